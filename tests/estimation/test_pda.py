"""Probabilistic data association against recorded runs, a hand scan and limits."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.rows import load_reference
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.constant_velocity import constant_velocity
from uwtrack_cli.estimation.information_reduction import gate_probability
from uwtrack_cli.estimation.probabilistic_association import associate, correct, innovate

GOLDEN = load_reference("clutter_golden")


def _scan(mean, covariance, measured, noise, **points):
    """Run one scan and return state, covariance and the association."""
    present = np.ones(measured.shape[:-1], dtype=bool)
    innovation = innovate(mean, covariance, measured, present, noise)
    gated = innovation.distance2 < points.pop("gate", 4.0) ** 2
    association = associate(innovation, gated, **points)
    return *correct(mean, covariance, innovation, association), association


@pytest.mark.parametrize("track", GOLDEN["tracks"], ids=lambda t: f"seed {t['seed']}")
def test_the_recorded_tracks_are_met_to_1e_9(track):
    transition, process = constant_velocity(1.0, 10.0, 2)
    np.testing.assert_array_equal(transition, GOLDEN["F"])
    np.testing.assert_array_equal(process, GOLDEN["Q"])
    mean, covariance = np.array(track["x0"]), GOLDEN["P0"] * np.eye(4)
    for step in track["steps"]:
        mean = transition @ mean
        covariance = transition @ covariance @ transition.T + process
        mean, covariance, association = _scan(
            mean, covariance, np.array(step["Z"]).reshape(-1, 2),
            np.array(GOLDEN["R"])[None],
            clutter_density=GOLDEN["lam"], detection_probability=GOLDEN["PD"],
            gate_probability=GOLDEN["PG"],
        )  # fmt: skip
        np.testing.assert_allclose(mean, step["x"], rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(covariance, step["P"], rtol=1e-9, atol=1e-9)
        assert association.miss == pytest.approx(step["b0"], abs=1e-9)
        np.testing.assert_allclose(
            association.weight[association.weight > 0.0],
            np.array(step["beta"])[np.array(step["beta"]) > 0.0], atol=1e-9,
        )  # fmt: skip


@pytest.mark.parametrize(
    ("detection", "false_alarm", "miss", "betas", "moved", "variances"),
    [
        (0.8, 0.05, 0.007156764, [0.69096638, 0.26589225, 0.0359846],
         [5.62955452, 0.81690519], [36.83974192, 2.22091692, 37.08545033]),
        (0.9, 0.2, 0.012673632, [0.68712693, 0.26441479, 0.03578465],
         [5.59827314, 0.81236595], [37.33803901, 2.23398803, 37.41094791]),
    ],
)  # fmt: skip
def test_a_scan_worked_by_hand_is_met_to_all_printed_digits(
    detection, false_alarm, miss, betas, moved, variances
):
    mean, covariance, association = _scan(
        np.zeros(4), np.diag([95.0, 10.0, 95.0, 10.0]),
        np.array([[5.0, -3.0], [12.0, 9.0], [-20.0, 15.0]]), 5.0 * np.eye(2)[None],
        clutter_density=false_alarm / 900.0, detection_probability=detection,
        gate_probability=gate_probability(4.0, 2),
    )  # fmt: skip
    assert association.miss == pytest.approx(miss, abs=1e-9)
    np.testing.assert_allclose(association.weight, betas, atol=1e-8)
    np.testing.assert_allclose(mean[::2], moved, atol=1e-8)
    np.testing.assert_allclose(covariance[[0, 0, 2], [0, 2, 2]], variances, atol=1e-8)


def test_many_targets_stepped_together_equal_each_alone():
    rng = np.random.default_rng(3)
    mean = rng.normal(0.0, 3.0, (7, 4))
    root = rng.normal(0.0, 2.0, (7, 4, 4))
    covariance = root @ np.swapaxes(root, -1, -2) + np.eye(4)
    measured = rng.normal(0.0, 6.0, (7, 5, 2))
    points = {
        "clutter_density": 0.01, "detection_probability": 0.8,
        "gate_probability": gate_probability(4.0, 2),
    }  # fmt: skip
    noise = np.eye(2)[None]
    together = _scan(mean, covariance, measured, noise, **points)
    for run in range(7):
        alone = _scan(mean[run], covariance[run], measured[run], noise, **points)
        np.testing.assert_allclose(together[0][run], alone[0], rtol=1e-12)
        np.testing.assert_allclose(together[1][run], alone[1], rtol=1e-12)


def test_a_lone_sure_measurement_gives_the_kalman_filter():
    covariance = np.array([[4.0, 1.0], [1.0, 3.0]])
    mean, after, association = _scan(
        np.array([1.0, 2.0]), covariance, np.array([[2.5]]), np.array([[[2.0]]]),
        clutter_density=0.0, detection_probability=1.0, gate_probability=1.0,
    )  # fmt: skip
    gain = covariance[:, 0] / 6.0
    np.testing.assert_allclose(mean, [1.0, 2.0] + gain * 1.5)
    np.testing.assert_allclose(after, covariance - np.outer(gain, gain) * 6.0)
    assert association.weight.tolist() == [1.0]


def test_an_empty_scan_leaves_the_prediction_as_it_is():
    covariance = np.diag([4.0, 1.0])
    mean, after, association = _scan(
        np.array([1.0, 2.0]), covariance, np.empty((0, 1)), np.array([[[2.0]]]),
        clutter_density=0.0, detection_probability=0.9, gate_probability=1.0,
    )  # fmt: skip
    np.testing.assert_array_equal(mean, [1.0, 2.0])
    np.testing.assert_array_equal(after, covariance)
    assert association.miss == 1.0
    assert association.log_likelihood_ratio == pytest.approx(math.log(0.1))


def test_equal_accuracies_give_the_same_answer_written_once_or_per_measurement():
    rng = np.random.default_rng(4)
    measured = rng.normal(0.0, 3.0, (6, 2))
    covariance = np.diag([5.0, 1.0, 6.0, 2.0])
    points = {"clutter_density": 0.02, "detection_probability": 0.7, "gate_probability": 0.999}
    once = _scan(np.zeros(4), covariance, measured, 2.0 * np.eye(2)[None], **points)
    each = np.broadcast_to(2.0 * np.eye(2), (6, 2, 2))
    per = _scan(np.zeros(4), covariance, measured, each, **points)
    np.testing.assert_allclose(once[0], per[0], rtol=1e-12)
    np.testing.assert_allclose(once[1], per[1], rtol=1e-12)


def test_the_more_accurate_of_two_measurements_is_believed_more():
    noise = np.array([[[0.25]], [[25.0]]])
    _, _, association = _scan(
        np.zeros(2), np.diag([1.0, 1.0]), np.array([[0.5], [0.5]]), noise,
        clutter_density=0.01, detection_probability=0.9, gate_probability=1.0,
    )  # fmt: skip
    assert association.weight[0] > 3.0 * association.weight[1]


@pytest.mark.parametrize(
    "covariance",
    [np.diag([-9.0, 1.0, 4.0, 1.0]), np.diag([-9.0, 1.0, -9.0, 1.0]),
     np.array([[4.0, 0, 9.0, 0], [0, 1, 0, 0], [9.0, 0, 4.0, 0], [0, 0, 0, 1]])],
    ids=["one negative", "two negative", "indefinite"],
)  # fmt: skip
def test_a_covariance_that_is_not_positive_definite_is_refused(covariance):
    present = np.ones(1, dtype=bool)
    with pytest.raises(DataError, match="not positive definite"):
        innovate(np.zeros(4), covariance, np.zeros((1, 2)), present, np.eye(2)[None])


@given(
    seed=st.integers(0, 10_000), count=st.integers(0, 12), dimension=st.integers(1, 4),
    detection=st.floats(0.01, 1.0), density=st.floats(0.0, 10.0),
)  # fmt: skip
def test_probabilities_sum_to_one_and_covariances_stay_positive(
    seed, count, dimension, detection, density
):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(2 * dimension, 2 * dimension))
    covariance = root @ root.T + 0.01 * np.eye(2 * dimension)
    noise = (rng.uniform(0.1, 3.0, (count or 1, dimension)) ** 2)[..., None]
    mean, after, association = _scan(
        rng.normal(size=2 * dimension), covariance, rng.normal(0, 3, (count, dimension)),
        noise * np.eye(dimension), clutter_density=density,
        detection_probability=detection,
        gate_probability=gate_probability(4.0, dimension),
    )  # fmt: skip
    total = association.miss + association.weight.sum()
    assert total == pytest.approx(1.0, abs=1e-12)
    assert np.linalg.eigvalsh(0.5 * (after + after.T)).min() > 0.0
    assert np.isfinite(mean).all()
    assert np.isfinite(association.log_likelihood_ratio)


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_a_singular_covariance_is_refused(dimension):
    n = 2 * dimension
    noise = np.ones((1, 1, dimension, dimension)) * (dimension > 1)
    with pytest.raises(DataError, match="not positive definite"):
        innovate(
            np.zeros((1, n)), np.zeros((1, n, n)), np.zeros((1, 1, dimension)),
            np.ones((1, 1), dtype=bool), noise,
        )  # fmt: skip


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_distances_gains_and_reductions_are_those_of_the_matrices(dimension):
    rng = np.random.default_rng(dimension)
    n = 2 * dimension
    root = rng.standard_normal((n, n))
    covariance, mean = root @ root.T + np.eye(n), rng.standard_normal(n)
    measured = rng.standard_normal((4, dimension)) + mean[::2]
    for shared in (True, False):
        roots = rng.standard_normal((1 if shared else 4, dimension, dimension))
        noise = roots @ np.swapaxes(roots, -1, -2) + np.eye(dimension)
        found = innovate(
            mean[None], covariance[None], measured[None], np.ones((1, 4), dtype=bool), noise[None]
        )
        for k in range(4):
            each = 0 if shared else k
            spread = covariance[::2, ::2] + noise[each]
            gain = covariance[:, ::2] @ np.linalg.inv(spread)
            nu = measured[k] - mean[::2]
            np.testing.assert_allclose(found.gain[0, each], gain)
            np.testing.assert_allclose(found.move[0, k], gain @ nu)
            np.testing.assert_allclose(found.reduction[0, each], gain @ spread @ gain.T, atol=1e-12)
            assert found.determinant[0, each] == pytest.approx(np.linalg.det(spread))
            assert found.distance2[0, k] == pytest.approx(nu @ np.linalg.solve(spread, nu))
