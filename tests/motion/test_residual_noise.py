"""Weights of rows of measurements, from their residuals."""

from types import SimpleNamespace

import numpy as np

from uwtrack_cli.motion.passage.fit.residual_noise import rough_weight


def test_a_row_of_one_measurement_keeps_its_nominal_weight():
    """Its own rest frequency takes up all of it: a residual of zero is no accuracy."""
    rng = np.random.default_rng(1)
    nominal = np.full((1, 2, 2000), 4.0)
    nominal[0, 1, 1:] = 0.0
    residual = np.zeros((1, 2, 2000))
    residual[0, 0] = 3.0 * 0.5 * rng.standard_normal(2000)
    weight = rough_weight(residual, SimpleNamespace(weight=nominal))
    assert weight[0, 1, 0] == 4.0
    # many measurements tell that they scatter by three times what was stated
    assert abs(np.median(weight[0, 0]) - 4.0 / 9.0) < 0.1 * 4.0 / 9.0
