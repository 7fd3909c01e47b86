"""Frames of sound to one-sided power density and active intensity.

**Method.** Hann window with the scale to density in it, zero padding, one real
transform per frame and channel, a few frames at a time so that they stay in the cache.

**References.** Welch 1967 for the density; D'Spain et al. 1991 for the intensity.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.window import hann

CACHED_SAMPLES = 1 << 16
"""Samples transformed at once: they and their spectra stay in the cache."""

STRIP_ROWS = 256
"""Samples of all channels that are transposed at once."""


class DirectionalDensity(NamedTuple):
    """What omni and dipole channels tell, each of shape (frame, frequency)."""

    power: FloatArray
    """Power density of the omni channel."""
    first: FloatArray
    """Real cross density of the omni channel and the first dipole."""
    second: FloatArray
    """Real cross density of the omni channel and the second dipole."""


@dataclass(frozen=True)
class FrameTransform:
    """How sound is cut into frames; lengths in samples after decimation."""

    rate_hz: float
    """Sample rate after decimation, Hz."""
    decimation: int
    """Factor by which the sample rate was reduced."""
    window: int
    """Length of the analysis window."""
    hop: int
    """Distance of two frames."""
    fft_length: int
    """Length of the transform."""
    kept: slice
    """Cells that are returned."""

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequency of every cell kept, Hz."""
        return np.fft.rfftfreq(self.fft_length, 1.0 / self.rate_hz)[self.kept]

    def power(self, channel: FloatArray, n_frames: int) -> FloatArray:
        """Return the power density of a channel, shape (frame, frequency), float32."""
        out = np.empty((n_frames, self.frequency_hz.size), np.float32)
        for rows, spectrum in self.spectra(channel, n_frames):
            kept = spectrum[:, self.kept]
            np.add(kept.real**2, kept.imag**2, out=out[rows])
        return self._one_sided(out)

    def intensity(self, channels: FloatArray, n_frames: int) -> DirectionalDensity:
        """Return power density and the real cross densities of omni and dipoles.

        Samples of these have the shape (sample, 3).
        """
        shape = (n_frames, self.frequency_hz.size)
        out = [np.empty(shape, np.float32) for _ in range(3)]
        parts = [self.spectra(channels[:, k], n_frames) for k in range(3)]
        for (rows, omni), *dipoles in zip(*parts, strict=True):
            first = omni[:, self.kept]
            for k, spectrum in enumerate([omni, *(d[1] for d in dipoles)]):
                other = spectrum[:, self.kept]
                cross = (first.real * other.real, first.imag * other.imag)
                np.add(*cross, out=out[k][rows])
        return DirectionalDensity(*(self._one_sided(part) for part in out))

    def spectra(
        self, channel: FloatArray, n_frames: int
    ) -> Iterator[tuple[slice, NDArray[np.complex64]]]:
        """Return rows of frames and their spectra, scaled to the root of density."""
        window = hann(self.window)
        scale = 2.0 / (self.rate_hz * float(np.sum(window**2)))
        window = np.asarray(window * np.sqrt(scale), np.float32)
        return windowed_spectra(channel, window, self.hop, self.fft_length, n_frames)

    def spectra_of_all(self, samples: FloatArray, n_frames: int) -> NDArray[np.complex64]:
        """Return the cells kept of all channels, shape (cell, channel, frame)."""
        shape = (self.frequency_hz.size, samples.shape[1], n_frames)
        found = np.empty(shape, np.complex64)
        for number, channel in enumerate(_transposed(samples)):
            for rows, part in self.spectra(channel, n_frames):
                found[:, number, rows] = part[:, self.kept].T
        return found

    def _one_sided(self, density: FloatArray) -> FloatArray:
        """Halve what has no mirror image: zero and the Nyquist frequency."""
        if self.kept.start == 0:
            density[:, 0] *= np.float32(0.5)
        last = self.fft_length // 2 + 1
        if self.kept.stop == last and self.fft_length % 2 == 0:
            density[:, -1] *= np.float32(0.5)
        return density


def windowed_spectra(
    channel: FloatArray, window: FloatArray, hop: int, fft_length: int, n_windows: int
) -> Iterator[tuple[slice, NDArray[np.complex64]]]:
    """Yield rows of windows and their spectra, as many at once as the cache holds."""
    from scipy.fft import rfft

    view = np.lib.stride_tricks.sliding_window_view(channel, window.size)
    at_once = max(1, CACHED_SAMPLES // fft_length)
    for first in range(0, n_windows, at_once):
        rows = slice(first, min(first + at_once, n_windows))
        chosen = view[rows.start * hop : rows.stop * hop : hop]
        windowed = chosen[: rows.stop - first] * window
        yield rows, np.asarray(rfft(windowed, fft_length), np.complex64)


def lost_samples(samples: FloatArray, window: int, hop: int, n_windows: int) -> IntArray:
    """Return how many samples of each window are nan in any channel."""
    if not np.isnan(np.min(samples)):  # quick, and nearly always so
        return np.zeros(n_windows, np.int64)
    before = np.concatenate([[0], np.cumsum(np.isnan(samples).any(axis=1))])
    first = np.arange(n_windows) * hop
    lost: IntArray = before[first + window] - before[first]
    return lost


def _transposed(values: FloatArray) -> FloatArray:
    """Copy the transpose of a matrix a strip of rows at a time, which stay in the cache."""
    found = np.empty(values.shape[::-1], values.dtype)
    for first in range(0, len(values), STRIP_ROWS):
        strip = slice(first, first + STRIP_ROWS)
        found[:, strip] = values[strip].T
    return found
