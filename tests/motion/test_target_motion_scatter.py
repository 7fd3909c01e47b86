"""Deviations that nobody stated, and those of correlated measurements."""

import numpy as np
import pytest

from uwtrack_cli.estimation.robust import white_scatter
from uwtrack_cli.motion.target_motion.inputs import correlation_inflation
from uwtrack_cli.motion.target_motion.objective import loss_curvature, loss_value, loss_weight

LOSSES = ("squares", "huber", "student", "tukey")


def test_the_scatter_of_a_smooth_course_is_that_of_its_noise():
    rng = np.random.default_rng(1)
    time = np.linspace(0.0, 1.0, 2000)
    course = 6.0 * time**2 + 0.05 * rng.standard_normal(2000)
    course[::20] += 3.0  # one in twenty is an outlier
    assert white_scatter(course) == pytest.approx(0.05, rel=0.25)
    turning = np.angle(np.exp(1j * course))
    assert white_scatter(turning, circular=True) == pytest.approx(0.05, rel=0.25)
    assert np.isnan(white_scatter(course[:3]))


def test_independent_residuals_are_hardly_inflated():
    rng = np.random.default_rng(2)
    found = [
        correlation_inflation(rng.standard_normal((2, 600)), np.ones((2, 600)), 1)
        for _ in range(50)
    ]
    assert np.median(found) < 1.7
    assert min(found) >= 1.0


@pytest.mark.parametrize("rho", [0.5, 0.9])
def test_correlated_residuals_are_inflated_by_their_power_at_zero_frequency(rho):
    rng = np.random.default_rng(3)
    found = []
    for _ in range(40):
        noise = rng.standard_normal(1200)
        series = np.empty(1200)
        series[0] = noise[0]
        for k in range(1, 1200):
            series[k] = rho * series[k - 1] + np.sqrt(1 - rho**2) * noise[k]
        found.append(correlation_inflation(series[None], np.ones((1, 1200)), 1))
    # nothing was fitted here, so the share of a fit, a factor 1.5, is too much
    assert 0.9 < np.mean(found) / ((1 + rho) / (1 - rho)) < 1.9


def test_lines_that_wander_together_are_not_independent():
    rng = np.random.default_rng(4)
    shared = np.repeat(rng.standard_normal((1, 800)), 5, axis=0)
    assert correlation_inflation(shared, np.ones((5, 800)), 0) > 4.0


@pytest.mark.parametrize("loss", LOSSES)
def test_weights_and_curvatures_are_the_derivatives_of_the_losses(loss):
    z = np.array([-9.0, -3.0, -1.0, -0.2, 0.3, 1.2, 2.0, 4.0, 8.0])
    step = 1e-5
    high, low = loss_value(z + step, loss), loss_value(z - step, loss)
    slope = (high - low) / (2.0 * step)
    assert np.allclose(loss_weight(z, loss) * z, slope / 2.0, atol=1e-6)
    pull_high = loss_weight(z + step, loss) * (z + step)
    pull_low = loss_weight(z - step, loss) * (z - step)
    bend = (pull_high - pull_low) / (2.0 * step)
    assert np.allclose(loss_curvature(z, loss), bend, atol=1e-5)
    near = 1e-3
    assert loss_value(np.array([near]), loss)[0] == pytest.approx(near**2, rel=1e-3)
