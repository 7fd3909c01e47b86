"""A small picture of the spectrogram that every later file can carry.

**Method.** Max-pooling: a pixel is the strongest cell that it covers, so that a thin
line survives. Rows are pooled by twice as many frames whenever there are too many, at
positions that count from the first frame, so blocks have no influence.
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.options import AtLeast, AtMost, checked
from uwtrack_cli.data.spectra import Overview, Spectrogram

SPAN_DB = 60.0
"""Range of levels below the strongest pixel that the 256 shades cover at most."""


@checked
def pool_overview(
    blocks: Iterator[Spectrogram], *, max_pixels: Annotated[int, AtLeast(16), AtMost(4096)] = 1024
) -> Iterator[Overview]:
    """Pool a spectrogram into a small picture.

    Parameters
    ----------
    blocks
        Blocks of a spectrogram.
    max_pixels
        Largest number of rows and of columns.

    Returns
    -------
    Iterator[Overview]
        An empty block per block read, and the picture at the end.

    Raises
    ------
    OptionError
        ``max_pixels`` is out of range.
    """
    rows = np.zeros((0, 0), np.float32)
    frames_per_row, n_frames = 1, 0
    last: Spectrogram | None = None
    for block in blocks:
        last = block.take("frame", slice(-1, None))
        pooled = _pool_columns(block.power_density, max_pixels)
        if not rows.size:
            rows = np.zeros((0, pooled.shape[1]), np.float32)
        rows = _add(rows, pooled, n_frames, frames_per_row)
        n_frames += pooled.shape[0]
        while rows.shape[0] > max_pixels:
            rows = np.maximum.reduceat(rows, np.arange(0, len(rows), 2), axis=0)
            frames_per_row *= 2
        yield _overview(last, rows[:0], 1, max_pixels)
    if last is not None:
        yield _overview(last, rows, frames_per_row, max_pixels)


def _pool_columns(power: FloatArray, max_pixels: int) -> FloatArray:
    """Maximum over groups of columns; by strides, which is faster than reduceat."""
    group = -(-power.shape[1] // max_pixels)
    pooled = power[:, ::group].copy()
    for shift in range(1, group):
        other = power[:, shift::group]
        np.maximum(pooled[:, : other.shape[1]], other, out=pooled[:, : other.shape[1]])
    return pooled


def _add(rows: FloatArray, new: FloatArray, n_before: int, frames_per_row: int) -> FloatArray:
    if not new.shape[0]:  # a block without frames: the sound is too short for one
        return rows
    row_of = (n_before + np.arange(new.shape[0])) // frames_per_row
    starts = np.flatnonzero(np.diff(row_of, prepend=-1))
    pooled = np.maximum.reduceat(new, starts, axis=0)
    if row_of[0] < rows.shape[0]:  # the row before is not full yet
        pooled[0] = np.maximum(pooled[0], rows[-1])
        rows = rows[:-1]
    return np.concatenate([rows, pooled])


def _overview(
    last: Spectrogram, rows: FloatArray, frames_per_row: int, max_pixels: int
) -> Overview:
    frames = last.frames
    group = -(-last.frequency_hz.size // max_pixels)
    first = last.frequency_hz[::group]
    middle_frame = (np.arange(rows.shape[0]) + 0.5) * frames_per_row - 0.5
    with np.errstate(divide="ignore"):
        level_db = 10 * np.log10(rows)
    known = level_db[np.isfinite(level_db)]
    ceiling = float(known.max()) if known.size else 0.0
    floor = max(float(np.quantile(known, 0.02)), ceiling - SPAN_DB) if known.size else -1.0
    floor = min(floor, ceiling - 1.0)
    shade = np.clip((level_db - floor) / (ceiling - floor), 0.0, 1.0) * 255.0
    return Overview(
        time_s=middle_frame * frames.hop_s + frames.window_s / 2,
        frequency_hz=first + (group - 1) * frames.bin_hz / 2,
        shade=np.round(shade).astype(np.uint8),
        floor_db=floor,
        ceiling_db=ceiling,
        reference=last.reference,
        sensor=frames.sensor,
    )
