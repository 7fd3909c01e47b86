"""What speaks against a passage of lines: it is too fast for water, or it is mains hum.

**Method.** Calls of animals and sweeps have lines that fall as those of a passage would
whose speed no vessel has; so has sound in air that is read with the speed of sound in
water. And the frequency of mains wanders by less than 1e-3:
lines that are multiples of it and stay that near to them all the time are hum, whatever
shape their wander has. A vessel with a generator of the same frequency shifts its lines by
more, unless it hardly moves.

**Conventions.** Frequencies in Hz; chance is the probability that lines of a vessel, which may
lie anywhere between two multiples, are all that near to one.
"""

from collections.abc import Sequence

import numpy as np

from uwtrack_cli.constants import MAINS_HZ, MAINS_REACH_HZ, MAINS_TOLERANCE
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import MAINS, TOO_FAST
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.motion.decision import reject
from uwtrack_cli.motion.passage.candidates import CandidatePassage
from uwtrack_cli.motion.passage.encounter_rows import SMALLEST_SPEED_DEVIATIONS

FASTEST_MPS = 100.0
"""Speed that nothing in water has: one that is told must not lie above, however large its
deviation, which grows with the speed where a line of noise is followed."""

SHARE = 0.95
"""Share of the points of a line that must lie within it."""

GREATEST_CHANCE = 1e-3
"""Chance from which lines are not taken for mains."""


def check_known_sounds(item: CandidatePassage, lines: Lines | None) -> CandidatePassage:
    """Return a passage of lines, rejected where it is faster than vessels, or is hum.

    Parameters
    ----------
    item
        A significant fit.
    lines
        The tracked lines of its recording; None for a table.
    """
    fit = item.fit
    if item.rejections or item.blocks.shift.is_empty:
        return item
    speed, deviation = float(fit.theta[0, 2]), float(np.sqrt(fit.covariance[0, 2, 2]))
    is_told = speed > SMALLEST_SPEED_DEVIATIONS * deviation
    if fit.medium.is_water and is_told and speed > FASTEST_MPS:
        return item.rejected(reject(TOO_FAST, speed_mps=speed))
    if lines is None:
        return item
    mains_hz = mains_of([lines.frequency_hz[lines.line == n] for n in item.line_ids])
    if mains_hz is None:
        return item
    return item.rejected(reject(MAINS, mains_hz=mains_hz))


def mains_of(lines_hz: Sequence[FloatArray]) -> float | None:
    """Return the frequency of mains that all lines are multiples of, Hz.

    Parameters
    ----------
    lines_hz
        Frequencies of each line, each of shape (points,).

    Returns
    -------
    float | None
        None where a line is none, or all of them may be near by chance.
    """
    for mains_hz in MAINS_HZ:
        near = [np.abs(_off_mains(line, mains_hz)) <= _reach(line) for line in lines_hz]
        if min((float(one.mean()) for one in near if one.size), default=0.0) < SHARE:
            continue
        middle = np.array([np.median(line) for line in lines_hz if line.size])
        chance = np.minimum(2.0 * _reach(middle) / mains_hz, 1.0)
        if len(MAINS_HZ) * float(chance.prod()) < GREATEST_CHANCE:
            return mains_hz
    return None


def _off_mains(frequency_hz: FloatArray, mains_hz: float) -> FloatArray:
    """Return the distance from the next multiple of mains, Hz."""
    order = np.maximum(np.rint(frequency_hz / mains_hz), 1.0)
    return np.asarray(frequency_hz - order * mains_hz)


def _reach(frequency_hz: FloatArray) -> FloatArray:
    """Return how far a line of mains may be off, Hz."""
    return np.asarray(MAINS_TOLERANCE * frequency_hz + MAINS_REACH_HZ)
