"""Travel times against the closed form and against the defining equation."""

import numpy as np
import pytest

from uwtrack_cli.errors import DataError
from uwtrack_cli.simulate.delay import FIRST_STEP, Path
from uwtrack_cli.simulate.track_plans import TrackPlan, Turn
from uwtrack_cli.simulate.trajectories import Trajectory, fixed, track_trajectory


def straight_passage(time_s, speed, slant, c, t0):
    """Range at emission and emission time: Choi 2014 corrected, row 'exact'."""
    mach, past = speed / c, time_s - t0
    root = np.sqrt(speed**2 * past**2 + (1.0 - mach**2) * slant**2)
    emitted = (past - root / c) / (1.0 - mach**2)
    return (root - mach**2 * c * past) / (1.0 - mach**2), emitted


@pytest.mark.parametrize(
    ("speed", "horizontal", "depth", "c", "rate", "t0"),
    [
        (6.0, 250.0, 19.0, 1500.0, 2000.0, 150.0),
        (34.1, 10.0, 1.0, 343.0, 4000.0, 3.0),
        (12.0, 3.0, 2.0, 1500.0, 1000.0, 20.0),
        (0.3, 5000.0, 100.0, 1450.0, 500.0, -40.0),
    ],
)
def test_delay_follows_the_closed_form_to_a_nanosecond(speed, horizontal, depth, c, rate, t0):
    north = Trajectory(((t0, horizontal, 0.0, 0.0, speed, 0.0),))
    path = Path(north, 3.0, fixed(0.0, 0.0), 3.0 + depth, c)
    count = 40 * FIRST_STEP * 4
    first = FIRST_STEP * int((t0 * rate - count / 2) / FIRST_STEP)
    delay, east, up = path.along(first, count, rate)
    time_s = (first + np.arange(count)) / rate
    distance, emitted = straight_passage(time_s, speed, np.hypot(horizontal, depth), c, t0)
    np.testing.assert_allclose(delay, distance / c, rtol=0, atol=1e-9)
    np.testing.assert_allclose(east, horizontal / distance, rtol=0, atol=1e-4)
    np.testing.assert_allclose(up, speed * emitted / distance, rtol=0, atol=1e-4)


def test_delay_between_two_turning_platforms_meets_its_definition():
    ship = track_trajectory(
        TrackPlan(
            east_m=-300.0,
            north_m=120.0,
            course_deg=80.0,
            speed_mps=7.0,
            turns=(
                Turn(at_s=20.0, course_deg=200.0, rate_deg_per_s=6.0),
                Turn(at_s=55.0, course_deg=10.0, rate_deg_per_s=2.0),
            ),
        )
    )
    boat = track_trajectory(
        TrackPlan(
            course_deg=300.0,
            speed_mps=3.0,
            turns=(Turn(at_s=30.0, course_deg=30.0, rate_deg_per_s=4.0),),
        )
    )
    path = Path(ship, 2.0, boat, 40.0, 1480.0)
    rate, count = 1000.0, 300 * FIRST_STEP
    delay, _, _ = path.along(0, count, rate)
    time_s = np.arange(count) / rate
    low, high = np.zeros(count), np.full(count, 10.0)  # bisection: no derivative
    here = boat.at(time_s)
    for _ in range(60):
        middle = 0.5 * (low + high)
        there = ship.at(time_s - middle)
        distance = np.sqrt((there[0] - here[0]) ** 2 + (there[1] - here[1]) ** 2 + 38.0**2)
        early = distance > 1480.0 * middle
        low, high = np.where(early, middle, low), np.where(early, high, middle)
    np.testing.assert_allclose(delay, 0.5 * (low + high), rtol=0, atol=1e-9)


def test_motion_through_turns_is_the_integral_of_its_velocity():
    motion = track_trajectory(
        TrackPlan(
            course_deg=350.0,
            speed_mps=5.0,
            turns=(
                Turn(at_s=10.0, course_deg=40.0, rate_deg_per_s=2.5),
                Turn(at_s=60.0, course_deg=330.0, rate_deg_per_s=1.0, speed_mps=9.0),
            ),
        )
    )
    time_s = np.linspace(0.0, 160.0, 160_001)
    east, north, east_rate, north_rate = motion.at(time_s)
    for place, rate in ((east, east_rate), (north, north_rate)):
        summed = np.concatenate([[0], np.cumsum((rate[1:] + rate[:-1]) / 2)]) * 1e-3
        np.testing.assert_allclose(place - place[0], summed, atol=0.01)
    speed = np.hypot(east_rate, north_rate)
    assert np.ptp(speed[time_s < 59.9]) < 1e-12
    course = np.degrees(np.arctan2(east_rate, north_rate)) % 360.0
    assert course[0] == pytest.approx(350.0)
    assert course[50_000] == pytest.approx(40.0)
    assert course[-1] == pytest.approx(330.0)
    assert speed[-1] == pytest.approx(9.0)


def test_waypoint_track_touches_its_legs_and_keeps_its_speed():
    track = TrackPlan(
        waypoints_m=((0.0, 0.0), (0.0, 400.0), (300.0, 400.0), (300.0, 0.0)),
        speed_mps=4.0,
        turn_radius_m=60.0,
    )
    motion = track_trajectory(track)
    time_s = np.linspace(0.0, 300.0, 30_001)
    east, north, east_rate, north_rate = motion.at(time_s)
    np.testing.assert_allclose(np.hypot(east_rate, north_rate), 4.0, rtol=1e-12)
    assert np.hypot(np.diff(east), np.diff(north)).max() == pytest.approx(0.04)
    assert abs(east[5000]) < 1e-9  # on the first leg, going north
    assert abs(north[15_000] - 400.0) < 1e-9  # on the second, going east
    assert abs(east[-1] - 300.0) < 1e-9  # on the last, going south
    assert north[-1] < north[-2]
    corner = np.hypot(east - 60.0, north - 340.0)[8_600:10_800]
    np.testing.assert_allclose(corner.min(), 60.0, atol=1e-3)


def test_source_that_runs_into_the_sensor_is_refused():
    through = Trajectory(((0.0, 0.0, 0.0, 0.0, 5.0, 0.0),))
    path = Path(through, 3.0, fixed(0.0, 0.0), 3.0, 1500.0)
    with pytest.raises(DataError, match="nearer than"):
        path.along(0, FIRST_STEP, 1000.0)
