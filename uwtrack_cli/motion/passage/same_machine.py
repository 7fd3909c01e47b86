"""Contacts that are one machine: teeth of one comb, or lines in another gear.

**Method.** A tracker makes several contacts of one vessel where some lines are heard for
a shorter time than others, or where all of them jump as the gear changes. Two marks of a
machine tell so. *Comb*: the rest frequencies of one contact are multiples of a spacing
that the other's lines have in common; the chance that those of a stranger are is the
product, over its lines, of twice their reach over the spacing. *Gear*: one contact ends
within seconds of the other's beginning, and two lines or more, the greater part of the
smaller contact, go on with one ratio of frequencies. Two machines with harmonics that
follow each other do so, too: the mark says which contacts may be one, and a passage that
both show together says whether they are.

**Conventions.** Frequencies in Hz, times count from the first sample.

**References.** Desolneux, Moisan & Morel (2008), "From Gestalt Theory to Image Analysis",
for the number of false alarms.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.motion.passage.model.measurements import lines_of

GREATEST_CHANCE = 1e-3
"""Expected number of combs as good by chance, beyond which there is none."""

MOST_ORDER = 8
"""Greatest order of the lowest line of a comb."""

FEWEST_TEETH = 3
"""Lines that tell a spacing."""

REACH_SIGMAS = 3.0
"""Deviations of a rest frequency within which it is a tooth."""

SMALLEST_REACH = 1e-3
"""Reach that is assumed at least, as a share of the frequency: a third of the Doppler
shift of a slow vessel, which a contact that is heard for a part of the passage may miss."""

LONGEST_PAUSE_S = 15.0
"""Time between the lines of two gears, s: engines rev for some seconds."""

LARGEST_OVERLAP = 2.0
"""Frames by which lines are followed beyond their end."""

GREATEST_RATIO = 1.5
"""Greatest change of the rate of a shaft from gear to gear."""

FEWEST_PAIRS, LEAST_SHARE = 2, 0.6
"""Lines, and share of those of the smaller contact, that must go on with one ratio."""

LINE_REACH = 0.5
"""Distance from its place within which a line goes on, in resolutions."""

END_POINTS = 10
"""Measurements of a line that tell its frequency at either end."""


def is_of_comb(
    comb_hz: FloatArray, comb_std_hz: FloatArray, own_hz: FloatArray, own_std_hz: FloatArray
) -> bool:
    """Tell whether rest frequencies are teeth of the comb that others make.

    Parameters
    ----------
    comb_hz, comb_std_hz
        Rest frequencies that may have a spacing in common, with deviations, shape (line,).
    own_hz, own_std_hz
        Those that are asked about, shape (other,).

    Examples
    --------
    >>> std = np.full(3, 0.01)
    >>> is_of_comb(np.array([80.0, 200.0, 240.0]), std, np.array([120.0, 160.01]), std[:2])
    True
    >>> is_of_comb(np.array([80.0, 200.0, 240.0]), std, np.array([120.0, 171.0]), std[:2])
    False
    """
    if comb_hz.size < FEWEST_TEETH or not own_hz.size:
        return False
    reach_hz = _reach(comb_hz, comb_std_hz)
    for order in range(1, MOST_ORDER + 1):
        teeth = np.rint(comb_hz * order / comb_hz.min())
        spacing_hz = float((teeth * comb_hz).sum() / (teeth**2).sum())
        if not (np.abs(comb_hz - teeth * spacing_hz) < reach_hz).all():
            continue
        chance = order * np.sort(2 * reach_hz / spacing_hz)[1:].prod()
        if chance > GREATEST_CHANCE:
            return False
        own_reach_hz = _reach(own_hz, own_std_hz)
        off_hz = np.abs(own_hz - np.rint(own_hz / spacing_hz) * spacing_hz)
        alike = float((2 * own_reach_hz / spacing_hz).prod()) < GREATEST_CHANCE
        return bool(alike and (off_hz < own_reach_hz).all())
    return False


def _reach(frequency_hz: FloatArray, std_hz: FloatArray) -> FloatArray:
    reach: FloatArray = np.hypot(
        REACH_SIGMAS * np.nan_to_num(std_hz), SMALLEST_REACH * frequency_hz
    )
    return reach


class ContactEnds(NamedTuple):
    """Where the lines of a contact begin and end; arrays of shape (line,)."""

    first_s: FloatArray
    """First measurement, s."""
    last_s: FloatArray
    """Last measurement, s."""
    first_hz: FloatArray
    """Frequency at the begin, Hz."""
    last_hz: FloatArray
    """Frequency at the end, Hz."""


def contact_ends(lines: Lines, contacts: Sequence[int]) -> dict[int, ContactEnds]:
    """Return where the lines of contacts begin and end, but for the shortest.

    Parameters
    ----------
    lines
        Tracked lines.
    contacts
        Contact numbers.
    """
    order = np.argsort(lines.line, kind="stable")
    number = lines.line[order]
    found = {}
    for contact in contacts:
        ends = []
        for line in lines_of(lines, (contact,)):
            points = order[slice(*np.searchsorted(number, (line, line + 1)))]
            frequency = np.asarray(lines.measured_frequency_hz[points], float)
            known = np.isfinite(frequency)
            if np.count_nonzero(known) < END_POINTS:
                continue
            time, frequency = np.asarray(lines.time_s[points])[known], frequency[known]
            begin, end = frequency[:END_POINTS], frequency[-END_POINTS:]
            ends.append((time[0], time[-1], np.median(begin), np.median(end)))
        found[contact] = ContactEnds(*np.array(ends, float).reshape(-1, 4).T)
    return found


def is_next_gear(before: ContactEnds, after: ContactEnds, window_s: float) -> bool:
    """Tell whether the lines of a contact go on as another's, all by one ratio.

    Parameters
    ----------
    before, after
        The ends of the one's lines, and of the other's.
    window_s
        Length of the frames that they were tracked in, s.
    """
    if min(before.last_s.size, after.last_s.size) < FEWEST_PAIRS:
        return False
    last_s, first_s = np.median(before.last_s), np.median(after.first_s)
    overlap_s = LARGEST_OVERLAP * window_s
    if not -overlap_s < first_s - last_s < LONGEST_PAUSE_S + overlap_s:
        return False
    old_hz = before.last_hz[np.abs(before.last_s - last_s) < LONGEST_PAUSE_S]
    new_hz = after.first_hz[np.abs(after.first_s - first_s) < LONGEST_PAUSE_S]
    if min(old_hz.size, new_hz.size) < FEWEST_PAIRS:
        return False
    reach_hz = LINE_REACH / window_s + SMALLEST_REACH * new_hz
    ratios = np.unique(new_hz / old_hz[:, None])
    tried = ratios[(ratios < GREATEST_RATIO) & (ratios > 1 / GREATEST_RATIO)]
    needed = max(FEWEST_PAIRS, LEAST_SHARE * min(old_hz.size, new_hz.size))
    return any(
        np.count_nonzero((np.abs(new_hz - ratio * old_hz[:, None]) < reach_hz).any(axis=1))
        >= needed
        for ratio in tried
    )
