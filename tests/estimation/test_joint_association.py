"""Joint association against the enumeration of every hypothesis, and its limits."""

from itertools import product

import numpy as np
import pytest

from uwtrack_cli.estimation.joint_association import MOST_SHARED, associate_jointly


def enumerated(weight, missed):
    """Return the marginals by the sum over every hypothesis, one after the other."""
    n_targets, count = weight.shape
    miss, joint, total = np.zeros(n_targets), np.zeros_like(weight), 0.0
    for choice in product(range(-1, count), repeat=n_targets):
        used = [i for i in choice if i >= 0]
        if len(set(used)) < len(used):
            continue
        likelihood = np.prod([missed[t] if i < 0 else weight[t, i] for t, i in enumerate(choice)])
        total += likelihood
        for target, i in enumerate(choice):
            if i < 0:
                miss[target] += likelihood
            else:
                joint[target, i] += likelihood
    return miss / total, joint / total


@pytest.mark.parametrize("seed", range(12))
def test_marginals_are_those_of_all_hypotheses(seed):
    draw = np.random.default_rng(seed)
    weight = draw.lognormal(1.0, 2.0, (4, 5)) * (draw.random((4, 5)) < 0.2 + 0.06 * seed)
    missed = draw.uniform(0.01, 0.9, 4)
    found = associate_jointly(weight, missed)
    miss, joint = enumerated(weight, missed)
    np.testing.assert_allclose(found.miss, miss, rtol=1e-12)
    np.testing.assert_allclose(found.weight, joint, rtol=1e-12, atol=1e-15)
    assert found.n_omitted == 0


def test_a_crowd_stays_a_probability_and_says_what_was_left_out():
    draw = np.random.default_rng(3)
    weight = draw.lognormal(0.0, 2.0, (20, 40))
    found = associate_jointly(weight, np.full(20, 0.1))
    assert found.n_omitted > 0
    assert found.weight.min() >= 0.0
    assert found.weight.sum(axis=0).max() <= 1.0 + 1e-12
    np.testing.assert_allclose(found.miss + found.weight.sum(axis=1), 1.0)


def test_what_is_left_out_is_what_weighs_least():
    draw = np.random.default_rng(4)
    own = np.eye(MOST_SHARED + 4) * 1e3
    both = own + 1e-6 * draw.random(own.shape)
    missed = np.full(len(own), 0.1)
    found, alone = associate_jointly(both, missed), associate_jointly(own, missed)
    assert found.n_omitted > 0
    np.testing.assert_allclose(found.weight, alone.weight, atol=1e-6)


def test_many_targets_in_a_row_are_exact_without_an_exhaustive_sum():
    """Each shares one measurement with the next: a chain has a sum of its own."""
    n = 11
    weight = np.zeros((n, n + 1))
    weight[np.arange(n), np.arange(n)] = weight[np.arange(n), np.arange(n) + 1] = 3.0
    found = associate_jointly(weight, np.full(n, 0.5))
    # states of the chain: whether the measurement to the right is taken
    before = [np.array([1.0, 0.0])]
    for _ in range(n):
        free, taken = before[-1]
        before.append(np.array([0.5 * (free + taken) + 3.0 * free, 3.0 * (free + taken)]))
    last = before[-1][1] / before[-1].sum()
    assert found.n_omitted == 0
    assert found.weight[-1, -1] == pytest.approx(last, rel=1e-12)
