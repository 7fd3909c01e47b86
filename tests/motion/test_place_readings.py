"""Two readings of bearings that cross: densities whose integrals are known."""

import numpy as np
import pytest

from uwtrack_cli.motion.target_motion.place_readings import (
    PlaceReading,
    Region,
    compete,
    mixture,
    sample_density,
)


def test_a_density_has_the_integral_and_moments_that_are_known():
    mean = np.array([300.0, -40.0, 0.5])
    root = np.array([[50.0, 0.0, 0.0], [20.0, 30.0, 0.0], [0.1, -0.2, 0.3]])
    spread = root @ root.T
    inverse = np.linalg.inv(spread)

    def log_target(trial):
        away = trial - mean
        return 7.0 - 0.5 * np.einsum("ti,ij,tj->t", away, inverse, away)

    # the first draws lie beside the density and are twice as wide
    found = sample_density(log_target, mean + root[:, 0], 4.0 * spread)
    integral = 7.0 + 0.5 * np.linalg.slogdet(2.0 * np.pi * spread)[1]
    assert found.is_sampled
    assert found.log_evidence == pytest.approx(integral, abs=0.1)
    assert (found.mean - mean) @ inverse @ (found.mean - mean) < 0.05
    np.testing.assert_allclose(np.linalg.eigvals(inverse @ found.covariance).real, 1.0, atol=0.2)


def test_what_few_draws_meet_is_not_called_sampled():
    def log_target(trial):
        return -0.5 * (((trial - 5e4) / 0.01) ** 2).sum(1)

    assert not sample_density(log_target, np.zeros(2), np.eye(2)).is_sampled


def test_the_mixture_has_the_moments_of_draws_from_both():
    draw = np.random.default_rng(2)
    moving = Region(np.array([5.0, 2.0, 1.0, -1.0]), np.diag([4.0, 9.0, 1.0, 2.0]), 2.0)
    still = Region(np.array([-3.0, 1.0]), np.array([[4.0, 1.0], [1.0, 2.0]]), 3.0)
    n = 400_000
    rest = np.zeros((n, 4))
    rest[:, :2] = draw.multivariate_normal(still.mean, still.covariance, n)
    going = draw.multivariate_normal(moving.mean, moving.covariance, n)
    chance = np.e / (1.0 + np.e)  # evidences of 3 and 2 at equal odds
    both = np.where((draw.random(n) < chance)[:, None], rest, going)
    found = mixture(compete(still, moving), still, moving)
    np.testing.assert_allclose(found.mean, both.mean(0), atol=0.03)
    np.testing.assert_allclose(found.covariance, np.cov(both.T), atol=0.1)
    assert found.log_evidence == pytest.approx(2.0 + np.log((np.e + 1.0) / 2.0))


def test_a_reading_that_was_not_sampled_is_never_told_against_the_other():
    moving = Region(np.zeros(4), np.eye(4), 0.0)
    poor = Region(np.zeros(2), np.eye(2), -1.0, is_sampled=False)
    assert compete(poor, moving).name == ""
    hopeless = Region(np.zeros(2), np.eye(2), -50.0, is_sampled=False)
    told = compete(hopeless, moving)
    assert told == PlaceReading("moving", told.weight)
    assert told.weight > 0.999
    assert mixture(told, hopeless, moving) is moving
