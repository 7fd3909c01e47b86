"""Families in single frames: block law, false rate, bearings, options."""

import numpy as np
import pytest
from scipy.stats import binom

from tests.lines.line_scenes import cut, line_peaks
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.errors import OptionError
from uwtrack_cli.lines.classify import classify_peaks

TEETH = 100.0 + 12.5 * np.arange(10)


def test_a_family_is_found_in_nearly_every_frame_with_its_spacing() -> None:
    families = classify_peaks(line_peaks(np.tile(TEETH, (200, 1)), seen=0.9))
    frames = np.unique(families.frame)
    assert frames.size >= 190
    assert np.isclose(np.median(families.spacing_hz), 12.5, atol=0.02)
    assert families.is_harmonic.mean() > 0.9
    counts = np.bincount(families.peak_family[families.peak_family >= 0])
    assert np.array_equal(counts[families.family], families.n_members)


def test_the_cut_into_blocks_changes_no_bit() -> None:
    peaks = line_peaks(np.tile(TEETH, (100, 1)))
    blocks = [cut(peaks, k, min(k + 17, 100)) for k in range(0, 100, 17)]
    parts = Families.join([classify_peaks(block) for block in blocks])
    assert parts.equals(classify_peaks(peaks))


def test_families_in_noise_are_rarer_than_stated() -> None:
    peaks = line_peaks(np.full((1500, 1), np.nan), clutter=25.0)
    families = classify_peaks(peaks, chance=0.1)
    assert families.family.size <= binom.ppf(0.999, 1500, 0.1)


def test_teeth_from_many_directions_are_no_family() -> None:
    frequency = np.tile(TEETH, (100, 1))
    spread = np.tile(36.0 * np.arange(10), (100, 1))
    scattered = classify_peaks(line_peaks(frequency, spread))
    together = classify_peaks(line_peaks(frequency, np.full_like(spread, 80.0)))
    assert np.unique(scattered.frame).size <= 5
    assert np.unique(together.frame).size >= 95


@pytest.mark.parametrize(
    "options", [{"chance": 0.0}, {"spacing_hz": (5.0, 2.0)}, {"teeth": 1}, {"most_peaks": 2}]
)
def test_options_out_of_range_are_refused(options: dict) -> None:
    with pytest.raises(OptionError, match="got"):
        classify_peaks(line_peaks(np.tile(TEETH, (2, 1))), **options)
