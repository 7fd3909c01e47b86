"""What a closest approach explains of what was heard."""

from dataclasses import replace

import numpy as np
import pytest

from tests.flow.made_encounters import encounters_of
from uwtrack_cli.presence.line_summary import LineSummary
from uwtrack_cli.presence.passage_segments import add_readings, add_refusals, mark_passages
from uwtrack_cli.presence.segment import SoundSegment, segment_of_lines

SOUND_MPS = 343.0
REST_HZ = (100.0, 147.0, 231.0)
TIME_S, SPEED_MPS, RANGE_M = 50.0, 30.0, 12.0
LEVELS_REFUSED = "the levels of its lines do not rise and fall as the range would"


def received_hz(rest_hz, from_s, to_s):
    """Mean frequency of a tone past a sensor: emission times solved one by one."""
    emitted_s = np.linspace(-60.0, 60.0, 60001)
    range_m = np.hypot(RANGE_M, SPEED_MPS * emitted_s)
    arrived_s = TIME_S + emitted_s + (range_m - RANGE_M) / SOUND_MPS
    ratio = np.gradient(emitted_s, arrived_s)
    inside = (arrived_s > from_s) & (arrived_s < to_s)
    return rest_hz * float(np.average(ratio[inside], weights=np.gradient(arrived_s)[inside]))


def lines_of(rows, contact=2):
    """Lines from rows of frequency, begin and end."""
    frequency, begin, end = np.array(rows, float).T
    unknown = np.full(frequency.size, np.nan)
    return LineSummary(
        frequency_hz=frequency, frequency_std_hz=np.full(frequency.size, 0.02),
        from_s=begin, to_s=end, level_db=np.full(frequency.size, 60.0),
        bearing_deg=unknown, bearing_std_deg=unknown,
        contact=np.full(frequency.size, contact), family=np.full(frequency.size, -1),
        status=np.full(frequency.size, "moving"), line_id=np.arange(frequency.size) + 1,
        resolution_hz=np.full(frequency.size, 0.5),
    )  # fmt: skip


def passage(*refused):
    """One closest approach, contact 1, and what was refused."""
    known = {
        "time_s": TIME_S, "arrival_time_s": TIME_S, "speed_mps": SPEED_MPS,
        "speed_std_mps": 0.3, "range_over_speed_s": RANGE_M / SPEED_MPS,
        "sound_speed_mps": SOUND_MPS,
    }  # fmt: skip
    contact, begin, end, reason = zip(*refused, strict=True) if refused else [()] * 4
    return replace(
        encounters_of(known),
        rest_frequency_hz=np.array(REST_HZ),
        rest_frequency_std_hz=np.full(3, 0.1),
        rest_encounter=np.zeros(3, np.int64),
        rest_line_id=np.zeros(3, np.int64),
        refused_contact=np.array(contact, np.int64),
        refused_sensor=np.full(len(refused), "h1"),
        refused_from_s=np.array(begin, float),
        refused_to_s=np.array(end, float),
        refused_reason=np.array(reason, np.str_),
        refused_code=np.full(len(refused), ""),
        refused_probability=np.full(len(refused), np.nan),
        refused_motion_model=np.array([STILL.get(one, "") for one in reason], np.str_),
        refused_motion_model_probability=np.array([WEIGHT.get(one, np.nan) for one in contact]),
        refused_alternative_motion_model=np.full(len(refused), "constant"),
        refused_alternative_motion_model_probability=np.full(len(refused), 0.1),
    )


STILL, WEIGHT = {"a machine": "machinery", "a pair": "joined"}, {2: 0.9, 3: 0.7}
"""Readings by reason, and their weights by contact."""


def pieces(from_s, to_s, rest_hz=REST_HZ):
    return [(received_hz(one, from_s, to_s), from_s, to_s) for one in rest_hz]


def told(kind, rows, contact=2):
    return segment_of_lines(kind, lines_of(rows, contact), 1e-9, "a test")


@pytest.mark.parametrize("kind", ["vessel", "lines", "unknown"])
@pytest.mark.parametrize("span", [(20.0, 49.0), (51.0, 90.0), (30.0, 80.0)])
def test_pieces_of_the_lines_that_passed_are_of_the_passage(kind, span):
    found = [told(kind, pieces(*span))]
    mark_passages(passage(), found)
    assert [(one.kind, one.encounter) for one in found] == [("vessel", 1)]
    assert len(found[0].frequencies_hz) == 3
    assert "encounter" not in found[0].reasons()


@pytest.mark.parametrize("kind", ["vessel", "lines"])
def test_steady_lines_at_the_rest_frequencies_are_others(kind):
    """Before a passage the vessel's own lines are higher by v/c."""
    found = [told(kind, [(one, 5.0, 49.0) for one in REST_HZ])]
    mark_passages(passage(), found)
    assert [(one.kind, one.encounter) for one in found] == [(kind, 0), ("vessel", 1)]


def test_of_lines_that_nothing_joins_the_passages_own_are_taken_out():
    others = [(181.0, 10.0, 90.0), (512.0, 10.0, 90.0)]
    found = [told("lines", pieces(20.0, 49.0) + others), told("unknown", pieces(51.0, 70.0))]
    mark_passages(passage(), found)
    rest, hers = found
    assert (rest.kind, rest.encounter, rest.frequencies_hz) == ("lines", 0, [181.0, 512.0])
    assert (hers.kind, hers.encounter, len(hers.frequencies_hz)) == ("vessel", 1, 6)
    assert (hers.from_s, hers.to_s) == (20.0, 70.0)


def test_lines_of_another_time_are_not_the_passages():
    found = [told("vessel", [(f, from_s + 400, to_s + 400) for f, from_s, to_s in
                             pieces(51.0, 90.0)])]  # fmt: skip
    mark_passages(passage(), found)
    assert found[0].encounter == 0


def test_passages_without_lines_that_overlap_have_a_row_each():
    """The rise of one vessel is not that of the next, however long both last."""
    shown = [{"time_s": time_s, "arrival_time_s": time_s, "range_over_speed_s": width_s}
             for time_s, width_s in ((14.0, 280.0), (820.0, 1040.0))]  # fmt: skip
    found = []
    mark_passages(encounters_of(*shown), found)
    rows = {one.encounter: (one.from_s, one.to_s) for one in found}
    assert rows == {1: (-546.0, 574.0), 2: (-1260.0, 2900.0)}


def test_what_was_refused_of_a_vessel_that_passed_is_no_row():
    table = passage((2, 20.0, 49.0, LEVELS_REFUSED), (4, 40.0, 60.0, "another"))
    found = [told("vessel", pieces(20.0, 49.0))]
    mark_passages(table, found)
    add_refusals(table, found)
    assert [(one.kind, one.encounter) for one in found] == [("vessel", 1)]


def test_what_no_passage_explains_is_told_with_its_reason():
    table = passage((2, 200.0, 260.0, LEVELS_REFUSED), (3, 300.0, 330.0, "short"))
    found = [told("vessel", [(80.0, 200.0, 260.0)], contact=2)]
    mark_passages(table, found)
    add_refusals(table, found)
    reasons = {(one.kind, one.from_s): one.reason for one in found if not one.encounter}
    assert reasons == {("vessel", 200.0): LEVELS_REFUSED, ("unknown", 300.0): "short"}


def test_a_rise_that_was_refused_keeps_its_row_and_gets_the_reason():
    table = passage((5, 200.0, 260.0, LEVELS_REFUSED))
    found = [SoundSegment("broadband", 210.0, 250.0, reason="a rise")]
    add_refusals(table, found)
    assert [(one.kind, one.reason) for one in found] == [("broadband", LEVELS_REFUSED)]


@pytest.mark.parametrize(
    ("reasons", "read"),
    [(("a machine", "a machine"), ("machinery", 0.7)), (("a machine", "a pair"), ("", None)),
     (("a machine",), ("", None))],
)  # fmt: skip
def test_a_segment_is_read_as_all_of_its_contacts_are(reasons, read):
    """By the least certain; what stays neither refuses a rise nor gets a row."""
    table = passage(*((k + 2, 200.0, 260.0, one) for k, one in enumerate(reasons)))
    found = [
        told("lines", [(80.0, 200.0, 260.0), (90.0, 200.0, 260.0)]),
        SoundSegment("broadband", 210.0, 250.0, reason="a rise"),
    ]
    found[0].tones.contact[:] = [2, 3]
    add_refusals(table, found)
    add_readings(table, found)
    assert [one.reason for one in found] == ["a test", "a rise"]
    assert (found[0].motion_model, found[1].motion_model) == (read[0], "")
    if read[1] is None:
        assert "motion_model" in found[0].reasons()
    else:
        assert (found[0].motion_model_probability, found[0].alternative_motion_model) == (
            read[1],
            "constant",
        )
