"""The target-motion studies compute their figures, near the published ones."""

import numpy as np
import pytest

from studies import tma_study
from studies.optimisers import (
    block_1,
    block_3,
    find_minima,
    hybrid,
    paper_function,
    random_simplices,
    study_optimisers,
)
from studies.tma_runs import accuracy, convergence_index, rows_until
from studies.tma_study import study_tma


@pytest.mark.long
def test_the_study_sets_every_solver_beside_the_published_figures(monkeypatch):
    monkeypatch.setattr(tma_study, "TARGETS", {"S1-T3": None})
    monkeypatch.setattr(tma_study, "NOISES", (5,))
    monkeypatch.setattr(tma_study, "PEER_CASES", ())
    study = study_tma(runs=60, seed=2)
    rows = {row.quantity: row for row in study.rows if row.case == "S1-T3, 5 sigma"}
    bound = rows["bound of the range, m"]
    assert bound.ours == pytest.approx(bound.reference, rel=0.005)
    assert rows["success"].low <= rows["success"].reference
    ratio = rows["error over bound, range"]
    # 60 runs: a ratio scatters by 9 %
    assert ratio.ours == pytest.approx(1.0, abs=0.3)
    assert rows["95 % region holds the truth, 200 rows"].ours > 0.85
    length = rows["rows until 90 % of runs meet the criterion for good"]
    assert np.isfinite(length.ours)
    assert any("annealing" in name for name in rows)
    outliers = [row for row in study.rows if "outliers" in row.case]
    assert len(outliers) == 4 * 4 * 2


def test_the_convergence_index_is_where_success_begins_for_good():
    ends = np.array([10, 20, 30])
    met = np.array([[1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=bool)
    assert convergence_index(ends, met).tolist() == [30.0, 20.0, np.inf]
    assert rows_until(ends, met, share=0.6) == 30.0
    assert np.isnan(rows_until(ends, met, share=0.9))


def test_another_seed_changes_the_figures():
    first, second = (accuracy("S3", 1, 1000, 5, seed).ratio for seed in (1, 2))
    assert np.all(first != second)


def test_the_paper_function_is_zero_at_the_origin_only():
    assert abs(paper_function(np.zeros((1, 6)))[0]) < 1e-12
    rng = np.random.default_rng(1)
    assert paper_function(rng.uniform(-2, 2, (10_000, 6))).min() > 0.0


def test_the_function_has_the_published_levels_next_to_its_minimum():
    first = np.sort(block_1(find_minima(1)))
    third = np.sort(block_3(find_minima(3)))
    assert first[1] == pytest.approx(0.246912, abs=1e-4)
    assert np.isclose(third, 0.078723, atol=1e-5).sum() == 2
    assert np.isclose(third, 0.158483, atol=1e-5).sum() == 4


@pytest.mark.parametrize(("number", "count"), [(1, 55), (2, 7), (3, 221)])
def test_every_minimum_found_on_the_grid_is_one_and_none_is_missing(number, count):
    from studies import optimisers

    block = getattr(optimisers, f"block_{number}")
    minima = find_minima(number)
    step = 1e-3
    around = np.stack([[1, 0], [0, 1], [1, 1], [1, -1]]) * step
    middle = block(minima)
    for shift in np.concatenate([around, -around]):
        assert np.all(block(minima + shift) > middle)
    # Newton's method from 25 921 starts finds as many; the published counts 47 and
    # 193 leave some out, for instance the pair at (0.2, 0.2) of block 3
    assert len(minima) == count
    mirrored = {tuple(row) for row in np.round(-minima, 3) + 0.0}
    assert mirrored == {tuple(row) for row in np.round(minima, 3) + 0.0}


@pytest.mark.long
def test_a_simplex_from_random_vertices_succeeds_as_rarely_as_published():
    found = random_simplices(2000, seed=3)
    # the band 0.010-0.025 of 10 000 runs, widened to 2000
    assert 0.006 <= np.mean(found.value < 1e-6) <= 0.031
    assert 0.5 <= np.median(found.value) <= 0.8
    assert 700 < found.evaluations.mean() < 1500


@pytest.mark.long
def test_ten_thousand_simplices_meet_the_published_band():
    found = random_simplices(10_000, seed=3)
    assert 0.010 <= np.mean(found.value < 1e-6) <= 0.025
    assert 0.55 <= np.median(found.value) <= 0.75


def test_the_hybrids_do_not_solve_the_function_at_their_budget():
    assert np.mean(hybrid("genetic", 300, 1, 0.25).value < 1e-6) <= 0.06


@pytest.mark.long
def test_the_optimisers_study_lists_all_methods():
    study = study_optimisers(runs=60, seed=1)
    cases = {row.case for row in study.rows}
    assert "simplex, random vertices" in cases
    assert {"differential evolution", "dual annealing"} <= cases
    evolution = next(
        row for row in study.rows
        if row.case == "differential evolution" and row.quantity == "success"
    )  # fmt: skip
    assert evolution.ours >= 0.5
