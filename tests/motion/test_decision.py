"""How sure it is that a vessel passes: laws of the probability, and of its table."""

import math
from itertools import pairwise

import numpy as np
import pytest

from uwtrack_cli.motion import alternatives, decision
from uwtrack_cli.motion.alternatives import Alternative
from uwtrack_cli.motion.decision import ALTERNATIVES, MOST_NEPERS, REASONS, decide

SURE = {
    "has_lines": 1.0, "is_air": 0.0, "is_water": 1.0, "bearing": 40.0, "line_level": 30.0,
    "stationary_share": 0.0, "n_lines": 4.0,
    "speed_mps": 6.0, "speed_std_mps": 0.01, "range_m": 300.0, "relative_width_std": 0.02,
}  # fmt: skip
"""What is measured of a passage that nobody would doubt."""


def test_log_odds_are_those_before_and_the_sum_of_all_log_evidences():
    told = decide(SURE)
    odds = decision.LOG_ODDS["lines in water"] + sum(value for _, value in told.nepers)
    assert told.probability == pytest.approx(1.0 / (1.0 + math.exp(-odds)))
    assert told.probability > 0.9


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("line_level", (30.0, 10.0, 1.0, -1.0, -20.0)),
        ("stationary_share", (0.0, 0.25, 0.5, 0.75, 1.0)),
        ("speed_mps", (20.0, 30.0, 60.0, 100.0)),
        ("speed_mps", (0.5, 0.2, 0.1)),
        ("range_m", (5.0, 1.0, 0.2)),
        ("relative_width_std", (0.01, 0.1, 0.3, 0.6)),
        ("bearing", (90.0, 30.0, 6.0, 1.0)),
    ],
)
def test_what_speaks_against_a_passage_lowers_its_probability(name, values):
    told = [decide(SURE | {name: value}).probability for value in values]
    assert all(before > after for before, after in pairwise(told))


def test_no_explanation_counts_for_more_than_its_limit():
    worst = decide(SURE | {"relative_width_std": 1e6})
    assert dict(worst.nepers)["too-little-recorded"] == pytest.approx(-1.11 * MOST_NEPERS)
    assert worst.alternative == "too-little-recorded"
    assert 0.0 < worst.probability < 0.5
    assert worst.probability + worst.alternative_probability <= 1.0


def test_what_was_not_measured_says_nothing():
    empty = {"has_lines": 0.0, "is_air": 0.0, "relative_width_std": 0.0}
    told = decide(empty)
    odds = decision.LOG_ODDS["levels in water"]
    assert told.probability == pytest.approx(1.0 / (1.0 + math.exp(-odds)))
    assert told.alternative == "not-significant"
    unknown = decide(empty | dict.fromkeys(("sub_bands_gain", "sub_bands"), math.nan))
    assert unknown == told


def test_the_order_of_the_table_changes_nothing(monkeypatch):
    doubtful = SURE | {"line_level": -3.0, "stationary_share": 0.6}
    told = decide(doubtful)
    shuffled = tuple(np.random.default_rng(1).permutation(np.arange(len(ALTERNATIVES))))
    monkeypatch.setattr(decision, "ALTERNATIVES", tuple(ALTERNATIVES[k] for k in shuffled))
    again = decide(doubtful)
    assert again.probability == pytest.approx(told.probability, rel=1e-12)
    assert again.alternative == told.alternative


def test_a_new_explanation_is_one_function_and_one_line(monkeypatch):
    """A shower that drifts past: high sub-bands rise before the low ones."""

    def drifting_shower(measured):
        return -2.0 * measured.get("sub_bands_lag_s", math.nan)

    with_shower = REASONS | {"drifting-shower": "a shower drifts past"}
    monkeypatch.setattr(decision, "REASONS", with_shower)
    more = (*ALTERNATIVES, Alternative("drifting-shower", drifting_shower, 1.0))
    monkeypatch.setattr(decision, "ALTERNATIVES", more)
    assert decide(SURE).probability == decide(SURE | {"sub_bands_lag_s": 0.0}).probability
    told = decide(SURE | {"sub_bands_lag_s": 3.5})
    assert told.alternative == "drifting-shower"
    assert told.probability < 0.5


def test_every_explanation_has_a_sentence_and_its_log_evidence_a_sign():
    assert {one.code for one in ALTERNATIVES} <= REASONS.keys()
    rise = {"sub_bands": 6.0, "sub_bands_gain": -20.0}
    assert alternatives.other_rise(rise) < 0.0
    assert alternatives.other_rise(rise | {"sub_bands_gain": 20.0}) > 0.0
    assert alternatives.other_rise(rise | {"sub_bands": 3.0}) < 0.0
    assert math.isnan(alternatives.stationary_bearing({"bearing": 0.0}))
