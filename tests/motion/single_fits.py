"""Fits of one kind of measurement alone: bearings, levels or frequencies.

**Method.** The joint fit with only one kind given: search over time and width, then
robust maximum likelihood. Each tells a part: bearings d/v, time, side and course, with
no law of spreading; levels d/v and time; frequencies speed, d/v and time.

**Conventions.** Times in seconds, angles in compass degrees; the deviations take
their scale from the data.

**References.** Choi et al. (2014), eqs. 3-6 with free level, floor and rest frequency.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.passage.fit.estimator import PassageFit, fit_passage, take_rows
from uwtrack_cli.motion.passage.fit.initial_estimates import find_initial_estimates
from uwtrack_cli.motion.passage.model.measurements import PassageData, make_blocks


@dataclass(frozen=True)
class SingleFit:
    """What one kind of measurement tells; nan is "cannot be told".

    ``misfit`` is the variance of the residuals, slow ones as sums, over what the
    deviations given promise: far above one, the model is not the right one.
    """

    arrival_time_s: float
    arrival_time_std_s: float
    range_over_speed_s: float
    range_over_speed_std_s: float
    speed_mps: float
    speed_std_mps: float
    bearing_deg: float
    bearing_std_deg: float
    turn: int
    misfit: float


def fit_bearings(
    time_s: FloatArray, bearing_deg: FloatArray, bearing_std_deg: FloatArray
) -> SingleFit:
    """Fit b0 + turn * atan((t - t_arr) / r) to bearings.

    A constant compass error turns the course only; d/v and time stay right.

    Parameters
    ----------
    time_s
        Times in seconds, rising.
    bearing_deg
        Compass bearings from the sensor in degrees; nan is missing.
    bearing_std_deg
        Their standard deviations in degrees.

    Examples
    --------
    >>> t = np.arange(0.0, 200.0)
    >>> b = 30 + np.rad2deg(np.arctan((t - 80) / 25))
    >>> fit = fit_bearings(t, b, np.ones(t.size))
    >>> round(fit.arrival_time_s, 3), round(fit.range_over_speed_s, 3), fit.turn
    (80.0, 25.0, 1)
    """
    data = _data(time_s, bearing=(bearing_deg[None], bearing_std_deg[None]))
    return _single(data, Medium(1500.0), 1)


def fit_envelope(time_s: FloatArray, level_db: FloatArray, level_std_db: FloatArray) -> SingleFit:
    """Fit the level of a passage with a free floor, in decibels.

    Parameters
    ----------
    time_s
        Times in seconds, rising.
    level_db
        Levels in dB; nan is missing.
    level_std_db
        Their standard deviations in dB.

    Notes
    -----
    L = 10 log10(10^(K/10) r^2 / (r^2 + (t - t_arr)^2) + 10^(N/10)); a misfit above
    four tells of fringes of the surface image or another law of spreading.
    """
    data = _data(time_s, level=(level_db[None], level_std_db[None]))
    return _single(data, Medium(1500.0), 2)


def fit_doppler(
    time_s: FloatArray,
    frequency_hz: FloatArray,
    frequency_std_hz: FloatArray,
    sound_speed_mps: float,
) -> SingleFit:
    """Fit one motion to the frequencies of one line or several.

    Parameters
    ----------
    time_s
        Times in seconds, rising.
    frequency_hz
        Frequencies in Hz, shape (lines, n); nan is missing.
    frequency_std_hz
        Their standard deviations in Hz.
    sound_speed_mps
        Sound speed in m/s.
    """
    data = _data(time_s, frequency=(frequency_hz, frequency_std_hz))
    return _single(data, Medium(sound_speed_mps), 0)


def _data(time_s: FloatArray, **kinds: tuple[FloatArray, FloatArray]) -> PassageData:
    none = np.full((0, time_s.size), np.nan)
    blank = np.full((1, time_s.size), np.nan)
    frequency = kinds.get("frequency", (none, none))
    bearing = kinds.get("bearing", (blank, blank))
    level = kinds.get("level", (blank, blank))
    return PassageData(np.asarray(time_s, float), *frequency, *bearing, *level)


def _single(data: PassageData, medium: Medium, kind: int) -> SingleFit:
    blocks = make_blocks(data)
    starts = find_initial_estimates(blocks, medium)
    if not starts.turn.size:
        msg = "the measurements show no passage: nothing changes as one would."
        raise DataError(msg)
    fits = fit_passage(blocks, starts.theta, starts.turn, medium, with_coloured_noise=False)
    best = take_rows(fits, [int(np.argmin(fits.cost))])
    fit = fit_passage(blocks, best.theta, best.turn, medium)
    return _report(fit, medium, kind)


def _report(fit: PassageFit, medium: Medium, kind: int) -> SingleFit:
    deviation = np.sqrt(np.diag(fit.covariance[0]))
    width = float(fit.range_over_speed_s[0])
    speed = float(fit.theta[0, 2]) if kind == 0 else 0.0
    noise = fit.noises[kind]
    scale = float(np.mean(noise.scale[0] ** 2)) if noise.scale.size else 1.0
    has_bearing = kind == 1
    return SingleFit(
        float(fit.theta[0, 0]) + width * speed / medium.sound_speed_mps,
        float(deviation[0]),
        width,
        float(deviation[1]),
        speed if kind == 0 else float("nan"),
        float(deviation[2]),
        float(fit.bearing_deg[0]) if has_bearing else float("nan"),
        float(deviation[3]),
        int(fit.turn[0]) if has_bearing else 0,
        scale * float(noise.inflation[0]),
    )
