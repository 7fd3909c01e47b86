"""One row for each passage, whichever frames have shown it best."""

from dataclasses import replace

import numpy as np
import pytest

from tests.flow.made_encounters import encounters_of
from uwtrack_cli.motion.competition import compete

SLOW = {
    "time_s": 100.0, "time_std_s": 0.2, "range_over_speed_s": 4.0,
    "range_over_speed_std_s": 0.2, "speed_mps": 8.0, "speed_std_mps": 0.3,
    "probability": 0.6,
}  # fmt: skip
"""A passage of four seconds, as long frames have it."""

LEVELS = {"status": "level-only", "speed_mps": float("nan"), "speed_std_mps": float("nan")}


def won(first, *others, highest=0):
    """Return the rows of two tables after they have competed, and what was refused."""
    table = compete(encounters_of(*first), [encounters_of(*rows) for rows in others], highest)
    rows = zip(table.contact, table.speed_mps, table.range_over_speed_s, strict=True)
    return [tuple(map(float, row)) for row in rows], table.refusals()


def test_answers_that_agree_are_one_and_the_better_known_one_stays():
    close = SLOW | {"speed_mps": 8.4, "range_over_speed_std_s": 0.1}
    rows, refused = won([SLOW], [close])
    assert rows == [(2.0, 8.4, 4.0)]
    assert refused == []
    vague = close | {"range_over_speed_std_s": 0.4}
    assert won([SLOW], [vague]) == ([(1.0, 8.0, 4.0)], [])


def test_a_sharper_row_that_agrees_wins_and_can_take_the_contact():
    """A closest approach 21.5 s after the begin, as frames of two lengths told it."""
    early = {"time_s": 1.1, "time_std_s": 5.1, "range_over_speed_s": 166.2,
             "range_over_speed_std_s": 8.8, "speed_mps": 3.9, "speed_std_mps": 0.8}  # fmt: skip
    late = early | {"time_s": 17.8, "time_std_s": 3.6, "range_over_speed_s": 179.2,
                    "range_over_speed_std_s": 5.4}  # fmt: skip
    tables = encounters_of(early), [encounters_of(late)]
    for keeps, contact in ((True, 1), (False, 2)):
        table = compete(*tables, keeps_first=keeps)
        assert table.time_s.tolist() == [17.8]
        assert table.contact.tolist() == [contact]


def test_a_sharper_row_takes_the_levels_of_the_one_that_it_agrees_with():
    """They are those of the band that the table states."""
    sharper = SLOW | {"range_over_speed_std_s": 0.1, "received_level_db": 90.0}
    first = encounters_of(SLOW | {"received_level_db": 100.0})
    table = compete(first, [encounters_of(sharper)], keeps_first=True)
    assert table.range_over_speed_std_s.tolist() == [0.1]
    assert table.received_level_db.tolist() == [100.0]
    assert table.contact.tolist() == [1]


def test_covariances_grow_with_the_deviations():
    """0.5 s apart, of deviations that explain 0.3 s: the correlation stays."""
    matrix = np.full((4, 4), np.nan)
    matrix[:2, :2] = [[0.04, 0.01], [0.01, 0.04]]
    first = SLOW | {"time_s": 100.5, "time_std_s": np.hypot(0.2, 0.3), "bearing_deg": 10.0}
    sharp = replace(encounters_of(SLOW | {"bearing_deg": 10.0}), covariance=matrix[None])
    table = compete(encounters_of(first), [sharp], keeps_first=True)
    assert table.time_std_s[0] == pytest.approx(np.sqrt(0.04 + 0.25 - 0.09))
    found = table.covariance[0]
    assert np.sqrt(found[0, 0]) == pytest.approx(table.time_std_s[0])
    assert found[0, 1] / np.sqrt(found[0, 0] * found[1, 1]) == pytest.approx(0.25)


def test_two_rows_of_one_sound_that_differ_by_more_than_they_may_are_both_doubted():
    """By two estimates whose errors were drawn: the better one is part of the other."""
    rng = np.random.default_rng(3)
    sharp, more = rng.normal(0.0, 0.1, 400), rng.normal(0.0, 0.2, 400)
    wrong = np.where(np.arange(400) < 40, 0.6, 0.0)
    inside = 0
    for one, other, off in zip(sharp, more, wrong, strict=True):
        first = SLOW | {"time_s": 100.0 + one + other, "time_std_s": np.hypot(0.1, 0.2)}
        second = SLOW | {"time_s": 100.0 + one + off, "time_std_s": 0.1}
        table = compete(encounters_of(first), [encounters_of(second)], keeps_first=True)
        inside += abs(table.time_s[0] - 100.0) < 1.96 * table.time_std_s[0]
    assert inside > 0.93 * 400


def test_of_answers_that_do_not_agree_the_more_probable_wins():
    other = SLOW | {"speed_mps": 20.0, "range_over_speed_s": 1.0}
    sharper = other | {"probability": 0.9}
    rows, ((contact, _, _, reason),) = won([SLOW], [sharper])
    assert rows == [(2.0, 20.0, 1.0)]
    assert contact == 1
    assert "0.90 against 0.60" in reason
    blurred = other | {"probability": 0.5}
    assert won([SLOW], [blurred]) == ([(1.0, 8.0, 4.0)], [])


@pytest.mark.parametrize("order", [1, -1])
def test_lines_beat_levels(order):
    hump = SLOW | LEVELS | {"probability": 0.9, "range_over_speed_s": 2.0}
    hump |= {"range_over_speed_std_s": 0.01}
    first, second = [SLOW, hump][::order]
    ((_, speed, _),), _ = won([first], [second])
    assert speed == 8.0


def test_passages_at_other_times_and_those_of_one_table_do_not_compete():
    later = SLOW | {"time_s": 130.0}
    rows, refused = won([SLOW, SLOW], [later], highest=40)
    assert [row[0] for row in rows] == [1.0, 2.0, 41.0]
    assert refused == []


def test_winners_of_one_table_get_numbers_that_nobody_has_had():
    """Neither a row's, nor that of a refused contact, nor each other's."""
    first = [SLOW, SLOW | {"time_s": 200.0}, SLOW | {"time_s": 300.0}]
    second = [row | {"range_over_speed_std_s": 0.1} for row in first[:2]]
    assert [row[0] for row in won(first, second)[0]] == [4.0, 5.0, 3.0]
    refused = replace(
        encounters_of(*first), refused_contact=np.array([7]),
        refused_sensor=np.array(["h1"]), refused_from_s=np.array([1.0]),
        refused_to_s=np.array([2.0]), refused_reason=np.array(["hum"]),
        refused_code=np.array([""]), refused_probability=np.array([np.nan]),
        refused_motion_model=np.array([""]),
        refused_motion_model_probability=np.array([np.nan]), refused_alternative_motion_model=np.array([""]),
        refused_alternative_motion_model_probability=np.array([np.nan]),
    )  # fmt: skip
    made = compete(refused, [encounters_of(*second)])
    assert made.contact.tolist() == [8, 9, 3]


def test_what_lost_is_refused_for_the_time_it_claimed():
    other = SLOW | {"speed_mps": 20.0, "time_s": 101.0, "probability": 0.9}
    _, ((contact, from_s, to_s, _),) = won([SLOW], [other])
    assert (contact, from_s, to_s) == (1, 96.0, 104.0)


def test_three_tables_give_one_row_and_the_order_does_not_matter():
    best = SLOW | {"probability": 0.95, "speed_mps": 30.0, "range_over_speed_s": 0.5}
    middle = SLOW | {"probability": 0.8, "speed_mps": 15.0}
    for others in ([best], [middle]), ([middle], [best]):
        rows, _ = won([SLOW], *others)
        assert [row[1] for row in rows] == [30.0]
