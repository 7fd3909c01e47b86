"""What the direction of a vehicle's sound does to a passage that its level tells alone.

**Method.** The level of a passage is that of a source which sounds alike to all sides
over free ground. Engines, tyres and propellers do not: their levels ahead and behind
differ, so do those along the way and abeam, and ground that reflects adds to the far
sound more than to the near. Beside lines these patterns are unknowns of the fit
(`source_patterns`); a level alone cannot tell them from its time and width, and they are
considered afterwards: the answer moves with each by the partial of the optimum, and its
covariance grows by the square of that times the variance of the pattern (Schmidt 1966).
Errors of drawn vehicles in these deviations are told by `studies/constants/vehicle_levels.py`.

**Conventions.** Levels in nepers of power (ln). In water nothing is considered: there the
levels' own coloured noise holds what is left.

**References.** Schmidt (1966), Advances in Control Systems 3, 293 (consider
covariance); Jonasson (2007), Acta Acustica 93, 173 (directivity of road vehicles).
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.passage.fit.covariance import slant_partials
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.fit.source_patterns import source_patterns
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import CHANGED, FLOOR, HEIGHT


def consider_directivity(fit: PassageFit, blocks: Blocks) -> PassageFit:
    """Widen a fit in air by what the patterns of a source's sound can do to it.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        The measurements that it was made from.

    Returns
    -------
    PassageFit
        The same with wider covariances; as it is in water, without levels, and with
        frequencies.
    """
    if not (fit.medium.is_air and blocks.shift.is_empty) or blocks.level.is_empty:
        return fit
    law = fit.law(blocks.time_s)
    floor = fit.theta[0, FLOOR]
    share = np.exp(law.spread[0] - np.logaddexp(law.spread[0], floor))
    patterns = source_patterns(fit.theta, law, fit.medium)
    partials = share * law.rows[0, 2, 1:]
    places = [0, 1, 2, *range(HEIGHT, HEIGHT + partials.shape[0] - 3)]
    # level and floor are the levels' own unknowns: they take their part of a pattern
    own = np.stack([np.ones_like(share), 1.0 - share])
    weighted = _weighted(fit, np.vstack([partials, own]))
    weight = weighted[-2:] @ own.T
    left = patterns - (patterns @ weighted[-2:].T) @ np.linalg.pinv(weight) @ own
    unit = np.ones(len(places))
    unit[1] = np.exp(fit.theta[0, 1])
    inner = np.nan_to_num(fit.full_covariance[0][:, places]) / unit
    moved = inner @ (weighted[:-2] @ left.T)
    full = fit.full_covariance[0] + moved @ moved.T
    turn = slant_partials(fit.theta, fit.medium)[0]
    more = turn @ moved[:CHANGED]
    return replace(
        fit, full_covariance=full[None], covariance=(fit.covariance[0] + more @ more.T)[None]
    )


def _weighted(fit: PassageFit, rows: FloatArray) -> FloatArray:
    """Multiply rows by the inverse covariance of the levels' noise."""
    weighted: FloatArray = fit.noises[2].weight[0, 0] * rows
    loss = fit.losses[2]
    return weighted if loss is None else weighted - loss.times(rows)
