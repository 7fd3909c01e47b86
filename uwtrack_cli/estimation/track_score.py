"""The score of a track, when it is given up, and a test for the loss of its target.

**Method.** The score adds up how much likelier each scan is with the target than with
clutter alone. While the target is followed it rises; after a loss it stands still or
falls. Page's test sums the shortfall against half a unit per scan and starts afresh
whenever the score does better.

**References.** Sittler (1964); Page (1954); Blackman and Popoli (1999), section 6.2.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray

LEAST_RISE = 0.5
"""Rise per scan that a track must show: between the -0.2 to -3 after a loss and the 1.4
to 5 of kept tracks, in the scenes of the clutter study."""

DISMISSED = -2.0
"""Score, in nepers, at which what may become a track is given up."""


def shortfall(statistic: FloatArray, log_likelihood_ratio: FloatArray) -> FloatArray:
    """Return the statistic of the test for a loss after one more scan.

    Notes
    -----
    C(k) = max(0, C(k-1) + 1/2 - LLR(k)), C(0) = 0 (Page 1954).
    """
    return np.maximum(statistic + LEAST_RISE - log_likelihood_ratio, 0.0)


def track_score(log_likelihood_ratio: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the score after each scan and the statistic of the test for a loss.

    Of ln p(scan | target) - ln p(scan | clutter alone), ``(scan, ...)``. The statistic
    is that of `shortfall`; 10 flags most lost tracks within twenty scans and few others.

    Examples
    --------
    >>> track_score(np.array([4.0, -2.0, -2.0]))[1].tolist()
    [0.0, 2.5, 5.0]
    """
    score: FloatArray = np.cumsum(log_likelihood_ratio, axis=0)
    walk = np.cumsum(log_likelihood_ratio - LEAST_RISE, axis=0)
    best = np.maximum.accumulate(np.maximum(walk, 0.0), axis=0)
    return score, best - walk
