"""Which vessel was it: encounters and passages matched with probabilities.

**Method.** Each encounter is of one of the passages known, or of a vessel that the
truth does not list; each passage made at most one encounter, or went unheard. The
marginal probabilities of this joint assignment come from belief propagation, which
converges always and is exact for a single encounter.

**References.** Williams and Lau (2014), IEEE Trans. Aerospace and Electronic Systems
50(4), 2942: eqs. 25-30.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray

MAX_ITERATIONS = 1000
PRECISION = 1e-9
CERTAIN = 60.0
"""Logarithm of a ratio beyond which nothing changes."""


@dataclass(frozen=True, eq=False)
class Matching:
    """Probabilities per encounter (row) and passage (column), and the best pairs."""

    probability: FloatArray
    """Probability of each pair, shape (estimate, truth + 1); the last column is 'none of them'."""
    unlisted: FloatArray
    """Probability of each encounter to be of none of the passages."""
    pairs: tuple[tuple[int, int], ...]
    """Truth of each estimate in the most probable matching; -1 for none."""


def match_encounters(log_ratio: FloatArray) -> Matching:
    """Match encounters and passages one to one.

    ``log_ratio``: logarithm of how much likelier an encounter (row) is of a passage
    (column) than of an unlisted vessel while the passage went unheard; -inf if it
    cannot be.

    Examples
    --------
    >>> found = match_encounters(np.array([[3.0, -np.inf]]))
    >>> round(float(found.probability[0, 0]), 4)  # exp(3) / (1 + exp(3))
    0.9526
    """
    from scipy.optimize import linear_sum_assignment

    ratio = np.exp(np.clip(log_ratio, -CERTAIN, CERTAIN))
    ratio[~np.isfinite(log_ratio)] = 0.0
    probability = _marginals(ratio)
    gain = np.log1p(ratio)
    rows, columns = linear_sum_assignment(gain, maximize=True)
    pairs = tuple(
        (int(i), int(j))
        for i, j in zip(rows, columns, strict=True)
        if ratio[i, j] > 1.0
    )
    unlisted = np.clip(1.0 - probability.sum(axis=1), 0.0, 1.0)
    return Matching(probability, unlisted, pairs)


def _marginals(ratio: FloatArray) -> FloatArray:
    """Return the association probabilities by belief propagation."""
    to_encounter = np.ones_like(ratio)
    # sums over all others as products: a difference would lose the small ones
    other_rows, other_columns = (1.0 - np.eye(size) for size in ratio.shape)
    for _ in range(MAX_ITERATIONS):
        to_passage = ratio / (1.0 + (ratio * to_encounter) @ other_columns)
        new = 1.0 / (1.0 + other_rows @ to_passage)
        change = np.abs(new - to_encounter).max(initial=0.0)
        to_encounter = new
        if change < PRECISION:
            break
    weighted = ratio * to_encounter
    result: FloatArray = weighted / (1.0 + weighted.sum(axis=1, keepdims=True))
    return result
