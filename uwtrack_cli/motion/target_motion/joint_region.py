"""What the joint ellipse of a motion holds, judged by the likelihood itself.

**Method.** Range, bearing, speed and course have a joint ellipse of 95 % by their
covariance. Where the likelihood bends, that ellipse holds less, though each quantity by
itself may agree with its own interval. Motions are drawn from a normal density that is
wider than the ellipse and weighed by their likelihood over it, flat in the solver's
coordinates (importance sampling); the share of the weight within the ellipse is what it
holds. Where few draws carry all the weight, the likelihood lies elsewhere, and the
ellipse says nothing.

Of several legs all unknowns are drawn, and the share is that within the ellipse of the four.

**Conventions.** White noise on both sides: what nuisances add is normal and widens both.

**References.** Gelman et al. (2013), Bayesian Data Analysis, section 10.4 (importance
sampling, effective number of draws).
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.model import STRAIGHT, from_motion, to_motion
from uwtrack_cli.motion.target_motion.objective import misfit
from uwtrack_cli.motion.target_motion.problem import Problem

N_DRAWS = 200
"""Motions that are drawn."""

WIDER = 1.5
"""Deviations of the drawn motions over those of the ellipse, of four unknowns: half of the
draws are effective still. Of more unknowns it is less, so that as many are."""

QUANTILE = 9.488
"""Chi-square of four degrees of freedom that 95 % stay below."""

FEWEST_EFFECTIVE = 40.0
"""Effective draws below which the likelihood lies elsewhere."""

LEAST_CONTENT = 0.88
"""Content from which an ellipse of 95 % is one: 0.95 less three deviations of sampling."""


def ellipse_holds(problem: Problem, q: FloatArray, covariance: FloatArray, scale: float) -> bool:
    """Return whether the joint ellipse of 95 % holds what it should.

    The covariance is that of range (m), bearing (rad), speed (m/s), course (rad) and the
    alterations by white noise, shape (p, p); ``scale`` that of likelihood ratios under the
    loss.
    """
    centre = to_motion(q)
    wider = float(np.sqrt(1.0 + (WIDER**2 - 1.0) * STRAIGHT / q.size))
    std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    if not (np.isfinite(covariance).all() and std.all()):
        return False
    values, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    if values[0] <= 0.0:
        return False
    unit = np.random.default_rng(0).standard_normal((N_DRAWS, q.size))
    motion = centre + std * (wider * (unit * np.sqrt(values)) @ vectors.T)
    usable = (motion[:, 0] > 0.0) & (motion[:, 2] > 0.0)
    usable &= np.abs(motion[:, 3] - centre[3]) < np.pi
    if np.count_nonzero(usable) < FEWEST_EFFECTIVE:
        return False
    unit, motion = unit[usable], motion[usable]
    first = from_motion(*motion[:, :STRAIGHT].T)
    trial = np.concatenate([first, motion[:, STRAIGHT:]], axis=1)
    trial[:, 1] = q[1] + wrap_rad(trial[:, 1] - q[1])
    rise = (misfit(problem, trial).value - misfit(problem, q[np.newaxis]).value) / scale
    square = (unit**2).sum(axis=1)
    # flat in ln R and the components of the velocity
    density = np.log(motion[:, 2] / motion[:, 0])
    logarithm = 0.5 * square - 0.5 * rise + density
    weight = np.exp(logarithm - logarithm.max())
    if weight.sum() ** 2 < FEWEST_EFFECTIVE * (weight**2).sum():
        return False
    off = motion[:, :STRAIGHT] - centre[:STRAIGHT]
    inverse = np.linalg.inv(covariance[:STRAIGHT, :STRAIGHT])
    within = np.einsum("np,pq,nq->n", off, inverse, off) < QUANTILE
    return bool(weight[within].sum() > LEAST_CONTENT * weight.sum())
