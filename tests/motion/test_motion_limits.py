"""Limits of motion on both sides, and what small sums give at points that are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, multivariate_normal

from studies import genetic, hybrid
from studies.simplex import nelder_mead
from tests.motion.sonar_scene import Scene as SonarScene
from tests.motion.test_sub_bands import LAW, PLACE_S, heights, levels_of
from tests.motion.test_target_laws import STATE
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.robust import bisquare_weight
from uwtrack_cli.motion.fix_table import fix_rows
from uwtrack_cli.motion.options import MotionModel, Nuisances
from uwtrack_cli.motion.passage import candidates
from uwtrack_cli.motion.passage.broadband_sum import BroadbandSeries, KnownSources, SourceFit, alone
from uwtrack_cli.motion.passage.candidates import (
    LEAST_TURN_DEG,
    RecordingSpan,
    has_closest_approach,
)
from uwtrack_cli.motion.passage.checks import sub_bands, surface_image
from uwtrack_cli.motion.passage.encounter_rows import _fit_levels
from uwtrack_cli.motion.passage.fit.likelihood_ratio import LEVELS_SHARE, LikelihoodRatio
from uwtrack_cli.motion.passage.fit.residual_noise import _loss
from uwtrack_cli.motion.passage.model.measurements import PassageData, _averaged, _deviation
from uwtrack_cli.motion.passage.model.steady_turn import SteadyTurn, with_steady_turn
from uwtrack_cli.motion.target_motion import contact, joint_region, modes
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.inputs import Measurements
from uwtrack_cli.motion.target_motion.model import to_motion
from uwtrack_cli.motion.target_motion.modes import Interval, TmaOptions
from uwtrack_cli.motion.target_motion.objective import residuals
from uwtrack_cli.motion.target_motion.observability import (
    Information,
    assess,
    criterion_probability,
)
from uwtrack_cli.motion.target_motion.own_ship import OwnPath, bend_rad
from uwtrack_cli.motion.target_motion.row_noise import NO_MEMORY
from uwtrack_cli.motion.target_motion.solvers.marquardt import (
    DescentResult,
    SearchBounds,
    search_bounds,
)
from uwtrack_cli.motion.tma import _deviations


def fit_of(time_s=100.0, width_s=10.0, std=(1.0, 1.0, 0.1, 2.0), bearing_deg=30.0):
    return SimpleNamespace(
        theta=np.array([[time_s, np.log(width_s), 5.0, -5.0]]),
        range_over_speed_s=np.array([width_s]), bearing_deg=np.array([bearing_deg]),
        covariance=np.diag(np.square(std))[None],
    )  # fmt: skip


def blocks_of(first_s, last_s, *, bearing=True):
    """Measurements between two instants; times beyond them are not measured."""
    time = np.linspace(-100.0, 300.0, 401)
    weight = ((time >= first_s) & (time <= last_s))[None, None] * 1.0
    nothing = SimpleNamespace(weight=0.0 * weight)
    return SimpleNamespace(
        time_s=time, shift=SimpleNamespace(weight=weight), level=nothing,
        bearing=SimpleNamespace(weight=weight, is_empty=not bearing),
    )  # fmt: skip


SPAN = RecordingSpan(1.0, -100.0, 300.0)
SHARP = (0.1, 1.0, 0.1, 2.0)


@pytest.mark.parametrize(
    ("fit", "extent", "span", "words"),
    [
        (fit_of(), (0.0, 200.0), SPAN, None),
        (fit_of(std=(np.inf, 1, 1, 1)), (0.0, 200.0), SPAN, "time and width"),
        (fit_of(), (0.0, 200.0), RecordingSpan(9.9, -100.0, 300.0), None),
        (fit_of(), (0.0, 200.0), RecordingSpan(10.1, -100.0, 300.0), "shorter than the"),
        (fit_of(std=(9.9, 1, 1, 1)), (0.0, 200.0), SPAN, None),
        (fit_of(std=(10.1, 1, 1, 1)), (0.0, 200.0), SPAN, "too little"),
        (fit_of(std=(1, 3.3, 1, 1)), (0.0, 200.0), SPAN, None),
        (fit_of(std=(1, 3.4, 1, 1)), (0.0, 200.0), SPAN, "too little"),
        # three tenths of d/v on either side, unless the recording itself ends there
        (fit_of(), (97.0, 140.0), SPAN, None),
        (fit_of(), (98.0, 140.0), SPAN, "begin at the closest approach"),
        (fit_of(), (98.0, 140.0), RecordingSpan(1.0, 97.5, 300.0), None),
        (fit_of(), (60.0, 103.0), SPAN, None),
        (fit_of(), (60.0, 102.0), SPAN, "end at the closest approach"),
        (fit_of(), (60.0, 102.0), RecordingSpan(1.0, -100.0, 102.5), None),
        # which ends there within a tenth of its length and two frames
        (fit_of(), (98.0, 140.0), RecordingSpan(1.0, 70.0, 300.0), "begin at"),
        (fit_of(), (98.0, 140.0), RecordingSpan(1.0, 76.0, 300.0), None),
        (fit_of(), (60.0, 102.0), RecordingSpan(1.0, -100.0, 140.0), "end at"),
        (fit_of(), (60.0, 102.0), RecordingSpan(1.0, -100.0, 123.0), None),
        # as far beyond either end as d/v is long
        (fit_of(time_s=151.0), (60.0, 142.0), SPAN, "end at"),
        (fit_of(time_s=153.0), (60.0, 142.0), SPAN, "far outside"),
        (fit_of(time_s=51.0), (60.0, 142.0), SPAN, "begin at"),
        (fit_of(time_s=49.0), (60.0, 142.0), SPAN, "far outside"),
    ],
)
def test_a_passage_is_measured_on_both_sides_and_longer_than_a_frame(fit, extent, span, words):
    assert has_closest_approach(fit, blocks_of(*extent), span) is (words is None)


@pytest.mark.parametrize(("half_deg", "expected"), [(14.0, False), (17.0, True)])
def test_a_passage_turns_the_line_of_sight_by_thirty_degrees(half_deg, expected):
    half_s = 100.0 * np.tan(np.radians(half_deg))
    extent = blocks_of(100.0 - half_s, 100.0 + half_s)
    assert LEAST_TURN_DEG == 30.0
    assert has_closest_approach(fit_of(width_s=100.0), extent, SPAN) is expected


@pytest.mark.parametrize("line_level", [-5.0, 0.0, 1.0, 1e3])
@pytest.mark.parametrize("off", [-0.01, 0.01])
def test_levels_of_lines_add_up_to_their_share_of_the_threshold(line_level, off):
    threshold = 12.0
    counted = min(max(line_level, 0.0), LEVELS_SHARE * threshold)
    for name in ("doppler", "over_line", "over_break"):
        gains = {"doppler": 50.0, "bearing": 0.0, "level": 0.0, "over_line": 50.0,
                 "over_break": 50.0}  # fmt: skip
        gains[name] = threshold - counted + off
        found = LikelihoodRatio(**gains, threshold=threshold, line_level=line_level)
        assert found.is_passage is (off > 0)
    parts = LikelihoodRatio(1.0, 2.0, 4.0, 8.0, 16.0, 1.0)
    assert parts.total == 7.0


def test_tukeys_loss_is_the_integral_of_its_weight():
    deviation = np.array([[0.0, 1.0, -3.0], [2.0, 4.6, 8.0]])

    def integral(end):
        return quad(lambda z: z * bisquare_weight(np.array([z]))[0], 0.0, abs(end))[0]

    expected = [sum(integral(one) for one in row) for row in deviation]
    np.testing.assert_allclose(_loss(deviation), expected, rtol=1e-6)


def test_turns_of_a_batch_are_those_of_each_alone():
    """Turns by nothing beside one passage share their times of emission, others do not."""
    time = np.linspace(0.0, 600.0, 40)
    motions = np.array([[300.0, np.log(30.0), 6.0], [280.0, np.log(60.0), 9.0]])
    turns = [(0.0, 60.0, 320.0), (0.9, 90.0, 310.0), (-0.4, 40.0, 280.0)]
    for one in (motions[[0, 1]], motions[[0, 0]]):
        for pair in (turns[:1] * 2, turns[1:], turns[:2]):
            for depth in (np.array([10.0, 10.0]), np.array([10.0, 60.0])):
                both = with_steady_turn(
                    time, one, SteadyTurn(*np.array(pair).T), 1500.0, depth
                ).rows
                for row in range(2):
                    own = with_steady_turn(
                        time, one[[row]], SteadyTurn(*np.array(pair[row])[:, None]),
                        1500.0, depth[[row]],
                    ).rows[0]  # fmt: skip
                    np.testing.assert_allclose(both[row], own, atol=1e-10)


def test_what_is_left_of_a_sum_is_the_source_that_is_not_yet_in_it():
    time = np.linspace(0.0, 100.0, 41)
    theta = np.array([0.2, 1.0, 0.3, -0.2, 30.0, np.log(8.0), 1.5, 0.4])
    flow = np.exp(0.2) * (0.3 - 0.2j)
    x, y = (time - 30.0) / 8.0, (time - 60.0) / 12.0
    first = np.exp(1.5) / (1 + x**2) * np.exp(1j * (0.4 + np.arctan(x)))
    other = 3.0 / (1 + y**2) * np.exp(1j * (2.0 - np.arctan(y)))
    whole = np.exp(0.2) + np.abs(first) + np.abs(other)
    # directions weigh by the power over the background
    vector = (whole - np.exp(0.2)) * np.exp(1j * np.angle(flow + first + other))
    sound = BroadbandSeries(
        time, np.log(whole), np.full(41, 0.1), np.angle(vector), np.full(41, 0.05)
    )
    nothing = KnownSources(np.zeros((0, 41)), np.zeros((0, 41)))
    left = alone(SourceFit(theta, np.ones(1), 0.0, 0), None, sound, nothing)
    explained = np.exp(0.2) + np.abs(first)
    np.testing.assert_allclose(left.power, 0.2 + np.log(whole / explained))
    rest = vector - first - flow
    np.testing.assert_allclose(np.exp(1j * (left.bearing - np.angle(rest))), 1.0)
    error = np.hypot(np.abs(vector) * 0.05, whole * 0.1) / np.abs(rest)
    np.testing.assert_allclose(left.bearing_std, np.where(error < 1, error, np.nan))
    assert np.isnan(left.bearing_std).any()


@pytest.mark.parametrize("n_far", [0, 1])
def test_levels_of_vessels_over_a_background_are_taken_apart(n_far):
    """Of exact sums; what passes outside the recording has its loudest frame to start."""
    time = np.linspace(0.0, 400.0, 401)
    closest = [120.0, 430.0 if n_far else 280.0]
    spread = -np.log1p(((time - np.array(closest)[:, None]) / [[15.0], [20.0]]) ** 2)
    level = 10 * np.log10(10**8.0 + np.exp(spread).T @ [10**11.0, 10**10.0])
    found, std = _fit_levels(level, spread, time, 15.0)
    np.testing.assert_allclose(found, [110.0, 100.0], atol=0.01)
    assert std.max() < 0.1
    assert np.isnan(_fit_levels(level[:7], spread[:, :7], time[:7], 15.0)[0]).all()


def test_averages_of_a_long_series_are_weighted_means_and_bearings_go_round():
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 100.0)
    frequency = 50.0 + rng.standard_normal((2, 100))
    frequency[1, 5:9] = np.nan
    bearing = (358.0 + 8.0 * rng.standard_normal((1, 100))) % 360.0
    std = rng.uniform(0.5, 2.0, (3, 100))
    level = 80.0 + rng.standard_normal((1, 100))
    data = PassageData(time, frequency, std[:2], bearing, std[2:], level, std[:1])
    kept = np.arange(8, 93)
    found = _averaged(data, kept, 20)
    runs = [kept[k : k + 5] for k in range(0, 85, 5)]
    np.testing.assert_allclose(found.time_s, [time[run].mean() for run in runs])
    for k, run in enumerate(runs):
        for row in range(2):
            good = run[np.isfinite(frequency[row, run])]
            weight = 1 / std[row, good] ** 2
            mean = np.average(frequency[row, good], weights=weight)
            assert found.frequency_hz[row, k] == pytest.approx(mean)
            assert found.frequency_std_hz[row, k] == pytest.approx(weight.sum() ** -0.5)
        weight = 1 / std[2, run] ** 2
        unit = (weight * np.exp(1j * np.radians(bearing[0, run]))).sum()
        off = found.bearing_deg[0, k] - np.degrees(np.angle(unit))
        assert abs((off + 180.0) % 360.0 - 180.0) < 1e-9
        assert 0.0 <= found.bearing_deg[0, k] < 360.0
        assert found.bearing_std_deg[0, k] == pytest.approx(weight.sum() ** -0.5)


def test_a_reflection_is_found_between_the_delays_that_are_tried_first():
    u = np.linspace(-6.0, 6.0, 120)
    law = 1 / (1 + u**2)
    edges = np.array([[100.0 * k, 100.0 * (k + 1)] for k in range(2, 8)])
    step_s = surface_image.DELAY_STEP / 800.0
    for share in (0.6, -0.6):
        image = surface_image.Image((12 + share) * step_s, 0.0, -0.6)
        power = 1 + 30 * law * np.array([image.pattern(u, *pair) for pair in edges])
        near = surface_image._beside(image._replace(delay_s=12 * step_s, strength=-0.8), step_s)
        parts = power, power, np.ones((1, 120))
        found = surface_image._best(near, u, law, parts, edges)
        assert found.delay_s == pytest.approx(image.delay_s, abs=0.35 * step_s)
        assert found.strength == pytest.approx(-0.6, abs=0.11)


def test_fringes_are_the_mean_of_a_band_of_waves():
    """Two paths of a surface's image, averaged over frequency by a sum."""
    u = np.linspace(-4.0, 4.0, 33)
    for nearness in (0.0, 0.5):
        image = surface_image.Image(0.004, nearness, -0.8)
        if nearness:  # the image is farther by the root of its share of the range
            way = np.sqrt(1 + u**2 + nearness) - np.hypot(1, u)
            delay = 0.004 * way / way[16]
        else:
            delay = 0.004 / np.hypot(1, u)
        f = np.linspace(300.0, 500.0, 2001)[:, None]
        mean = (1 - 0.8 * np.cos(2 * np.pi * f * delay)).mean(axis=0)
        np.testing.assert_allclose(image.pattern(u, 300.0, 500.0), mean, atol=2e-3)


def test_what_is_left_of_the_parts_and_their_correlation_are_those_of_least_squares():
    rng = np.random.default_rng(2)
    power, usual = rng.uniform(1, 5, (2, 50)), rng.uniform(0.5, 2, (2, 50))
    basis, columns = rng.uniform(0, 1, (2, 50)), rng.uniform(0, 1, (2, 3, 50))
    left = surface_image.residuals(power, usual, basis, columns)
    for part in range(2):
        for k in range(3):
            rows = np.stack([*basis, columns[part, k]], 1) / usual[part][:, None]
            value = power[part] / usual[part]
            found = np.linalg.lstsq(rows, value, rcond=None)[0]
            if found[-1] < 0:
                found = np.append(np.linalg.lstsq(rows[:, :2], value, rcond=None)[0], 0)
            np.testing.assert_allclose(left[part, k], value - rows @ found, atol=1e-9)
    long = rng.standard_normal(40_000)
    for k in range(1, long.size):
        long[k] = 0.6 * long[k - 1] + 0.8 * long[k]
    # 1 + 2 (0.6 + 0.36 ...) = 4, less what lies below a twentieth
    total = surface_image.correlation_sum(long, float(np.mean(long**2)))
    assert total == pytest.approx(1 + 2 * sum(0.6**k for k in range(1, 6)), rel=0.06)
    gain = surface_image.gain_of(2 * long[None], long[None])
    assert gain == pytest.approx(0.5 * 40_000 / total * np.log(4.0))


def test_a_simplex_rests_when_its_values_are_alike_for_their_size():
    flat = nelder_mead(
        lambda points, _: 1.0 + 1e-12 * (points**2).sum(1),
        np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]),
    )
    assert flat.evaluations.tolist() == [3]


def test_a_global_search_and_the_simplex_count_what_they_ask(monkeypatch):
    asked = []

    def bowl(_problem, state, rest_hz, _member):
        asked.append(len(state))
        away = state - [3000.0, 4000.0, 3.0, -4.0]
        return (away**2).sum(1) / [1.0] + 0.0 * rest_hz.sum(1)

    monkeypatch.setattr(hybrid, "misfit_value", bowl)
    box = hybrid.Box(np.zeros(4), np.array([2e4, 2 * np.pi, 15.0, 2 * np.pi]))
    rng = np.random.default_rng(3)
    near = np.array([[-5050.0, np.arctan2(3, 4) + np.pi, 5.05, np.arctan2(3, -4)]])
    for search, feedback in (("none", near), ("annealing", near)):
        asked.clear()
        found = hybrid.hybrid_search(None, box, 1, rng, search=search, feedback=feedback)
        ours = to_motion(hybrid.to_solver(found.point))[0]
        truth = [5000.0, np.arctan2(3, 4), 5.0, np.arctan2(3, -4)]
        np.testing.assert_allclose(ours, truth, rtol=1e-3)
        # of old solutions it asks once more
        slack = 0 if search == "none" else 1
        assert abs(int(found.evaluations[0]) - sum(asked)) <= slack
    drawn = box.draw(4000, rng)
    np.testing.assert_allclose(drawn.mean(axis=0), box.upper / 2, rtol=0.05)
    assert np.all((drawn >= 0) & (drawn <= box.upper))


TOLD = {"sound_speed_std_mps": 1.0, "compass_std_deg": 2.0, "position_std_m": 3.0,
        "velocity_std_mps": 4.0}  # fmt: skip
REPORTED = ("sound_speed_mps", "compass_deg", "own_position_m", "own_velocity_mps")


@pytest.mark.parametrize("moving", [True, False])
def test_deviations_are_those_of_options_then_the_sensor_then_the_usual(moving):
    sensor = Sensor(
        id="a", compass_std_deg=20.0, navigation_position_std_m=30.0,
        navigation_velocity_std_mps=40.0,
    )  # fmt: skip
    usual = _deviations(Nuisances(), None, moving, None).values()
    own = _deviations(Nuisances(), sensor, moving, None).values()
    assert list(own.values())[1:] == [20.0, 30.0, 40.0]
    bare = _deviations(Nuisances(), Sensor(id="a"), moving, None).values()
    for key in REPORTED[2:]:
        assert bare[key] == usual[key]
        assert (usual[key] > 0) is moving
    for number, (name, value) in enumerate(TOLD.items()):
        for one, other in ((sensor, own), (None, usual)):
            found = _deviations(Nuisances(**{name: value}), one, moving, None).values()
            expected = other | {REPORTED[number]: value}
            assert found == expected
    some = {"position_std_m": 3.0}
    for told, is_usual in (({}, True), (some, True), (TOLD, False)):
        made = _deviations(Nuisances(**told), None, moving, None)
        assert made.is_usual_navigation is (moving and is_usual)


def test_the_weakest_direction_is_a_deviation_along_it():
    """Two weak unknowns of one direction: 12 % of 5000 m and -0.9 knots."""
    direction = np.array([600.0, 0.0, -0.9 * 1852 / 3600, 0.0])
    covariance = np.outer(direction, direction) + np.diag([1.0, 1e-4, 1e-6, 1e-4])
    bread = np.linalg.inv(covariance)
    found = Information(bread, bread, np.eye(4))
    seen = assess(found, np.array([5000.0, 1.0, 5.0, 2.0]))
    assert seen.rank == seen.n_parameters == 4
    assert seen.observable.all()
    words = dict(part.rsplit(" ", 2)[:2] for part in seen.weakest.split(", "))
    assert float(words["range"]) == pytest.approx(12.0, rel=0.02)
    assert float(words["speed"]) == pytest.approx(-0.9, rel=0.02)


def test_an_interval_widens_about_its_centre():
    assert Interval(2.0, 7.0, True, False).widened(4.0, 2.0) == Interval(0.0, 10.0, True, False)
    assert Interval(2.0, 7.0, False, True).is_open
    assert not Interval(2.0, 7.0, False, False).is_open


@pytest.mark.parametrize(
    ("stretch", "expected"), [(0.8, True), (1.05, True), (1.25, False), (0.35, False)]
)
def test_an_ellipse_holds_what_a_normal_likelihood_of_like_width_does(
    monkeypatch, stretch, expected
):
    """It holds chi-square's share of 9.488 over the square; far narrower, few draws."""
    if stretch > 0.5:
        content = chi2.cdf(joint_region.QUANTILE / stretch**2, 4)
        assert bool(content > 0.88) is expected
    q = np.array([np.log(5000.0), 1.0, 3.0, 4.0])
    std = np.array([20.0, 0.01, 0.05, 0.01])
    centre = to_motion(q)

    def normal(_, trial):
        off = to_motion(trial) - centre
        return SimpleNamespace(value=((off / (stretch * std)) ** 2).sum(1))

    monkeypatch.setattr(joint_region, "misfit", normal)
    assert joint_region.ellipse_holds(None, q, np.diag(std**2), 1.0) is expected
    assert joint_region.ellipse_holds(None, q, np.diag(std**2), 1 / stretch**2) is True


@pytest.mark.parametrize("empty", range(8))
def test_levels_are_weighed_by_their_misfit_beside_either_of_the_other_kinds(monkeypatch, empty):
    monkeypatch.setattr(candidates, "level_misfit", lambda *_: 1e3)
    kinds = [SimpleNamespace(is_empty=bool(empty & bit)) for bit in (1, 2, 4)]
    blocks = SimpleNamespace(level=kinds[0], shift=kinds[1], bearing=kinds[2])
    expected = not empty & 1 and empty & 6 != 6
    assert candidates._is_misfit(None, blocks) is expected


@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0])
def test_motions_are_on_different_sides_of_the_first_heading(heading):
    problem = SimpleNamespace(array_heading_rad=np.array([heading, 0.4]), lobe_cosine=None)
    for one, other, expected in ((0.3, 1.2, False), (0.3, -1.2, True), (3.0, -3.0, True)):
        q = np.zeros((2, 4))
        q[:, 1] = heading + np.array([one, other])
        fit = SimpleNamespace(q=q)
        assert modes._other_side(problem, fit, 0, 1) is expected
    nowhere = SimpleNamespace(array_heading_rad=None)
    assert not modes._other_side(nowhere, fit, 0, 1)
    lost = SimpleNamespace(array_heading_rad=np.array([np.nan]))
    assert not modes._other_side(lost, fit, 0, 1)


def test_fringes_are_sought_at_the_width_of_the_level_and_two_beside_it(monkeypatch):
    widths = []

    def told(_parts, own, _over_squall):
        widths.append(own.width_s)
        return sub_bands.Agreement(0, np.nan, "a gust", -1.0)

    monkeypatch.setattr(sub_bands, "_told", told)
    levels = levels_of(1 + heights() * LAW)
    assert not sub_bands.agreement(levels, PLACE_S, 8.0).is_passage
    assert widths == pytest.approx([8.0, 5.6, 11.2])


def test_correlated_measurements_count_by_the_root_of_their_inflation(monkeypatch):
    found = iter([4.0, 9.0])
    monkeypatch.setattr(contact, "correlation_inflation", lambda *_: next(found))
    problem = SonarScene(1, "interval").problem(offsets=False)
    wide = contact._allow_for_overlap(problem, search_bounds((50.0, 1e5), 15.0), 2)
    np.testing.assert_allclose(2.0 * wide.bearing_weight, problem.bearing_weight)
    np.testing.assert_allclose(3.0 * wide.frequency_weight, problem.frequency_weight)


def test_the_heading_of_an_array_is_own_course_its_compass_or_the_fixed_one():
    time = np.array([0.0, 100.0, 200.0])
    path = OwnPath(time, 3.0 * time, 4.0 * time, np.radians([10.0, 20.0, 40.0]))
    at, still = np.array([50.0, 150.0]), replace(path, heading_rad=np.full(3, np.nan))

    def heading(kind, own, fixed=None):
        options = TmaOptions(
            NuisanceDeviations(), 1500.0, is_table=True, array_heading=kind, fixed_heading_deg=fixed
        )
        found = contact._array_heading(own, at, 10.0, options)
        return found if found is None else np.degrees(found)

    assert heading("none", path, 70.0) is None
    course = np.degrees(np.arctan2(3.0, 4.0))
    np.testing.assert_allclose(heading("course", path, 70.0), course)
    np.testing.assert_allclose(heading("heading", path, 70.0), [15.0, 30.0])
    np.testing.assert_allclose(heading("heading", still, 70.0), 70.0)
    with pytest.raises(DataError, match="needs a column heading_deg"):
        heading("heading", still)
    one = OwnPath(time[:1], time[:1], time[:1], np.full(1, np.nan))
    with pytest.raises(DataError, match="own ship has no course"):
        heading("course", one)
    for kind, tow_m, expected in (
        ("course", None, 300.0), ("heading", None, 0.0), ("heading", 120.0, 120.0)
    ):  # fmt: skip
        options = TmaOptions(
            NuisanceDeviations(), 1500.0, is_table=True, array_heading=kind,
            model=MotionModel(tow_length_m=tow_m),
        )  # fmt: skip
        assert contact._tow_length_m(options) == expected


def test_an_array_lies_on_own_ships_way_behind_it():
    """Own ship turns by 90 degrees at 300 s; an array of 200 m is straight 50 s later."""
    time = np.arange(0.0, 601.0, 10.0)
    east = 4.0 * np.minimum(time, 300.0)
    north = 4.0 * np.maximum(time - 300.0, 0.0)
    path = OwnPath(time, east, north, np.full(time.size, np.nan))
    bend = np.degrees(bend_rad(path, np.array([250.0, 310.0, 340.0, 360.0, 500.0]), 200.0))
    np.testing.assert_allclose(bend, [0.0, 90.0, 90.0, 0.0, 0.0], atol=1e-6)
    assert not bend_rad(path, time, 0.0).any()
    assert not bend_rad(replace(path, east_m=0 * time, north_m=0 * time), time, 9.0).any()


@pytest.mark.parametrize(
    ("told_s", "window_s", "expected_s"), [(3.0, 8.0, 3.0), (None, 8.0, 8.0), (None, None, 2.0)]
)
def test_a_mean_frequency_is_one_over_what_is_told_a_frame_or_a_row(told_s, window_s, expected_s):
    time, none = 2.0 * np.arange(40), np.full((0, 40), np.nan)
    still = np.zeros(40)
    own = Navigation(time_s=time, east_m=still, north_m=still, heading_deg=still)
    data = Measurements(
        1, time, np.full((1, 40), 30.0), np.full((1, 40), 1.0), none, none,
        np.arange(0), None, window_s, 1,
    )  # fmt: skip
    options = TmaOptions(
        NuisanceDeviations(), 1500.0, is_table=True,
        navigation=own,
        model=MotionModel(interval_s=told_s),
    )  # fmt: skip
    problem = contact.build_problem(data, options)
    np.testing.assert_allclose(problem.track.interval_s, expected_s)


def test_updates_grow_evenly_to_all_rows():
    assert contact._growing(10, 4).tolist() == [3, 5, 8, 10]
    assert contact._growing(3, 5).tolist() == [1, 2, 3]


def test_three_errors_stay_within_bounds_by_the_normal_distribution():
    for seed in range(4):
        root = np.random.default_rng(seed).standard_normal((3, 3))
        covariance, bounds = root @ root.T, np.array([1.0, 2.0, 0.7])
        share = multivariate_normal(cov=covariance, seed=1).cdf(bounds, lower_limit=-bounds)
        assert criterion_probability(covariance, bounds) == pytest.approx(share, abs=1e-4)


def test_bits_of_a_search_reach_both_ends_of_the_box_and_go_round():
    lower, upper = np.array([0.0, -2.0]), np.array([10.0, 6.0])
    ends = [np.zeros(16, bool), np.ones(16, bool)]
    np.testing.assert_allclose(genetic._decode(ends[0], lower, upper, 8), lower)
    np.testing.assert_allclose(genetic._decode(ends[1], lower, upper, 8), upper)
    points = np.array([[0.0, -2.0], [3.3, 1.7], [10.0, 6.0], [12.0, -9.0]])
    back = genetic._decode(genetic._encode(points, lower, upper, 8), lower, upper, 8)
    held = np.clip(points, lower, upper)
    assert np.abs(back - held).max() <= 0.5 * 10.0 / 255.0


def test_the_largest_speed_of_a_profile_is_that_of_the_corner_of_the_box():
    limits = search_bounds((50.0, 1e5), 12.0)
    polar = modes._bounds(limits, polar=True)
    assert polar.upper[2] == pytest.approx(np.hypot(12.0, 12.0))
    assert polar.lower[2] == 0.0
    assert np.isinf([polar.lower[3], polar.upper[3]]).all()
    assert modes._bounds(limits, polar=False) is limits


def test_deviations_that_are_not_stated_are_the_scatter_of_neighbours():
    """The median of differences of a normal variable is 0.954 of its deviation."""
    rng = np.random.default_rng(11)
    value = np.stack([300.0 * np.linspace(0, 1, 4000), np.zeros(4000)])
    value = value + 2.0 * rng.standard_normal(value.shape)
    value[1] %= 360.0
    value[0, ::50] = np.nan
    unknown = np.full(value.shape, np.nan)
    for row, period in ((0, None), (1, 360.0)):
        found = _deviation(unknown[[row]], value[[row]], period)
        assert found[0] == pytest.approx(2.0, rel=0.06)
    told = np.where(np.arange(4000) == 7, 3.0, np.nan)[None]
    assert _deviation(told, value[:1]) is told


def test_half_a_square_along_a_constant_and_partials_is_what_they_explain():
    rng = np.random.default_rng(12)
    residual, weight = rng.standard_normal((2, 30)), rng.uniform(0.5, 2.0, (2, 30))
    slope = rng.standard_normal((30, 2)) * [1.0, 1e4]
    found = candidates._projected(residual, weight, slope)
    design = np.column_stack([np.ones(30), slope])
    for row in range(2):
        root = np.sqrt(weight[row])
        value = root * residual[row]
        fit = np.linalg.lstsq(root[:, None] * design, value, rcond=None)[0]
        left = value - root * (design @ fit)
        assert found[row] == pytest.approx(0.5 * (value @ value - left @ left))


@pytest.mark.parametrize(("room", "is_open"), [(0.98, True), (1.02, False)])
@pytest.mark.parametrize("guess", [0.02, 0.3, 5.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_profile_ends_where_a_parabola_has_risen_or_at_the_limit(
    monkeypatch, room, is_open, guess, side
):
    """Whatever the first guess of its deviation, here of 0.7."""
    centre, reach = np.array([3.0, 0.0, 0.0, 0.0]), 0.7 * np.sqrt(3.841)
    limits = SearchBounds(centre - room * reach, centre + room * reach)

    def fit(_self, trials, **_):
        value = 50.0 + ((trials[:, 0] - 3.0) / 0.7) ** 2
        rest, matrix = np.empty((len(trials), 0)), np.ones((len(trials), 4, 4))
        return DescentResult(trials, rest, value, matrix)

    monkeypatch.setattr(modes._Profile, "_fit", fit)
    profile = modes._Profile(None, limits, 0, 3.841, False)
    end, was_cut, way = profile.side(centre, side * guess * 0.7)
    excess = ((way.q[:, 0] - 3.0) / 0.7) ** 2
    np.testing.assert_allclose(way.value, excess, atol=1e-9)
    assert was_cut is is_open
    assert end == pytest.approx(3.0 + side * (room if is_open else 1.0) * reach, abs=1e-6)


@pytest.mark.parametrize(
    "covariance",
    [
        np.diag([1.0, 0.0, 1.0, 1.0]),
        np.diag([1.0, np.nan, 1.0, 1.0]),
        np.eye(4) + 2.0 * np.eye(4)[[1, 0, 2, 3]] * (np.arange(4) < 2),
    ],
)
def test_an_ellipse_without_extent_or_sense_holds_nothing(covariance):
    q = np.array([np.log(5000.0), 1.0, 3.0, 4.0])
    assert joint_region.ellipse_holds(None, q, covariance, 1.0) is False


@pytest.mark.parametrize(("off", "asks"), [(-0.01, False), (0.01, True)])
@pytest.mark.parametrize("told", [0.0, 500.0])
def test_others_are_sought_where_the_misfit_exceeds_five_deviations(monkeypatch, off, asks, told):
    """Beyond what own navigation, told to so many metres, does to the bearings."""
    problem = replace(SonarScene(1, "interval").problem(offsets=False), sensor=None)
    q = STATE[np.newaxis]
    found, nuisances = residuals(problem, q), NuisanceDeviations(own_position_m=told)
    count = problem.bearing_weight.size
    across = 1.0 / np.hypot(*found.prediction.bearing_jacobian[0, :2])
    expected = 1.0 + (problem.bearing_weight[0] * told / across) ** 2
    freedom = count - 4
    power = freedom * (1 + 5 * np.sqrt(2 / freedom) + off) / count
    bearing = np.sqrt(power * expected)[np.newaxis, np.newaxis]
    asked = []
    monkeypatch.setattr(contact, "_is_told", lambda *_: True)
    monkeypatch.setattr(contact, "residuals", lambda *_: replace(found, bearing=bearing))
    monkeypatch.setattr(contact, "associate", lambda *_, is_told: asked.append(is_told))
    legs = SimpleNamespace(fit=SimpleNamespace(q=q), problem=problem, colours=NO_MEMORY)
    options = SimpleNamespace(nuisances=nuisances)
    assert contact._sources(problem, legs, None, None, options) is None
    assert asked == ([True] if asks else [])


def test_fixes_have_the_deviations_of_speed_and_course():
    rng = np.random.default_rng(13)
    state = np.array([[100.0, 50.0, 3.0, -4.0], [0.0, 0.0, -2.0, 0.5]])
    root = rng.standard_normal((2, 4, 4))
    covariance = 0.01 * root @ np.swapaxes(root, 1, 2)
    found = fix_rows(state, covariance, np.zeros(2), mode=1)

    def motion(velocity):
        return np.array([np.hypot(*velocity), np.degrees(np.arctan2(*velocity))])

    for row in range(2):
        steps = 1e-6 * np.eye(2)
        velocity = state[row, 2:]
        slope = np.stack([(motion(velocity + s) - motion(velocity - s)) / 2e-6 for s in steps], 1)
        std = np.sqrt(np.diag(slope @ covariance[row, 2:, 2:] @ slope.T))
        ours = found["speed_std_mps"][row], found["course_std_deg"][row]
        np.testing.assert_allclose(ours, std, rtol=1e-5)
        assert found["speed_mps"][row] == pytest.approx(motion(velocity)[0])
        assert found["course_deg"][row] == pytest.approx(motion(velocity)[1] % 360.0)
