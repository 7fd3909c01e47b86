"""Levels of the sound in decidecade bands, second by second.

**Method.** The power density is summed over each band; cells at the edges count by the
part that lies within. Rows are means of mean squares over whole frames, at positions that
count from the first frame, so blocks have no influence.

**Conventions.** Bands are those of base ten, 1000 Hz times powers of 10^(1/10), with
edges half a step to either side. Bands that the spectrogram does not hold as a whole, or
that are narrower than its resolution, are left out. Frames that lack samples are not
counted.

**References.** IEC 61260-1 (2014), section 5; ISO 18405 (2017), 3.1.4.2 (decidecade).
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.decidecades import Decidecades
from uwtrack_cli.data.options import Above, AtMost, Unit, checked
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.window import NOISE_BANDWIDTH_BINS

REFERENCE_HZ = 1000.0
LEAST_VALID = 0.99
"""Least share of valid samples of a frame that counts."""


@checked
def measure_decidecades(
    blocks: Iterator[Spectrogram],
    *,
    average_s: Annotated[float, Unit("s"), Above(0), AtMost(3600)] = 1.0,
) -> Iterator[Decidecades]:
    """Measure the levels in decidecade bands along time.

    Parameters
    ----------
    blocks
        Blocks of a spectrogram.
    average_s
        Time that a row is averaged over, in s; rounded up to whole frames.

    Returns
    -------
    Iterator[Decidecades]
        One block per block read, and what is left at last.

    Raises
    ------
    DataError
        The spectrogram holds no decidecade band as a whole.
    OptionError
        ``average_s`` is out of range.
    """
    edges: FloatArray | None = None
    rest_time, rest = np.zeros(0), np.zeros((0, 0))
    last: Spectrogram | None = None
    for block in blocks:
        if edges is None:
            edges = band_edges(block)
            rest = np.zeros((0, edges.shape[0]))
        last = block.take("frame", slice(0))
        time = np.concatenate([rest_time, block.frames.time_s])
        power = np.concatenate([rest, _band_power(block, edges)])
        per_row = _frames_per_row(last, average_s)
        whole = time.size - time.size % per_row
        yield _rows(last, edges, time[:whole], power[:whole], per_row)
        rest_time, rest = time[whole:], power[whole:]
    if last is not None and edges is not None:
        per_row = _frames_per_row(last, average_s)
        yield _rows(last, edges, rest_time, rest, per_row)


def band_edges(block: Spectrogram) -> FloatArray:
    """Return the edges of the bands that a spectrogram holds, shape (band, 2), Hz.

    Raises
    ------
    DataError
        It holds none.
    """
    frames, frequency = block.frames, block.frequency_hz
    resolution_hz = NOISE_BANDWIDTH_BINS / frames.window_s
    half_hz = 0.5 * (frequency[1] - frequency[0])
    low, high = frequency[0] - half_hz, frequency[-1] + half_hz
    number = np.arange(-40, 31)
    centre = REFERENCE_HZ * 10.0 ** (number / 10.0)
    edges = centre[:, None] * 10.0 ** (np.array([-0.5, 0.5]) / 10.0)
    is_whole = (edges[:, 0] >= low) & (edges[:, 1] <= high)
    edges = edges[is_whole & (np.diff(edges)[:, 0] >= resolution_hz)]
    if not edges.size:
        raise DataError(
            f"the spectrogram reaches from {frequency[0]:g} to {frequency[-1]:g} Hz at a "
            f"resolution of {resolution_hz:g} Hz: it holds no decidecade band."
        )
    return np.asarray(edges)


def _band_power(block: Spectrogram, edges: FloatArray) -> FloatArray:
    """Return the mean square in each band, shape (frame, band); nan without samples."""
    frequency = block.frequency_hz
    step_hz = frequency[1] - frequency[0]
    # edges in cells; a cell reaches half a step to either side of its centre
    at = (edges - frequency[0]) / step_hz + 0.5
    first, last = at[:, 0].astype(int), np.minimum(at[:, 1], frequency.size - 1e-6)
    last = last.astype(int)
    pairs = np.stack([first, last], axis=1).ravel()
    total = np.add.reduceat(block.power_density, pairs, axis=1)[:, ::2]
    density = block.power_density
    below = (at[:, 0] - first) * density[:, first]
    above = (at[:, 1] - last) * density[:, last]
    power = (total - below + above) * step_hz
    return np.where(block.frames.valid_fraction[:, None] >= LEAST_VALID, power, np.nan)


def _frames_per_row(block: Spectrogram, average_s: float) -> int:
    return max(1, int(np.ceil(average_s / block.frames.hop_s - 1e-6)))


def _rows(
    block: Spectrogram, edges: FloatArray, time_s: FloatArray, power: FloatArray, per_row: int
) -> Decidecades:
    """Average frames to rows; the last row may be of fewer frames."""
    starts = np.arange(0, time_s.size, per_row)
    known = np.isfinite(power)

    def sums(values: FloatArray | BoolArray) -> FloatArray:
        if not starts.size:
            return np.zeros((0, *values.shape[1:]))
        return np.asarray(np.add.reduceat(values, starts, axis=0, dtype=float))

    count = sums(known)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = sums(np.where(known, power, 0.0)) / count
        level_db = 10.0 * np.log10(mean)
    return Decidecades(
        time_s=sums(time_s) / sums(np.ones(time_s.size)),
        centre_hz=np.sqrt(edges[:, 0] * edges[:, 1]),
        level_db=level_db,
        average_s=per_row * block.frames.hop_s,
        reference=block.reference,
        sensor=block.frames.sensor,
        start_utc_ns=block.frames.start_utc_ns,
    )
