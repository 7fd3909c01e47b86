"""The surroundings of one line, with finer cells than a spectrogram has.

**Method.** The sound is turned down by a frequency and decimated by moving sums (three
in a row: a cascaded integrator-comb filter), first all lines together, then each by
itself: a few operations for a sample, where the low pass of `decimation`, flatter than a
picture needs, takes dozens. Of what is left, Hann-windowed frames are transformed. Sound is read in blocks,
so memory does not grow with the sample rate.

**References.** Hogenauer (1981), IEEE Trans. Acoust. Speech Signal Process. 29, 155.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Recording

STAGES = 3
"""Moving sums in a row: sound that folds into the band is 70 dB down or more."""

GUARD = 10.0
"""Rate after decimation, in half widths of the band that is kept."""

BLOCK_SAMPLES = 1 << 21
"""Samples that are read at once."""

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
    rate = recording.sample_rate_hz
    highest = max((w.frequency_hz + w.half_hz for w in windows), default=rate)
    shared = max(1, int(rate / (GUARD * highest)))
    start_s = max(0.0, span_s[0])
    sound, first_s = _decimated_sound(recording, start_s, span_s[1], shared)
    return [_zoomed(sound, first_s, rate / shared, window) for window in windows]


def _decimated_sound(
    recording: Recording, start_s: float, stop_s: float, factor: int
) -> tuple[FloatArray, float]:
    """Read the sound at a lower rate; also the time of its first sample."""
    rate = recording.sample_rate_hz
    reach = (STAGES - 1) * factor if factor > 1 else 0
    step = BLOCK_SAMPLES // factor * factor
    first = round(start_s * rate)
    last = min(round(stop_s * rate), recording.n_samples)
    parts = []
    for begin in range(first, last, step):
        end = min(begin + step + reach, last)
        block = recording.stretch(begin / rate, end / rate)[:, 0]
        parts.append(decimate(np.nan_to_num(block), factor))
    delay = STAGES * (factor - 1) / 2 / rate
    return np.concatenate(parts or [np.zeros(0)]), first / rate + delay


def decimate(sound: NDArray[np.number], factor: int) -> NDArray[np.number]:
    """Return every so many-th value of three moving means in a row, shape (n,)."""
    if factor == 1:
        return sound
    kernel = np.ones(1)
    for _ in range(STAGES):
        kernel = np.convolve(kernel, np.full(factor, 1.0 / factor))
    taps = np.zeros(STAGES * factor)
    taps[: kernel.size] = kernel
    rows = sound[: sound.size // factor * factor].reshape(-1, factor)
    count = max(0, rows.shape[0] - STAGES + 1)
    kept = np.zeros(count, np.result_type(sound.dtype, np.float32))
    for number, part in enumerate(taps.reshape(STAGES, factor)):
        kept += rows[number : number + count] @ part.astype(rows.real.dtype)
    return kept


def _zoomed(sound: FloatArray, first_s: float, rate_hz: float, window: Window) -> Zoom:
    time = np.arange(sound.size) / rate_hz
    turned = sound * np.exp(-2j * np.pi * window.frequency_hz * time)
    factor = max(1, int(rate_hz / (GUARD * window.half_hz)))
    narrow = decimate(turned, factor)
    rate = rate_hz / factor
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
    delay = STAGES * (factor - 1) / 2 / rate_hz
    middle = (np.arange(level.shape[0]) * hop + (length - 1) / 2 - length // 2) / rate
    return Zoom(first_s + delay + middle, offset[inside], level)
