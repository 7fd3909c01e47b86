"""The estimators against the bound, each other, and published success rates."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize, rosen

from studies.rows import load_reference
from studies.simplex import nelder_mead, simplex_about
from studies.tma_runs import (
    PAPER,
    PAPER_BOX,
    WIDE,
    accuracy,
    fit_from_truth,
    follow,
    motion_errors,
    rows_until,
    single_shots,
    with_feedback,
)
from studies.tma_scenarios import STEP_S, TARGETS, make_problem, make_scenario
from studies.tma_study import robust_fits
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion import modes
from uwtrack_cli.motion.target_motion.joint_region import QUANTILE, ellipse_holds
from uwtrack_cli.motion.target_motion.model import to_motion, to_polar
from uwtrack_cli.motion.target_motion.modes import find_modes, profile_interval
from uwtrack_cli.motion.target_motion.objective import misfit
from uwtrack_cli.motion.target_motion.observability import information
from uwtrack_cli.motion.target_motion.solvers.marquardt import minimise
from uwtrack_cli.motion.target_motion.solvers.recursive import estimate_recursively
from uwtrack_cli.motion.target_motion.solvers.solvers import solve_mle
from uwtrack_cli.motion.target_motion.starts import multistart

REFERENCE = load_reference("tma")
LEAST_SUCCESS = {"S1-T1": 0.97, "S1-T2": 0.83, "S1-T3": 0.99, "S1-T4": 0.99, "S2": 0.99, "S3": 0.99}


def departure_from_linear(name, noise, runs, seed):
    """Return the departure of estimates from their first-order prediction.

    The prediction uses the same noise, so that no Monte-Carlo error enters: rms of
    the difference over the bound, for range, bearing, speed and course.
    """
    scenario = make_scenario(name)
    truth = scenario.solution()
    problem = make_problem(scenario, noise=noise, runs=runs, seed=seed)
    fit = fit_from_truth(problem, truth)
    start = np.repeat(truth[np.newaxis], runs, axis=0)
    at_truth = misfit(problem, start, np.arange(runs))
    found = information(problem.record(0), truth)
    inner = found.covariance(people=False)[:4, :4]
    predicted = -at_truth.gradient @ inner.T @ found.turn[:4, :4].T
    off = motion_errors(fit.q, scenario) - predicted
    bound = np.sqrt(np.diagonal(found.covariance())[:4])
    return np.asarray(np.sqrt(np.mean(off**2, axis=0)) / bound)


@pytest.mark.parametrize("noise", [1, 5])
@pytest.mark.parametrize("name", TARGETS)
def test_estimates_are_what_the_same_noise_gives_to_first_order(name, noise):
    departure = departure_from_linear(name, noise, runs=20, seed=11)
    assert departure.max() < (0.05 if noise == 1 else 0.2)


@pytest.mark.parametrize(("name", "noise"), [("S1-T1", 5), ("S1-T2", 5), ("S2", 1), ("S3", 5)])
def test_errors_success_and_chi_square_are_those_of_an_efficient_estimator(name, noise):
    found = accuracy(name, noise, 1000, runs=200, seed=4)
    assert found.ratio.min() > 0.85
    assert found.ratio.max() < 1.15
    # 200 records: the mean of chi-square has a deviation of 0.0022
    assert found.chi_square.mean() / 1995.0 == pytest.approx(1.0, abs=0.007)
    assert 4.3 < found.nees.mean() < 6.3
    share = found.success.mean()
    assert share >= (LEAST_SUCCESS[name] if noise == 5 else 1.0)
    if (name, noise) == ("S1-T2", 5):
        assert share <= 0.94  # no efficient estimator does better


@pytest.mark.long
@pytest.mark.parametrize("noise", [1, 5])
@pytest.mark.parametrize("name", TARGETS)
def test_a_thousand_runs_meet_the_bound_in_every_parameter(name, noise):
    found = accuracy(name, noise, 1000, runs=1000, seed=2)
    assert found.ratio.min() > 0.93
    assert found.ratio.max() < 1.07
    assert found.chi_square.mean() / 1995.0 == pytest.approx(1.0, abs=0.003)
    assert 4.7 < found.nees.mean() < (5.8 if name == "S1-T2" else 5.7)
    share = found.success.mean()
    assert share >= (LEAST_SUCCESS[name] if noise == 5 else 1.0)
    assert share <= (0.94 if (name, noise) == ("S1-T2", 5) else 1.0)


def test_the_mean_bearing_straddles_north_without_bias():
    found = accuracy("S1-T1", 1, 1000, runs=1000, seed=6)
    bearing = found.errors[:, 1]
    assert 0.4 < np.mean(bearing < 0) < 0.6
    mean = np.angle(np.exp(1j * bearing).mean())
    assert abs(mean) < 0.1 * bearing.std()


@pytest.mark.parametrize("rows", [100, 200, 1000])
@pytest.mark.parametrize(("name", "noise"), [("S1-T4", 1), ("S2", 5), ("S3", 1)])
def test_the_likelihood_ratio_region_holds_the_truth_at_any_length(name, noise, rows):
    found = accuracy(name, noise, rows, runs=200, seed=8)
    inside = np.mean(found.rise < 11.070)  # chi-square of 5, 95 %
    # the band 0.92-0.99, widened by two deviations of 200 draws
    assert 0.92 - 0.031 <= inside <= 1.0


@pytest.mark.parametrize("rows", [100, 250, 1000])
@pytest.mark.parametrize("name", ["S1-T1", "S2"])
def test_descents_from_anywhere_reach_the_minimum(name, rows):
    problem = make_problem(make_scenario(name), noise=1, runs=1, seed=9)
    problem = problem.rows(slice(0, rows))
    rng = np.random.default_rng(9)
    draws = PAPER_BOX.draw(100, rng)
    start = np.stack([
        np.log(np.maximum(draws[:, 0], 50.0)), draws[:, 1],
        draws[:, 2] * np.sin(draws[:, 3]), draws[:, 2] * np.cos(draws[:, 3]),
    ], 1)  # fmt: skip
    ends = minimise(problem, start, WIDE, iterations=200)
    best = multistart(problem, WIDE)
    # before the range is observable, corners of the box differ by less than 0.7
    slack = 0.7 if (name, rows) == ("S2", 100) else 1e-3
    assert best.value[0] <= ends.value.min() + slack
    reached = np.mean(ends.value - best.value[0] < slack)
    assert reached >= (0.99 if rows == 1000 else 0.9)


@pytest.mark.parametrize("rows", [100, 1000])
@pytest.mark.parametrize("name", TARGETS)
def test_many_starts_find_the_minimum_that_the_truth_leads_to(name, rows):
    problem = make_problem(make_scenario(name), noise=5, runs=6, seed=10)
    problem = problem.rows(slice(0, rows))
    near = fit_from_truth(problem, make_scenario(name).solution())
    for index, value in enumerate(near.value):
        found = multistart(problem.record(index), WIDE)
        assert found.value[0] < value + 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "noise"), [("S1-T2", 1), ("S2", 5), ("S3", 1)])
def test_recursive_estimates_follow_the_batch(name, noise):
    problem = make_problem(make_scenario(name), noise=noise, runs=1, seed=12)
    found = estimate_recursively(problem, WIDE)
    assert found.rows[-1] == 1000
    assert found.rows.size == found.q.shape[0]
    ends = np.array([300, 500, 1000])
    exact = solve_mle(problem, WIDE, ends, seed=0)
    for end, batch, allowed in zip(ends, exact, (1.6, 0.05, 2e-3), strict=True):
        part = problem.rows(slice(0, int(end)))
        ours = found.q[found.rows == end]
        excess = misfit(part, ours).value[0] - misfit(part, batch[None]).value[0]
        assert excess < allowed


@pytest.mark.long
def test_the_criterion_holds_from_the_published_length_on():
    ends, met = follow("S1-T4", 1, runs=50, seed=3)
    reached = rows_until(ends, met)
    published = next(
        row["n90"] for row in REFERENCE["sequential"]
        if (row["case"], row["noise"], row["method"]) == ("S1-T4", 1, "seq. MLE")
    )  # fmt: skip
    assert reached == pytest.approx(published, abs=40)
    assert reached > 300  # where an efficient estimator meets it in half its runs


@pytest.mark.long
@pytest.mark.parametrize("row", [r for r in REFERENCE["criterion"] if r["both"][1]],
                         ids=lambda row: f"{row['case']}-{row['noise']}")  # fmt: skip
def test_every_scenario_meets_the_criterion_where_an_efficient_estimator_does(row):
    ends, met = follow(row["case"], row["noise"], runs=200, seed=3)
    reached = rows_until(ends, met)
    # a share of 200 runs has a deviation of 0.02: its crossing scatters by tens
    assert reached == pytest.approx(row["both"][1], abs=80)
    assert reached > row["both"][0]


@pytest.mark.long
def test_hybrids_reach_the_minimum_as_often_as_published_and_always_with_feedback():
    runs = 30
    genetic = single_shots("S1-T3", 1, runs, 5, "genetic").is_reached.mean()
    annealing = single_shots("S1-T3", 1, runs, 5, "annealing").is_reached.mean()
    alone = single_shots("S1-T4", 5, runs, 5, "none").is_reached.mean()
    # the bands 0.80-1.00 and 0.70-0.95, widened by a deviation of 30 runs
    assert genetic >= 0.73
    assert annealing >= 0.73
    assert 0.62 <= alone <= 0.99
    for search in ("genetic", "annealing"):
        assert with_feedback("S1-T3", 1, 3, 5, search).all()


@pytest.mark.long
@pytest.mark.parametrize("noise", [1, 5])
@pytest.mark.parametrize("name", TARGETS)
def test_hybrids_meet_the_published_bands_in_every_scenario(name, noise):
    runs = 100
    fitted = accuracy(name, noise, 1000, runs, seed=5).success.mean()
    for search in ("genetic", "annealing"):
        reached = single_shots(name, noise, runs, 5, search).is_reached.mean()
        assert 0.8 <= reached <= 1.0
        fed = with_feedback(name, noise, 20, 5, search).mean()
        # a share of 20 runs near 0.9 has a deviation of 0.07
        assert fed >= fitted - 0.05 - 0.14
    alone = single_shots(name, noise, runs, 5, "none").is_reached.mean()
    assert 0.65 <= alone <= 0.98


def test_a_simplex_finds_the_end_of_rosenbrocks_valley_as_fast_as_scipys():
    starts = np.array([[-1.2, 1.0], [2.0, -1.0], [0.3, 3.0]])
    simplices = simplex_about(starts, np.full(2, 4.0))
    found = nelder_mead(lambda points, _: rosen(points.T), simplices)
    options = {"xatol": 1e-6, "fatol": 1e-14}
    for row, simplex in enumerate(simplices):
        peer = minimize(
            rosen, starts[row], method="Nelder-Mead", options=options | {"initial_simplex": simplex}
        )
        np.testing.assert_allclose(found.point[row], peer.x, atol=1e-5)
        assert found.evaluations[row] < 1.5 * peer.nfev


@pytest.mark.slow
@pytest.mark.parametrize(
    "loss",
    [*(pytest.param(name, marks=pytest.mark.long) for name in ("huber", "student")), "tukey"],
)
def test_robust_losses_withstand_a_tenth_of_outliers_from_many_starts(loss):
    published = REFERENCE["outliers"]["S3"][loss][0]
    ratio, met = robust_fits("S3", loss, runs=20, seed=13)
    assert met.all()
    # 20 runs: the ratio has a deviation of 16 %
    assert published * 0.6 < ratio < published * 1.4
    clean, _ = robust_fits("S3", loss, runs=20, seed=13, clean=True)
    plain, _ = robust_fits("S3", "squares", runs=20, seed=13, clean=True)
    assert clean / plain < 1.15


def test_least_squares_does_not_withstand_outliers():
    ratio, _ = robust_fits("S3", "squares", runs=10, seed=13)
    assert ratio > 10.0


def test_the_profile_interval_is_the_ellipse_where_data_abound_and_open_where_not():
    problem = make_problem(make_scenario("S3"), noise=1, runs=1, seed=14)
    fit = multistart(problem, WIDE)
    std = np.sqrt(information(problem, fit.q[0]).covariance(people=False)[0, 0])
    span = profile_interval(problem, fit.q[0], 0, float(std), WIDE, rise=3.841)
    assert span.high - fit.q[0, 0] == pytest.approx(1.96 * std, rel=0.05)
    assert not span.is_open
    early = make_problem(make_scenario("S2"), noise=5, runs=1, seed=1)
    early = early.rows(slice(0, 100))
    fit = multistart(early, WIDE)
    assert profile_interval(early, fit.q[0], 0, 1.0, WIDE, rise=3.841).open_high


@pytest.mark.long
def test_the_profile_interval_covers_the_true_range_in_the_weak_regime():
    scenario = make_scenario("S1-T4")
    problem = make_problem(scenario, noise=1, runs=60, seed=15).rows(slice(0, 200))
    inside = 0
    for index in range(60):
        one = problem.record(index)
        fit = multistart(one, WIDE)
        span = profile_interval(one, fit.q[0], 0, 0.5, WIDE, rise=3.841)
        inside += span.low <= scenario.solution()[0] <= span.high
    assert inside / 60 >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / 60)


def test_the_profile_interval_of_the_course_follows_a_valley_that_bends():
    """Of 20 true courses 19 are due within 95 %; a search that stalls has 15 or fewer."""
    scenario = make_scenario("S2")
    problem = make_problem(scenario, noise=1, runs=20, seed=77).rows(slice(0, 200))
    truth = to_motion(scenario.solution())[3]
    inside = 0
    for index in range(20):
        one = problem.record(index)
        best = multistart(one, WIDE).q[0]
        std = np.sqrt(information(one, best).covariance()[3, 3])
        span = profile_interval(one, best, 3, min(std, 0.8), WIDE, rise=3.841)
        middle = to_polar(best)[3]
        course = middle + wrap_rad(truth - middle)
        inside += span.low <= course <= span.high
    assert inside >= 17


@pytest.mark.parametrize(
    ("name", "rows", "expected"), [("S3", 1000, True), ("S2", 200, False), ("S1-T4", 200, False)]
)
def test_a_joint_ellipse_is_trusted_where_it_holds_the_truth(name, rows, expected):
    """By the true motions of 12 runs: 95 % of them within, or far fewer."""
    scenario = make_scenario(name)
    problem = make_problem(scenario, noise=1, runs=12, seed=78).rows(slice(0, rows))
    truth = to_motion(scenario.solution())
    trusted, within = [], []
    for index in range(12):
        one = problem.record(index)
        best = multistart(one, WIDE).q[0]
        covariance = information(one, best).covariance()[:4, :4]
        off = to_motion(best) - truth
        off[[1, 3]] = wrap_rad(off[[1, 3]])
        within.append(off @ np.linalg.solve(covariance, off) < QUANTILE)
        trusted.append(ellipse_holds(one, best, covariance, 1.0))
    assert np.mean(trusted) == float(expected)
    assert (np.mean(within) > 0.8) == expected


def folded(name, rows):
    """Bearings of an array that points along own course, true to the model."""
    problem = make_problem(make_scenario(name), noise=1e-6, runs=1, seed=1)
    scenario = make_scenario(name)
    # the course of the interval that follows a row; the last repeats
    step = np.diff(scenario.own_east_m[1:]), np.diff(scenario.own_north_m[1:])
    course = np.arctan2(*step)
    course = np.append(course, course[-1])
    one_sigma = replace(
        problem,
        array_heading_rad=course,
        bearing_weight=problem.bearing_weight * 1e-6,
        frequency_weight=problem.frequency_weight * 1e-6,
    )
    return one_sigma.rows(slice(0, rows))


def test_the_ghost_of_a_line_array_is_exact_on_a_straight_course():
    for name, rows in (("S3", 1000), ("S1-T2", 250)):
        modes = find_modes(folded(name, rows), multistart(folded(name, rows), PAPER), 5)
        assert modes.weight == pytest.approx([0.5, 0.5], abs=1e-3), name
        assert np.all(modes.value < 1e-6)
    ghost = to_motion(multistart(folded("S3", 1000), PAPER).q[:2])
    order = np.argsort(ghost[:, 1])
    bearing, course = np.degrees(ghost[order][:, [1, 3]]).T
    assert bearing == pytest.approx([45.0, 135.0], abs=0.01)
    assert course == pytest.approx([270.0, 270.0], abs=0.01)


def test_modes_weigh_what_laplace_says_of_their_height_and_volume():
    """exp(-misfit / 2) / sqrt(det): Laplace's approximation (MacKay 2003, ch. 27)."""
    problem = folded("S3", 1000)
    found = multistart(problem, PAPER)
    north = np.cos(found.q[:, 1]) > 0.0
    ghosts = found.take(np.array([north.argmax(), north.argmin()]))
    own = ghosts.matrix[0] + np.eye(4) * np.trace(ghosts.matrix[0])
    ghosts = replace(ghosts, value=np.array([0.0, 2.0]), matrix=np.stack([own, 1.5 * own]))
    modes = find_modes(problem, ghosts, 5)
    ratio = np.exp(-1.0) / np.sqrt(1.5**4)
    assert modes.weight == pytest.approx([1 / (1 + ratio), ratio / (1 + ratio)], 1e-4)


@pytest.mark.parametrize("rows", [40, 60, 80, 100])
def test_a_turning_array_rules_the_ghost_out_as_published(rows):
    problem = folded("S2", rows)
    side = np.sign(np.sin(make_scenario("S2").solution()[1]))
    found = multistart(problem, PAPER)
    ghosts = np.sign(np.sin(found.q[:, 1])) != side
    published = REFERENCE["ghost_chi2_s2"][str(rows)]
    assert found.value[0] < 1e-6
    # published values are upper bounds of the ghost's best misfit
    best = found.value[ghosts].min() if ghosts.any() else np.inf
    assert best > 0.5 * published
    assert STEP_S == 6.0


@pytest.mark.parametrize(("rise", "is_apart"), [(0.0, False), (0.9, False), (1.1, True)])
def test_minima_are_two_when_a_barrier_lies_between_them(monkeypatch, rise, is_apart):
    """The misfit along the straight line is a cosine that rises by parts of the barrier."""
    ends = np.array([[0.0, 0.1, 0.0, 0.0], [9.0, 0.1, 0.0, 0.0]])

    def hill(_, q):
        height = rise * modes.BARRIER * np.sin(np.pi * q[:, 0] / 9.0)
        return SimpleNamespace(value=50.0 + height)

    monkeypatch.setattr(modes, "misfit", hill)
    fit = SimpleNamespace(q=ends, value=np.full(2, 50.0), matrix=np.stack([np.eye(4)] * 2))
    assert modes._apart(None, fit, 1, 0) is is_apart
