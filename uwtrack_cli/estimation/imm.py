"""Interacting motion models: a target that is quiet now and turns later.

**Method.** Each model runs a filter of its own. Before every step the filters are mixed by
the chance that the target has changed its behaviour, after it they are weighed by how
well each foresaw the scan.

**Conventions.** The first axis is the model, further axes are targets stepped together.

**References.** Blom and Bar-Shalom (1988); Bar-Shalom, Li and Kirubarajan (2001),
section 11.6.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray


@dataclass(frozen=True)
class Belief:
    """State of every model's filter and the probabilities of the models."""

    mean: FloatArray
    """``(model, ..., n)``."""
    covariance: FloatArray
    """``(model, ..., n, n)``."""
    probability: FloatArray
    """``(model, ...)``, sums to one over the models."""


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
    """Predict every filter by a common F, ``(n, n)``, and its Q, ``(model, n, n)``."""
    between = belief.mean.ndim - 2
    spread = noise.reshape(noise.shape[0], *(1,) * between, *noise.shape[1:])
    covariance = transition @ belief.covariance @ transition.T + spread
    return Belief(belief.mean @ transition.T, covariance, belief.probability)


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
