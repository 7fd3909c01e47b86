"""Two readings of bearings that cross: the source lies still, or it moves.

**Method.** Each reading has a posterior, which is no ellipse where the target is near a
sensor or far from all. It is sampled by adaptive importance sampling from a Student
distribution (Cappe et al. 2004), for a source that moves about its best motion, for a still
one about what a grid of places over all directions and ranges gives. The mean weight of the
draws is the reading's evidence, so that the readings compete by their marginal likelihoods
(MacKay 2003, chapter 28): equal odds before the bearings are seen. The place is given over
both: mean and covariance of the mixture.

A source at rest is speed zero as a point. The velocity of one that moves is normal with a
deviation that is itself unknown, from drift to a fast vessel; with one wide deviation alone,
a slow drift would have to be many deviations from zero before it were told from rest.

The prior of the place is flat among the sensors and in the logarithm of the range far from
them.

**References.** Cappe, Guillin, Marin & Robert 2004, J. Comput. Graph. Stat. 13, 907; MacKay
2003, Information Theory, Inference, and Learning Algorithms.

**Conventions.** States are (x, y, vx, vy) in the problem's coordinates: from the sensor of
the first row, at its time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import lgamma

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.target_motion.objective import misfit_value
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.row_mixture import RowMixture

STILL, MOVING = "stationary", "moving"

VESSEL_VELOCITY_STD_MPS = 10.0
"""Deviation of each component of a vessel's velocity of which nothing is known."""

VELOCITY_STDS_MPS = (0.3, 1.0, 3.0, VESSEL_VELOCITY_STD_MPS)
"""Deviations of each component of a moving source's velocity that are equally likely: what
drifts, rows or sails, works, and hurries."""

LEAST_RIVAL = 0.05
"""Probability from which the other reading is named."""

DRAWS, ROUNDS, TAILS = 2000, 6, 4.0
"""Draws of a round, rounds, and degrees of freedom of the proposal."""

FEWEST_EFFECTIVE = 60.0
"""Effective draws below which the likelihood has no region that an ellipse describes."""

GRID_RANGES, GRID_BEARINGS = 32, 48
GRID_NEAREST, GRID_FARTHEST = 0.03, 30.0
"""Places that a still source's search begins from: numbers of ranges and bearings about the
sensors' middle, nearest and farthest range in units of the sensors' spread."""


@dataclass(frozen=True, eq=False)
class Region:
    """Posterior of a state, or of what of it is unknown."""

    mean: FloatArray
    """Mean, shape (n,)."""
    covariance: FloatArray
    """Covariance, shape (n, n)."""
    log_evidence: float
    """Logarithm of the marginal likelihood, up to a constant common to all readings."""
    is_sampled: bool = True
    """Whether enough draws agree for mean and covariance to be the posterior's."""


@dataclass(frozen=True)
class PlaceReading:
    """The likelier reading, and the other one."""

    name: str
    """'stationary' or 'moving'; empty where the readings did not compete."""
    weight: float
    """Its probability."""

    @property
    def rival(self) -> str:
        """Name of the other reading; empty below 5 %, or where there is none."""
        if not self.name or 1.0 - self.weight < LEAST_RIVAL:
            return ""
        return MOVING if self.name == STILL else STILL

    @property
    def rival_weight(self) -> float:
        """Probability of the other reading; 0 where it is not named."""
        return 1.0 - self.weight if self.rival else 0.0


NO_READING = PlaceReading("", np.nan)


@dataclass(frozen=True, eq=False)
class _Places:
    """The prior of places: where the sensors are, and how far apart."""

    centre: FloatArray
    """Middle of the sensors over time, m, shape (2,)."""
    reach_m2: float
    """Their mean squared distance from it, m^2."""
    middle_s: float
    """Time at which the prior holds: the middle of the rows, s."""

    def log_prior(self, state: FloatArray) -> FloatArray:
        """Return the logarithm of the density, up to a constant."""
        away = state[:, :2] + state[:, 2:] * self.middle_s - self.centre
        return -np.asarray(np.log1p((away**2).sum(1) / self.reach_m2))


def _places(problem: Problem) -> _Places:
    track = problem.track
    own = np.stack([track.east_m, track.north_m])[:, track.now]
    return _Places(
        own.mean(axis=1),
        max(float(np.var(own, axis=1).sum()), 1.0),
        float(problem.row_time_s.mean()),
    )


def _log_likelihood(problem: Problem, mixture: RowMixture | None, state: FloatArray) -> FloatArray:
    if mixture is not None:
        return mixture.log_likelihood(state)
    count = len(state)
    value = misfit_value(problem, state, np.zeros((count, 0)), np.zeros(count, dtype=np.int64))
    return -0.5 * value


def _log_velocity(velocity: FloatArray, stds: tuple[float, ...]) -> FloatArray:
    """Return the logarithm of the prior density of velocities, (trials, 2)."""
    square = (velocity**2).sum(1)[:, np.newaxis]
    variance = np.square(stds)
    each = -0.5 * square / variance - np.log(2.0 * np.pi * variance)
    top = each.max(axis=1)
    return np.asarray(top + np.log(np.exp(each - top[:, np.newaxis]).mean(axis=1)))


def moving_region(
    problem: Problem,
    state: FloatArray,
    covariance: FloatArray,
    stds: tuple[float, ...] = VELOCITY_STDS_MPS,
    mixture: RowMixture | None = None,
) -> Region:
    """Sample the posterior of a source that moves about its best state, shape (4,).

    Its covariance is that of Laplace's approximation, with a prior on the velocity,
    each component of which has one of ``stds``, m/s. ``mixture``: some rows are
    another's.
    """
    places = _places(problem)

    def log_target(trial: FloatArray) -> FloatArray:
        found = _log_likelihood(problem, mixture, trial) + places.log_prior(trial)
        return found + _log_velocity(trial[:, 2:], stds)

    return sample_density(log_target, state, covariance)


def still_region(problem: Problem, mixture: RowMixture | None = None) -> Region:
    """Sample the posterior of the place of a source at rest."""
    places = _places(problem)

    def log_target(place: FloatArray) -> FloatArray:
        trial = np.concatenate([place, np.zeros_like(place)], axis=1)
        return _log_likelihood(problem, mixture, trial) + places.log_prior(trial)

    reach = np.sqrt(places.reach_m2)
    ranges = np.geomspace(GRID_NEAREST, GRID_FARTHEST, GRID_RANGES) * reach
    angles = np.linspace(0.0, 2.0 * np.pi, GRID_BEARINGS, endpoint=False)
    away = ranges[:, np.newaxis, np.newaxis] * np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    grid = places.centre + away.reshape(-1, 2)
    area = np.repeat(ranges**2, angles.size)
    value = log_target(grid) + np.log(area)
    weight = np.exp(value - value.max())
    mean, spread = _moments(grid, weight / weight.sum())
    # a likelihood narrower than the grid still lies within a cell of its best place
    cell_m2 = float(area[value.argmax()]) * (2.0 * np.pi / angles.size) ** 2
    return sample_density(log_target, mean, spread + cell_m2 * np.eye(2))


def compete(still: Region, moving: Region) -> PlaceReading:
    """Return the likelier reading with its probability, at equal odds beforehand.

    Where no place at rest explains a moving source's bearings, few draws agree, and their
    evidence is far below the other's all the same; where it is not, nothing is told.

    Examples
    --------
    >>> nowhere = np.zeros(2), np.eye(2)
    >>> found = compete(Region(*nowhere, 3.0), Region(*nowhere, 0.0))
    >>> found.name, round(found.weight, 3), found.rival
    ('stationary', 0.953, '')
    """
    ratio = still.log_evidence - moving.log_evidence
    chance = float(1.0 / (1.0 + np.exp(-np.clip(ratio, -700.0, 700.0))))
    if chance >= LEAST_RIVAL and not still.is_sampled:
        return NO_READING
    if chance > 0.5:
        return PlaceReading(STILL, chance)
    return PlaceReading(MOVING, 1.0 - chance)


def mixture(reading: PlaceReading, still: Region, moving: Region) -> Region:
    """Return mean and covariance of the state over both readings."""
    if not still.is_sampled:
        return moving
    share = reading.weight if reading.name == STILL else 1.0 - reading.weight
    rest, spread = np.zeros(4), np.zeros((4, 4))
    rest[:2], spread[:2, :2] = still.mean, still.covariance
    apart = moving.mean - rest
    return Region(
        share * rest + (1.0 - share) * moving.mean,
        share * spread
        + (1.0 - share) * moving.covariance
        + share * (1.0 - share) * np.outer(apart, apart),
        float(np.logaddexp(still.log_evidence, moving.log_evidence) - np.log(2.0)),
    )


def _moments(trial: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = weight @ trial
    away = trial - mean
    return mean, away.T @ (away * weight[:, np.newaxis])


def sample_density(
    log_target: Callable[[FloatArray], FloatArray], mean: FloatArray, first: FloatArray
) -> Region:
    """Sample a density by rounds of draws, each about the moments of the last.

    Its logarithm at points (trials, n) is known up to a constant; the first draws lie
    about a mean, shape (n,), with a covariance.
    """
    draw = np.random.default_rng(1)
    size = mean.size
    spread = 2.0 * first
    constant = lgamma(0.5 * (TAILS + size)) - lgamma(0.5 * TAILS)
    constant -= 0.5 * size * np.log(TAILS * np.pi)
    found = Region(mean, first, -np.inf, is_sampled=False)
    for _ in range(ROUNDS):
        root = np.linalg.cholesky(spread + 1e-9 * np.diag(np.diagonal(spread)))
        unit = draw.standard_normal((DRAWS, size))
        length = draw.chisquare(TAILS, DRAWS) / TAILS
        off = unit / np.sqrt(length)[:, np.newaxis]
        trial = mean + off @ root.T
        log_proposal = constant - np.log(np.diagonal(root)).sum()
        log_proposal = log_proposal - 0.5 * (TAILS + size) * np.log1p((off**2).sum(1) / TAILS)
        log_weight = log_target(trial) - log_proposal
        top = float(log_weight.max())
        weight = np.exp(log_weight - top)
        evidence = top + float(np.log(weight.mean()))
        weight /= weight.sum()
        mean, spread = _moments(trial, weight)
        is_enough = 1.0 / float((weight**2).sum()) > FEWEST_EFFECTIVE
        found = Region(mean, spread, evidence, is_sampled=is_enough)
        spread = spread if is_enough else 2.0 * spread + 0.1 * first
    return found
