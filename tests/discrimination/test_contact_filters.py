"""The contact filters: numerical slopes, exact geometry, coverage, missing values."""

import numpy as np
import pytest

from uwtrack_cli.discrimination.contact_filters import (
    GaussianSum,
    Observation,
    inverse_range_deviation,
    predict_drift,
    predict_moving,
    start_drift,
    start_moving,
    update_drift,
    update_moving,
)
from uwtrack_cli.discrimination.pair_test import consistency
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.imm import Belief

VARIANCE = np.array([25.0, 0.035**2, 1.0])
ONE = np.ones((1, 1))


def _seen(measured, position=(0.0, 0.0), velocity=(0.0, 0.0), variance=VARIANCE):
    return Observation(
        np.asarray(measured, float), np.asarray(variance, float),
        np.asarray(position, float), np.asarray(velocity, float),
    )  # fmt: skip


def _one(mean, covariance):
    """Return a sum of one model and one term."""
    belief = Belief(
        np.asarray(mean, float)[None, None], np.asarray(covariance)[None, None], np.ones((1, 1))
    )
    return GaussianSum(belief, np.zeros(1))


def _drifted(mean, covariance, way, drift_std=0.0, intensity=0.0, interval=2.0):
    state = predict_drift(
        _one(mean, covariance), interval, np.asarray(way), drift_std, np.array([intensity]), ONE
    )
    return state.belief.mean[0, 0], state.belief.covariance[0, 0]


def _moved(mean, covariance, way, intensity=0.0, interval=2.0):
    state = predict_moving(
        _one(mean, covariance), interval, np.asarray(way), np.array([intensity]), ONE
    )
    return state.belief.mean[0, 0], state.belief.covariance[0, 0]


def _plane(state):
    """Return place and velocity, east and north, of moving states about the origin."""
    theta, across, distance, along = np.moveaxis(state, -1, 0)
    line = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    side = np.stack([-line[..., 1], line[..., 0]], axis=-1)
    rate = along[..., None] * line + across[..., None] * side
    return np.concatenate([distance[..., None] * line, rate], axis=-1)


def test_a_vessel_is_carried_straight_over_own_ships_way():
    mean, way = np.array([2.9, 6.0, 300.0, -11.0]), np.array([40.0, 25.0])
    before = _plane(mean)
    expected = before + np.array([*(2.0 * before[2:] - way), 0.0, 0.0])
    moved, _ = _moved(mean, np.eye(4) * 1e-6, way)
    np.testing.assert_allclose(_plane(moved), expected, rtol=1e-12)


def test_the_covariance_of_the_moving_state_follows_its_slopes_and_the_published_noise():
    mean, way = np.array([0.7, -4.0, 650.0, 12.8]), np.array([35.0, -20.0])
    spread = np.diag([1e-3, 4.0, 25.0, 1.0])
    _, covariance = _moved(mean, spread, way)
    slope = np.empty((4, 4))
    for k, step in enumerate((1e-5, 1e-4, 1e-3, 1e-4)):
        up, down = (_moved(mean + sign * step * np.eye(4)[k], spread, way)[0] for sign in (1, -1))
        slope[:, k] = (up - down) / (2.0 * step)
    np.testing.assert_allclose(covariance, slope @ spread @ slope.T, rtol=1e-5, atol=1e-12)
    # The published matrix in east and north, drawn and turned into bearing and range.
    after, noise = _moved(mean, 1e-9 * np.eye(4), way, intensity=4.0)
    drawn = _plane(after) + _pushes(np.random.default_rng(1), 2.0, 4.0, 200_000)
    distance = np.hypot(drawn[:, 0], drawn[:, 1])
    line = drawn[:, :2] / distance[:, None]
    bearing = np.arctan2(drawn[:, 1], drawn[:, 0])
    across = line[:, 0] * drawn[:, 3] - line[:, 1] * drawn[:, 2]
    along = (line * drawn[:, 2:]).sum(axis=1)
    found = np.cov(np.stack([bearing, across, distance, along]))
    scale = np.sqrt(np.diag(found))
    np.testing.assert_allclose(
        noise / np.outer(scale, scale), found / np.outer(scale, scale), atol=0.02
    )


def _pushes(rng, interval, intensity, runs):
    """Draw what white acceleration adds to place and velocity (Jeong and Hong, eq. 12)."""
    block = [[interval**3 / 3.0, interval**2 / 2.0], [interval**2 / 2.0, interval]]
    noise = intensity * np.kron(block, np.eye(2))
    return rng.multivariate_normal(np.zeros(4), noise, runs)


def test_a_still_source_is_carried_exactly_over_own_ships_way():
    source, way = np.array([300.0, 800.0]), np.array([40.0, 25.0])
    left = source - way
    distance, after = np.hypot(*source), np.hypot(*left)
    mean = [np.arctan2(*source[::-1]), 1.0 / distance, distance + 70.0, 12.8]
    moved, _ = _drifted(mean, np.eye(4) * 1e-6, way)
    # A false range grows by its false rate beside the true one.
    expected = [np.arctan2(*left[::-1]), 1.0 / after, after + 70.0 + 2.0 * 12.8, 12.8]
    np.testing.assert_allclose(moved, expected, rtol=1e-12)


def test_the_covariance_of_the_drifting_state_follows_its_slopes():
    mean, way = np.array([0.7, 1.0 / 600.0, 650.0, 12.8]), np.array([35.0, -20.0])
    spread = np.diag([1e-3, 1e-8, 25.0, 1.0])
    _, covariance = _drifted(mean, spread, way)
    slope = np.empty((4, 4))
    for k, step in enumerate((1e-5, 1e-8, 1e-3, 1e-3)):
        up, down = (_drifted(mean + sign * step * np.eye(4)[k], spread, way)[0] for sign in (1, -1))
        slope[:, k] = (up - down) / (2.0 * step)
    np.testing.assert_allclose(covariance, slope @ spread @ slope.T, rtol=1e-5)


def test_the_drift_widens_bearing_and_inverse_range_as_published():
    mean = [0.3, 1.0 / 500.0, 500.0, 0.0]
    _, still = _drifted(mean, np.zeros((4, 4)), np.zeros(2), drift_std=3.0)
    expected = np.diag([2.0 * 9.0 / 500.0**2, 2.0 * 9.0 / 500.0**4])
    np.testing.assert_allclose(still[:2, :2], expected)
    # Along the line of sight the range grows as its inverse shrinks.
    assert still[1, 2] == pytest.approx(-2.0 * 9.0 / 500.0**2)
    _, pushed = _drifted(mean, np.zeros((4, 4)), np.zeros(2), intensity=4.0)
    np.testing.assert_allclose(pushed[2:, 2:], [[4.0 * 8 / 3, 8.0], [8.0, 8.0]])


def test_the_terms_of_a_start_have_the_moments_of_its_prior():
    seen = _seen([1000.0, 0.4, 3.0], (50.0, 20.0), (4.0, -7.0), [25.0, 0.2**2, 1.0])
    rng = np.random.default_rng(3)
    bearing = 0.4 + 0.2 * rng.standard_normal(400_000)
    along = np.stack([np.cos(bearing), np.sin(bearing)])
    shrunk = 400.0 / 401.0
    radial = shrunk * (3.0 + np.array([4.0, -7.0]) @ along)
    radial += np.sqrt(shrunk) * rng.standard_normal(bearing.size)
    distance = 1000.0 + 5.0 * rng.standard_normal(bearing.size)
    drawn = np.stack([bearing, 20.0 * rng.standard_normal(bearing.size), distance, radial])
    state = start_moving(seen, 20.0, 1)
    weight = np.exp(state.log_weight)
    assert weight.sum() == pytest.approx(1.0)
    mean = weight @ state.belief.mean[0]
    away = state.belief.mean[0] - mean
    spread = np.einsum("t,tij->ij", weight, state.belief.covariance[0])
    spread += np.einsum("t,ti,tj->ij", weight, away, away)
    deviation = drawn.std(axis=1)
    np.testing.assert_allclose((mean - drawn.mean(axis=1)) / deviation, 0.0, atol=0.03)
    np.testing.assert_allclose(
        spread / np.outer(deviation, deviation), np.corrcoef(drawn), atol=0.05
    )


def test_a_repeater_is_no_farther_than_it_was_measured():
    state = start_drift(_seen([800.0, 0.1, 0.0]), 0.5, 20.0, 1)
    inverse = 800.0 * state.belief.mean[0, :, 1]
    assert inverse.min() == pytest.approx(1.0)
    # A half-normal distribution from 1 on: mean 1 + 0.5 sqrt(2/pi).
    mean = np.exp(state.log_weight) @ inverse
    assert mean == pytest.approx(1.0 + 0.5 * np.sqrt(2.0 / np.pi), abs=0.04)
    # Its deviation, and the width of the terms beside it.
    deviation = np.hypot(0.5 * np.sqrt(1.0 - 2.0 / np.pi) / mean, 0.15)
    assert inverse_range_deviation(state) == pytest.approx(deviation, abs=0.02)


def test_a_true_repeater_and_a_true_mover_are_covered_at_the_stated_rates():
    rng = np.random.default_rng(6)
    runs, interval, own_rate = 400, 2.0, np.array([10.0, 5.0])
    target = np.tile([500.0, 900.0, -6.0, 3.0], (runs, 1))
    buoy = np.tile([700.0, 400.0], (runs, 1))
    moving = drifting = None
    inside = []
    for scan in range(20):
        own = own_rate * interval * scan
        if scan:
            push = _pushes(rng, interval, 0.25, runs)
            target[:, :2] += interval * target[:, 2:]
            target += push
            buoy += np.sqrt(interval) * rng.standard_normal(buoy.shape)
        place, rate = target[:, :2] - own, target[:, 2:] - own_rate
        distance = np.hypot(*place.T)
        exact = np.stack(
            [distance, np.arctan2(place[:, 1], place[:, 0]), (place * rate).sum(1) / distance],
            axis=1,
        )
        seen = _seen(exact + np.sqrt(VARIANCE) * rng.standard_normal((runs, 3)), own, own_rate)
        line = buoy - own
        bearing = np.arctan2(line[:, 1], line[:, 0])
        echo = np.stack([np.hypot(*line.T), bearing, 0 * bearing], axis=1)
        echo[:, 2] = -(line * own_rate).sum(1) / echo[:, 0]
        echoed = _seen(echo + np.sqrt(VARIANCE) * rng.standard_normal((runs, 3)), own, own_rate)
        if moving is None:
            moving = start_moving(seen, 20.0, 1)
            drifting = start_drift(echoed, 0.5, 20.0, 1)
            continue
        moving = predict_moving(moving, interval, own_rate * interval, np.array([0.25]), ONE)
        moving, fit = update_moving(moving, seen)
        drifting = predict_drift(
            drifting, interval, own_rate * interval, 1.0, np.array([0.25]), ONE
        )
        drifting, line_fit = update_drift(drifting, echoed)
        inside.append((fit.distance2, line_fit.distance2))
    along = place / distance[:, None]
    speed = (along * target[:, 2:]).sum(axis=1)
    across = along[:, 0] * target[:, 3] - along[:, 1] * target[:, 2]
    true = np.stack([exact[:, 1], across, distance, speed], axis=1)
    error = moving.belief.mean[0, 0] - true
    error[:, 0] = wrap_rad(error[:, 0])
    covariance = moving.belief.covariance[0, 0]
    nees = (error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(1)
    assert nees.mean() == pytest.approx(4.0, abs=0.6)
    mover, repeater = np.mean(inside, axis=(0, 2))
    assert mover == pytest.approx(3.0, abs=0.15)
    assert repeater == pytest.approx(1.0, abs=0.08)


def test_a_missing_component_leaves_the_others_to_correct_the_state():
    state = _one([0.9, 400.0, 500.0, 2.0], 50.0 * np.eye(4))
    whole = [500.0, np.arctan2(4.0, 3.0), 3.0]
    after, fit = update_moving(state, _seen([np.nan, whole[1], np.nan]))
    assert fit.degrees == 1
    assert after.belief.covariance[0, 0, 2, 2] == pytest.approx(50.0)
    nothing, none = update_moving(state, _seen([np.nan] * 3))
    np.testing.assert_array_equal(nothing.belief.mean, state.belief.mean)
    assert none.log_density == 0.0
    drift = _one([0.1, 0.01, 100.0, 0.0], np.eye(4))
    still, fit = update_drift(drift, _seen([np.nan] * 3))
    np.testing.assert_array_equal(still.belief.mean, drift.belief.mean)
    assert fit.log_density == fit.degrees == 0.0


def test_bearings_across_south_west_are_differenced_the_short_way():
    ends = np.abs(wrap_rad(np.array([3.0 * np.pi, -np.pi])))
    assert ends.tolist() == pytest.approx([np.pi] * 2)
    drift = _one([np.pi - 0.01, 1e-3, 1000.0, 0.0], 1e-4 * np.eye(4))
    after, fit = update_drift(drift, _seen([1000.0, -np.pi + 0.01, 0.0]))
    assert fit.distance2 < 1.0
    assert after.belief.mean[0, 0, 0] > np.pi - 0.01


def test_consistency_is_uniform_enough_and_sees_one_wild_scan():
    rng = np.random.default_rng(7)
    distance2 = rng.chisquare(3, (15, 4000))
    degrees = np.full(distance2.shape, 3)
    assert 0.02 < (consistency(distance2, degrees) < 0.05).mean() < 0.06
    distance2[4] += 30.0
    assert (consistency(distance2, degrees) < 0.05).mean() > 0.95
