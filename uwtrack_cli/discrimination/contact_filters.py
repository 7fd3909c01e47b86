"""The filters of a contact that moves and of one that only drifts.

**Method.** *Moving*: an extended Kalman filter of nearly constant velocity on range,
bearing and range rate, with one or more process noises that interact. *Drifting*: an
extended Kalman filter of bearing and inverse range on the bearing alone; a repeater
answers with a false range and range rate, so that own ship's motion past it must give
the range. Both return the logarithm of the density of their innovation, without the
factors of 2 pi.

**Conventions.** Metres, seconds; bearings are mathematical, atan2(north, east), in
radians. A moving state is east, north and their rates on a fixed grid, which equals the
published relative state with own ship's accelerations as an input. Leading axes are
anything stepped together; the models of `uwtrack_cli.estimation.imm` come first, with
their intensities of white acceleration, sigma_v^2, and chances of switching. A
measurement that is nan is left out.

**References.** Jeong and Hong (1996), equations 5-18 as corrected; Aidala and Hammel
(1983) for the modified polar state.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.constant_velocity import transition, white_acceleration
from uwtrack_cli.estimation.imm import Belief, advance, mix, reweigh


@dataclass(frozen=True)
class Observation:
    """Measurement of a contact, with own ship's position and velocity."""

    measured: FloatArray
    """Range (m), bearing (rad), range rate (m/s), ``(..., 3)``; nan is not measured."""
    variance: FloatArray
    """Variances of the three, ``(..., 3)``."""
    position: FloatArray
    """Own ship's east and north, m, ``(..., 2)``."""
    velocity: FloatArray
    """Own ship's velocity east and north, m/s, ``(..., 2)``."""


@dataclass(frozen=True)
class InnovationFit:
    """How well a measurement agrees with a filter's prediction."""

    log_density: FloatArray
    """-(ln det V + nu' V^-1 nu) / 2; 0 where nothing was measured."""
    distance2: FloatArray
    """nu' V^-1 nu, ``(...)``."""
    degrees: FloatArray
    """Number of components measured, ``(...)``."""


def velocity_noise(interval_s: float, intensity: FloatArray) -> FloatArray:
    """Return Q for states east, north and their rates over a step, of each intensity.

    Notes
    -----
    Q = sigma_v^2 [[T^3/3 I, T^2/2 I], [T^2/2 I, T I]] (Jeong and Hong 1996, eq. 12).
    """
    block = np.kron(white_acceleration(interval_s).matrix, np.eye(2))
    return np.asarray(np.multiply.outer(intensity, block))


def start_moving(
    observation: Observation, speed_std_mps: float, n_models: int
) -> Belief:
    """Begin a moving filter at a measurement that is complete in range and bearing.

    Velocity is zero but for the measured range rate, each component with a deviation.
    """
    distance, bearing, rate = np.moveaxis(observation.measured, -1, 0)
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    outer = along[..., :, None] * along[..., None, :]
    side = across[..., :, None] * across[..., None, :]
    spread = np.zeros((*distance.shape, 4, 4))
    var_r, var_b, var_d = np.moveaxis(observation.variance, -1, 0)[..., None, None]
    spread[..., :2, :2] = outer * var_r + side * var_b * distance[..., None, None] ** 2
    known = np.isfinite(rate)[..., None, None]
    free = speed_std_mps**2
    spread[..., 2:, 2:] = outer * np.where(known, var_d, free) + side * free
    # Own ship's motion along the line of sight belongs to the measured rate.
    own = (observation.velocity * along).sum(axis=-1)
    towards = np.where(np.isfinite(rate), rate + own, 0.0)
    mean = np.concatenate(
        [
            observation.position + distance[..., None] * along,
            towards[..., None] * along,
        ],
        -1,
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
    """Carry a moving filter over a step by each model's intensity, m^2/s^3."""
    return advance(
        mix(belief, switching),
        np.kron(transition(interval_s), np.eye(2)),
        velocity_noise(interval_s, intensity),
    )


def update_moving(
    belief: Belief, observation: Observation
) -> tuple[Belief, InnovationFit]:
    """Correct a predicted filter by a scan; say how it agrees with the prediction."""
    expected, slope = _observe(belief.mean, observation)
    known = np.isfinite(observation.measured)
    residual = np.where(known, observation.measured - expected, 0.0)
    residual[..., 1] = wrap_rad(residual[..., 1])
    # A component that is missing gets a slope of zero and a variance of one.
    slope = np.where(known[..., None], slope, 0.0)
    variance = np.where(known, observation.variance, 1.0)
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
    fit = InnovationFit(total, (weight * distance2).sum(axis=0), known.sum(axis=-1))
    return Belief(mean, covariance, weight), fit


def _observe(
    mean: FloatArray, observation: Observation
) -> tuple[FloatArray, FloatArray]:
    """Return expected range, bearing, range rate and their slopes."""
    place = mean[..., :2] - observation.position
    rate = mean[..., 2:] - observation.velocity
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


@dataclass(frozen=True)
class DriftState:
    """State of the drifting filter: bearing and inverse range."""

    mean: FloatArray
    """Bearing (rad) and inverse range (1/m), ``(..., 2)``."""
    covariance: FloatArray
    """Its covariance, ``(..., 2, 2)``."""


def start_drift(observation: Observation, relative_std: float = 0.5) -> DriftState:
    """Begin a drifting filter at a measurement, whose range is only a first guess.

    ``relative_std`` is the deviation of the inverse range over that measured.

    Notes
    -----
    P = diag(s_b^2, (0.5 / z_range)^2). The source prints 2 / z_range, which does worse.
    """
    inverse = 1.0 / observation.measured[..., 0]
    mean = np.stack([observation.measured[..., 1], inverse], axis=-1)
    covariance = np.zeros((*inverse.shape, 2, 2))
    covariance[..., 0, 0] = observation.variance[..., 1]
    covariance[..., 1, 1] = (relative_std * inverse) ** 2
    return DriftState(mean, covariance)


def predict_drift(
    drift: DriftState, interval_s: float, displacement: FloatArray, speed_std_mps: float
) -> DriftState:
    """Carry a drifting filter over own ship's displacement, east and north, m.

    The drift has a root intensity in m/s^(1/2).

    Notes
    -----
    S1 = s (u1 sin theta - u2 cos theta), S2 = 1 - s (u1 cos theta + u2 sin theta);
    theta + atan2(S1, S2), s / sqrt(S1^2 + S2^2) (Jeong and Hong 1996, eqs. 10-14).
    """
    theta, inverse = drift.mean[..., 0], drift.mean[..., 1]
    sine, cosine = np.sin(theta), np.cos(theta)
    u1, u2 = displacement[..., 0], displacement[..., 1]
    side = u1 * sine - u2 * cosine
    ahead = u1 * cosine + u2 * sine
    s1, s2 = inverse * side, 1.0 - inverse * ahead
    square = s1**2 + s2**2
    mean = np.stack(
        [wrap_rad(theta + np.arctan2(s1, s2)), inverse / np.sqrt(square)], axis=-1
    )
    # d atan2(S1, S2) = (S2 dS1 - S1 dS2) / (S1^2 + S2^2), and likewise for the range.
    s1_theta, s2_theta = inverse * ahead, inverse * side
    s1_s, s2_s = side, -ahead
    root = square**-1.5
    slope = np.stack(
        [
            1.0 + (s2 * s1_theta - s1 * s2_theta) / square,
            (s2 * s1_s - s1 * s2_s) / square,
            -inverse * (s1 * s1_theta + s2 * s2_theta) * root,
            square**-0.5 - inverse * (s1 * s1_s + s2 * s2_s) * root,
        ],
        axis=-1,
    ).reshape(*theta.shape, 2, 2)
    covariance = slope @ drift.covariance @ np.swapaxes(slope, -1, -2)
    walk = interval_s * speed_std_mps**2
    covariance[..., 0, 0] += inverse**2 * walk
    covariance[..., 1, 1] += inverse**4 * walk
    return DriftState(mean, covariance)


def update_drift(
    drift: DriftState, observation: Observation
) -> tuple[DriftState, InnovationFit]:
    """Correct a predicted drifting filter by a bearing alone; say how it agrees."""
    bearing = observation.measured[..., 1]
    known = np.isfinite(bearing)
    residual = np.where(known, wrap_rad(bearing - drift.mean[..., 0]), 0.0)
    column = np.where(known[..., None], drift.covariance[..., 0], 0.0)
    spread = np.where(
        known, drift.covariance[..., 0, 0] + observation.variance[..., 1], 1.0
    )
    gain = column / spread[..., None]
    mean = drift.mean + gain * residual[..., None]
    # A range cannot be negative; the bearing alone does not know that.
    mean[..., 1] = np.maximum(mean[..., 1], 1e-6)
    covariance = drift.covariance - gain[..., :, None] * column[..., None, :]
    distance2 = residual**2 / spread
    density = -0.5 * (np.log(spread) + distance2)
    return DriftState(mean, covariance), InnovationFit(
        density, distance2, known.astype(np.int64)
    )
