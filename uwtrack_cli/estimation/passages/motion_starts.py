"""Starts for a straight motion: from one sensor, from two, and from a fan of courses.

**Method.** A closest approach with speed, bearing and side gives the motion by itself
(one sensor); two with bearings give the speed by the corrected quadratic (two
sensors); what is missing is filled by a fan of courses, both sides and a few speeds.

**References.** Choi et al. (2014), eqs. 1 and 15-18 with the side per sensor.
"""

from itertools import combinations

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.passages.motion_fit import Approaches, speed_from_two

N_COURSES = 36


def motion_starts(approaches: Approaches, reference_s: float) -> FloatArray:
    """Return states to start a motion fit from, shape (starts, 4).

    Parameters
    ----------
    approaches
        Closest approaches of one vessel.
    reference_s
        Time of the states in seconds.
    """
    speeds = _speeds(approaches)
    found: list[FloatArray] = []
    for row in range(approaches.turn.size):
        time, width, speed, bearing = approaches.measured[row]
        if not np.isfinite(time + width):
            continue
        candidates = np.array([speed]) if np.isfinite(speed) else speeds
        if np.isfinite(bearing) and approaches.turn[row]:
            angle, turn = np.array([bearing]), np.array([approaches.turn[row]])
        elif len(found) < 4:
            fan = 2 * np.pi * np.arange(N_COURSES) / N_COURSES
            angle = np.tile(fan, 2)
            turn = np.repeat([1.0, -1.0], N_COURSES)
        else:
            continue
        found.append(_states(approaches, row, reference_s, (candidates, angle, turn)))
    return np.concatenate(found) if found else np.empty((0, 4))


def _speeds(approaches: Approaches) -> FloatArray:
    """Speeds measured, from pairs, or from the time between distant sensors."""
    measured = approaches.measured[:, 2]
    known = measured[np.isfinite(measured)]
    if known.size:
        return np.array([float(np.median(known))])
    time, width, _, bearing = approaches.measured.T
    vector = width[:, None] * np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    speeds = []
    for pair in combinations(range(time.size), 2):
        rows = list(pair)
        base = float(np.hypot(*(np.diff(approaches.sensor[rows], axis=0)[0])))
        if base == 0:
            continue
        quadratic = float(
            speed_from_two(approaches.sensor[rows], time[rows], vector[rows])
        )
        apart = abs(float(np.diff(time[rows])[0])) + float(width[rows].sum())
        rough = base / max(apart, 1e-9)
        speeds += [quadratic] if quadratic > 0 else [rough, 3 * rough, 0.3 * rough]
    return np.array(speeds)


def _states(
    approaches: Approaches,
    row: int,
    reference_s: float,
    fan: tuple[FloatArray, FloatArray, FloatArray],
) -> FloatArray:
    speed, angle, turn = fan
    time, width = approaches.measured[row, :2]
    speed = np.repeat(speed, angle.size)
    angle, turn = np.resize(angle, speed.size), np.resize(turn, speed.size)
    height = approaches.height_m[row]
    flat = np.sqrt(np.maximum((width * speed) ** 2 - height**2, 1e-6))
    out = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    along = turn[:, None] * np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
    velocity = speed[:, None] * along
    nearest = approaches.sensor[row] + flat[:, None] * out
    return np.concatenate(
        [nearest + velocity * (reference_s - time), velocity], axis=-1
    )
