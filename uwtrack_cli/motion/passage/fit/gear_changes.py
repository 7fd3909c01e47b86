"""A change of gear: the step of all frequencies that looks like a short passage.

**Method.** The engine of a vehicle runs faster or slower by a fifth to a half when it
changes gear, within tenths of a second. Where that lasts about as long as d/v, the lines
fall as they do at a closest approach, and only what they do before and after tells them
apart. So where the frequencies of a passage in air are held against a step, beside noise
that holds the engine's wander, the step may take its time: a hyperbolic tangent, whose
ends are between those of a hand that lets go at once and the slow ones of a passage.

**Conventions.** Heights are one. Times of reception.
"""

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray

SHIFT_LENGTHS_S = (0.2, 0.35, 0.6, 1.0)
"""How long a change of gear takes, s, from 2 to 98 % of its height: from a racing gearbox
to a slow hand."""

TANH_LENGTH = 4.0
"""That length over the unit of the argument of the hyperbolic tangent."""

SHORTEST = 0.25
"""Share of d/v below which a step might as well be sudden."""


def shift_lengths_s(medium: Medium, width_s: float) -> tuple[float, ...]:
    """Return how long a step beside a passage may take; empty where none may.

    Parameters
    ----------
    medium
        The medium: vehicles change gear in air.
    width_s
        d/v of the passage, s.
    """
    if not medium.is_air:
        return ()
    return tuple(length for length in SHIFT_LENGTHS_S if length > SHORTEST * width_s)


def frequency_steps(time_s: FloatArray, middle_s: FloatArray, length_s: float) -> FloatArray:
    """Return steps of unit height.

    Parameters
    ----------
    time_s
        Times, s, shape (n,).
    middle_s
        Middle of each step, s, shape (step,).
    length_s
        How long they take, s; 0 for sudden ones.

    Returns
    -------
    FloatArray
        Shape (step, n).
    """
    lag = time_s - middle_s[:, None]
    if length_s <= 0:
        return np.where(lag > 0, 1.0, 0.0)
    steps: FloatArray = 0.5 + 0.5 * np.tanh(TANH_LENGTH / length_s * lag)
    return steps


def step_speeds(time_s: FloatArray, middle_s: FloatArray, length_s: float) -> FloatArray:
    """Return how fast steps of unit height go on: their partials by the instant.

    Beside a step they leave its instant free, from one of a coarse grid.

    Parameters
    ----------
    time_s
        Times, s, shape (n,).
    middle_s
        Middle of each step, s, shape (step,).
    length_s
        How long they take, s, above 0.

    Returns
    -------
    FloatArray
        Shape (step, n), one at the middle.
    """
    steps = frequency_steps(time_s, middle_s, length_s)
    speeds: FloatArray = 4.0 * steps * (1.0 - steps)
    return speeds
