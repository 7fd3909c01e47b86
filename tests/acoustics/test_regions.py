"""The 95 % region of a place, against chi-square, and what it is made of."""

import numpy as np
import pytest
from scipy.stats import chi2

from uwtrack_cli.acoustics.geometry import compass_unit, place_covariance, region_95


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_region_holds_95_percent_and_runs_against_the_clock(sign):
    covariance = np.array([[900.0, sign * 400.0], [sign * 400.0, 400.0]])
    ring = region_95(covariance)
    assert ring[:, 0] == pytest.approx(ring[:, -1])
    unit = np.linalg.solve(np.linalg.cholesky(covariance), ring)
    steps = np.hypot(*np.diff(unit, axis=1))
    assert steps == pytest.approx(steps[0])  # corners all the way round
    squares = np.einsum("ji,jk,ki->i", ring, np.linalg.inv(covariance), ring)
    assert squares == pytest.approx(chi2.ppf(0.95, 2))
    x, y = ring
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0.0


def test_the_covariance_of_a_place_is_that_of_drawn_ranges_and_bearings():
    polar = np.array([[400.0, 3.0], [3.0, 0.09]])
    rng = np.random.default_rng(1)
    off_m, off_deg = rng.multivariate_normal([0.0, 0.0], polar, 100_000).T
    places = (3000.0 + off_m)[:, None] * compass_unit(200.0 + off_deg)
    expected = place_covariance(3000.0, 200.0, polar)
    np.testing.assert_allclose(np.cov(places.T), expected, rtol=0.03, atol=5.0)
