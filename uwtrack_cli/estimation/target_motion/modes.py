"""Modes: the motions that explain the data about equally well, with weights.

**Method.** Minima within the likelihood-ratio region of the best are kept when a
barrier lies between them, and weighted by Laplace's approximation of their
posterior mass, exp(-F/2) |C|^(1/2) (MacKay 2003, eq. 27.8), flat in the solver's
coordinates.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.target_motion.marquardt import Fit
from uwtrack_cli.estimation.target_motion.objective import misfit
from uwtrack_cli.estimation.target_motion.problem import Problem, wrap_rad

BARRIER = 0.5
"""Rise of the misfit between two minima that makes two modes of them."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Distinct motions, best first, with weights that sum to one."""

    q: FloatArray
    rest_hz: FloatArray
    value: FloatArray
    weight: FloatArray


def find_modes(
    problem: Problem, fit: Fit, threshold: float, *, singular: bool = False
) -> Modes:
    """Pick the distinct minima within a rise of the misfit.

    Parameters
    ----------
    problem
        One record.
    fit
        Minima, best first.
    threshold
        Largest rise over the best.
    singular
        Whether a whole line of motions fits alike: then one of them stands for all
        on its side of the array.
    """
    kept = [0]
    for index in range(1, len(fit.q)):
        if fit.value[index] - fit.value[0] > threshold:
            break
        apart = _other_side if singular else _apart
        if all(apart(problem, fit, index, other) for other in kept):
            kept.append(index)
    q = fit.q[kept].copy()
    q[:, 1] = np.mod(q[:, 1], 2.0 * np.pi)
    log_weight = -0.5 * fit.value[kept] + 0.5 * _log_volume(fit.matrix[kept])
    weight = np.exp(log_weight - log_weight.max())
    return Modes(q, fit.rest_hz[kept], fit.value[kept], weight / weight.sum())


def _apart(problem: Problem, fit: Fit, a: int, b: int) -> bool:
    """Tell whether a barrier lies on the straight way from one to the other."""
    change = fit.q[b] - fit.q[a]
    change[1] = wrap_rad(change[1])
    # curvature of the better one: a distance far below a sigma is the same minimum
    if change @ fit.matrix[b] @ change < 1e-2:
        return False
    share = np.linspace(0.0, 1.0, 11)[1:-1, np.newaxis]
    between = misfit(problem, fit.q[a] + share * change)
    top = max(fit.value[a], fit.value[b])
    return bool(between.value.max() > top + BARRIER)


def _other_side(problem: Problem, fit: Fit, a: int, b: int) -> bool:
    """Tell whether two motions start on different sides of a line array."""
    if problem.array_heading_rad is None:
        return False
    off = wrap_rad(fit.q[[a, b], 1] - problem.array_heading_rad[0])
    return bool(off[0] * off[1] < 0)


def _log_volume(matrix: FloatArray) -> FloatArray:
    """Half-log volumes up to a constant; flat directions are cut at the bounds."""
    values = np.linalg.eigvalsh(matrix)
    # a direction flatter than this would reach beyond any search box
    return np.asarray(-np.log(np.maximum(values, 1e-2)).sum(-1))
