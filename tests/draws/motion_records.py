"""Coverage of target motion when what is told is not exact.

The published scenarios with what the program cannot know drawn from what it is told:
sound speed, compass, own navigation (Ornstein-Uhlenbeck errors of position), and noise
that is coloured, AR(1), and not told at all. Nothing of the package is used to make the
measurements but the tracks of the scenarios. A quantity is covered when it lies within
1.96 stated deviations, and when it lies within the stated interval.
"""

from dataclasses import dataclass, replace

import numpy as np

from studies.tma_scenarios import COUNT, STEP_S, make_scenario
from tests.draws.sonar_tables import heard, own_ship
from uwtrack_cli.motion.options import MotionModel, Nuisances
from uwtrack_cli.motion.tma import estimate_motion

EXACT = {
    "sound_speed_std_mps": 0.0, "compass_std_deg": 0.0, "position_std_m": 0.0,
    "velocity_std_mps": 0.0,
}  # fmt: skip
SOUND_MPS, CORRELATION_S = 1480.0, 100.0
KINDS = {
    "exact": {},
    "sound speed 1 %": {"sound_speed_std_mps": 14.8},
    "compass 1 degree": {"compass_std_deg": 1.0},
    "navigation 5 m": {"position_std_m": 5.0},
    "AR(1) 0.9": {},
    "all": {"sound_speed_std_mps": 14.8, "compass_std_deg": 1.0, "position_std_m": 5.0},
}
CASES = ("S1-T1", "S1-T3", "S2", "S3")
NAMES = ("range", "bearing", "speed", "course")


@dataclass(frozen=True)
class Score:
    """Errors, their stated deviations, and whether the intervals hold the truth."""

    error: np.ndarray
    std: np.ndarray
    holds: np.ndarray

    @property
    def deviations(self):
        """Errors in stated deviations."""
        return np.abs(self.error) / self.std


def markov(rng, count, step_s, correlation_s, shape=()):
    """Unit Ornstein-Uhlenbeck noise at regular times, shape (*shape, count)."""
    decay = np.exp(-step_s / correlation_s)
    value = rng.standard_normal((*shape, count))
    for k in range(1, count):
        value[..., k] = decay * value[..., k - 1] + np.sqrt(1 - decay**2) * value[..., k]
    return value


def ar1(rng, count, shape, coefficient=0.9):
    """Unit first-order autoregressive noise, shape (*shape, count)."""
    return markov(rng, count, 1.0, -1.0 / np.log(coefficient), shape)


def draw(name, kind, seed, noise=1.0):
    """Return table and navigation of a drawn record."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), CASES.index(name)])
    told = {**EXACT, **KINDS[kind]}
    bearing, _, frequency = make_scenario(name).truth()
    colour = ar1(rng, COUNT, (2,)) if kind in {"AR(1) 0.9", "all"} else None
    white = rng.standard_normal((2, COUNT)) if colour is None else colour
    sound = SOUND_MPS + told["sound_speed_std_mps"] * rng.standard_normal()
    shift = (frequency - 650.0) * SOUND_MPS / sound
    compass = told["compass_std_deg"] * rng.standard_normal()
    table = heard(name, noise=noise)
    table = replace(
        table,
        bearing_deg=(np.degrees(bearing) + compass + noise * white[0]) % 360.0,
        frequency_hz=(650.0 + shift + 0.25 * noise * white[1])[:, np.newaxis],
    )
    own = own_ship(name)
    error = told["position_std_m"] * markov(rng, own.time_s.size, STEP_S, CORRELATION_S, (2,))
    return table, replace(own, east_m=own.east_m + error[0], north_m=own.north_m + error[1])


def score(name, kind, seed):
    """Analyse a drawn record."""
    table, own = draw(name, kind, seed)
    found = estimate_motion(
        table, None, own, sound_speed_mps=SOUND_MPS, updates=1,
        model=MotionModel(doppler="interval"),
        nuisances=Nuisances(**{**EXACT, **KINDS[kind]}),
    )  # fmt: skip
    scenario = make_scenario(name)
    pairs = (
        (found.range_m, found.range_std_m, scenario.range_m),
        (found.bearing_deg, found.bearing_std_deg, scenario.bearing_deg),
        (found.speed_mps, found.speed_std_mps, scenario.speed_mps),
        (found.course_deg, found.course_std_deg, scenario.course_deg),
    )
    error = np.array([value[0] - truth for value, _, truth in pairs])
    error[[1, 3]] = (error[[1, 3]] + 180.0) % 360.0 - 180.0
    std = np.array([std[0] for _, std, _ in pairs])
    width = (found.course_high_deg[0] - found.course_low_deg[0]) % 360.0
    holds = np.array([
        found.range_low_m[0] <= scenario.range_m <= np.nan_to_num(
            found.range_high_m[0], nan=np.inf
        ),
        found.speed_low_mps[0] <= scenario.speed_mps <= np.nan_to_num(
            found.speed_high_mps[0], nan=np.inf
        ),
        (scenario.course_deg - found.course_low_deg[0]) % 360.0 <= width,
    ])  # fmt: skip
    return Score(error, std, holds)
