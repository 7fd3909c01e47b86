"""The operating curve of a detector: detection probability by false alarm rate.

**Method.** Noise amplitudes are Rayleigh distributed with unit deviation per quadrature,
so that the threshold is ``tau = sqrt(-2 ln P_F)``. Three targets are known, and any
detector may be given as a measured table.

**Conventions.** The signal-to-noise ratio is ``A^2 / (2 sigma^2)`` as a power ratio.

**References.** Choi, Kim and Hong (2001), section IV and Fig. 1; Richards (2005) for the
fluctuating and the steady target.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import FloatArray

TargetModel = Literal["fluctuating", "gaussian", "steady"]
"""How a target's amplitude behaves: Rayleigh, Gaussian around A, or Rician."""


@dataclass(frozen=True)
class OperatingCurve:
    """Detection probability and threshold as functions of the false alarm rate."""

    detection: Callable[[FloatArray], FloatArray]
    """The detection probability at a false alarm probability."""
    threshold: Callable[[FloatArray], FloatArray]
    """The threshold on the amplitude at a false alarm probability."""
    false_alarm: Callable[[FloatArray], FloatArray]
    """The false alarm probability of a threshold."""
    limits: tuple[float, float] = (0.0, 1.0)
    """False alarm probabilities between which the curve is known."""


@lru_cache(maxsize=16)
def model_curve(model: TargetModel, signal_to_noise: float) -> OperatingCurve:
    """Return the curve of a target model at a power ratio d = A^2 / (2 sigma^2).

    Notes
    -----
    fluctuating: P_D = P_F^(1/(1+d)); gaussian: P_D = Q(tau - A), the paper's Fig. 1;
    steady: P_D = Q_1(A, tau), Marcum's function; A = sqrt(2 d).

    Examples
    --------
    >>> curve = model_curve("gaussian", 4.5)
    >>> round(float(curve.detection(np.array(0.01))), 5)
    0.4861
    """
    shift = math.sqrt(2.0 * signal_to_noise)

    def fluctuating(probability: FloatArray) -> FloatArray:
        found: FloatArray = np.power(probability, 1.0 / (1.0 + signal_to_noise))
        return found

    def gaussian(probability: FloatArray) -> FloatArray:
        from scipy.special import ndtr

        return np.asarray(ndtr(shift - rayleigh_threshold(probability)))

    def steady(probability: FloatArray) -> FloatArray:
        from scipy.special import chndtr

        power = rayleigh_threshold(probability) ** 2
        return np.asarray(1.0 - chndtr(power, 2.0, shift**2))

    detection = {"fluctuating": fluctuating, "gaussian": gaussian, "steady": steady}
    return OperatingCurve(detection[model], rayleigh_threshold, rayleigh_false_alarm)


def measured_curve(
    false_alarm: FloatArray, detection: FloatArray, threshold: FloatArray
) -> OperatingCurve:
    """Return the curve of a table, linear over the logarithm of the false alarm rate.

    False alarm probabilities ascend strictly, detection probabilities do not descend,
    thresholds descend strictly; all nan for Rayleigh noise amplitudes.
    """
    logarithm = np.log(false_alarm)

    def interpolate(values: FloatArray) -> Callable[[FloatArray], FloatArray]:
        return lambda p: np.asarray(np.interp(np.log(p), logarithm, values))

    limits = (float(false_alarm[0]), float(false_alarm[-1]))
    if np.isnan(threshold).any():
        return OperatingCurve(
            interpolate(detection), rayleigh_threshold, rayleigh_false_alarm, limits
        )

    def inverse(tau: FloatArray) -> FloatArray:
        found: FloatArray = np.exp(np.interp(tau, threshold[::-1], logarithm[::-1]))
        return found

    return OperatingCurve(interpolate(detection), interpolate(threshold), inverse, limits)


def constant_curve(detection: float) -> OperatingCurve:
    """Return a curve whose detection probability is known at one point only."""

    def always(probability: FloatArray) -> FloatArray:
        return np.full(np.shape(probability), detection)

    return OperatingCurve(always, rayleigh_threshold, rayleigh_false_alarm)


def rayleigh_threshold(false_alarm_probability: FloatArray) -> FloatArray:
    """Return the amplitude that noise exceeds with a given probability."""
    threshold: FloatArray = np.sqrt(-2.0 * np.log(false_alarm_probability))
    return threshold


def rayleigh_false_alarm(threshold: FloatArray) -> FloatArray:
    """Return the probability that a noise amplitude exceeds a threshold."""
    probability: FloatArray = np.exp(-0.5 * np.square(threshold))
    return probability
