"""Error budget of a motion: what nuisances and coloured noise add to white noise.

**Method.** A fact that is not known exactly moves the fitted motion by B^-1 J' dz, with
the residuals' change dz per deviation of that fact; its covariance is added (the
Schmidt form: the estimate stays, its covariance holds the nuisance). Own position and
velocity are Ornstein-Uhlenbeck processes, whose covariance between the rows is summed.
The noise of a table may be coloured: strength and correlation time of every series
come from the restricted likelihood of its residuals, and the meat of the sandwich is
that of white and coloured noise.

**Conventions.** Solver coordinates and rest frequencies; everything in SI.

**References.** Schmidt (1966), Adv. Control Systems 3, 293; Huber (1967); Van Trees,
Bell and Tian (2013), section 4.3.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.coloured_noise import fit_coloured_noise
from uwtrack_cli.motion.target_motion.model import state_jacobian
from uwtrack_cli.motion.target_motion.objective import Residuals, loss_weight, residuals
from uwtrack_cli.motion.target_motion.observability import Information, design_rows, series_slopes
from uwtrack_cli.motion.target_motion.problem import Problem

MOST_CELLS = 1000
"""Cells of a series beyond which rows are summed before their covariance is taken."""

BOUNCE_DEPTHS = "bounce_depths_percent"
"""Name under which the factor of the delays of a reflected path is reported."""

WIDTH_SHARE = 0.25
"""Share of the record that matters as a whole to the motion."""


@dataclass(frozen=True)
class NuisanceDeviations:
    """Standard deviations of what a motion is fitted with; zero is known exactly."""

    sound_speed_mps: float = 0.0
    """Of the sound speed, m/s."""
    compass_deg: float = 0.0
    """Of the compass, degrees."""
    own_position_m: float = 0.0
    """Of each coordinate of own position, m."""
    own_velocity_mps: float = 0.0
    """Of each component of own velocity, m/s."""
    correlation_time_s: float = 100.0
    """Correlation time of own position and velocity, s."""
    is_usual_navigation: bool = False
    """Whether one of the last two is the usual one, because nobody told it."""
    sensor_position_m: FloatArray | None = None
    """Of each coordinate of every sensor of a table, m, shape (sensors,); None for one
    platform."""

    def values(self) -> dict[str, float]:
        """Return the deviations by the name under which they are reported."""
        return {
            "sound_speed_mps": self.sound_speed_mps,
            "compass_deg": self.compass_deg,
            "own_position_m": self.own_position_m,
            "own_velocity_mps": self.own_velocity_mps,
        }


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Covariance of a motion and where it comes from."""

    covariance: FloatArray
    """Of solver coordinates and rest frequencies, all causes together, shape (p, p)."""
    parts: dict[str, FloatArray]
    """Covariance that each nuisance causes, shape (p, p), by its name."""


def error_budget(
    problem: Problem,
    q: FloatArray,
    found: Information,
    deviations: NuisanceDeviations,
    *,
    with_coloured_noise: bool,
) -> ErrorBudget:
    """Add nuisances and coloured noise to the covariance of a motion."""
    r = residuals(problem, q[np.newaxis])
    chain = np.eye(len(found.bread))
    chain[: q.size, : q.size] = state_jacobian(q[np.newaxis])[0]
    rows = design_rows(problem, r) @ chain
    meat = found.meat
    if with_coloured_noise:
        meat = meat + _coloured_meat(problem, r, rows)
    inverse = found.inverse()
    total = inverse @ meat @ inverse
    slopes = series_slopes(problem, r)
    pull = slopes[:, np.newaxis, np.newaxis] * rows
    parts: dict[str, FloatArray] = {}
    if deviations.sensor_position_m is not None:
        parts["sensor_position_m"] = _misplaced_sensors(
            problem, r, pull @ inverse, deviations.sensor_position_m
        )
        total = total + parts["sensor_position_m"]
    for name, std in deviations.values().items():
        if not std:
            continue
        if name.startswith("own_"):
            is_position = name == "own_position_m"
            moved = sum(
                markov_covariance(time, gradient, deviations.correlation_time_s)
                for time, gradient in _own_ship(problem, r, pull, is_position)
            )
            parts[name] = std**2 * (inverse @ moved @ inverse)
        else:
            change = _whitened_change(problem, q, r, name, std)
            shift = inverse @ np.einsum("snp,sn->p", pull, change)
            parts[name] = np.outer(shift, shift)
        total = total + parts[name]
    if problem.bounce is not None:
        # an unknown of the fit with a prior: the covariance holds its error already
        place = q.size + problem.n_tones
        shift = inverse[place] / problem.bounce.relative_std
        parts[BOUNCE_DEPTHS] = np.outer(shift, shift)
    return ErrorBudget(total, parts)


def _misplaced_sensors(
    problem: Problem, r: Residuals, pull: FloatArray, std_m: FloatArray
) -> FloatArray:
    """Covariance of a constant error in the place of every sensor, each its own."""
    streams = len(problem.bearing_weight)
    sensor = np.zeros(problem.n_rows, int) if problem.sensor is None else problem.sensor
    size = pull.shape[-1]
    covariance = np.zeros((size, size))
    slope = r.rest_hz[0][:, np.newaxis] / problem.sound_speed_mps
    for axis in (0, 1):
        angle = -r.prediction.bearing_jacobian[0, axis] * r.side[0]
        rate = slope * r.prediction.rate_jacobian[0, axis]
        change = np.concatenate([problem.bearing_weight * angle, problem.frequency_weight * rate])
        each = np.einsum("snp,sn->np", pull[: streams + problem.n_lines], change)
        for number, std in enumerate(std_m):
            moved = std * each[sensor == number].sum(axis=0)
            covariance += np.outer(moved, moved)
    return covariance


def _whitened_change(
    problem: Problem, q: FloatArray, r: Residuals, name: str, std: float
) -> FloatArray:
    """Change of the whitened residuals by one deviation of a constant nuisance."""
    if name == "compass_deg":
        turned = problem.bearing_weight * r.side[0] * np.radians(std)
        return np.concatenate([turned, np.zeros_like(problem.frequency_weight)])
    moved = replace(problem, sound_speed_mps=problem.sound_speed_mps + std)
    other = residuals(moved, q[np.newaxis], rest_hz=r.rest_hz)
    return np.concatenate([other.bearing[0] - r.bearing[0], other.frequency[0] - r.frequency[0]])


def along_sight(problem: Problem, r: Residuals) -> tuple[FloatArray, FloatArray]:
    """Return what own motion along the line of sight does to whitened lines.

    Per m/s of own velocity and per m of own place, shapes (lines, rows): frequencies
    tell the range rate, delays the range.
    """
    velocity, place = (np.zeros_like(problem.frequency_weight) for _ in range(2))
    for one in r.scaled:
        by = velocity if one.lines.start == 0 and problem.n_tones else place
        slope = r.rest_hz[0, one.lines, np.newaxis] * one.slope[0]
        # the range opens by less when own ship follows
        by[one.lines] = -problem.frequency_weight[one.lines] * slope
    return velocity, place


def _own_ship(
    problem: Problem, r: Residuals, pull: FloatArray, is_position: bool
) -> list[tuple[FloatArray, FloatArray]]:
    """Return times and gradients by own east and by own north: (m,) and (m, p).

    An error of own position moves bearing and range, and its change over an interval
    moves the range rate; an error of own velocity moves the range rate alone.
    """
    streams = problem.bearing_weight.shape[0]
    track, time = problem.track, problem.row_time_s
    behind = track.interval_s * (0.5 if track.before is None else 1.0)
    early: FloatArray = time - behind
    late: FloatArray = early + track.interval_s
    velocity, place = along_sight(problem, r)
    found: list[tuple[FloatArray, FloatArray]] = []
    for axis, sight in enumerate(
        (np.sin(r.prediction.bearing_rad[0]), np.cos(r.prediction.bearing_rad[0]))
    ):
        rate = np.einsum("snp,sn->np", pull[streams:], velocity * sight)
        if not is_position:
            found.append((time, rate))
            continue
        turn = -r.prediction.bearing_jacobian[0, axis] * r.side[0]
        here = np.concatenate([problem.bearing_weight * turn, place * sight])
        angle = np.einsum("snp,sn->np", pull, here)
        step = rate / track.interval_s[:, np.newaxis]
        times = np.concatenate([time, late, early])
        found.append((times, np.concatenate([angle, step, -step])))
    return found


def markov_covariance(
    time_s: FloatArray, gradient: FloatArray, correlation_time_s: float
) -> FloatArray:
    """Sum g_i g_j' exp(-|t_i - t_j| / tau) over all pairs, in one pass.

    One gradient, shape (m, p), per time, s, in any order.

    Examples
    --------
    >>> one = np.ones((2, 1))
    >>> float(markov_covariance(np.array([0.0, 1.0]), one, 1.0)[0, 0].round(6))
    2.735759
    """
    order = np.argsort(time_s, kind="stable")
    rows = gradient[order]
    decay = np.exp(-np.diff(time_s[order], prepend=time_s[order[:1]]) / correlation_time_s)
    past = np.zeros_like(rows)
    for row in range(1, len(rows)):
        past[row] = decay[row] * (past[row - 1] + rows[row - 1])
    cross = past.T @ rows
    return np.asarray(rows.T @ rows + cross + cross.T)


def looks_white(deviation: FloatArray) -> bool:
    """Return whether unit residuals in time show neither colour nor a larger variance.

    Notes
    -----
    Sums of blocks of 1, 4, 16 ... residuals over the root of their number have unit
    variance when white; each mean square must lie within two deviations of one. It
    saves the search for a correlation time where there is none to find.
    """
    length = 1
    while deviation.size // length >= 8:
        count = deviation.size // length
        sums = deviation[: count * length].reshape(count, length).sum(axis=1)
        if float(np.mean(sums**2)) / length > 1.0 + 2.0 * np.sqrt(2.0 / count):
            return False
        length *= 4
    return True


def _coloured_meat(problem: Problem, r: Residuals, rows: FloatArray) -> FloatArray:
    """Sum over the series what coloured noise adds to the variance of the gradient."""
    z = np.concatenate([r.bearing[0], r.frequency[0]])
    weight = np.concatenate([problem.bearing_weight, problem.frequency_weight])
    influence = loss_weight(z, problem.loss) * z
    share = np.concatenate([np.ones(len(r.bearing[0])), problem.line_share])
    size = rows.shape[-1]
    added = np.zeros((size, size))
    width_s = WIDTH_SHARE * float(np.ptp(problem.row_time_s))
    if not width_s:
        return added
    for number, (series, measured) in enumerate(zip(influence, weight > 0, strict=True)):
        others = np.delete(rows, number, axis=0).reshape(-1, size)
        design = rows[number]
        if not measured.any():
            continue
        power = float(np.mean(series[measured] ** 2))
        if problem.loss == "squares":
            power = float(share[number])
        scale = np.sqrt(max(power, 1e-300))
        if looks_white(series[measured] / scale):
            continue
        upper = np.asarray(np.linalg.qr(others, mode="r"))
        noise = fit_coloured_noise(
            series / scale,
            measured.astype(float),
            problem.row_time_s,
            design,
            width_s,
            (np.zeros(len(upper)), upper),
        )
        if noise.is_white:
            continue
        kept = np.flatnonzero(measured)
        starts = np.unique(
            np.linspace(0, kept.size, min(kept.size, MOST_CELLS), endpoint=False)
        ).astype(int)
        count = np.diff(np.append(starts, kept.size))
        cells = np.add.reduceat(design[kept], starts, axis=0)
        time = np.add.reduceat(problem.row_time_s[kept], starts) / count
        lag = np.abs(time[:, None] - time[None, :])
        kernel = np.zeros_like(lag)
        for variance, correlation_time in zip(
            noise.variance, noise.correlation_time_s, strict=True
        ):
            kernel += variance * np.exp(-lag / correlation_time)
        white = design[kept].T @ design[kept]
        coloured = cells.T @ kernel @ cells
        added += scale**2 * (noise.inflation * (white + coloured) - white)
    return added
