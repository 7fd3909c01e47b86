"""Did the target manoeuvre? One change of velocity, at an unknown time, is always tried.

**Method.** A change of velocity dv at the time s moves what is measured at t > s by
(d/dv - s d/dx) of the model: its partials by the velocity less s times those by the
position. For many instants s the two unknowns of dv are added to the linearised model
of the straight motion, whose own unknowns are projected out with those of sound speed
and compass (or of the offset of every sensor), and what they gain in the misfit is compared with what noise gains at the
best of so many instants. The gain is that of noise with a memory: the residuals of
bearings and frequencies, less the change itself, tell how far their sums scatter more
than those of independent ones.

**Conventions.** Times count from the first measurement; the gain is that of the misfit
(a chi-square with two degrees of freedom and a search).

**References.** Rao (1948), Proc. Camb. Phil. Soc. 44, 50 (score test); Davies (1987),
Biometrika 74, 33 (a search over an unknown instant).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.least_squares import orthonormal
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.inputs import correlation_inflation
from uwtrack_cli.motion.target_motion.objective import Residuals, loss_weight, residuals
from uwtrack_cli.motion.target_motion.problem import Problem

N_INSTANTS = 41
"""Instants at which the target may have changed its velocity."""

FIRST_SHARE, LAST_SHARE = 0.05, 0.95
"""Where they begin and end, as shares of the rows."""

FEWEST_ROWS = 20
"""Rows below which no manoeuvre is sought."""

SMALLEST_CORRELATION = 3.0
"""Correlation of neighbours, in its deviations, from which noise has a memory."""

LARGEST_DECAY = 0.98
"""Correlation of neighbours of the slowest Markov noise."""

LARGEST_CHANCE_GAIN = 14.5
"""Gain that straight targets exceed in less than 2 % of the records: see
studies/constants/manoeuvre.py. With 13, 17 of 600 independent records (seed 4000) did; with
this one 4 of 600 (seed 8000: 0.2 to 1.7 %)."""

COLOURED_CHANCE_GAIN = 20.0
"""The same where noise has a memory, whose strength is known less well."""

LARGEST_WHITE = 2.0
"""Inflation up to which the noise counts as white: that of white noise is about 1.5."""


@dataclass(frozen=True)
class Manoeuvre:
    """The change of velocity that gains most."""

    time_s: float
    """When it was, s from the first measurement; nan where it was not sought."""
    gain: float
    """What it gains in the misfit, noise with a memory allowed for."""
    chance_gain: float = 0.0
    """What straight targets gain in less than 2 % of such records."""

    @property
    def is_certain(self) -> bool:
        """Whether straight targets hardly ever gain so much."""
        return self.gain > self.chance_gain


def find_manoeuvre(
    problem: Problem, q: FloatArray, nuisances: NuisanceDeviations, overlap_rows: int
) -> Manoeuvre:
    """Seek one change of the target's velocity in a record.

    Measurements still share samples at ``overlap_rows``; 0 for independent ones.
    """
    if problem.n_rows < FEWEST_ROWS:
        return Manoeuvre(float("nan"), 0.0)
    r = residuals(problem, q[np.newaxis])
    parts = _Parts(problem, r, nuisances)
    rows = np.linspace(FIRST_SHARE, LAST_SHARE, N_INSTANTS) * (problem.n_rows - 1)
    instants = problem.row_time_s[np.unique(rows.astype(int))]
    inflation = np.ones(2)
    best, change = _search(parts, instants, inflation)
    left = parts.z - change
    kinds = [parts.z_of(left, bearings=True), parts.z_of(left, bearings=False)]
    weights = (problem.bearing_weight, problem.frequency_weight)
    inflation = np.array([
        max(correlation_inflation(z, weight, overlap_rows), _markov_inflation(z))
        if z.size
        else 1.0
        for z, weight in zip(kinds, weights, strict=True)
    ])  # fmt: skip
    best, _ = _search(parts, instants, inflation)
    is_white = inflation.max() < LARGEST_WHITE
    chance = LARGEST_CHANCE_GAIN if is_white else COLOURED_CHANCE_GAIN
    return replace(best, chance_gain=chance)


def _markov_inflation(z: FloatArray) -> float:
    """Return the variance of sums of white and first-order Markov noise together.

    Over that of independent values; a few lags tell it with less scatter than the
    power at zero frequency does. ``z`` has the shape (stream, row).
    """
    value = np.clip(z, -5.0, 5.0).sum(axis=0)
    n = value.size
    power, one, two = (
        float(value[lag:] @ value[: n - lag]) / n for lag in range(3)
    )  # fmt: skip
    if not one > SMALLEST_CORRELATION / np.sqrt(n) * power:
        return 1.0
    decay = float(np.clip(two / one, 0.0, LARGEST_DECAY))
    share = min(one / (max(decay, one / power) * power), 1.0)
    return float(1.0 + 2.0 * share * decay / (1.0 - decay))


class _Parts:
    """Whitened residuals and partials of one record, value by value."""

    def __init__(
        self, problem: Problem, r: Residuals, nuisances: NuisanceDeviations
    ) -> None:
        share_b = np.sqrt(np.maximum(loss_weight(r.bearing[0], problem.loss), 0.0))
        share_f = np.sqrt(np.maximum(loss_weight(r.frequency[0], problem.loss), 0.0))
        self._shape_b = r.bearing[0].shape
        self._shape_f = r.frequency[0].shape
        self.z = np.concatenate(
            [(share_b * r.bearing[0]).ravel(), (share_f * r.frequency[0]).ravel()]
        )
        weight_b = share_b * problem.bearing_weight * r.side[0]
        weight_f = share_f * problem.frequency_weight
        bearing = weight_b[:, :, np.newaxis] * r.prediction.bearing_jacobian[0].T
        rate = -r.rest_hz[0][:, np.newaxis] / problem.sound_speed_mps * weight_f
        frequency = rate[:, :, np.newaxis] * r.prediction.rate_jacobian[0].T
        self.state = np.concatenate([bearing.reshape(-1, 4), frequency.reshape(-1, 4)])
        time = problem.row_time_s
        self.time_s = np.concatenate(
            [np.tile(time, self._shape_b[0]), np.tile(time, self._shape_f[0])]
        )
        streams = self._shape_b[0]
        std = problem.offset_std_rad
        n_constant = 1 if std is None else streams
        n_lines = self._shape_f[0]
        others = np.zeros((self.z.size, n_lines + 1 + n_constant))
        n_bearings = share_b.size
        for line in range(n_lines):
            begin = n_bearings + line * time.size
            others[begin : begin + time.size, line] = weight_f[line] * r.factor[0]
        speed = -rate * r.prediction.rate_mps[0]  # by the logarithm of sound speed
        relative = nuisances.sound_speed_mps / problem.sound_speed_mps
        others[n_bearings:, n_lines] = relative * speed.ravel()
        self.prior_z: FloatArray = np.zeros(1 + n_constant)
        if std is None:
            compass = np.radians(nuisances.compass_deg)
            others[:n_bearings, -1] = (
                compass * np.broadcast_to(weight_b, self._shape_b).ravel()
            )
        else:
            plain = share_b * problem.bearing_weight
            for stream in range(streams):
                begin = stream * time.size
                own = slice(begin, begin + time.size)
                others[own, n_lines + 1 + stream] = std[stream] * plain[stream]
            known = np.maximum(std, 1e-300)
            self.prior_z[1:] = np.where(std > 0, r.offset_rad[0] / known, 0.0)
        self.others = others

    def z_of(self, values: FloatArray, *, bearings: bool) -> FloatArray:
        """Return the values of one kind, shape (stream, row)."""
        n = self._shape_b[0] * self._shape_b[1]
        if bearings:
            return values[:n].reshape(self._shape_b)
        return values[n:].reshape(self._shape_f)

    def scale(self, inflation: FloatArray) -> FloatArray:
        """Return the factor of every value that its kind's inflation asks for."""
        n = self._shape_b[0] * self._shape_b[1]
        factor = np.full(self.z.size, inflation[1])
        factor[:n] = inflation[0]
        return np.asarray(1 / np.sqrt(factor))


def _search(
    parts: _Parts, instants_s: FloatArray, inflation: FloatArray
) -> tuple[Manoeuvre, FloatArray]:
    """Return the best change of velocity, and what it does to the residuals."""
    scale = parts.scale(inflation)
    straight = np.concatenate([parts.state, parts.others], axis=1) * scale[:, None]
    # sound speed and constant bearing errors have unit priors; the motion is free
    n_priors = parts.prior_z.size
    n_free = straight.shape[1] - n_priors
    prior = np.zeros((n_priors, straight.shape[1]))
    prior[:, n_free:] = np.eye(n_priors)
    basis = orthonormal(np.concatenate([straight, prior]))
    z = np.concatenate([scale * parts.z, parts.prior_z])
    z = z - basis @ (basis.T @ z)
    best, change = Manoeuvre(float("nan"), 0.0), np.zeros(parts.z.size)
    for at in instants_s:
        later = (parts.time_s > at)[:, np.newaxis]
        turned = later * (parts.state[:, 2:] - at * parts.state[:, :2])
        turned = np.concatenate(
            [turned * scale[:, np.newaxis], np.zeros((n_priors, 2))]
        )
        own = orthonormal(turned - basis @ (basis.T @ turned))
        along = own.T @ z
        gain = float(along @ along)
        if gain > best.gain:
            best, change = Manoeuvre(float(at), gain), (own @ along)[:-n_priors] / scale
    return best, change
