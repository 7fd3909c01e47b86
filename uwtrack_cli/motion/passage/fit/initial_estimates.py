"""Initial estimates of a passage: a search over time and width, all else closed form.

**Method.** On a grid of (t0, d/v) the frequencies are linear in speed and rest
frequency, the bearings in the bearing at closest approach, the levels in the level
(for a few floors). So each kind gives its gain in log-likelihood over "nothing passes"
by matrix products; starts are the best cells of each kind alone and of all together.

**Conventions.** Gains are in units of half a chi-square. The grid follows the data:
widths from the distance of measurements to the time covered, times at a share of the
width; nothing is fixed in seconds.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.least_squares import orthonormal
from uwtrack_cli.estimation.robust import median_scale, median_where, neighbour_scale
from uwtrack_cli.estimation.row_offsets import Design, mean_of_rows, padded
from uwtrack_cli.motion.passage.model.law import SLOWEST_MPS
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import STEP, Change

MOST_CELLS = 400
"""Cells of time to which longer data are condensed."""

FLOORS = (-9.0, -6.0, -3.5, -1.5)
"""Natural logarithms of the floor relative to the level at closest approach."""

SMALLEST_HORIZONTAL = 0.1
"""Share of the slant range that the horizontal range is not below at the start."""

WIDTH_RATIO = 1.5
TIME_SHARE = 0.6


@dataclass(frozen=True)
class InitialEstimates:
    """Unknowns to start fits from (rows as in `normal`) and their turns."""

    theta: FloatArray
    """Unknowns as in `unknowns`, shape (starts, 4)."""
    turn: FloatArray
    """Sign of the bearing trend, shape (starts,)."""
    gain: FloatArray
    """Gain in log-likelihood over "nothing passes", shape (starts,)."""


@dataclass(frozen=True)
class _Grid:
    time: FloatArray
    """Time of closest approach of every cell, s, shape (cells,)."""
    width: FloatArray
    """Range over speed of every cell, s, same shape."""
    x: FloatArray
    """(t - t0) over the width, shape (cells, n)."""
    slant: FloatArray
    """sqrt(1 + x^2), same shape."""


@dataclass(frozen=True)
class _Coarse:
    """Cells of time with summed weights: the data at the grid's resolution."""

    time: FloatArray
    """Mean times, s, shape (n,)."""
    shift: FloatArray
    """Mean frequencies over the line's mean, less one, shape (lines, n)."""
    shift_weight: FloatArray
    """Their inverse variances."""
    vector: FloatArray
    """Weighted sum of unit vectors of the bearings, complex, shape (n,)."""
    level: FloatArray
    """Mean levels, ln of power, shape (n,)."""
    level_weight: FloatArray
    """Their inverse variances."""


def find_initial_estimates(
    blocks: Blocks, medium: Medium, *, n_starts: int = 3
) -> InitialEstimates:
    """Find starts for a fit of one data set.

    Parameters
    ----------
    blocks
        Measurements in fit units; the first row of the batch is used.
    medium
        Sound speed and depth difference.
    n_starts
        Initial estimates of each kind.
    """
    coarse = _condense(blocks)
    grid = _grid(coarse.time)
    doppler, speed = _doppler_gain(grid, coarse, medium.sound_speed_mps)
    turns = _bearing_gain(grid, coarse)
    level, floor = _level_gain(grid, coarse)
    gains = [doppler, turns[0], turns[1], level]
    both = [doppler + level + turn for turn in turns]
    picks: list[tuple[int, float, float]] = []
    for number, gain in enumerate([*both, *gains]):
        turn = (1.0, -1.0, 0.0, 1.0, -1.0, 0.0)[number]
        for cell in _best(grid, gain, n_starts):
            better = 1.0 if turns[0][cell] >= turns[1][cell] else -1.0
            picks.append((int(cell), turn or better, float(both[0][cell])))
    chosen = list(dict.fromkeys((cell, turn) for cell, turn, _ in picks))
    cells = np.array([cell for cell, _ in chosen], dtype=np.int64)
    turn_of = np.array([turn for _, turn in chosen])
    theta = np.stack(
        [
            grid.time[cells],
            np.log(grid.width[cells]),
            np.where(speed[cells] > 0, speed[cells], _slow(speed)),
            floor[cells],
        ],
        axis=-1,
    )
    if blocks.shift.is_empty:
        theta[:, 2] = 0.0
    else:
        theta[:, 1] = _horizontal(grid.width[cells], theta[:, 2], medium)
    total = np.where(turn_of > 0, both[0][cells], both[1][cells])
    return InitialEstimates(theta, turn_of, total)


class ChangedEstimates(NamedTuple):
    """Unknowns to start from where the frequencies changed beside the passage."""

    theta: FloatArray
    """Unknowns as in `unknowns`, shape (starts, 4)."""
    time_s: FloatArray
    """Instant of the change, s, shape (starts,)."""
    sign: FloatArray
    """+1 where what changed follows that instant, -1 where it goes before, same shape."""
    size: FloatArray
    """Size of that change, shape (starts,)."""
    others: FloatArray
    """Gain in log-likelihood of bearings and levels alone, shape (starts,)."""
    known_to_s: float
    """How well the instants are known, s."""


_ROWS_AT_ONCE = 512
"""Passages that are compared with all changes at once."""


class _ChangedColumns(NamedTuple):
    """Changes of the frequencies as columns of a linear model, the lines' constants out.

    A step leaves out the cell in which it lies: that is a mean of both sides.
    """

    columns: FloatArray
    """Columns of the changes, shape (changes, n)."""
    left_out: IntArray
    """Cell that is left out, shape (changes,); empty if none is."""
    share: FloatArray
    """What the constants leave of the square of these cells, same shape."""

    def along(self, rows: FloatArray, value: FloatArray) -> FloatArray:
        """Multiply rows with a value, for every change without its left-out cell.

        Parameters
        ----------
        rows
            Rows that are the same for all changes, shape (rows, n).
        value
            Shape (n,).

        Returns
        -------
        FloatArray
            Shape (rows, changes), or (rows, 1) if nothing is left out.
        """
        whole: FloatArray = (rows @ value)[:, None]
        if not self.left_out.size:
            return whole
        return whole - rows[:, self.left_out] * (value[self.left_out] / self.share)

    def both(self, rows: FloatArray, root: FloatArray) -> FloatArray:
        """Multiply rows with the columns, each pair without its left-out cell.

        Parameters
        ----------
        rows
            Rows without the lines' constants, the same for all changes, shape (rows, n).
        root
            Square roots of the weights, shape (n,).

        Returns
        -------
        FloatArray
            Shape (rows, changes).
        """
        if not self.left_out.size:
            return np.asarray(rows @ self.columns.T)
        # a step sums what follows it; its constants are no part of such rows
        sums = np.cumsum(rows[:, : root.size] * root, axis=1)
        whole = sums[:, -1:] - sums[:, self.left_out]
        own = self.columns[np.arange(self.left_out.size), self.left_out]
        return np.asarray(whole - rows[:, self.left_out] * (own / self.share))

    def square(self, rows: FloatArray) -> FloatArray:
        """Square rows, each for every change without its left-out cell.

        Parameters
        ----------
        rows
            Rows that are the same for all changes, shape (rows, n).

        Returns
        -------
        FloatArray
            Shape (rows, changes), or (rows, 1) if nothing is left out.
        """
        whole: FloatArray = (rows**2).sum(axis=1)[:, None]
        if not self.left_out.size:
            return whole
        return np.asarray(whole - rows[:, self.left_out] ** 2 / self.share)

    def own(self, value: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Multiply every column with a value, and with itself.

        Parameters
        ----------
        value
            Shape (n,).

        Returns
        -------
        tuple[FloatArray, FloatArray]
            Each of shape (changes,).
        """
        product, square = self.columns @ value, (self.columns**2).sum(axis=1)
        if self.left_out.size:
            here = self.columns[np.arange(self.left_out.size), self.left_out]
            product = product - here * value[self.left_out] / self.share
            square = square - here**2 / self.share
        least = 1e-9 * max(float(square.max(initial=0.0)), 1e-300)
        known: FloatArray = np.maximum(square, least)
        return np.where(square > least, product, 0.0), known


@dataclass(frozen=True)
class PassageSearch:
    """What the search beside every kind of change has in common."""

    data: _Coarse
    """The measurements at the grid's resolution."""
    grid: _Grid
    """Times and widths that are tried."""
    others: FloatArray
    """Gain in log-likelihood of bearings and levels, shape (cells,)."""
    floor: FloatArray
    """ln of the best floor, same shape."""
    sound_speed_mps: float
    """Sound speed, m/s."""

    @classmethod
    def of(cls, blocks: Blocks, medium: Medium, turn: float) -> "PassageSearch":
        """Prepare the search in one data set.

        Parameters
        ----------
        blocks
            Measurements in fit units; the first row of the batch is used.
        medium
            Sound speed.
        turn
            Sign of the bearing trend.
        """
        data = _condense(blocks)
        grid = _grid(data.time)
        level, floor = _level_gain(grid, data)
        bearing = _bearing_gain(grid, data)[0 if turn > 0 else 1]
        return cls(data, grid, level + bearing, floor, medium.sound_speed_mps)


def find_changed_estimates(
    search: PassageSearch, medium: Medium, every: Change, *, n_starts: int = 3
) -> ChangedEstimates:
    """Search all passages beside all changes of the frequencies at once.

    Both are linear in the frequencies, so that each pair of them costs a few products.
    A step far above the noise must lie within a cell of where it was, or it spoils every
    passage beside it: it is sought in all cells.

    Parameters
    ----------
    search
        What the search of this data set begins with.
    medium
        Depth difference.
    every
        A step or a ramp of the frequencies at many instants; a step is sought in all
        cells among them.
    n_starts
        Pairs that are wanted, with changes that are not neighbours.
    """
    data, grid, weight = search.data, search.grid, search.data.shift_weight
    used, mean = weight.any(axis=0), np.zeros(data.time.size)
    mean[used], offsets = mean_of_rows(data.shift[:, used], weight[:, used])
    columns = np.zeros((used.size, offsets.known.size))
    columns[used] = offsets.columns
    root = np.sqrt(weight.sum(axis=0))
    basis = orthonormal(Design(columns, offsets.known).rows(root))

    def free(rows: FloatArray) -> FloatArray:
        whole = padded(rows * root, len(basis))
        return np.asarray(whole - (whole @ basis) @ basis.T)

    known_to_s = float(np.median(np.diff(np.unique(every.time_s))))
    apart_s = 2.5 * known_to_s
    left_out = np.empty(0, np.int64)
    if every.kind == STEP:
        inside = (data.time >= every.time_s.min()) & (data.time <= every.time_s.max())
        left_out = np.flatnonzero(inside & (root > 0))
        every = Change(STEP, data.time[left_out], np.ones(left_out.size))
        apart_s, known_to_s = known_to_s, float(np.median(np.diff(data.time)))
    value = free(mean)
    passing, shapes = free(grid.x / grid.slant), free(every.shape(data.time))
    share = np.maximum(1 - (basis[left_out] ** 2).sum(axis=1), 1e-9)
    changed = _ChangedColumns(shapes, left_out, share)
    own, length = changed.own(value)

    def beside(rows: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return gain, slope and product with the changes of some passages."""
        along = changed.along(passing[rows], value)
        both = changed.both(passing[rows], root)
        whole = changed.square(passing[rows])
        square = whole - both**2 / length
        least = 1e-3 * np.maximum(whole, 1e-300)
        slope = (along - both * own / length) / np.maximum(square, least)
        speed = -search.sound_speed_mps * slope
        usable = (speed > 0) & (speed < 0.8 * search.sound_speed_mps) & (square > least)
        gain = 0.5 * (own**2 / length + slope**2 * square) + search.others[rows, None]
        if left_out.size:  # what is left out is explained whole
            gain += 0.5 * value[left_out] ** 2 / share
        return np.where(usable, gain, -np.inf), slope, both

    # by parts: the pairs are many, and only their gains are compared
    gain = np.concatenate([
        beside(slice(first, first + _ROWS_AT_ONCE))[0]
        for first in range(0, len(passing), _ROWS_AT_ONCE)
    ])  # fmt: skip
    picked: list[tuple[int, int, float, float]] = []
    for _ in range(n_starts):
        at, of = divmod(int(np.argmax(gain)), gain.shape[1])
        if not np.isfinite(gain[at, of]):
            break
        _, slope, both = beside(slice(at, at + 1))
        picked.append((at, of, float(slope[0, of]), float(both[0, of])))
        gain[:, np.abs(every.time_s - every.time_s[of]) < apart_s] = -np.inf
    slopes, products = np.array([pick[2:] for pick in picked]).reshape(-1, 2).T
    cell, number = np.array([pick[:2] for pick in picked], np.int64).reshape(-1, 2).T
    fast = -search.sound_speed_mps * slopes
    theta = np.stack([grid.time[cell], np.log(grid.width[cell]), fast, search.floor[cell]], axis=-1)
    theta[:, 1] = _horizontal(grid.width[cell], fast, medium)
    amount = (own[number] - slopes * products) / length[number]
    return ChangedEstimates(
        theta, every.time_s[number], every.sign[number], amount, search.others[cell], known_to_s
    )


def _horizontal(width: FloatArray, speed: FloatArray, medium: Medium) -> FloatArray:
    """Return the logarithm of the horizontal range over speed of a slant one."""
    rise = medium.height_m / np.maximum(speed, SLOWEST_MPS)
    square = np.maximum(width**2 - rise**2, (SMALLEST_HORIZONTAL * width) ** 2)
    logarithm: FloatArray = 0.5 * np.log(square)
    return logarithm


def _slow(speed: FloatArray) -> float:
    """Choose a small positive speed where the grid's own fit had the wrong sign."""
    positive = speed[speed > 0]
    return float(np.median(positive)) if positive.size else 1e-3


def _condense(blocks: Blocks) -> _Coarse:
    time = blocks.time_s
    starts = _cell_starts(time)
    shift, shift_weight = _scaled(blocks.shift.value[0], blocks.shift.weight[0])
    level, level_weight = _scaled(blocks.level.value[0], blocks.level.weight[0])
    bearing, bearing_weight = blocks.bearing.value[0], blocks.bearing.weight[0]
    vector = (bearing_weight * np.exp(1j * bearing)).sum(axis=0)
    count = np.diff(np.append(starts, time.size))
    weight = np.add.reduceat(shift_weight, starts, axis=-1)
    total = np.add.reduceat(level_weight.sum(axis=0), starts)
    return _Coarse(
        np.add.reduceat(time, starts) / count,
        np.add.reduceat(shift_weight * shift, starts, axis=-1) / np.where(weight > 0, weight, 1.0),
        weight,
        np.add.reduceat(vector, starts),
        np.add.reduceat((level_weight * level).sum(axis=0), starts)
        / np.where(total > 0, total, 1.0),
        total,
    )


def _cell_starts(time: FloatArray) -> IntArray:
    if time.size <= MOST_CELLS:
        return np.arange(time.size)
    cell = (time - time[0]) / (time[-1] - time[0]) * MOST_CELLS
    _, starts = np.unique(np.floor(cell).astype(np.int64), return_index=True)
    return starts


def _scaled(value: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Clip outliers and bring the weights to the scale of the data."""
    if value.shape[0] == 0:
        return value, weight
    middle = median_where(value, weight)[:, None]
    middle[np.isinf(middle)] = 0.0
    reach = 8 * median_scale(value - middle, weight)[:, None]
    clipped = np.clip(value, middle - reach, middle + reach)
    scale = neighbour_scale(clipped, weight)
    return clipped, weight / scale[:, None] ** 2


def _grid(time: FloatArray) -> _Grid:
    span = max(float(time[-1] - time[0]), 1e-9)
    step = span / max(time.size - 1, 1)
    n_widths = int(np.ceil(np.log(span / step) / np.log(WIDTH_RATIO))) + 2
    widths = 1.2 * step * WIDTH_RATIO ** np.arange(max(n_widths, 2))
    times, wide = [], []
    for width in widths:
        margin = 0.5 * min(width, span)
        count = max(int(np.ceil((span + 2 * margin) / (TIME_SHARE * width))), 3)
        times.append(np.linspace(time[0] - margin, time[-1] + margin, count))
        wide.append(np.full(count, width))
    t0, r = np.concatenate(times), np.concatenate(wide)
    x = (time[None, :] - t0[:, None]) / r[:, None]
    return _Grid(t0, r, x, np.sqrt(1 + x**2))


def _doppler_gain(
    grid: _Grid, data: _Coarse, sound_speed_mps: float
) -> tuple[FloatArray, FloatArray]:
    g = grid.x / grid.slant
    size = data.shift_weight.sum(axis=-1)
    size = np.where(size > 0, size, 1.0)
    value = data.shift_weight * data.shift
    sum_g = g @ data.shift_weight.T
    slope = (g @ value.T - sum_g * value.sum(axis=-1) / size).sum(axis=-1)
    square = ((g**2) @ data.shift_weight.T - sum_g**2 / size).sum(axis=-1)
    square = np.where(square > 0, square, np.inf)
    speed = -sound_speed_mps * slope / square
    usable = (speed > 0) & (speed < 0.8 * sound_speed_mps)
    gain: FloatArray = np.where(usable, 0.5 * slope**2 / square, 0.0)
    return gain, np.where(usable, speed, 0.0)


def _bearing_gain(grid: _Grid, data: _Coarse) -> tuple[FloatArray, FloatArray]:
    if not data.vector.any():
        return np.zeros(grid.time.size), np.zeros(grid.time.size)
    # products of real matrices: each of the two turns is half of a complex one
    parts = np.stack([data.vector.real, data.vector.imag], axis=1)
    cosine = 1.0 / grid.slant
    along, across = cosine @ parts, (grid.x * cosine) @ parts
    constant = abs(data.vector.sum())
    clockwise = np.hypot(along[:, 0] + across[:, 1], along[:, 1] - across[:, 0])
    counter = np.hypot(along[:, 0] - across[:, 1], along[:, 1] + across[:, 0])
    return clockwise - constant, counter - constant


def _level_gain(grid: _Grid, data: _Coarse) -> tuple[FloatArray, FloatArray]:
    weight = data.level_weight
    size = weight.sum()
    best = np.zeros(grid.time.size)
    floor = np.full(grid.time.size, FLOORS[0])
    if size <= 0:
        return best, floor
    centred = data.level - (weight * data.level).sum() / size
    null = 0.5 * (weight * centred**2).sum()
    best -= np.inf
    inverse_square = 1 / grid.slant**2
    for candidate in FLOORS:
        shape = np.log(inverse_square + np.exp(candidate))
        residual = centred - shape
        mean = residual @ weight / size
        cost = 0.5 * ((residual**2) @ weight - size * mean**2)
        better = null - cost > best
        best = np.where(better, null - cost, best)
        floor = np.where(better, candidate, floor)
    return best, floor


def _best(grid: _Grid, gain: FloatArray, count: int) -> list[int]:
    """Take the best cells that are apart by a width in time or by its double."""
    if not np.any(gain > 0):
        return []
    left = gain.copy()
    found = []
    for _ in range(count):
        cell = int(np.argmax(left))
        if left[cell] <= 0:
            break
        found.append(cell)
        ratio = grid.width / grid.width[cell]
        near = np.abs(grid.time - grid.time[cell]) < grid.width[cell]
        left = np.where(near & (ratio < 2.1) & (ratio > 1 / 2.1), -np.inf, left)
    return found
