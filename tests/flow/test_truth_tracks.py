"""Tracks, passages and calibrations against scipy and closed forms."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.flow import calibration
from uwtrack_cli.flow.scoring.ais_passages import _approaches, _passage, interpolate_track


def track_of(time_s, east, north, speed=None, course=None):
    nothing = np.full(time_s.size, np.nan)
    return VesselTrack(
        vessel="v", time_s=time_s, first=east, second=north,
        speed_mps=nothing if speed is None else speed,
        course_deg=nothing if course is None else course,
    )  # fmt: skip


def test_between_messages_a_track_is_hermites_cubic():
    rng = np.random.default_rng(1)
    time_s = np.array([0.0, 20.0, 50.0, 350.0, 651.0, 700.0])
    east, north = 100.0 * rng.normal(size=(2, 6))
    speed, course = rng.uniform(1, 9, 6), rng.uniform(0, 360, 6)
    track = track_of(time_s, east, north, speed, course)
    at = np.array([-0.1, 0.0, 7.0, 20.0, 35.0, 200.0, 400.0, 690.0, 700.0, 700.1])
    found = interpolate_track(track, east, north, at)
    slopes = speed * np.sin(np.radians(course)), speed * np.cos(np.radians(course))
    is_known = (at >= 0.0) & (at <= 700.0) & (at != 400.0)  # a gap of 301 s
    for own, values, slope in zip(found, (east, north), slopes, strict=True):
        wanted = CubicHermiteSpline(time_s, values, slope)(at)
        assert np.array_equal(np.isfinite(own), is_known)
        assert own[is_known] == pytest.approx(wanted[is_known])
    # without a speed the chord is the slope
    plain = interpolate_track(track_of(time_s, east, north), east, north, at)
    straight = np.interp(at, time_s, east)
    assert plain[0][is_known] == pytest.approx(straight[is_known])


@pytest.mark.parametrize(("course_deg", "side"), [(90.0, "starboard"), (270.0, "port")])
def test_a_passage_of_a_straight_track_is_closed_form(course_deg, side):
    """North of the sensor by 400 m at 5 m/s, 300 s into the track."""
    sensor = Sensor(id="h1", latitude=50.0, longitude=-1.0, depth_m=63.0)
    origin = Origin(50.0, -1.0)
    time_s = np.arange(0.0, 700.0, 10.0)
    along = 5.0 * (time_s - 300.0) * (1.0 if course_deg == 90.0 else -1.0)
    per_degree = [
        to_grid(50.001, -1.0, origin)[1] / 0.001, to_grid(50.0, -0.999, origin)[0] / 0.001
    ]  # fmt: skip
    track = track_of(
        time_s, 50.0 + np.full(time_s.size, 400.0) / per_degree[0], -1.0 + along / per_degree[1]
    )
    (found,) = _approaches(track, origin, (0.0, 690.0))
    assert found[0] == pytest.approx(300.0, abs=0.5)
    truth = Truth(
        name="t", start_utc_ns=0, is_geographic=True, tracks=(track,), position_std_m=10.0
    )
    row = _passage(truth, track, sensor, (300.0, (0.0, 400.0), found[2]))
    depth_m = 63.0 - calibration.SOURCE_DEPTH_M
    slant_m = np.hypot(400.0, depth_m)
    speed = np.hypot(*found[2])
    wanted = {
        "time_s": (300.0, 10.0 / speed), "speed_mps": (5.0, 0.1),
        "slant_range_m": (slant_m, 10.0), "horizontal_range_m": (400.0, 10.0),
        "course_deg": (course_deg, 2.0),
        "bearing_deg": (0.0, np.degrees(10.0 / 400.0)),
        "range_over_speed_s": (slant_m / speed, slant_m / speed * np.hypot(
            10.0 / slant_m, 0.1 / speed)),
    }  # fmt: skip
    for name, (value, std) in wanted.items():
        assert row.values[name] == pytest.approx(value, rel=2e-3, abs=1e-6), name
        assert row.std[name] == pytest.approx(std), name
    assert row.side == side
    slow = _passage(truth, track, sensor, (300.0, (0.0, 400.0), (0.05, 0.0)))
    assert "range_over_speed_s" not in slow.values
    assert slow.std["time_s"] == 10.0 / 0.1
    assert not list(_approaches(track, Origin(51.1, -1.0), (0.0, 690.0)))
    assert not list(_approaches(track, origin, (1000.0, 1500.0)))


def calibration_track(clock=None, **facts):
    time_s = np.arange(0.0, 400.0, 5.0)
    east, north = 4.0 * (time_s - 150.0), np.full(time_s.size, 200.0)
    track = track_of(time_s, east + 30.0, north - 40.0)
    sensor = Sensor(
        id="h1", kind="difar", channels="omni,x,y", heading_deg=20.0, depth_m=50.0,
        compass_offset_deg=3.0, position_std_m=3.0, clock_std_s=clock,
    )  # fmt: skip
    truth = Truth(
        name="t", start_utc_ns=0, is_geographic=False, tracks=(track,),
        position_std_m=4.0, sensor_places={"h1": (30.0, -40.0)},
    )  # fmt: skip
    return track, replace(sensor, **facts), truth


@pytest.mark.parametrize("clock_std_s", [0.0, 0.5])
def test_known_bearings_and_their_slopes_are_those_of_the_place_of_the_sound(clock_std_s):
    _, sensor, truth = calibration_track(clock_std_s)
    (own,) = calibration._tracks(truth, sensor, (0.0, 300.0))
    time_s = np.arange(100.0, 300.0, 20.0)
    east, north = own.heard(time_s, 1500.0)
    # where it was: c (t - t0) is the range then, a quadratic in t0
    for t, x, y in zip(time_s, east, north, strict=True):
        late = np.roots([
            1500.0**2 - 16.0, 2 * (16.0 * 150.0 - 1500.0**2 * t),
            1500.0**2 * t**2 - 16.0 * 150.0**2 - 200.0**2,
        ]).min()  # fmt: skip
        assert (x, y) == pytest.approx((4.0 * (late - 150.0), 200.0), abs=0.01)
    used = np.arange(time_s.size) != 3
    frames = SimpleNamespace(power=None, intensity=None, n_cells=None)
    known = calibration._passage(sensor, truth, frames, (own, time_s, used))
    range_m = np.hypot(east, north)
    angle = np.arctan2(east, north) - np.radians(23.0)
    assert known.angle_rad == pytest.approx(np.where(used, angle, np.nan), nan_ok=True)
    height_m = 50.0 - calibration.SOURCE_DEPTH_M
    assert known.cos_elevation == pytest.approx(range_m / np.hypot(range_m, height_m))
    # the bearing turns by north / r^2 per metre eastwards, and with the vessel
    slopes = [north / range_m**2, -east / range_m**2, -4.0 * north / range_m**2]
    std = [5.0, 5.0, clock_std_s]
    count = 3 if clock_std_s else 2
    assert np.allclose(known.slope, np.stack(slopes[:count], axis=-1), rtol=0.02, atol=1e-6)
    assert known.prior_std == pytest.approx(std[:count])
    fixed = replace(sensor, channels="omni,east,north", depth_m=None)
    plain = calibration._passage(fixed, truth, frames, (own, time_s, used))
    turned = np.where(used, np.arctan2(east, north) - np.radians(3.0), np.nan)
    assert plain.angle_rad == pytest.approx(turned, nan_ok=True)
    assert np.array_equal(plain.cos_elevation, np.ones(time_s.size))


@pytest.mark.parametrize(
    ("one_deg", "other_deg", "wanted_deg"),
    [(10.0, 350.0, 20.0), (350.0, 10.0, -20.0), (30.0, 10.0, 20.0), (10.0, 95.0, -85.0)],
)
def test_bearings_differ_the_short_way_round(one_deg, other_deg, wanted_deg):
    one, other = np.radians([one_deg]), np.radians([other_deg])
    assert np.degrees(calibration._difference(one, other)) == pytest.approx(wanted_deg)


def test_the_vessel_of_a_calibration_is_the_nearest_or_the_one_named():
    _, sensor, truth = calibration_track()
    heard = {
        "Alpha": np.array([[300.0, 100.0], [0.0, 50.0]]),
        "Beta": np.array([[90.0, np.nan], [0.0, 0.0]]),
        "Gone": np.full((2, 2), np.nan),
    }
    assert calibration._chosen(heard, None, 2000.0, truth) == "Beta"
    assert calibration._chosen(heard, "alp", 2000.0, truth) == "Alpha"
    assert calibration._chosen(heard, "alp", np.hypot(100.0, 50.0), truth) == "Alpha"
    for name, within_m, words in (
        ("alp", 111.0, "nearest came to 112 m"), (None, 89.0, "nearest came to 90 m"),
        ("a", 2000.0, "found 2"), ("gone", 2000.0, "found 0"),
    ):  # fmt: skip
        with pytest.raises(calibration.DataError, match=words):
            calibration._chosen(heard, name, within_m, truth)
    late = list(calibration._tracks(truth, sensor, (395.1, 500.0)))
    early = list(calibration._tracks(truth, sensor, (-9.0, -0.1)))
    assert (late, early) == ([], [])
    assert len(list(calibration._tracks(truth, sensor, (395.0, 500.0)))) == 1


def test_what_was_measured_is_the_sensors():
    _, sensor, _ = calibration_track()
    fit = SimpleNamespace(
        value=np.array([1.1234567, 0.9, 0.01, 0.02, -0.03, 178.5]), bearing_std_deg=1.23456
    )
    found = calibration._corrected(sensor, fit)
    assert found.dipole_gains == "1.12346,0.9"
    assert found.dipole_crosstalk == 0.01
    assert found.omni_crosstalk == "0.02,-0.03"
    assert found.compass_offset_deg == pytest.approx(-178.5)  # 3 and 178.5
    assert found.compass_std_deg == 1.235
