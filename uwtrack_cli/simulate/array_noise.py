"""Ambient noise at the hydrophones of an array: isotropic, and each one's own.

**Method.** Isotropic noise is a sum of plane waves from directions whose cosines with
the array are the nodes of a Gauss-Legendre rule, with its weights as powers: the mean
over all directions of a sphere is the mean over that cosine, and a rule of M nodes is
exact for phases up to about 2 M radians across the array. An array of another shape
takes as many waves around as twice the nodes, for every node of the rule. Each wave is
a stream of noise of its own, delayed to every hydrophone by its shaping filter. A hydrophone's own
noise (flow, electronics) is white and shared with no other.

**Conventions.** Pressure in uPa. A delay shifts the middle of the filter, whose taper
ends well beyond it. The array is taken as straight: noise has no turn to follow.

**References.** H. Cox, Spatial correlation in arbitrary noise fields, J. Acoust. Soc.
Am. 54 (1973): the field as a superposition of plane waves.
"""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.noise import (
    TAIL,
    TILE,
    NoiseGenerator,
    ambient_density,
    delayed_filters,
    shaping_filter,
    white_spectrum,
)
from uwtrack_cli.simulate.scenario import Noise, Scenario
from uwtrack_cli.simulate.trajectories import Array

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
            msg = (
                f"noise.{other[0]} is not simulated for arrays ({plan.id}); leave it "
                f"out, or use a sensor of another kind."
            )
            raise OptionError(msg)
        self._seed = scenario.seed
        self._number = number
        places_m = np.array(plan.element_places)
        places_m = places_m - places_m.mean(axis=0)
        radius_m = float(np.linalg.norm(places_m, axis=1).max())
        crossing_s = 2.0 * radius_m / scenario.sound_speed_mps
        if crossing_s * rate > 2 * LONGEST_DELAY:
            msg = (
                f"sound crosses {plan.id} in {crossing_s * rate:.0f} samples; the noise "
                f"of an array is simulated up to {2 * LONGEST_DELAY}: lower the rate."
            )
            raise OptionError(msg)
        n_nodes = int(np.ceil(0.5 * np.pi * rate * crossing_s)) + SPARE_NODES
        directions, weights = _plane_waves(n_nodes, is_line=bool(plan.element_along_m))
        delays_s = -(places_m @ directions.T) / scenario.sound_speed_mps
        filters = delayed_filters(
            lambda f: ambient_density(noise, f), rate, delays_s.ravel()
        )
        scaled = filters.reshape(*delays_s.shape, -1) * np.sqrt(0.5 * weights)[:, None]
        self._filters: NDArray[np.complex64] = np.ascontiguousarray(
            np.moveaxis(scaled, -1, 0), np.complex64
        )
        self._own: list[NoiseGenerator] = []
        if plan.element_noise_db is not None:
            density = 10.0 ** (plan.element_noise_db / 10.0)
            white = shaping_filter(lambda f: np.full_like(f, density), rate)
            self._own = [
                NoiseGenerator(scenario.seed, (110, number, k), white)
                for k in range(len(places_m))
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
