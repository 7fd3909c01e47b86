"""Drawn recordings through the whole chain: bands, error bars, nothing invented."""

import numpy as np
import pytest

from tests.motion.passage_scores import score
from tests.motion.random_passages import CLASSES

pytestmark = pytest.mark.filterwarnings("ignore:contact .* frames of")


@pytest.mark.parametrize("kind", ["two", "noise"])
def test_a_drawn_recording_is_answered_within_its_band(kind):
    result = score(kind, 1)
    assert result.claimed == result.expected
    assert result.missed == 0
    assert result.wrong_side == 0
    assert result.outside == []
    assert all(abs(value) < 4 for _, value in result.deviations)


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
def test_error_bars_hold_over_two_hundred_drawn_recordings():
    seed = int(np.random.SeedSequence().generate_state(1)[0])
    results = [score(kind, seed + k) for kind in CLASSES for k in range(23)]
    report = f"first seed {seed}"
    deviations = np.abs([d for r in results for _, d in r.deviations])
    assert (deviations <= 3).mean() >= 0.99, report
    assert 0.4 <= np.median(deviations) <= 1.0, report
    due = [given for r in results for given in r.due]
    assert np.mean(due) >= 0.95, report
    assert sum(r.wrong_side for r in results) == 0, report
    claims = [r for r in results if r.kind == "noise" and r.claimed]
    assert claims == [], report
    total = sum(len(r.deviations) for r in results)
    assert sum(len(r.outside) for r in results) <= 0.03 * total, report
