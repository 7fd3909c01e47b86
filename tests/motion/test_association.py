"""Whether two reports are of one vessel: laws of the odds, and drawn passages."""

import warnings
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import norm

from studies.constants.same_passage import pairs
from uwtrack_cli.motion.association import (
    LOG_SPEED_STD,
    MODEL_SHARE,
    OUTLIER_SCALE,
    OUTLIERS,
    PASSAGES_PER_HOUR,
    PassageReport,
    same_vessel,
)
from uwtrack_cli.motion.passage.candidates import is_one

ONE = PassageReport(100.0, 0.5, 8.0, 0.2, 4.0, 0.1, 350.0, 1.0)
STEPS = {"time_s": 1.0, "range_over_speed_s": 1.0, "speed_mps": 0.5, "bearing_deg": 5.0}


def test_the_odds_are_those_of_a_difference_over_those_of_two_vessels():
    """Written out with scipy for a time and a speed, what is unknown left out."""
    one = PassageReport(10.0, 0.5, speed_mps=5.0, speed_std_mps=0.1)
    other = PassageReport(11.0, 1.2, speed_mps=5.5, speed_std_mps=0.2)

    def density(apart, std):
        parts = norm.pdf(apart, 0.0, std), norm.pdf(apart, 0.0, OUTLIER_SCALE * std)
        return np.log((1.0 - OUTLIERS) * parts[0] + OUTLIERS * parts[1])

    time_std = np.sqrt(0.5**2 + 1.2**2 + (30.0 * MODEL_SHARE) ** 2)
    share, apart = np.hypot(0.1 / 5.0, 0.2 / 5.5), np.log(5.0 / 5.5)
    share = np.hypot(share, MODEL_SHARE)
    wanted = density(1.0, time_std) - np.log(PASSAGES_PER_HOUR / 3600.0)
    wanted += density(apart, share) - norm.logpdf(
        apart, 0.0, np.hypot(share, np.sqrt(2.0) * LOG_SPEED_STD)
    )
    assert same_vessel(one, other) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("name", STEPS)
def test_the_farther_apart_the_less_it_is_one_vessel(name):
    for sign in (-1.0, 1.0):
        odds = [
            same_vessel(ONE, ONE._replace(**{name: getattr(ONE, name) + sign * k * STEPS[name]}))
            for k in range(7)
        ]
        assert all(a > b for a, b in pairwise(odds))
        assert odds[0] > 0.0


def test_the_order_of_two_reports_does_not_matter_and_north_is_no_edge():
    other = ONE._replace(time_s=102.0, speed_mps=5.0, bearing_deg=4.0)
    assert same_vessel(ONE, other) == pytest.approx(same_vessel(other, ONE))
    turned = [one._replace(bearing_deg=one.bearing_deg - 100.0) for one in (ONE, other)]
    assert same_vessel(*turned) == pytest.approx(same_vessel(ONE, other))


def test_wide_reports_may_be_farther_apart_than_sharp_ones():
    wide = ONE._replace(time_std_s=6.0)
    late = {"time_s": 112.0}
    assert same_vessel(ONE, ONE._replace(**late)) < 0.0
    assert same_vessel(wide, wide._replace(**late)) > 0.0


def test_lines_of_one_machine_are_found_again():
    lines = ONE._replace(rest_frequencies_hz=(40.0, 63.0))
    for hz, is_common in ((63.3, True), (63.4, False)):
        other = lines._replace(rest_frequencies_hz=(hz, 90.0))
        assert (same_vessel(lines, other) == same_vessel(ONE, ONE)) is is_common


def test_lines_of_one_vessel_that_are_parted_are_one_and_two_vessels_are_two():
    warnings.simplefilter("ignore")
    assert all(is_one(*found) for found in pairs(3, 6500, of_one=True))
    assert not any(is_one(*found) for found in pairs(3, 6500, of_one=False))
