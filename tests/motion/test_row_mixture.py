"""Bearings of which some are another's, and those of a target beside a sensor."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.stats import norm

from uwtrack_cli.motion.target_motion.model import to_state
from uwtrack_cli.motion.target_motion.near_rows import near_rows
from uwtrack_cli.motion.target_motion.objective import misfit, misfit_value
from uwtrack_cli.motion.target_motion.observability import information
from uwtrack_cli.motion.target_motion.own_ship import ObserverTrack
from uwtrack_cli.motion.target_motion.problem import Problem, without_rows
from uwtrack_cli.motion.target_motion.row_mixture import RowMixture

PLACES_M = np.array([[0.0, 0.0], [2000.0, 0.0], [900.0, 1800.0]])
STD_RAD, OFFSET_STD_RAD = np.radians(3.0), np.radians(6.0)


def record(state, times_s, draw, std_rad=STD_RAD):
    """Return a record of three sensors that hear a motion in turn at each time."""
    time = np.repeat(times_s, 3)
    sensor = np.tile(np.arange(3), len(times_s))
    own = PLACES_M[sensor]
    way = state[:2] + state[2:] * time[:, None] - own
    bearing = np.arctan2(*way.T) + std_rad * draw.standard_normal(time.size)
    weight = np.zeros((3, time.size))
    weight[sensor, np.arange(time.size)] = 1.0 / std_rad
    track = ObserverTrack(
        time_s=time, east_m=own[:, 0], north_m=own[:, 1], now=np.arange(time.size),
        before=None, interval_s=np.ones(time.size),
        velocity_mps=np.zeros((2, time.size)),
    )  # fmt: skip
    return Problem(
        track=track,
        bearing_rad=np.where(weight > 0, bearing, 0.0)[np.newaxis],
        bearing_weight=weight,
        frequency_hz=np.zeros((1, 0, time.size)),
        frequency_weight=np.zeros((0, time.size)),
        sound_speed_mps=1500.0,
        sensor=sensor,
        offset_std_rad=np.full(3, OFFSET_STD_RAD),
    )


def test_rows_count_as_the_sum_over_all_who_may_own_them_and_over_offsets():
    state = np.array([700.0, 600.0, 1.0, 2.0])
    problem = record(state, [0.0, 200.0, 400.0], np.random.default_rng(4))
    share, other = 0.7, np.linspace(0.02, 0.3, 9)
    trials = state + np.array([[0.0] * 4, [150, -90, 0, 0], [0, 120, 0.3, 0.0]])
    # every assignment of a sensor's three rows, the offset integrated numerically
    offset = np.linspace(-0.6, 0.6, 4001)
    prior = norm.pdf(offset, scale=OFFSET_STD_RAD)
    exact = np.zeros(3)
    for (trial, here), sensor in product(enumerate(trials), range(3)):
        rows = np.flatnonzero(problem.sensor == sensor)
        way = here[:2] + here[2:] * problem.track.time_s[rows, None] - PLACES_M[sensor]
        off = np.arctan2(*way.T) - problem.bearing_rad[0, sensor, rows]
        own = share * norm.pdf(off[:, None] + offset, scale=STD_RAD)
        alike = np.broadcast_to(other[rows, None], own.shape)
        total = sum(
            np.where(np.array(mine)[:, None], own, alike).prod(axis=0)
            for mine in product((False, True), repeat=3)
        )
        exact[trial] += np.log(trapezoid(total * prior, offset))
    mixture = RowMixture(problem, share, other, np.zeros(3))
    found = mixture.log_likelihood(trials)
    np.testing.assert_allclose(found - found[0], exact - exact[0], atol=0.15)
    assert np.ptp(exact) > 1.5


@pytest.mark.parametrize("loss", ["squares", "huber", "student", "tukey"])
def test_a_trial_motion_costs_the_same_alone_and_beside_others(loss):
    """Each has the offsets of the sensors that suit it best."""
    state = np.array([700.0, 600.0, 1.0, 2.0])
    problem = record(state, np.arange(0.0, 900.0, 60.0), np.random.default_rng(4))
    # the first sensor's bearings have no offset
    problem = replace(problem, loss=loss, offset_std_rad=OFFSET_STD_RAD * np.arange(3))
    q = np.array([np.log(922.0), 0.86, 1.0, 2.0])
    trials = q + np.array([[0.0] * 4, [0.2, 0.3, 0.0, 1.0], [-0.2, -0.4, 2.0, 0.0]])
    alone = [float(misfit(problem, one[None]).value[0]) for one in trials]
    np.testing.assert_allclose(misfit(problem, trials).value, alone, rtol=1e-9)
    of_states = misfit_value(problem, to_state(trials), np.empty((3, 0)), np.zeros(3, np.int64))
    np.testing.assert_allclose(of_states, alone, rtol=1e-9)
    assert alone[0] < min(alone[1:])


def test_a_target_at_the_place_of_a_sensor_is_not_known_to_centimetres():
    times = np.linspace(0.0, 600.0, 21)
    for beside_m, is_near in ((0.01, True), (300.0, False)):
        # past the first sensor at 300 s, eastwards at 3 m/s
        state = np.array([-900.0, beside_m, 3.0, 0.0])
        problem = record(state, times, np.random.default_rng(5))
        q = np.array([np.log(np.hypot(*state[:2])), np.arctan2(*state[:2]), 3.0, 0.0])
        near = near_rows(problem, q)
        at_sensor = (problem.sensor == 0) & (problem.track.time_s == 300.0)
        assert near[at_sensor].all() == is_near
        # those just before and after may be, no others
        assert not near[(problem.sensor > 0) | (abs(problem.track.time_s - 300) > 31)].any()
        told = np.linalg.det(information(problem, q).covariance())
        rest = without_rows(problem, near)
        assert (told < 1e-2 * np.linalg.det(information(rest, q).covariance())) == is_near


def test_offsets_that_are_known_leave_the_sum_over_who_may_own_each_row():
    state = np.array([700.0, 600.0, 1.0, 2.0])
    problem = record(state, [0.0, 200.0, 400.0], np.random.default_rng(4))
    problem = replace(problem, offset_std_rad=np.array([1e-7, 0.0, 1e-7]))
    share, other = 0.7, np.linspace(0.02, 0.3, 9)
    trials = state + np.array([[0.0] * 4, [150, -90, 0, 0], [0, 120, 0.3, 0.0]])
    rows, time = np.arange(9), problem.track.time_s
    exact = []
    for trial in trials:
        way = trial[:2] + trial[2:] * time[:, None] - PLACES_M[problem.sensor]
        off = np.arctan2(*way.T) - problem.bearing_rad[0, problem.sensor, rows]
        off = np.angle(np.exp(1j * off))
        exact.append(np.log(share * norm.pdf(off, scale=STD_RAD) + other).sum())
    found = RowMixture(problem, share, other, np.zeros(3)).log_likelihood(trials)
    np.testing.assert_allclose(found, exact, atol=1e-4)
