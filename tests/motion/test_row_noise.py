"""Noise of the rows of a contact, against dense covariances and drawn noise."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from studies.tma_scenarios import make_problem, make_scenario
from tests.motion.sonar_scene import Scene
from tests.motion.test_target_laws import STATE
from uwtrack_cli.motion.coloured_noise import ColouredNoise
from uwtrack_cli.motion.target_motion.bounce import Bounce
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.objective import residuals
from uwtrack_cli.motion.target_motion.row_noise import alike_rows, find_colours, row_noise, whitened

KNOWN = NuisanceDeviations(own_position_m=30.0, own_velocity_mps=0.3, correlation_time_s=90.0)
BOUNCE = Bounce(90.0, 120.0, 0.0, 0.1, "")
MEMORY = ColouredNoise(np.array([2.0, 0.5]), np.array([70.0, 400.0]), 0.8)


def made(doppler="instantaneous"):
    """A problem of one platform with delays, and the residuals of its motion."""
    problem = replace(Scene(1, doppler).problem(offsets=False), sensor=None)
    r = residuals(problem, STATE[np.newaxis])
    delay, _ = BOUNCE.delay_s(r.prediction.range_m, problem.sound_speed_mps)
    heard = np.arange(problem.n_rows) % 2
    problem = replace(
        problem, bounce=BOUNCE,
        frequency_hz=np.concatenate([problem.frequency_hz, 1.01 * delay[np.newaxis]], 1),
        frequency_weight=np.concatenate([problem.frequency_weight, [2e3 * heard]]),
    )  # fmt: skip
    return problem, residuals(problem, STATE[np.newaxis])


def dense(problem, r, colours):
    """The covariance by its definition: every pair of values of every cause."""
    streams, time = len(problem.bearing_weight), problem.row_time_s
    tones = problem.n_lines - 1
    kind = np.repeat([0] * streams + [1] * tones + [2], time.size)
    at = np.tile(time, streams + problem.n_lines)
    _, share = whitened(problem, r)
    over = problem.track.interval_s[0]
    early = at - over * (0.5 if problem.track.before is None else 1.0)
    weight = np.concatenate([problem.bearing_weight, problem.frequency_weight]).ravel()
    across = np.tile(np.hypot(*r.prediction.bearing_jacobian[0, :2]), streams + problem.n_lines)
    slope = np.repeat(r.rest_hz[0, :-1] / problem.sound_speed_mps, time.size)
    turn = np.where(kind, 0.0, share * weight * across)
    rate, near = np.zeros(at.size), np.zeros(at.size)
    rate[kind == 1] = (share * weight)[kind == 1] * slope
    # the delay by its differences
    range_m = r.prediction.range_m[0]
    up, down = (BOUNCE.delay_s(range_m + step, problem.sound_speed_mps)[0] for step in (1, -1))
    near[kind == 2] = (share * weight)[kind == 2] * r.rest_hz[0, -1] * (down - up) / 2

    def like(a, b, memory_s):
        return np.exp(-np.abs(a[:, None] - b) / memory_s)

    tau = KNOWN.correlation_time_s
    late = early + over
    found = np.outer(turn, turn) * KNOWN.own_position_m**2 * like(at, at, tau)
    # all that own places along the line of sight move
    forms = ((late, rate / over), (early, -rate / over), (at, near))
    for (one, a), (other, b) in product(forms, forms):
        found += np.outer(a, b) * KNOWN.own_position_m**2 * like(one, other, tau)
    found += np.outer(rate, rate) * KNOWN.own_velocity_mps**2 * like(at, at, tau)
    white = np.ones(at.size)
    measured = weight > 0
    for which, colour in enumerate(colours):
        own = kind == which
        white[own] = colour.inflation
        rows = np.zeros(time.size)
        np.add.at(rows, np.tile(np.arange(time.size), at.size // time.size), own * measured)
        gain = own * measured * share
        gain = gain / np.sqrt(np.tile(np.maximum(rows, 1), at.size // time.size))
        for variance, memory_s in zip(colour.variance, colour.correlation_time_s, strict=True):
            strength = colour.inflation * variance
            found += strength * np.outer(gain, gain) * like(at, at, memory_s)
    return found + np.diag(white)


@pytest.mark.parametrize("doppler", ["instantaneous", "interval"])
def test_the_inverse_covariance_is_that_of_all_pairs_of_values(doppler):
    problem, r = made(doppler)
    colours = (MEMORY, replace(MEMORY, inflation=1.5), replace(MEMORY, inflation=2.0))
    noise = row_noise(problem, r, KNOWN, colours)
    covariance = dense(problem, r, colours)
    columns = np.random.default_rng(2).standard_normal((len(covariance), 3))
    np.testing.assert_allclose(
        noise.weigh(columns), np.linalg.solve(covariance, columns), atol=1e-6
    )
    assert noise.log_volume == pytest.approx(np.linalg.slogdet(covariance)[1])
    np.testing.assert_allclose(noise.variance, np.diagonal(covariance))


def test_drawn_noise_with_a_memory_is_found_and_white_noise_is_left():
    """AR(1) of stated variance on the bearings, white on the frequencies."""
    scenario = make_scenario("S3")
    problem = make_problem(scenario, noise=1.0, runs=1, seed=0)
    r = residuals(problem, scenario.solution()[np.newaxis])
    rng = np.random.default_rng(5)
    bearing = rng.standard_normal(r.bearing.shape)
    for row in range(1, problem.n_rows):
        bearing[..., row] = 0.8 * bearing[..., row - 1] + 0.6 * bearing[..., row]
    drawn = replace(r, bearing=bearing, frequency=rng.standard_normal(r.frequency.shape))
    n = problem.bearing_weight.size + problem.frequency_weight.size
    found = find_colours(problem, drawn, NuisanceDeviations(), np.ones((n, 1)), np.ones((1, 1)))
    assert found[1].is_white
    step_s = float(np.median(np.diff(problem.row_time_s)))
    memory = found[0]
    total = memory.inflation * (1.0 + memory.variance.sum())
    after = memory.variance @ np.exp(-step_s / memory.correlation_time_s)
    assert total == pytest.approx(1.0, abs=0.4)
    assert memory.inflation * after / total == pytest.approx(0.8, abs=0.15)


def test_rows_of_noise_with_a_memory_count_as_one_as_in_drawn_mean_squares():
    """Variance of the mean square of an AR(1) series, drawn, over that of white noise."""
    rng, decay, n = np.random.default_rng(3), 0.9, 400
    series = rng.standard_normal((n, 4000))
    for row in range(1, n):
        series[row] = decay * series[row - 1] + np.sqrt(1 - decay**2) * series[row]
    found = np.var((series**2).mean(axis=0)) / (2.0 / n)
    strong = ColouredNoise(np.array([1e6]), np.array([-1.0 / np.log(decay)]), 1e-6)
    assert alike_rows(strong, np.arange(n, dtype=float)) == pytest.approx(found, rel=0.1)
