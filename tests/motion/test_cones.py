"""Cones of a line array in the fit: cosines, their lobes, and the ship that tows it."""

from dataclasses import replace

import numpy as np
import pytest

from uwtrack_cli.motion.target_motion.model import from_motion, to_motion
from uwtrack_cli.motion.target_motion.objective import bearing_errors, misfit
from uwtrack_cli.motion.target_motion.own_noise import is_own_noise
from uwtrack_cli.motion.target_motion.own_ship import OwnPath, make_observer_track
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.marquardt import search_bounds
from uwtrack_cli.motion.target_motion.starts import first_bearings, multistart

C, DESIGN_HZ, COSINE_STD, FREQUENCY_STD_HZ = 1500.0, 250.0, 0.004, 0.01
TOW_M, SPEED_MPS, TURN_S, TURN_RAD = 80.0, 4.0, 110.0, np.radians(70.0)
TIME_S = np.arange(0.0, 280.0, 2.0)
PLACE_M, VELOCITY_MPS = np.array([1100.0, 700.0]), np.array([-5.0, 3.0])
LIMITS = search_bounds((20.0, 2e4), 18.0)


def ship(time_s):
    """Where the towing ship is: north, then to the right at a corner."""
    before, after = np.minimum(time_s, TURN_S), np.maximum(time_s - TURN_S, 0.0)
    way = SPEED_MPS * np.stack([after * np.sin(TURN_RAD), before + after * np.cos(TURN_RAD)])
    return way, np.where(time_s < TURN_S, 0.0, TURN_RAD)


WAY_S = np.arange(-60.0, 300.0, 1.0)


def path(later_s):
    places, heading = ship(WAY_S - later_s)
    return OwnPath(WAY_S, *places, heading)


ARRAY, SHIP = path(TOW_M / SPEED_MPS), path(0.0)


def heard(there, rest_hz, seed):
    """Cones and frequencies of what lies at places, of lines at rest frequencies."""
    rng = np.random.default_rng(seed)
    here, heading = ship(TIME_S - TOW_M / SPEED_MPS)
    off = there - here
    range_m = np.hypot(*off)
    rate = np.gradient(range_m, TIME_S)
    frequency = rest_hz[:, None] * (1.0 - rate / C)
    frequency += FREQUENCY_STD_HZ * rng.standard_normal(frequency.shape)
    cosine = np.cos(np.arctan2(*off) - heading)
    cosine = cosine + COSINE_STD * rng.standard_normal(frequency.shape)
    lobe = 2.0 * DESIGN_HZ / frequency
    # the lobe nearest to abeam is what the array names
    cosine = np.clip(cosine - lobe * np.round(cosine / lobe), -1.0, 1.0)
    sine2 = np.maximum(1.0 - cosine**2, COSINE_STD)
    return Problem(
        track=make_observer_track(ARRAY, TIME_S, "instantaneous", 1.0),
        bearing_rad=(heading + np.arccos(cosine))[None],
        bearing_weight=np.sqrt(sine2) / COSINE_STD,
        frequency_hz=frequency[None],
        frequency_weight=np.full(frequency.shape, 1.0 / FREQUENCY_STD_HZ),
        sound_speed_mps=C,
        array_heading_rad=heading,
        lobe_cosine=lobe,
    )


def target(rest_hz, seed=1):
    return heard(PLACE_M[:, None] + VELOCITY_MPS[:, None] * TIME_S, np.array(rest_hz), seed)


def truth():
    """Range, bearing, speed and course at the first row."""
    off = PLACE_M - ship(np.array([-TOW_M / SPEED_MPS]))[0][:, 0]
    return np.array([np.hypot(*off), np.arctan2(*off), np.hypot(*VELOCITY_MPS),
                     np.arctan2(*VELOCITY_MPS) % (2 * np.pi)])  # fmt: skip


@pytest.mark.parametrize("rest_hz", [[180.0], [410.0], [460.0, 330.0]])
def test_gradients_of_cones_are_those_of_differences(rest_hz):
    problem = target(rest_hz)
    q = from_motion(*(truth() * [1.1, 1.02, 0.9, 1.03])).reshape(1, 4)
    step = 1e-6 * np.eye(4)
    ahead, behind = (misfit(problem, q + sign * step).value for sign in (1.0, -1.0))
    half = (ahead - behind) / 4e-6
    assert misfit(problem, q).gradient[0] == pytest.approx(half, rel=1e-4, abs=1e-2)


@pytest.mark.parametrize("lobes_away", [-2, -1, 0, 1])
def test_a_lobe_tells_what_any_other_lobe_tells(lobes_away):
    problem = target([460.0])
    heading = problem.array_heading_rad
    model = np.arctan2(*(PLACE_M[:, None] + VELOCITY_MPS[:, None] * TIME_S - ARRAY_AT))
    cosine = np.cos(problem.bearing_rad - heading) + lobes_away * problem.lobe_cosine
    inside = np.abs(cosine) < 0.95
    other = heading + np.arccos(np.where(inside, cosine, 0.0))
    # over the sine of its own angle: the deviation is that of the cosine
    sine = [np.sin(each - heading) for each in (problem.bearing_rad, other)]
    first, second = (
        bearing_errors(problem, model[None], data)[0] * own
        for data, own in zip((problem.bearing_rad, other), sine, strict=True)
    )
    assert second[inside] == pytest.approx(first[inside], abs=1e-12)


ARRAY_AT = ship(TIME_S - TOW_M / SPEED_MPS)[0]


@pytest.mark.parametrize("rest_hz", [[180.0, 120.0], [460.0, 330.0], [480.0]])
def test_the_lobe_that_is_right_is_found_with_the_motion(rest_hz):
    problem = target(rest_hz)
    starts = first_bearings(problem)
    assert np.abs(np.exp(1j * (starts - truth()[1])) - 1.0).min() < 0.03
    found = multistart(problem, LIMITS)
    motion = to_motion(found.q[0])
    assert motion == pytest.approx(truth(), rel=0.03)
    n = 2 * len(rest_hz) * TIME_S.size
    assert abs(found.value[0] - n) < 5.0 * np.sqrt(2.0 * n)


def test_cones_that_begin_beyond_the_axis_start_on_it():
    problem = target([180.0])
    # a slope that no cone goes on with: its line begins at 1.22
    cosine = np.where(TIME_S < 12.0, 1.0, -0.9)
    angle = problem.array_heading_rad + np.arccos(cosine)
    steep = replace(problem, bearing_rad=angle[None, None], lobe_cosine=None)
    starts = first_bearings(steep)
    assert starts.size >= 2
    assert np.abs(np.sin(starts)).max() < 0.05


def test_ranges_by_uncertain_cones_are_not_short():
    """A weight that follows its own noisy angle pulls cones to abeam."""
    off = []
    for seed in range(12):
        problem = target([180.0, 120.0], seed)
        rng = np.random.default_rng(seed)
        heading, std = problem.array_heading_rad, 0.2
        cosine = np.cos(np.arctan2(
            *(PLACE_M[:, None] + VELOCITY_MPS[:, None] * TIME_S - ARRAY_AT)
        ) - heading)  # fmt: skip
        cosine = np.clip(cosine + std * rng.standard_normal((2, TIME_S.size)), -1.0, 1.0)
        noisy = replace(
            problem,
            bearing_rad=(heading + np.arccos(cosine))[None],
            bearing_weight=np.sqrt(np.maximum(1.0 - cosine**2, std)) / std,
            frequency_weight=0.05 * problem.frequency_weight,
            cone_std_rad=None,
        )
        fit = multistart(noisy, LIMITS)
        spread = np.linalg.inv(fit.matrix[0])
        off.append((fit.q[0, 0] - np.log(truth()[0])) / np.sqrt(spread[0, 0]))
    assert abs(np.mean(off)) < 2.0 / np.sqrt(12)  # folded angles: 1.2 short and more


@pytest.mark.parametrize(("rest_hz", "seed"), [([180.0, 120.0], 1), ([460.0], 2)])
def test_the_towing_ship_is_told_from_a_target(rest_hz, seed):
    own = heard(ship(TIME_S)[0], np.array(rest_hz), seed)
    best = float(multistart(own, LIMITS).value[0])
    assert is_own_noise(own, ARRAY, SHIP, TIME_S, best)
    other = target(rest_hz, seed)
    best = float(multistart(other, LIMITS).value[0])
    assert not is_own_noise(other, ARRAY, SHIP, TIME_S, best)
    unfolded = replace(own, array_heading_rad=None)
    assert not is_own_noise(unfolded, ARRAY, SHIP, TIME_S, best)
