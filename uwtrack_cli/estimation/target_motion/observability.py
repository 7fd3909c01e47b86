"""What the data can and cannot tell of a motion, in numbers and words.

**Method.** The eigenvalues of the Fisher information, scaled to unit diagonal, tell
rank and condition; the eigenvector of the smallest tells the combination of
parameters that changes the fit least (Jauffret & Pillon 1996). The condition number
does not rank cases: deviations and the probability of a stated accuracy do.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.target_motion.information import (
    RANK_THRESHOLD,
    Information,
    criterion_probability,
)
from uwtrack_cli.estimation.target_motion.problem import Track

RANGE_CRITERION = 0.10
SPEED_CRITERION_MPS = 3.0 * KNOT_MPS
COURSE_CRITERION_RAD = np.radians(7.0)
TOUCHED = 1e-6
"""Share of a parameter in a singular direction above which it is not told."""

STRAIGHT_M = 5.0
"""Departure from a straight and steady track that counts as a manoeuvre, m."""


@dataclass(frozen=True, eq=False)
class Observability:
    """Rank, condition, weakest direction, chance of the criterion.

    ``told`` marks the parameters (range, bearing, speed, course, rest frequencies)
    that no singular direction touches.
    """

    rank: int
    n_parameters: int
    condition: float
    weakest: str
    probability: float
    told: BoolArray


def assess(found: Information, motion: FloatArray) -> Observability:
    """Assess what a motion's information tells.

    Parameters
    ----------
    found
        Information at the motion.
    motion
        Range (m), bearing (rad), speed (m/s), course (rad).
    """
    unit, scale = found.unit_diagonal()
    values, vectors = np.linalg.eigh(unit)
    lost = values <= RANK_THRESHOLD * values[-1]
    told = ~np.any(np.abs(vectors[:, lost]) > TOUCHED, axis=1)
    spread = 1.0 / np.sqrt(max(float(values[0]), 1e-300))
    direction = vectors[:, 0] / scale * spread
    probability = 0.0
    if not lost.any():
        probability = accuracy_probability(found.covariance(), float(motion[0]))
    return Observability(
        rank=int(np.count_nonzero(~lost)),
        n_parameters=values.size,
        condition=found.condition,
        weakest=_in_words(direction, float(motion[0]), singular=bool(lost.any())),
        probability=probability,
        told=told,
    )


def accuracy_probability(covariance: FloatArray, range_m: float) -> float:
    """Return the chance of range in 10 %, speed in 3 kn and course in 7 degrees."""
    chosen = np.ix_([0, 2, 3], [0, 2, 3])
    bounds = [RANGE_CRITERION * range_m, SPEED_CRITERION_MPS, COURSE_CRITERION_RAD]
    return criterion_probability(covariance[chosen], np.array(bounds))


def _in_words(direction: FloatArray, range_m: float, *, singular: bool) -> str:
    """Write a direction; a singular one scaled to the largest readable change."""
    readable = np.concatenate([
        [100.0 * direction[0] / range_m],
        [direction[2] / KNOT_MPS],
        np.degrees(direction[[3, 1]]),
        direction[4:],
    ])  # fmt: skip
    if singular:
        readable = readable * (10.0 / max(np.abs(readable).max(), 1e-300))
    readable = readable * (1.0 if readable[np.abs(readable).argmax()] >= 0 else -1.0)
    units = ["%", "kn", "deg", "deg"] + ["Hz"] * (readable.size - 4)
    names = ["range", "speed", "course", "bearing"]
    names += [f"line {i + 1}" for i in range(readable.size - 4)]
    least = 1e-6 if singular else 0.0
    return ", ".join(
        f"{name} {value:+.3g} {unit}"
        for name, value, unit in zip(names, readable, units, strict=True)
        if abs(value) > least
    )


def is_manoeuvring(track: Track) -> bool:
    """Tell whether own ship leaves a straight track at constant speed."""
    if track.time_s.size < 3:
        return False
    off = 0.0
    for place in (track.east_m, track.north_m):
        line = np.polyfit(track.time_s, place, 1)
        off = max(off, float(np.abs(place - np.polyval(line, track.time_s)).max()))
    return off > STRAIGHT_M
