"""What holds 95 % of a mixture, against draws of it."""

import numpy as np
import pytest

from uwtrack_cli.estimation.normal_mixture import HALF_WIDTH, widened

COVARIANCE = np.array([[4.0, 1.9], [1.9, 1.0]])


@pytest.mark.parametrize("chance", [0.01, 0.04, 0.3])
def test_a_widened_deviation_holds_95_percent_of_what_was_drawn(chance):
    rng = np.random.default_rng(3)
    along = np.array([10.0, -2.0])
    found = widened(COVARIANCE, np.array([chance]), np.outer(along, along)[None])
    drawn = rng.multivariate_normal(np.zeros(2), COVARIANCE, 400_000)
    drawn += (rng.random(400_000) < chance)[:, None] * (rng.standard_normal((400_000, 1)) * along)
    held = np.mean(np.abs(drawn) < HALF_WIDTH * np.sqrt(np.diagonal(found)), axis=0)
    np.testing.assert_allclose(held, 0.95, atol=0.002)
    # no direction is known better than without the part that is added
    assert np.linalg.eigvalsh(found - COVARIANCE).min() > -1e-9


def test_nothing_added_changes_nothing():
    np.testing.assert_array_equal(widened(COVARIANCE, np.zeros(0), np.zeros((0, 2, 2))), COVARIANCE)
