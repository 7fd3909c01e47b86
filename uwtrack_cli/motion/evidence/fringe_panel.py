"""The image of fringes as numbers: averaged in time, with the noise of its cells measured.

**Method.** Shades are power again, averaged over rows, and logarithms of that: averaging
before the logarithm loses nothing where a cell has few degrees of freedom. The variance
of a cell is that of differences of consecutive rows, by their median, so that neither
fringes nor swells count; what neighbouring cells share (a window's bins, cells narrower
than a bin) is measured from the same differences, and makes each cell count for less.
Cells that vary more than those about them hold lines, and hardly count.

**Conventions.** Values are nepers of power. Cells count from the lowest; a row without
sound is left out.

**References.** The median of chi-square with one degree of freedom is 0.4549.
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.fringes import MIDDLE, STEP_DB, Fringes

NEPERS = float(np.log(10.0) / 10.0)
"""Nepers of power of a decibel."""

POWER = np.exp((np.arange(256) - MIDDLE) * STEP_DB * NEPERS).astype(np.float32)
"""Power of each shade."""

MEDIAN_SQUARE = 0.4549
"""Median of a squared normal deviate."""

FEWEST_ROWS = 8
"""Rows of a panel at least: fewer know no noise."""

VARIANCE_CELLS, SHARED_CELLS, FARTHEST_LAG = 9, 31, 6
"""Cells among which a variance is a median, those over which correlations are averaged,
and the farthest neighbours that are asked. All are chosen."""


ANY_BEND = 1e5
"""Variance of what rows bend by that leaves it free (`Panel.bend`)."""

LINE_SWING, LEFT_OUT = 9.0, 1e-4
"""How many times a cell's variance over time is that of its neighbours where it holds a
line, which comes and goes in its place, and what such cells and the next ones count."""


class Panel(NamedTuple):
    """An image of log power over time and log frequency."""

    time_s: FloatArray
    """Middle of each row, s, shape (row,)."""
    value: FloatArray
    """Log power, nepers, shape (row, cell)."""
    precision: FloatArray
    """What an independent cell would weigh as much as each of these, shape (cell,)."""
    step_s: float
    """Time from one row to the next, s."""
    cell: float
    """Step of the logarithm of frequency from one cell to the next."""
    bend: float = ANY_BEND
    """Prior variance of what each row bends by over log frequency, beside level and slope,
    over the variance that noise gives it."""

    def near(self, time_s: float, reach_s: float) -> "Panel":
        """Return the rows within a reach of a time, s."""
        rows = np.abs(self.time_s - time_s) <= reach_s
        return self._replace(time_s=self.time_s[rows], value=self.value[rows])


def panel_of(fringes: Fringes, step_s: float, cells: int = 1) -> Panel | None:
    """Return the panel of rows and cells averaged in power; None where it is too small.

    Parameters
    ----------
    fringes
        The image.
    step_s
        Time that a row is averaged over, s, at most; one of the image at least.
    cells
        Neighbouring cells that are averaged.
    """
    per_row = max(1, int(step_s / fringes.average_s + 1e-6))
    count = fringes.time_s.size // per_row
    width = fringes.frequency_hz.size // cells
    if count < FEWEST_ROWS or width < FARTHEST_LAG * 8:
        return None
    size = count * per_row
    shade = fringes.shade[:size, : width * cells]
    is_heard = (fringes.shade[:size, 0] > 0).reshape(count, per_row)
    has_sound: BoolArray = np.asarray(is_heard.all(axis=1))
    value = np.empty((count, width), np.float32)
    strip = max(1, 4096 // per_row)
    for first in range(0, count, strip):  # flat memory, whatever the length
        part = shade[first * per_row : (first + strip) * per_row]
        power = POWER[part].reshape(-1, per_row, width, cells)
        value[first : first + strip] = np.log(power.mean(axis=(1, 3)))
    if np.count_nonzero(has_sound) < FEWEST_ROWS:
        return None
    time_s = fringes.time_s[:size].reshape(count, per_row).mean(axis=1)
    return Panel(
        time_s[has_sound], value[has_sound], _precision(value[has_sound]),
        per_row * fringes.average_s,
        cells * float(np.log(fringes.frequency_hz[1] / fringes.frequency_hz[0])),
    )  # fmt: skip


def _precision(value: FloatArray) -> FloatArray:
    """Return the precision of each cell, its neighbours' share taken into account."""
    swing = value.var(axis=0)
    has_line = swing > LINE_SWING * _running(swing, SHARED_CELLS, np.median)
    has_line = np.convolve(has_line, np.ones(3), "same") > 0.0
    steps = np.diff(value, axis=0)
    spread = np.median(steps**2, axis=0) / (2.0 * MEDIAN_SQUARE)
    variance = _running(np.maximum(spread, 1e-6), VARIANCE_CELLS, np.median)
    steps = np.clip(steps / np.sqrt(2.0 * variance), -4.0, 4.0)
    shared = np.ones(variance.size)
    for lag in range(1, FARTHEST_LAG + 1):
        both = (steps[:, lag:] * steps[:, :-lag]).mean(axis=0)
        both = _running(np.pad(both, (0, lag), "edge"), SHARED_CELLS, np.mean)
        shared += 2.0 * np.maximum(both, 0.0)
    return np.asarray(np.where(has_line, LEFT_OUT, 1.0) / (variance * shared))


def _running(values: FloatArray, size: int, middle: object) -> FloatArray:
    """Return the middle of so many neighbours; at the ends those of the first or last."""
    views = np.lib.stride_tricks.sliding_window_view(values, min(size, values.size))
    place = np.clip(np.arange(values.size) - size // 2, 0, len(views) - 1)
    return np.asarray(middle(views, axis=-1)[place])  # type: ignore[operator]
