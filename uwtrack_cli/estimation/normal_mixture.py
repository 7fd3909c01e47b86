"""How far about a reported value a mixture of normal distributions reaches.

**Method.** The half width that holds 95 % of the mixture, by bisection. Of a share that is
small and far off it takes what lies within 95 %, where the mean square would count all of
it.

**Conventions.** The mixture is held against zero, the reported value.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray

HELD, HALF_WIDTH = 0.95, 1.959964
"""Probability within an interval, and its half width in deviations if normal."""

N_HALVINGS = 40
"""Steps of the search for that half width."""


def half_width(share: FloatArray, mean: FloatArray, std: FloatArray) -> float:
    """Return the half width about zero that holds 95 % of a mixture of normals.

    Parameters
    ----------
    share
        Weights, of sum one, shape (parts,).
    mean
        Means, same shape.
    std
        Deviations, same shape.
    """
    from scipy.special import ndtr

    low, high = 0.0, float((np.abs(mean) + 8.0 * std).max())
    for _ in range(N_HALVINGS):
        middle = 0.5 * (low + high)
        within = ndtr((middle - mean) / std) - ndtr((-middle - mean) / std)
        if float(share @ within) < HELD:
            low = middle
        else:
            high = middle
    return high


def widened(covariance: FloatArray, weight: FloatArray, added: FloatArray) -> FloatArray:
    """Return a covariance whose every deviation holds 95 % of a mixture.

    Parameters
    ----------
    covariance
        Covariance where nothing is added, shape (quantities, quantities).
    weight
        Probabilities of the parts to which something is added, shape (parts,).
    added
        Covariance that each adds, shape (parts, quantities, quantities).

    Notes
    -----
    What is added is the mean of the parts, each quantity's share of it so large that
    the deviation is right; what they have in common keeps its correlation.
    """
    mean = np.einsum("k,kpq->pq", weight, added)
    # a variance of nothing but rounding may be negative
    variance = np.maximum(np.diagonal(covariance), 0.0)
    more = np.diagonal(added, axis1=1, axis2=2)
    share = np.append(weight, 1.0 - weight.sum())
    std = np.sqrt(np.concatenate([more, np.zeros((1, variance.size))]) + variance)
    root = np.zeros(variance.size)
    for place in np.flatnonzero((variance > 0.0) & (np.diagonal(mean) > 0.0)):
        held = half_width(share, np.zeros(share.size), std[:, place]) / HALF_WIDTH
        asked = max(held**2 - variance[place], 0.0)
        root[place] = np.sqrt(asked / mean[place, place])
    return np.asarray(covariance + mean * np.outer(root, root))
