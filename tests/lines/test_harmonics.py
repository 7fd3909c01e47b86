"""The comb test: its guarantee in noise, its families, its invariances."""

import numpy as np
import pytest
from scipy.stats import binom

from studies.line_comb import family_chances, noise_chances
from uwtrack_cli.lines.families.comb_test import CombRule, comb_tests
from uwtrack_cli.lines.families.harmonics import comb_fit, find_combs

RULE = CombRule((2.0, 60.0), 18, 0.1, 10.0, 1000.0)


def _unknown(frequency: np.ndarray) -> np.ndarray:
    return np.full(frequency.size, np.nan)


@pytest.mark.parametrize("density", [30.0, 12.0, 6.0])
def test_families_in_noise_are_rarer_than_stated(density: float) -> None:
    chances = noise_chances(density, 400, np.random.default_rng(5))
    for level in (1.0, 0.1):
        allowed = binom.ppf(0.999, 400, level)
        assert np.count_nonzero(chances < np.log10(level)) <= allowed


@pytest.mark.parametrize(
    ("density", "teeth", "published"),
    [(12.0, 8, 0.74), (12.0, 10, 0.89), (6.0, 8, 0.82), (6.0, 10, 0.96)],
)
def test_families_are_detected_as_often_as_published(
    density: float, teeth: int, published: float
) -> None:
    rng = np.random.default_rng(6)
    threshold = np.quantile(noise_chances(density, 600, rng), 0.01)
    share = np.mean(family_chances(teeth, density, 200, rng) < threshold)
    # eight points below the reference, and three deviations of 200 sets
    assert share >= published - 0.08 - 3.0 * np.sqrt(published * (1 - published) / 200)


def test_hits_and_chance_equal_a_count_by_hand() -> None:
    rng = np.random.default_rng(7)
    frequency = np.sort(np.append(100.0 + 20.0 * np.arange(8), rng.uniform(50, 900, 12)))
    bearing = rng.uniform(60.0, 80.0, frequency.size)
    rule = CombRule((15.0, 60.0), 14, 0.2, 8.0, 1000.0)
    lower, upper, spacings, chance = comb_tests(frequency, bearing, rule)
    density = frequency.size / 1000.0
    for i, j, m, found in list(zip(lower, upper, spacings, chance, strict=True))[::7]:
        teeth = frequency[i] + (frequency[j] - frequency[i]) / m * np.arange(1, m)
        middle = 0.5 * (bearing[i] + bearing[j])
        near = np.abs(frequency[None] - teeth[:, None]) <= rule.tolerance_hz
        near &= np.abs(bearing - middle)[None] <= 8.0
        hits = int(near.any(axis=1).sum())
        others = max(j - i - 1 - hits, 0) / (frequency[j] - frequency[i])
        q = -np.expm1(-2 * rule.tolerance_hz * max(density, others) * 16.0 / 360.0)
        exact = np.log10(lower.size * binom.sf(hits - 1, m - 1, q))
        # the table rounds the probability up by at most two per cent
        assert exact - 1e-9 <= found <= exact + hits * np.log10(1.021) + 1e-9


def test_a_harmonic_series_is_told_from_a_progression_with_an_offset() -> None:
    teeth = np.arange(3, 11)
    combs, _ = find_combs(12.0 * teeth, _unknown(teeth), RULE, 1e-2)
    other, _ = find_combs(12.0 * teeth + 5.0, _unknown(teeth), RULE, 1e-2)
    assert len(combs) == len(other) == 1
    assert comb_fit(12.0 * teeth, combs[0].teeth, 0.02)[3]
    assert not comb_fit(12.0 * teeth + 5.0, other[0].teeth, 0.02)[3]


@pytest.mark.parametrize("spacing", [6.25, 8.5, 30.0])
def test_neither_half_nor_double_the_spacing_beats_the_spacing(spacing: float) -> None:
    frequency = spacing * np.arange(2, 14) + 0.37
    combs, _ = find_combs(frequency, _unknown(frequency), RULE, 1e-2)
    assert len(combs) == 1
    assert np.isclose(combs[0].spacing_hz, spacing, rtol=1e-6)
    assert combs[0].members.size == 12


def test_every_tooth_between_the_ends_is_of_the_family_and_none_beside() -> None:
    """The pair of the ends alone is unlikely by chance; a peak beside a tooth is not
    of it, and of two on one tooth the nearer one is."""
    frequency = np.array([70.0, 100.0, 126.4, 130.02, 130.06, 160.0, 505.0])
    combs, _ = find_combs(frequency, _unknown(frequency), RULE, 0.5)
    assert combs[0].members.tolist() == [0, 1, 3, 5]
    assert combs[0].teeth.tolist() == [0, 1, 2, 3]


def test_a_family_longer_than_the_comb_is_one_family() -> None:
    frequency = 100.0 + 7.3 * np.arange(40)
    combs, _ = find_combs(frequency, _unknown(frequency), RULE, 1e-2)
    assert len(combs) == 1
    assert combs[0].members.tolist() == combs[0].teeth.tolist() == list(range(40))


def test_families_of_one_spacing_that_lie_far_apart_are_two() -> None:
    """Twenty-two teeth are missing; half of their length and a tooth may be."""
    tooth = np.append(np.arange(9), np.arange(30, 39))
    frequency = 100.0 + 7.3 * tooth
    combs, _ = find_combs(frequency, _unknown(frequency), RULE, 1e-2)
    assert sorted(comb.members.tolist() for comb in combs) == [list(range(9)), list(range(9, 18))]


def test_bearings_keep_two_interleaved_families_apart() -> None:
    rng = np.random.default_rng(8)
    one, two = 100.0 + 20.0 * np.arange(10), 107.0 + 26.0 * np.arange(10)
    frequency = np.concatenate([one, two])
    bearing = np.repeat([50.0, 200.0], 10) + rng.standard_normal(20)
    order = np.argsort(frequency)
    combs, _ = find_combs(frequency[order], bearing[order], RULE, 1e-2)
    found = sorted(comb.spacing_hz for comb in combs)
    assert np.allclose(found, [20.0, 26.0], rtol=1e-6)
    assert all(np.ptp(bearing[order][comb.members]) < 20.0 for comb in combs)


def test_a_shift_of_all_frequencies_changes_no_chance() -> None:
    frequency = np.sort(np.random.default_rng(9).uniform(100, 900, 25))
    here = comb_tests(frequency, _unknown(frequency), RULE).log10_chance
    there = comb_tests(frequency + 64.0, _unknown(frequency), RULE).log10_chance
    assert np.allclose(here, there)
