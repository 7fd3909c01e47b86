"""Interacting motion models: laws of mixing, and a mixture worked by hand."""

import numpy as np
import pytest

from uwtrack_cli.estimation.imm import Belief, advance, mix, moments, reweigh

SWITCHING = np.array([[0.9, 0.1], [0.3, 0.7]])


def _belief(seed=1, runs=3):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(2, runs, 2, 2))
    weight = rng.random((2, runs))
    return Belief(
        rng.normal(size=(2, runs, 2)), root @ np.swapaxes(root, -1, -2), weight / weight.sum(axis=0)
    )


def test_mixing_keeps_the_mean_and_the_covariance_of_the_whole():
    before = _belief()
    after = mix(before, SWITCHING)
    for ours, theirs in zip(moments(after), moments(before), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)
    np.testing.assert_allclose(
        after.probability, np.einsum("ij,ir->jr", SWITCHING, before.probability)
    )


def test_no_switching_leaves_every_filter_alone():
    before = _belief()
    after = mix(before, np.eye(2))
    np.testing.assert_allclose(after.mean, before.mean)
    np.testing.assert_allclose(after.covariance, before.covariance, atol=1e-12)


def test_two_equal_filters_are_one():
    belief = _belief()
    same = Belief(
        np.stack([belief.mean[0]] * 2), np.stack([belief.covariance[0]] * 2), belief.probability
    )
    mean, covariance = moments(mix(same, SWITCHING))
    np.testing.assert_allclose(mean, belief.mean[0])
    np.testing.assert_allclose(covariance, belief.covariance[0])


def test_a_mixture_worked_by_hand():
    belief = Belief(
        np.array([[[0.0, 0.0]], [[4.0, 0.0]]]), np.stack([np.eye(2)[None]] * 2),
        np.array([[0.75], [0.25]]),
    )  # fmt: skip
    mean, covariance = moments(belief)
    np.testing.assert_allclose(mean, [[1.0, 0.0]])
    np.testing.assert_allclose(covariance, [[[4.0, 0.0], [0.0, 1.0]]])


def test_the_model_that_foresaw_the_scan_gains_by_bayes_rule():
    belief = Belief(np.zeros((2, 1, 2)), np.zeros((2, 1, 2, 2)), np.array([[0.8], [0.2]]))
    weight = reweigh(belief, np.log([[1e-300], [4e-300]]))
    assert weight[:, 0] == pytest.approx([0.5, 0.5])


def test_every_filter_is_predicted_by_its_own_noise():
    belief = _belief()
    step = np.array([[1.0, 2.0], [0.0, 1.0]])
    noise = np.stack([np.zeros((2, 2)), np.eye(2)])
    after = advance(belief, step, noise)
    for model in range(2):
        for run in range(3):
            np.testing.assert_allclose(
                after.covariance[model, run],
                step @ belief.covariance[model, run] @ step.T + noise[model],
            )
    np.testing.assert_allclose(after.mean[1, 2], step @ belief.mean[1, 2])
