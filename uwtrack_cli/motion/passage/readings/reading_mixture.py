"""How wide an answer is while its reading is not certain.

**Method.** Each reading that was fitted has its own answer, covariance and weight;
changes that were not seen move the straight answer. The covariance of the answer that is
told is the mean square about it of the mixture of all (Hoeting et al. 1999, eq. 5). Two
answers far apart are no normal distribution: with a rival of 6 to 25 % the interval of
that covariance would hold less than the mixture does. So each deviation is at least
1 / 1.96 of the half width that holds 95 % of the mixture.

**Conventions.** One data set, each fit's one row.

**References.** Hoeting et al. (1999), Statist. Sci. 14, 382 (averaging over models).
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.normal_mixture import HALF_WIDTH, half_width
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.readings.unseen_changes import Unseen

SMALLEST_WEIGHT = 1e-3
"""Weight of a fit below which its answer is left out."""

FLAT = [0, 4, 2, 3, 5]
"""Places of t0, horizontal d/v, speed, bearing and depth difference in an answer."""


def mixed(
    fits: list[PassageFit], best: int, chance: FloatArray, unseen: list[tuple[float, Unseen]]
) -> PassageFit:
    """Return the fit that is told, its covariance that of the mixture about it.

    Parameters
    ----------
    fits
        Fit of every reading, the straight one first.
    best
        Place of the one that is told.
    chance
        Weight of each fit.
    unseen
        Changes that were not seen, each with its weight; the sum of all weights is one.
    """
    winner = fits[best]
    centre = _answer(winner)
    full = winner.full_covariance[0].copy()
    unknown = np.isnan(winner.covariance)
    weights, offsets = list[float](), list[FloatArray]()
    slants, flats = list[FloatArray](), list[FloatArray]()

    def add(weight: float, fit: PassageFit, moves: Unseen | None) -> None:
        if weight < SMALLEST_WEIGHT or np.any(np.isnan(fit.covariance) != unknown):
            return
        apart = _answer(fit) - centre
        apart[3] = (apart[3] + 180.0) % 360.0 - 180.0
        weights.append(weight)
        offsets.append(apart)
        slants.append(fit.covariance[0] + (moves.slant if moves else 0.0))
        flats.append(fit.full_covariance[0, :5, :5] + (moves.flat if moves else 0.0))

    for weight, fit in zip(chance, fits, strict=True):
        add(float(weight), fit, None)
    for weight, one in unseen:
        add(weight, fits[0], one)
    share = np.array(weights) / np.sum(weights)
    apart = np.array(offsets)
    full[:5, :5] = _about(share, apart[:, FLAT], np.array(flats))
    slant = _about(share, apart[:, :4], np.array(slants))
    return replace(winner, covariance=slant[None], full_covariance=full[None])


def _about(share: FloatArray, apart: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance of a mixture about zero, its intervals no shorter than due.

    Parameters
    ----------
    share
        Weights, shape (parts,).
    apart
        Means, shape (parts, quantities).
    covariance
        Covariances, shape (parts, quantities, quantities).
    """
    square = np.einsum("i,ip,iq->pq", share, apart, apart)
    whole = square + np.einsum("i,ipq->pq", share, covariance)
    if share.size == 1:
        return np.asarray(whole)
    std = np.sqrt(np.diagonal(whole))
    own = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scale = np.ones(std.size)
    for place in np.flatnonzero((own > 0).all(axis=0)):
        held = half_width(share, apart[:, place], own[:, place])
        scale[place] = max(1.0, held / (HALF_WIDTH * float(std[place])))
    return np.asarray(whole * np.outer(scale, scale))


def _answer(fit: PassageFit) -> FloatArray:
    """Time, slant d/v, speed, bearing, horizontal d/v and depth difference."""
    return np.array([
        fit.theta[0, 0], fit.range_over_speed_s[0], fit.theta[0, 2],
        fit.bearing_deg[0], np.exp(fit.theta[0, 1]), fit.height_m[0],
    ])  # fmt: skip
