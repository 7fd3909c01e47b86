"""Multi-start search: a grid on block averages, then descent from the best.

**Method.** Measurements are gathered into at most forty blocks (averages; medians
under a robust loss, which a tenth of outliers does not move). Every motion of a grid
over range, bearing, speed and course is scored there with its best rest frequencies,
the best few descend on the blocks, and what remains distinct descends on all data.

Bearings of several sensors cross: a few of them, drawn at random, determine a motion in
closed form (each says that the target lies on a line, linear in place and velocity), and
the draws that agree with most of the other rows are the starts (Fischler & Bolles 1981,
CACM 24, 381; Lingren & Gong 1978 for the linear form).
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.model import from_motion, from_state
from uwtrack_cli.motion.target_motion.objective import loss_value, residuals
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.marquardt import DescentResult, SearchBounds, minimise

BLOCKS = 40
HOPELESS = 60.0
"""Rise of the misfit on blocks beyond which a minimum is not followed."""

SAME = np.array([0.02, 0.01, 0.05, 0.05])
"""Distance in solver coordinates within which two minima of the blocks are one."""

RANGES, SPEEDS, COURSES, BEARINGS = 10, 4, 16, 8


@dataclass(frozen=True)
class StartCounts:
    """How many grid points descend on the blocks, and how many on all data."""

    on_blocks: int = 24
    """Grid points that descend on the block averages."""
    on_all: int = 6
    """Minima that descend on all data."""


def multistart(
    problem: Problem,
    limits: SearchBounds,
    *,
    counts: StartCounts | None = None,
    extra: FloatArray | None = None,
) -> DescentResult:
    """Find the minima of the misfit of one record, best first.

    ``extra`` are further starts on all data, for instance the previous solution.
    """
    counts = StartCounts() if counts is None else counts
    if problem.sensor is not None and len(problem.bearing_weight) > 1:
        starts = subset_starts(problem, limits)
        if extra is not None:
            starts = np.concatenate([starts, extra])
        final = minimise(problem, starts, limits)
        return final.take(np.argsort(final.value, kind="stable"))
    coarse = block_averages(problem)
    grid = start_grid(coarse, limits)
    chosen = _best_of_each_range(coarse, grid, counts.on_blocks)
    rough = minimise(coarse, chosen, limits, iterations=40, tolerance=1e-6)
    starts = _distinct(rough, counts.on_all)
    if extra is not None:
        starts = np.concatenate([starts, extra])
    final = minimise(problem, starts, limits)
    return final.take(np.argsort(final.value, kind="stable"))


@lru_cache(maxsize=2)
def minima_of(problem: Problem, limits: SearchBounds) -> DescentResult:
    """Find the minima of a record as `multistart`, once for all that ask about it."""
    return multistart(problem, limits)


MOVING_DRAWS, STILL_DRAWS = (600, 5), (300, 3)
"""Random draws of rows, and rows of each, for moving and for still targets."""

MOST_SCORED = 240
"""Rows that score the draws."""

COARSE_RAD = np.radians(3.0)
"""Error of a bearing that the scores of draws allow beside its deviation."""

KEPT_DRAWS = 10


def subset_starts(problem: Problem, limits: SearchBounds) -> FloatArray:
    """Return starts from bearings that cross, best first, in solver coordinates.

    Each row has at most one bearing.
    """
    stream, row = np.nonzero(problem.bearing_weight)
    if row.size < 2:
        return start_grid(problem, limits)
    draw = np.random.default_rng(1)
    node = problem.track.now[row]
    time = problem.track.time_s[node]
    place = np.stack([problem.track.east_m[node], problem.track.north_m[node]], -1)
    angle = problem.bearing_rad[0][stream, row]
    other = angle
    if problem.array_heading_rad is not None:
        heading = problem.array_heading_rad[row]
        other = np.where(np.isnan(heading), angle, 2.0 * heading - angle)
    deviation = 1.0 / problem.bearing_weight[stream, row]
    if problem.offset_std_rad is not None:
        deviation = np.hypot(deviation, problem.offset_std_rad[stream])
    deviation = np.hypot(deviation, COARSE_RAD)
    state = np.concatenate(
        [
            _crossings(draw, (time, place, angle, other), *MOVING_DRAWS, moving=True),
            _crossings(draw, (time, place, angle, other), *STILL_DRAWS, moving=False),
        ]
    )
    few = np.unique(np.linspace(0, row.size - 1, MOST_SCORED).astype(int))
    away = (
        state[:, :2, np.newaxis] + state[:, 2:, np.newaxis] * time[few] - place[few].T[np.newaxis]
    )
    model = np.arctan2(away[:, 0], away[:, 1])
    off = np.minimum(np.abs(wrap_rad(model - angle[few])), np.abs(wrap_rad(model - other[few])))
    score = np.minimum((off / deviation[few]) ** 2, 9.0).sum(1)
    q = np.clip(from_state(state), limits.lower, limits.upper)
    return q[_apart(q, np.argsort(score), 5.0 * SAME, KEPT_DRAWS)]


def _apart(q: FloatArray, order: IntArray, reach: FloatArray, count: int) -> list[int]:
    """Return the first few motions in an order of which none is in reach of another."""
    chosen: list[int] = []
    for index in order:
        apart = q[chosen] - q[index]
        apart[:, 1] = wrap_rad(apart[:, 1])
        if not np.any(np.all(np.abs(apart) < reach, axis=1)):
            chosen.append(int(index))
        if len(chosen) == count:
            break
    return chosen


def _crossings(
    draw: np.random.Generator,
    rows: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    count: int,
    size: int,
    *,
    moving: bool,
) -> FloatArray:
    """Solve n.(x + t v - s) = 0 for random draws of rows: (x, y, vx, vy) of each."""
    time, place, angle, other = rows
    chosen = draw.integers(0, time.size, (count, size))
    side = draw.random((count, size)) < 0.5
    bearing = np.where(side, angle[chosen], other[chosen])
    normal = np.stack([np.cos(bearing), -np.sin(bearing)], -1)
    right = (normal * place[chosen]).sum(-1)
    unknown = 4 if moving else 2
    span = max(float(np.ptp(time)), 1.0)
    matrix = np.concatenate([normal, normal * time[chosen][..., np.newaxis] / span], -1)
    matrix = matrix[..., :unknown]
    turned = np.swapaxes(matrix, 1, 2)
    normal_matrix = turned @ matrix + 1e-9 * np.eye(unknown)
    found = np.linalg.solve(normal_matrix, turned @ right[..., np.newaxis])[..., 0]
    state = np.zeros((count, 4))
    state[:, :unknown] = found
    state[:, 2:] /= span
    return state


def block_averages(problem: Problem) -> Problem:
    """Gather consecutive rows of one record into blocks.

    The value of a block is placed on its central row: bearings and frequencies
    change nearly in proportion to time within a block.
    """
    n = problem.n_rows
    heading = problem.array_heading_rad
    is_mixed = heading is not None and bool(np.isnan(heading).any())
    if n <= 2 * BLOCKS or is_mixed:
        return problem
    edges = np.linspace(0, n, BLOCKS + 1).astype(np.int64)
    centre = (edges[:-1] + edges[1:]) // 2
    reduced = problem.rows(centre)
    robust = problem.loss != "squares"
    bearing: FloatArray = problem.bearing_rad[0]
    period: FloatArray = np.ones((1, 1))
    if heading is not None:  # the cosine, put back on the starboard side
        period = _cosine_periods(problem)
        bearing = np.cos(bearing - heading) * 2.0 * np.pi / period
        period = period[:, centre]
    angle, angle_weight = _gather(
        bearing, problem.bearing_weight, edges, robust=robust, circular=True
    )
    if reduced.array_heading_rad is not None:
        cosine = np.clip(wrap_rad(angle) * period / (2.0 * np.pi), -1.0, 1.0)
        angle = np.arccos(cosine) + reduced.array_heading_rad
    frequency, frequency_weight = _gather(
        problem.frequency_hz[0], problem.frequency_weight, edges, robust=robust
    )
    return replace(
        reduced,
        bearing_rad=angle[np.newaxis],
        bearing_weight=angle_weight,
        cone_std_rad=None,
        frequency_hz=frequency[np.newaxis],
        frequency_weight=frequency_weight,
    )


UNIQUE_COSINE = 4.0
"""Distance of lobes that never come into view."""


def _cosine_periods(problem: Problem) -> FloatArray:
    """Return the distance of an array's lobes in the cosine, shape (streams, rows)."""
    shape = problem.bearing_weight.shape
    lobes = problem.lobe_cosine
    return np.full(shape, UNIQUE_COSINE) if lobes is None else np.minimum(lobes, UNIQUE_COSINE)


def _gather(
    data: FloatArray, weight: FloatArray, edges: IntArray, *, robust: bool, circular: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Average (or take the median of) every block; weights are those of means."""
    power = np.add.reduceat(weight**2, edges[:-1], axis=1)
    reference = np.zeros_like(data)
    if circular:
        turned = np.add.reduceat(weight**2 * np.exp(1j * data), edges[:-1], axis=1)
        reference = np.repeat(np.angle(turned), np.diff(edges), axis=1)
        offset = wrap_rad(data - reference)
    else:
        offset = data
    if robust:
        middle = _block_medians(np.where(weight > 0, offset, np.nan), edges)
    else:
        total = np.add.reduceat(weight**2 * offset, edges[:-1], axis=1)
        middle = total / np.where(power > 0, power, 1.0)
    return reference[:, edges[:-1]] + middle, np.sqrt(power)


def _block_medians(data: FloatArray, edges: IntArray) -> FloatArray:
    """Median of the measured values of each block; 0 where there is none."""
    longest = int(np.diff(edges).max())
    index = edges[:-1, np.newaxis] + np.arange(longest)
    outside = index >= edges[1:, np.newaxis]
    cells = data[:, np.minimum(index, data.shape[1] - 1)]
    cells = np.sort(np.where(outside, np.nan, cells), axis=-1)  # nan sorts last
    count = np.count_nonzero(~np.isnan(cells), axis=-1)
    low = np.maximum((count - 1) // 2, 0)[..., np.newaxis]
    high = (count // 2)[..., np.newaxis]
    high = np.minimum(high, longest - 1)
    pair = np.take_along_axis(cells, low, -1) + np.take_along_axis(cells, high, -1)
    return np.where(count > 0, pair[..., 0] / 2.0, 0.0)


def start_grid(problem: Problem, limits: SearchBounds) -> FloatArray:
    """Lay a grid over range, bearing, speed and course, in solver coordinates."""
    low, high = limits.lower[0], limits.upper[0]
    ranges = np.exp(low + (high - low) * (np.arange(RANGES) + 0.5) / RANGES)
    speeds = limits.upper[2] * (np.arange(SPEEDS) + 0.5) / SPEEDS
    courses = 2.0 * np.pi * np.arange(COURSES) / COURSES
    axes = np.meshgrid(ranges, first_bearings(problem), speeds, courses, indexing="ij")
    return from_motion(*(axis.ravel() for axis in axes)).reshape(-1, 4)


MOST_LOBES, IN_VIEW, MOST_COSINE = 20, 0.05, 0.9995
"""Lobes to each side, and the share of their distance by which one may lie beyond the
axis and still be in view: noise carries it there."""


def first_bearings(problem: Problem) -> FloatArray:
    """Return the candidates for the bearing at time zero, rad.

    A straight line through the first bearings gives it; an array that does not
    resolve the side has two for each of its lobes; without bearings a ring of them must do.
    """
    heard = (problem.bearing_weight > 0).any(0)
    rows = np.flatnonzero(heard)[: max(4, problem.n_rows // 10)]
    if rows.size < 2:
        return 2.0 * np.pi * np.arange(BEARINGS) / BEARINGS
    weight = problem.bearing_weight[:, rows] ** 2
    heading = problem.array_heading_rad
    if heading is not None and np.isnan(heading[rows]).any():
        heading = None
    angle = problem.bearing_rad[0][:, rows]
    if heading is not None:  # the lines that have the fewest lobes
        period = np.where(weight > 0, _cosine_periods(problem)[:, rows], 0.0)
        stream = period.max(1).argmax()
        apart = float(period[stream].max())
        weight = np.where(period > 0.9 * apart, weight, 0.0)
        rows, weight = rows[weight.any(0)], weight[:, weight.any(0)]
        angle = problem.bearing_rad[0][:, rows]
        angle = np.cos(angle - heading[rows]) * 2.0 * np.pi / apart
    reference = np.median(np.angle((weight * np.exp(1j * angle)).sum(0)))
    offset = wrap_rad(angle - reference)
    middle = (weight * offset).sum(0) / weight.sum(0)
    if problem.loss == "squares" and rows.size > 1:
        start = np.polyfit(problem.row_time_s[rows], middle, 1)[1]
    else:
        start = np.median(middle)
    guess = reference + start
    if heading is None:
        return np.array([guess])
    lobe = guess * apart / (2.0 * np.pi) + apart * np.arange(-MOST_LOBES, MOST_LOBES + 1)
    # a line through noisy cones may begin beyond the axis
    farthest = max(1.0 + IN_VIEW * apart, float(np.abs(lobe).min()))
    lobe = np.clip(lobe[np.abs(lobe) <= farthest], -MOST_COSINE, MOST_COSINE)
    seen = np.arccos(lobe)
    return np.concatenate([heading[rows[0]] + seen, heading[rows[0]] - seen])


def _best_of_each_range(problem: Problem, grid: FloatArray, count: int) -> FloatArray:
    """Choose good starts, but some from every range and bearing."""
    r = residuals(problem, grid)
    value = loss_value(r.bearing, problem.loss).sum((1, 2))
    value += loss_value(r.frequency, problem.loss).sum((1, 2))
    value += r.prior_value(problem)
    groups = value.reshape(-1, SPEEDS * COURSES)
    share = max(1, count // (2 * groups.shape[0]))
    firsts = np.argsort(groups, axis=1)[:, :share]
    per_group = firsts + SPEEDS * COURSES * np.arange(groups.shape[0])[:, np.newaxis]
    overall = np.argsort(value)[: count // 2]
    chosen = np.unique(np.concatenate([per_group.ravel(), overall]))
    return np.asarray(grid[chosen])


def _distinct(fit: DescentResult, count: int) -> FloatArray:
    """Keep the best of those minima that lie apart and could matter.

    A minimum of the blocks far above the best is no mode of all data either; the
    margin grows where even the best fits the blocks badly.
    """
    margin = fit.value.min() + HOPELESS
    order = np.argsort(fit.value)
    order = order[fit.value[order] <= fit.value.min() + margin]
    return fit.q[_apart(fit.q, order, SAME, count)]
