"""The filter of a contact that moves, on range, bearing and range rate.

**Method.** An extended Kalman filter of nearly constant velocity, with one or more
process noises that interact. It returns the logarithm of the density of its innovation,
without the factors of 2 pi.

**Conventions.** Metres, seconds; bearings are mathematical, atan2(north, east), in
radians. A moving state is east, north and their rates on a fixed grid, which equals the
published relative state with own ship's accelerations as an input. Leading axes are
anything stepped together; the models of `uwtrack_cli.estimation.imm` come first. A
measurement that is nan is left out.

**References.** Jeong and Hong (1996), equations 5-18 as corrected.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.imm import Belief, advance, mix, reweigh


@dataclass(frozen=True)
class Observation:
    """What own ship measured of a contact, and where own ship was."""

    measured: FloatArray
    """Range, bearing, range rate, ``(..., 3)``; nan is "not measured"."""
    variance: FloatArray
    """Variances of the three, ``(..., 3)``."""
    position: FloatArray
    """Own ship's east and north, ``(..., 2)``."""
    velocity: FloatArray
    """Own ship's rates, ``(..., 2)``."""


@dataclass(frozen=True)
class Fit:
    """How well a filter foresaw a measurement."""

    log_density: FloatArray
    """-(ln det V + nu' V^-1 nu) / 2; 0 where nothing was measured."""
    distance2: FloatArray
    """nu' V^-1 nu."""
    degrees: FloatArray
    """Number of components measured."""


def wrap(angle: FloatArray) -> FloatArray:
    """Return an angle in (-pi, pi].

    Examples
    --------
    >>> float(wrap(np.array(3.5)).round(4))
    -2.7832
    """
    wrapped: FloatArray = np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
    return wrapped


def velocity_noise(interval_s: float, intensity: FloatArray) -> FloatArray:
    """Return Q for states east, north and their rates.

    Parameters
    ----------
    interval_s
        Time step in s.
    intensity
        Intensity of the white acceleration, sigma_v^2, of each model.

    Notes
    -----
    Q = sigma_v^2 [[T^3/3 I, T^2/2 I], [T^2/2 I, T I]] (Jeong and Hong 1996, eq. 12).
    """
    t = interval_s
    each = np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
    block = np.kron(each, np.eye(2))
    return np.multiply.outer(np.asarray(intensity), block)


def start_moving(seen: Observation, speed_std_mps: float, n_models: int) -> Belief:
    """Begin a moving filter at a measurement.

    Parameters
    ----------
    seen
        The measurement, complete in range and bearing.
    speed_std_mps
        Standard deviation of each velocity component in m/s.
    n_models
        Number of interacting models.

    Returns
    -------
    Belief
        Position as measured; velocity zero but for the measured range rate.
    """
    distance, bearing, rate = np.moveaxis(seen.measured, -1, 0)
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    outer = along[..., :, None] * along[..., None, :]
    side = across[..., :, None] * across[..., None, :]
    spread = np.zeros((*distance.shape, 4, 4))
    var_r, var_b, var_d = np.moveaxis(seen.variance, -1, 0)[..., None, None]
    spread[..., :2, :2] = outer * var_r + side * var_b * distance[..., None, None] ** 2
    known = np.isfinite(rate)[..., None, None]
    free = speed_std_mps**2
    spread[..., 2:, 2:] = outer * np.where(known, var_d, free) + side * free
    # Own ship's motion along the line of sight belongs to the measured rate.
    own = (seen.velocity * along).sum(axis=-1)
    towards = np.where(np.isfinite(rate), rate + own, 0.0)
    mean = np.concatenate(
        [seen.position + distance[..., None] * along, towards[..., None] * along], -1
    )
    weight = np.full((n_models, *distance.shape), 1.0 / n_models)
    return Belief(
        np.broadcast_to(mean, (n_models, *mean.shape)),
        np.broadcast_to(spread, (n_models, *spread.shape)),
        weight,
    )


def predict_moving(
    belief: Belief, interval_s: float, intensity: FloatArray, switching: FloatArray
) -> Belief:
    """Carry a moving filter forward.

    Parameters
    ----------
    belief
        The filter after the last scan.
    interval_s
        Time step in s.
    intensity
        Intensity of the white acceleration of each model, m^2/s^3.
    switching
        Probabilities of changing from one model to another in the step.
    """
    transition = np.kron(np.array([[1.0, interval_s], [0.0, 1.0]]), np.eye(2))
    noise = velocity_noise(interval_s, intensity)
    return advance(mix(belief, switching), transition, noise)


def update_moving(belief: Belief, seen: Observation) -> tuple[Belief, Fit]:
    """Correct a moving filter by range, bearing and range rate.

    Parameters
    ----------
    belief
        The filter, predicted.
    seen
        The measurement.

    Returns
    -------
    tuple
        The filter after the scan, and how well it had foreseen it.
    """
    expected, slope = _observe(belief.mean, seen)
    known = np.isfinite(seen.measured)
    residual = np.where(known, seen.measured - expected, 0.0)
    residual[..., 1] = wrap(residual[..., 1])
    # A component that is missing gets a slope of zero and a variance of one.
    slope = np.where(known[..., None], slope, 0.0)
    variance = np.where(known, seen.variance, 1.0)
    cross = belief.covariance @ np.swapaxes(slope, -1, -2)
    spread = slope @ cross + variance[..., None] * np.eye(3)
    gain = cross @ np.linalg.inv(spread)
    mean = belief.mean + (gain @ residual[..., None])[..., 0]
    covariance = belief.covariance - gain @ spread @ np.swapaxes(gain, -1, -2)
    covariance = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
    distance2 = (residual * np.linalg.solve(spread, residual[..., None])[..., 0]).sum(
        -1
    )
    density = -0.5 * (np.log(np.linalg.det(spread)) + distance2)
    weight = reweigh(belief, density)
    top = density.max(axis=0)
    total = top + np.log((belief.probability * np.exp(density - top)).sum(axis=0))
    fit = Fit(total, (weight * distance2).sum(axis=0), known.sum(axis=-1))
    return Belief(mean, covariance, weight), fit


def _observe(mean: FloatArray, seen: Observation) -> tuple[FloatArray, FloatArray]:
    """Return expected range, bearing, range rate and their slopes."""
    place = mean[..., :2] - seen.position
    rate = mean[..., 2:] - seen.velocity
    distance = np.hypot(place[..., 0], place[..., 1])
    along = place / distance[..., None]
    closing = (along * rate).sum(axis=-1)
    expected = np.stack(
        [distance, np.arctan2(place[..., 1], place[..., 0]), closing], axis=-1
    )
    nothing = np.zeros_like(along)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1) / distance[..., None]
    turning = (rate - closing[..., None] * along) / distance[..., None]
    slope = np.stack(
        [
            np.concatenate([along, nothing], axis=-1),
            np.concatenate([across, nothing], axis=-1),
            np.concatenate([turning, along], axis=-1),
        ],
        axis=-2,
    )
    return expected, slope
