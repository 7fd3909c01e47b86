"""Courses that bend for long: the law, its reading, and where the vessel is."""

from functools import cache

import numpy as np
import pytest

from tests.draws.measured_passages import (
    BEND,
    CLOSEST_S,
    LENGTH_S,
    SENSOR,
    analyse,
    bent,
    draw,
    errors,
)
from uwtrack_cli.motion.locate import locate_vessels
from uwtrack_cli.motion.passage.model.law import passage_law
from uwtrack_cli.motion.passage.model.steady_turn import SteadyTurn, with_steady_turn
from uwtrack_cli.plotting.passage import ReportedPassage

FLAT_M, HEIGHT_M, SPEED_MPS, SOUND_MPS = 180.0, 19.0, 6.0, 1500.0
TIME_S = np.arange(0.5, LENGTH_S)
START = np.array([CLOSEST_S, np.log(FLAT_M / SPEED_MPS), SPEED_MPS, HEIGHT_M])
SEED = 520004


def law(values):
    """Return the rows of a passage with a turn by its seven unknowns."""
    turn = SteadyTurn(*values[4:, None])
    return with_steady_turn(TIME_S, values[None, :3], turn, SOUND_MPS, values[3:4]).rows[0]


@cache
def bending():
    """Return a drawn vessel whose course bends, and its encounters."""
    drawn = draw(BEND, SEED)
    return drawn, analyse(drawn)


@pytest.mark.parametrize(
    ("angle", "duration", "middle"), [(1.2, 200.0, 340.0), (-0.9, 90.0, 400.0), (0.5, 50.0, 180.0)]
)
def test_the_law_of_a_turn_is_that_of_a_path_that_is_summed_up(angle, duration, middle):
    bend = middle, duration, angle
    x, y, rate = bent(TIME_S, FLAT_M, HEIGHT_M, SOUND_MPS, SPEED_MPS, bend)
    values = np.array([*START, angle, duration, middle])
    rows = law(values)
    turned = np.angle(np.exp(1j * (rows[1, 0] - np.arctan2(x, y))))
    spread = np.log((FLAT_M**2 + HEIGHT_M**2) / (x**2 + y**2 + HEIGHT_M**2))
    # the sums are off by the square of their step of 20 ms
    assert np.abs(rows[0, 0] + 1 - 1 / (1 + rate / SOUND_MPS)).max() < 1e-8
    assert np.abs(turned).max() < 1e-6
    assert np.abs(rows[2, 0] - spread).max() < 1e-6
    for row, step in enumerate(1e-5 * np.eye(7), 1):
        slope = (law(values + step)[:, 0] - law(values - step)[:, 0]) / 2e-5
        assert np.abs(rows[:, row] - slope).max() < 1e-7


def test_a_turn_by_nothing_is_straight():
    straight = passage_law(TIME_S, START[None, :3], SOUND_MPS, HEIGHT_M, with_height=True)
    rows = law(np.array([*START, 0.0, 60.0, 320.0]))
    assert np.abs(rows[:, :5] - straight.rows[0]).max() < 1e-12


def test_a_course_that_bends_is_read_so_and_followed():
    """Read as straight, its d/v was off by several deviations, and its curve too."""
    drawn, found = bending()
    error, std = errors(drawn, found)
    assert found.motion_model.tolist() == ["manoeuvre"]
    assert np.nanmax(np.abs(error / std)) < 4.0
    lasts, angle = drawn.facts.change
    given = found.turn_away_deg[0], found.turn_away_std_deg[0]
    assert abs(given[0] - np.degrees(angle)) < 4 * given[1] < 80.0
    given = found.turn_duration_s[0], found.turn_duration_std_s[0]
    assert abs(given[0] - lasts) < 4 * given[1]
    shift, _ = ReportedPassage(found, 0).shift(drawn.series.time_s)
    off = drawn.series.frequency_hz - found.rest_frequency_hz * (1 + shift[:, None])
    scaled = off / drawn.series.frequency_std_hz
    assert np.sqrt(np.nanmean(scaled**2)) < 1.2


def test_positions_follow_a_turn():
    drawn, found = bending()
    times = CLOSEST_S + np.array([-150.0, 0.0, 150.0])
    fixes = locate_vessels([found], [SENSOR], at=[f"{t:.3f}" for t in times])
    facts = drawn.facts
    bend = drawn.change_s, *facts.change
    # emitted there and then: sound that needs no time
    x, y, _ = bent(fixes.time_s, drawn.flat_m, 0.0, 1e12, drawn.truth[1], bend)
    course = np.radians(drawn.truth[4])
    along = np.array([np.sin(course), np.cos(course)])
    side = 1.0 if drawn.side == "starboard" else -1.0
    away = side * np.array([-along[1], along[0]])
    rows = np.flatnonzero(fixes.mode == 1)
    assert rows.size == times.size
    for row in rows:
        off = np.array([fixes.east_m[row], fixes.north_m[row]])
        off -= x[row] * along + y[row] * away
        # 99.99 % of a chi-square with two degrees of freedom
        assert off @ np.linalg.solve(fixes.covariance_m2[row], off) < 18.4
