"""Harmonic families of the joined lines of a ladder, from those of its rungs.

**Method.** The families of the rungs are taken in the order of how unlikely they are by
chance. One that shares lines with an earlier one, at the same spacing or a small
multiple, is that family: frames of another length have found some of its teeth. A line
belongs to the first family that has it, and a family needs three lines of its own.

**Conventions.** Families count from 1.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from uwtrack_cli.data.base import IntArray
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.lines.rungs.best_basis import RungLines
from uwtrack_cli.lines.rungs.same_line import is_one_family

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
        one,
        family=np.array([name]),
        frame=frame.astype(np.int64),
        n_members=np.array([n_members]),
    )
