"""The density of noise peaks along frequency and time, over the nominal one.

**Method.** Noise is not white everywhere: its peaks are denser beside a band edge, in a
whistle or in the frame of a click. The lasting density is averaged per resolution over
many frames and summed over the neighbourhood of each, itself left out, so that a line
that is not yet known does not stand against itself. The momentary density follows from
the number of peaks in the frame.

**Conventions.** Excess is the logarithm of the density over the nominal one, 0 or more.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.lines.tracking.track_management import NOISE_PEAKS_PER_CELL

NEAR_CELLS = 16
"""Resolutions to either side that make a neighbourhood."""

OWN_CELLS = 2
"""Resolutions to either side that may be a line's own."""

AVERAGED_FRAMES = 128
"""Frames over which the lasting density is averaged."""

PRIOR_FRAMES = 24
"""Frames that the nominal density is worth at the start."""

MOMENT_FRAMES = 16
"""Frames over which the usual number of free peaks in a frame is averaged."""

RENEWAL_FRAMES = 8
"""Frames from one renewal of the lasting density to the next."""


class ClutterDensity:
    """Follows the density of the peaks that belong to no line."""

    def __init__(self, frames: Frames, peaks: Peaks) -> None:
        self.lowest_hz = peaks.lowest_hz
        self.per_hz = frames.window_s
        n_cells = int((peaks.highest_hz - peaks.lowest_hz) * frames.window_s) + 1
        self.nominal = NOISE_PEAKS_PER_CELL * peaks.kept_probability
        self.density = np.full(n_cells, self.nominal)
        self.lasting = np.zeros(n_cells)
        self.fresh: list[FloatArray] = []
        self.watched = 0
        self.usual = 0.0
        self.n_claimed = 0

    def excess(self, frequency_hz: FloatArray) -> FloatArray:
        """Return how much denser noise peaks are than nominal at some frequencies."""
        count = float(frequency_hz.size - self.n_claimed)
        usual = max(self.usual if self.usual > 0.0 else count, 1.0)
        surplus = count - usual
        sudden = float(np.log1p(surplus / usual)) if surplus > 3.0 * usual**0.5 else 0.0
        return self.lasting[self._cells(frequency_hz)] + sudden

    def watch(self, frequency_hz: FloatArray, n_peaks: int) -> None:
        """Take note of a frame's free peaks, out of all its peaks."""
        count = frequency_hz.size
        self.n_claimed = n_peaks - count
        if self.usual == 0.0:
            self.usual = float(count)
        self.usual += (count - self.usual) / MOMENT_FRAMES
        self.fresh.append(frequency_hz)
        if len(self.fresh) == RENEWAL_FRAMES:
            self._renew()

    def _renew(self) -> None:
        cells = self._cells(np.concatenate(self.fresh))
        self.fresh.clear()
        self.watched += RENEWAL_FRAMES
        n_averaged = min(PRIOR_FRAMES + self.watched, AVERAGED_FRAMES)
        counts = np.bincount(cells, minlength=self.density.size)
        self.density += (counts - RENEWAL_FRAMES * self.density) / n_averaged
        total = np.append(0.0, np.cumsum(self.density))
        wide, n_wide = _window_sum(total, NEAR_CELLS)
        own, n_own = _window_sum(total, OWN_CELLS)
        n_around = np.maximum(n_wide - n_own, 1)
        around = (wide - own) / n_around
        # less what chance adds to the density of so few peaks
        around -= np.sqrt(np.maximum(around, self.nominal) / (n_around * n_averaged))
        self.lasting = np.log(np.maximum(around / self.nominal, 1.0))

    def _cells(self, frequency_hz: FloatArray) -> IntArray:
        cell = ((frequency_hz - self.lowest_hz) * self.per_hz).astype(np.int64)
        return np.minimum(np.maximum(cell, 0), self.density.size - 1)


def _window_sum(total: FloatArray, half: int) -> tuple[FloatArray, IntArray]:
    """Sum and number of the cells within ``half`` of each, from the running sum."""
    cell = np.arange(total.size - 1)
    low = np.maximum(cell - half, 0)
    high = np.minimum(cell + half + 1, cell.size)
    return total[high] - total[low], high - low
