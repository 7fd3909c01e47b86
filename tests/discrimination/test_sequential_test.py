"""Wald's test against Siegmund's approximations and the textbook's simulation."""

import math

import numpy as np
import pytest

from studies.discrimination_study import textbook_test
from studies.rows import load_reference
from uwtrack_cli.discrimination.pair_test import (
    Thresholds,
    consistency,
    expected_scans,
    first_crossing,
    fixed_scans,
    overshoot_error,
    wald_thresholds,
)

REFERENCE = load_reference("discriminate")
RUNS = 20_000


@pytest.mark.parametrize("row", REFERENCE["textbook"], ids=lambda r: f"{r[0]},{r[1]}")
def test_the_textbook_table_is_met_within_three_standard_errors_of_both(row):
    error, mean, rate, scans, *_ = row
    wrong, taken = textbook_test(error, mean, runs=RUNS, seed=4)
    both = 1.0 / RUNS + 1.0 / REFERENCE["textbook_runs"]
    assert abs(wrong.mean() - rate) <= 3.0 * math.sqrt(rate * (1 - rate) * both)
    assert abs(taken.mean() - scans) <= 3.0 * taken.std() * math.sqrt(both)


@pytest.mark.parametrize("row", REFERENCE["textbook"], ids=lambda r: f"{r[0]},{r[1]}")
def test_siegmunds_error_and_length_are_the_published_ones(row):
    error, mean, rate, _, siegmund_rate, siegmund_scans, fixed = row
    thresholds = wald_thresholds(error, error)
    # A sample N(mean/2, 1) adds log odds of mean mean^2/2 and deviation mean.
    ours = overshoot_error(thresholds, mean)
    assert ours == pytest.approx(siegmund_rate, abs=6e-6)
    assert expected_scans(mean**2 / 2, mean, thresholds, ours) == pytest.approx(
        siegmund_scans, abs=6e-4 * siegmund_scans
    )
    assert fixed_scans(mean**2 / 2, mean, rate) == pytest.approx(fixed, rel=2e-3)


def test_the_thresholds_are_walds():
    found = wald_thresholds(0.005, 0.005)
    assert found.upper == pytest.approx(5.2933, abs=1e-4)
    assert found.lower == -found.upper
    skew = wald_thresholds(0.1, 0.01)
    assert skew.upper == pytest.approx(math.log(0.9 / 0.01))
    assert skew.lower == pytest.approx(math.log(0.1 / 0.99))


def test_only_the_first_crossing_decides():
    odds = np.array([[0.5, 0.5, 0.5], [-3.0, 0.0, 3.0], [9.0, 0.1, -9.0]])
    scan, decision = first_crossing(odds, Thresholds(-2.0, 2.0))
    assert scan.tolist() == [1, -1, 1]
    assert decision.tolist() == [-1, 0, 1]


def test_consistency_is_that_of_two_chi_square_tests():
    from scipy.stats import chi2

    degrees = np.array([3, 3, 0, 1, 3])
    distance2 = np.array([1.0, 1.5, 0.0, 0.2, 14.0])
    each = chi2.sf(distance2[degrees > 0], degrees[degrees > 0])
    largest = 1.0 - (1.0 - each.min()) ** 4
    total = chi2.sf(distance2.sum(), degrees.sum())
    expected = min(2.0 * min(largest, total), 1.0)
    assert consistency(distance2, degrees) == pytest.approx(expected, rel=1e-9)
    assert largest < total  # the one scan decides here, the sum below
    many = np.full(20, 6.5)
    total = chi2.sf(130.0, 60)
    assert total < 1.0 - (1.0 - chi2.sf(6.5, 3)) ** 20
    found = consistency(many, np.full(20, 3))
    assert found == pytest.approx(2.0 * total, rel=1e-9)
