"""The surroundings of one line, with finer cells than a spectrogram has.

**Method.** The sound is turned down by a frequency and slowed down to the width of the band
that is kept (`estimation/narrow_bands`). Of what is left, Hann-windowed frames are
transformed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.estimation.decimation import decimated_stretch, usual_decimation
from uwtrack_cli.estimation.narrow_bands import NarrowBand, narrow_bands

WIDER = 1.25
"""Width that is cut out, in widths of the band that is kept."""

OVERSAMPLED = 4
"""Cells of the transform for one of the frame."""

OVERLAP = 0.8
"""Share of a frame that the next one repeats."""


@dataclass(frozen=True, eq=False)
class Zoom:
    """Levels about a frequency over time."""

    time_s: FloatArray
    """Middles of the frames, s from the first sample, shape (frame,)."""
    offset_hz: FloatArray
    """Frequencies less that of the line, Hz, shape (cell,)."""
    level_db: FloatArray
    """Levels over the median of all cells, dB, shape (frame, cell)."""


@dataclass(frozen=True)
class Window:
    """What is cut out of the sound."""

    frequency_hz: float
    """Its middle, Hz."""
    half_hz: float
    """Half its width, Hz."""
    frame_s: float
    """Length of a frame, s."""


def zoom(
    recording: Recording, span_s: tuple[float, float], windows: Sequence[Window]
) -> list[Zoom]:
    """Return fine spectrograms of narrow bands of a stretch of sound, s.

    Of several channels the first one is taken. One for each band; without frames where
    the stretch is shorter than one.

    Raises
    ------
    DataError
        The sound is not at hand.
    """
    if not windows:
        return []
    centre_hz = np.array([window.frequency_hz for window in windows])
    half_hz = WIDER * np.array([window.half_hz for window in windows])
    factor = usual_decimation(
        recording.sample_rate_hz, float((centre_hz + half_hz).max()), least_rate_hz=0.0
    )
    sound, rate_hz, start_s = decimated_stretch(recording, *span_s, factor)
    bands = narrow_bands(sound, rate_hz, centre_hz, half_hz)
    return [
        _zoomed(band, start_s, window)
        for band, window in zip(bands, windows, strict=True)
    ]


def _zoomed(band: NarrowBand, first_s: float, window: Window) -> Zoom:
    narrow, rate = band.sound, band.rate_hz
    length = max(8, round(window.frame_s * rate))
    transform = OVERSAMPLED * length
    offset = np.fft.fftshift(np.fft.fftfreq(transform, 1 / rate))
    inside = np.abs(offset) <= window.half_hz
    empty = np.zeros((0, int(inside.sum())))
    if narrow.size < length:
        return Zoom(np.zeros(0), offset[inside], empty)
    hop = max(1, round((1 - OVERLAP) * length))
    padded = np.pad(narrow, length // 2)  # so that the first frame is about its begin
    frames = np.lib.stride_tricks.sliding_window_view(padded, length)[::hop]
    spectra = np.fft.fft(frames * np.hanning(length), transform, axis=1)
    power = np.abs(np.fft.fftshift(spectra, axes=1)[:, inside]) ** 2
    floor = np.median(power[power > 0]) if power.any() else 1.0
    level: FloatArray = 10 * np.log10(np.maximum(power, 1e-12 * floor) / floor)
    middle = (np.arange(level.shape[0]) * hop + (length - 1) / 2 - length // 2) / rate
    return Zoom(first_s + middle, offset[inside], level)
