"""The rule of acceptance can fail: each kind of loss is red, each gain is green."""

from copy import deepcopy

import pytest

from tests.acceptance.comparison import case_differences, exact
from tests.acceptance.outcomes import score, scored
from tests.acceptance.rates import Rate
from tests.draws.recordings import Passage

PASSAGE = Passage(100.0, 5.0, 200.0, 80.0, "port", {"speed_mps": 0.1})


def row(**changes):
    return {
        "contact": 1, "status": "ok", "probability": 0.95, "time_s": 100.1, "time_std_s": 0.2, "side": "port",
        "speed_mps": 5.05, "speed_std_mps": 0.15, "range_over_speed_s": 40.0,
        "range_over_speed_std_s": 0.5, "slant_range_m": None, "slant_range_std_m": None,
        "course_deg": 81.0, "course_std_deg": 2.0, **changes,
    }  # fmt: skip


def compared(*rows):
    return list(case_differences(score([row()], [PASSAGE]), score(rows, [PASSAGE])))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([], "lost"),
        ([row(status="level-only")], "status 'level-only'"),
        ([row(side="starboard")], "side wrong"),
        ([row(side="")], "side none"),
        ([row(speed_mps=None)], "speed_mps not given"),
        ([row(speed_mps=5.4)], "speed_mps off by"),
        ([row(speed_std_mps=0.3)], "speed_mps wider"),
        ([row(speed_std_mps=0.07)], "speed_mps narrower"),
        ([row(time_std_s=0.1)], "time_s narrower"),
        ([row(), row(contact=2)], "1 false rows"),
        ([row(), row(contact=2, time_s=200.0)], "1 false rows"),
        ([row(), row(time_s=200.0)], "2 false rows"),
        ([row(speed_mps=6.0)], "1 false rows"),
    ],
)
def test_what_is_worse_is_red(rows, words):
    assert any(words in one for one in compared(*rows))


@pytest.mark.parametrize(
    "changes",
    [{}, {"speed_mps": 5.0}, {"speed_mps": 4.95}, {"speed_std_mps": 0.1}, {"time_s": 99.8}],
)
def test_what_is_as_good_or_better_is_green(changes):
    assert compared(row(**changes)) == []


def test_a_vessel_that_was_missed_may_be_found_and_a_false_row_may_go():
    worse = score([row(time_s=300.0)], [PASSAGE])
    assert list(case_differences(worse, score([row()], [PASSAGE]))) == []


def test_a_score_is_worse_beyond_its_slack_and_what_fails_is_red():
    before = {"scores": {"ids": scored(1.0, "less", 0.1)}}
    for value, n_red in ((0.5, 0), (1.05, 0), (1.2, 1), (float("nan"), 1)):
        now = {"scores": {"ids": scored(value, "less", 0.1)}}
        assert len(list(case_differences(before, now))) == n_red, value
    assert list(case_differences(before, {"failed": "IndexError"})) == ["failed: IndexError"]


def test_a_count_is_worse_where_the_exact_intervals_part():
    before = {"counts": {"false by track": [1, 1.0], "own at 20 degrees": [58, 60]}}
    for false, own, n_red in ((3, 55, 0), (12, 58, 1), (1, 40, 1), (0, 60, 0)):
        now = {"counts": {"false by track": [false, 1.0], "own at 20 degrees": [own, 60]}}
        assert len(list(case_differences(before, now))) == n_red, (false, own)


def test_pure_moves_are_compared_to_the_ninth_digit():
    one = score([row()], [PASSAGE])
    other = deepcopy(one)
    other["vessels"][0]["quantities"]["speed_mps"]["error"] *= 1 + 1e-6
    assert list(exact(one, one)) == []
    assert len(list(exact(one, other))) == 1


def test_a_rate_is_held_by_its_exact_interval():
    share = Rate("share", lambda _: (0, 0), (), (0.98, 1.0), (0.98, 1.0), "")
    assert share.held((57, 60), share.limit)  # upper end .990
    assert not share.held((54, 60), share.limit)  # upper end .962
    rate = share._replace(limit=(0.0, 0.1), is_share=False)
    assert rate.held((2, 5.0), rate.limit)  # lower end .048 an hour
    assert not rate.held((3, 5.0), rate.limit)  # lower end .124 an hour
