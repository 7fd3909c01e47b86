"""One-to-one assignment of measurements to lines inside their gates.

**Method.** Measurements are sorted by frequency, so the candidates of a line are a
slice of them. Pairs whose line and measurement have no other candidate are taken
at once; the rest goes through an exact rectangular assignment, which
therefore only sees the few lines that compete. It is written here because they are so
few: importing that of scipy takes longer than all assignments of an hour.

**Conventions.** Lines and measurements are given by index; the result lists pairs.
As many pairs as possible are made; among those, the sum of costs is least.

**References.** Crouse, "On implementing 2D rectangular assignment algorithms", IEEE
Trans. AES 52(4), 1679-1696 (2016): shortest augmenting paths, as in scipy.
"""

import math
from collections.abc import Mapping

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray

CELLS_PER_MEASUREMENT = 4
"""Cells of the table in which gates are looked up, for each measurement."""


def candidate_pairs(
    centres: FloatArray, half_widths: FloatArray, measured: FloatArray
) -> tuple[IntArray, IntArray]:
    """List (line, measurement) pairs closer than the half width of the line's gate.

    Frequencies in Hz, measured ones ascending; the edge itself is outside. Pairs are
    ordered by line.
    """
    if not measured.size:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    # a table of fine cells finds where a gate begins and ends faster than a search
    low, span = float(measured[0]), float(measured[-1] - measured[0])
    last = CELLS_PER_MEASUREMENT * measured.size
    scale = last / span if span > 0.0 else 0.0
    cell = ((measured - low) * scale).astype(np.int64)
    below = np.bincount(cell + 1, minlength=last + 2).cumsum()
    lowest, highest = centres - half_widths, centres + half_widths
    begin = np.minimum(np.maximum((lowest - low) * scale, 0.0), last)
    end = np.minimum(np.maximum((highest - low) * scale, 0.0), last)
    first = below[begin.astype(np.int64)]
    counts = np.maximum(below[end.astype(np.int64) + 1] - first, 0)
    lines = np.arange(centres.size).repeat(counts)
    found = np.arange(lines.size) + (first + counts - counts.cumsum())[lines]
    value = measured[found]
    is_inside = ((value > lowest[lines]) & (value < highest[lines])).nonzero()[0]
    return lines[is_inside], found[is_inside]


def assign(lines: IntArray, measurements: IntArray, costs: FloatArray) -> IntArray:
    """Choose pairs so that each line and each measurement occurs at most once.

    Candidate pairs have any finite costs. Returns the positions of the chosen ones,
    ascending.
    """
    if lines.size == 0:
        return np.zeros(0, dtype=np.int64)
    is_chosen = _is_single(lines) & _is_single(measurements)
    busy = np.flatnonzero(~is_chosen)
    if busy.size:
        position = dict(
            zip(
                zip(lines[busy].tolist(), measurements[busy].tolist(), strict=True),
                busy.tolist(), strict=True,
            )
        )  # fmt: skip
        pairs = _paired(dict(zip(position, costs[busy].tolist(), strict=True)))
        is_chosen[[position[pair] for pair in pairs]] = True
    return np.flatnonzero(is_chosen)


def _is_single(index: IntArray) -> BoolArray:
    return np.asarray(np.bincount(index)[index] == 1)


def _paired(costs: Mapping[tuple[int, int], float]) -> list[tuple[int, int]]:
    """Return the pairs of (line, measurement) that are chosen by their costs."""
    cheapest = min(costs.values())
    ways: dict[int, dict[int, float]] = {line: {} for line, _ in costs}
    # more than any exchange of allowed pairs can gain, so that cardinality leads
    alone = (max(costs.values()) - cheapest + 1.0) * (len(ways) + 1)
    for (line, measurement), cost in costs.items():
        ways[line][measurement] = cost - cheapest
    for line, way in ways.items():
        way[-1 - line] = alone  # a place of its own, for a line that gets nothing
    pairing = _Pairing(ways)
    for line in ways:
        pairing.add(line)
    return [(line, place) for line, place in pairing.place_of.items() if place >= 0]


class _Pairing:
    """Lines with their places so far: the cheapest one for these lines.

    ``ways``: costs of the places that each line may have.
    """

    def __init__(self, ways: Mapping[int, Mapping[int, float]]) -> None:
        self.place_of: dict[int, int] = {}
        self._ways = ways
        self._line_at: dict[int, int] = {}
        self._line_price = dict.fromkeys(ways, 0.0)
        self._place_price: dict[int, float] = {}

    def add(self, start: int) -> None:
        """Give a line a place, by the cheapest chain of exchanges to a free one."""
        reached, before = self._search(start)
        place, least = reached.popitem()  # the free one, which was reached last
        self._line_price[start] += least
        for taken, length in reached.items():
            self._line_price[self._line_at[taken]] += least - length
            self._place_price[taken] = self._place_price.get(taken, 0.0) - (least - length)
        line = None
        while line != start:
            line = before[place]
            self._line_at[place] = line
            place, self.place_of[line] = self.place_of.get(line, place), place

    def _search(self, start: int) -> tuple[dict[int, float], dict[int, int]]:
        """Return the places reached, nearest first, and whence, by Dijkstra's search."""
        price = self._place_price
        lengths: dict[int, float] = {}
        before: dict[int, int] = {}
        reached: dict[int, float] = {}
        line: int | None = start
        least = 0.0
        while line is not None:
            base = least - self._line_price[line]
            for place, cost in self._ways[line].items():
                through = base + cost - price.get(place, 0.0)
                if place not in reached and through < lengths.get(place, math.inf):
                    lengths[place], before[place] = through, line
            nearest = min(lengths, key=lengths.__getitem__)
            reached[nearest] = least = lengths.pop(nearest)
            line = self._line_at.get(nearest)
        return reached, before
