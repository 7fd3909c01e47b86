"""The filters of a contact that moves and of one that only drifts.

**Method.** *Moving*: an extended Kalman filter of nearly constant velocity on range,
bearing and range rate. *Drifting*: an extended Kalman filter of bearing and inverse
range, which own ship's motion past the contact must give, beside the range and range
rate with which it answers. These are false, but go on as steadily as a vessel's: were
they free in every scan, their noise alone would tell one repeater from the other.
Both filters have one or more process noises that interact, and both are Gaussian sums
over what their first measurement leaves open, the moving one over the speed across the
line of sight and over the bearing, the drifting one over the inverse range: each term
is narrow enough to be linear in it. Both return the logarithm of the density of what
was measured, without the factors of 2 pi.

**Conventions.** Metres, seconds; bearings are mathematical, atan2(north, east), in
radians. A moving state is east, north and their rates on a fixed grid, which equals the
published relative state with own ship's accelerations as an input. A drifting state is
bearing, inverse range, measured range and the false part of the range rate. Leading
axes are anything stepped together; the models of `uwtrack_cli.estimation.imm` come
first, with their intensities of white acceleration, sigma_v^2, and chances of
switching, the terms of the sum second. A measurement that is nan is left out.

**References.** Jeong and Hong (1996), equations 5-18 as corrected; Aidala and Hammel
(1983) for the modified polar state; Alspach and Sorenson (1972) for Gaussian sums.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.constant_velocity import transition, white_acceleration
from uwtrack_cli.estimation.imm import Belief, advance, mix, reweigh

_SPEED_SHARE = 0.25
"""Deviation of a term over that of the speed across the line of sight."""
_RANGE_SHARE = 0.15
"""Relative deviation of the inverse range of a term."""
_REACH = 3.0
"""Deviations of a prior that the terms of its sum cover on either side."""
_DISTINCT = 0.1
"""Share of the variance that lies between terms, below which they become one."""


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
    """-(ln det V + nu' V^-1 nu) / 2 of all that was measured; 0 where nothing was."""
    distance2: FloatArray
    """nu' V^-1 nu of what the reading trusts, ``(...)``: all of a moving contact, the
    bearing of a drifting one."""
    degrees: FloatArray
    """Number of components of these that were measured, ``(...)``."""


@dataclass(frozen=True)
class GaussianSum:
    """State of a filter that began with an open first measurement."""

    belief: Belief
    """Filters of the terms, mean ``(model, term, ..., 4)``."""
    log_weight: FloatArray
    """Logarithms of the terms' probabilities, ``(term, ...)``."""


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
) -> GaussianSum:
    """Begin a moving filter at a measurement that is complete in range and bearing.

    Velocity is zero but for the measured range rate, each component with a deviation.
    """
    distance, bearing, rate = np.moveaxis(observation.measured, -1, 0)
    var_r, var_b, _ = np.moveaxis(observation.variance, -1, 0)
    # The arc of a term leaves its tangent by an eighth of the deviation of the range.
    narrow = 0.5 * np.sqrt(np.sqrt(var_r) / distance / var_b).min()
    turns, turn_weight = _terms(max(float(narrow), 0.1))
    speeds, speed_weight = _terms(_SPEED_SHARE)
    axes = (-1, *(1,) * distance.ndim)
    turned = np.tile(turns, speeds.size).reshape(axes)
    sideways = speed_std_mps * np.repeat(speeds, turns.size).reshape(axes)
    bearing = bearing + turned * np.sqrt(var_b)
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    gain, var_towards = _radial_prior(observation, speed_std_mps)
    # Own ship's motion along the line of sight belongs to the measured rate.
    own = (observation.velocity * along).sum(axis=-1)
    towards = np.where(np.isfinite(rate), gain * (rate + own), 0.0)
    sideways = np.broadcast_to(sideways, bearing.shape)
    mean = np.concatenate(
        [
            observation.position + distance[..., None] * along,
            towards[..., None] * along + sideways[..., None] * across,
        ],
        -1,
    )
    # Columns: errors of range, bearing, radial speed and speed across. A bearing that is
    # wrong lets the rate measured be that along another line.
    slip = gain * ((observation.velocity * across).sum(axis=-1) - sideways)
    slope = np.zeros((*bearing.shape, 4, 4))
    slope[..., :2, 0] = along
    slope[..., :2, 1] = distance[..., None] * across
    slope[..., 2:, 1] = slip[..., None] * along
    slope[..., 2:, 2] = along
    slope[..., 2:, 3] = across
    free = (_SPEED_SHARE * speed_std_mps) ** 2
    variance = np.stack(
        np.broadcast_arrays(
            var_r, var_b * min(narrow, 1.0) ** 2, var_towards, free, bearing
        )[:4],
        axis=-1,
    )
    spread = (slope * variance[..., None, :]) @ np.swapaxes(slope, -1, -2)
    weight = np.add.outer(speed_weight, turn_weight).reshape(axes)
    return _sum_of(mean, spread, weight, n_models)


def _terms(share: float) -> tuple[FloatArray, FloatArray]:
    """Return centres and log weights of Gaussians whose sum is a standard normal one.

    Each has the deviation ``share``; one term does for a share of 1 or more.
    """
    if share >= 1.0:
        return np.zeros(1), np.zeros(1)
    side = np.arange(2.0 * share, _REACH + 1e-9, 2.0 * share)
    centres = np.concatenate([-side[::-1], [0.0], side])
    weight = np.exp(-0.5 * centres**2 / (1.0 - share**2))
    return centres, np.log(weight / weight.sum())


def _radial_prior(
    observation: Observation, speed_std_mps: float
) -> tuple[FloatArray, FloatArray]:
    """Return the gain of a measured range rate over none, and the variance left."""
    free, var_d = speed_std_mps**2, observation.variance[..., 2]
    known = np.isfinite(observation.measured[..., 2])
    gain = np.where(known, free / (free + var_d), 0.0)
    return gain, free * (1.0 - gain)


def _sum_of(
    mean: FloatArray, spread: FloatArray, log_weight: FloatArray, n_models: int
) -> GaussianSum:
    """Give all models the same terms."""
    size = mean.shape[:-1]
    belief = Belief(
        np.broadcast_to(mean, (n_models, *mean.shape)),
        np.broadcast_to(spread, (n_models, *spread.shape)),
        np.full((n_models, *size), 1.0 / n_models),
    )
    return GaussianSum(belief, np.broadcast_to(log_weight, size))


def predict_moving(
    state: GaussianSum, interval_s: float, intensity: FloatArray, switching: FloatArray
) -> GaussianSum:
    """Carry a moving filter over a step by each model's intensity, m^2/s^3."""
    belief = advance(
        mix(state.belief, switching),
        np.kron(transition(interval_s), np.eye(2)),
        velocity_noise(interval_s, intensity),
    )
    return GaussianSum(belief, state.log_weight)


def update_moving(
    state: GaussianSum, observation: Observation
) -> tuple[GaussianSum, InnovationFit]:
    """Correct a predicted filter by a scan; say how it agrees with the prediction."""
    expected, slope = observe_moving(state.belief.mean, observation)
    return _correct(state, observation, expected, slope, slice(0, 3))


def _merged(state: GaussianSum) -> GaussianSum:
    """Return one term with the same moments where each is nearly as wide as the sum."""
    belief = state.belief
    if belief.mean.shape[1] == 1:
        return state
    weight = np.exp(state.log_weight) * belief.probability
    total = weight.sum(axis=1, keepdims=True)
    share = (weight / np.maximum(total, np.finfo(np.float64).tiny))[..., None]
    mean = (share * belief.mean).sum(axis=1, keepdims=True)
    away = belief.mean - mean
    between = (share * away**2).sum(axis=1)
    spread = belief.covariance + away[..., :, None] * away[..., None, :]
    covariance = (share[..., None] * spread).sum(axis=1, keepdims=True)
    whole = np.diagonal(covariance[:, 0], axis1=-2, axis2=-1)
    if np.any(between > _DISTINCT * whole):
        return state
    one = Belief(mean, covariance, total)
    return GaussianSum(one, np.zeros_like(state.log_weight[:1]))


def _correct(
    state: GaussianSum,
    observation: Observation,
    expected: FloatArray,
    slope: FloatArray,
    trusted: slice,
) -> tuple[GaussianSum, InnovationFit]:
    """Correct all terms and models and weigh them by what they foresaw."""
    belief = state.belief
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
    density = -0.5 * (
        np.log(np.linalg.det(spread)) + _distance2(residual, spread, slice(0, 3))
    )
    by_model = reweigh(belief, density)
    weight = state.log_weight + _log_sum(np.log(belief.probability) + density)
    total = _log_sum(weight)
    weight = weight - total
    distance2 = (by_model * _distance2(residual, spread, trusted)).sum(axis=0)
    fit = InnovationFit(
        total,
        (np.exp(weight) * distance2).sum(axis=0),
        known[..., trusted].sum(axis=-1),
    )
    return _merged(GaussianSum(Belief(mean, covariance, by_model), weight)), fit


def _distance2(residual: FloatArray, spread: FloatArray, part: slice) -> FloatArray:
    some = residual[..., part]
    solved = np.linalg.solve(spread[..., part, part], some[..., None])[..., 0]
    return np.asarray((some * solved).sum(axis=-1))


def _log_sum(log_value: FloatArray) -> FloatArray:
    """Return the logarithm of a sum over the first axis."""
    top = log_value.max(axis=0)
    return np.asarray(top + np.log(np.exp(log_value - top).sum(axis=0)))


def observe_moving(
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


def start_drift(
    observation: Observation, relative_std: float, speed_std_mps: float, n_models: int
) -> GaussianSum:
    """Begin a drifting filter at a measurement, whose range is only an upper bound.

    ``relative_std``: deviation of the inverse range over that measured, upwards: the
    answer comes late. ``speed_std_mps``: deviation of the false part of the range rate.

    Notes
    -----
    A half-normal prior of 1/range from 1/z_range on, its deviation 0.5/z_range where the
    source has P = diag(s_b^2, (2/z_range)^2) (Jeong and Hong 1996, eq. 28, corrected).
    """
    distance, bearing, rate = np.moveaxis(observation.measured, -1, 0)
    var_r, var_b, _ = np.moveaxis(observation.variance, -1, 0)
    share = min(_RANGE_SHARE, relative_std)
    # Terms that are equally apart in ratio: a range is as linear as another then.
    reach = np.log1p(_REACH * relative_std)
    ratio = np.exp(np.arange(0.0, reach + 1e-9, np.log1p(2.0 * _RANGE_SHARE)))
    log_weight = np.log(ratio) - 0.5 * ((ratio - 1.0) / relative_std) ** 2
    log_weight[0] -= np.log(2.0)  # the edge, by the trapezium rule
    log_weight -= _log_sum(log_weight)
    axes = (-1, *(1,) * distance.ndim)
    inverse = ratio.reshape(axes) / distance
    gain, var_false = _radial_prior(observation, speed_std_mps)
    sine, cosine = np.sin(bearing), np.cos(bearing)
    own = observation.velocity[..., 0] * cosine + observation.velocity[..., 1] * sine
    turned = observation.velocity[..., 1] * cosine - observation.velocity[..., 0] * sine
    false = np.where(np.isfinite(rate), gain * (rate + own), 0.0)
    mean = np.stack(np.broadcast_arrays(bearing, inverse, distance, false), axis=-1)
    spread = np.zeros((*inverse.shape, 4, 4))
    spread[..., 0, 0] = var_b
    spread[..., 1, 1] = (share * inverse) ** 2
    spread[..., 2, 2] = var_r
    spread[..., 3, 3] = var_false + (gain * turned) ** 2 * var_b
    spread[..., 0, 3] = spread[..., 3, 0] = gain * turned * var_b
    return _sum_of(mean, spread, log_weight.reshape(axes), n_models)


def separated(track: GaussianSum, observation: Observation) -> Observation:
    """Return the first measurement of a contact with the bearing of an earlier track.

    A repeater that a source leaves behind is where the source was. Were its bearing that
    of one scan alone, a moving filter, which knows the track, would foresee the next ones
    better though it is wrong. A bearing that the track, corrected by the scan, misses by
    three deviations began elsewhere and stays as it is.
    """
    weight = np.exp(track.log_weight) * track.belief.probability
    mean = (weight[..., None] * track.belief.mean).sum(axis=(0, 1))
    away = track.belief.mean - mean
    spread = track.belief.covariance + away[..., :, None] * away[..., None, :]
    spread = (weight[..., None, None] * spread).sum(axis=(0, 1))[..., :2, :2]
    place = mean[..., :2] - observation.position
    side = np.stack([-place[..., 1], place[..., 0]], axis=-1)
    square = (place**2).sum(axis=-1)
    variance = np.einsum("...i,...ij,...j->...", side, spread, side) / square**2
    bearing = np.arctan2(place[..., 1], place[..., 0])
    off = wrap_rad(observation.measured[..., 1] - bearing)
    is_there = off**2 < 9.0 * observation.variance[..., 1]
    measured, known = observation.measured.copy(), observation.variance
    known = np.broadcast_to(known, measured.shape).copy()
    measured[..., 1] = np.where(is_there, bearing, measured[..., 1])
    known[..., 1] = np.where(is_there, variance, known[..., 1])
    return replace(observation, measured=measured, variance=known)


def predict_drift(
    state: GaussianSum,
    interval_s: float,
    displacement: FloatArray,
    speed_std_mps: float,
    intensity: FloatArray,
    switching: FloatArray,
) -> GaussianSum:
    """Carry a drifting filter over own ship's displacement, east and north, m.

    The drift has a root intensity in m/s^(1/2); the false range rate wanders with each
    model's intensity, m^2/s^3, as a vessel's would.

    Notes
    -----
    S1 = s (u1 sin theta - u2 cos theta), S2 = 1 - s (u1 cos theta + u2 sin theta);
    theta + atan2(S1, S2), s / sqrt(S1^2 + S2^2) (Jeong and Hong 1996, eqs. 10-14). The
    measured range grows by 1/s+ - 1/s and by the false rate.
    """
    belief = mix(state.belief, switching)
    theta, inverse, distance, false = np.moveaxis(belief.mean, -1, 0)
    sine, cosine = np.sin(theta), np.cos(theta)
    u1, u2 = displacement[..., 0], displacement[..., 1]
    side = u1 * sine - u2 * cosine
    ahead = u1 * cosine + u2 * sine
    way2 = u1**2 + u2**2
    s1, s2 = inverse * side, 1.0 - inverse * ahead
    square = s1**2 + s2**2
    root = np.sqrt(square)
    # (root - 1) / s without the difference of large ranges.
    grown = (inverse * way2 - 2.0 * ahead) / (root + 1.0)
    mean = np.stack(
        [
            wrap_rad(theta + np.arctan2(s1, s2)), inverse / root,
            distance + grown + interval_s * false, false,
        ],
        axis=-1,
    )  # fmt: skip
    # d atan2(S1, S2) = (S2 dS1 - S1 dS2) / (S1^2 + S2^2), and likewise for the range.
    s1_theta, s2_theta = inverse * ahead, inverse * side
    s1_s, s2_s = side, -ahead
    root_theta = (s1 * s1_theta + s2 * s2_theta) / root
    root_s = (s1 * s1_s + s2 * s2_s) / root
    slope = np.zeros((*theta.shape, 4, 4))
    slope[..., 0, 0] = 1.0 + (s2 * s1_theta - s1 * s2_theta) / square
    slope[..., 0, 1] = (s2 * s1_s - s1 * s2_s) / square
    slope[..., 1, 0] = -inverse * root_theta / square
    slope[..., 1, 1] = 1.0 / root - inverse * root_s / square
    slope[..., 2, 0] = (2.0 * side - grown * root_theta) / (root + 1.0)
    slope[..., 2, 1] = (way2 - grown * root_s) / (root + 1.0)
    slope[..., 2:, 2:] = transition(interval_s)
    covariance = slope @ belief.covariance @ np.swapaxes(slope, -1, -2)
    walk = interval_s * speed_std_mps**2
    # The drift along the line of sight changes range and inverse range alike.
    radial = np.stack(np.broadcast_arrays(-(inverse**2), 1.0), axis=-1)
    covariance[..., 0, 0] += inverse**2 * walk
    covariance[..., 1:3, 1:3] += walk * radial[..., :, None] * radial[..., None, :]
    push = np.multiply.outer(intensity, white_acceleration(interval_s).matrix)
    covariance[..., 2:, 2:] += push.reshape(-1, *(1,) * (theta.ndim - 1), 2, 2)
    return GaussianSum(Belief(mean, covariance, belief.probability), state.log_weight)


def update_drift(
    state: GaussianSum, observation: Observation
) -> tuple[GaussianSum, InnovationFit]:
    """Correct a predicted drifting filter by a scan; say how its bearing agrees."""
    theta, _, distance, false = np.moveaxis(state.belief.mean, -1, 0)
    sine, cosine = np.sin(theta), np.cos(theta)
    east, north = observation.velocity[..., 0], observation.velocity[..., 1]
    rate = false - east * cosine - north * sine
    slope = np.zeros((*theta.shape, 3, 4))
    slope[..., 0, 2] = slope[..., 1, 0] = slope[..., 2, 3] = 1.0
    slope[..., 2, 0] = east * sine - north * cosine
    expected = np.stack([distance, theta, rate], axis=-1)
    state, fit = _correct(state, observation, expected, slope, slice(1, 2))
    # A range cannot be negative; the bearing alone does not know that.
    state.belief.mean[..., 1] = np.maximum(state.belief.mean[..., 1], 1e-6)
    return state, fit


def inverse_range_deviation(state: GaussianSum) -> FloatArray:
    """Return the relative deviation of a drifting contact's inverse range, ``(...)``."""
    mean, spread = state.belief.mean[..., 1], state.belief.covariance[..., 1, 1]
    weight = np.exp(state.log_weight) * state.belief.probability
    centre = (weight * mean).sum(axis=(0, 1))
    variance = (weight * (spread + (mean - centre) ** 2)).sum(axis=(0, 1))
    return np.asarray(np.sqrt(variance) / centre)
