"""Straight courses at the ends and beside the crossings of paths.

**Method.** The likeliest path knows no rate: where two lines cross it goes on along
either, and where a line falls silent it says nothing of where the line will be. So
straight lines are fitted to what was measured on either side: they tell which of two
lines that came together is which (`meetings`), and, extrapolated from the end of a path,
whether a later one continues it.

**Conventions.** A course is taken over as many frames as it is straight for, at most
`COURSE_FRAMES`. Costs are in nepers.

**References.** Bar-Shalom, Li & Kirubarajan (2001), section 3.4 (least squares);
Holland & Welsch (1977), Commun. Stat. A6, 813-827 (Cauchy's weights, iterated).
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.kalman import KalmanState

COURSE_FRAMES = 40
"""Most frames of a course."""

FEWEST_FRAMES = 8
"""Fewest frames of a course."""

FAR = 3.0
"""Deviations beyond which a frame is far from a course."""

MOST_FAR = 0.2
"""Share of frames that may be far from a straight course: those after its end are noise's."""

_FITS = 6
"""Fits with weights from the residuals of the one before."""


def fit_course(
    time_s: FloatArray, frequency_hz: FloatArray, variance: FloatArray, at_s: float
) -> KalmanState | None:
    """Fit a straight course to the frames nearest to a time; None if too few are.

    Frequencies in Hz, rates in Hz/s; entries are single values.

    Times, s, lie all on one side of ``at_s``, nearest first; the variance, Hz^2, is inf
    where nothing was measured.
    """
    known = np.flatnonzero(np.isfinite(variance) & np.isfinite(frequency_hz))
    n_used = min(known.size, COURSE_FRAMES)
    if n_used < FEWEST_FRAMES:
        return None
    while True:
        use = known[:n_used]
        course, is_far = _robust_fit(time_s[use] - at_s, frequency_hz[use], 1.0 / variance[use])
        shorter = max(n_used // 2, FEWEST_FRAMES)
        if is_far.mean() <= MOST_FAR or shorter == n_used:
            return course
        n_used = shorter


def _robust_fit(
    time_s: FloatArray, frequency_hz: FloatArray, weight: FloatArray
) -> tuple[KalmanState, BoolArray]:
    """Fit a straight line by iterated weights, and tell which frames are far from it."""
    design = np.stack([np.ones(time_s.size), time_s], axis=1)
    share = np.ones(time_s.size)
    for _ in range(_FITS):
        used = share * weight
        covariance = np.linalg.inv(design.T @ (used[:, None] * design))
        value = covariance @ (design.T @ (used * frequency_hz))
        square = weight * (frequency_hz - design @ value) ** 2
        share = 1.0 / (1.0 + square / FAR**2)
    excess = float((share * square).sum()) / (time_s.size - 2)
    covariance *= max(excess, 1.0)
    return KalmanState(*value, *covariance[[0, 0, 1], [0, 1, 1]]), square > FAR**2
