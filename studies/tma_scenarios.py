"""The three scenarios of Chang et al. 2003, with truth from its own formulas.

**Conventions.** One thousand measurements, six seconds apart; index k has the time
6 k s. The interval from k to k + 1 uses own speed and course of index k. The sound
speed is 1480 m/s. Nothing here shares a formula with the estimator.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.target_motion.own_ship import OwnPath, make_observer_track
from uwtrack_cli.motion.target_motion.problem import Problem

COUNT, STEP_S, SOUND_SPEED_MPS, REST_HZ = 1000, 6.0, 1480.0, 650.0
BEARING_STD_DEG, FREQUENCY_STD_HZ = 1.0, 0.25
TARGETS = {
    "S1-T1": (135.0, 0.0),
    "S1-T2": (225.0, 90.0),
    "S1-T3": (135.0, 270.0),
    "S1-T4": (45.0, 270.0),
    "S2": (315.0, 90.0),
    "S3": (270.0, 45.0),
}
"""Course and initial bearing of every target, degrees; all 8 kn at 20 000 m."""
JITTER_SEED = 2003


class TrueSeries(NamedTuple):
    """Series without noise; arrays of shape (index,)."""

    bearing_rad: FloatArray
    """Compass bearing, rad."""
    range_m: FloatArray
    """Range, m."""
    frequency_hz: FloatArray
    """Frequency, Hz."""


@dataclass(frozen=True, eq=False)
class TmaScenario:
    """Own track (with one row before the first measurement) and the truth."""

    name: str
    """Name of the scenario."""
    own_east_m: FloatArray
    """Own ship's east, m, one row before the first measurement on."""
    own_north_m: FloatArray
    """Own ship's north, m."""
    range_m: float
    """Range of the target at the first measurement, m."""
    bearing_deg: float
    """Bearing of the target at the first measurement, compass degrees."""
    speed_mps: float
    """Speed of the target, m/s."""
    course_deg: float
    """Course of the target, compass degrees."""

    def truth(self) -> TrueSeries:
        """Return what own ship would measure without noise, at each index."""
        time = STEP_S * np.arange(-1, COUNT)
        bearing, course = np.radians(self.bearing_deg), np.radians(self.course_deg)
        away = self.range_m * np.sin(bearing) + self.speed_mps * time * np.sin(course)
        up = self.range_m * np.cos(bearing) + self.speed_mps * time * np.cos(course)
        away, up = away - self.own_east_m, up - self.own_north_m
        distance = np.hypot(away, up)
        shift = np.diff(distance) / (STEP_S * SOUND_SPEED_MPS)
        return TrueSeries(np.arctan2(away, up)[1:], distance[1:], REST_HZ * (1.0 - shift))

    def solution(self) -> FloatArray:
        """Return the truth in solver coordinates (ln R, bearing, vx, vy)."""
        course = np.radians(self.course_deg)
        return np.array([
            np.log(self.range_m),
            np.radians(self.bearing_deg),
            self.speed_mps * np.sin(course),
            self.speed_mps * np.cos(course),
        ])  # fmt: skip


def make_scenario(name: str) -> TmaScenario:
    """Make a scenario by name.

    Parameters
    ----------
    name
        S1-T1 ... S1-T4, S2 or S3.
    """
    speed_kn, heading_deg = _own_ship(name)
    step = speed_kn * KNOT_MPS * STEP_S
    east = step * np.sin(np.radians(heading_deg))
    north = step * np.cos(np.radians(heading_deg))
    # one interval back at the first velocity, for the Doppler of the first row
    own_east = np.concatenate([[-east[0], 0.0], np.cumsum(east[:-1])])
    own_north = np.concatenate([[-north[0], 0.0], np.cumsum(north[:-1])])
    course_deg, bearing_deg = TARGETS[name]
    return TmaScenario(name, own_east, own_north, 20_000.0, bearing_deg, 8.0 * KNOT_MPS, course_deg)


def _own_ship(name: str) -> tuple[FloatArray, FloatArray]:
    k = np.arange(COUNT)
    if name.startswith("S1"):
        outer = (k < 250) | (k >= 750)
        return np.where(outer, 5.0, 8.0), np.where(outer, 300.0, 240.0)
    if name == "S2":
        # own speed varies by a knot from one interval to the next
        jitter = np.random.default_rng(JITTER_SEED).standard_normal(COUNT)
        return 6.0 + jitter, 0.3 * k
    return np.full(COUNT, 6.0), np.full(COUNT, 90.0)


def make_problem(scenario: TmaScenario, *, noise: float, runs: int = 1, seed: int = 0) -> Problem:
    """Draw noisy measurements of a scenario.

    ``noise``: multiple of the deviations 1 degree and 0.25 Hz; 1 or 5 in the paper.
    ``runs``: number of independent records.
    """
    bearing, _, frequency = scenario.truth()
    draw = np.random.default_rng(seed).standard_normal((runs, 2, 1, COUNT))
    bearing_std = noise * np.radians(BEARING_STD_DEG)
    frequency_std = noise * FREQUENCY_STD_HZ
    time = STEP_S * np.arange(-1, COUNT)
    path = OwnPath(time, scenario.own_east_m, scenario.own_north_m, np.nan * time)
    return Problem(
        track=make_observer_track(path, time[1:], "interval", STEP_S),
        bearing_rad=bearing + bearing_std * draw[:, 0],
        bearing_weight=np.full((1, COUNT), 1.0 / bearing_std),
        frequency_hz=frequency + frequency_std * draw[:, 1],
        frequency_weight=np.full((1, COUNT), 1.0 / frequency_std),
        sound_speed_mps=SOUND_SPEED_MPS,
    )
