"""Lines of several lengths of frames joined to one table: the rungs of a ladder.

**Method.** Long frames hear weak steady lines, short ones lines that move. What both
hear is told once, by the rung with more evidence in that stretch
(`lines.rungs.best_basis`), and what belongs together gets one number
(`lines.rungs.rung_links`). Contacts and status are found again among the joined lines;
families and jumps are those of the rungs, each told once.

The families of the rungs are taken in the order of how unlikely they are by chance. One
that shares lines with an earlier one, at the same spacing or a small multiple, is that
family: frames of another length have found some of its teeth. A line belongs to the first
family that has it, and a family needs three lines of its own.

**Conventions.** Points keep the length of their own frame; the frames of the table are
those of the shortest rung, and a point names the nearest. Rates of false lines add up.

**References.** Coifman & Wickerhauser, IEEE Trans. IT 38(2), 713-718 (1992).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import checked
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.errors import DataError
from uwtrack_cli.lines.contacts import CORRELATION_WINDOWS, ContactSamples, group_lines
from uwtrack_cli.lines.line_points import N_MEASURED, LinePoints
from uwtrack_cli.lines.rungs.best_basis import RungLines, best_basis
from uwtrack_cli.lines.rungs.rung_links import joined_jumps, joined_share, numbers_of_lines
from uwtrack_cli.lines.rungs.same_line import is_one_family

SAME_OVERLAP = 0.05
"""Relative difference of the overlaps of two rungs that are one: they are rounded."""


@checked
def join_rungs(lines: list[Lines]) -> Lines:
    """Join the lines that were tracked in frames of several lengths.

    Every part of a line is taken from the frames that detect it best, and every line
    has one number.

    Parameters
    ----------
    lines
        Tracked lines of one sensor, from frames of one length each.

    Returns
    -------
    Lines
        One table, with the length of each point's frame.

    Raises
    ------
    DataError
        The lines are of several sensors or kinds of sound, were joined before, or their
        frames overlap by different shares.

    Notes
    -----
    A frame whose line has s times the noise's power has the evidence
    s - ln(1 + s), in nepers, less what the choice of the strongest cell gives, and
    overlapping frames as much less. In every stretch
    a line of short frames is held against all the lines of longer ones within its
    resolution: whatever has more evidence stays (the best basis of Coifman &
    Wickerhauser 1992).
    """
    _check(lines)
    if len(lines) == 1:
        one = lines[0]
        return replace(one, window_s=one.point_window_s)
    # the longest frames first: they are the finest in frequency
    ordered = sorted(lines, key=lambda one: -one.frames.window_s)
    rungs = [RungLines.of(one) for one in ordered]
    kept = best_basis(rungs)
    numbers = numbers_of_lines(rungs, kept)
    shortest = min(ordered, key=lambda one: one.frames.hop_s)
    points = _points(ordered, rungs, kept, numbers, shortest.frames)
    beside = joined_share(ordered, rungs, kept, numbers)
    return _with_table(ordered, rungs, numbers, points, shortest, beside)


def _check(lines: Sequence[Lines]) -> None:
    """Refuse lines that cannot be joined."""
    if not lines:
        raise DataError("there are no lines to join: run 'uwtrack track' or 'uwtrack trace' first.")
    for what, values in (
        ("sensors", {one.frames.sensor for one in lines}),
        ("kinds of level", {one.reference for one in lines}),
    ):
        if len(values) > 1:
            raise DataError(
                f"lines of one sensor and one kind of level are joined, and these are of "
                f"{len(values)} {what}: {', '.join(sorted(values))}."
            )
    if any(one.window_s is not None for one in lines) and len(lines) > 1:
        raise DataError(
            "some of these lines were joined from several lengths of frames before: "
            "give those of each length, all at once."
        )
    overlaps = [one.overlap_frames for one in lines]
    if max(overlaps) > (1.0 + SAME_OVERLAP) * min(overlaps):
        raise DataError(
            "the frames of all rungs must overlap by the same share, got "
            f"{', '.join(f'{1.0 - 1.0 / each:.3g}' for each in overlaps)}."
        )


def _points(
    lines: Sequence[Lines],
    rungs: Sequence[RungLines],
    kept: Sequence[BoolArray],
    numbers: Sequence[IntArray],
    frames: Frames,
) -> dict[str, Any]:
    """Return the columns of the points that stay, by line and time."""
    line: list[IntArray] = []
    rows: list[IntArray] = []
    for rung, stays, names in zip(rungs, kept, numbers, strict=True):
        own = names[rung.row]
        rows.append(np.flatnonzero(stays & (own > 0)))
        line.append(own[rows[-1]])
    number = np.concatenate(line)
    time_s = np.concatenate([one.time_s[own] for one, own in zip(lines, rows, strict=True)])
    order = np.lexsort((time_s, number))
    columns: dict[str, Any] = {}
    for name, spec in Lines.columns().items():
        if name in {"line", "frame", "window_s"} or any(
            getattr(one, name) is None for one in lines
        ):
            continue
        if spec.axes[0] == "point":
            parts = [getattr(one, name)[own] for one, own in zip(lines, rows, strict=True)]
            columns[name] = np.concatenate(parts)[order]
    window_s = [
        np.full(own.size, one.frames.window_s) for one, own in zip(lines, rows, strict=True)
    ]
    columns["window_s"] = np.concatenate(window_s)[order]
    columns["line"] = number[order]
    columns["frame"] = _nearest_frame(frames, columns["time_s"])
    return columns


def _nearest_frame(frames: Frames, time_s: FloatArray) -> IntArray:
    """Return the frame nearest to each time."""
    if not frames.n_frames:
        return np.zeros(time_s.size, np.int64)
    middles = np.asarray(frames.time_s)
    after = np.clip(np.searchsorted(middles, time_s), 1, max(1, middles.size - 1))
    before = np.minimum(after - 1, middles.size - 1)
    after = np.minimum(after, middles.size - 1)
    nearer = np.abs(middles[after] - time_s) < np.abs(middles[before] - time_s)
    return frames.first_frame + np.where(nearer, after, before)


def _with_table(
    lines: Sequence[Lines],
    rungs: Sequence[RungLines],
    numbers: Sequence[IntArray],
    points: dict[str, Any],
    shortest: Lines,
    unresolved_share: FloatArray,
) -> Lines:
    """Return the points with what is known of whole lines."""
    names = np.unique(points["line"])
    families, family = joined_families(names, [one.families for one in lines], rungs, numbers)
    contact, status = _contacts(names, family, points)
    measured = [one.measured_false_lines_per_khz_hour for one in lines]
    known = [rate for rate in measured if np.isfinite(rate)]
    keenest = min(
        lines, key=lambda one: one.weakest_line_snr_db - 10 * np.log10(one.frames.window_s)
    )
    return Lines(
        frames=shortest.frames,
        families=families,
        **points,
        line_id=names,
        line_contact=contact,
        line_family=family,
        line_status=status,
        line_unresolved_share=unresolved_share,
        **joined_jumps(lines, rungs, numbers, contact),
        reference=shortest.reference,
        false_lines_per_khz_hour=sum(one.false_lines_per_khz_hour for one in lines),
        weakest_line_snr_db=keenest.weakest_line_snr_db,
        measured_false_lines_per_khz_hour=sum(known) if known else float("nan"),
    )


def _contacts(names: IntArray, family: IntArray, points: dict[str, Any]) -> tuple[IntArray, Any]:
    """Find contacts and status again, on a grid of times that all rungs share."""
    grid_s = _usual_window_s(points)
    samples = ContactSamples(1)
    for row, (begin, end) in enumerate(_spans(points["line"], names)):
        samples.add(_on_grid(int(names[row]), points, slice(begin, end), grid_s))
    held = samples.samples(names, CORRELATION_WINDOWS)
    return group_lines(held, family)


def _spans(line: IntArray, names: IntArray) -> list[tuple[int, int]]:
    """Return where the points of each line begin and end."""
    first, last = (np.searchsorted(line, names, side) for side in ("left", "right"))
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _usual_window_s(points: dict[str, Any]) -> float:
    """Return the length of frames in which half of the time of all lines is told, s."""
    window_s = points["window_s"]
    if not window_s.size:
        return 1.0
    lengths, which = np.unique(window_s, return_inverse=True)
    time = np.cumsum(np.bincount(which) * lengths)
    return float(lengths[np.searchsorted(time, 0.5 * time[-1])])


def _on_grid(name: int, points: dict[str, Any], own: slice, grid_s: float) -> LinePoints:
    """Return one line at the times of a grid at which it has a point about."""
    time_s, window_s = points["time_s"][own], points["window_s"][own]
    grid = np.arange(np.ceil(time_s[0] / grid_s), np.floor(time_s[-1] / grid_s) + 1.0)
    at_s = grid * grid_s
    near = np.clip(np.searchsorted(time_s, at_s), 1, max(1, time_s.size - 1))
    near = np.minimum(near, time_s.size - 1)
    before = np.maximum(near - 1, 0)
    near = np.where(at_s - time_s[before] < time_s[near] - at_s, before, near)
    has_point = np.abs(time_s[near] - at_s) <= np.maximum(window_s[near], grid_s)
    grid, at_s, near = grid[has_point], at_s[has_point], near[has_point]
    bearing = points["bearing_deg"][own]
    state = np.zeros((at_s.size, 5, 2))
    state[:, 0, 0] = np.interp(at_s, time_s, points["frequency_hz"][own])
    state[:, 2, 0] = points["frequency_covariance"][own][near, 0, 0]
    state[:, 0, 1] = bearing[near]
    variance = points["bearing_covariance"][own][near, 0, 0]
    state[:, 2, 1] = np.where(np.isfinite(variance), variance, np.inf)
    return LinePoints(
        line=np.full(at_s.size, name, np.int64),
        frame=grid.astype(np.int64),
        time_s=at_s,
        state=state,
        measured=np.full((at_s.size, N_MEASURED), np.nan),
        association=np.zeros(at_s.size, np.int64),
    )


FEWEST_LINES = 3
"""Lines of a family."""


def joined_families(
    names: IntArray,
    tables: Sequence[Families],
    rungs: Sequence[RungLines],
    numbers: Sequence[IntArray],
) -> tuple[Families, IntArray]:
    """Return the families of joined lines, and each line's one (-1: none)."""
    family = np.full(names.size, -1, np.int64)
    rows: list[Families] = []
    hop_s = min((rung.hop_s for rung in rungs), default=1.0)
    for rung, row, own in _joined(tables, rungs, numbers):
        free = np.isin(names, own) & (family < 0)
        if np.count_nonzero(free) < FEWEST_LINES:
            continue
        family[free] = len(rows) + 1
        one = tables[rung].take("family", np.array([row]))
        first = np.rint(one.frame * rungs[rung].hop_s / hop_s)
        rows.append(_renamed(one, len(rows) + 1, first, int(np.count_nonzero(free))))
    if not rows:
        return tables[0].take("family", np.zeros(0, np.int64)), family
    return Families.join(rows), family


def _joined(
    tables: Sequence[Families], rungs: Sequence[RungLines], numbers: Sequence[IntArray]
) -> list[tuple[int, int, IntArray]]:
    """Return rung and row of each family with its joined lines, most certain first."""
    found: list[tuple[float, int, int, IntArray]] = []
    for rung, table in enumerate(tables):
        for row, name in enumerate(table.family.tolist()):
            own = np.unique(numbers[rung][rungs[rung].family == name])
            chance = float(table.log10_chance[row])
            found.append((chance, rung, row, own[own > 0]))
    found.sort(key=lambda each: each[:3])
    joined: list[tuple[int, int, IntArray]] = []
    for _, rung, row, own in found:
        spacing_hz = float(tables[rung].spacing_hz[row])
        for k, (rung_too, row_too, lines) in enumerate(joined):
            other_hz = float(tables[rung_too].spacing_hz[row_too])
            if is_one_family((spacing_hz, other_hz), own, lines):
                joined[k] = (rung_too, row_too, np.union1d(lines, own))
                break
        else:
            joined.append((rung, row, own))
    return joined


def _renamed(one: Families, name: int, frame: IntArray, n_members: int) -> Families:
    return replace(
        one, family=np.array([name]), frame=frame.astype(np.int64), n_members=np.array([n_members])
    )
