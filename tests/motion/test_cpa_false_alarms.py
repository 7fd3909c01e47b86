"""How often noise is taken for a passage, and how weak a passage is found."""

import numpy as np
import pytest

from tests.motion.false_alarms import DIFAR, STATED, claims, hump_claims, interval, still_recording


def noise_counts(runs, seed):
    """Claims in drawn noise at each stated probability."""
    results = [claims(*still_recording([seed, k]), DIFAR, STATED) for k in range(runs)]
    return np.sum(results, axis=0)


@pytest.mark.long
def test_noise_is_hardly_ever_taken_for_a_passage():
    counts = dict(zip(STATED, noise_counts(8, 1), strict=True))
    assert counts[0.001] == counts[0.01] == 0
    assert counts[0.1] <= 4


@pytest.mark.long
@pytest.mark.timeout(3 * 3600)
def test_the_false_alarm_rate_is_not_above_the_stated_one():
    runs = 1500
    for stated, count in zip(STATED, noise_counts(runs, 2), strict=True):
        low, high = interval(int(count), runs)
        assert low <= stated, f"stated {stated:.1%}, {low:.2%} to {high:.2%}"


@pytest.mark.slow
def test_a_hump_is_found_at_the_threshold_that_noise_does_not_reach():
    shares = {
        ratio: np.mean([hump_claims(k, ratio, (1e-3,)) for k in range(6)]) for ratio in (-12.0, 3.0)
    }
    assert shares[-12.0] <= 0.2
    assert shares[3.0] >= 0.9


def test_the_interval_of_a_rate_is_that_of_clopper_and_pearson():
    """Clopper and Pearson (1934): 0 of 10 is 0 to 30.85 %, 5 of 10 is 18.7 to 81.3 %."""
    assert interval(0, 10) == pytest.approx((0.0, 0.3085), abs=1e-4)
    assert interval(5, 10) == pytest.approx((0.1871, 0.8129), abs=1e-4)
