"""Coloured Gaussian noise that can be made tile by tile and joins without a seam.

**Method.** White noise comes in tiles of fixed length, each from a generator of its
own, seeded by (seed, stream, tile). A linear-phase filter, designed by sampling the
wanted density and windowing, is applied by overlap-save: the last samples of one tile
go before the next. A sequence can be made at a multiple of the rate of its white
noise (for interpolation): the spectrum is then repeated, as zero-stuffing does.

**Conventions.** Densities are one-sided, uPa^2/Hz. A tile and its predecessor's tail
fit a transform of `TRANSFORM` samples.

**References.** A. V. Oppenheim, R. W. Schafer, Discrete-Time Signal Processing,
sections 7.5 (window design) and 8.7 (overlap-save).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.simulate.scenario import Noise

Array = NDArray[np.float64]
Density = Callable[[Array], Array]

TRANSFORM = 16384
TAIL = 1024
TILE = TRANSFORM - TAIL
"""Samples in a tile: the unit in which everything is made, whatever is asked for."""


def ambient_density(noise: Noise, frequency_hz: Array) -> Array:
    """Return the density of the ambient noise, uPa^2/Hz."""
    held = np.maximum(frequency_hz, noise.corner_hz)
    decades = np.log10(held / noise.reference_hz)
    level_db = noise.density_db + noise.slope_db_per_decade * decades
    density = np.asarray(10.0 ** (level_db / 10.0))
    for feature in noise.features:
        density = density * feature.gain(frequency_hz)
    return density


def white_tile(seed: int, stream: tuple[int, ...], tile: int) -> Array:
    """Return a tile of unit white noise; tiles count from -1."""
    generator = np.random.default_rng([seed, *stream, tile + 1])
    return generator.standard_normal(TILE)


def shaping_filter(
    density: Density, sample_rate_hz: float, multiple: int = 1
) -> NDArray[np.complex128]:
    """Return the spectrum of the filter that gives unit white noise a density.

    The filter has ``TAIL * multiple + 1`` taps at ``multiple`` times the sample rate.
    """
    size = TRANSFORM * multiple
    step = sample_rate_hz * multiple / size
    frequency = step * np.arange(size // 2 + 1.0)
    gain = multiple * np.sqrt(0.5 * sample_rate_hz * density(frequency))
    taps = np.roll(np.fft.irfft(gain, size), TAIL * multiple // 2)
    taps = taps[: TAIL * multiple + 1] * np.hanning(TAIL * multiple + 3)[1:-1]
    return np.fft.rfft(taps, size)


def delayed_filters(
    density: Density, sample_rate_hz: float, delays_s: Array
) -> NDArray[np.complex128]:
    """Return spectra of the filter of `shaping_filter` with delays of its middle.

    ``density``: one-sided density, uPa^2/Hz, at frequencies in Hz. ``sample_rate_hz``:
    sample rate, Hz. ``delays_s``: delays, s, shape (delay,), small against the length
    of the filter.

    Returned: array, shape (delay, frequency); one spectrum per delay, ``TAIL + 1`` taps
    each.
    """
    frequency = sample_rate_hz / TRANSFORM * np.arange(TRANSFORM // 2 + 1.0)
    gain = np.sqrt(0.5 * sample_rate_hz * density(frequency))
    taper = np.hanning(TAIL + 3)[1:-1]
    found = np.empty((delays_s.size, frequency.size), np.complex128)
    for row, delay_s in enumerate(delays_s):
        turned = gain * np.exp(-2j * np.pi * frequency * delay_s)
        taps = np.roll(np.fft.irfft(turned, TRANSFORM), TAIL // 2)[: TAIL + 1]
        found[row] = np.fft.rfft(taps * taper, TRANSFORM)
    return found


def white_spectrum(
    seed: int, stream: tuple[int, ...], tile: int
) -> NDArray[np.complex128]:
    """Return the spectrum of a tile of white noise with the tail of the one before."""
    before = white_tile(seed, stream, tile - 1)[-TAIL:]
    return np.fft.rfft(np.concatenate([before, white_tile(seed, stream, tile)]))


@dataclass
class NoiseGenerator:
    """A stream of coloured tiles, asked for in any order (cheapest in sequence)."""

    seed: int
    """Seed of the scenario."""
    stream: tuple[int, ...]
    """Numbers that tell this stream from others."""
    spectrum: NDArray[np.complex128]
    """Spectrum of the shaping filter."""
    multiple: int = 1
    """Rate of the samples over that of the white noise."""

    def __post_init__(self) -> None:
        """Start with an empty store of white noise."""
        self._tail: tuple[int, Array] | None = None

    def tile(self, number: int) -> Array:
        """Return ``TILE * multiple`` samples of the tile (counted from 0)."""
        if self._tail is None or self._tail[0] != number - 1:
            before = white_tile(self.seed, self.stream, number - 1)[-TAIL:]
        else:
            before = self._tail[1]
        white = white_tile(self.seed, self.stream, number)
        self._tail = (number, white[-TAIL:].copy())
        spectrum = np.fft.rfft(np.concatenate([before, white]))
        repeated = _repeat(spectrum, self.multiple) * self.spectrum
        coloured = np.fft.irfft(repeated, TRANSFORM * self.multiple)
        return coloured[TAIL * self.multiple :]


def _repeat(spectrum: NDArray[np.complex128], multiple: int) -> NDArray[np.complex128]:
    """Return the one-sided spectrum of the sequence with zeros stuffed between."""
    if multiple == 1:
        return spectrum
    whole = np.concatenate([spectrum, np.conj(spectrum[-2:0:-1])])
    periods = np.concatenate([whole] * (multiple // 2) + [whole[:1]])
    return np.asarray(periods)
