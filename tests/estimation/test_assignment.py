"""One-to-one assignment against scipy on the full table, and by brute force."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from uwtrack_cli.estimation.assignment import assign, candidate_pairs


def test_candidates_are_those_of_a_comparison_of_everything() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        centres = np.sort(rng.uniform(0, 100, 20))
        widths = rng.uniform(0, 5, 20)
        measured = np.sort(rng.uniform(0, 100, 30))
        lines, peaks = candidate_pairs(centres, widths, measured)
        close = np.abs(measured[None, :] - centres[:, None]) < widths[:, None]
        assert np.array_equal(np.argwhere(close), np.stack([lines, peaks], axis=1))


def test_assignment_has_the_size_and_cost_of_the_exact_one() -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        n_lines, n_peaks = rng.integers(1, 12, 2)
        allowed = rng.random((n_lines, n_peaks)) < 0.3
        cost = rng.uniform(0, 10, allowed.shape)
        lines, peaks = np.nonzero(allowed)
        pairs = assign(lines, peaks, cost[allowed])
        chosen = lines[pairs], peaks[pairs]
        table = np.where(allowed, cost, 1e4)
        rows, columns = linear_sum_assignment(table)
        real = table[rows, columns] < 1e4
        assert len(set(chosen[0])) == len(set(chosen[1])) == chosen[0].size
        assert chosen[0].size == real.sum()
        assert np.isclose(cost[chosen].sum(), table[rows, columns][real].sum())


def test_nothing_to_assign_gives_nothing() -> None:
    none = np.zeros(0, dtype=np.int64)
    assert assign(none, none, np.zeros(0)).size == 0
