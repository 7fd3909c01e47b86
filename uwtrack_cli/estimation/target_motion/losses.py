"""Losses of a standardised residual: least squares and three robust ones.

**Conventions.** Every loss is z^2 near zero, so that the sums compare. Tuning
constants give 95 % efficiency on Gaussian noise (Huber 1981; Beaton & Tukey 1974);
Student's t has four degrees of freedom (Lange et al. 1989).
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.target_motion.problem import Loss

HUBER, TUKEY, STUDENT = 1.345, 4.685, 4.0


def loss_value(z: FloatArray, loss: Loss) -> FloatArray:
    """Return the loss of standardised residuals, element by element.

    Parameters
    ----------
    z
        Residuals divided by their standard deviations.
    loss
        Which loss.
    """
    if loss == "huber":
        size = np.abs(z)
        return np.where(size <= HUBER, z * z, HUBER * (2.0 * size - HUBER))
    if loss == "student":
        return np.asarray(STUDENT * np.log1p(z * z / STUDENT))
    if loss == "tukey":
        rest = np.clip(1.0 - (z / TUKEY) ** 2, 0.0, None)
        return np.asarray(TUKEY**2 / 3.0 * (1.0 - rest**3))
    return z * z


def loss_weight(z: FloatArray, loss: Loss) -> FloatArray:
    """Return the weight of a residual, half the slope of its loss over itself."""
    if loss == "huber":
        return np.asarray(HUBER / np.maximum(np.abs(z), HUBER))
    if loss == "student":
        return STUDENT / (STUDENT + z * z)
    if loss == "tukey":
        return np.asarray(np.clip(1.0 - (z / TUKEY) ** 2, 0.0, None) ** 2)
    return np.ones_like(z)


def loss_curvature(z: FloatArray, loss: Loss) -> FloatArray:
    """Return half the second derivative of the loss."""
    if loss == "huber":
        return np.where(np.abs(z) <= HUBER, 1.0, 0.0)
    if loss == "student":
        return STUDENT * (STUDENT - z * z) / (STUDENT + z * z) ** 2
    if loss == "tukey":
        ratio = (z / TUKEY) ** 2
        return np.where(ratio < 1.0, (1.0 - ratio) * (1.0 - 5.0 * ratio), 0.0)
    return np.ones_like(z)
