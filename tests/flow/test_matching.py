"""Association probabilities against the enumeration of every joint assignment."""

from itertools import product

import numpy as np
import pytest

from uwtrack_cli.flow.scoring.encounter_scores import match_encounters


def enumerated(ratio):
    """Marginals by listing every one-to-one assignment with its weight."""
    n, m = ratio.shape
    total, sums = 0.0, np.zeros((n, m))
    for choice in product(range(-1, m), repeat=n):
        used = [j for j in choice if j >= 0]
        if len(set(used)) < len(used):
            continue
        weight = np.prod([ratio[i, j] for i, j in enumerate(choice) if j >= 0])
        total += weight
        for i, j in enumerate(choice):
            if j >= 0:
                sums[i, j] += weight
    return sums / total


@pytest.mark.parametrize(("n", "m"), [(1, 4), (4, 1)])
def test_marginals_are_exact_where_no_two_compete_in_a_circle(n, m):
    logs = np.random.default_rng(1).normal(0.0, 2.0, (n, m))
    found = match_encounters(logs)
    np.testing.assert_allclose(found.probability, enumerated(np.exp(logs)), rtol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_marginals_are_near_the_enumerated_ones(seed):
    logs = np.random.default_rng(seed).normal(0.0, 3.0, (4, 4))
    found = match_encounters(logs).probability
    np.testing.assert_allclose(found, enumerated(np.exp(logs)), atol=0.08)


def test_probabilities_of_an_encounter_sum_to_one():
    logs = np.random.default_rng(3).normal(0.0, 30.0, (6, 5))
    found = match_encounters(logs)
    np.testing.assert_allclose(found.probability.sum(axis=1) + found.unlisted, 1.0)


def test_each_passage_belongs_to_one_encounter_at_most():
    found = match_encounters(np.array([[9.0, 8.0], [9.5, -9.0]]))
    assert set(found.pairs) == {(0, 1), (1, 0)}


def test_what_cannot_be_is_not_matched():
    found = match_encounters(np.full((2, 3), -np.inf))
    assert found.pairs == ()
    np.testing.assert_array_equal(found.unlisted, 1.0)
    assert match_encounters(np.zeros((0, 3))).pairs == ()
    np.testing.assert_array_equal(match_encounters(np.zeros((2, 0))).unlisted, 1.0)
