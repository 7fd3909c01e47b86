"""Bearings of several sensors in one table give one motion, with a place on the map."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.sensor_tables import buoys, untold
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.motion.locate import locate_vessels
from uwtrack_cli.motion.options import Nuisances
from uwtrack_cli.motion.tma import estimate_motion

MIDDLE = ["600"]


def one_fix(fixes, row):
    """Return one row of the fixes."""
    return fixes.take("fix", np.array([row]))


def errors(fixes, place, velocity):
    """Return the error of the fix at 600 s, and its square in units of the ellipse."""
    off = np.array([fixes.east_m[0], fixes.north_m[0]]) - place - 600.0 * velocity
    return np.hypot(*off), off @ np.linalg.solve(fixes.covariance_m2[0], off)


@pytest.mark.slow
@pytest.mark.parametrize(("told", "count"), [(True, 5), (False, 2)])
def test_four_drifting_buoys_with_offsets_and_outliers_give_one_place(told, count):
    square, size = [], []
    for seed in range(count):
        series, place, velocity, _ = buoys(seed, rows=36)
        fixes = locate_vessels(series=series if told else untold(series), at=MIDDLE)
        assert np.unique(fixes.contact).tolist() == [1]
        far, chance = errors(fixes, place, velocity)
        square.append(chance)
        size.append(far)
    # 95 % due: three or more of five beyond happen once in 860 such tests; and the
    # ellipses are not far too wide: chi-square of two has the median 1.4
    assert np.count_nonzero(np.array(square) > 5.99) < 3
    assert np.median(square) > 0.3
    assert np.median(size) < 150.0


def test_a_still_source_has_a_fix_and_the_offsets_are_told():
    series, place, velocity, _ = buoys(3, moving=False, strange=0.0, std_deg=2.0)
    motions = estimate_motion(series)
    _, chance = errors(locate_vessels(series=series, at=MIDDLE), place, velocity)
    assert chance < 9.2
    assert motions.offset_sensor.tolist() == ["b0", "b1", "b2", "b3"]
    assert motions.speed_mps[0] < 4.0 * motions.speed_std_mps[0] + 0.05
    assert motions.reference.tolist() == ["b0"]


@pytest.mark.slow
def test_a_source_at_rest_is_read_as_still_and_one_that_moves_as_moving():
    for seed in (3, 11):
        series, place, _, _ = buoys(seed, moving=False, rows=40)
        fixes = locate_vessels(series=series, at=["0", "1200"])
        assert set(fixes.motion_model) == {"stationary"}
        assert np.isnan(fixes.course_deg).all()
        assert np.isnan(fixes.course_std_deg).all()
        assert fixes.motion_model_probability[0] > 0.6
        # both readings are in the place: little motion is left, and the ellipse holds
        # (beyond 99.9 %: once in 170 such tests)
        assert np.hypot(np.ptp(fixes.east_m), np.ptp(fixes.north_m)) < 100.0
        assert errors(one_fix(fixes, 0), place, np.zeros(2))[1] < 13.8
    series, _, velocity, _ = buoys(3, rows=40)
    fixes = locate_vessels(series=series, at=MIDDLE)
    assert (fixes.motion_model[0], fixes.alternative_motion_model[0]) == ("moving", "")
    course = np.degrees(np.arctan2(*velocity))
    off = (fixes.course_deg[0] - course + 180.0) % 360.0 - 180.0
    assert abs(off) < 4.0 * fixes.course_std_deg[0]
    assert fixes.motion_model_probability[0] > 0.99


def test_the_readings_part_where_the_drift_is_about_its_deviation():
    # one table of noise, the source drifting faster and faster: the odds turn over once
    chance = []
    for speed in (0.0, 0.1, 0.3, 1.0):
        series, *_ = buoys(3, rows=20, strange=0.0, std_deg=4.0, speeds_mps=(speed, speed))
        fixes = locate_vessels(series=series, at=MIDDLE)
        is_still = fixes.motion_model[0] == "stationary"
        weight = fixes.motion_model_probability[0]
        chance.append(weight if is_still else 1.0 - weight)
        other = min(weight, 1.0 - weight)
        assert (fixes.alternative_motion_model[0] != "") == (other >= 0.05)
    assert chance == sorted(chance, reverse=True)
    assert chance[0] > 0.5
    assert chance[-1] < 1e-3


def test_bearings_of_one_moment_tell_a_place_whose_ellipse_grows_as_a_vessel_may_go():
    square = []
    for seed in range(10):
        series, place, _, _ = buoys(seed + 300, rows=1, strange=0.0, std_deg=3.0)
        fixes = locate_vessels(series=series, at=["0", "100"])
        square.append(errors(fixes, place, np.zeros(2))[1])
        spread = np.linalg.eigvalsh(fixes.covariance_m2)
        assert np.all(spread[1] > 1000.0**2)
    # five or more of ten beyond a 95 % region happen once in 15,000 such tests
    assert np.count_nonzero(np.array(square) > 5.99) < 5


@pytest.mark.slow
def test_the_order_of_rows_and_the_origin_of_the_grid_do_not_matter():
    series, *_ = buoys(5)
    mixed = series.take("row", np.random.default_rng(1).permutation(series.time_s.size))
    moved = replace(mixed, sensor_east_m=mixed.sensor_east_m + 5e4)
    first, second = (locate_vessels(series=s, at=MIDDLE) for s in (series, moved))
    assert second.east_m[0] - 5e4 == pytest.approx(first.east_m[0], abs=2.0)
    assert second.north_m[0] == pytest.approx(first.north_m[0], abs=2.0)


def test_the_probability_of_every_bearing_is_in_the_product():
    series, *_, wrong = buoys(2)
    motions = estimate_motion(series)
    far = np.abs(motions.row_residual_deg) > 60.0
    own = motions.row_probability[np.argsort(motions.row_number)]
    assert np.all(own[~wrong].mean() > 0.95)
    assert own[wrong].mean() < 0.35
    assert not np.any(far & (motions.row_probability > 0.5))
    # 216 bearings of 8 degrees: the root of their mean square has a deviation of 5 %
    off = motions.row_residual_deg[np.argsort(motions.row_number)][~wrong]
    assert np.sqrt(np.mean(off**2)) == pytest.approx(8.0, rel=0.2)


def circling(seed, *, strange, n_other):
    """Own ship circles a nearly still source; other ships pass, or noise is heard."""
    draw = np.random.default_rng(seed)
    n = 600
    time = np.linspace(0, 900, n)
    angle = 2 * np.pi * time / 450
    own = 160 * np.stack([np.sin(angle), np.cos(angle)])
    place, velocity = draw.normal(0, 20, 2), draw.normal(0, 0.02, 2)
    way = place[:, None] + velocity[:, None] * time - own
    bearing = np.degrees(np.arctan2(*way))
    wrong = draw.random(n) < strange
    bearing[wrong] = draw.uniform(0, 360, np.count_nonzero(wrong))
    for number in range(n_other):
        course = draw.uniform(0, 2 * np.pi)
        other = draw.uniform(1, 4) * np.array([np.sin(course), np.cos(course)])
        away = draw.uniform(-800, 800, 2)[:, None] + other[:, None] * (time - 450)
        mine = wrong & (np.arange(n) % n_other == number)
        bearing[mine] = np.degrees(np.arctan2(*(away - own)))[mine]
    bearing += 5.0 * draw.standard_normal(n)
    table, *_ = buoys(0, n=1, rows=n)
    series = replace(
        table, time_s=time, bearing_deg=bearing % 360.0, sensor=None,
        bearing_std_deg=np.full(n, np.nan), sensor_east_m=None, sensor_north_m=None,
        sensor_id=None, sensor_compass_std_deg=None, sensor_position_std_m=None,
    )  # fmt: skip
    ship = Navigation(time_s=time, east_m=own[0], north_m=own[1], heading_deg=np.full(n, np.nan))
    return series, ship, place - own[:, 0], wrong


# in the second the scatter of all bearings together is 51 degrees, ten times the source's
@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "strange", "n_other"),
    [(4, 0.45, 1), pytest.param(710088, 0.597927107898852, 2, marks=pytest.mark.long)],
)
def test_a_source_among_bearings_of_others_is_found(seed, strange, n_other):
    series, ship, place, wrong = circling(seed, strange=strange, n_other=n_other)
    motions = estimate_motion(series, None, ship, nuisances=Nuisances())
    angle = np.radians(motions.bearing_deg[0])
    found = motions.range_m[0] * np.array([np.sin(angle), np.cos(angle)])
    assert np.hypot(*(found - place)) < 80.0
    assert motions.range_low_m[0] < np.hypot(*place) < motions.range_high_m[0]
    own = motions.row_contact == 1
    assert motions.row_probability[own][~wrong].mean() > 0.8
    # every source has a contact of its own, and the rows of the others go with theirs
    assert np.unique(motions.contact).tolist() == list(range(1, n_other + 2))
    others = motions.row_probability[~own].reshape(n_other, -1).sum(axis=0)
    assert others[wrong].mean() > 0.8


def test_what_a_table_of_sensors_cannot_be_is_refused():
    series, *_ = buoys(1)
    nowhere = replace(series, sensor_east_m=None, sensor_north_m=None)
    with pytest.raises(DataError, match="names its sensors"):
        locate_vessels(series=nowhere)
    with pytest.raises(DataError, match="no column sensor"):
        locate_vessels(series=replace(nowhere, sensor=None))
    with pytest.raises(OptionError, match="own-ship"):
        estimate_motion(
            series,
            navigation=Navigation(
                time_s=np.array([0.0, 1.0]), east_m=np.zeros(2), north_m=np.zeros(2),
                heading_deg=np.zeros(2),
            ),
        )  # fmt: skip
    with pytest.raises(OptionError, match="recursive"):
        estimate_motion(series, solver="recursive")


def test_bearings_of_one_sensor_in_radians_are_told_with_its_name():
    series, *_ = buoys(1, strange=0.0)
    of_one = series.sensor == "b2"
    mixed = replace(
        series, bearing_deg=np.where(of_one, np.radians(series.bearing_deg), series.bearing_deg)
    )
    with pytest.raises(DataError, match=r"by b2 .* radians"):
        locate_vessels(series=mixed)


def test_fixes_follow_the_legs_of_a_target_that_alters():
    """It goes east of north for ten minutes, and then north."""
    series, *_ = buoys(1, rows=60)
    time = series.time_s
    late = np.maximum(time - 600.0, 0.0)
    east, north = -1000.0 + 3.0 * (time - late), -500.0 + time + 3.0 * late
    away = east - series.sensor_east_m, north - series.sensor_north_m
    noise = np.random.default_rng(4).standard_normal(time.size)
    bearing = (np.degrees(np.arctan2(*away)) + noise) % 360.0
    series = replace(series, bearing_deg=bearing, bearing_std_deg=np.ones(time.size))
    fixes = locate_vessels(series=series, at=["0", "300", "1200"])
    truth = [[-1000.0, -500.0], [-100.0, -200.0], [800.0, 2500.0]]
    found = np.stack([fixes.east_m, fixes.north_m], 1) - truth
    inside = np.einsum("ta,tab,tb->t", found, np.linalg.inv(fixes.covariance_m2), found)
    assert inside.max() < 13.8  # 99.9 % of two degrees of freedom
    assert np.sqrt(np.linalg.det(fixes.covariance_m2)).max() < 30.0**2
    assert fixes.speed_mps[[0, 2]] == pytest.approx([np.hypot(3, 1), 4.0], abs=0.25)


@pytest.mark.parametrize(
    ("sensors", "times", "missing"),
    [
        (("a", "a", "a"), (0, 60, 120), "a second sensor of the same time"),
        (("a", "a", "b", "b"), (0, 60, 900, 960), "no two sensors have rows of the"),
        (("a", "b", "a", "b"), (0, 0, 9, 9), "cross at too small an angle"),
    ],
)
def test_a_table_without_a_position_says_its_rows_and_what_they_lack(sensors, times, missing):
    sensor, rows = np.array(sensors), len(sensors)
    nothing = np.full(rows, np.nan)
    series = Series(
        contact=np.ones(rows, np.int64), time_s=np.array(times, float),
        bearing_deg=30.0 + 0.01 * np.arange(rows), bearing_std_deg=np.ones(rows),
        frequency_hz=np.zeros((rows, 0)), frequency_std_hz=np.zeros((rows, 0)),
        level_db=nothing, level_std_db=nothing, sensor=sensor,
        sensor_east_m=np.where(sensor == "a", 0.0, 50.0),
        sensor_north_m=np.zeros(rows), contact_numbers="common",
        sensor_id=np.unique(sensor),
    )  # fmt: skip
    fixes = locate_vessels(series=series)
    assert fixes.time_s.size == 0
    told = str(fixes.statement)
    assert missing in told
    assert f"a {sensors.count('a')} rows from {times[0]} to" in told
    assert "'uwtrack tma' of the same table" in told
