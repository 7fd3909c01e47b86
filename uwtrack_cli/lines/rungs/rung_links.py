"""One number for each line of a ladder, whichever rungs tell it.

**Method.** Lines of two rungs that run beside each other for most of the time that they
have in common are one, the longest companions first. Two lines that are told at the
same time are not: a coarse line beside two fine ones goes with the one that it
accompanies longer. A line that is alone, and mostly told by others, is none of its own.

A machine that changes its speed at once is told by every rung that hears its
lines. Jumps nearer to each other than the longest frame, with ratios that agree, are one,
told as the rung with the most lines of it does. The share of its time in which a line is
not resolved is that of the lines of its rungs, each for the time that it tells.

**Conventions.** Numbers count from 1 in the order of the first point; 0 is no line.
Rungs are given with the finest in frequency first.

Ratios of jumps agree within three standard deviations of their difference.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.rungs.best_basis import RungLines, beside

COMMON_SHARE = 0.5
"""Share of their common time in which two lines must run beside each other."""

DOUBLE_SHARE = 0.2
"""Share of the time of the shorter of two lines in which both may be told."""

OWN_SHARE = 0.5
"""Share of a lone line's points that must stand."""

Place = tuple[int, int]
"""Rung and row of a line."""


def numbers_of_lines(rungs: Sequence[RungLines], stands: Sequence[BoolArray]) -> list[IntArray]:
    """Return the number of each line, shape (line,) for each rung."""
    step_s = min((rung.hop_s for rung in rungs), default=1.0)
    told, heard = (
        {
            (number, line): _steps_told(rung, points[number], line, step_s)
            for number, rung in enumerate(rungs)
            for line in range(rung.names.size)
        }
        for points in (stands, [np.ones_like(each) for each in stands])
    )
    group: dict[Place, Place] = {place: place for place in told}
    members: dict[Place, list[Place]] = {place: [place] for place in told}
    for one, two in _companions(rungs):
        a, b = group[one], group[two]
        if a == b:
            continue
        n_both = np.intersect1d(told[a], told[b], assume_unique=True).size
        if n_both > DOUBLE_SHARE * min(heard[a].size, heard[b].size):
            continue
        for place in members[b]:
            group[place] = a
        members[a] += members.pop(b)
        told[a], heard[a] = np.union1d(told[a], told[b]), np.union1d(heard[a], heard[b])
    return _numbered(rungs, stands, members)


def _steps_told(rung: RungLines, stands: BoolArray, line: int, step_s: float) -> IntArray:
    """Return in which steps of time a line of a rung is told, ascending.

    A point tells the time for half a hop to either side, if it does not coast.
    """
    points = slice(int(rung.first[line]), int(rung.first[line + 1]))
    is_heard = stands[points] & (rung.ratio[points] > 0.0)
    first = np.floor((rung.time_s[points][is_heard] - 0.5 * rung.hop_s) / step_s + 1e-3)
    n_steps = max(1, round(rung.hop_s / step_s))
    return np.unique(first.astype(np.int64)[:, None] + np.arange(n_steps))


def _companions(rungs: Sequence[RungLines]) -> list[tuple[Place, Place]]:
    """Return pairs of lines that run beside each other, the longest first."""
    found: list[tuple[float, Place, Place]] = []
    for number, rung in enumerate(rungs):
        for line in range(rung.names.size if number else 0):
            begin_s = rung.time_s[rung.first[line]]
            end_s = rung.time_s[rung.first[line + 1] - 1]
            near = beside(rungs, number, line)
            for other in np.unique(near.rung).tolist():
                finer = rungs[other]
                rows, count = np.unique(
                    finer.row[near.point[near.rung == other]], return_counts=True
                )
                for row, n_near in zip(rows.tolist(), count.tolist(), strict=True):
                    times = finer.time_s[finer.first[row] : finer.first[row + 1]]
                    half_s = 0.5 * finer.hop_s
                    n_common = np.count_nonzero(
                        (times >= begin_s - half_s) & (times <= end_s + half_s)
                    )
                    if n_near >= COMMON_SHARE * n_common:
                        pair = (number, line), (other, row)
                        found.append((n_near * finer.hop_s, *pair))
    found.sort(key=lambda each: -each[0])
    return [(one, two) for _, one, two in found]


def _numbered(
    rungs: Sequence[RungLines], stands: Sequence[BoolArray], members: dict[Place, list[Place]]
) -> list[IntArray]:
    """Give the groups numbers in the order in which they begin."""
    begins: list[tuple[float, Place]] = []
    for place, own in members.items():
        first_s = np.inf
        n_told = n_points = 0
        for number, line in own:
            rung = rungs[number]
            points = slice(int(rung.first[line]), int(rung.first[line + 1]))
            told = stands[number][points]
            n_told += int(np.count_nonzero(told))
            n_points += told.size
            if told.any():
                first_s = min(first_s, float(rung.time_s[points][told][0]))
        is_alone = len(own) == 1
        if n_told and not (is_alone and n_told < OWN_SHARE * n_points):
            begins.append((first_s, place))
    numbers: list[IntArray] = [np.zeros(r.names.size, np.int64) for r in rungs]
    for name, (_, place) in enumerate(sorted(begins), 1):
        for number, line in members[place]:
            numbers[number][line] = name
    return numbers


SAME_RATIO_SIGMAS = 3.0
"""Deviations of the difference of two ratios up to which both are one jump."""


def joined_jumps(
    lines: Sequence[Lines],
    rungs: Sequence[RungLines],
    numbers: Sequence[IntArray],
    contact: IntArray,
) -> dict[str, Any]:
    """Return the columns of the jumps of joined lines, in the order of time.

    ``contact`` is that of each joined line, by its number less one. A file of an older
    version has no jumps.
    """
    reach_s = max(rung.window_s for rung in rungs)
    names = ("jump_line_count", "jump_time_s", "jump_ratio", "jump_ratio_std", "jump_contact")
    told = [np.zeros((len(names), 0))]
    for one, rung, joined in zip(lines, rungs, numbers, strict=True):
        if one.jump_line_count is not None:
            told.append(np.stack([getattr(one, name) for name in names]).astype(float))
            place = np.searchsorted(one.line_id, rung.names)
            own = np.where(joined > 0, one.line_contact[place], 0)
            told[-1][4] = [
                _usual(contact[joined[own == old] - 1]) if old else 0 for old in told[-1][4]
            ]
    jumps = np.concatenate(told, axis=1)
    kept: list[int] = []
    for k in np.lexsort((jumps[3], -jumps[0])).tolist():
        _, late_s, off, _, _ = np.abs(jumps[:, kept] - jumps[:, [k]])
        std = np.hypot(jumps[3, kept], jumps[3, k])
        if not ((late_s <= reach_s) & (off <= SAME_RATIO_SIGMAS * std)).any():
            kept.append(k)
    kept.sort(key=lambda k: jumps[1, k])
    columns = dict(zip(names, jumps[:, kept], strict=True))
    whole = {name: columns[name].astype(np.int64) for name in ("jump_line_count", "jump_contact")}
    return columns | whole


def _usual(values: IntArray) -> int:
    """Return the commonest of some numbers, 0 for none."""
    return int(np.bincount(values).argmax()) if values.size else 0


def joined_share(
    lines: Sequence[Lines],
    rungs: Sequence[RungLines],
    kept: Sequence[BoolArray],
    numbers: Sequence[IntArray],
) -> FloatArray:
    """Return the share of its time in which each joined line is not resolved.

    Lines of older versions count as resolved; ``kept`` says which points are told.
    """
    n_lines = max((int(names.max(initial=0)) for names in numbers), default=0)
    beside_s, told_s = np.zeros((2, n_lines + 1))
    for one, rung, stays, names in zip(lines, rungs, kept, numbers, strict=True):
        count = np.bincount(rung.row[stays], minlength=rung.names.size) * rung.hop_s
        np.add.at(told_s, names, count)
        if one.line_unresolved_share is not None:
            place = np.searchsorted(one.line_id, rung.names)
            np.add.at(beside_s, names, count * one.line_unresolved_share[place])
    return beside_s[1:] / np.maximum(told_s[1:], 1e-9)
