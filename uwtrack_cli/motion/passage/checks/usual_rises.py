"""Whether a rise of the level stands out from what its parts of the band do all the time.

**Method.** A stretch of seconds cannot tell swell from a passage: a crest of it has the
shape, and a gust below some frequency lets the parts of the band rise by different
amounts, as a passage does. Another crest follows, though. So each part of the band is
measured against itself over the whole recording: the mean level within d/v of the rise,
less that of the louder of both sides, is compared with the same at every other instant.
A part stands out where it rises by more than a stated factor times what one instant in
twenty exceeds. A passage stands out in as many parts as must rise for the level alone
to make one.

**Conventions.** Levels in dB over the quiet time; times count from the first sample.

**References.** Rohling (1983), IEEE Trans. Aerosp. Electron. Syst. 19, 608: a threshold
from order statistics of the neighbours.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.motion.alternatives import ENOUGH_SUB_BANDS

FLANK = (3.0, 5.0)
"""Where the sides of a rise begin and end, in d/v from its middle."""

USUAL = 0.95
"""Share of the other instants that rise by less than what is usual."""

FACTOR = 2.0
"""What a rise must exceed the usual by. The crests of a swell of one height lie 1.1 to
1.4 times above what one instant in twenty exceeds, before gusts and noise."""

FEWEST_LENGTHS = 10
"""Transients with their sides that the rest of the recording must hold to say anything."""


def stands_out(levels: Levels, time_s: float, width_s: float) -> bool:
    """Tell whether a rise exceeds what its parts of the band do all the time.

    Parameters
    ----------
    levels
        Levels of the whole recording.
    time_s
        When the rise is highest, s from the first sample.
    width_s
        Its d/v, s.

    Returns
    -------
    bool
        True, too, where the recording is too short to know what is usual, and of an
        older product without parts.
    """
    if levels.part_excess_db is None or levels.frames.n_frames < 2:
        return True
    lag = np.abs(levels.frames.time_s - time_s)
    other = lag > FLANK[1] * width_s
    hop_s = levels.frames.hop_s
    if other.sum() * hop_s < FEWEST_LENGTHS * 2 * FLANK[1] * width_s:
        return True
    before, after = _heights(np.asarray(levels.part_excess_db, float), width_s / hop_s)
    near = lag <= max(0.5 * width_s, hop_s)
    # at an end of the recording one side alone is compared with one side alone
    sides = [side for side in (before, after) if np.isfinite(side[near]).any()]
    if not sides:
        return True
    height = np.min(sides, axis=0)
    usual = np.nanquantile(height[other], USUAL, axis=0)
    own = np.fmax.reduce(height[near], axis=0)
    risen = own > FACTOR * np.maximum(usual, 0.0)
    return bool(np.count_nonzero(risen) >= ENOUGH_SUB_BANDS)


def _heights(level_db: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """Return how far each instant lies above the side before it, and above that after.

    Parameters
    ----------
    level_db
        Levels of the parts, dB, shape (frame, part).
    width
        d/v in frames.

    Returns
    -------
    tuple of arrays, shape (frame, part)
        Heights in dB; nan where too little was heard.
    """
    inner = max(0, round(width))
    near = max(inner + 1, round(FLANK[0] * width))
    far = max(near + 1, round(FLANK[1] * width))
    heard = np.isfinite(level_db)
    zero = np.zeros((1, level_db.shape[1]))
    total = np.concatenate([zero, np.nan_to_num(level_db).cumsum(axis=0)])
    count = np.concatenate([zero, heard.cumsum(axis=0)])
    frame = np.arange(level_db.shape[0])

    def mean(first: int, last: int) -> FloatArray:
        low = np.clip(frame + first, 0, frame.size)
        high = np.clip(frame + last + 1, 0, frame.size)
        size = count[high] - count[low]
        # less than half of a side says little of it
        known = size > 0.5 * (last - first)
        return np.where(known, (total[high] - total[low]) / np.maximum(size, 1.0), np.nan)

    middle = mean(-inner, inner)
    return middle - mean(-far, -near), middle - mean(near, far)
