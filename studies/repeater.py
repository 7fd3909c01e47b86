"""A moving source, the repeater that it leaves behind, and an observer with a sonar.

**Method.** The source runs straight and may turn when the repeater separates. Until then
there is one contact, from then on there are two: the source itself, and the repeater
that stays where it was left, drifts, and answers with a growing delay and a constant
Doppler shift. The observer steers a constant bearing until the separation.

**Conventions.** Metres, seconds, compass degrees. Time zero is 60 s before the
separation. The aspect is the angle between the source's course and the line of sight
from the observer, 0 for a source that runs straight away.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray

_STEP_S = 0.1
_SOURCE_MPS, _OBSERVER_MPS = 15.4, 23.1
_SPLIT_S, _END_S = 60.0, 90.0


@dataclass(frozen=True)
class RepeaterScene:
    """One of the published experiments.

    Parameters
    ----------
    aspect_deg
        Angle between source course and line of sight at the separation, degrees.
    range_m
        Range at the separation, m.
    interval_s
        Time between scans, s.
    turns
        Whether the source turns 45 degrees right in 1.2 s, and the observer 22.5 degrees
        right in 0.9 s, when the repeater separates.
    range_std_m
        Deviation of measured ranges, m.
    bearing_std_deg
        Deviation of measured bearings, degrees.
    range_rate_std_mps
        Deviation of measured range rates, m/s.
    vessel_course_deg
        Course of a second vessel in place of the repeater, compass degrees; None is the
        repeater.
    vessel_speed_mps
        Speed of the second vessel, m/s.
    drift_mps
        Root intensity of the repeater's drift, m/s^(1/2).
    false_rate_mps
        False part of the repeater's range rate, m/s.
    acceleration_mps2
        Root intensity of the source's accelerations, m/s^2 over 1 s; 0 runs straight.
    """

    aspect_deg: float = 80.0
    range_m: float = 1000.0
    interval_s: float = 2.0
    turns: bool = False
    range_std_m: float = 5.0
    bearing_std_deg: float = float(np.rad2deg(0.035))
    range_rate_std_mps: float = 1.0
    vessel_course_deg: float | None = None
    vessel_speed_mps: float = 12.0
    drift_mps: float = 1.0
    false_rate_mps: float = 12.8
    acceleration_mps2: float = 0.0


@dataclass(frozen=True)
class RepeaterRuns:
    """Measurements of many runs on one geometry."""

    navigation_time_s: FloatArray
    """Times of own ship's positions, s, ``(time,)``."""
    own_ship_m: FloatArray
    """Own ship's east and north every 0.1 s, ``(time, 2)``."""
    time_s: FloatArray
    """Times of the scans, s, ``(scan,)``."""
    source: FloatArray
    """Range (m), compass bearing (degrees), range rate (m/s) of the source, ``(scan, run, 3)``."""
    repeater: FloatArray
    """The same of the repeater; nan before the separation."""


def simulate_repeater(rng: np.random.Generator, scene: RepeaterScene, runs: int) -> RepeaterRuns:
    """Draw the measurements of a number of runs.

    ``runs``: number of runs, from 1.
    """
    clock = np.arange(0.0, _END_S + 0.5 * _STEP_S, _STEP_S)
    aspect = np.deg2rad(scene.aspect_deg)
    lead = np.arcsin(_SOURCE_MPS * np.sin(aspect) / _OBSERVER_MPS)
    turn = 1.0 if scene.turns else 0.0
    left = np.array([0.0, scene.range_m])
    source, source_rate = _path(clock, _SOURCE_MPS, aspect, 45.0 * turn, 1.2, left)
    own, own_rate = _path(clock, _OBSERVER_MPS, lead, 22.5 * turn, 0.9, 0.0 * left)
    time_s = np.arange(scene.interval_s, _END_S + 1e-9, scene.interval_s)
    at = np.round(time_s / _STEP_S).astype(np.int64)
    deviation = np.array([scene.range_std_m, scene.bearing_std_deg, scene.range_rate_std_mps])
    size = (time_s.size, runs)
    off, off_rate = _wander(rng, scene.acceleration_mps2, clock, runs)
    seen = _measure(
        (source - own)[at][:, None] + off[at], (source_rate - own_rate)[at][:, None] + off_rate[at]
    )
    after = np.maximum(time_s - _SPLIT_S, 0.0)
    walk = np.diff(np.concatenate([[0.0], after]))
    drift = rng.standard_normal((*size, 2)) * np.sqrt(walk)[:, None, None]
    place = left + scene.drift_mps * np.cumsum(drift, axis=0)
    if scene.vessel_course_deg is None:
        echo = _measure(place - own[at][:, None], -own_rate[at][:, None])
        echo[..., 0] += (scene.false_rate_mps * after)[:, None]
        echo[..., 2] += scene.false_rate_mps
    else:
        way = np.deg2rad(scene.vessel_course_deg)
        velocity = scene.vessel_speed_mps * np.array([np.sin(way), np.cos(way)])
        place = left + np.multiply.outer(after, velocity) - own[at]
        echo = np.repeat(_measure(place, velocity - own_rate[at])[:, None], runs, 1)
    echo += deviation * rng.standard_normal((*size, 3))
    echo[time_s < _SPLIT_S - 1e-9] = np.nan
    noise = deviation * rng.standard_normal((*size, 3))
    return RepeaterRuns(clock, own, time_s, seen + noise, echo)


def _wander(
    rng: np.random.Generator, acceleration_mps2: float, clock: FloatArray, runs: int
) -> tuple[FloatArray, FloatArray]:
    """Return what accelerations add to place and velocity, 0 at the separation."""
    if not acceleration_mps2:
        return np.zeros((clock.size, 1, 2)), np.zeros((clock.size, 1, 2))
    push = rng.standard_normal((clock.size, runs, 2))
    rate = acceleration_mps2 * np.sqrt(_STEP_S) * np.cumsum(push, axis=0)
    split = int(np.argmin(np.abs(clock - _SPLIT_S)))
    rate -= rate[split]
    place = _STEP_S * np.cumsum(rate, axis=0)
    return place - place[split], rate


def _path(
    clock: FloatArray,
    speed_mps: float,
    course: float,
    turn_deg: float,
    turn_s: float,
    at_split: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities of a platform that turns at the separation."""
    share = np.clip((clock - _SPLIT_S) / turn_s, 0.0, 1.0)
    heading = course + np.deg2rad(turn_deg) * share
    rate = speed_mps * np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    way = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * _STEP_S, axis=0)
    place = np.concatenate([np.zeros((1, 2)), way])
    split = int(np.argmin(np.abs(clock - _SPLIT_S)))
    return place - place[split] + at_split, rate


def _measure(place: FloatArray, rate: FloatArray) -> FloatArray:
    """Return range, compass bearing and range rate."""
    distance = np.hypot(place[..., 0], place[..., 1])
    bearing = np.rad2deg(np.arctan2(place[..., 0], place[..., 1]))
    closing = (place * rate).sum(axis=-1) / distance
    return np.stack([distance, bearing, closing], axis=-1)
