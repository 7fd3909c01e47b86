"""The image of time and log frequency in which interference draws its fringes.

**Method.** The density of each frame is averaged over cells of a constant part of an
octave, edges counting by the part of a bin within, and over frames until a row is as long
as is wanted. In decibels, the straight line over log frequency that fits a row best is
taken off, and the rest is kept in steps of a quarter decibel: the noise of a cell is ten
times coarser.

**Conventions.** Cells begin at the lower edge of the band and end where the next one
would reach beyond the upper one, or beyond `HIGHEST_SHARE` of the sample rate. Where they
are narrower than a bin, neighbours share it. Rows count absolute frames, so blocks have
no influence; one that lacks samples has no sound.

**References.** Chuprov (1982); Brekhovskikh and Lysanov, Fundamentals of Ocean Acoustics,
section 6.7: a pattern of f R^-beta shifts along log frequency as the range changes.
"""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.fringes import MIDDLE, STEP_DB, Fringes
from uwtrack_cli.data.options import Above, AtLeast, AtMost, Increasing, Unit, checked
from uwtrack_cli.data.spectra import Spectrogram

HIGHEST_SHARE = 0.44
"""Share of the sample rate above which recorders filter."""

LEAST_VALID = 0.99
"""Least share of valid samples of a frame that counts."""


@checked
def measure_fringes(
    blocks: Iterator[Spectrogram],
    *,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(1), AtMost(1e6), Increasing()] = (
        100.0,
        7000.0,
    ),
    cells_per_octave: Annotated[int, AtLeast(8), AtMost(256)] = 64,
    average_s: Annotated[float, Unit("s"), Above(0), AtMost(60)] = 0.5,
    least_highest_hz: Annotated[float, Unit("Hz"), AtLeast(0), AtMost(1e6)] = 0.0,
) -> Iterator[Fringes]:
    """Compute the image that shows the interference fringes of a passing vessel.

    Parameters
    ----------
    blocks
        Blocks of a spectrogram of half a second or so.
    band_hz
        Lowest and highest frequency, Hz; cut to what the spectrogram holds.
    cells_per_octave
        Cells of an octave.
    average_s
        Time that a row is averaged over, s; rounded up to whole frames, but for a hundredth
        of one: half windows of odd rates are no whole part of a second.
    least_highest_hz
        Highest frequency, Hz, that the band must reach in the recording: one that ends
        lower shows too few fringes, and gives rows without cells.

    Returns
    -------
    Iterator[Fringes]
        One block per block read, of whole rows. A spectrogram that holds nothing of the
        band gives rows without cells.

    Raises
    ------
    OptionError
        An option is out of range.
    """
    cells: _Cells | None = None
    rest = np.zeros((0, 0), np.float32)
    rest_time = np.zeros(0)
    for block in blocks:
        if cells is None:
            cells = _cells(block, band_hz, cells_per_octave, least_highest_hz)
            rest = np.zeros((0, cells.middle_hz.size), np.float32)
        per_row = max(1, int(np.ceil(average_s / block.frames.hop_s - 0.01)))
        time = np.concatenate([rest_time, block.frames.time_s])
        power = np.concatenate([rest, _cell_density(block, cells)])
        whole = time.size - time.size % per_row
        yield _rows(block, cells, time[:whole], power[:whole], per_row)
        rest_time, rest = time[whole:], power[whole:]


class _Cells(NamedTuple):
    """Where the cells lie among the bins."""

    middle_hz: FloatArray
    """Middle of each cell, shape (cell,)."""
    pairs: IntArray
    """First and last bin of each, one after the other, shape (2 cell,)."""
    below: FloatArray
    """Part of the first bin that lies below the cell, shape (cell,)."""
    above: FloatArray
    """Part of the last bin that lies above it."""
    width: FloatArray
    """Width, in bins."""


def _cells(
    block: Spectrogram, band_hz: tuple[float, float], per_octave: int, least_highest_hz: float
) -> _Cells:
    frequency, frames = block.frequency_hz, block.frames
    step_hz = float(frequency[1] - frequency[0])
    low = max(band_hz[0], float(frequency[0]) + 0.5 * step_hz)
    high = min(
        band_hz[1], float(frequency[-1]) - 0.5 * step_hz, HIGHEST_SHARE * frames.sample_rate_hz
    )
    count = 0
    if high > low and high >= least_highest_hz:
        count = int(np.floor(per_octave * np.log2(high / low)))
    edges = low * 2.0 ** (np.arange(count + 1) / per_octave)
    # in bins; one reaches half a step to either side of its middle
    at = (edges - frequency[0]) / step_hz + 0.5
    first, last = at[:-1].astype(np.int64), at[1:].astype(np.int64)
    return _Cells(
        np.sqrt(edges[:-1] * edges[1:]), np.stack([first, last], axis=1).ravel(),
        np.asarray(at[:-1] - first, np.float32),
        np.asarray(last + 1 - at[1:], np.float32),
        np.asarray(at[1:] - at[:-1], np.float32),
    )  # fmt: skip


def _cell_density(block: Spectrogram, cells: _Cells) -> FloatArray:
    """Return the mean density of each cell, shape (frame, cell); nan without sound."""
    if not cells.middle_hz.size:
        return np.zeros((block.frames.n_frames, 0), np.float32)
    density = block.power_density
    first, last = cells.pairs[::2], cells.pairs[1::2]
    # bins from the first to the one before the last, which is added by its part
    total = np.where(first == last, 0.0, np.add.reduceat(density, cells.pairs, axis=1)[:, ::2])
    total = total - cells.below * density[:, first]
    total += (1.0 - cells.above) * density[:, last]
    lacks = block.frames.valid_fraction < LEAST_VALID
    total[lacks] = np.nan
    return np.asarray(np.maximum(total / cells.width, 0.0), np.float32)


def _rows(
    block: Spectrogram, cells: _Cells, time_s: FloatArray, density: FloatArray, per_row: int
) -> Fringes:
    """Average whole rows of frames, and take their lines off."""
    count = time_s.size // per_row
    n_cells = cells.middle_hz.size
    mean = density.reshape(count, per_row, n_cells).mean(axis=1, dtype=np.float64)
    octave = np.log2(cells.middle_hz)
    octave = octave - octave.mean() if n_cells else octave
    with np.errstate(divide="ignore", invalid="ignore"):
        level = 10.0 * np.log10(mean)
        row_level = level.sum(axis=1) / max(n_cells, 1)
        slope = (level * octave).sum(axis=1) / max(float((octave**2).sum()), 1e-9)
        height = level - row_level[:, None] - slope[:, None] * octave
    has_sound = np.isfinite(row_level) & (n_cells > 0)
    shade = np.clip(np.round(height / STEP_DB) + MIDDLE, 1, 255)
    return Fringes(
        time_s=time_s.reshape(count, per_row).mean(axis=1),
        frequency_hz=cells.middle_hz,
        shade=np.where(has_sound[:, None], shade, 0).astype(np.uint8),
        level_db=np.where(has_sound, row_level, np.nan),
        slope_db=np.where(has_sound, slope, np.nan),
        average_s=per_row * block.frames.hop_s,
        bin_hz=1.0 / block.frames.window_s,
        reference=block.reference,
        sensor=block.frames.sensor,
        start_utc_ns=block.frames.start_utc_ns,
    )
