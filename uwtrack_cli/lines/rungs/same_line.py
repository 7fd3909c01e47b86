"""When lines, and families of lines, that different trackers found are one.

**Method.** Lines are one within the coarser resolution, families that share lines where
their spacings agree. What a line is worth is its evidence against noise.

**Conventions.** The resolution of a line is the reciprocal of its frames' length, Hz; of
two, the coarser one decides what can be told apart.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray

SAME_LINE = 0.6
"""Distance of two lines that are one, in the coarser resolution."""

SAME_SPACING = 0.01
"""Relative difference of two spacings, or of their small multiples, that are one."""

MOST_RATIO = 4
"""Greatest whole number in the ratio of two spacings of one family."""


def line_evidence(n_frames: FloatArray, ratio: FloatArray | float, choice: float) -> FloatArray:
    """Return the evidence of a line against noise, nepers; none is less than zero.

    Of independent frames that it lasts, its mean power over noise in its cell, and the
    evidence in each frame that comes of choosing where the line is.

    Notes
    -----
    The likelihood ratio of n exponential powers of mean 1 + s against mean 1 is
    n (s - ln(1 + s)), less what was chosen.
    """
    gain = ratio - np.log1p(ratio) - choice
    return np.asarray(n_frames * np.maximum(gain, 0.0))


def is_one_family(spacings_hz: tuple[float, float], one: IntArray, two: IntArray) -> bool:
    """Tell whether families are one: they share lines, and their spacings agree.

    Examples
    --------
    >>> is_one_family((5.0, 10.0), np.arange(6), np.arange(0, 6, 2))
    True
    >>> is_one_family((5.0, 7.1), np.arange(6), np.arange(0, 6, 2))
    False
    """
    shared = np.intersect1d(one, two).size
    if shared < min(2, one.size, two.size):
        return False
    ratio = spacings_hz[0] / spacings_hz[1]
    return any(
        abs(ratio * q / p - 1.0) < SAME_SPACING
        for p in range(1, MOST_RATIO + 1)
        for q in range(1, MOST_RATIO + 1)
    )
