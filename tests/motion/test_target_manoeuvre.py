"""A target that turns or changes its speed is told, a straight one is not suspected."""

from dataclasses import replace

import numpy as np
import pytest

from studies.tma_scenarios import (
    COUNT,
    REST_HZ,
    SOUND_SPEED_MPS,
    STEP_S,
    TARGETS,
    make_problem,
    make_scenario,
)
from tests.draws.sonar_tables import heard, own_ship
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.motion.options import MotionModel, Nuisances
from uwtrack_cli.motion.target_motion.last_leg import _linear, _Trial, bent
from uwtrack_cli.motion.target_motion.objective import residuals
from uwtrack_cli.motion.tma import estimate_motion

TURN_S = STEP_S * 500


def seen(place, own):
    relative = place - own
    distance = np.hypot(*relative.T)
    rate = np.diff(distance) / STEP_S
    bearing = np.degrees(np.arctan2(relative[1:, 0], relative[1:, 1]))
    return bearing, REST_HZ * (1 - rate / SOUND_SPEED_MPS)


def turning(name, turn_deg, faster_kn, noise, seed=3):
    """The published scenario, its target with another velocity from the middle on."""
    scenario = make_scenario(name)
    time = STEP_S * np.arange(-1, COUNT)
    course, start = np.radians([scenario.course_deg, scenario.bearing_deg])
    before = scenario.speed_mps * np.array([np.sin(course), np.cos(course)])
    speed, course = (
        scenario.speed_mps + faster_kn * KNOT_MPS, course + np.radians(turn_deg)
    )  # fmt: skip
    after = speed * np.array([np.sin(course), np.cos(course)])
    place = scenario.range_m * np.array([np.sin(start), np.cos(start)])
    place = place + time[:, np.newaxis] * before
    place += np.maximum(time - TURN_S, 0.0)[:, np.newaxis] * (after - before)
    bearing, frequency = seen(
        place, np.stack([scenario.own_east_m, scenario.own_north_m], axis=1)
    )
    draw = np.random.default_rng(seed).standard_normal((2, COUNT))
    return replace(
        heard(name, noise=noise),
        bearing_deg=(bearing + noise * draw[0]) % 360.0,
        frequency_hz=(frequency + 0.25 * noise * draw[1])[:, np.newaxis],
    )


def motions_of(series, name):
    return estimate_motion(
        series, None, own_ship(name), sound_speed_mps=SOUND_SPEED_MPS, updates=1,
        model=MotionModel(doppler="interval"), nuisances=Nuisances(0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip


@pytest.mark.parametrize("name", TARGETS)
def test_a_straight_target_is_not_suspected(name):
    motions = motions_of(heard(name), name)
    assert motions.motion_model.tolist() == ["straight"] * motions.mode.size
    assert motions.manoeuvre_gain[0] < 14.5
    assert np.isnan(motions.manoeuvre_time_s).all()


def state_at_the_end(name, turn_deg, faster_kn):
    """Range, bearing, speed and course at the last row, SI and degrees."""
    scenario = make_scenario(name)
    time = STEP_S * (COUNT - 1)
    course, start = np.radians([scenario.course_deg, scenario.bearing_deg])
    speed = scenario.speed_mps + faster_kn * KNOT_MPS
    later = course + np.radians(turn_deg)
    place = scenario.range_m * np.array([np.sin(start), np.cos(start)])
    place = place + TURN_S * scenario.speed_mps * np.array(
        [np.sin(course), np.cos(course)]
    )
    place += (time - TURN_S) * speed * np.array([np.sin(later), np.cos(later)])
    place -= np.array([scenario.own_east_m[-1], scenario.own_north_m[-1]])
    bearing = np.degrees(np.arctan2(*place))
    return np.array([np.hypot(*place), bearing, speed, np.degrees(later)])


def error_now(motions, true):
    """Errors of the state at the last measurement, in stated deviations."""
    names = ("range{}_m", "bearing{}_deg", "speed{}_mps", "course{}_deg")
    now, std = (
        np.array([getattr(motions, f"now_{n.format(part)}")[0] for n in names])
        for part in ("", "_std")
    )
    off = now - true
    off[[1, 3]] = (off[[1, 3]] + 180.0) % 360.0 - 180.0
    return off / std


CHANGES = [(10.0, 0.0, 1.0), (0.0, 1.0, 1.0), (90.0, 0.0, 1.0), (30.0, 0.0, 5.0)]


@pytest.mark.parametrize(("turn_deg", "faster_kn", "noise"), CHANGES)
def test_a_target_that_changes_its_velocity_is_told_and_where_it_is_now(
    turn_deg, faster_kn, noise
):
    motions = motions_of(turning("S1-T1", turn_deg, faster_kn, noise), "S1-T1")
    assert set(motions.motion_model) == {"manoeuvre"}
    # a turn of ten degrees at one sigma: the published gain is 160
    assert motions.manoeuvre_gain[0] > 20.0
    if turn_deg < 90.0:
        assert motions.manoeuvre_time_s[0] == pytest.approx(TURN_S, abs=600.0)
    for name in ("range_m", "speed_mps", "course_deg", "range_low_m"):
        assert np.isnan(getattr(motions, name)).all()
    assert "at the first measurement not given" in motions.reasons(0)["range_m"]
    assert not motions.manoeuvre_needed[0]
    off = error_now(motions, state_at_the_end("S1-T1", turn_deg, faster_kn))
    assert np.abs(off).max() < 4.0
    assert (
        motions.now_range_std_m[0] < 0.15 * motions.now_range_m[0]
    )  # 1 to 10 %: it is not bought with wide deviations


def both_legs():
    """A problem without noise, its last leg in solver coordinates, and the change."""
    series = turning("S1-T1", 30.0, 2.0, 0.0)
    scenario = make_scenario("S1-T1")
    problem = make_problem(scenario, noise=1.0, runs=1, seed=0)
    problem = replace(
        problem,
        bearing_rad=np.radians(series.bearing_deg)[None, None],
        frequency_hz=series.frequency_hz.T[None],
    )
    before = scenario.speed_mps * np.array([
        np.sin(np.radians(scenario.course_deg)), np.cos(np.radians(scenario.course_deg))
    ])  # fmt: skip
    speed = scenario.speed_mps + 2.0 * KNOT_MPS
    course = np.radians(scenario.course_deg + 30.0)
    after = speed * np.array([np.sin(course), np.cos(course)])
    first = scenario.range_m * np.array([
        np.sin(np.radians(scenario.bearing_deg)), np.cos(np.radians(scenario.bearing_deg))
    ])  # fmt: skip
    track, own = problem.track, (scenario.own_east_m[1], scenario.own_north_m[1])
    node = track.now[0]
    origin = np.array(own) - np.array([track.east_m[node], track.north_m[node]])
    place = first - origin + TURN_S * (before - after)
    q = np.array([np.log(np.hypot(*place)), np.arctan2(*place), *after])
    return problem, q, np.array([*(after - before), TURN_S])


def test_both_legs_are_a_straight_motion_seen_from_a_bent_track():
    """Without noise nothing is left of bearings and frequencies but the one row in
    which the velocity changes."""
    problem, q, change = both_legs()
    r = residuals(bent(problem, change), q[None])
    assert np.abs(r.bearing).max() < 1e-6
    assert np.sort(np.abs(r.frequency.ravel()))[-3] < 1e-5


def test_partials_by_the_change_are_what_a_small_change_does():
    problem, q, change = both_legs()
    rest_hz = residuals(bent(problem, change), q[None]).rest_hz
    rows = _linear(problem, _Trial(q, change), float(problem.row_time_s[-1]))[0]
    for column, step in zip(rows[:, -3:].T, np.diag([0.3, 0.3, 5.0]), strict=True):
        r = residuals(bent(problem, change + step), q[None], rest_hz=rest_hz)
        moved = np.concatenate([r.bearing.ravel(), r.frequency.ravel()]) / step.max()
        assert moved @ column == pytest.approx(column @ column, rel=0.05)
