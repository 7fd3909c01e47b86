"""Intervals of the studies: those of scipy, and what they hold of drawn truth."""

import numpy as np
import pytest
from scipy import stats

from studies.rows import mean_row, median_row, normal_root_row, rate_row, root_row, share_row

RUNS = 2000


def coverage(rows, truth):
    """Share of intervals that hold the truth."""
    return np.mean([row.low <= truth <= row.high for row in rows])


def test_a_mean_of_few_runs_has_student_s_interval():
    values = np.array([1.0, 4.0, 2.0, np.nan])
    row = mean_row("", "", None, values)[0]
    expected = stats.ttest_1samp(values[:3], 0.0).confidence_interval(0.95)
    assert (row.low, row.high) == pytest.approx((expected.low, expected.high))
    drawn = np.random.default_rng(1).standard_normal((RUNS, 4))
    rows = [mean_row("", "", None, values)[0] for values in drawn]
    assert coverage(rows, 0.0) == pytest.approx(0.95, abs=0.015)


def test_one_run_has_no_interval_and_none_has_no_row():
    assert mean_row("", "", None, np.array([1.0]))[0].high == np.inf
    assert mean_row("", "", None, np.array([np.nan])) == []


@pytest.mark.parametrize(("hits", "runs"), [(0, 5), (5, 5), (3, 40), (199, 200)])
def test_a_share_has_the_exact_interval(hits, runs):
    row = share_row("", "", None, np.arange(runs) < hits, percent=True)
    expected = stats.binomtest(hits, runs).proportion_ci(0.95, "exact")
    assert row.ours == pytest.approx(100.0 * hits / runs)
    assert (row.low, row.high) == pytest.approx((100 * expected.low, 100 * expected.high))


@pytest.mark.parametrize("runs", [6, 25, 400])
def test_a_median_lies_within_its_ranks_as_often_as_stated(runs):
    drawn = np.random.default_rng(2).exponential(size=(RUNS, runs))
    rows = [median_row("", "", None, values) for values in drawn]
    held = coverage(rows, np.log(2.0))
    assert held > 0.95 - 0.015
    expected = stats.quantile_test(drawn[0], p=0.5).confidence_interval(0.95)
    assert (rows[0].low, rows[0].high) == (expected.low, expected.high)


def test_a_median_of_five_runs_has_no_interval():
    row = median_row("", "", None, np.arange(5.0))
    assert (row.low, row.ours, row.high) == (-np.inf, 2.0, np.inf)


def test_roots_of_mean_squares_hold_their_truth():
    drawn = np.random.default_rng(3).standard_normal((RUNS, 20))
    roots = np.sqrt((drawn**2).mean(axis=1))
    rows = [normal_root_row("", "", None, float(root), 20) for root in roots]
    assert coverage(rows, 1.0) == pytest.approx(0.95, abs=0.015)
    wide = [root_row("", "", None, values**2)[0] for values in drawn]
    # squares are skewed: the interval of their mean is a little short at 20 runs
    assert 0.88 < coverage(wide, 1.0) < 0.96


@pytest.mark.parametrize("count", [0, 1, 9])
def test_a_rate_has_the_exact_interval_and_none_at_all_is_no_rate_of_zero(count):
    row = rate_row("", "", None, count, 4.0)
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    high = stats.chi2.ppf(0.975, 2 * count + 2) / 2
    expected = (count / 4.0, low / 4.0, high / 4.0)
    assert (row.ours, row.low, row.high) == pytest.approx(expected)
    assert row.high > 0.9
