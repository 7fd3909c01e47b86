"""Changes beside a passage that are too small to be seen, and what they leave open.

**Method.** Where no change gains enough to be fitted, one may be there all the same.
About the straight passage everything is linear (`change_scores`): for each instant and
each size of a grid (with the prior of `change_priors`, of either sign or of any
direction, and that of the fits) the likelihood over that of no change follows from the score and its
information. Averaged over the prior it is the evidence for a change that was not seen,
and weighs by how much that change would move the answers. Moves beyond the reach of the
linear law are left out: a change that large is seen.

A change counts as one where it moves time, d/v or speed by more than a share of their
own deviations; smaller ones are straight in all that is told.

**Conventions.** Log-likelihoods in nepers, noise taken as white. One data set, the fit's
one row.

**References.** Rao (1948), Proc. Camb. Phil. Soc. 44, 50 (scores); Jaynes (1968), IEEE
Trans. Syst. Sci. Cybern. 4, 227 (priors of scales); Hoeting et al. (1999), Statist. Sci.
14, 382 (averaging over models).
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.passage.fit.covariance import slant_partials
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import CHANGE_STD, MANOEUVRE, N_SIZES, RAMP
from uwtrack_cli.motion.passage.readings.change_priors import ODDS, SIZES
from uwtrack_cli.motion.passage.readings.change_scores import FARTHEST_LOG, FARTHEST_S, Scores

N_INNER, N_RADII, N_DIRECTIONS = 6, 32, 16
"""Sizes of the grid below the lower bound and above it, and directions."""

FARTHEST_SPEED = 0.5
"""Share of the speed up to which a move of it is linear."""

LEAST_MOVE = 0.5
"""Own deviations by which a change must move an answer to be one."""

TINY = 1e-300
"""Stands for a chance of nothing."""


class Unseen(NamedTuple):
    """One kind of change that was not seen."""

    kind: str
    """Kind of the change."""
    log_evidence: float
    """Logarithm of its evidence over that of a straight passage, odds included."""
    share: float
    """Part of it in which the change would move an answer."""
    slant: FloatArray
    """Mean square of the moves of t0 (s), slant d/v (s), v (m/s) and bearing (degrees),
    shape (4, 4)."""
    flat: FloatArray
    """The same of t0, horizontal d/v, v, bearing and depth difference (m), shape (5, 5)."""


def unseen_change(scores: Scores, fit: PassageFit, blocks: Blocks) -> Unseen:
    """Return what a change that was not seen leaves open.

    Parameters
    ----------
    scores
        What the change would gain and move.
    fit
        Straight fit of one row.
    blocks
        The measurements that it was made from.
    """
    kind = scores.kind
    count = N_SIZES[kind]
    sizes, prior = _grid(kind)
    size = sizes * _units(scores, fit, blocks)[:, None, None]
    right, information = scores.right[:, :count], scores.information[:, :count, :count]
    # what would be too large for a fit, as a ramp of 5 % within seconds, is none here
    information = information + np.diag(np.power(CHANGE_STD[kind][:count], -2.0))
    gain = np.einsum("ijn,in->ij", size, right)
    gain -= 0.5 * np.einsum("ijn,inm,ijm->ij", size, information, size)
    instants = scores.spacing_s / scores.spacing_s.sum()
    moved = np.einsum("ipn,ijn->ijp", scores.moves[:, :, :count], size)
    width, speed = float(np.exp(fit.theta[0, 1])), abs(float(fit.theta[0, 2]))
    reach = FARTHEST_S * width, FARTHEST_LOG, FARTHEST_SPEED * speed
    is_near = np.all(np.abs(moved[..., :3]) < reach, axis=-1)
    chance = np.where(is_near, np.exp(gain) * prior * instants[:, None], 0.0)
    total = max(float(chance.sum()), TINY)
    flat = moved[..., [0, 1, 2, 4, 3]]
    flat[..., 1] *= width
    slant = flat @ slant_partials(fit.theta[:, :5], fit.medium)[0].T
    own = np.sqrt(np.diag(fit.covariance[0])[:3])
    matters = (np.abs(slant[..., :3]) > LEAST_MOVE * own).any(axis=-1)
    chance /= total
    return Unseen(
        kind,
        float(np.log(total)) - ODDS[kind],
        float(chance[matters].sum()),
        np.einsum("ij,ijp,ijq->pq", chance, slant, slant),
        np.einsum("ij,ijp,ijq->pq", chance, flat, flat),
    )


def _grid(kind: str) -> tuple[FloatArray, FloatArray]:
    """Return sizes in the units of the bounds, and the prior of each.

    Uniform below the lower bound, and in the logarithm between both; shape (points,
    unknowns) and (points,).
    """
    low, high = SIZES[kind]
    count = N_SIZES[kind]
    outer = np.geomspace(low, high, N_RADII + 1)
    inner = np.linspace(0.0, low, N_INNER + 1)
    radius = np.append(0.5 * (inner[1:] + inner[:-1]), np.sqrt(outer[1:] * outer[:-1]))
    # the volume of the sphere below the lower bound counts as one over its dimension
    mass = np.append(np.diff((inner / low) ** count) / count, np.diff(np.log(outer))) / (
        float(np.log(high / low)) + 1 / count
    )
    toward = np.array([[1.0], [-1.0]])
    if count > 1:
        angle = 2 * np.pi * np.arange(N_DIRECTIONS) / N_DIRECTIONS
        toward = np.column_stack([np.cos(angle), np.sin(angle)])
    sizes = (radius[:, None, None] * toward).reshape(-1, count)
    return sizes, np.repeat(mass / len(toward), len(toward))


def _units(scores: Scores, fit: PassageFit, blocks: Blocks) -> FloatArray:
    """Return the unit of the bounds at every instant."""
    if scores.kind == MANOEUVRE:
        return np.full(scores.time_s.size, abs(float(fit.theta[0, 2])))
    if scores.kind == RAMP:
        end = np.where(scores.sign > 0, blocks.time_s[-1], blocks.time_s[0])
        return np.asarray(1 / np.maximum(np.abs(end - scores.time_s), 1e-9))
    return np.ones(scores.time_s.size)
