"""Passages beside which something changed: the law, the reading and what is given."""

from functools import cache

import numpy as np
import pytest

from tests.draws.measured_bounds import bounds
from tests.draws.measured_passages import READ_AS, SENSOR, analyse, draw, errors, place, received
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.locate import locate_vessels
from uwtrack_cli.motion.passage.model.law import passage_law, with_other_leg
from uwtrack_cli.motion.passage.model.unknowns import RAMP, Change, law_of
from uwtrack_cli.plotting.passage import ReportedPassage

CLOSEST_S, FLAT_M, HEIGHT_M, SPEED_MPS = 300.0, 180.0, 19.0, 6.0
STRAIGHT = np.array([[CLOSEST_S, np.log(FLAT_M / SPEED_MPS), SPEED_MPS]])


@cache
def analysed(kind, seed):
    """Return a drawn passage and its encounters; several tests ask the same ones."""
    drawn = draw(kind, seed)
    return drawn, analyse(drawn)


@pytest.mark.parametrize("at", [265.0, 350.0])
@pytest.mark.parametrize("change", [(-1.5, 2.0), (3.0, -4.0)])
def test_the_law_of_two_legs_is_that_of_newtons_method(at, change):
    time = np.arange(0.5, 600.0)
    other = np.array([SPEED_MPS + change[0], change[1]])
    legs = np.array([SPEED_MPS, 0.0]), other
    x, y, rate = received(time, FLAT_M, HEIGHT_M, 1500.0, at, legs)
    law = passage_law(time, STRAIGHT, 1500.0, HEIGHT_M, with_height=True)
    sign = np.array([1.0 if at > CLOSEST_S else -1.0])
    two = with_other_leg(
        law, time, STRAIGHT, (np.array([at]), sign, np.array([change])), 1500.0, HEIGHT_M
    )
    turned = (two.angle[0] - np.arctan2(x, y) + np.pi) % (2 * np.pi) - np.pi
    distance2 = x**2 + y**2 + HEIGHT_M**2
    assert np.abs(two.shift[0] + 1 - 1 / (1 + rate / 1500.0)).max() < 1e-10
    assert np.abs(turned).max() < 1e-9
    spread = np.log((FLAT_M**2 + HEIGHT_M**2) / distance2)
    assert np.abs(two.spread[0] - spread).max() < 1e-9


def test_the_partials_of_two_legs_are_those_of_differences():
    time = np.delete(np.arange(0.5, 600.0), slice(348, 354))
    start = np.array([*STRAIGHT[0], HEIGHT_M, 0.7, -1.5])

    def law(values):
        one, height = values[None, :3], values[3:4]
        straight = passage_law(time, one, 1500.0, height, with_height=True)
        change = np.array([350.0]), np.ones(1), values[None, 4:]
        return with_other_leg(straight, time, one, change, 1500.0, height).rows[0]

    exact = law(start)[:, 1:]
    for row, step in enumerate(1e-5 * np.eye(6)):
        slope = (law(start + step)[:, 0] - law(start - step)[:, 0]) / 2e-5
        assert np.abs(exact[:, row] - slope).max() < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed"),
    [("jitter", 4), ("frequency-step", 4), ("frequency-ramp", 1),
     ("speed-change", 951003),
     ("turn", 97003)],
)  # fmt: skip
def test_a_passage_is_read_as_it_was_drawn(kind, seed):
    drawn, found = analysed(kind, seed)
    error, std = errors(drawn, found)
    assert found.motion_model[0] == READ_AS.get(kind, kind)
    assert np.nanmax(np.abs(error / std)) < 4.0
    is_changed = kind not in ("straight", "jitter")
    assert np.isfinite(found.change_time_s[0]) == is_changed
    if is_changed:
        off = abs(found.change_time_s[0] - drawn.change_s)
        assert off < 4 * found.change_time_std_s[0]
        assert found.change_time_std_s[0] < 2.5  # a quarter of d/v


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed"), [("turn", 2), ("frequency-step", 4), ("frequency-ramp", 1)]
)
def test_the_curve_of_a_page_follows_what_changed(kind, seed):
    drawn, found = analysed(kind, seed)
    shift, _ = ReportedPassage(found, 0).shift(drawn.series.time_s)
    curve = found.rest_frequency_hz[0] * (1 + shift)
    off = (drawn.series.frequency_hz - curve[:, None])[:, 0]
    scaled = off / drawn.series.frequency_std_hz[:, 0]
    assert np.sqrt(np.nanmean(scaled**2)) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("turn", 2), ("turn", 7), ("speed-change", 4)])
def test_the_other_leg_has_its_own_speed_and_course(kind, seed):
    drawn, found = analysed(kind, seed)
    other = 1.0 if drawn.change_s > CLOSEST_S else -1.0
    near, far = (place(drawn, drawn.change_s + other * s) for s in (50.0, 51.0))
    velocity = other * (np.array(far) - near)
    speed = found.other_leg_speed_mps[0], found.other_leg_speed_std_mps[0]
    assert abs(speed[0] - np.hypot(*velocity)) < 4 * speed[1] < 4.0
    course = found.other_leg_course_deg[0], found.other_leg_course_std_deg[0]
    truth_deg = np.rad2deg(np.arctan2(*velocity))
    assert abs(wrap_deg(course[0] - truth_deg)) < 4 * course[1] < 40.0


@pytest.mark.parametrize("seed", [1, 2])
def test_positions_follow_both_legs_of_a_manoeuvre(seed):
    drawn, found = analysed("turn", seed)
    other = 1.0 if drawn.change_s > CLOSEST_S else -1.0
    times = [CLOSEST_S, drawn.change_s + 40.0 * other, drawn.change_s + 150.0 * other]
    at = [f"{time:.3f}" for time in times]
    fixes = locate_vessels([found], [SENSOR], at=at)
    for row in np.flatnonzero(fixes.mode == 1):
        east, north = place(drawn, fixes.time_s[row])
        off = np.array([fixes.east_m[row] - east, fixes.north_m[row] - north])
        # 99.99 % of a chi-square with two degrees of freedom
        assert off @ np.linalg.solve(fixes.covariance_m2[row], off) < 18.4


def test_a_passage_beside_a_step_beyond_its_doppler_shift_is_found():
    drawn = draw("frequency-step", 810018)
    assert abs(drawn.facts.change[0]) > 2 * drawn.truth[1] / 1500.0
    found = analyse(drawn)
    error, std = errors(drawn, found)
    assert found.motion_model.tolist() == ["frequency-step"]
    assert np.nanmax(np.abs(error / std)) < 4.0
    size = found.frequency_change[0], found.frequency_change_std[0]
    assert abs(size[0] - drawn.facts.change[0]) < 4 * size[1]


@pytest.mark.parametrize("seed", [5, 810039])
def test_a_machine_that_changes_its_speed_is_no_passage(seed):
    assert not find_encounters(series=draw("machinery", seed).series).n_encounters


def test_the_instant_of_a_ramp_is_one_of_its_unknowns():
    """Its partial is that of differences, and it widens what the passage tells."""
    theta = np.array([[CLOSEST_S, np.log(30.0), SPEED_MPS, 0.0, HEIGHT_M, 2e-5, 0.0]])
    change, medium = Change(RAMP, np.array([330.0]), np.ones(1)), Medium(1500.0)
    time = np.arange(0.5, 600.0)
    step = np.array([0.0] * 6 + [1e-3])
    ahead, behind = (law_of(theta + sign * step, time, medium, change).shift[0] for sign in (1, -1))
    exact = law_of(theta, time, medium, change).rows[0, 0, -1]
    assert np.abs(exact - (ahead - behind) / 2e-3).max() < 1e-9
    assert np.abs(exact).max() > 1e-5


def test_stated_deviations_are_near_the_bound():
    """Bounds by another law, with the same unknowns; half of them would be wrong."""
    for kind, seed in (("straight", 1), ("frequency-ramp", 1), ("speed-change", 4)):
        drawn, found = analysed(kind, seed)
        _, std = errors(drawn, found)
        share = (std / bounds(drawn))[:4]
        assert share.min() > 0.8
        assert share.max() < 2.0
