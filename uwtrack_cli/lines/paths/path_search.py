"""Find all lines in a window: best paths one after another, each masked when found.

**Method.** A path visits one cell per frame and moves at most one cell per frame. Its
score is the sum of the cells' log-likelihood ratios "steady line against noise"
minus a penalty per move. For every last cell the best path is found by the Viterbi
recursion, all cells at once; the way back is kept as one byte per cell. Paths above the
threshold that share nothing are accepted together; their cells are masked as wide as they leak, and
the search is repeated until nothing is left. The part of a path that holds the line
is the interval with the greatest sum of log-likelihood ratios "line against the noise that
a path finds".

**Conventions.** Scores in nepers, shape (frame, cell); paths are cells by frame.

**References.** Streit & Barrett, "Frequency line tracking using hidden Markov
models", IEEE Trans. ASSP 38(4), 586-598 (1990), for the recursion; Rice (1945) for the
amplitude of a steady line in noise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.noise_floor import EDGE_STEP, SMALLEST, TILE_BINS
from uwtrack_cli.lines.paths.trace_threshold import PathScores
from uwtrack_cli.lines.paths.trace_window import WindowData
from uwtrack_cli.lines.sensitivity import amplitude_log_ratio

Steps = NDArray[np.int8]
"""Move into each cell on its best path: -1, 0 or 1, shape (frame, cell)."""

DESIGN_SNR = 1.5
"""Power ratio of the line looked for, in its cell."""

MOVE_PENALTY = float(np.log(8.0))
"""Cost of a move by one cell, in nepers."""

MOST_SCORE = 4.0
"""Cap on a cell's score: a click in two overlapping frames must not be a line."""

_MOST_PASSES = 12
_MOST_ENDS = 256
_MASKED = -2.0
"""Score of masked cells: paths may cross them, and do not gain by it."""

_STRONG = 20.0
"""Power ratio above which the loudest cell is surely the line's."""

_LOUD = 6.0
"""Power ratio to which cells are limited when the noise's shape is sought."""

_SHAPE_BINS = 16
"""Bins to either side over which the noise's shape is a median."""

_TRIAL_SNRS = (0.3, 0.6, 1.2, 2.5, 5.0, 10.0, 20.0, 50.0)
"""Power ratios tried when the ends of a line are sought."""

PATH_NOISE = 1.1
"""Mean power over noise along what a path goes on through when its line has ended: it
chooses louder cells. `studies/constants/line_ends.py` has the ends with other values."""

END_GAIN = 6.0
"""Log-likelihood ratio, in nepers, with which the frames before or after a line must speak
against it to be left out (same script)."""

_BRIDGE_MOVES, _BRIDGE_CELLS = 0.5, 8
"""Least moves per frame, and cells in all, by which a path crosses from line to line."""

_SHARED = 0.2
"""Share of common frames beyond which two paths are one."""


@dataclass(frozen=True)
class FoundPath:
    """A path and the interval of frames in which the line was."""

    cells: IntArray
    """Cell in every frame of the window, shape (frame,)."""
    first: int
    """First frame with the line."""
    stop: int
    """Frame after the last one with the line."""
    score: float
    """Score of the whole path, nepers."""


@dataclass(frozen=True)
class PathSearch:
    """What a search has found in a window, and what is left of it."""

    paths: list[FoundPath]
    """The paths that noise does not explain, strongest first."""
    total: FloatArray
    """Score of the best path into each last cell beside them, shape (cell,)."""
    moves: Steps
    """The moves of these paths, shape (frame, cell)."""
    scores: FloatArray
    """Score of each cell, those of the paths that were found masked."""

    @property
    def is_masked(self) -> BoolArray:
        """Cells of the paths that were found, shape (frame, cell)."""
        return self.scores <= _MASKED


def best_scores(score: FloatArray, move_penalty: float) -> tuple[FloatArray, Steps]:
    """Return the score of the best path into each last cell, and the moves.

    Scores have the shape (frame, cell); a move by one cell costs the penalty, nepers.
    """
    n_frames, n_cells = score.shape
    moves = np.zeros((n_frames, n_cells), dtype=np.int8)
    padded = np.full(n_cells + 2, -np.inf, dtype=score.dtype)
    total = padded[1:-1]
    total[:] = score[0]
    side = np.empty(n_cells, dtype=score.dtype)
    is_right = np.empty(n_cells, dtype=bool)
    is_move = np.empty(n_cells, dtype=bool)
    penalty = score.dtype.type(move_penalty)
    for k in range(1, n_frames):
        np.greater(padded[2:], padded[:-2], out=is_right)
        np.maximum(padded[2:], padded[:-2], out=side)
        side -= penalty
        np.greater(side, total, out=is_move)
        # the move that led here: from the cell above (+1) or below (-1)
        moves[k] = is_move * (2 * is_right.view(np.int8) - 1)
        np.maximum(total, side, out=total)
        total += score[k]
    return total.copy(), moves


def trace_back(moves: Steps, last_cells: IntArray) -> IntArray:
    """Return the cells of the best paths to last cells, shape (path, frame)."""
    cells = np.asarray(last_cells, dtype=np.int64)
    path = np.empty((cells.size, moves.shape[0]), dtype=np.int64)
    for k in range(moves.shape[0] - 1, -1, -1):
        path[:, k] = cells
        cells = cells + moves[k, cells]
    return path


def cell_scores(power_ratio: FloatArray) -> FloatArray:
    """Return ln I0(2 sqrt(d y)) - d for power over noise; nan scores 0.

    Beyond the cap the score grows with its logarithm only, just enough for a path to
    stay in the middle of a strong line.
    """
    score = amplitude_log_ratio(power_ratio, np.float32(DESIGN_SNR))
    above = np.maximum(score - np.float32(MOST_SCORE), np.float32(0.0))
    score = np.minimum(score, np.float32(MOST_SCORE)) + 0.5 * np.log1p(above)
    return np.where(np.isfinite(score), score, np.float32(0.0)).astype(np.float32)


def whitened(data: WindowData) -> FloatArray:
    """Return the power over the noise of a window, as even as white noise's."""
    beyond = beyond_outer_tiles(data.even_floor, data.frequency_hz, data.cells_per_bin)
    return whiten(data.power_ratio / beyond, data.cells_per_bin)


def whiten(power_ratio: FloatArray, cells_per_bin: int) -> FloatArray:
    """Divide by what is left of the noise's shape over a whole window.

    The floor behind ``power_ratio`` is smooth over tens of bins. What a window shows
    beyond it, broader than a line, is divided out: the running median along frequency
    of the cells' mean, loud cells limited.
    """
    limited = np.minimum(power_ratio, np.float32(_LOUD))
    is_known = np.isfinite(limited)
    total = np.where(is_known, limited, 0.0).sum(axis=0, dtype=np.float64)
    mean = total / np.maximum(is_known.sum(axis=0), 1)
    half = _SHAPE_BINS * cells_per_bin
    padded = np.pad(mean, half, mode="reflect")
    rows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    shape = np.median(rows, axis=1)
    return np.asarray(power_ratio / np.clip(shape, 0.5, 10.0).astype(np.float32))


def beyond_outer_tiles(
    floor: FloatArray, frequency_hz: FloatArray, cells_per_bin: int
) -> FloatArray:
    """Return by how much noise exceeds its floor beyond the middle of the outer tiles.

    The floor, shape (frame, cell), nan in a gap, is constant there. Noise that rises
    towards the end of the band is taken to rise on by the power law of the two tiles
    next to the end; where it falls, and where the step between the tiles is an edge,
    nothing is known. Factors from one on, shape (cell,).
    """
    width = TILE_BINS * cells_per_bin
    n_tiles = frequency_hz.size // width
    raised = np.zeros(frequency_hz.size)
    known = floor[np.isfinite(floor[:, 0])]
    if n_tiles < 2 or not known.size:
        return np.ones(frequency_hz.size, np.float32)
    centres = np.round((np.arange(n_tiles) + 0.5) * width - 0.5).astype(np.int64)
    log_hz = np.log(frequency_hz)
    for outer, inner, own in (
        (centres[0], centres[1], slice(None, int(centres[0]))),
        (centres[-1], centres[-2], slice(int(centres[-1]), None)),
    ):
        ratio = np.maximum(known[:, outer], SMALLEST) / np.maximum(known[:, inner], SMALLEST)
        step = float(np.log(ratio).mean())
        if 0.0 < step < EDGE_STEP:
            share = (log_hz[own] - log_hz[outer]) / (log_hz[outer] - log_hz[inner])
            raised[own] = step * share
    return np.exp(raised).astype(np.float32)


def find_paths(
    scores: FloatArray,
    power_ratio: FloatArray,
    least: PathScores,
    expected: IntArray,
    cells_per_bin: int,
) -> PathSearch:
    """Find the paths that noise does not explain.

    Scores and power over noise have one shape; ``expected`` are cells in the first
    frame where lines are expected, from the window before.
    """
    left = scores.copy()
    found: list[FoundPath] = []
    total, moves = best_scores(left, MOVE_PENALTY)
    for _ in range(_MOST_PASSES):
        if least.bearing is not None:
            least = least._replace(bearing=least.bearing.without(left <= _MASKED))
        fresh = _accepted(total, moves, least, expected, cells_per_bin)
        if not fresh:
            break
        for path, score in fresh:
            cells = _centred(path, power_ratio, cells_per_bin)
            for own, interval in _lines_along(cells, power_ratio, cells_per_bin):
                first, stop = _own_frames(own, interval, found, cells_per_bin)
                if first < stop:
                    found.append(FoundPath(own, first, stop, score))
                _mask(left, power_ratio, own, cells_per_bin)
        total, moves = best_scores(left, MOVE_PENALTY)
    return PathSearch(found, total, moves, left)


def _lines_along(
    cells: IntArray, power_ratio: FloatArray, cells_per_bin: int
) -> list[tuple[IntArray, tuple[int, int]]]:
    """Return the cells and the frames of the line of a path, or of each of its lines.

    A path that goes from one line to another leaves the one early and meets the other
    late: each is followed straight on into the frames between.
    """

    def along(own: IntArray) -> FloatArray:
        return np.take_along_axis(power_ratio, own[:, None], axis=1)[:, 0]

    parts = line_intervals(along(cells), cells)
    if len(parts) == 1:
        return [(cells, parts[0])]
    lines = []
    earliest = [0, *(stop for _, stop in parts)]
    latest = [*(first for first, _ in parts[1:]), cells.size]
    for (first, stop), least, most in zip(parts, earliest, latest, strict=False):
        own = cells.copy()
        own[least:first], own[stop:most] = cells[first], cells[stop - 1]
        own = _centred(own, power_ratio, cells_per_bin)
        begin, end = line_intervals(along(own)[least:most], own[least:most])[0]
        lines.append((own, (min(least + begin, first), max(least + end, stop))))
    return lines


def _own_frames(
    cells: IntArray, interval: tuple[int, int], found: list[FoundPath], cells_per_bin: int
) -> tuple[int, int]:
    """Return what is left of a path's interval without others' lines at its ends."""
    is_own = np.zeros(cells.size, dtype=bool)
    is_own[slice(*interval)] = True
    for other in found:
        near = np.abs(cells - other.cells)[other.first : other.stop] <= cells_per_bin
        is_own[other.first : other.stop] &= ~near
    own = np.flatnonzero(is_own)
    return (int(own[0]), int(own[-1]) + 1) if own.size else (0, 0)


def _centred(path: IntArray, power_ratio: FloatArray, cells_per_bin: int) -> IntArray:
    """Move a strong line's path to the loudest cell within a bin of it."""
    offset = np.arange(-cells_per_bin, cells_per_bin + 1)
    near = np.clip(path[:, None] + offset, 0, power_ratio.shape[1] - 1)
    power = np.nan_to_num(np.take_along_axis(power_ratio, near, axis=1))
    best = np.take_along_axis(near, power.argmax(axis=1)[:, None], axis=1)[:, 0]
    return np.where(power.max(axis=1) > _STRONG, best, path)


def _accepted(
    total: FloatArray, moves: Steps, least: PathScores, expected: IntArray, cells_per_bin: int
) -> list[tuple[IntArray, float]]:
    """Choose paths above their threshold that share no frames, best first."""
    is_top = np.ones(total.size, dtype=bool)
    is_top[1:] &= total[1:] > total[:-1]
    is_top[:-1] &= total[:-1] >= total[1:]
    bearing, lowest = least.bearing, min(least.new, least.continued)
    if bearing is not None:
        lowest = min(lowest, bearing.least_score)
    ends = np.flatnonzero(is_top & (total > lowest))
    ends = ends[np.argsort(-total[ends], kind="stable")][:_MOST_ENDS]
    paths = trace_back(moves, ends)
    scores = total[ends]
    if bearing is not None:
        scores = scores + bearing.scores(paths)
        order = np.argsort(-scores, kind="stable")
        paths, scores = paths[order], scores[order]
    is_good = scores > least.new
    if expected.size:
        away = np.abs(paths[:, :1] - expected[None, :]).min(axis=1)
        is_good |= (scores > least.continued) & (away <= 2 * cells_per_bin)
    paths, scores = paths[is_good], scores[is_good]
    accepted = []
    while scores.size:
        best = paths[0]
        accepted.append((best, float(scores[0])))
        shared = (np.abs(paths - best) <= 2 * cells_per_bin).mean(axis=1)
        apart = shared <= _SHARED
        paths, scores = paths[apart], scores[apart]
    return accepted


def _mask(scores: FloatArray, power_ratio: FloatArray, cells: IntArray, cells_per_bin: int) -> None:
    """Take a line and what it leaks out of the scores.

    Hann's main lobe is two bins to either side; side lobes fall by 18 dB per octave
    from -31 dB at 2.4 bins on (Harris 1978), so a strong line is masked wider: as if
    they fell by 9 dB.
    """
    at = np.take_along_axis(power_ratio, cells[:, None], axis=1)
    strength = float(np.nanmean(at)) if np.isfinite(at).any() else 1.0
    bins = max(2.5, 2.4 * (strength * 10.0**-3.1) ** (1.0 / 3.0))
    half = int(min(np.ceil(bins * cells_per_bin), scores.shape[1]))
    offset = np.arange(-half, half + 1)
    columns = np.clip(cells[:, None] + offset, 0, scores.shape[1] - 1)
    np.put_along_axis(scores, columns, np.float32(_MASKED), axis=1)


def line_intervals(power_ratio: FloatArray, cells: IntArray) -> list[tuple[int, int]]:
    """Return the frames [first, stop) in which a path holds a line.

    Of the power over noise along the path, nan in a gap, and its cells: one interval,
    or one for each line if the path goes from one to another.

    Notes
    -----
    In every frame a line of some power ratio is compared with the noise that a path
    finds. The interval is that of the greatest sum, over all ratios tried; frames
    before and after it are left out when they are unlikely enough to be the line's.
    So are those between if the path crosses them straight to somewhere else: a line that
    is silent has no course, and one that moves so fast is heard.
    """
    trials = np.array(_TRIAL_SNRS)[:, None]
    gain = amplitude_log_ratio(power_ratio[None, :], trials)
    gain = gain - power_ratio * (1.0 - 1.0 / PATH_NOISE) + np.log(PATH_NOISE)
    gain = np.nan_to_num(gain, nan=0.0)
    ends = [_greatest_sum(row) for row in gain]
    sums = [float(row[a:b].sum()) for row, (a, b) in zip(gain, ends, strict=True)]
    best = int(np.argmax(sums))
    first, stop = ends[best]
    if gain[best, :first].sum() > -END_GAIN:
        first = 0
    if gain[best, stop:].sum() > -END_GAIN:
        stop = power_ratio.size
    return _without_bridges(gain[best], cells, first, stop)


def _without_bridges(
    gain: FloatArray, cells: IntArray, first: int, stop: int
) -> list[tuple[int, int]]:
    """Divide an interval where a path runs through noise from one line to another."""
    low, high = _greatest_sum(-gain[first:stop])
    low, high = first + low, first + high
    moved = abs(int(cells[min(high, stop - 1)] - cells[max(low - 1, first)]))
    is_silent = -gain[low:high].sum() > END_GAIN
    if not (first < low and high < stop and is_silent):
        return [(first, stop)]
    if moved < max(_BRIDGE_MOVES * (high - low), _BRIDGE_CELLS):
        return [(first, stop)]
    return [*_without_bridges(gain, cells, first, low), *_without_bridges(gain, cells, high, stop)]


def _greatest_sum(values: FloatArray) -> tuple[int, int]:
    total = np.concatenate([[0.0], np.cumsum(values, dtype=float)])
    lowest = np.minimum.accumulate(total)
    stop = int(np.argmax(total[1:] - lowest[:-1])) + 1
    return int(np.argmin(total[:stop])), stop
