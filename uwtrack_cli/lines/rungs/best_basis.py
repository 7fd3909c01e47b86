"""Which rung of a ladder tells a stretch of a line: the one with the most evidence.

**Method.** Rungs are taken from the finest in frequency (the longest frames) to the
coarsest. In every cell of time a line is held against the sum of what still stands of
the finer lines within its resolution, as the best basis of a tree of wavelet packets is
found (Coifman & Wickerhauser 1992, section III): the greater evidence stands and the other
falls. Between neighbouring cells a change costs what is strong evidence, so that the
noise of a cell decides nothing; the cheapest course is found by dynamic programming.

**Conventions.** Evidence is in nepers against noise: s - ln(1 + s) for an independent
frame at a power ratio s, less what choosing the strongest cell gives. A cell of time is
as long as the longest frame. Rungs are given with the finest in frequency first.

**References.** Coifman & Wickerhauser, IEEE Trans. IT 38(2), 713-718 (1992); Viterbi
(1967); Kass & Raftery, JASA 90, 773-795 (1995) for what is strong.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.contacts import LEAST_EVIDENCE
from uwtrack_cli.lines.rungs.same_line import SAME_LINE, line_evidence

PEAK_CHOICE = 0.2
"""Evidence that a followed line gains in each independent frame, nepers, because the
strongest cell nearby is taken for it: 0.17 at most (`studies/constants/multi_resolution.py`)."""

PREFERENCE = 1.25
"""Weight of the evidence of finer lines: two lines that short frames do not resolve have
each the power of both there. Chosen: with 1 pairs a bin apart stay with the short frames,
whose numbers change between the two; what long frames blur loses half and more."""


@dataclass(frozen=True)
class RungLines:
    """The lines of one length of frames; points by line, then by time."""

    window_s: float
    """Length of the frames, s."""
    hop_s: float
    """Time from one frame to the next, s."""
    names: IntArray
    """Numbers of the lines, shape (line,)."""
    family: IntArray
    """Family of each line in the rung's own table, -1 for none, shape (line,)."""
    first: IntArray
    """First point of each line, and the number of all, shape (line + 1,)."""
    row: IntArray
    """Line of each point, as its row, shape (point,)."""
    time_s: FloatArray
    """Time of each point, s, shape (point,)."""
    frequency_hz: FloatArray
    """Smoothed frequency of each point, Hz, shape (point,)."""
    ratio: FloatArray
    """Power over noise in the cell of each point; 0 where it coasted; shape (point,)."""
    by_time: IntArray = field(repr=False)
    """Points in the order of time, shape (point,)."""

    @classmethod
    def of(cls, lines: Lines) -> Self:
        """Return what is compared of the lines of one length of frames."""
        names, first = np.unique(lines.line, return_index=True)
        row = np.searchsorted(names, lines.line)
        place = np.clip(np.searchsorted(lines.line_id, names), 0, None)
        family = np.full(names.size, -1, np.int64)
        known = np.isin(names, lines.line_id)
        snr_db = np.asarray(lines.measured_snr_db, float)
        family[known] = lines.line_family[place[known]]
        return cls(
            lines.frames.window_s,
            lines.frames.hop_s,
            names.astype(np.int64),
            family,
            np.append(first, lines.line.size),
            row,
            np.asarray(lines.time_s),
            np.asarray(lines.frequency_hz),
            10.0 ** (np.nan_to_num(snr_db, nan=-np.inf) / 10.0),
            np.argsort(lines.time_s, kind="stable"),
        )


@dataclass(frozen=True)
class Beside:
    """Points of finer rungs that run beside a line of a coarser one."""

    rung: IntArray
    """Rung of each point, shape (near,)."""
    point: IntArray
    """The point in its rung, shape (near,)."""


def beside(rungs: Sequence[RungLines], coarser: int, line: int) -> Beside:
    """Return the points of finer rungs within the resolution of a line of another."""
    own = rungs[coarser]
    points = slice(int(own.first[line]), int(own.first[line + 1]))
    time_s, frequency_hz = own.time_s[points], own.frequency_hz[points]
    reach_hz = SAME_LINE / own.window_s
    numbers, near = [], []
    for number, other in enumerate(rungs[:coarser]):
        half_s = 0.5 * other.hop_s  # a point stands for the time about it
        span = time_s[0] - half_s, time_s[-1] + half_s
        begin, end = np.searchsorted(other.time_s, span, sorter=other.by_time)
        there = other.by_time[begin:end]
        course = np.interp(other.time_s[there], time_s, frequency_hz)
        there = there[np.abs(other.frequency_hz[there] - course) < reach_hz]
        near.append(there)
        numbers.append(np.full(there.size, number, np.int64))
    if not near:
        none = np.zeros(0, np.int64)
        return Beside(none, none)
    return Beside(np.concatenate(numbers), np.concatenate(near))


def best_basis(rungs: Sequence[RungLines]) -> list[BoolArray]:
    """Return which points stand, shape (point,) for each rung."""
    stands = [np.ones(rung.time_s.size, np.bool_) for rung in rungs]
    cell_s = max((rung.window_s for rung in rungs), default=1.0)
    for number, rung in enumerate(rungs):
        for line in range(rung.names.size if number else 0):
            _decide(rungs, stands, (number, line), cell_s)
    return stands


def _decide(
    rungs: Sequence[RungLines], stands: Sequence[BoolArray], place: tuple[int, int], cell_s: float
) -> None:
    """Let a line, or what runs beside it in finer rungs, fall in every cell of time."""
    number, line = place
    own = rungs[number]
    points = np.arange(own.first[line], own.first[line + 1])
    near = beside(rungs, number, line)
    standing = np.zeros(near.point.size, np.bool_)
    for other in np.unique(near.rung):
        chosen = near.rung == other
        standing[chosen] = stands[other][near.point[chosen]]
    if not standing.any():
        return
    near = Beside(near.rung[standing], near.point[standing])
    time_s, hop_s = np.empty((2, near.point.size))
    for other in np.unique(near.rung):
        chosen = near.rung == other
        time_s[chosen] = rungs[other].time_s[near.point[chosen]]
        hop_s[chosen] = rungs[other].hop_s
    near_cell = np.floor(time_s / cell_s).astype(np.int64)
    cells = np.unique(near_cell)
    # what finer lines do not tell stays in either case
    covering = _covering(own.time_s[points], time_s, hop_s)
    points, covering = points[covering >= 0], covering[covering >= 0]
    gain = -_evidence(own, points, near_cell[covering], cells)
    for other in np.unique(near.rung):
        chosen = near.rung == other
        where, rows = near_cell[chosen], near.point[chosen]
        for each in np.unique(rungs[other].row[rows]):  # lines beside each other add up
            its = rungs[other].row[rows] == each
            own_gain = _evidence(rungs[other], rows[its], where[its], cells)
            gain += PREFERENCE * own_gain
    finer = cells[is_finer_best(gain, np.diff(cells))]
    is_told = np.isin(near_cell, finer)
    for other in np.unique(near.rung):
        stands[other][near.point[~is_told & (near.rung == other)]] = False
    stands[number][points[is_told[covering]]] = False


def _evidence(rung: RungLines, points: IntArray, cell: IntArray, cells: IntArray) -> FloatArray:
    """Return the evidence of points of one line in each of some cells of time."""
    rows = np.searchsorted(cells, cell)
    count = np.bincount(rows, minlength=cells.size)
    total = np.bincount(rows, rung.ratio[points], minlength=cells.size)
    ratio = total / np.maximum(count, 1)
    return line_evidence(count * rung.hop_s / rung.window_s, ratio, PEAK_CHOICE)


def _covering(time_s: FloatArray, finer_s: FloatArray, hop_s: FloatArray) -> IntArray:
    """Return the finer point that tells each time, -1 for none.

    A point tells the time for half a hop to either side.
    """
    order = np.argsort(finer_s - 0.5 * hop_s, kind="stable")
    begin_s, end_s = ((finer_s + sign * 0.5 * hop_s)[order] for sign in (-1.0, 1.0))
    latest = np.maximum.accumulate(end_s)
    # the point whose time reaches furthest among those that have begun
    furthest = np.maximum.accumulate(np.where(end_s == latest, np.arange(order.size), 0))
    last = np.searchsorted(begin_s, time_s + 1e-9, "right") - 1
    begun = np.maximum(last, 0)
    chosen = np.where(end_s[begun] >= time_s - 1e-9, begun, furthest[begun])
    is_told = (last >= 0) & (end_s[chosen] >= time_s - 1e-9)
    return np.where(is_told, order[chosen], -1)


def is_finer_best(gain: FloatArray, steps: IntArray) -> BoolArray:
    """Tell in which cells finer lines are told, so that the evidence is greatest.

    The gain is the evidence of the finer lines less that of the coarser one in each
    cell, nepers; a change costs nothing where the step to the next cell is more than
    one.

    Examples
    --------
    A single cell does not change the rung for less than strong evidence, twice.

    >>> is_finer_best(np.array([4.0, -5.0, 6.0, -7.0]), np.array([1, 1, 1])).tolist()
    [True, True, True, False]
    """
    best = np.zeros((gain.size + 1, 2))
    came = np.zeros((gain.size, 2), np.int64)
    for k, own in enumerate(gain.tolist()):
        cost = LEAST_EVIDENCE if k and steps[k - 1] == 1 else 0.0
        for state in (0, 1):
            ways = best[k] - cost * (np.arange(2) != state)
            came[k, state] = int(np.argmax(ways))
            best[k + 1, state] = ways[came[k, state]] + state * own
    found = np.zeros(gain.size, np.bool_)
    state = int(np.argmax(best[-1]))
    for k in range(gain.size - 1, -1, -1):
        found[k] = state == 1
        state = int(came[k, state])
    return found
