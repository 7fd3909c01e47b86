"""What may change beside a passage before anything is measured, and what that costs.

**Method.** A change is an unknown with a proper prior, so that readings with and
without it are compared by their evidence. Its scale is not known: its size is uniform
in the logarithm between two bounds (Jaynes 1968), even below the lower one, of either
sign or of any direction, and nothing lies beyond the upper one. The evidence of a
reading is its likelihood times the prior at the fit, times the volume of the posterior
(Laplace's method): the ratio of both is what a change costs (Occam's factor). Where the
posterior reaches beyond the upper bound, only its part within counts.

The bounds are those of vessels and their machinery. Rest frequencies step or drift by
5 % at most: more is another line. A vessel that turns back at the speed it had changes
its velocity by twice that speed, and none changes it by more; speeds themselves are
those of vessels (`VESSEL_MPS`), which the faster of two legs must have.

**Conventions.** Log-likelihoods in nepers; unknowns as in `unknowns`.

**References.** Jaynes (1968), IEEE Trans. Syst. Sci. Cybern. 4, 227 (priors of scales);
MacKay (2003), Information Theory, ch. 28 (Laplace's method, Occam factors); O'Hagan
(1979), J. R. Statist. Soc. B 41, 358 (priors that give way to outliers).
"""

from math import lgamma

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.model.law import SLOWEST_MPS
from uwtrack_cli.motion.passage.model.unknowns import CHANGED, MANOEUVRE, N_SIZES, RAMP, STEP, TURN

STRAIGHT = "straight"
"""Reading of a passage beside which nothing changes."""

VESSEL_MPS, VESSEL_STD_MPS = 5.5, 3.5
"""Speed of vessels before it is measured, m/s, and its deviation."""

TAIL_FREEDOM = 3.0
"""Degrees of freedom of that prior's tails."""

SPEED_MASS = float(
    0.5 * np.log(np.pi * TAIL_FREEDOM * np.log1p((VESSEL_STD_MPS / VESSEL_MPS) ** 2))
    + lgamma(0.5 * TAIL_FREEDOM) - lgamma(0.5 * (TAIL_FREEDOM + 1))
)  # fmt: skip
"""Logarithm of the integral of `speed_prior`."""

SIZES = {STEP: (1e-4, 5e-2), RAMP: (1e-4, 5e-2), MANOEUVRE: (0.01, 2.0), TURN: (0.02, np.pi)}
"""Bounds of the sizes: share of all rest frequencies, the same at the far end of the
measurements, change of velocity over the speed of the faster leg, and angle of a
steady turn, rad."""

ODDS = {STEP: 3.0, RAMP: 3.0, MANOEUVRE: 3.0, TURN: 3.0}
"""Logarithm of the odds against each change before the measurements: see
studies/constants/readings.py."""


def speed_prior(fit: PassageFit) -> float:
    """Return the logarithm of the prior density of the speed, of the faster leg.

    Parameters
    ----------
    fit
        Fit of one row, straight or with a change.

    Notes
    -----
    Normal in the logarithm near the speeds of vessels, with the long tails of Student's
    distribution of three degrees of freedom: what goes as fast as a car or a satellite
    is still read by its measurements (O'Hagan 1979).
    """
    square = np.log1p((VESSEL_STD_MPS / VESSEL_MPS) ** 2)
    middle = np.log(VESSEL_MPS) - 0.5 * square
    logarithm = np.log(_fastest_mps(fit))
    lag = (logarithm - middle) ** 2 / square
    tail = 0.5 * (TAIL_FREEDOM + 1) * np.log1p(lag / TAIL_FREEDOM)
    return float(-tail - logarithm)


def cost_of_speed(fit: PassageFit) -> float:
    """Return what a measured speed costs: its prior over its posterior density.

    Parameters
    ----------
    fit
        Fit of one row with lines.

    Returns
    -------
    float
        Nepers, zero or more; infinite where the fit does not determine the speed.
    """
    variance = float(fit.covariance[0, 2, 2])
    if not (np.isfinite(variance) and variance > 0):
        return float("inf")
    density = speed_prior(fit) - SPEED_MASS
    return float(max(-density - 0.5 * np.log(2 * np.pi * variance), 0.0))


def cost_of_change(fit: PassageFit, time_s: FloatArray) -> float:
    """Return what a change costs: its odds, and prior over posterior density of its size.

    Parameters
    ----------
    fit
        Fit of one row with a change.
    time_s
        Times of the measurements, s.

    Returns
    -------
    float
        Nepers; infinite where the fit does not determine the size.
    """
    from scipy.special import log_ndtr

    change = fit.change
    if change is None:
        return 0.0
    low, high = SIZES[change.kind]
    count = N_SIZES[change.kind]
    unit = _unit(fit, time_s)
    size = float(np.linalg.norm(fit.theta[0, CHANGED : CHANGED + count])) / unit
    own = fit.full_covariance[0, 5 : 5 + count, 5 : 5 + count] / unit**2
    if not (np.isfinite(own).all() and np.linalg.det(own) > 0):
        return float("inf")
    shell = (2.0, 2.0 * np.pi)[count - 1] * max(size, low) ** count
    prior = -np.log(shell * (np.log(high / low) + 1 / count))
    volume = 0.5 * (count * np.log(2 * np.pi) + np.linalg.slogdet(own)[1])
    spread = float(np.sqrt(np.linalg.eigvalsh(own)[-1]))
    within = float(log_ndtr((high - size) / spread))
    return float(ODDS[change.kind] + max(-prior - volume, 0.0) - within)


def _unit(fit: PassageFit, time_s: FloatArray) -> float:
    """Return what the size of a change is measured by."""
    change = fit.change
    if change is not None and change.kind == MANOEUVRE:
        return _fastest_mps(fit)
    if change is not None and change.kind == RAMP:
        end = time_s[-1] if change.sign[0] > 0 else time_s[0]
        return 1 / max(abs(float(end - change.time_s[0])), 1e-9)
    return 1.0


def _fastest_mps(fit: PassageFit) -> float:
    """Return the speed of the faster leg, m/s."""
    speed = abs(float(fit.theta[0, 2]))
    if fit.change is not None and fit.change.kind == MANOEUVRE:
        more, away = fit.theta[0, CHANGED : CHANGED + 2]
        speed = max(speed, float(np.hypot(speed + more, away)))
    return max(speed, SLOWEST_MPS)
