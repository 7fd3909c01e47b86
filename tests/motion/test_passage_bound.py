"""The joint fit attains the Cramer-Rao bound, and its error bars hold."""

import numpy as np
import pytest

from tests.draws.passage_truth import ROWS, Scene, bound, measure, true_motion
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.motion.passage.candidates import best_start
from uwtrack_cli.motion.passage.fit.estimator import fit_passage, fit_with_coloured_noise
from uwtrack_cli.motion.passage.model.measurements import make_blocks

NAMES = [
    f"{scene.speed_mps}-{scene.range_m:.0f}-{scene.carrier_to_noise_db:.0f}"
    f"-{len(scene.rest_hz)}-{scene.level_std_db:.0f}"
    for scene in ROWS
]

PUBLISHED = (
    (0.0059, 1.37, 0.20, 0.23),
    (0.0077, 1.07, 0.065, 0.28),
    (0.0019, 0.27, 0.016, 0.27),
    (0.0139, 0.62, 0.031, 0.50),
    (0.0067, 1.41, 0.062, 0.23),
    (0.0110, 2.01, 0.15, 0.25),
    (0.0078, 1.11, 0.066, 0.57),
)
"""Section 3.3: bounds of speed, range, time and course. Its broadband noise also
limits the lines and its level floor is another, hence the wide tolerance."""


def medium(scene):
    return Medium(scene.sound_speed_mps, scene.height_m)


def estimates(fit):
    return np.stack(
        [fit.theta[:, 0], fit.range_over_speed_s, fit.theta[:, 2], fit.bearing_deg], axis=-1
    )


def errors(scene, fit):
    truth = true_motion(scene)
    truth[3] = scene.bearing_deg
    return estimates(fit) - truth


def run(scene, runs, seed):
    rng = np.random.default_rng(seed)
    blocks = make_blocks(measure(scene, rng, runs))
    first = make_blocks(measure(scene, rng, 1))
    start, _ = best_start(first, medium(scene))
    return fit_passage(
        blocks, np.repeat(start.theta, runs, axis=0), np.repeat(start.turn, runs), medium(scene)
    )


def range_errors(scene, error):
    width = true_motion(scene)[1]
    return error[:, 1] * scene.speed_mps + error[:, 2] * width


def range_variance(scene, covariance):
    gradient = np.array([0.0, scene.speed_mps, true_motion(scene)[1], 0.0])
    return np.einsum("i,...ij,j->...", gradient, covariance, gradient)


def check_gates(scene, fit, most_ratio, coverage, bias):
    limit = bound(scene)
    error = errors(scene, fit)
    error = np.column_stack([error, range_errors(scene, error)])
    variance = np.column_stack(
        [np.einsum("bii->bi", fit.covariance), range_variance(scene, fit.covariance)]
    )
    attainable = np.append(np.diag(limit), range_variance(scene, limit))
    root = np.sqrt((error**2).mean(axis=0))
    assert np.all(root / np.sqrt(attainable) <= most_ratio)
    assert np.all(np.abs(error.mean(axis=0)) <= bias * root)
    deviations = np.abs(error) / np.sqrt(variance)
    inside = (deviations <= 1.96).mean(axis=0)
    assert np.all((inside >= coverage[0]) & (inside <= coverage[1]))
    median = np.median(deviations, axis=0)
    assert np.all((median >= 0.4) & (median <= 1.0))
    nees = np.einsum("bi,bij,bj->b", error[:, :4], np.linalg.inv(fit.covariance), error[:, :4])
    scatter = np.sqrt(2 * 4 / nees.size)
    assert abs(nees.mean() - 4) <= 4 * scatter + 0.35


@pytest.mark.parametrize(("scene", "published"), list(zip(ROWS, PUBLISHED, strict=True)), ids=NAMES)
def test_the_bound_is_near_the_published_one(scene, published):
    limit = bound(scene)
    ours = np.sqrt([limit[2, 2], range_variance(scene, limit), limit[0, 0], limit[3, 3]])
    np.testing.assert_allclose(ours, published, rtol=0.35)


@pytest.mark.parametrize("scene", ROWS, ids=NAMES)
def test_error_over_bound_and_error_bars(scene):
    fit = run(scene, 150, 1)
    check_gates(scene, fit, 1.15 + 3 / np.sqrt(300), (0.88, 1.0), 0.45)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("scene", ROWS, ids=NAMES)
def test_error_over_bound_and_error_bars_of_many(scene):
    parts = [run(scene, 250, seed) for seed in range(8)]
    whole = type(parts[0])(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in (
            "theta", "turn", "bearing_deg", "rest_hz", "rest_std_hz", "level_db",
            "covariance", "cost",
        )),
        noises=parts[0].noises,
    )  # fmt: skip
    check_gates(scene, whole, 1.15, (0.93, 0.97), 0.3)


@pytest.mark.parametrize("seed", range(3))
def test_the_search_finds_the_optimum_whatever_the_side(seed):
    scene = Scene(turn=1 if seed % 2 else -1, closest_s=120.0 + 150 * seed)
    rng = np.random.default_rng(seed)
    start, other = best_start(make_blocks(measure(scene, rng, 1)), medium(scene))
    assert start.turn[0] == scene.turn
    assert other < 1e-6
    assert abs(start.theta[0, 0] - scene.closest_s) < 1.0


@pytest.mark.slow
def test_error_bars_hold_when_the_shaft_wanders():
    scene = Scene(rest_hz=(63.0, 126.0, 189.0, 310.0), jitter=1e-3)
    scores = []
    for seed in range(8):
        blocks = make_blocks(measure(scene, np.random.default_rng(seed), 1))
        rough = run_one(blocks, scene)
        fit = fit_with_coloured_noise(rough, blocks)
        deviation = np.sqrt(np.diag(fit.covariance[0]))
        scores.append(np.abs(errors(scene, fit)[0]) / deviation)
    scores = np.array(scores)
    assert np.all(np.median(scores, axis=0) <= 1.0)
    assert (scores <= 3).mean() >= 0.96


def run_one(blocks, scene):
    start, _ = best_start(blocks, medium(scene))
    return fit_passage(blocks, start.theta, start.turn, medium(scene))


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_error_bars_hold_where_the_wander_is_as_slow_as_the_passage():
    """Few correlation times fit into a near, weak passage: little is left of the noise."""
    scene = Scene(
        6.57, 102.0, 21.0, tuple(69.377 * np.arange(2, 7)), closest_s=233.0,
        length_s=480.0, jitter=7.6e-4,
    )  # fmt: skip
    scores = []
    for seed in range(120):
        blocks = make_blocks(measure(scene, np.random.default_rng([77, seed]), 1))
        fit = fit_with_coloured_noise(run_one(blocks, scene), blocks)
        deviation = np.sqrt(np.diag(fit.covariance[0]))
        scores.append(np.abs(errors(scene, fit)[0]) / deviation)
    scores = np.array(scores)
    assert np.all((scores <= 2).mean(axis=0) >= 0.92)
    assert np.all((scores <= 3).mean(axis=0) >= 0.975)
    assert np.all(np.median(scores, axis=0) >= 0.1)
