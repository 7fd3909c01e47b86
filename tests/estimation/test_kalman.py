"""The two-state filters against reference values, the matrices and Stone Soup."""

from datetime import datetime, timedelta

import numpy as np
import pytest

from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.kalman import KalmanState, advance, predict, smooth_all, update


def _steady(q: float, r: float) -> tuple[float, float, float, float]:
    state = KalmanState(*(np.array([v]) for v in (0.0, 0.0, r, 0.0, 1.0)))
    before = state
    for _ in range(2000):
        before = predict(state, 1.0, np.array([q]))
        state = update(before, np.array([0.0]), np.array([r]))
    total = before.variance[0] + r
    return (
        before.variance[0], state.variance[0],
        before.variance[0] / total, before.covariance[0] / total,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("q", "r", "published"),
    [
        (1e-4, 0.25, (0.05535, 0.04532, 0.1813, 0.0181)),
        (1e-2, 1.0, (0.56395, 0.36059, 0.3606, 0.0800)),
    ],
    ids=["frequency", "bearing"],
)
def test_steady_variances_and_gains_are_the_reference_values(
    q: float, r: float, published: tuple[float, ...]
) -> None:
    assert np.allclose(_steady(q, r), published, rtol=0, atol=6e-5)


def test_a_run_equals_stone_soup_to_rounding() -> None:
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import ConstantVelocity
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    q, r, epoch = 1e-3, 0.2, datetime(2024, 5, 1)  # noqa: DTZ001
    predictor = KalmanPredictor(ConstantVelocity(q))
    updater = KalmanUpdater(LinearGaussian(2, (0,), np.array([[r]])))
    theirs = GaussianState([[5.0], [0.1]], np.diag([r, 0.04]), timestamp=epoch)
    ours = KalmanState(*(np.array([v]) for v in (5.0, 0.1, r, 0.0, 0.04)))
    rng = np.random.default_rng(3)
    for k, z in enumerate(5.0 + rng.standard_normal(50)):
        now = epoch + timedelta(seconds=0.5 * (k + 1))
        prediction = predictor.predict(theirs, timestamp=now)
        detection = Detection([[z]], timestamp=now)
        theirs = updater.update(SingleHypothesis(prediction, detection))
        before = predict(ours, 0.5, np.array([q]))
        ours = update(before, z - before.position, np.array([r]))
        found = [ours.position[0], ours.rate[0]]
        assert np.allclose(theirs.state_vector.ravel(), found, atol=1e-10)
        assert np.isclose(float(theirs.covar[0, 1]), ours.covariance[0], atol=1e-10)


def test_smoothing_equals_the_least_squares_solution_of_the_whole_interval() -> None:
    rng = np.random.default_rng(4)
    q, r, n = 1e-2, 0.3, 40
    z = np.cumsum(0.1 * rng.standard_normal(n))
    start = KalmanState(*(np.array([v]) for v in (z[0], 0.0, r, 0.0, 0.5)))
    kept = [start]
    for k in range(1, n):
        before = predict(kept[-1], 1.0, np.array([q]))
        kept.append(update(before, z[k] - before.position, np.array([r])))
    states = np.array([np.stack(state) for state in kept])
    smooth_all(states, np.ones(n), np.array([q]), np.ones((n, 1), dtype=bool))
    positions, variances = states[:, 0, 0], states[:, 2, 0]
    step = np.array([[1.0, 1.0], [0.0, 1.0]])
    noise = np.linalg.inv(q * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]))
    normal, right = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    normal[0, 0] += 1 / r
    normal[1, 1] += 1 / 0.5
    right[0] += z[0] / r
    for k in range(1, n):
        model = np.zeros((2, 2 * n))
        model[:, 2 * k : 2 * k + 2] = np.eye(2)
        model[:, 2 * k - 2 : 2 * k] = -step
        normal += model.T @ noise @ model
        normal[2 * k, 2 * k] += 1 / r
        right[2 * k] += z[k] / r
    inverse = np.linalg.inv(normal)
    assert np.allclose(positions, (inverse @ right)[::2], atol=1e-8)
    assert np.allclose(variances, np.diag(inverse)[::2], atol=1e-8)


def test_a_measurement_without_information_changes_nothing() -> None:
    state = KalmanState(*(np.array([v]) for v in (5.0, 0.1, 0.2, 0.01, 0.04)))
    after = update(state, np.array([3.0]), np.array([np.inf]))
    assert all(np.array_equal(a, b) for a, b in zip(after, state, strict=True))


def test_angles_wrap_to_the_half_open_circle() -> None:
    angles = np.array([180.0, -180.0, 190.0, -190.0, 720.5])
    assert wrap_deg(angles).tolist() == [-180.0, -180.0, -170.0, 170.0, 0.5]


def test_states_are_carried_in_place_as_they_are_predicted() -> None:
    rng = np.random.default_rng(5)
    state = KalmanState(*rng.random((5, 2, 7)))
    noise = rng.random((2, 7))
    ahead = predict(state, 0.5, noise)
    advance(state, 0.5, noise)
    assert np.allclose(np.stack(state), np.stack(ahead), rtol=1e-13)


def test_times_behind_a_lines_end_stay_as_they_were_filtered() -> None:
    states = np.random.default_rng(6).random((6, 5, 1, 1)) + 1.0
    filtered = states.copy()
    is_inside = (np.arange(6) < 3)[:, None, None]
    smooth_all(states, np.ones(6), np.ones((1, 1)), is_inside)
    assert np.array_equal(states[3:], filtered[3:])
    assert (states[:3] != filtered[:3]).any(axis=(1, 2, 3)).all()
