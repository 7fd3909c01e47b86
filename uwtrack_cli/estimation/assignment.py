"""One-to-one assignment of measurements to lines inside their gates.

**Method.** Measurements are sorted by frequency, so the candidates of a line are a
slice of them. Pairs whose line and measurement have no other candidate are taken
at once; the rest goes through the exact rectangular assignment of scipy, which
therefore only sees the few lines that compete.

**Conventions.** Lines and measurements are given by index; the result lists pairs.
As many pairs as possible are made; among those, the sum of costs is least.

**References.** Crouse, "On implementing 2D rectangular assignment algorithms", IEEE
Trans. AES 52(4), 1679-1696 (2016): the algorithm in scipy.
"""

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
        chosen = _assign_busy(lines[busy], measurements[busy], costs[busy])
        is_chosen[busy[chosen]] = True
    return np.flatnonzero(is_chosen)


def _is_single(index: IntArray) -> BoolArray:
    return np.asarray(np.bincount(index)[index] == 1)


def _assign_busy(
    lines: IntArray, measurements: IntArray, costs: FloatArray
) -> IntArray:
    from scipy.optimize import linear_sum_assignment

    row_names, rows = np.unique(lines, return_inverse=True)
    column_names, columns = np.unique(measurements, return_inverse=True)
    cheapest = costs.min()
    # more than any exchange of allowed pairs can gain, so that cardinality leads
    forbidden = (costs.max() - cheapest + 1.0) * (min(row_names.size, 1_000_000) + 1)
    table = np.full((row_names.size, column_names.size), forbidden)
    table[rows, columns] = costs - cheapest
    position = np.zeros(table.shape, dtype=np.int64)
    position[rows, columns] = np.arange(lines.size)
    chosen_rows, chosen_columns = linear_sum_assignment(table)
    allowed = table[chosen_rows, chosen_columns] < forbidden
    return np.asarray(position[chosen_rows[allowed], chosen_columns[allowed]])
