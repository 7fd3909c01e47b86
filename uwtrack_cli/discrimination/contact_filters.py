"""The filters of a contact that moves and of one that only drifts.

**Method.** Both are extended Kalman filters in polar coordinates about own ship, in which
what is measured is linear: a bearing that is some degrees wrong bends a place in east and
north by more than a range is wrong. *Moving*: nearly constant velocity. *Drifting*:
bearing and inverse range, which own ship's motion past the contact must give, beside the
range and range rate with which it answers. These are false, but go on as steadily as a
vessel's: were they free in every scan, their noise alone would tell one repeater from the
other. Both filters have one or more process noises that interact, and both are Gaussian
sums over what their first measurement leaves open, the moving one over the speed across
the line of sight, the drifting one over the inverse range: each term is narrow enough to
be linear in it. Both return the logarithm of the density of what was measured, without
the factors of 2 pi.

**Conventions.** Metres, seconds; bearings are mathematical, atan2(north, east), in
radians, and go on beyond half a circle. A state is the bearing, then the speed over ground
across the line of sight of a moving contact or the inverse range of a drifting one, then
the range and the speed over ground along the line of sight as they are measured. Leading
axes are anything stepped together; the models of `uwtrack_cli.estimation.imm` come first,
with their intensities of white acceleration, sigma_v^2, and chances of switching, the
terms of the sum second. A measurement that is nan is left out.

**References.** Jeong and Hong (1996), equations 5-18 as corrected; Aidala and Hammel
(1983) for polar states; Alspach and Sorenson (1972) for Gaussian sums.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.constant_velocity import transition, white_acceleration
from uwtrack_cli.estimation.imm import Belief, mix, reweigh

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


def start_moving(observation: Observation, speed_std_mps: float, n_models: int) -> GaussianSum:
    """Begin a moving filter at a measurement that is complete in range and bearing.

    Velocity is zero but for the measured range rate, each component with a deviation.
    """
    speeds, log_weight = _terms(_SPEED_SHARE)
    width = _SPEED_SHARE * speed_std_mps
    return _begun(observation, speed_std_mps, speed_std_mps * speeds, width, log_weight, n_models)


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


def _begun(
    observation: Observation,
    speed_std_mps: float,
    centres: FloatArray,
    width: float | FloatArray,
    log_weight: FloatArray,
    n_models: int,
) -> GaussianSum:
    """Return the terms of a filter that begins, all models with the same ones.

    ``centres`` and ``width`` are of the second component of the state, ``(term, ...)``.
    Own ship's motion along the line of sight belongs to the rate measured, so that its
    error goes with that of the bearing.
    """
    distance, bearing, rate = np.moveaxis(observation.measured, -1, 0)
    var_r, var_b, var_d = np.moveaxis(observation.variance, -1, 0)
    free = speed_std_mps**2
    gain = np.where(np.isfinite(rate), free / (free + var_d), 0.0)
    own, turned = _along_and_across(observation.velocity, bearing)
    along = np.where(np.isfinite(rate), gain * (rate + own), 0.0)
    axes = (-1, *(1,) * distance.ndim)
    if centres.ndim == 1:
        centres = centres.reshape(axes)
    mean = np.stack(np.broadcast_arrays(bearing, centres, distance, along), axis=-1)
    spread = np.zeros((*mean.shape, 4))
    spread[..., 0, 0], spread[..., 1, 1], spread[..., 2, 2] = var_b, width**2, var_r
    spread[..., 3, 3] = free * (1.0 - gain) + (gain * turned) ** 2 * var_b
    spread[..., 0, 3] = spread[..., 3, 0] = gain * turned * var_b
    size = mean.shape[:-1]
    belief = Belief(
        np.broadcast_to(mean, (n_models, *mean.shape)),
        np.broadcast_to(spread, (n_models, *spread.shape)),
        np.full((n_models, *size), 1.0 / n_models),
    )
    return GaussianSum(belief, np.broadcast_to(log_weight.reshape(axes), size))


def _along_and_across(vector: FloatArray, bearing: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return components along and across (to the left of) a line of sight."""
    sine, cosine = np.sin(bearing), np.cos(bearing)
    east, north = vector[..., 0], vector[..., 1]
    return east * cosine + north * sine, north * cosine - east * sine


def predict_moving(
    state: GaussianSum,
    interval_s: float,
    displacement: FloatArray,
    intensity: FloatArray,
    switching: FloatArray,
) -> GaussianSum:
    """Carry a moving filter over own ship's displacement, east and north, m.

    Notes
    -----
    In the frame of the line of sight before the step the contact is carried straight;
    the noise, alike in all directions, is added in the frame of that after it.
    """
    belief = mix(state.belief, switching)
    theta, across, distance, along = np.moveaxis(belief.mean, -1, 0)
    own_along, own_across = _along_and_across(displacement, theta)
    ahead = distance + interval_s * along - own_along
    aside = interval_s * across - own_across
    after = np.hypot(ahead, aside)
    cosine, sine = ahead / after, aside / after
    new_along, new_across = (along * cosine + across * sine, across * cosine - along * sine)
    mean = np.stack([theta + np.arctan2(aside, ahead), new_across, after, new_along], axis=-1)
    one, none = np.ones_like(theta), np.zeros_like(theta)
    step = interval_s * one
    # place and velocity in the old frame by the old state, both carried over the step
    carried = _matrix([
        [-step * across, none, one, step],
        [distance + step * along, step, none, none],
        [-across, none, none, one],
        [along, one, none, none],
    ])  # fmt: skip
    turned = _matrix([
        [cosine, sine, none, none], [-sine, cosine, none, none],
        [none, none, cosine, sine], [none, none, -sine, cosine],
    ])  # fmt: skip
    # the new state by place and velocity in the new frame
    polar = _matrix([
        [none, one / after, none, none],
        [none, -new_along / after, none, one],
        [one, none, none, none],
        [none, new_across / after, one, none],
    ])  # fmt: skip
    slope = polar @ turned @ carried
    noise = velocity_noise(interval_s, intensity)
    noise = noise.reshape(-1, *(1,) * (theta.ndim - 1), 4, 4)
    covariance = slope @ belief.covariance @ np.swapaxes(slope, -1, -2)
    covariance = covariance + polar @ noise @ np.swapaxes(polar, -1, -2)
    return GaussianSum(Belief(mean, covariance, belief.probability), state.log_weight)


def _matrix(rows: list[list[FloatArray]]) -> FloatArray:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def update_moving(
    state: GaussianSum, observation: Observation
) -> tuple[GaussianSum, InnovationFit]:
    """Correct a predicted filter by a scan; say how it agrees with the prediction."""
    return _correct(state, observation, slice(0, 3))


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
    state: GaussianSum, observation: Observation, trusted: slice
) -> tuple[GaussianSum, InnovationFit]:
    """Correct all terms and models and weigh them by what they foresaw."""
    belief = state.belief
    theta, _, distance, along = np.moveaxis(belief.mean, -1, 0)
    own, turned = _along_and_across(observation.velocity, theta)
    expected = np.stack([distance, theta, along - own], axis=-1)
    slope = np.zeros((*theta.shape, 3, 4))
    slope[..., 0, 2] = slope[..., 1, 0] = slope[..., 2, 3] = 1.0
    slope[..., 2, 0] = -turned
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
    density = -0.5 * (np.log(np.linalg.det(spread)) + _distance2(residual, spread, slice(0, 3)))
    by_model = reweigh(belief, density)
    weight = state.log_weight + _log_sum(np.log(belief.probability) + density)
    total = _log_sum(weight)
    weight = weight - total
    distance2 = (by_model * _distance2(residual, spread, trusted)).sum(axis=0)
    fit = InnovationFit(
        total, (np.exp(weight) * distance2).sum(axis=0), known[..., trusted].sum(axis=-1)
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
    share = min(_RANGE_SHARE, relative_std)
    # Terms that are equally apart in ratio: a range is as linear as another then.
    reach = np.log1p(_REACH * relative_std)
    ratio = np.exp(np.arange(0.0, reach + 1e-9, np.log1p(2.0 * _RANGE_SHARE)))
    log_weight = np.log(ratio) - 0.5 * ((ratio - 1.0) / relative_std) ** 2
    log_weight[0] -= np.log(2.0)  # the edge, by the trapezium rule
    log_weight -= _log_sum(log_weight)
    inverse = np.divide.outer(ratio, observation.measured[..., 0])
    return _begun(observation, speed_std_mps, inverse, share * inverse, log_weight, n_models)


def separated(track: GaussianSum, observation: Observation) -> Observation:
    """Return the first measurement of a contact with the bearing of an earlier track.

    A repeater that a source leaves behind is where the source was. Were its bearing that
    of one scan alone, a moving filter, which knows the track, would foresee the next ones
    better though it is wrong. A bearing that the track, corrected by the scan, misses by
    three deviations began elsewhere and stays as it is.
    """
    weight = np.exp(track.log_weight) * track.belief.probability
    angle = track.belief.mean[..., 0]
    bearing = (weight * angle).sum(axis=(0, 1))
    spread = track.belief.covariance[..., 0, 0] + (angle - bearing) ** 2
    variance = (weight * spread).sum(axis=(0, 1))
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
    ahead, aside = _along_and_across(displacement, theta)
    side = -aside
    way2 = ahead**2 + side**2
    s1, s2 = inverse * side, 1.0 - inverse * ahead
    square = s1**2 + s2**2
    root = np.sqrt(square)
    # (root - 1) / s without the difference of large ranges.
    grown = (inverse * way2 - 2.0 * ahead) / (root + 1.0)
    mean = np.stack(
        [theta + np.arctan2(s1, s2), inverse / root, distance + grown + interval_s * false, false],
        axis=-1,
    )
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


def update_drift(state: GaussianSum, observation: Observation) -> tuple[GaussianSum, InnovationFit]:
    """Correct a predicted drifting filter by a scan; say how its bearing agrees."""
    state, fit = _correct(state, observation, slice(1, 2))
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
