"""Whether lines are mains hum.

**Method.** The frequency of mains wanders by less than 1e-3: lines that are multiples of it
and stay that near to them all the time are hum, whatever shape their wander has. A vessel
with a generator of the same frequency shifts its lines by more, unless it hardly moves.

**Conventions.** Frequencies in Hz; chance is the probability that lines of a vessel, which may
lie anywhere between two multiples, are all that near to one.
"""

from collections.abc import Sequence

import numpy as np

from uwtrack_cli.constants import MAINS_HZ, MAINS_REACH_HZ, MAINS_TOLERANCE
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.motion.passage.candidates import CandidatePassage

SHARE = 0.95
"""Share of the points of a line that must lie within it."""


def check_known_sounds(item: CandidatePassage, lines: Lines | None) -> CandidatePassage:
    """Return a passage of lines with the chance that they are mains.

    Parameters
    ----------
    item
        A significant fit.
    lines
        The tracked lines of its recording; None for a table.
    """
    if lines is None or item.blocks.shift.is_empty:
        return item
    found = mains_of([lines.frequency_hz[lines.line == n] for n in item.line_ids])
    if found is None:
        return item
    mains_hz, chance = found
    return item.measured(mains_hz=mains_hz, mains=float(np.log(max(chance, 1e-300))))


def mains_of(lines_hz: Sequence[FloatArray]) -> tuple[float, float] | None:
    """Return the mains that all lines are multiples of, Hz, and the chance of that.

    Parameters
    ----------
    lines_hz
        Frequencies of each line, each of shape (points,).

    Returns
    -------
    tuple[float, float] | None
        None where a line is none.
    """
    for mains_hz in MAINS_HZ:
        near = [np.abs(_off_mains(line, mains_hz)) <= _reach(line) for line in lines_hz]
        if min((float(one.mean()) for one in near if one.size), default=0.0) < SHARE:
            continue
        middle = np.array([np.median(line) for line in lines_hz if line.size])
        chance = np.minimum(2.0 * _reach(middle) / mains_hz, 1.0)
        return mains_hz, min(len(MAINS_HZ) * float(chance.prod()), 1.0)
    return None


def _off_mains(frequency_hz: FloatArray, mains_hz: float) -> FloatArray:
    """Return the distance from the next multiple of mains, Hz."""
    order = np.maximum(np.rint(frequency_hz / mains_hz), 1.0)
    return np.asarray(frequency_hz - order * mains_hz)


def _reach(frequency_hz: FloatArray) -> FloatArray:
    """Return how far a line of mains may be off, Hz."""
    return np.asarray(MAINS_TOLERANCE * frequency_hz + MAINS_REACH_HZ)
