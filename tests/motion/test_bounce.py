"""Delays of a bottom or surface bounce as ranges."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws import bounce_delays
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.tables.series import read_series
from uwtrack_cli.motion.options import BounceGeometry, Nuisances
from uwtrack_cli.motion.target_motion.bounce import bounce_of
from uwtrack_cli.motion.target_motion.contact import build_problem
from uwtrack_cli.motion.target_motion.error_budget import (
    BOUNCE_DEPTHS,
    NuisanceDeviations,
    error_budget,
)
from uwtrack_cli.motion.target_motion.inputs import measurements_from_series
from uwtrack_cli.motion.target_motion.model import from_state
from uwtrack_cli.motion.target_motion.modes import TmaOptions
from uwtrack_cli.motion.target_motion.objective import misfit, residuals
from uwtrack_cli.motion.target_motion.observability import information
from uwtrack_cli.motion.target_motion.solvers.marquardt import minimise, search_bounds
from uwtrack_cli.motion.tma import estimate_motion

DEPTHS = BounceGeometry(
    water_depth_m=150.0, sensor_depth_m=40.0, source_depth_m=10.0,
    source_depth_std_m=7.0, water_depth_std_m=2.0,
)  # fmt: skip

BOUNDS = search_bounds((20.0, 200_000.0), 30.0)


def image_delays(path, east, north):
    """By the distance of the image of the source, in space."""
    sensor, source = np.array([0.0, 0.0, -40.0]), np.stack(
        [east, north, np.full_like(east, -10.0)], -1
    )  # fmt: skip
    plane = -150.0 if path == "bottom" else 0.0
    image = source.copy()
    image[:, 2] = 2.0 * plane - source[:, 2]
    direct, reflected = (np.sqrt(((one - sensor) ** 2).sum(-1)) for one in (source, image))
    return direct, (reflected - direct) / 1480.0


@pytest.mark.parametrize("path", ["bottom", "surface"])
def test_delays_are_those_of_the_image_of_the_source(path):
    rng = np.random.default_rng(1)
    east, north = 10.0 ** rng.uniform(0.0, 4.5, (2, 50))
    direct, expected = image_delays(path, east, north)
    bounce = bounce_of(replace(DEPTHS, path=path), None)
    delay, slope = bounce.delay_s(direct, 1480.0)
    np.testing.assert_allclose(delay, expected, rtol=1e-6, atol=1e-12)
    up, down = (bounce.delay_s(direct + one, 1480.0)[0] for one in (0.01, -0.01))
    np.testing.assert_allclose(slope, (up - down) / 0.02, rtol=1e-5, atol=1e-14)
    above = np.zeros(1)
    assert bounce.most_m / 1480.0 == pytest.approx(image_delays(path, above, above)[1][0])


@pytest.mark.parametrize("path", ["bottom", "surface"])
def test_the_factor_holds_what_the_depths_may_be_far_away(path):
    rng, far = np.random.default_rng(2), 2e4
    source = 10.0 + 0.7 * rng.standard_normal(20_000)
    water = 150.0 + 2.0 * rng.standard_normal(20_000)
    plane = water if path == "bottom" else 0.0
    direct = np.hypot(far, 40.0 - source)
    late = np.hypot(far, 2.0 * plane - 40.0 - source) - direct
    bounce = bounce_of(replace(DEPTHS, path=path, source_depth_std_m=0.7), None)
    assert bounce.relative_std == pytest.approx(late.std() / late.mean(), rel=0.03)


def problem_of(table, bounce):
    exact = NuisanceDeviations()
    options = TmaOptions(nuisances=exact, sound_speed_mps=1500.0, is_table=True, bounce=bounce)
    return build_problem(measurements_from_series(table)[0], options)


@pytest.mark.parametrize("loss", ["squares", "student"])
def test_the_gradient_of_the_misfit_is_its_slope_with_delays(loss):
    table, own, truth, _ = bounce_delays.draw(9100)
    angle, course = np.radians(truth[[1, 3]])
    state = np.array([
        truth[0] * np.sin(angle), truth[0] * np.cos(angle),
        truth[2] * np.sin(course), truth[2] * np.cos(course),
    ])  # fmt: skip
    own_mps = np.polyfit(own.time_s, own.north_m, 1)[0]
    away = np.hypot(*bounce_delays.motions(state, table.time_s, own_mps))
    noise = 0.3 * np.random.default_rng(1).standard_normal(180)
    frequency = 300.0 * (1.0 - np.gradient(away, table.time_s) / 1500.0) + noise
    table = replace(
        table, frequency_hz=frequency[:, np.newaxis], frequency_std_hz=np.full((180, 1), 0.3)
    )
    bounce = bounce_of(bounce_delays.GEOMETRY, None)
    problem = replace(problem_of(table, bounce), loss=loss)
    q = from_state(state[np.newaxis])[0] + np.array([0.002, 0.001, 0.005, -0.005])
    steps = np.diag([1e-6, 1e-6, 1e-5, 1e-5])
    up, down = misfit(problem, q + steps), misfit(problem, q - steps)
    slope = (up.value - down.value) / (2.0 * steps.sum(1))
    found = 2.0 * misfit(problem, q[np.newaxis]).gradient[0]
    # three reweightings bring the scales nearly to the robust minimum
    np.testing.assert_allclose(
        found, slope, rtol=1e-4 if loss == "squares" else 0.02, atol=1e-4 * np.abs(slope).max()
    )


def estimate(table, own, **options):
    return estimate_motion(
        table, None, own, updates=1, nuisances=Nuisances(**bounce_delays.TOLD), **options
    )


def test_delays_tell_the_range_that_bearings_do_not():
    table, own, truth, bound = bounce_delays.draw(9008)
    blind = estimate(replace(table, bounce_delay_s=None, bounce_delay_std_s=None), own)
    assert np.isnan(blind.range_m[0])
    found = estimate(table, own, bounce=bounce_delays.GEOMETRY)
    assert abs(found.range_m[0] - truth[0]) < 3.0 * bound
    assert found.range_std_m[0] == pytest.approx(bound, rel=0.2)
    assert "bottom bounce, water of 400 m" in found.statement
    assert found.rest_frequency_hz.size == 0
    exact = replace(bounce_delays.GEOMETRY, source_depth_std_m=0.0, water_depth_std_m=0.0)
    assert estimate(table, own, bounce=exact).range_std_m[0] < 0.5 * bound


def test_the_recursive_solver_knows_the_depths_alike():
    table, own, _, bound = bounce_delays.draw(9008)
    one, other = (
        estimate(table, own, bounce=bounce_delays.GEOMETRY, solver=solver)
        for solver in ("mle", "recursive")
    )
    assert other.range_m[0] == pytest.approx(one.range_m[0], abs=0.01 * bound)


def test_outliers_among_delays_move_the_range_little():
    table, own, truth, bound = bounce_delays.draw(9008)
    late = table.bounce_delay_s.copy()
    late[::30] *= 1.5
    found = estimate(replace(table, bounce_delay_s=late), own, bounce=bounce_delays.GEOMETRY)
    assert abs(found.range_m[0] - truth[0]) < 3.0 * bound


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"water_depth_m": None}, "--bounce-water-depth-m"),
        ({"sensor_depth_m": None}, "--bounce-sensor-depth-m"),
        ({"sensor_depth_m": 500.0}, "must lie between surface and bottom"),
        ({"path": "surface", "source_depth_m": 0.0}, "no path is reflected"),
    ],
)
def test_depths_that_make_no_bounce_are_refused(change, words):
    with pytest.raises(OptionError, match=words):
        bounce_of(replace(DEPTHS, **change), None)


def test_the_depth_of_the_sensor_comes_from_its_file():
    sensor = Sensor(id="a", depth_m=40.0, depth_std_m=1.0)
    given = replace(DEPTHS, sensor_depth_m=None)
    assert bounce_of(given, sensor).sensor_m == 110.0
    assert bounce_of(given, sensor).relative_std > bounce_of(DEPTHS, None).relative_std


def test_delays_in_milliseconds_are_refused():
    table, own, _, _ = bounce_delays.draw(9000)
    wrong = replace(table, bounce_delay_s=1e3 * table.bounce_delay_s)
    with pytest.raises(DataError, match="are the delays in seconds"):
        estimate(wrong, own, bounce=bounce_delays.GEOMETRY)


def test_depths_without_delays_are_refused():
    table, own, _, _ = bounce_delays.draw(9000)
    with pytest.raises(OptionError, match="no column bounce_delay_s"):
        estimate(replace(table, bounce_delay_s=None), own, bounce=DEPTHS)


def test_a_table_of_several_sensors_takes_no_delays():
    table, _, _, _ = bounce_delays.draw(9000)
    place = np.zeros(table.time_s.size)
    sensors = np.where(np.arange(place.size) % 2, "a", "b")
    placed = replace(table, sensor=sensors, sensor_east_m=place, sensor_north_m=place)
    with pytest.raises(DataError, match="of one platform"):
        estimate(placed, None, bounce=DEPTHS)


def test_a_table_has_delays_in_some_rows(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(
        "time_s,bearing_deg,bounce_delay_s,bounce_delay_std_s\n"
        "0,10,0.02,0.001\n10,11,,\n20,12,0.021,\n"
    )
    np.testing.assert_array_equal(read_series(path).bounce_delay_s, [0.02, np.nan, 0.021])
    path.write_text("time_s,bearing_deg,bounce_delay_s\n0,10,-0.02\n")
    with pytest.raises(DataError, match="bounce_delay_s"):
        read_series(path)


def test_depths_of_which_no_deviation_is_told_are_those_of_a_chart_and_a_mooring():
    # IHO S-44, order 2, at 200 m: 4.707 m at 95 %, 2.402 m; sensor 0.5 m, source 2 m
    given = BounceGeometry(water_depth_m=200.0, sensor_depth_m=60.0)
    parts = [0.5 / 140.0, 2.0 / 197.0, 2.402 * (1.0 / 140.0 + 1.0 / 197.0)]
    found = bounce_of(given, None).relative_std
    assert found == pytest.approx(np.linalg.norm(parts), rel=1e-3)


def test_the_depths_move_the_range_as_their_share_says():
    table, own, truth, _ = bounce_delays.draw(9008)
    found = estimate(table, own, bounce=bounce_delays.GEOMETRY)
    row = found.nuisance_name.tolist().index(BOUNCE_DEPTHS)
    bounce = bounce_of(bounce_delays.GEOMETRY, None)
    std = bounce.relative_std
    assert found.nuisance_std[row] == pytest.approx(100.0 * std)
    assert 0.1 < found.nuisance_share[row] < 1.0
    # of measurements without an error the covariance of the linear model is exact
    exact = NuisanceDeviations()
    options = TmaOptions(
        navigation=own, nuisances=exact, sound_speed_mps=1500.0, is_table=True, bounce=bounce
    )
    problem = build_problem(measurements_from_series(table)[0], options)
    angle, course = np.radians(truth[[1, 3]])
    velocity = truth[2] * np.array([np.sin(course), np.cos(course)])
    q = np.array([np.log(truth[0]), angle, *velocity])
    r = residuals(problem, q[np.newaxis], rest_hz=np.ones((1, 1)))
    problem = replace(
        problem,
        bearing_rad=problem.bearing_rad + r.bearing[0] / problem.bearing_weight,
        frequency_hz=problem.frequency_hz
        + r.frequency[0] / np.maximum(problem.frequency_weight, 1e-300),
    )
    budget = error_budget(problem, q, information(problem, q), exact, with_coloured_noise=False)
    # a factor whose prior mean is 1 + step: the same delays in a unit that is as much larger
    moved = []
    for step in (0.02 * std, -0.02 * std):
        other = replace(
            problem,
            frequency_hz=problem.frequency_hz / (1.0 + step),
            frequency_weight=problem.frequency_weight * (1.0 + step),
        )
        moved.append(minimise(other, q[np.newaxis], BOUNDS, iterations=500, tolerance=1e-12).q[0])
    shift = (moved[0] - moved[1]) / 0.04
    np.testing.assert_allclose(
        budget.parts[BOUNCE_DEPTHS][:4, :4], np.outer(shift, shift), rtol=0.02, atol=1e-7
    )
