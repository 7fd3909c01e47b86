"""How high paths score in the noise of the recording itself, where no line can be.

**Method.** The table of `trace_threshold` is that of white noise. A floor that is low by
a tenth of a decibel gives three times as many false lines, and where it is low only the
recording can tell. So each window is searched once more, its frames shifted along
frequency by random steps that no line can make: what is steady is smeared, and what the
noise has in one place, or at one time, too much of stays. Lines that were found, and the
best path in each block of the band, which may be a line that was not, are replaced by
what is beside them before. What the best paths through the shifted frames score more than in
white noise is the excess of their block, a mean over the windows so far that is drawn to
nothing while they are few. Thresholds are raised by it.

**Conventions.** Scores in nepers, shape (frame, cell); blocks of 16 natural bins. The
shifts are drawn from the number of the window's first frame: the same sound gives the
same lines.

**References.** Theiler et al., "Testing for nonlinearity in time series: the method of
surrogate data", Physica D 58, 77-94 (1992); Efron and Morris (1975) for the shrinkage.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.lines.paths.path_search import MOVE_PENALTY, PathSearch, best_scores, trace_back

BLOCK_BINS = 16
"""Natural bins of a block: those of a tile of the noise floor."""

SHIFT_BINS = 4
"""Natural bins by which a frame is shifted at most, to either side."""

LEAST_STEP_BINS = 2
"""Natural bins between the shifts of neighbouring frames, at least: paths make half."""

PATH_BINS = 2.0
"""Natural bins to either side of a block's best path that are replaced."""

PRIOR_WINDOWS = 5.0
"""Windows that the absence of any excess is worth before any is seen."""


def surrogate_scores(search: PathSearch, cells_per_bin: int, seed: int) -> FloatArray:
    """Return the best scores of paths that no line can take, one for each block.

    Cells beyond the last whole block are in none. The seed is that of the shifts.
    """
    rng = np.random.default_rng([seed])
    n_frames, n_cells = search.scores.shape
    width = block_cells(n_cells, cells_per_bin)
    last = search.total[: n_cells // width * width].reshape(-1, width).argmax(axis=1)
    best = trace_back(search.moves, last + width * np.arange(last.size)).T
    half = round(PATH_BINS * cells_per_bin)
    near = np.clip(best[..., None] + np.arange(-half, half + 1), 0, n_cells - 1)
    replaced = search.is_masked
    np.put_along_axis(replaced, near.reshape(n_frames, -1), True, axis=1)
    noise = _filled(search.scores, replaced)
    widest = min(SHIFT_BINS * cells_per_bin, n_cells - 1)
    shift = _shifts(rng, n_frames, widest, LEAST_STEP_BINS * cells_per_bin)
    # beyond the ends the band is mirrored
    padded = np.pad(noise, ((0, 0), (widest, widest)), mode="reflect")
    from_cell = (widest + shift)[:, None] + np.arange(n_cells)
    shifted = np.take_along_axis(padded, from_cell, axis=1)
    total, _ = best_scores(shifted, MOVE_PENALTY)
    scores: FloatArray = total[: last.size * width].reshape(-1, width).max(axis=1)
    return scores


def block_cells(n_cells: int, cells_per_bin: int) -> int:
    """Return the width of a block in cells."""
    return min(BLOCK_BINS * cells_per_bin, n_cells)


def _filled(values: FloatArray, is_replaced: BoolArray) -> FloatArray:
    """Put into each gap of a frame the cells that follow it, gaps left out.

    So neighbours are as alike as neighbours are.
    """
    free_first = np.argsort(is_replaced, axis=1, kind="stable")
    before = np.cumsum(~is_replaced, axis=1)
    cell = np.arange(values.shape[1])
    last_free = np.maximum.accumulate(np.where(is_replaced, -1, cell), axis=1)
    order = np.where(is_replaced, before + cell - last_free - 1, before - 1)
    most = np.maximum(before[:, -1:] - 1, 0)
    source = np.take_along_axis(free_first, np.minimum(order, most), axis=1)
    return np.take_along_axis(values, source, axis=1)


def _shifts(rng: np.random.Generator, n_frames: int, widest: int, least_step: int) -> IntArray:
    """Draw shifts evenly, of which no two neighbours are near each other."""
    shift = np.empty(n_frames, dtype=np.int64)
    places = np.arange(-widest, widest + 1)
    last = 0
    for frame, share in enumerate(rng.random(n_frames)):
        free = places[np.abs(places - last) >= min(least_step, widest)]
        last = shift[frame] = int(free[int(share * free.size)])
    return shift


class RecordingNoise:
    """Gathers what paths score in the noise of a recording, block by block of its band."""

    def __init__(self, n_cells: int, cells_per_bin: int) -> None:
        self.n_cells = n_cells
        self.width = block_cells(n_cells, cells_per_bin)
        self.total = np.zeros(n_cells // self.width)
        self.passed = np.zeros_like(self.total)
        self.windows = 0
        self.slope = 1.0

    def note(self, scores: FloatArray, white: float, slope: float) -> FloatArray:
        """Enter the scores of a window; return what its thresholds are raised by.

        Scores, nepers, are those of the paths that no line can take, shape (block,),
        ``white`` their mean in white noise, and ``slope`` the nepers by which noise
        paths become rarer by e. The excess has the shape (cell,).
        """
        self.total += scores - white
        self.windows += 1
        self.slope = slope
        raised = np.maximum(self._excess(), 0.0)
        self.passed += np.exp(-raised / slope)
        cells = np.repeat(raised, self.width)
        return np.pad(cells, (0, self.n_cells - cells.size), mode="edge")

    def relative_rate(self) -> float:
        """Return the rate of false lines over the stated one; nan if not measured.

        By all that was heard in the end, at the thresholds as they were raised.
        """
        if not self.windows:
            return float("nan")
        passed = np.exp(self._excess() / self.slope) * self.passed / self.windows
        return float(passed.mean())

    def _excess(self) -> FloatArray:
        return self.total / (self.windows + PRIOR_WINDOWS)
