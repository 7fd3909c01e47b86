"""Coloured Gaussian noise that can be made tile by tile and joins without a seam.

**Method.** White noise comes in tiles of fixed length, each from a generator of its
own, seeded by (seed, stream, tile). A linear-phase filter, designed by sampling the
wanted density and windowing, is applied by overlap-save: the last samples of one tile
go before the next. A sequence can be made at a multiple of the rate of its white
noise (for interpolation): the spectrum is then repeated, as zero-stuffing does.

Isotropic noise at an array is a sum of plane waves from directions whose cosines with
the array are the nodes of a Gauss-Legendre rule, with its weights as powers: the mean
over all directions of a sphere is the mean over that cosine, and a rule of M nodes is
exact for phases up to about 2 M radians across the array. An array of another shape
takes as many waves around as twice the nodes, for every node of the rule. Each wave is
a stream of noise of its own, delayed to every hydrophone by its shaping filter. A
hydrophone's own noise (flow, electronics) is white and shared with no other.

**Conventions.** Densities are one-sided, uPa^2/Hz. A tile and its predecessor's tail
fit a transform of `TRANSFORM` samples.

Pressure in uPa. A delay shifts the middle of the filter, whose taper
ends well beyond it. The array is taken as straight: noise has no turn to follow.

**References.** A. V. Oppenheim, R. W. Schafer, Discrete-Time Signal Processing,
sections 7.5 (window design) and 8.7 (overlap-save); H. Cox, Spatial correlation in arbitrary noise fields, J. Acoust. Soc.
Am. 54 (1973): the field as a superposition of plane waves.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.scenario import Noise, Scenario

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


def white_spectrum(seed: int, stream: tuple[int, ...], tile: int) -> NDArray[np.complex128]:
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


PLACED = {
    "density_db", "reference_hz", "slope_db_per_decade", "corner_hz", "features",
    "drift", "swell",
}  # fmt: skip
"""Parts of the noise that an array hears; the others have no direction along it."""

SPARE_NODES = 8
"""Nodes beyond those that the aperture needs."""

LONGEST_DELAY = TAIL // 8
"""Samples by which a filter may be delayed before its taper cuts it."""


class ArrayNoise:
    """The ambient noise at all hydrophones of an array, tile by tile in sequence.

    ``number``: number of the array among the sensors.

    Raises
    ------
    OptionError
        The noise has parts that are not simulated for arrays, or the array is too long
        for its sample rate.
    """

    def __init__(self, scenario: Scenario, noise: Noise, number: int) -> None:
        plan, rate = scenario.sensors[number], scenario.sample_rate_hz
        parts = [f.name for f in fields(noise) if f.name not in PLACED]
        other = [name for name in parts if getattr(noise, name)]
        if other:
            raise OptionError(
                f"noise.{other[0]} is not simulated for arrays ({plan.id}); leave it "
                f"out, or use a sensor of another kind."
            )
        self._seed = scenario.seed
        self._number = number
        places_m = np.array(plan.element_places)
        places_m = places_m - places_m.mean(axis=0)
        radius_m = float(np.linalg.norm(places_m, axis=1).max())
        crossing_s = 2.0 * radius_m / scenario.sound_speed_mps
        if crossing_s * rate > 2 * LONGEST_DELAY:
            raise OptionError(
                f"sound crosses {plan.id} in {crossing_s * rate:.0f} samples; the noise "
                f"of an array is simulated up to {2 * LONGEST_DELAY}: lower the rate."
            )
        n_nodes = int(np.ceil(0.5 * np.pi * rate * crossing_s)) + SPARE_NODES
        directions, weights = _plane_waves(n_nodes, is_line=bool(plan.element_along_m))
        delays_s = -(places_m @ directions.T) / scenario.sound_speed_mps
        filters = delayed_filters(lambda f: ambient_density(noise, f), rate, delays_s.ravel())
        scaled = filters.reshape(*delays_s.shape, -1) * np.sqrt(0.5 * weights)[:, None]
        self._filters: NDArray[np.complex64] = np.ascontiguousarray(
            np.moveaxis(scaled, -1, 0), np.complex64
        )
        self._own: list[NoiseGenerator] = []
        if plan.element_noise_db is not None:
            density = 10.0 ** (plan.element_noise_db / 10.0)
            white = shaping_filter(lambda f: np.full_like(f, density), rate)
            self._own = [
                NoiseGenerator(scenario.seed, (110, number, k), white) for k in range(len(places_m))
            ]

    def tile(self, number: int) -> Array:
        """Return a tile of pressure, shape (sample, hydrophone), uPa."""
        waves = np.stack(
            [
                white_spectrum(self._seed, (111, self._number, wave), number)
                for wave in range(self._filters.shape[2])
            ],
            axis=-1,
        )
        heard = np.einsum("fem,fm->fe", self._filters, waves, optimize=False)
        found = np.fft.irfft(heard, TILE + TAIL, axis=0)[TAIL:]
        for element, own in enumerate(self._own):
            found[:, element] += own.tile(number)
        return np.asarray(found)


def _plane_waves(n_nodes: int, *, is_line: bool) -> tuple[Array, Array]:
    """Return directions that fill the sphere, shape (wave, 3), and their weights."""
    cosines, weights = np.polynomial.legendre.leggauss(n_nodes)
    turn = np.zeros(1) if is_line else np.pi / n_nodes * np.arange(2 * n_nodes)
    sine = np.sqrt(1.0 - cosines**2)
    around = np.stack(
        [
            np.outer(sine, np.sin(turn)),
            np.repeat(cosines[:, None], turn.size, axis=1),
            np.outer(sine, np.cos(turn)),
        ],
        axis=-1,
    )
    return around.reshape(-1, 3), np.repeat(weights / turn.size, turn.size)
