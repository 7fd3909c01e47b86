"""A planar or volume array: the directions it hears, and how well it tells them.

**Method.** A direction is the vector u = c s that points to the source, s its slowness.
An array in space hears all three components, so that its beams fill the unit sphere; a
plane hears two, and its beams fill a disc a little wider than 1. Beams lie at most a
quarter of a beam's width apart. A maximum among them is refined by a paraboloid over
its neighbours. The covariance of a direction is the inverse of the Fisher information
of the hydrophones' places.

**Conventions.** Places are metres to starboard, ahead and up, from their mean. A wave
from u turns a hydrophone at p by exp(+j 2 pi f p.u / c). Beams are numbered; those at
the rim have no neighbours outside and are no maxima.

**References.** H. L. Van Trees, Optimum Array Processing (2002), sections 2.2 and 8.4;
A. Gonzalez, Measurement of areas on a sphere using Fibonacci lattices (2010).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.arrays.line_array import angle_std_deg
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import compass_deg

FLAT_SHARE = 1e-3
"""An array thinner than this share of its length is a plane."""

LEVEL_SINE = 1e-3
"""A plane whose normal leans less than this from the vertical is level."""

DISC = 1.1
"""Largest |u| that a plane of hydrophones listens to: errors reach beyond 1."""

RIM_STEPS = 2.2
"""Steps by which beams of a plane reach beyond the disc: the beam next to any direction
on it, half a diagonal away at most, has neighbours all around (a diagonal more)."""

WIDTH_SHARE = 0.25
"""Distance of beams as a share of their width c / (f D)."""

MOST_BEAMS = 6000
"""Beams that are formed at most."""

N_NEIGHBOURS = 8
"""Beams around one among which it must be the largest."""

UNIFORM_STD_DEG = 104.0
"""Deviation of a bearing that tells nothing."""

LOBE_DB = 3.0
"""A lobe that reaches this near the main lobe may be taken for it."""


ROWS_AT_ONCE = 256
"""Beams whose distances from all others are held at once."""


@dataclass(frozen=True, eq=False)
class Bearing:
    """Directions as a person states them, all shape (n,), degrees."""

    bearing_deg: FloatArray
    """Compass bearing."""
    bearing_std_deg: FloatArray
    """Its standard deviation."""
    elevation_deg: FloatArray
    """Angle above the horizontal."""
    elevation_std_deg: FloatArray
    """Its standard deviation."""


@dataclass(frozen=True, eq=False)
class SpatialArray:
    """The hydrophones of a planar or volume array, or of a line where delays tell it."""

    places_m: FloatArray
    """Their places: starboard, ahead and up, shape (element, 3)."""
    sound_speed_mps: float
    """Speed of sound, m/s."""

    @cached_property
    def centred_m(self) -> FloatArray:
        """Places from their mean."""
        return np.asarray(self.places_m - self.places_m.mean(axis=0))

    @cached_property
    def _axes(self) -> tuple[FloatArray, FloatArray]:
        _, spans, axes = np.linalg.svd(self.centred_m, full_matrices=True)
        return np.append(spans, np.zeros(3 - spans.size)), axes

    @cached_property
    def measured_axes(self) -> FloatArray:
        """Axes along which the array measures a direction, shape (1 to 3, 3)."""
        if self.is_line:
            return np.array([[0.0, 1.0, 0.0]])  # as `Sensor.element_xyz_m` lays it
        if self.is_planar:  # the two across its normal
            return np.asarray(np.linalg.svd(self.normal[None])[2][1:])
        return np.eye(3)

    @property
    def is_line(self) -> bool:
        """Whether all hydrophones lie on one line: it is planar as well."""
        spans, _ = self._axes
        return bool(spans[1] < FLAT_SHARE * spans[0])

    @property
    def is_planar(self) -> bool:
        """Whether all hydrophones lie in one plane."""
        spans, _ = self._axes
        return bool(spans[2] < FLAT_SHARE * spans[0])

    @cached_property
    def normal(self) -> FloatArray:
        """Normal of the plane, upwards; of a volume array that of its thinnest extent."""
        normal = self._axes[1][2]
        if np.hypot(*normal[:2]) < LEVEL_SINE:
            return np.array([0.0, 0.0, 1.0])
        return np.asarray(normal * (1.0 if normal[2] >= 0.0 else -1.0))

    @property
    def is_level(self) -> bool:
        """Whether it is a level plane, which tells bearings, but not up from down."""
        return self.is_planar and bool(self.normal[2] == 1.0)

    @cached_property
    def aperture_m(self) -> float:
        """Largest distance of two hydrophones, m."""
        return float(self._distances_m.max())

    @property
    def closest_m(self) -> float:
        """Smallest distance of two hydrophones, m."""
        apart = self._distances_m
        return float(apart[np.triu_indices_from(apart, 1)].min())

    @cached_property
    def _distances_m(self) -> FloatArray:
        apart = self.places_m[:, None] - self.places_m[None]
        return np.asarray(np.linalg.norm(apart, axis=2))

    def isotropic_coherence(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the coherence of isotropic noise, shape (cell, element, element).

        sinc(2 f d / c), Cox (1973).
        """
        waves = 2.0 * np.multiply.outer(frequency_hz, self._distances_m)
        return np.asarray(np.sinc(waves / self.sound_speed_mps))

    def steering(self, frequency_hz: FloatArray, toward: FloatArray) -> NDArray[np.complex64]:
        """Return exp(-j 2 pi f p.u / c), to be summed with the spectra.

        Of directions u, shape (beam, 3): shape (cell, beam, element).
        """
        waves = np.multiply.outer(frequency_hz, self.lead_s(toward))
        return np.asarray(np.exp(-2j * np.pi * waves), np.complex64)

    def lead_s(self, toward: FloatArray) -> FloatArray:
        """Return how much earlier each hydrophone hears, s, shape (beam, element)."""
        return toward @ self.centred_m.T / self.sound_speed_mps

    def beams_needed(self, highest_hz: FloatArray) -> FloatArray:
        """Return how many beams fill all directions up to frequencies, Hz."""
        step = self._step(highest_hz)
        area = np.pi * (DISC + RIM_STEPS * step) ** 2 if self.is_planar else 4.0 * np.pi
        return np.asarray(area / step**2)

    def _step(self, highest_hz: FloatArray) -> FloatArray:
        """Return the distance of beams, of u."""
        width = self.sound_speed_mps / (highest_hz * self.aperture_m)
        return np.asarray(np.minimum(WIDTH_SHARE * width, 0.25))

    def grid(self, highest_hz: float) -> "DirectionGrid":
        """Return the beams for frequencies up to a highest one, Hz.

        Their number grows with its square.
        """
        step = float(self._step(np.array(highest_hz)))
        if self.is_planar:
            return _disc(self.normal, step)
        return _sphere(int(np.ceil(4.0 * np.pi / step**2)), step)

    def scatter_m2(self, weights: FloatArray) -> FloatArray:
        """Return sum dp dp^T of the hydrophones used, shape (3, 3), m^2."""
        used = self.places_m[weights > 0.0]
        around = used - used.mean(axis=0)
        return np.asarray(around.T @ around)

    def bearings(
        self,
        toward: FloatArray,
        covariance: FloatArray,
        heading_deg: FloatArray,
        *,
        below: bool = False,
    ) -> Bearing:
        """Return compass bearings and elevations of directions.

        Directions u as heard, shape (n, 3), lie within the plane of a planar array, and
        have length 1 for a volume array; the heading is the array's. Of a planar array
        the source above is taken, unless ``below`` its plane. Of a line it is taken to
        starboard and level with it, unless ``below``, to port; its elevation is nan.
        """
        if self.is_line:
            return _cone_bearings(toward, covariance, heading_deg, port=below)
        length = np.linalg.norm(toward, axis=1)
        full, spread = toward, covariance
        if self.is_planar:
            normal = -self.normal if below else self.normal
            inside = toward / np.maximum(length, 1.0)[:, None]
            rise = np.sqrt(np.maximum(1.0 - np.minimum(length, 1.0) ** 2, 0.0))
            full = inside + rise[:, None] * normal
            along = toward / np.maximum(length, 1e-9)[:, None]
            radial = _quadratic(along, covariance)
            slope = length / np.sqrt(np.maximum(rise**2, np.sqrt(radial) + 1e-30))
            turn = np.eye(3) - (slope[:, None] * along)[:, None, :] * normal[:, None]
            spread = turn @ covariance @ turn.transpose(0, 2, 1)
        level = np.hypot(full[:, 0], full[:, 1])
        east, north = (full[:, 0] / np.maximum(level, 1e-9), full[:, 1] / np.maximum(level, 1e-9))
        across = np.stack([north, -east, np.zeros_like(east)], axis=1)
        rising = np.stack([-full[:, 2] * east, -full[:, 2] * north, level], axis=1)
        turn_std = np.sqrt(_quadratic(across, spread))
        rise_std = np.sqrt(_quadratic(rising, spread))
        if self.is_level:  # the angle to the horizon goes as the root of the cosine
            rise_std = np.radians(angle_std_deg(length, np.sqrt(radial)))
        return Bearing(
            bearing_deg=(compass_deg(full[:, 0], full[:, 1]) + heading_deg) % 360.0,
            bearing_std_deg=np.minimum(
                np.degrees(turn_std / np.maximum(level, 1e-6)), UNIFORM_STD_DEG
            ),
            elevation_deg=np.degrees(np.arcsin(np.clip(full[:, 2], -1.0, 1.0))),
            elevation_std_deg=np.minimum(np.degrees(rise_std), 52.0),
        )

    def tone_covariance(
        self, snr: FloatArray, frequency_hz: FloatArray, weights: FloatArray
    ) -> FloatArray:
        """Return the covariance of the direction of tones, shape (n, 3, 3).

        The inverse of 2 rho (2 pi f / c)^2 sum dp dp^T, rho the ratio at one
        hydrophone, on what the array hears; of a volume array it is across u. SNR is
        that in the beam; a hydrophone of weight 0 is not used.
        """
        wave = 2.0 * np.pi * frequency_hz / self.sound_speed_mps
        rho = np.maximum(snr, 1e-6) / np.count_nonzero(weights)
        inverse = np.linalg.pinv(self.scatter_m2(weights), rcond=FLAT_SHARE**2)
        return np.asarray(inverse / (2.0 * rho * wave**2)[:, None, None])


def _cone_bearings(
    toward: FloatArray, covariance: FloatArray, heading_deg: FloatArray, *, port: bool
) -> Bearing:
    """Return the bearings of a line's cones on one of its sides."""
    cosine = np.clip(toward[:, 1], -1.0, 1.0)
    cone_deg = np.degrees(np.arccos(cosine)) * (-1.0 if port else 1.0)
    unknown = np.full(cosine.size, np.nan)
    return Bearing(
        bearing_deg=(heading_deg + cone_deg) % 360.0,
        bearing_std_deg=angle_std_deg(cosine, np.sqrt(covariance[:, 1, 1])),
        elevation_deg=unknown,
        elevation_std_deg=unknown,
    )


@dataclass(frozen=True, eq=False)
class DirectionGrid:
    """Beams over the directions of an array."""

    toward: FloatArray
    """Direction u of every beam, shape (beam, 3)."""
    tangents: FloatArray
    """Two axes along which a beam's direction varies, shape (beam, 2, 3)."""
    neighbours: IntArray
    """The beams next to each one, shape (beam, neighbour)."""
    is_rim: BoolArray
    """Whether a beam lies at the rim of the disc."""
    step: float
    """Distance of beams, of u."""

    @cached_property
    def _fits(self) -> FloatArray:
        """Coefficients of a paraboloid from a beam and its neighbours."""
        around = np.concatenate([np.arange(self.n_beams)[:, None], self.neighbours], axis=1)
        apart = self.toward[around] - self.toward[:, None]
        x, y = np.moveaxis(apart @ self.tangents.transpose(0, 2, 1), 2, 0) / self.step
        design = np.stack([x**0, x, y, x * x, x * y, y * y], axis=2)
        return np.asarray(np.linalg.pinv(design))

    @cached_property
    def floor_beams(self) -> tuple[IntArray, IntArray]:
        """Beams whose noise is estimated, and which of them stands for every beam.

        Beams a quarter of a width apart hear nearly the same noise: each takes the
        floor of one that is at most a step away.
        """
        owner = np.full(self.n_beams, -1)
        centres: list[int] = []
        for beam in range(self.n_beams):
            if owner[beam] < 0:
                apart = np.linalg.norm(self.toward - self.toward[beam], axis=1)
                near = (apart <= 1.1 * self.step) & (owner < 0)
                owner[near] = len(centres)
                centres.append(beam)
        return np.array(centres), owner

    @property
    def n_beams(self) -> int:
        """Number of beams."""
        return len(self.toward)

    def is_maximum(self, values: FloatArray) -> BoolArray:
        """Mark the beams that are larger than all beside them, axis 0 the beams."""
        found = np.empty(values.shape, np.bool_)
        for beam, beside in enumerate(self.neighbours):
            found[beam] = values[beam] > values[beside].max(axis=0)
        found[self.is_rim] = False
        return found

    def refine(self, beam: IntArray, around: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return directions and heights of maxima by paraboloids.

        Of beams, shape (n,), and values there and at the neighbours, (n, 1 +
        neighbour).
        """
        part = np.einsum("nij,nj->ni", self._fits[beam], around)
        _, bx, by, axx, axy, ayy = part.T
        determinant = 4.0 * axx * ayy - axy**2
        is_peak = (axx < 0.0) & (ayy < 0.0) & (determinant > 0.0)
        safe = np.where(is_peak, determinant, 1.0)
        x = np.where(is_peak, (axy * by - 2.0 * ayy * bx) / safe, 0.0)
        y = np.where(is_peak, (axy * bx - 2.0 * axx * by) / safe, 0.0)
        shrink = 1.0 / np.maximum(np.hypot(x, y), 1.0)
        x, y = x * shrink, y * shrink
        height = np.maximum(around[:, 0], part[:, 0] + 0.5 * (bx * x + by * y))
        moved = self.toward[beam] + self.step * np.einsum(
            "ni,nij->nj", np.stack([x, y], axis=1), self.tangents[beam]
        )
        lengths = np.linalg.norm(self.toward[beam], axis=1)
        if np.allclose(np.linalg.norm(self.toward, axis=1), 1.0):
            moved *= (lengths / np.linalg.norm(moved, axis=1))[:, None]
        return moved, height


def highest_lobe(array: SpatialArray, grid: DirectionGrid, frequency_hz: float) -> float:
    """Return the highest lobe beside the main one, as a share of its power."""
    inner = np.flatnonzero(~grid.is_rim)
    some = inner[:: max(1, inner.size // 24)]
    turns = array.steering(np.array([frequency_hz]), grid.toward)[0]
    pattern = np.abs(turns @ turns[some].conj().T / turns.shape[1]) ** 2
    is_lobe = grid.is_maximum(pattern)
    apart = grid.toward[:, None] - grid.toward[None, some]
    is_lobe &= np.linalg.norm(apart, axis=2) > 1.5 * grid.step
    return float(np.where(is_lobe, pattern, 0.0).max(initial=0.0))


def _quadratic(axis: FloatArray, covariance: FloatArray) -> FloatArray:
    variance = np.einsum("ni,nij,nj->n", axis, covariance, axis)
    return np.asarray(np.maximum(variance, 0.0))


def _disc(normal: FloatArray, step: float) -> DirectionGrid:
    """Beams on a square lattice in the plane across a normal."""
    first = np.cross([0.0, 1.0, 0.0], normal)  # starboard, of a level plane
    if np.linalg.norm(first) < 0.5:
        first = np.cross(normal, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(normal, first)])
    outer = DISC + RIM_STEPS * step
    reach = int(np.ceil(outer / step))
    number = np.arange(-reach, reach + 1)
    across, along = (part.ravel() for part in np.meshgrid(number, number))
    inside = np.hypot(across, along) * step <= outer
    across, along = across[inside], along[inside]
    index = {pair: k for k, pair in enumerate(zip(across, along, strict=True))}
    shifts = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    beside = [
        [index.get((x + i, y + j), -1) for i, j in shifts]
        for x, y in zip(across, along, strict=True)
    ]
    neighbours = np.array(beside)
    is_rim = np.asarray((neighbours < 0).any(axis=1))
    neighbours = np.where(neighbours < 0, np.arange(is_rim.size)[:, None], neighbours)
    return DirectionGrid(
        toward=step * (across[:, None] * axes[0] + along[:, None] * axes[1]),
        tangents=np.broadcast_to(axes, (is_rim.size, 2, 3)),
        neighbours=neighbours,
        is_rim=is_rim,
        step=step,
    )


def _sphere(n_beams: int, step: float) -> DirectionGrid:
    """Beams on a Fibonacci lattice, which fills the sphere evenly."""
    number = np.arange(n_beams) + 0.5
    rise = 1.0 - 2.0 * number / n_beams
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    level = np.sqrt(1.0 - rise**2)
    toward = np.stack([level * np.cos(turn), level * np.sin(turn), rise], axis=1)
    near = np.concatenate(
        [np.argsort(-(some @ toward.T), axis=1)[:, 1 : N_NEIGHBOURS + 1]
         for some in np.array_split(toward, -(-n_beams // ROWS_AT_ONCE))]
    )  # fmt: skip
    helper = np.where(np.abs(rise)[:, None] < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    first = np.cross(helper, toward)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return DirectionGrid(
        toward=toward,
        tangents=np.stack([first, np.cross(toward, first)], axis=1),
        neighbours=near,
        is_rim=np.zeros(n_beams, np.bool_),
        step=step,
    )
