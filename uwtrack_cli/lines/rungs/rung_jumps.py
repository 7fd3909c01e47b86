"""What the trackers of the rungs tell beside lines: jumps of machines, unresolved lines.

**Method.** A machine that changes its speed at once is told by every rung that hears its
lines. Jumps nearer to each other than the longest frame, with ratios that agree, are one,
told as the rung with the most lines of it does. The share of its time in which a line is
not resolved is that of the lines of its rungs, each for the time that it tells.

**Conventions.** Ratios agree within three standard deviations of their difference.
Lines have the numbers of `rung_links`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.rungs.best_basis import RungLines

SAME_RATIO_SIGMAS = 3.0
"""Deviations of the difference of two ratios up to which both are one jump."""


class _Jump(NamedTuple):
    """A jump as one rung tells it."""

    n_lines: int
    """Lines that jumped."""
    time_s: float
    """When, s."""
    ratio: float
    """Rate afterwards over the rate before."""
    ratio_std: float
    """Standard deviation of the ratio."""
    contact: int
    """Contact of most of the lines among the joined ones."""

    def is_same(self, other: "_Jump", reach_s: float) -> bool:
        """Tell whether two rungs tell one jump."""
        off = abs(self.ratio - other.ratio)
        allowed = SAME_RATIO_SIGMAS * float(np.hypot(self.ratio_std, other.ratio_std))
        return abs(self.time_s - other.time_s) <= reach_s and off <= allowed


def joined_jumps(
    lines: Sequence[Lines],
    rungs: Sequence[RungLines],
    numbers: Sequence[IntArray],
    contact: IntArray,
) -> dict[str, Any]:
    """Return the columns of the jumps of joined lines, in the order of time.

    ``contact`` is that of each joined line, by its number less one.
    """
    reach_s = max(rung.window_s for rung in rungs)
    told = [
        jump
        for one, rung, names in zip(lines, rungs, numbers, strict=True)
        for jump in _told(one, rung, names, contact)
    ]
    kept: list[_Jump] = []
    for jump in sorted(told, key=lambda each: (-each.n_lines, each.ratio_std)):
        if not any(jump.is_same(other, reach_s) for other in kept):
            kept.append(jump)
    kept.sort(key=lambda each: each.time_s)
    return {
        "jump_time_s": np.array([jump.time_s for jump in kept], float),
        "jump_ratio": np.array([jump.ratio for jump in kept], float),
        "jump_ratio_std": np.array([jump.ratio_std for jump in kept], float),
        "jump_line_count": np.array([jump.n_lines for jump in kept], np.int64),
        "jump_contact": np.array([jump.contact for jump in kept], np.int64),
    }


def _told(
    lines: Lines, rung: RungLines, numbers: IntArray, contact: IntArray
) -> list[_Jump]:
    """Return the jumps of one rung; a file of an older version has none."""
    columns = (
        lines.jump_line_count, lines.jump_time_s, lines.jump_ratio, lines.jump_ratio_std,
        lines.jump_contact,
    )  # fmt: skip
    if any(column is None for column in columns):
        return []
    found = []
    of_line = dict(
        zip(lines.line_id.tolist(), lines.line_contact.tolist(), strict=True)
    )
    own = np.array([of_line.get(name, 0) for name in rung.names.tolist()], np.int64)
    for n_lines, time_s, ratio, std, old in zip(*columns, strict=True):  # type: ignore[arg-type]
        joined = numbers[(own == old) & (own > 0) & (numbers > 0)]
        new = contact[joined - 1]
        best = int(np.bincount(new).argmax()) if new.size else 0
        found.append(_Jump(int(n_lines), float(time_s), float(ratio), float(std), best))
    return found


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
