"""When a line is believed and when it is given up: counts and scores.

**Method.** Two logics. *Count*: M hits in a true sliding window of N frames, the
hits of each line kept as the bits of one integer. *Score*: the cumulative
logarithm of the likelihood ratio "line" against "noise", with the amplitude of a
steady line in Gaussian noise. By Wald's inequality noise alone reaches a score T
with a probability of at most exp(-T), which sets the threshold without calibration.

**Conventions.** The youngest frame is the lowest bit. ``power_ratio`` is the power
of a cell over the noise in it, linear.

**References.** Wald, "Sequential Analysis" (1947); Blackman & Popoli, "Design and
Analysis of Modern Tracking Systems" (1999), section 6.2; Rice (1945) for the
amplitude.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray

LONGEST_WINDOW = 63
"""Most frames that a sliding window may have."""


def push_hits(history: IntArray, is_hit: BoolArray) -> IntArray:
    """Shift every history by one frame and write the newest hit or miss."""
    return (history << 1) | is_hit


def count_hits(history: IntArray, window: IntArray | int) -> IntArray:
    """Count the hits of the last ``window`` frames of every history.

    Examples
    --------
    >>> count_hits(np.array([0b10110, 0b11111]), np.array([3, 5])).tolist()
    [2, 5]
    """
    one = np.uint64(1)
    mask = (one << np.asarray(window, dtype=np.uint64)) - one
    return _count_bits(history.astype(np.uint64) & mask)


def _count_bits(words: IntArray) -> IntArray:
    # the classic sum by halves; numpy has bitwise_count only from 2.0 on
    u = np.uint64
    words = words - ((words >> u(1)) & u(0x5555555555555555))
    words = (words & u(0x3333333333333333)) + ((words >> u(2)) & u(0x3333333333333333))
    words = (words + (words >> u(4))) & u(0x0F0F0F0F0F0F0F0F)
    words = words + (words >> u(8))
    words = words + (words >> u(16))
    words = words + (words >> u(32))
    return (words & u(0x7F)).astype(np.int64)


def amplitude_log_ratio(
    power_ratio: FloatArray, design_snr: float | FloatArray
) -> FloatArray:
    """Logarithm of the amplitude's likelihood, steady line against noise.

    Parameters
    ----------
    power_ratio
        Power of the cell over the noise in it, linear.
    design_snr
        Power of the line looked for over the noise in its cell, linear.

    Notes
    -----
    ln I0(2 sqrt(d y)) - d for a line of power ratio d and a cell of ratio y.
    """
    from scipy.special import i0e

    argument = 2.0 * np.sqrt(design_snr * np.maximum(power_ratio, 0.0))
    return np.log(i0e(argument)) + argument - design_snr


def detection_probability(threshold: float, design_snr: float) -> float:
    """Probability that a steady line's cell exceeds a power ratio.

    Notes
    -----
    Marcum's Q1(sqrt(2 d), sqrt(2 threshold)), through the noncentral chi-square.
    """
    from scipy.stats import ncx2

    return float(ncx2.sf(2.0 * threshold, 2, 2.0 * design_snr))
