"""Narrow bands of a stretch of sound, each turned down to zero and slowed down to its width.

**Method.** Frames whose windows add up to one are transformed, the cells of each band are
cut out, tapered at their edges, transformed back by themselves, and added up again: one
pass over the sound for any number of bands, in frames of a length that does not depend on
that of the stretch.

**Conventions.** A tone of amplitude A at the centre of a band becomes the constant
A exp(j phase). Bands reach to both sides of their centre; the outer `TAPER` of each
side falls off to nothing.

**References.** Allen & Rabiner (1977), Proc. IEEE 65, 1558 (overlap and addition of
short-time spectra).
"""

from collections.abc import Iterable
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.window import hann

TAPER = 0.1
"""Share of each side of a band that is tapered."""

FRAME_CELLS = 64
"""Cells of a frame to either side of the centre of the narrowest band."""


class NarrowBand(NamedTuple):
    """The sound about one frequency, turned down by it."""

    centre_hz: float
    """The frequency, Hz."""
    rate_hz: float
    """Samples per second: the width of the band, to a cell."""
    sound: NDArray[np.complex64]
    """Samples, the first at the begin of the stretch, shape (n,)."""


def narrow_bands(
    blocks: Iterable[FloatArray], rate_hz: float, centre_hz: FloatArray, half_hz: FloatArray
) -> list[NarrowBand]:
    """Cut bands out of sound that comes in blocks.

    Parameters
    ----------
    blocks
        Consecutive samples, shape (n,); none may be nan.
    rate_hz
        Samples per second.
    centre_hz, half_hz
        Centre and half width of each band, Hz, shape (band,).
    """
    from scipy.fft import rfft

    cuts = FRAME_CELLS * rate_hz / float(half_hz.min())
    size = 1 << max(4, int(np.ceil(np.log2(cuts))))
    hop, window = size // 2, hann(size).astype(np.float32)
    bands = [
        _Band(size, round(centre * size / rate_hz), max(1, round(half * size / rate_hz)))
        for centre, half in zip(centre_hz, half_hz, strict=True)
    ]
    pending, n_samples = np.zeros(hop, np.float32), -size  # less the silence at last
    for block in chain(blocks, [np.zeros(size, np.float32)]):
        n_samples += block.size
        pending = np.concatenate([pending, block])
        while pending.size >= size:
            spectrum = rfft(pending[:size] * window)
            for band in bands:
                band.add(spectrum)
            pending = pending[hop:]
    return [
        band.whole(float(centre), rate_hz, n_samples)
        for band, centre in zip(bands, centre_hz, strict=True)
    ]


class _Band:
    """A band that is cut out of one frame after the other."""

    def __init__(self, size: int, centre: int, half: int) -> None:
        self._size, self._centre, self._half = size, centre, half
        cells = np.arange(-half, half)
        self._inside = (centre + cells > 0) & (centre + cells <= size // 2)
        self._cells = (centre + cells)[self._inside]
        taper = np.minimum(1.0, (half - np.abs(cells + 0.5)) / (TAPER * half))
        # of a real sound half of a tone is at its frequency; the other half is cut off
        self._weight = (4.0 * half / size * taper).astype(np.float32)
        self._parts: list[NDArray[np.complex64]] = []
        self._late: NDArray[np.complexfloating] = np.zeros(half, np.complex64)

    def add(self, spectrum: NDArray[np.complex64]) -> None:
        """Add the next frame, half a frame after the one before it."""
        part = np.zeros(2 * self._half, np.complex64)
        part[self._inside] = spectrum[self._cells]
        made = np.fft.ifft(np.fft.ifftshift(part * self._weight))
        if self._centre % 2 and len(self._parts) % 2 == 0:  # half a frame of odd turns
            made = -made
        self._parts.append((self._late + made[: self._half]).astype(np.complex64))
        self._late = made[self._half :]

    def whole(self, centre_hz: float, rate_hz: float, n_samples: int) -> NarrowBand:
        """Return what came of so many samples, turned down by the very frequency."""
        own_hz = rate_hz * 2 * self._half / self._size
        # the first frame begins half its length before the sound
        sound = np.concatenate([*self._parts[1:], np.zeros(0, np.complex64)])
        sound = sound[: n_samples * 2 * self._half // self._size]
        off_hz = centre_hz - self._centre * rate_hz / self._size
        turn = np.exp(-2j * np.pi * off_hz / own_hz * np.arange(sound.size))
        return NarrowBand(centre_hz, own_hz, (sound * turn).astype(np.complex64))
