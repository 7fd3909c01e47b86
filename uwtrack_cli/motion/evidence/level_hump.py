"""Whether a level rises and falls with the range, or follows the speed of an engine.

**Method.** An engine in place that slows down shifts its sound as a passage does, and its
level changes with its speed; that of a vehicle rises and falls about the closest approach.
Mean levels of quarters of R/v are fitted by least squares: as the power of the vehicle, which
falls with the square of the range and may be louder ahead or astern, over the rest of the
sound; as a level that is linear in the shift of frequency; and as one that drifts. The evidence is half the number of means times the
logarithm of the ratio of the squares that are left, what fading does to a mean included.

**Conventions.** Times count from the first sample. Nepers, positive for the passage.

**References.** Gelman et al. (2013), Bayesian Data Analysis, ch. 14, for the ratio.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.spectra import Levels

REACH, BLOCK = 3.0, 0.25
"""R/v on either side that are taken, and of a mean."""

FADING_DB = 1.5
"""Scatter of a mean by directions, ground and load, dB."""

FLOORS = 10.0 ** np.arange(-3.0, 0.51, 0.25)
"""Power of the rest of the sound, over the vehicle's at its closest."""

FEWEST_MEANS = 8
"""Means without which nothing is said."""


def level_hump(levels: Levels, time_s: float, width_s: float) -> float:
    """Return the log evidence that the level goes with the range of a passage.

    Parameters
    ----------
    levels
        Levels of the sound.
    time_s, width_s
        Closest approach, as it is heard, and R/v, s.

    Returns
    -------
    float
        Nepers; nan where too little was measured.
    """
    lag = (levels.frames.time_s - time_s) / width_s
    known = (np.abs(lag) < REACH) & np.isfinite(levels.excess_db)
    cell = np.floor(lag[known] / BLOCK).astype(int)
    _, place = np.unique(cell, return_inverse=True)
    count = np.bincount(place)
    if count.size < FEWEST_MEANS:
        return float("nan")
    mean_db = np.bincount(place, levels.excess_db[known]) / count
    middle = np.bincount(place, lag[known]) / count
    shift = middle / np.hypot(1.0, middle)
    rise_db = 10.0 * np.log10(1.0 / (1.0 + middle**2) + FLOORS[:, None])
    rises = [_left(mean_db - one, shift) for one in rise_db]
    other = min(_left(mean_db, shift), _left(mean_db, middle))
    floor = count.size * FADING_DB**2
    return float(0.5 * count.size * np.log((other + floor) / (min(rises) + floor)))


def _left(level_db: FloatArray, course: FloatArray) -> float:
    """Return the squares that a course times any factor leaves of levels."""
    own, left = course - course.mean(), level_db - level_db.mean()
    left = left - own * float(own @ left) / max(float(own @ own), 1e-12)
    return float(left @ left)
