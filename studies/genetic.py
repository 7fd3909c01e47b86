"""Genetic search for many independent problems at once.

**Method.** Chang et al. 2003, section IV and eq. 7: parameters as binary numbers,
m = m_min + i (m_max - m_min) / (2^n - 1); binary tournament, crossover at one point,
mutation bit by bit, the best kept. A solution that is fed back takes the place of
the first individual.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from studies.simplex import Minima, Objective
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.options import AtLeast, AtMost, OptionGroup


@dataclass(frozen=True)
class GeneticPolicy(OptionGroup):
    """How the genetic search breeds.

    Parameters
    ----------
    members
        Individuals in a generation.
    generations
        Number of generations.
    bits
        Bits of a parameter.
    crossover
        Probability that a pair is crossed.
    mutation
        Probability that a bit flips.
    """

    members: Annotated[int, AtLeast(2), AtMost(100_000)] = 10
    generations: Annotated[int, AtLeast(1), AtMost(100_000)] = 50
    bits: Annotated[int, AtLeast(1), AtMost(50)] = 15
    crossover: Annotated[float, AtLeast(0), AtMost(1)] = 0.5
    mutation: Annotated[float, AtLeast(0), AtMost(1)] = 0.05


def genetic_search(
    objective: Objective,
    box: tuple[FloatArray, FloatArray],
    count: int,
    rng: np.random.Generator,
    *,
    policy: GeneticPolicy,
    feedback: FloatArray | None = None,
) -> Minima:
    """Search a box for the minima of ``count`` problems.

    ``feedback`` are earlier solutions (problem, parameter).
    """
    lower, upper = box
    shape = (count, policy.members, lower.size * policy.bits)
    genes = rng.random(shape) < 0.5
    if feedback is not None:
        genes[:, 0] = _encode(feedback, lower, upper, policy.bits)
    value = _evaluate(objective, genes, box, policy)
    for _ in range(policy.generations - 1):
        elite = value.argmin(1)
        rows = np.arange(count)
        kept, kept_value = genes[rows, elite].copy(), value[rows, elite].copy()
        genes = _breed(genes, value, rng, policy)
        genes[:, 0] = kept
        value = _evaluate(objective, genes, box, policy)
        value[:, 0] = np.minimum(value[:, 0], kept_value)
    best = value.argmin(1)
    rows = np.arange(count)
    point = _decode(genes[rows, best], lower, upper, policy.bits)
    spent = np.full(count, policy.members * policy.generations)
    return Minima(point, value[rows, best], spent)


def _evaluate(
    objective: Objective,
    genes: BoolArray,
    box: tuple[FloatArray, FloatArray],
    policy: GeneticPolicy,
) -> FloatArray:
    points = _decode(genes, *box, policy.bits)
    member = np.repeat(np.arange(len(genes)), policy.members)
    return objective(points.reshape(-1, points.shape[-1]), member).reshape(genes.shape[:2])


def _breed(
    genes: BoolArray, value: FloatArray, rng: np.random.Generator, policy: GeneticPolicy
) -> BoolArray:
    """Select by tournament, cross pairs at one point, flip bits."""
    count, members, length = genes.shape
    rivals = rng.integers(members, size=(count, members, 2))
    rows = np.arange(count)[:, np.newaxis]
    first = value[rows, rivals[:, :, 0]] <= value[rows, rivals[:, :, 1]]
    parents = genes[rows, np.where(first, rivals[:, :, 0], rivals[:, :, 1])]
    mates = np.arange(members) ^ 1
    mates = np.where(mates < members, mates, np.arange(members))
    pairs = np.arange(members) // 2
    cut = rng.integers(1, length, size=(count, members))[:, pairs]
    crossed = (rng.random((count, members)) < policy.crossover)[:, pairs]
    tail = (np.arange(length) >= cut[:, :, np.newaxis]) & crossed[:, :, np.newaxis]
    children = np.where(tail, parents[:, mates], parents)
    return np.asarray(children ^ (rng.random(genes.shape) < policy.mutation))


def _decode(genes: BoolArray, lower: FloatArray, upper: FloatArray, bits: int) -> FloatArray:
    """Turn bits into parameters (Chang et al. 2003, eq. 7)."""
    power = 2.0 ** np.arange(bits - 1, -1, -1)
    number = genes.reshape(*genes.shape[:-1], lower.size, bits) @ power
    return np.asarray(lower + number * (upper - lower) / (2.0**bits - 1.0))


def _encode(points: FloatArray, lower: FloatArray, upper: FloatArray, bits: int) -> BoolArray:
    share = np.clip((points - lower) / (upper - lower), 0.0, 1.0)
    number = np.rint(share * (2.0**bits - 1.0)).astype(np.int64)
    genes = (number[..., np.newaxis] >> np.arange(bits - 1, -1, -1)) & 1
    return np.asarray(genes.reshape(*points.shape[:-1], -1) == 1)
