"""Positions from the closest approaches of one sensor and more."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from uwtrack_cli.acoustics.geodesy import Origin, to_latitude_longitude
from uwtrack_cli.acoustics.geometry import compass_unit
from uwtrack_cli.data.base import reason_columns
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.motion.fusion.motion_fit import clock_errors, speed_from_two
from uwtrack_cli.motion.fusion.sensor_table import gather_passages
from uwtrack_cli.motion.fusion.track_to_track import find_modes
from uwtrack_cli.motion.locate import locate_vessels

COURSE, SPEED = 80.0, 6.0
DEVIATIONS = np.array([0.1, 0.3, 0.02, 0.4])


def sensor_at(name, along, off, **facts):
    """Sensor beside the track: ``off`` metres to starboard of it."""
    place = along * compass_unit(COURSE) + off * compass_unit(COURSE + 90)
    facts = {"east_m": place[0], "north_m": place[1], "kind": "difar", "clock_std_s": 0.0} | facts
    return Sensor(id=name, **facts)


def encounter_of(
    sensor, along, off, *, error=(0.0, 0.0, 0.0, 0.0), has_speed=True,
    has_bearing=True, rest=(63.0, 126.0), contact=1, start_ns=-1, start_s=0.0,
):  # fmt: skip
    """The exact closest approach (plus errors) of the vessel that is at 0 at 0 s."""
    turn = 1 if off > 0 else -1
    time = along / SPEED + error[0]
    width = abs(off) / SPEED + error[1]
    speed = SPEED + error[2] if has_speed else np.nan
    bearing = (COURSE - 90 * turn + error[3]) % 360 if has_bearing else np.nan
    arrival = time if has_speed else time + abs(off) / 1500.0
    std = DEVIATIONS.copy()
    covariance = np.diag(std**2)
    for row, known in ((2, has_speed), (3, has_bearing)):
        if not known:
            covariance[row, :] = covariance[:, row] = np.nan
    one = np.ones(1)
    shown = time if has_speed else arrival
    return Encounters(
        contact=one * contact, sensor=np.array([sensor.id]),
        status=np.array(["ok" if has_speed else "level-only"]),
        time_s=one * shown - start_s, time_std_s=one * std[0],
        time_utc_ns=np.array([start_ns if start_ns < 0 else start_ns + round(1e9 * shown)]),
        arrival_time_s=one * arrival - start_s,
        speed_mps=one * speed, speed_std_mps=one * std[2],
        slant_range_m=one * width * speed, slant_range_std_m=one,
        horizontal_range_m=one * width * speed, range_over_speed_s=one * width,
        range_over_speed_std_s=one * std[1], course_deg=one * COURSE,
        course_std_deg=one * std[3], bearing_deg=one * bearing,
        bearing_std_deg=one * std[3],
        side=np.array([("starboard" if turn > 0 else "port") if has_bearing else ""]),
        sound_speed_mps=one * 1500.0, received_level_db=one * np.nan,
        received_level_std_db=one * np.nan, source_level_db=one * np.nan,
        source_level_std_db=one * np.nan, extrapolated=np.zeros(1, bool),
        covariance=covariance[None], ambiguity_encounter=[], ambiguity_side=[],
        ambiguity_weight=[], **reason_columns("reason_encounter", [{}]),
        rest_encounter=np.zeros(len(rest)),
        rest_line_id=np.arange(len(rest)), rest_frequency_hz=np.array(rest, float),
        rest_frequency_std_hz=np.full(len(rest), 0.003), reference="1 uPa",
    )  # fmt: skip


def truth_at(time_s):
    return SPEED * time_s * compass_unit(COURSE)


def test_one_sensor_with_doppler_predicts_the_track():
    sensor = sensor_at("h1", 600.0, 250.0)
    fixes = locate_vessels([encounter_of(sensor, 600.0, 250.0)], [sensor], at=["0", "900"])
    for row, time in enumerate((0.0, 900.0)):
        found = [fixes.east_m[row], fixes.north_m[row]]
        np.testing.assert_allclose(found, truth_at(time), atol=1e-6)
    assert fixes.course_deg[0] == pytest.approx(COURSE)
    assert fixes.weight.tolist() == [1.0, 1.0]


def test_the_covariance_grows_as_the_closed_form_says():
    """Along: sqrt(h^2 sv^2 + v^2 st^2 + d^2 sb^2); across: sqrt(sd^2 + (v h sb)^2)."""
    sensor = sensor_at("h1", 600.0, 250.0)
    lag = 1500.0
    fixes = locate_vessels([encounter_of(sensor, 600.0, 250.0)], [sensor], at=[str(100.0 + lag)])
    time, width, speed, bearing = DEVIATIONS
    turn = np.deg2rad(bearing)
    reach_std = np.hypot(width * SPEED, speed * 250.0 / SPEED)
    along = compass_unit(COURSE)
    across = compass_unit(COURSE + 90)
    covariance = fixes.covariance_m2[0]
    expected = (lag * speed) ** 2 + (SPEED * time) ** 2 + (250.0 * turn) ** 2
    assert along @ covariance @ along == pytest.approx(expected, rel=1e-3)
    expected = reach_std**2 + (SPEED * lag * turn) ** 2
    assert across @ covariance @ across == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    "places",
    [
        {600.0: 150.0, 1500.0: 320.0},
        {600.0: 150.0, 1500.0: -320.0},
        {600.0: -150.0, 1500.0: -40.0},
        {600.0: 150.0, 1500.0: -320.0, 2400.0: 90.0},
    ],
    ids=["same-side", "opposite-sides", "port", "three"],
)
def test_sensors_without_doppler_are_exact_without_noise(places):
    names = [f"h{number}" for number in range(1, 1 + len(places))]
    sensors = [sensor_at(n, *at) for n, at in zip(names, places.items(), strict=True)]
    encounters = [
        encounter_of(s, *at, has_speed=False, rest=())
        for s, at in zip(sensors, places.items(), strict=True)
    ]
    fixes = locate_vessels(encounters, sensors, at=["1800"])
    assert fixes.sensors.tolist() == [",".join(names)]
    np.testing.assert_allclose([fixes.east_m[0], fixes.north_m[0]], truth_at(1800.0), atol=1e-4)
    assert fixes.speed_mps[0] == pytest.approx(SPEED, rel=1e-7)


def test_the_corrected_quadratic_refuses_sensors_too_close_in_time():
    sensor = np.array([[0.0, 0.0], [0.0, 500.0]])
    miss = np.array([[10.0, 0.0], [-60.0, 0.0]])
    assert np.isnan(speed_from_two(sensor, np.array([0.0, 5.0]), miss))


def test_three_sensors_give_smaller_deviations_than_two():
    names = ("h1", "h2", "h3")
    along, off = (600.0, 1500.0, 2400.0), (150.0, -200.0, 90.0)
    sensors = [sensor_at(*item) for item in zip(names, along, off, strict=True)]
    encounters = [encounter_of(s, a, o) for s, a, o in zip(sensors, along, off, strict=True)]
    two = locate_vessels(encounters[:2], sensors[:2], at=["1000"])
    three = locate_vessels(encounters, sensors, at=["1000"])
    assert three.sensors.tolist() == ["h1,h2,h3"]
    assert np.trace(three.covariance_m2[0]) < np.trace(two.covariance_m2[0])


@pytest.mark.slow
@pytest.mark.parametrize(("position_std_m", "clock_std_s"), [(0.0, 0.0), (15.0, 0.0), (0.0, 2.0)])
def test_fused_positions_hold_their_error_bars(position_std_m, clock_std_s):
    """On both sides, when places or clocks of the sensors are known roughly, too."""
    rng = np.random.default_rng(1)
    scores = []
    for _ in range(150):
        encounters, sensors = [], []
        for name, along, off in (("h1", 600.0, 150.0), ("h2", 1500.0, -300.0)):
            sensor = sensor_at(name, along, off)
            error = DEVIATIONS * rng.normal(size=4)
            error[0] += clock_std_s * rng.normal()
            encounters.append(encounter_of(sensor, along, off, error=error))
            east_m, north_m = position_std_m * rng.normal(size=2)
            sensors.append(
                replace(
                    sensor,
                    east_m=sensor.east_m + east_m,
                    north_m=sensor.north_m + north_m,
                    position_std_m=position_std_m,
                    clock_std_s=clock_std_s,
                )
            )
        fixes = locate_vessels(encounters, sensors, at=["1500"])
        if fixes.sensors.tolist() != ["h1,h2"]:
            continue
        error = np.array([fixes.east_m[0], fixes.north_m[0]]) - truth_at(1500.0)
        scores.append(error @ np.linalg.solve(fixes.covariance_m2[0], error))
    assert len(scores) >= 146
    assert np.mean(scores) == pytest.approx(2.0, abs=4 * 2 / np.sqrt(len(scores)))


def test_encounters_of_different_vessels_are_not_joined():
    sensors = [sensor_at("h1", 600.0, 150.0), sensor_at("h2", 1500.0, -300.0)]
    encounters = [
        encounter_of(sensors[0], 600.0, 150.0),
        encounter_of(sensors[1], 1500.0, -300.0, error=(90.0, 0, 0, 0)),
    ]
    fixes = locate_vessels(encounters, sensors, at=["1500"])
    assert fixes.sensors.tolist() == ["h1", "h2"]


def test_encounters_with_other_rest_frequencies_are_not_joined():
    sensors = [sensor_at("h1", 600.0, 150.0), sensor_at("h2", 1500.0, -300.0)]
    encounters = [
        encounter_of(sensors[0], 600.0, 150.0),
        encounter_of(sensors[1], 1500.0, -300.0, rest=(71.0, 142.0)),
    ]
    fixes = locate_vessels(encounters, sensors, at=["1500"])
    assert fixes.sensors.tolist() == ["h1", "h2"]


def lack_of_fit(sensors, encounters):
    """Least weighted square error of a straight track, by scipy."""

    def residuals(state):
        place, velocity = state[:2], state[2:]
        speed = np.hypot(*velocity)
        values = []
        for sensor, found in zip(sensors, encounters, strict=True):
            away = place - [sensor.east_m, sensor.north_m]
            time = -(away @ velocity) / speed**2
            closest = away + time * velocity
            bearing = np.rad2deg(np.arctan2(*closest))
            values += [
                time - found.time_s[0],
                np.hypot(*closest) / speed - found.range_over_speed_s[0],
                speed - found.speed_mps[0],
                (bearing - found.bearing_deg[0] + 180.0) % 360.0 - 180.0,
            ]
        return np.array(values) / np.tile(DEVIATIONS, len(sensors))

    start = np.concatenate([truth_at(0.0), SPEED * compass_unit(COURSE)])
    return 2.0 * least_squares(residuals, start, x_scale=[100.0, 100.0, 1.0, 1.0]).cost


def test_rival_pairings_are_listed_with_weights():
    sensors = [sensor_at("h1", 600.0, 150.0), sensor_at("h2", 1500.0, -300.0)]
    first = encounter_of(sensors[0], 600.0, 150.0)
    second = [
        encounter_of(sensors[1], 1500.0, -300.0, error=(error, 0, 0, 0), contact=contact)
        for contact, error in ((1, 0.1), (2, -0.5))
    ]
    fixes = locate_vessels([first, *second], sensors, at=["1500"])
    lack = [lack_of_fit(sensors, [first, other]) for other in second]
    weight = fixes.weight[fixes.contact == 1]
    assert weight.tolist() == sorted(weight, reverse=True)
    likelihood = np.exp(-0.5 * (np.array(lack) - min(lack)))
    assert weight == pytest.approx(likelihood / likelihood.sum(), abs=1e-3)
    assert weight[0] - weight[1] > 0.05


def test_sensors_with_latitude_and_longitude_give_such_positions():
    origin = Origin(35.0, 128.5)
    places = []
    for along, off in ((600.0, 150.0), (1500.0, -300.0)):
        place = along * compass_unit(COURSE) + off * compass_unit(COURSE + 90)
        lat, lon = to_latitude_longitude(place[:1], place[1:], origin)
        places.append({"latitude": float(lat[0]), "longitude": float(lon[0])})
    sensors = [
        sensor_at(name, 0, 0, east_m=None, north_m=None, depth_m=None, **place)
        for name, place in zip(("h1", "h2"), places, strict=True)
    ]
    encounters = [encounter_of(sensors[0], 600.0, 150.0), encounter_of(sensors[1], 1500.0, -300.0)]
    fixes = locate_vessels(encounters, sensors, at=["1000"])
    expected = truth_at(1000.0)
    lat, lon = to_latitude_longitude(expected[:1], expected[1:], origin)
    assert fixes.latitude[0] == pytest.approx(lat[0], abs=2e-6)
    assert fixes.longitude[0] == pytest.approx(lon[0], abs=2e-6)


def test_a_mirrored_world_gives_mirrored_fixes():
    def mirrored(item):
        return replace(
            item, bearing_deg=-item.bearing_deg % 360,
            side=np.where(item.side == "port", "starboard", "port"),
        )  # fmt: skip

    sensors = [sensor_at("h1", 600.0, 150.0), sensor_at("h2", 1500.0, -300.0)]
    encounters = [encounter_of(sensors[0], 600.0, 150.0), encounter_of(sensors[1], 1500.0, -300.0)]
    one = locate_vessels(encounters, sensors, at=["700"])
    two = locate_vessels(
        [mirrored(item) for item in encounters],
        [replace(s, east_m=-s.east_m) for s in sensors],
        at=["700"],
    )
    assert two.east_m[0] == pytest.approx(-one.east_m[0], abs=1e-6)
    assert two.north_m[0] == pytest.approx(one.north_m[0], abs=1e-6)


def test_recordings_that_start_at_different_times_share_the_utc_clock():
    start = 1_700_000_000_000_000_000
    sensors = [sensor_at("h1", 600.0, 150.0), sensor_at("h2", 1500.0, -300.0)]
    encounters = [
        encounter_of(sensors[0], 600.0, 150.0, start_ns=start),
        encounter_of(sensors[1], 1500.0, -300.0, start_ns=start, start_s=100.0),
    ]
    fixes = locate_vessels(encounters, sensors, at=["2023-11-14T22:30:00Z"])
    assert fixes.sensors.tolist() == ["h1,h2"]
    lag = (fixes.time_utc_ns[0] - start) / 1e9
    np.testing.assert_allclose([fixes.east_m[0], fixes.north_m[0]], truth_at(lag), atol=1e-3)


def test_one_sensor_without_doppler_has_no_position_and_says_why():
    sensor = sensor_at("h1", 600.0, 250.0)
    alone = encounter_of(sensor, 600.0, 250.0, has_speed=False)
    with pytest.warns(UwtrackWarning, match="one sensor needs a speed"):
        fixes = locate_vessels([alone], [sensor])
    assert fixes.time_s.size == 0


def test_two_readings_of_one_sensor_are_two_contacts():
    sensor = sensor_at("h1", 600.0, 250.0)
    one = encounter_of(sensor, 600.0, 250.0)
    assert locate_vessels([one], [sensor]).contact.tolist() == [1]
    assert locate_vessels([one, one], [sensor]).contact.tolist() == [1, 2]


def test_regular_times_run_from_the_first_closest_approach():
    sensor = sensor_at("h1", 600.0, 250.0)
    fixes = locate_vessels(
        [encounter_of(sensor, 600.0, 250.0)], [sensor], every_s=60.0, until="300"
    )
    assert fixes.time_s.tolist() == [100.0, 160.0, 220.0, 280.0]


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"every_s": 0.0}, "every_s must be a number .s, at least 0.001"),
        ({"until": "5"}, "needs every_s"),
        ({"at": ["noon"]}, "cannot read the time"),
        ({"at": ["1e308"]}, "1e308 is no number of seconds within 1e.09"),
        ({"at": ["nan"]}, "nan is no number of seconds"),
        ({"gate_probability": 1.0}, "gate_probability"),
    ],
)
def test_options_out_of_range_are_refused(options, match):
    sensor = sensor_at("h1", 600.0, 250.0)
    with pytest.raises(OptionError, match=match):
        locate_vessels([encounter_of(sensor, 600.0, 250.0)], [sensor], **options)


def test_several_sensors_need_positions():
    sensors = [sensor_at("h1", 600.0, 150.0), Sensor(id="h2", kind="difar")]
    encounters = [encounter_of(sensors[0], 600.0, 150.0), encounter_of(sensors[1], 1500.0, -300.0)]
    with pytest.raises(DataError, match="positions of one kind"):
        locate_vessels(encounters, sensors)


@pytest.mark.parametrize("stated", [None, 5.0])
@pytest.mark.parametrize("error_s", [3.6, -3.6])
def test_a_clock_error_is_named_and_gives_one_vessel(stated, error_s):
    sensors = [
        sensor_at("h1", 600.0, 150.0, clock_std_s=stated),
        sensor_at("h2", 1500.0, -300.0, clock_std_s=stated),
    ]
    encounters = [
        encounter_of(sensors[0], 600.0, 150.0),
        encounter_of(sensors[1], 1500.0, -300.0, error=(error_s, 0, 0, 0)),
    ]
    fixes = locate_vessels(encounters, sensors, at=["1500"])
    assert fixes.sensors.tolist() == ["h1,h2"]
    assert "The clocks of h1 and h2 differ by 3.6" in fixes.statement
    assert f"{'h2' if error_s > 0 else 'h1'} is ahead" in fixes.statement


def test_the_estimate_of_a_clock_error_holds_its_deviation():
    """Coverage over 300 drawn clock errors: mean square of errors in deviations."""
    rng = np.random.default_rng(8)
    scores = []
    for _ in range(300):
        clock = 5.0 * rng.standard_normal(2)
        sensors = [
            sensor_at("h1", 600.0, 150.0, clock_std_s=5.0),
            sensor_at("h2", 1500.0, -300.0, clock_std_s=5.0),
        ]
        errors = DEVIATIONS * rng.standard_normal((2, 4))
        errors[:, 0] += clock
        encounters = [
            encounter_of(sensors[0], 600.0, 150.0, error=errors[0]),
            encounter_of(sensors[1], 1500.0, -300.0, error=errors[1]),
        ]
        passages = gather_passages(encounters, sensors)
        (mode, *_) = find_modes(passages, (0, 1))
        offset, spread = clock_errors(
            passages.approaches, mode.state, mode.reference_s, passages.clock_std_s
        )
        change = np.array([-1.0, 1.0])
        error = change @ offset - (clock[1] - clock[0])
        scores.append(error**2 / (change @ spread @ change))
    assert np.mean(scores) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 300))


def test_exact_clocks_say_nothing():
    sensors = [sensor_at("h1", 600.0, 150.0), sensor_at("h2", 1500.0, -300.0)]
    encounters = [encounter_of(sensors[0], 600.0, 150.0), encounter_of(sensors[1], 1500.0, -300.0)]
    assert locate_vessels(encounters, sensors).statement == ""
