"""Joint probabilistic data association: several targets share a scan.

**Method.** A measurement belongs to one target at most. Targets whose gates share no
measurement are associated each for itself; the others form clusters. Within a cluster
the sum over all joint hypotheses is exact: targets are taken one after the other, with
the set of shared measurements used so far as the state, once forwards and once
backwards, so that hypotheses that use the same set are never told apart.

**Conventions.** Weights are likelihood ratios against clutter, ``(target, k)``: P_D g /
lambda for a measurement in the gate, 0 for any other.

**References.** Fortmann, Bar-Shalom and Scheffe (1983), IEEE J. Oceanic Eng. 8, 173;
Bar-Shalom and Li (1995), section 6.2; Maskell, Briers and Wright (2004), Proc. SPIE
5428, for hypotheses that are summed together.
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray

MOST_SHARED = 12
"""Shared measurements of a cluster that are summed over exactly: 4096 sets of them."""


class JointAssociation(NamedTuple):
    """Marginal probabilities of the targets, and what was left out for them."""

    miss: FloatArray
    """Probability that none of the measurements is the target's, ``(target,)``."""
    weight: FloatArray
    """Probability that a measurement is the target's, ``(target, k)``."""
    n_omitted: int
    """Pairs of target and measurement that were left out to keep clusters exact."""


def associate_jointly(weight: FloatArray, missed: FloatArray) -> JointAssociation:
    """Return the marginal association probabilities of targets that share a scan.

    Parameters
    ----------
    weight
        Likelihood ratio of each pair, ``(target, k)``, 0 or more.
    missed
        1 - P_D P_G of each target, ``(target,)``, above 0.

    Returns
    -------
    JointAssociation
        Probabilities that sum to one over the measurements and the miss of a target.

    Notes
    -----
    p(hypothesis) is proportional to the product of the weights of its pairs and of
    1 - P_D P_G of the targets without one (Fortmann et al. 1983, eq. 3.24). A cluster
    with more than `MOST_SHARED` shared measurements loses its least likely pairs, by
    the probability that they have in a filter of one target, until it falls apart or
    shares few enough.

    Examples
    --------
    >>> both = associate_jointly(np.array([[8.0], [8.0]]), np.array([0.5, 0.5]))
    >>> both.weight.round(3).tolist()
    [[0.485], [0.485]]
    """
    whole = missed + weight.sum(axis=1)
    share = weight / whole[:, None]
    alone = missed / whole
    share, groups, n_omitted = _clusters(share)
    miss, joint = alone.copy(), share.copy()
    if n_omitted:
        rest = alone + share.sum(axis=1)
        miss, joint = alone / rest, share / rest[:, None]
    for group in groups:
        miss[group], joint[group] = _marginals(share[group], alone[group])
    return JointAssociation(miss, joint, n_omitted)


def _clusters(share: FloatArray) -> tuple[FloatArray, list[IntArray], int]:
    """Return the clusters of two targets or more, without the pairs left out."""
    n_omitted = 0
    while True:
        gated = share > 0.0
        shared = gated[:, gated.sum(axis=0) > 1]
        groups = _components(shared)
        crowded = [group for group in groups if (gated[group].sum(axis=0) > 1).sum() > MOST_SHARED]
        if not crowded:
            return share, groups, n_omitted
        if not n_omitted:
            share = share.copy()
        for group in crowded:
            columns = np.flatnonzero(gated[group].sum(axis=0) > 1)
            part = share[np.ix_(group, columns)]
            part = np.where(part > 0.0, part, np.inf)
            row, column = np.unravel_index(int(part.argmin()), part.shape)
            share[group[row], columns[column]] = 0.0
            n_omitted += 1


def _components(shared: BoolArray) -> list[IntArray]:
    """Return the sets of targets that hang together by shared measurements."""
    left = set(np.flatnonzero(shared.any(axis=1)).tolist())
    groups: list[IntArray] = []
    while left:
        group: BoolArray = np.zeros(len(shared), dtype=bool)
        group[min(left)] = True
        size = 0
        while group.sum() > size:
            size = int(group.sum())
            group = np.asarray(shared[:, shared[group].any(axis=0)].any(axis=1))
        members = np.flatnonzero(group)
        groups.append(members)
        left -= set(members.tolist())
    return groups


def _marginals(share: FloatArray, alone: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return miss and association probabilities within one cluster."""
    is_shared = (share > 0.0).sum(axis=0) > 1
    shared = np.flatnonzero(is_shared)
    # a measurement of one target only excludes nothing
    unshared = np.where(is_shared, 0.0, share)
    own = alone + unshared.sum(axis=1)
    options = [
        [(1 << bit, row[column]) for bit, column in enumerate(shared) if row[column]]
        for row in share
    ]
    before = [np.zeros(1 << shared.size)]
    before[0][0] = 1.0
    for free, pairs in zip(own, options, strict=True):
        sums = before[-1] * free
        for bit, weight in pairs:
            _halves(sums, bit)[1][...] += weight * _halves(before[-1], bit)[0]
        before.append(sums)
    total = before.pop().sum()
    joint = np.zeros_like(share)
    after = np.ones(1 << shared.size)
    kept = np.empty_like(alone)
    for target in range(len(share) - 1, -1, -1):
        reached, free = before[target], own[target]
        kept[target] = free * (reached @ after) / total
        sums = after * free
        for bit, weight in options[target]:
            with_it = weight * _halves(after, bit)[1]
            joint[target, shared[bit.bit_length() - 1]] = (
                _halves(reached, bit)[0] * with_it
            ).sum() / total
            _halves(sums, bit)[0][...] += with_it
        after = sums
    of_own = kept / own
    return alone * of_own, joint + unshared * of_own[:, None]


def _halves(sums: FloatArray, bit: int) -> tuple[FloatArray, FloatArray]:
    """Return views of the sets without a measurement and of those with it."""
    parts = sums.reshape(-1, 2, bit)
    return parts[:, 0], parts[:, 1]
