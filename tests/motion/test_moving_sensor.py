"""Closest approaches to a sensor that moves, and positions that follow from them."""

import numpy as np
import pytest

from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.locate import locate_vessels

C_MPS, REST_HZ, CLOSEST_S = 1500.0, np.array([120.0, 240.0]), 300.0
SENSOR_MPS = np.array([1.2, -0.8])
VESSEL_MPS, MISS_M = np.array([1.0, 5.0]), np.array([220.0, -30.0])


def navigation(time, *, turn_at=None):
    """The sensor passes the origin at the closest approach."""
    east, north = SENSOR_MPS[:, None] * (time - CLOSEST_S)
    if turn_at is not None:
        late = np.maximum(time - turn_at, 0.0)
        east = east - 2.0 * SENSOR_MPS[0] * late
    return Navigation(
        time_s=time, east_m=east, north_m=north, heading_deg=np.full(time.size, np.nan)
    )


def vessel_at(time):
    relative = VESSEL_MPS - SENSOR_MPS
    across = np.array([relative[1], -relative[0]]) / np.hypot(*relative)
    nearest = across * (across @ MISS_M)
    return nearest[:, None] + VESSEL_MPS[:, None] * (time - CLOSEST_S)


def received(time, ship):
    """Bearing (degrees) and frequency ratio by the exact retarded time."""

    def path(at):
        own = np.stack(
            [np.interp(time, ship.time_s, ship.east_m), np.interp(time, ship.time_s, ship.north_m)]
        )
        return vessel_at(at) - own

    emitted = time.copy()
    for _ in range(30):
        emitted = time - np.hypot(*path(emitted)) / C_MPS
    step = 0.5

    def emission(at):
        guess = at.copy()
        for _ in range(30):
            own = np.stack(
                [np.interp(at, ship.time_s, ship.east_m), np.interp(at, ship.time_s, ship.north_m)]
            )
            guess = at - np.hypot(*(vessel_at(guess) - own)) / C_MPS
        return guess

    ratio = (emission(time + step) - emission(time - step)) / (2 * step)
    east, north = path(emitted)
    return np.degrees(np.arctan2(east, north)) % 360.0, ratio


def table(rng, ship):
    time = np.arange(2.0, 598.0)
    bearing, ratio = received(time, ship)
    frequency = REST_HZ * ratio[:, None] + 0.01 * rng.standard_normal((time.size, 2))
    return Series(
        contact=np.ones(time.size), time_s=time,
        bearing_deg=(bearing + 2.0 * rng.standard_normal(time.size)) % 360.0,
        bearing_std_deg=np.full(time.size, 2.0), frequency_hz=frequency,
        frequency_std_hz=np.full(frequency.shape, 0.01),
        level_db=np.full(time.size, np.nan), level_std_db=np.full(time.size, np.nan),
        start_utc_ns=None,
    )  # fmt: skip


def sensor_with(ship):
    return Sensor(
        id="s1", kind="difar", depth_m=22.0, depth_std_m=0.0, sound_speed_std_mps=0.0,
        navigation=ship,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_speed_course_and_position_are_those_over_ground(seed):
    ship = navigation(np.arange(0.0, 601.0))
    sensor = sensor_with(ship)
    series = table(np.random.default_rng(seed), ship)
    found = find_encounters(series=series, sensor=sensor)
    assert found.status[0] == "ok"
    speed = np.hypot(*VESSEL_MPS)
    course = np.degrees(np.arctan2(*VESSEL_MPS))
    assert abs(found.speed_mps[0] - speed) < 3.5 * found.speed_std_mps[0]
    assert found.speed_std_mps[0] < 0.3
    turned = (found.course_deg[0] - course + 180.0) % 360.0 - 180.0
    assert abs(turned) < 3.5 * found.course_std_deg[0]
    assert found.sensor_velocity_east_mps[0] == pytest.approx(SENSOR_MPS[0])
    fixes = locate_vessels([found], [sensor], at=[str(CLOSEST_S), "500"])
    for row, time in enumerate((CLOSEST_S, 500.0)):
        error = (
            np.array([fixes.east_m[row], fixes.north_m[row]]) - vessel_at(np.array([time]))[:, 0]
        )
        assert error @ np.linalg.solve(fixes.covariance_m2[row], error) < 16.0
        assert np.sqrt(np.trace(fixes.covariance_m2[row])) < 80.0


def test_a_sensor_that_turns_gives_a_reason_and_no_passage():
    ship = navigation(np.arange(0.0, 601.0), turn_at=250.0)
    series = table(np.random.default_rng(1), ship)
    found = find_encounters(series=series, sensor=sensor_with(ship))
    assert found.status.size == 0
    (reason,) = found.refused_reason
    assert "turned" in reason


def test_navigation_that_does_not_cover_the_passage_is_refused():
    whole = navigation(np.arange(0.0, 601.0))
    series = table(np.random.default_rng(1), whole)
    short = navigation(np.arange(0.0, 200.0))
    with pytest.raises(DataError, match="navigation of the sensor covers 0 to 199 s"):
        find_encounters(series=series, sensor=sensor_with(short))
