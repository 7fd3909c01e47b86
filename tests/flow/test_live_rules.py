"""When two things that live sound told are one, are news, or are worth a look.

Every limit is held on both sides.
"""

from itertools import permutations

import numpy as np
import pytest

from uwtrack_cli.flow import live_events, live_presence
from uwtrack_cli.flow.live_activity import HeardSpan, ToldPassage, _joined, is_worth_a_look
from uwtrack_cli.flow.live_events import _Passage, _Passages


def passage(time_s=100.0, std_s=2.0, width_s=20.0, lines=(63.0,), **more):
    return {
        "time_s": time_s, "time_std_s": std_s, "range_over_speed_s": width_s,
        "range_over_speed_std_s": 1.0, "horizontal_range_over_speed_s": 7.0,
        "speed_mps": 5.0, "speed_std_mps": 0.3, "rest_frequencies_hz": list(lines),
        "status": "ok", "contact": 1, "reasons": {}, **more,
    }  # fmt: skip


def test_an_event_is_told_again_where_its_time_and_lines_are_the_same():
    """By the odds of `same_vessel`; another machine at that time is another vessel."""
    known = [_Passage(passage(500.0), 1, 0, 9.0), _Passage(passage(100.0), 2, 0, 9.0)]
    assert live_events._nearest(passage(103.0), known) is known[1]
    assert live_events._nearest(passage(300.0), known) is None
    assert live_events._nearest(passage(103.0), []) is None
    assert live_events._nearest(passage(103.0, lines=(40.0, 63.1)), known) is known[1]
    assert live_events._nearest(passage(103.0, lines=(40.0, 70.0)), known) is None
    assert live_events._nearest(passage(103.0, lines=()), known) is known[1]


@pytest.mark.slow
def test_passages_are_paired_the_nearest_first_and_one_to_one():
    rng = np.random.default_rng(1)
    for _ in range(40):
        rows = [passage(t) for t in rng.uniform(90.0, 125.0, 4)]
        known = [_Passage(passage(t), 1, 0, 9.0) for t in rng.uniform(90.0, 125.0, 3)]
        found = live_events._paired(rows, known)
        apart = np.array([[abs(r["time_s"] - p.row["time_s"]) for r in rows] for p in known])
        (limit,) = [
            t for t in np.arange(0.0, 40.0, 0.01)
            if live_events._nearest(passage(t), [_Passage(passage(0.0), 1, 0, 9.0)])
        ][-1:]  # fmt: skip
        wanted = {}
        while apart.min() <= limit:
            k, n = np.unravel_index(apart.argmin(), apart.shape)
            wanted[int(k)] = rows[int(n)]
            apart[k], apart[:, n] = np.inf, np.inf
        assert found == wanted


@pytest.mark.parametrize(
    ("row", "width_s", "from_s"),
    [
        (passage(), 20.0, 80.0),
        (passage(width_s=None), 7.0, 93.0),
        (passage(width_s=None, horizontal_range_over_speed_s=None), 10.0, 90.0),
        (passage(status="level-only"), 20.0, 40.0),  # a level needs its flanks
    ],
)
def test_a_passage_is_shown_by_the_sound_from_its_width_before_it(row, width_s, from_s):
    assert live_events._width_s(row) == width_s
    assert live_events._needed_from_s(row) == from_s
    assert _Passage(row, 1, 0, 9.0).due_s == 100.0 + 4.0 * width_s + 60.0


@pytest.mark.parametrize(
    ("change", "agrees", "is_news"),
    [
        ({}, True, False),
        ({"time_s": 101.9}, True, False),
        ({"time_s": 102.1}, False, True),
        ({"speed_mps": 5.29}, True, False),
        ({"speed_mps": 4.69}, False, True),
        ({"range_over_speed_s": 21.5}, False, True),
        ({"speed_mps": None, "speed_std_mps": None}, False, True),
        ({"status": "level-only"}, False, True),
        ({"time_std_s": 0.66 * 2.0}, True, True),  # known a third better
        ({"time_std_s": 0.68 * 2.0}, True, False),
    ],
)
def test_what_is_beyond_a_deviation_or_known_better_is_news(change, agrees, is_news):
    told = _Passage(passage(), 1, 0, 160.0)
    row = passage(**change)
    assert live_events._agrees(row, told.row) == agrees
    assert live_events._is_news(row, told, 160.0) == is_news
    sharper = change.get("time_std_s", 2.0) < 0.67 * 2.0
    assert live_events._is_news(row, told, 159.0) == sharper  # shorter looks know less


def test_a_deviation_that_was_not_known_is_news():
    told = _Passage(passage(speed_mps=None, speed_std_mps=None), 1, 0, 160.0)
    assert live_events._is_news(passage(), told, 60.0)


def told_passages(*rows):
    said = []

    def say(kind, time_s, row, revision, *, is_final):
        assert (kind, time_s) == ("encounter", row["time_s"])
        said.append((row["contact"], revision, is_final, row["status"]))

    known = _Passages(say)
    for row in rows:
        known.see(row, 160.0)
    return known, said


def test_passages_are_numbered_revised_decided_and_withdrawn():
    known, said = told_passages(passage(), passage(400.0), passage(101.0))
    assert said == [(1, 0, False, "ok"), (2, 0, False, "ok")]
    assert known.told(passage(405.0)) == 2
    assert known.told(passage(430.0)) is None
    assert not known.some_are_due(239.9)
    assert known.some_are_due(240.0)
    known.decide([passage(102.5), passage(402.0)], 539.9)
    assert said[2:] == [(1, 1, True, "ok")]
    assert not known.some_are_due(539.9)
    known.decide([], 540.0)
    assert said[3:] == [(2, 1, True, "not-a-passage")]
    assert known.told(passage(400.0)) is None
    known.see(passage(104.9), 2500.0)  # it is decided
    known.finish([passage(103.0), passage(900.0)])
    assert said[4:] == [(3, 0, True, "ok")]
    known.finish([passage(109.0), passage(900.0)])
    assert said[5:] == [(1, 2, True, "ok")]
    known.finish([passage(109.0)])
    assert said[6:] == [(3, 1, True, "not-a-passage")]


def test_what_passages_explain_reaches_eight_widths():
    known, _ = told_passages(passage(), passage(10.0, status="level-only"))
    known.looked(80.0, 300.0)
    one, other = known.explaining()
    lines = (63.0,)
    assert one == ToldPassage(-60.0, 260.0, lines, 20.0, 80.0, 300.0, False)
    assert other[:6] == (-150.0, 170.0, lines, 20.0, 0.0, -np.inf)
    known.looked(0.0, 310.0)
    assert [p.looked_s for p in known.explaining()] == [310.0, 310.0]
    known.decide([], 1000.0)
    assert known.explaining() == []


def row(from_s, to_s, lines=(60.0, 120.0), rates=(), **more):
    return {
        "contact": 1, "kind": "vessel", "from_s": from_s, "to_s": to_s,
        "from_utc": None, "to_utc": None, "spacing_hz": None, "blade_rate_hz": None,
        "frequencies_hz": list(lines), "rates_hz": list(rates), "n_lines": len(lines),
        "probability_of_chance": 1e-6, "encounter": None, "reasons": {}, **more,
    }  # fmt: skip


NO_LINES = {"lines": ()}


@pytest.mark.parametrize(
    ("one", "other", "is_one"),
    [
        (row(0, 100), row(160, 200), True),  # a minute apart
        (row(0, 100), row(160.1, 200), False),
        (row(160.1, 200), row(0, 100), False),
        (row(0, 99, **NO_LINES), row(50, 80, **NO_LINES), True),
        (row(0, 99, **NO_LINES), row(50, 80), False),
        (row(0, 99, encounter=3, **NO_LINES), row(50, 80, encounter=3), True),
        (row(0, 99, encounter=3, **NO_LINES), row(50, 80, encounter=4), False),
        # half of the shorter list, within 0.5 % or half a hertz
        (row(0, 99, (60.0, 500.0)), row(0, 99, (60.49, 700.0, 9.0)), True),
        (row(0, 99, (60.0, 500.0)), row(0, 99, (60.51, 700.0, 9.0)), False),
        (row(0, 99, (500.0,)), row(0, 99, (502.4,)), True),
        (row(0, 99, (500.0,)), row(0, 99, (502.6,)), False),
        (row(0, 99, (60.0, 300.0, 500.0)), row(0, 99, (60.0, 10.0, 11.0)), False),
        (row(0, 99, (5.0,), (3.0,)), row(0, 99, (9.0,), (3.049,)), True),
        (row(0, 99, (5.0,), (3.0,)), row(0, 99, (9.0,), (3.051,)), False),
        (row(0, 99, (5.0,), (30.0,)), row(0, 99, (9.0,), (30.119,)), True),
        (row(0, 99, (5.0,), (30.0,)), row(0, 99, (9.0,), (30.121,)), False),
        (row(0, 99, (5.0,), spacing_hz=10.0), row(0, 9, (9.0,), spacing_hz=10.09), True),
        (row(0, 99, (5.0,), spacing_hz=10.0), row(0, 9, (9.0,), spacing_hz=10.11), False),
    ],
)
def test_two_segments_are_one_by_time_and_lines(one, other, is_one):
    assert live_presence._are_one(one, other) == is_one
    assert live_presence._are_one(other, one) == is_one


@pytest.mark.parametrize(
    ("later", "may"),
    [
        (row(150, 300, (59.5, 119.0)), True),
        (row(150, 300, (58.81, 119.0)), True),  # falls by 2 %, and none rises
        (row(150, 300, (58.79, 119.0)), False),
        (row(150, 300, (60.01, 119.0)), False),
        (row(160.5, 300, (59.5, 119.0)), False),
        (row(-1, 300, (59.5, 119.0)), False),
        (row(150, 300, (59.5, 119.0), (3.0,)), False),
        (row(150, 300, **NO_LINES), False),
    ],
)
def test_lines_go_on_lower_after_a_passage(later, may):
    assert live_presence._may_go_on(row(0, 100), later) == may


@pytest.mark.parametrize(
    ("change", "is_news"),
    [
        ({}, False),
        ({"to_s": 999.0}, False),
        ({"kind": "lines"}, True),
        ({"encounter": 2}, True),
        ({"spacing_hz": 30.0}, True),
        ({"frequencies_hz": [60.0, 120.0, 180.0]}, False),
        ({"frequencies_hz": [60.0, 120.0, 180.0, 240.0]}, True),  # half more, and one
        ({"rates_hz": [3.0]}, True),
    ],
)
def test_more_time_is_no_news_and_more_lines_are(change, is_news):
    assert live_presence._is_news({**row(0, 100), **change}, row(0, 100)) == is_news
    known = row(0, 100, spacing_hz=20.0, blade_rate_hz=5.0)
    for spacing_hz, is_other in ((20.19, False), (20.21, True), (None, True)):
        new = {**known, "spacing_hz": spacing_hz}
        assert live_presence._is_news(new, known) == is_other


@pytest.mark.parametrize(
    ("span_s", "is_inside"),
    [((50, 200), True), ((51, 200), False), ((50, 199), False), ((0, 900), True)],
)
def test_a_level_counts_with_flanks_as_long_as_it_is(span_s, is_inside):
    level = row(100, 150, **NO_LINES)
    assert live_presence._is_inside(level, span_s) == is_inside
    assert live_presence._is_inside(row(100, 150), (120, 130))
    early = row(10, 60, **NO_LINES)
    assert live_presence._is_inside(early, (0.0, 110.0))
    assert not live_presence._is_inside(early, (1.0, 110.0))


@pytest.mark.parametrize(
    ("kind", "chance", "is_certain"),
    [("vessel", 1e-3, True), ("vessel", 1.1e-3, False), ("vessel", None, True),
     ("unknown", 1e-9, False)],
)  # fmt: skip
def test_what_may_be_chance_is_not_told(kind, chance, is_certain):
    one = row(0, 9, kind=kind, probability_of_chance=chance)
    assert live_presence._is_certain(one) == is_certain


def test_segments_are_paired_by_the_time_that_they_share():
    told = [
        live_presence._Told(one, one, k, 160.0) for k, one in enumerate((row(0, 100), row(80, 300)))
    ]
    for rows in permutations([row(90, 310), row(0, 95), row(500, 600)]):
        found = {t.number: r for t, r in live_presence._paired(rows, told)}
        assert found == {0: row(0, 95), 1: row(90, 310)}


@pytest.mark.parametrize(
    ("last", "wanted"),
    [
        # runs of 6, 0, 6 and 0 s with gaps of 6, 24 and 8 s, then one of 2 or 38 s
        ((50, 52), [(4.0, 16.0), (40.0, 46.0), (54.0, 54.0), (100.0, 102.0)]),
        ((40, 60), [(4.0, 118.0)]),  # it joins one after another
    ],
)
def test_spans_that_lie_closer_than_they_last_are_one(last, wanted):
    counted = np.zeros(60, bool)
    for first, stop in ((2, 6), (8, 9), (20, 24), (27, 28), last):
        counted[first:stop] = True
    assert _joined(counted, 2.0 * np.arange(60)) == [HeardSpan(*one) for one in wanted]


@pytest.mark.parametrize(
    ("span", "is_worth"),
    [
        (HeardSpan(100.0, 384.0), True),  # sound after it tells a tenth more
        (HeardSpan(100.0, 383.9), False),
        (HeardSpan(372.0, 392.0), True),  # the shorter segment has what begins later
        (HeardSpan(372.1, 400.0), False),
        (HeardSpan(370.0, 390.0), True),  # an eighth of the shorter one, or half
        (HeardSpan(370.0, 389.9), False),
        (HeardSpan(320.0, 400.0, 60.0), True),
        (HeardSpan(320.1, 400.0, 60.0), False),
    ],
)
def test_a_look_is_worth_what_no_shorter_one_shows(span, is_worth):
    """At 500 s, 400 s long after one of 160 s, looked at last at 424 s."""
    assert is_worth_a_look([span], 500.0, 424.0, 400.0, 160.0) == is_worth


@pytest.mark.parametrize(
    ("span", "is_own"),
    [
        (HeardSpan(90.0, 100.0), True), (HeardSpan(90.0, 99.9), False),
        (HeardSpan(200.0, 300.0), True), (HeardSpan(200.1, 300.0), False),
        (HeardSpan(-np.inf, 300.0), False),
        (HeardSpan(90.0, 150.0, 61.8), True), (HeardSpan(90.0, 150.0, 61.7), False),
    ],
)  # fmt: skip
def test_what_overlaps_a_passage_and_has_its_lines_is_explained(span, is_own):
    assert span.is_explained(ToldPassage(100.0, 200.0, (31.0, 63.0), 9.0)) == is_own
