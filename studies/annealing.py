"""Simulated annealing for many independent problems at once.

**Method.** Chang et al. 2003, section IV and eq. 9 (Kirkpatrick et al. 1983): all
parameters are perturbed within a window that narrows with the temperature; a worse
point is accepted with probability exp(-dF / T). The best point so far is kept. Trials
stay in the box, for the temperature would carry them far outside; periodic parameters
are free.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from studies.simplex import Minima, Objective
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.options import Above, AtLeast, AtMost, OptionGroup


@dataclass(frozen=True)
class AnnealingPolicy(OptionGroup):
    """How the annealing cools.

    Parameters
    ----------
    temperatures
        Number of temperatures.
    perturbations
        Trials at each temperature.
    cooling
        Factor from one temperature and window to the next.
    """

    temperatures: Annotated[int, AtLeast(1), AtMost(100_000)] = 50
    perturbations: Annotated[int, AtLeast(1), AtMost(100_000)] = 10
    cooling: Annotated[float, Above(0), AtMost(1)] = 0.85


def annealing_search(
    objective: Objective,
    box: tuple[FloatArray, FloatArray],
    count: int,
    rng: np.random.Generator,
    *,
    policy: AnnealingPolicy,
    periodic: BoolArray | None = None,
    feedback: FloatArray | None = None,
) -> Minima:
    """Search a box for the minima of ``count`` problems.

    The box does not bound ``periodic`` parameters; ``feedback`` are earlier solutions
    (problem, parameter) to start from.
    """
    lower, upper = box
    size, rows = lower.size, np.arange(count)
    free = np.zeros(size, dtype=bool) if periodic is None else periodic
    floor, ceiling = np.where(free, -np.inf, lower), np.where(free, np.inf, upper)
    draws = lower + (upper - lower) * rng.random((count, 10, size))
    values = objective(draws.reshape(-1, size), np.repeat(rows, 10)).reshape(count, 10)
    heat = values.std(1)
    place, value = draws[rows, values.argmin(1)], values.min(1)
    if feedback is not None:
        place, value = feedback.copy(), objective(feedback, rows)
    best, best_value = place.copy(), value.copy()
    for level in range(policy.temperatures):
        shrink = policy.cooling**level
        for _ in range(policy.perturbations):
            window = 0.5 * (upper - lower) * shrink
            trial = place + window * rng.uniform(-1.0, 1.0, place.shape)
            trial = np.clip(trial, floor, ceiling)
            found = objective(trial, rows)
            rise = np.maximum(found - value, 0.0) / np.maximum(heat * shrink, 1e-300)
            taken = np.exp(-rise) > rng.random(count)
            place = np.where(taken[:, np.newaxis], trial, place)
            value = np.where(taken, found, value)
            better = value < best_value
            best = np.where(better[:, np.newaxis], place, best)
            best_value = np.where(better, value, best_value)
    spent = 11 + policy.temperatures * policy.perturbations
    return Minima(best, best_value, np.full(count, spent))
