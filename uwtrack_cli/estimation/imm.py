"""Interacting motion models: a target that is quiet now and turns later.

**Method.** Each model runs a filter of its own. Before every step the filters are mixed by
the chance that the target has changed its behaviour, after it they are weighed by how
well each foresaw the scan.

**Conventions.** The first axis is the model, further axes are targets stepped together.

**References.** Blom and Bar-Shalom (1988); Bar-Shalom, Li and Kirubarajan (2001),
section 11.6; Rauch, Tung and Striebel (1965) and Helmick, Blair and Hoffman (1995), IEEE
Trans. Information Theory 41, 1845, for smoothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray

_MOST_AGREEMENT = 50.0
"""Greatest logarithm of a weight: pairs of models that exclude each other have none."""


@dataclass(frozen=True)
class Belief:
    """State of every model's filter and the probabilities of the models."""

    mean: FloatArray
    """``(model, ..., n)``."""
    covariance: FloatArray
    """``(model, ..., n, n)``."""
    probability: FloatArray
    """``(model, ...)``, sums to one over the models."""

    def take(self, targets: BoolArray | IntArray | slice) -> "Belief":
        """Return some along the axis after the models."""
        return Belief(
            self.mean[:, targets], self.covariance[:, targets], self.probability[:, targets]
        )

    @classmethod
    def join(cls, parts: Sequence[Self]) -> "Belief":
        """Put several behind each other along the axis after the models."""
        return Belief(
            np.concatenate([part.mean for part in parts], axis=1),
            np.concatenate([part.covariance for part in parts], axis=1),
            np.concatenate([part.probability for part in parts], axis=1),
        )


def mix(belief: Belief, switching: FloatArray) -> Belief:
    """Let the target change its behaviour before a step: mix the filters.

    ``switching`` is the probability of changing from the model of the row to that of
    the column; probabilities are then predicted ones.
    """
    if belief.probability.shape[0] == 1:
        return belief
    joint = switching.reshape(*switching.shape, *(1,) * (belief.probability.ndim - 1))
    joint = joint * belief.probability[:, None]
    predicted = joint.sum(axis=0)
    share = joint / np.maximum(predicted, np.finfo(np.float64).tiny)
    mean = (share[..., None] * belief.mean[:, None]).sum(axis=0)
    away = belief.mean[:, None] - mean
    spread = belief.covariance[:, None] + away[..., :, None] * away[..., None, :]
    return Belief(mean, (share[..., None, None] * spread).sum(axis=0), predicted)


def advance(belief: Belief, transition: FloatArray, noise: FloatArray) -> Belief:
    """Predict every filter by F, ``(n, n)`` or a model's own ``(model, n, n)``, and its Q.

    Q is ``(model, n, n)``.
    """
    between = (1,) * (belief.mean.ndim - 2)
    spread = noise.reshape(noise.shape[0], *between, *noise.shape[1:])
    if transition.ndim == 2:
        covariance = transition @ belief.covariance @ transition.T + spread
        return Belief(belief.mean @ transition.T, covariance, belief.probability)
    forward = transition.reshape(len(transition), *between, *transition.shape[1:])
    covariance = forward @ belief.covariance @ forward.swapaxes(-1, -2) + spread
    mean = (forward @ belief.mean[..., None])[..., 0]
    return Belief(mean, covariance, belief.probability)


def reweigh(belief: Belief, log_likelihood: FloatArray) -> FloatArray:
    """Return the models' probabilities after a scan, by its log likelihood in each."""
    if belief.probability.shape[0] == 1:
        return belief.probability
    scaled = np.exp(log_likelihood - log_likelihood.max(axis=0))
    weight = belief.probability * scaled
    probability: FloatArray = weight / weight.sum(axis=0)
    return probability


def moments(belief: Belief) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance over the models."""
    if belief.probability.shape[0] == 1:
        return belief.mean[0], belief.covariance[0]
    weight = belief.probability
    mean = (weight[..., None] * belief.mean).sum(axis=0)
    away = belief.mean - mean
    spread = belief.covariance + away[..., :, None] * away[..., None, :]
    return mean, (weight[..., None, None] * spread).sum(axis=0)


def smooth(
    belief: Belief, transition: FloatArray, noise: FloatArray, switching: FloatArray, lag: int
) -> Belief:
    """Let the states of one target learn from as many later scans as the lag says.

    Parameters
    ----------
    belief
        Its filters after every scan, ``(model, scan, ...)``.
    transition
        F of each model from every scan to the next, ``(model, scan - 1, n, n)``.
    noise
        Q of the same.
    switching
        Probabilities of changing the model, from that of the row.
    lag
        Number of later scans, 0 or more; all there are from the number of scans on.

    Returns
    -------
    Belief
        The smoothed filters, ``(model, scan, ...)``.

    Notes
    -----
    For one model the recursion of Rauch, Tung and Striebel. For several it is that of
    the mixed state that each filter began with; what it adds to this is told to every
    filter now, which weighs the pairs of models beside p_ij mu_i(k) mu_j(k+1|N) /
    mu_j(k+1|k), before those of a model are merged.
    """
    last = belief.probability.shape[1] - 1
    if lag < last:
        # all scans at once, once for each scan of the lag
        smoothed = belief
        for _ in range(lag):
            ahead = smoothed.take(slice(1, None))
            back = _step_back(belief.take(slice(last)), ahead, transition, noise, switching)
            smoothed = Belief.join([back, belief.take(slice(last, None))])
        return smoothed
    found = [belief.take(slice(last, None))]
    for scan in range(last - 1, -1, -1):
        one = slice(scan, scan + 1)
        found.append(
            _step_back(belief.take(one), found[-1], transition[:, one], noise[:, one], switching)
        )
    return Belief.join(found[::-1])


def _step_back(
    now: Belief, ahead: Belief, transition: FloatArray, noise: FloatArray, switching: FloatArray
) -> Belief:
    """Correct filters by the smoothed ones of the next scan, ``(model, scan, ...)``."""
    mixed = mix(now, switching)
    cross = mixed.covariance @ transition.swapaxes(-1, -2)
    spread = transition @ cross + noise
    gain = np.linalg.solve(spread, cross.swapaxes(-1, -2)).swapaxes(-1, -2)
    off = ahead.mean - (transition @ mixed.mean[..., None])[..., 0]
    moved = (gain @ off[..., None])[..., 0]
    learnt = gain @ (ahead.covariance - spread) @ gain.swapaxes(-1, -2)
    covariance = mixed.covariance + learnt
    if len(now.probability) == 1:
        return Belief(mixed.mean + moved, covariance, ahead.probability)
    # what the later scans say of the state now, about the mixed state of each model then
    before, own = np.linalg.inv(mixed.covariance), np.linalg.inv(now.covariance)
    after = np.linalg.inv(covariance)
    size, axes = np.linalg.eigh(after - before)
    side = axes.swapaxes(-1, -2)
    # where association is doubtful a later scan may widen a state; that is not told
    push = axes @ np.where(size[..., None] > 0.0, side @ after @ moved[..., None], 0.0)
    gained = (axes * np.maximum(size, 0.0)[..., None, :]) @ side
    away = (now.mean[:, None] - mixed.mean[None])[..., None]
    told, wide, agreement = _told(own[:, None], away, gained, push)
    _, _, usual = _told(before, np.zeros_like(push), gained, push)
    joint: FloatArray = switching[..., None] * now.probability[:, None]
    joint = joint * ahead.probability
    joint = joint / np.maximum(mixed.probability, np.finfo(np.float64).tiny)
    joint = joint * np.exp(np.minimum(agreement - usual, _MOST_AGREEMENT))
    joint = joint / joint.sum(axis=(0, 1))
    probability: FloatArray = joint.sum(axis=1)
    share = joint / np.maximum(probability, np.finfo(np.float64).tiny)[:, None]
    mean: FloatArray = mixed.mean + told
    middle = (share[..., None] * mean).sum(axis=1)
    apart = mean - middle[:, None]
    wide = wide + apart[..., :, None] * apart[..., None, :]
    return Belief(middle, (share[..., None, None] * wide).sum(axis=1), probability)


def _told(
    own: FloatArray, away: FloatArray, information: FloatArray, push: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Gaussians after what was told of them, and how well they agree with it.

    ``own`` and ``away`` are inverse covariance and mean, ``information`` and ``push`` the
    coefficients of what is told, exp(-x' I x / 2 + p' x).
    """
    whole = own + information
    spread = np.linalg.inv(whole)
    mean = spread @ (own @ away + push)
    square = (mean * (whole @ mean)).sum(axis=(-2, -1))
    square = square - (away * (own @ away)).sum(axis=(-2, -1))
    size = np.linalg.slogdet(own)[1] - np.linalg.slogdet(whole)[1]
    return mean[..., 0], spread, 0.5 * (size + square)
