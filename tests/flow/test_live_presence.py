"""Presence of live sound: told as it begins, once, and in accord with the file."""

import pytest

from uwtrack_cli.flow.live_presence import (
    NOT_CONFIRMED,
    NOT_DECIDED,
    OVER_S,
    LivePresence,
    with_told_encounter,
)


def row(from_s, to_s, kind="vessel", lines=(60.0, 120.0, 180.0), **more):
    return {
        "contact": 1, "sensor": "h1", "kind": kind, "from_s": from_s, "to_s": to_s,
        "from_utc": None, "to_utc": None, "spacing_hz": 60.0 if lines else None,
        "blade_rate_hz": None, "frequencies_hz": list(lines), "rates_hz": [],
        "n_lines": len(lines), "probability_of_chance": 1e-6, "encounter": None,
        "reasons": {}, **more,
    }  # fmt: skip


@pytest.fixture
def heard():
    said = []

    def say(event, time_s, facts, revision, *, is_final):
        assert event == "presence"
        assert time_s == facts["from_s"]
        assert "contact" not in facts
        said.append((facts["segment"], revision, is_final, facts["kind"], facts["to_s"]))

    return LivePresence(say), said


def test_a_segment_that_goes_on_is_told_once(heard):
    known, said = heard
    known.see([row(20, 100)], (0, 100), 160)
    known.see([row(40, 200)], (40, 200), 160)  # the short look begins later
    known.see([row(140, 300, lines=(60.02, 120.0))], (140, 300), 160)
    assert said == [(1, 0, False, "vessel", 100)]
    known.see([row(20, 300, encounter=1)], (0, 300), 400)
    assert said[1:] == [(1, 1, False, "vessel", 300)]
    assert not known.some_are_due(300 + OVER_S - 1)
    assert known.some_are_due(300 + OVER_S)
    known.decide([row(20, 310, encounter=1)], 310 + OVER_S)
    assert said[2:] == [(1, 2, True, "vessel", 310)]
    known.see([row(30, 310)], (30, 650), 2500)  # it is decided
    known.finish([row(20, 310, encounter=1)])
    assert len(said) == 3


FALLEN = (59.5, 119.0, 178.5)
BROKEN = {"spacing_hz": None, "kind": "lines", "lines": FALLEN}


def test_lines_that_broke_off_at_the_passage_are_not_told_alone(heard):
    known, said = heard
    known.see([row(20, 80)], (0, 80), 160)
    known.see([row(20, 80), row(84, 100, **BROKEN)], (0, 100), 160)
    joined = row(20, 120, lines=(60.0, 120.0, 180.0, *FALLEN))
    known.see([joined], (0, 120), 160)
    known.finish([joined])
    assert {told[0] for told in said} == {1}


@pytest.mark.parametrize(
    ("from_s", "lines", "now_s"),
    [
        (84, FALLEN, 144),  # they have lasted
        (84, (60.5, 121.0, 181.5), 100),  # lines of a passage fall
        (84, (55.0, 110.0, 165.0), 100),  # no vessel is so fast
        (150, FALLEN, 160),  # it was over long before
        (15, FALLEN, 40),  # they began before
    ],
)
def test_other_lines_beside_a_segment_are_told_at_once(heard, from_s, lines, now_s):
    known, said = heard
    known.see([row(20, 80)], (0, 80), 160)
    own = row(from_s, now_s, **{**BROKEN, "lines": lines})
    known.see([row(20, 80), own], (0, now_s), 160)
    assert [told[0] for told in said] == [1, 2]


def test_what_still_sounds_is_not_decided(heard):
    known, said = heard
    known.see([row(20, 100)], (0, 100), 160)
    known.decide([row(20, 390)], 100 + OVER_S)
    assert [told[2] for told in said] == [False]


def test_other_lines_or_another_time_are_another_segment(heard):
    known, said = heard
    other = row(50, 90, lines=(77.0, 91.0, 99.0), spacing_hz=None)
    known.see([row(20, 100), other], (0, 100), 160)
    known.see([row(400, 450)], (300, 460), 160)
    assert [told[0] for told in said] == [1, 2, 3]


@pytest.mark.parametrize("more", [{"kind": "unknown"}, {"probability_of_chance": 0.01}], ids=str)
def test_what_may_be_chance_is_told_at_the_end_alone(heard, more):
    known, said = heard
    known.see([row(20, 100, **more)], (0, 100), 160)
    assert said == []
    known.finish([row(20, 100, **more)])
    assert [told[:3] for told in said] == [(1, 0, True)]


def test_a_rise_is_told_when_it_has_quiet_sound_on_either_side(heard):
    known, said = heard
    rise = row(100, 140, kind="broadband", lines=())
    known.see([rise], (0, 150), 160)
    known.see([rise], (70, 230), 160)
    assert said == []
    known.see([rise], (20, 180), 160)
    assert [told[3] for told in said] == ["broadband"]


def test_what_more_sound_does_not_confirm_is_withdrawn(heard):
    known, said = heard
    other = row(150, 160, lines=(300.0,), spacing_hz=None)
    known.see([row(20, 100), other], (0, 160), 160)
    known.decide([], 100 + OVER_S)
    assert said[2:] == [(1, 1, True, "unknown", 100)]
    known.finish([])
    assert said[3:] == [(2, 1, True, "unknown", 160)]  # the first one is told already
    assert NOT_CONFIRMED in with_reason(known)


def with_reason(known):
    return {told.row["reasons"].get("encounter") for told in known._known}


def test_the_whole_sound_has_the_last_word(heard):
    known, said = heard
    known.see([row(20, 100)], (0, 100), 160)
    known.decide([row(20, 100)], 100 + OVER_S)
    del said[:]
    known.finish([row(20, 100, kind="hum"), row(900, 950)])
    assert said == [(1, 2, True, "hum", 100), (2, 0, True, "vessel", 950)]


def test_a_closest_approach_is_named_as_it_was_told():
    told = with_told_encounter(row(0, 9, encounter=7), {7: 2})
    assert told["encounter"] == 2
    early = with_told_encounter(row(0, 9, encounter=8), {7: 2})
    assert early["encounter"] is None
    assert early["reasons"]["encounter"] == NOT_DECIDED
    assert with_told_encounter(row(0, 9), {})["reasons"] == {}
