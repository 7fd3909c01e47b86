"""A target that turns or changes its speed is told, a straight one is not suspected."""

from dataclasses import replace

import numpy as np
import pytest

from studies.tma_runs import PAPER
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
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.errors import UwtrackNote
from uwtrack_cli.motion.options import MotionModel, Nuisances
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.legs import CHANGE_STDS_MPS, seek_alteration
from uwtrack_cli.motion.target_motion.model import from_state, predict, state_at, to_state
from uwtrack_cli.motion.target_motion.objective import misfit
from uwtrack_cli.motion.target_motion.problem import MotionPrior
from uwtrack_cli.motion.target_motion.solvers.marquardt import minimise
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
    speed, course = (scenario.speed_mps + faster_kn * KNOT_MPS, course + np.radians(turn_deg))
    after = speed * np.array([np.sin(course), np.cos(course)])
    place = scenario.range_m * np.array([np.sin(start), np.cos(start)])
    place = place + time[:, np.newaxis] * before
    place += np.maximum(time - TURN_S, 0.0)[:, np.newaxis] * (after - before)
    bearing, frequency = seen(place, np.stack([scenario.own_east_m, scenario.own_north_m], axis=1))
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
    assert motions.manoeuvre_probability[0] < 0.1
    assert np.isnan(motions.manoeuvre_time_s).all()


def state_at_the_end(name, turn_deg, faster_kn):
    """Range, bearing, speed and course at the last row, SI and degrees."""
    scenario = make_scenario(name)
    time = STEP_S * (COUNT - 1)
    course, start = np.radians([scenario.course_deg, scenario.bearing_deg])
    speed = scenario.speed_mps + faster_kn * KNOT_MPS
    later = course + np.radians(turn_deg)
    place = scenario.range_m * np.array([np.sin(start), np.cos(start)])
    place = place + TURN_S * scenario.speed_mps * np.array([np.sin(course), np.cos(course)])
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
def test_a_target_that_changes_its_velocity_is_told_and_where_it_is_now(turn_deg, faster_kn, noise):
    motions = motions_of(turning("S1-T1", turn_deg, faster_kn, noise), "S1-T1")
    assert set(motions.motion_model) == {"manoeuvre"}
    # a turn of ten degrees at one sigma: the published gain is 160
    assert motions.manoeuvre_gain[0] > 20.0
    if turn_deg < 90.0:
        assert motions.manoeuvre_time_s[0] == pytest.approx(TURN_S, abs=600.0)
    assert not motions.manoeuvre_needed[0]
    off = error_now(motions, state_at_the_end("S1-T1", turn_deg, faster_kn))
    assert np.abs(off).max() < 4.0
    assert (
        motions.now_range_std_m[0] < 0.15 * motions.now_range_m[0]
    )  # 1 to 10 %: it is not bought with wide deviations


@pytest.mark.parametrize(("turn_deg", "faster_kn", "noise"), [(30.0, 0.0, 1.0), (-60.0, 2.0, 1.0)])
def test_every_leg_is_told_with_the_time_of_the_alteration(turn_deg, faster_kn, noise):
    """Against the drawn truth: the state at the first row, and each leg's speed."""
    motions = motions_of(turning("S1-T1", turn_deg, faster_kn, noise), "S1-T1")
    scenario, legs = make_scenario("S1-T1"), motions.ragged("legs", 0)
    assert [leg["number"] for leg in legs] == [1, 2]
    after = scenario.speed_mps + faster_kn * KNOT_MPS
    for leg, speed, course in zip(
        legs, (scenario.speed_mps, after),
        (scenario.course_deg, scenario.course_deg + turn_deg), strict=True,
    ):  # fmt: skip
        assert abs(leg["speed_mps"] - speed) < 4.0 * leg["speed_std_mps"] < 2.0
        off = (leg["course_deg"] - course + 180.0) % 360.0 - 180.0
        assert abs(off) < 4.0 * leg["course_std_deg"] < 20.0
    assert abs(motions.range_m[0] - scenario.range_m) < 4.0 * motions.range_std_m[0]
    assert legs[1]["alteration_time_s"] == motions.manoeuvre_time_s[0]
    late = legs[1]["alteration_time_s"] - TURN_S
    assert abs(late) < max(4.0 * legs[1]["alteration_time_std_s"], 2.0 * STEP_S)
    assert legs[0]["end_s"] < legs[1]["start_s"] < legs[1]["end_s"] == 5994.0
    assert (motions.update_time_s <= legs[0]["end_s"]).all()


def test_a_change_that_may_have_been_widens_what_a_straight_motion_tells():
    """A turn of ten degrees at five deviations: found, or held by the deviations."""
    straight = motions_of(heard("S1-T1", noise=5.0), "S1-T1")
    motions = motions_of(turning("S1-T1", 10.0, 0.0, 5.0, seed=1), "S1-T1")
    assert motions.motion_model[0] == "straight"
    assert motions.manoeuvre_probability[0] > straight.manoeuvre_probability[0]
    assert motions.speed_std_mps[0] > 1.2 * straight.speed_std_mps[0]


@pytest.mark.parametrize("which", ["bearings", "frequencies", "both"])
def test_outliers_do_not_widen_what_a_table_tells(which):
    """One in twenty is off by degrees, or by hertz; deviations are stated."""
    rng, clean = np.random.default_rng(5), heard("S1-T1")
    hit = rng.random((2, COUNT)) < 0.05
    bearing, frequency = clean.bearing_deg, clean.frequency_hz.copy()
    if which != "frequencies":
        bearing = bearing + hit[0] * rng.normal(0.0, 20.0, COUNT)
    if which != "bearings":
        frequency[:, 0] += hit[1] * rng.uniform(-5.0, 5.0, COUNT)
    table = replace(clean, bearing_deg=bearing % 360.0, frequency_hz=frequency)
    found, known = motions_of(table, "S1-T1"), motions_of(clean, "S1-T1")
    assert found.motion_model[0] == "straight"
    assert found.range_std_m[0] < 1.2 * known.range_std_m[0]
    error = abs(found.range_m[0] - make_scenario("S1-T1").range_m)
    assert error < 4.0 * found.range_std_m[0]


def test_limits_of_an_analyst_count_as_measurements_and_are_said():
    """Mean and deviation of what lies anywhere between two limits: middle, w / sqrt 12."""
    series = heard("S3", rows=150)
    series = replace(series, frequency_hz=np.full((150, 1), np.nan))
    found = estimate_motion(
        series, None, own_ship("S3"), updates=1, speed_limits_mps=(3.0, 5.0),
        range_limits_m=(10_000.0, 40_000.0), course_limits_deg=(200.0, 340.0),
    )  # fmt: skip
    assert found.speed_std_mps[0] <= 2.0 / np.sqrt(12.0) * 1.05
    assert found.range_std_m[0] <= np.log(4.0) / np.sqrt(12.0) * 1.05 * found.range_m[0]
    assert abs(found.range_m[0] - 20_000.0) < 2.0 * found.range_std_m[0]
    for words in ("20000 m within a factor of 1.5", "4.0 +- 0.6 m/s", "270 +- 40 degrees"):
        assert words in found.statement
    assert "limits" not in estimate_motion(series, None, own_ship("S3")).statement


def test_rows_out_of_order_are_sorted_with_a_line_of_notice():
    series, order = heard("S3"), np.random.default_rng(2).permutation(COUNT)
    mixed = series.take("row", order)
    with pytest.warns(UwtrackNote, match="contact 1 were not in order of time: sorted"):
        found = motions_of(mixed, "S3")
    assert found.range_m[0] == motions_of(series, "S3").range_m[0]


def test_frequencies_alone_do_not_make_a_mirrored_motion_trusted():
    """Two courses of own ship leave the motion and its mirror image alike."""
    series = replace(heard("S1-T1"), bearing_deg=np.full(COUNT, np.nan))
    found = motions_of(series, "S1-T1")
    assert found.mode.size > 1
    assert found.misfit[1] == pytest.approx(found.misfit[0], abs=2.0)
    assert not found.ellipse_trusted.any()
    assert "a bearing would" in found.report[0]


def altered():
    """A problem whose target altered twice, and that motion in solver coordinates."""
    scenario = make_scenario("S1-T1")
    problem = make_problem(scenario, noise=1.0, runs=1, seed=0)
    changes = [1.0, -2.0, 1500.3, np.log(300.0), 0.5, 1.0, 4000.2, np.log(100.0)]
    return problem, np.append(scenario.solution(), changes)


@pytest.mark.parametrize("is_delayed", [False, True])
def test_partials_of_a_target_with_legs_are_what_small_steps_do(is_delayed):
    problem, q = altered()
    medium, state = Medium(SOUND_SPEED_MPS, is_delayed=is_delayed), to_state(q)
    model = predict(problem.track, state[None], medium)
    assert model.bearing_jacobian.shape == (1, 12, COUNT)
    for place, step in enumerate([1.0, 1.0] + 2 * [1e-3, 1e-3, 1e-3, 1e-3] + 2 * [1e-3]):
        shift = step * np.eye(12)[place]
        ends = predict(problem.track, np.stack([state + shift, state - shift]), medium)
        for values, partials in (
            (ends.bearing_rad, model.bearing_jacobian),
            (ends.rate_mps, model.rate_jacobian),
        ):
            slope = (values[0] - values[1]) / (2.0 * step)
            scale = np.abs(slope).max()
            np.testing.assert_allclose(partials[0, place], slope, atol=1e-5 * scale)


def test_a_target_turns_evenly_in_course_between_its_legs():
    """Integrated in small steps: course and logarithm of the speed are linear in time."""
    _, q = altered()
    state = to_state(q)
    time = np.arange(0.0, 6000.0, 0.05) + 0.025
    velocity = np.full(time.size, state[2] + 1j * state[3])
    for east, north, middle, log_duration in state[4:].reshape(-1, 4):
        share = np.clip((time - middle) / np.exp(log_duration) + 0.5, 0.0, 1.0)
        turn = np.log((velocity[-1] + east + 1j * north) / velocity[-1])
        velocity = velocity * np.exp(turn * share)
    for at in (1400.0, 1500.0, 1700.0, 4010.0, 5999.0):
        place = state[0] + 1j * state[1] + 0.05 * velocity[time < at].sum()
        found = state_at(q, at)[0]
        np.testing.assert_allclose(found[:2], [place.real, place.imag], atol=0.5)
        now = np.interp(at, time, velocity)
        np.testing.assert_allclose(found[2:], [now.real, now.imag], atol=1e-3)


def test_the_odds_of_an_alteration_are_those_of_its_integral():
    """Against the likelihood itself, summed over changes of velocity, at one instant."""
    problem = make_problem(make_scenario("S3"), noise=5.0, runs=1, seed=4)
    q = minimise(problem, make_scenario("S3").solution()[None], PAPER).q[0]
    found = seek_alteration(problem, q, NuisanceDeviations())
    place = 20
    at, width = found.instant_s[place], CHANGE_STDS_MPS[1]
    grid = np.linspace(-4.0 * width, 4.0 * width, 17)
    east, north = (one.ravel() for one in np.meshgrid(grid, grid))
    state = to_state(q) + found.shift[place, :4].dot(np.stack([east, north])).T
    moved = np.concatenate([from_state(state), np.zeros((east.size, 4))], axis=1)
    moved[:, 2:4] = state[:, 2:]
    moved[:, 4:] = np.stack([east, north, at + 0 * east, np.log(1.0) + 0 * east], axis=1)
    free = replace(problem, prior=MotionPrior(change_std_mps=1e6))
    value = misfit(free, moved).value
    duration = (0.0 - free.prior.log_duration.mean) ** 2
    value = value - duration - misfit(problem, q[None]).value[0]
    density = np.exp(-0.5 * (east**2 + north**2) / width**2) / (2.0 * np.pi * width**2)
    odds = (np.exp(-0.5 * value) * density).sum() * (grid[1] - grid[0]) ** 2
    assert found.log_odds[place, 1] == pytest.approx(np.log(odds), abs=0.1)
