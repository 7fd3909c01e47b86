"""Distances between two sets of positions: GOSPA and OSPA.

**Method.** Positions are paired so that the sum of the cut-off distances is least;
what finds no partner costs the cut-off (OSPA) or half of it to the power (GOSPA).

**References.** Schuhmacher, Vo and Vo (2008), IEEE Trans. Signal Processing 56, 3447
(OSPA, eq. 3); Rahmathullah, Garcia-Fernandez and Svensson (2017), FUSION (GOSPA with
alpha = 2, eq. 5 and proposition 1).
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.errors import OptionError


@dataclass(frozen=True)
class Gospa:
    """The distance and its parts, each as a sum of powers before the root."""

    distance_m: float
    """The distance, m."""
    localisation: float
    """Sum of the powers of the distances of the pairs, m^order."""
    n_missed: int
    """Number of true positions without a partner."""
    n_false: int
    """Number of found positions without a partner."""


def gospa(
    estimated: FloatArray, true: FloatArray, *, cutoff_m: float, order: float = 2.0
) -> Gospa:
    """Return the generalised optimal sub-pattern assignment distance.

    ``estimated``: positions found, shape (n, 2), m. ``true``: positions that were
    there, shape (m, 2), m. ``cutoff_m``: distance from which two positions do not
    belong together, m, positive. ``order``: power in which distances count, 1 or more.

    Examples
    --------
    >>> found = gospa(np.zeros((1, 2)), np.array([[3.0, 4.0]]), cutoff_m=10.0)
    >>> found.distance_m, found.n_missed
    (5.0, 0)
    """
    costs = _paired_costs(estimated, true, cutoff_m, order)
    near = costs[costs < cutoff_m**order]
    n_false, n_missed = len(estimated) - near.size, len(true) - near.size
    penalty = 0.5 * cutoff_m**order * (n_false + n_missed)
    total = float(near.sum()) + penalty
    return Gospa(total ** (1.0 / order), float(near.sum()), n_missed, n_false)


def ospa(
    estimated: FloatArray, true: FloatArray, *, cutoff_m: float, order: float = 2.0
) -> float:
    """Return the optimal sub-pattern assignment distance, m.

    ``estimated``: positions found, shape (n, 2), m. ``true``: positions that were
    there, shape (m, 2), m. ``cutoff_m``: distance from which two positions do not
    belong together, m, positive. ``order``: power in which distances count, 1 or more.

    Examples
    --------
    >>> ospa(np.zeros((0, 2)), np.array([[3.0, 4.0]]), cutoff_m=10.0)
    10.0
    """
    costs = _paired_costs(estimated, true, cutoff_m, order)
    larger = max(len(estimated), len(true))
    if larger == 0:
        return 0.0
    alone = cutoff_m**order * (larger - costs.size)
    return float(((costs.sum() + alone) / larger) ** (1.0 / order))


def _paired_costs(
    estimated: FloatArray, true: FloatArray, cutoff_m: float, order: float
) -> FloatArray:
    """Return the cut-off costs of the best pairs."""
    from scipy.optimize import linear_sum_assignment

    if not (cutoff_m > 0.0 and order >= 1.0):
        msg = f"cutoff_m must be positive and order 1 or more, got {cutoff_m}, {order}."
        raise OptionError(msg)
    apart = np.linalg.norm(estimated[:, None, :] - true[None, :, :], axis=-1)
    costs = np.minimum(apart, cutoff_m) ** order
    chosen: FloatArray = costs[linear_sum_assignment(costs)]
    return chosen
