"""The comb test over the whole reference table: false families, families found."""

import numpy as np
import pytest
from scipy.stats import binom

from studies.line_comb import family_chances, noise_chances
from studies.rows import load_reference

REFERENCE = load_reference("lines")
REFERENCE_SETS, SURE = 5000, 0.9987
BAND = 0.08
"""How far below the table a share may lie."""


def check_false(jitter: str, density: str, sets: int) -> None:
    rng = np.random.default_rng(int(100 * float(density)))
    found = noise_chances(float(density), sets, rng, float(jitter))
    shares = REFERENCE["comb_false"][jitter][density]
    for level, share in zip((1.0, 0.1, 0.01), shares, strict=True):
        count = np.count_nonzero(found < np.log10(level))
        assert count <= binom.ppf(SURE, sets, level)
        # nor more than the reference, whose share is a count of 5000 sets itself
        most = binom.ppf(SURE, REFERENCE_SETS, share + 1.0 / REFERENCE_SETS)
        assert count <= binom.ppf(SURE, sets, most / REFERENCE_SETS)


def check_found(density: str, noise_sets: int, sets: int) -> None:
    rng = np.random.default_rng(int(100 * float(density)))
    threshold = np.quantile(noise_chances(float(density), noise_sets, rng), 0.01)
    for teeth, published in REFERENCE["comb_detection"][density].items():
        found = family_chances(int(teeth), float(density), sets, rng) < threshold
        scatter = 3.0 * np.sqrt(published * (1.0 - published) / sets)
        assert found.mean() >= published - BAND - scatter, teeth


@pytest.mark.parametrize("density", ["12", "6", "3"])
@pytest.mark.parametrize("jitter", ["0.1", "0.25", "0.5", "1"])
def test_noise_makes_no_more_families_than_stated(jitter: str, density: str) -> None:
    check_false(jitter, density, 500)


@pytest.mark.parametrize("density", ["12", "6", "3", "1.5"])
def test_families_are_found_as_often_as_the_table_says(density: str) -> None:
    check_found(density, 1500, 150)


@pytest.mark.long
@pytest.mark.parametrize("density", ["60", "30", "12", "6", "3"])
@pytest.mark.parametrize("jitter", ["0.1", "0.25", "0.5", "1"])
def test_many_sets_of_noise_make_no_more_families(jitter: str, density: str) -> None:
    check_false(jitter, density, 5000)


@pytest.mark.long
@pytest.mark.parametrize("density", ["60", "30", "12", "6", "3", "1.5"])
def test_many_families_are_found_as_often_as_the_table_says(density: str) -> None:
    check_found(density, 5000, 1000)
