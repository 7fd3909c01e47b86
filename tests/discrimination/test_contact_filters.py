"""The contact filters: numerical slopes, exact geometry, coverage, missing values."""

import numpy as np
import pytest

from uwtrack_cli.discrimination.contact_filters import (
    DriftState,
    Observation,
    _observe,
    predict_drift,
    predict_moving,
    start_drift,
    start_moving,
    update_drift,
    update_moving,
    velocity_noise,
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


def test_the_slopes_of_range_bearing_and_range_rate_are_their_derivatives():
    seen = _seen([0.0, 0.0, 0.0], (30.0, -20.0), (3.0, -1.0))
    state = np.array([400.0, 250.0, -7.0, 4.0])
    _, slope = _observe(state, seen)
    for k, step in enumerate(np.diag([1e-3, 1e-3, 1e-4, 1e-4])):
        up, down = _observe(state + step, seen)[0], _observe(state - step, seen)[0]
        np.testing.assert_allclose(
            slope[:, k], (up - down) / (2 * step[k]), rtol=1e-6, atol=1e-9
        )


def test_a_still_source_is_carried_exactly_over_own_ships_way():
    source, before, after = (
        np.array([300.0, 800.0]),
        np.zeros(2),
        np.array([40.0, 25.0]),
    )
    place = source - before
    drift = DriftState(
        np.array([np.arctan2(*place[::-1]), 1.0 / np.hypot(*place)]), np.eye(2) * 1e-6
    )
    moved = predict_drift(drift, 2.0, after - before, 1.0)
    left = source - after
    np.testing.assert_allclose(
        moved.mean, [np.arctan2(*left[::-1]), 1.0 / np.hypot(*left)], rtol=1e-12
    )


def test_the_covariance_of_the_drifting_state_follows_its_slopes():
    mean, way = np.array([0.7, 1.0 / 600.0]), np.array([35.0, -20.0])
    spread = np.diag([1e-3, 1e-8])
    moved = predict_drift(DriftState(mean, spread), 2.0, way, 0.0)
    slope = np.empty((2, 2))
    for k, step in enumerate((1e-5, 1e-8)):
        ends = []
        for sign in (1.0, -1.0):
            shifted = mean.copy()
            shifted[k] += sign * step
            ends.append(predict_drift(DriftState(shifted, spread), 2.0, way, 0.0).mean)
        slope[:, k] = (ends[0] - ends[1]) / (2.0 * step)
    np.testing.assert_allclose(moved.covariance, slope @ spread @ slope.T, rtol=1e-5)


def test_the_drift_widens_bearing_and_inverse_range_as_published():
    mean = np.array([0.3, 1.0 / 500.0])
    still = predict_drift(DriftState(mean, np.zeros((2, 2))), 2.0, np.zeros(2), 3.0)
    expected = np.diag([2.0 * 9.0 / 500.0**2, 2.0 * 9.0 / 500.0**4])
    np.testing.assert_allclose(still.covariance, expected)


def test_the_noise_of_the_moving_state_is_the_published_matrix():
    expected = 4.0 * np.array(
        [[8 / 3, 0, 2, 0], [0, 8 / 3, 0, 2], [2, 0, 2, 0], [0, 2, 0, 2]]
    )
    np.testing.assert_allclose(velocity_noise(2.0, np.array([4.0]))[0], expected)


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
            push = rng.multivariate_normal(
                np.zeros(4), velocity_noise(interval, np.array([0.25]))[0], runs
            )
            target[:, :2] += interval * target[:, 2:]
            target += push
            buoy += np.sqrt(interval) * rng.standard_normal(buoy.shape)
        place, rate = target[:, :2] - own, target[:, 2:] - own_rate
        distance = np.hypot(*place.T)
        exact = np.stack(
            [distance, np.arctan2(place[:, 1], place[:, 0]),
             (place * rate).sum(1) / distance], axis=1,
        )  # fmt: skip
        seen = _seen(
            exact + np.sqrt(VARIANCE) * rng.standard_normal((runs, 3)), own, own_rate
        )
        line = buoy - own
        bearing = np.arctan2(line[:, 1], line[:, 0])
        echo = np.stack([np.hypot(*line.T), bearing, 0 * bearing], axis=1)
        echoed = _seen(echo + np.sqrt(VARIANCE) * rng.standard_normal((runs, 3)), own)
        if moving is None:
            moving, drifting = start_moving(seen, 20.0, 1), start_drift(echoed)
            continue
        moving = predict_moving(moving, interval, np.array([0.25]), ONE)
        moving, fit = update_moving(moving, seen)
        drifting = predict_drift(drifting, interval, own_rate * interval, 1.0)
        drifting, line_fit = update_drift(drifting, echoed)
        inside.append((fit.distance2, line_fit.distance2))
    error = moving.mean[0] - target
    nees = (
        error * np.linalg.solve(moving.covariance[0], error[..., None])[..., 0]
    ).sum(1)
    assert nees.mean() == pytest.approx(4.0, abs=0.6)
    mover, repeater = np.mean(inside, axis=(0, 2))
    assert mover == pytest.approx(3.0, abs=0.15)
    assert repeater == pytest.approx(1.0, abs=0.08)


def test_a_missing_component_leaves_the_others_to_correct_the_state():
    belief = Belief(
        np.array([[300.0, 400.0, 1.0, 2.0]]), 50.0 * np.eye(4)[None], np.ones(1)
    )
    whole = [500.0, np.arctan2(4.0, 3.0), 3.0]
    after, fit = update_moving(belief, _seen([np.nan, whole[1], np.nan]))
    assert fit.degrees == 1
    assert after.covariance[0, 2, 2] == pytest.approx(50.0)
    nothing, none = update_moving(belief, _seen([np.nan] * 3))
    np.testing.assert_array_equal(nothing.mean, belief.mean)
    assert none.log_density == 0.0
    still, fit = update_drift(
        DriftState(np.array([0.1, 0.01]), np.eye(2)), _seen([1.0, np.nan, 1.0])
    )
    np.testing.assert_array_equal(still.mean, [0.1, 0.01])
    assert fit.log_density == 0.0


def test_bearings_across_south_west_are_differenced_the_short_way():
    ends = np.abs(wrap_rad(np.array([3.0 * np.pi, -np.pi])))
    assert ends.tolist() == pytest.approx([np.pi] * 2)
    drift = DriftState(np.array([np.pi - 0.01, 1e-3]), 1e-4 * np.eye(2))
    after, fit = update_drift(drift, _seen([1000.0, -np.pi + 0.01, 0.0]))
    assert fit.distance2 < 1.0
    assert after.mean[0] > np.pi - 0.01


def test_consistency_is_uniform_enough_and_sees_one_wild_scan():
    rng = np.random.default_rng(7)
    distance2 = rng.chisquare(3, (15, 4000))
    degrees = np.full(distance2.shape, 3)
    assert 0.02 < (consistency(distance2, degrees) < 0.05).mean() < 0.06
    distance2[4] += 30.0
    assert (consistency(distance2, degrees) < 0.05).mean() > 0.95
