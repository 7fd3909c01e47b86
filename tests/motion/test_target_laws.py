"""The misfit of target motion against a model of its own, differenced and written out."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares

from tests.motion.sonar_scene import (
    BEARING_STD_RAD,
    FREQUENCY_STD_HZ,
    INTERVAL_S,
    OFFSET_STD_RAD,
    ROWS,
    SOUND_MPS,
    STATE,
    Scene,
)
from uwtrack_cli.motion.coloured_noise import ColouredNoise
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations, error_budget
from uwtrack_cli.motion.target_motion.legs import seek_alteration
from uwtrack_cli.motion.target_motion.modes import seen_at
from uwtrack_cli.motion.target_motion.objective import misfit, misfit_value, residuals
from uwtrack_cli.motion.target_motion.observability import information

KINDS = [
    (1, "interval", False, 0.0, False), (1, "instantaneous", True, 40.0, False),
    (3, "interval", True, 300.0, True), (3, "instantaneous", False, 0.0, True),
]  # fmt: skip


@cache
def made(kind, loss="squares"):
    sensors, doppler, delayed, height_m, offsets = kind
    scene = Scene(sensors, doppler, delayed=delayed, height_m=height_m)
    problem = scene.problem(offsets=offsets, loss=loss)
    return scene, problem


def beside(scene, problem, q):
    """Return motion, best rest frequencies and offsets, by the linear equations."""
    x = scene.truth(offsets=problem.offset_std_rad is not None)
    x[:4] = q
    free = 4 + np.flatnonzero(np.concatenate([[1, 1], OFFSET_STD_RAD[: x.size - 6] > 0]))
    x[6:] = 0.0
    rows = scene.slopes(problem, x)[:, 4:]
    for _ in range(2):  # linear but for the wrap of angles
        x[free] -= np.linalg.lstsq(rows, scene.whitened(problem, x), rcond=None)[0]
    return x


@pytest.mark.parametrize("kind", KINDS)
def test_misfit_gradient_and_information_are_those_of_the_residuals_written_out(kind):
    scene, problem = made(kind)
    q = STATE + np.array([0.02, 0.01, 0.1, -0.1])
    x = beside(scene, problem, q)
    z, rows = scene.whitened(problem, x), scene.slopes(problem, x)
    found = misfit(problem, q[None])
    assert found.value[0] == pytest.approx(z @ z, rel=1e-6)
    np.testing.assert_allclose(found.rest_hz[0], x[4:6], rtol=1e-9)
    np.testing.assert_allclose(found.gradient[0], rows[:, :4].T @ z, rtol=2e-4)
    square = rows.T @ rows
    schur = square[:4, :4] - square[:4, 4:] @ np.linalg.solve(square[4:, 4:], square[4:, :4])
    np.testing.assert_allclose(found.matrix[0], schur, rtol=1e-3, atol=1e-3)
    r = residuals(problem, q[None])
    np.testing.assert_allclose(r.offset_rad[0], x[6:] if x.size > 6 else 0.0, atol=1e-9)
    covariance = np.linalg.inv(square)[:6, :6]
    ours = information(problem, q)
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        ours.covariance(people=False) / np.outer(scale, scale),
        covariance / np.outer(scale, scale), atol=1e-4,
    )  # fmt: skip
    state = np.array([np.exp(q[0]) * np.sin(q[1]), np.exp(q[0]) * np.cos(q[1]), *q[2:]])
    value = misfit_value(problem, state[None], x[None, 4:6], np.zeros(1, int))
    assert value[0] == pytest.approx(z @ z, rel=1e-6)


@pytest.mark.parametrize("loss", ["huber", "student"])
@pytest.mark.parametrize("kind", KINDS[::2])
def test_robust_rest_frequencies_and_offsets_are_those_that_scipy_finds(kind, loss):
    """Three reweightings from the median come within a tenth of a deviation."""
    scene, problem = made(kind, loss)
    x = scene.truth(offsets=kind[-1])
    free = np.concatenate([[True] * 2, OFFSET_STD_RAD[: x.size - 6] > 0])
    x[6:][~free[2:]] = 0.0
    rows = scene.slopes(problem, x)[:, 4:]
    z0 = scene.whitened(problem, x)
    scale = {"huber": 1.345, "student": 2.0}[loss]
    usual = {"huber": _huber, "student": _cauchy}[loss]

    def rho(square):  # priors stay squares
        return np.where(np.arange(square.size) < 3 * ROWS, usual(square), _plain(square))

    peer = least_squares(
        lambda by: z0 + rows @ by, np.zeros(rows.shape[1]), lambda _: rows, loss=rho, f_scale=scale
    )
    found = misfit(problem, STATE[None])
    assert found.value[0] == pytest.approx(2 * peer.cost, rel=2e-3)
    away = (found.rest_hz[0] - x[4:6] - peer.x[:2]) / FREQUENCY_STD_HZ * np.sqrt(ROWS)
    assert np.abs(away).max() < 0.1


def _huber(square):
    root = np.sqrt(np.maximum(square, 1.0))
    inside = square <= 1.0
    return np.stack(
        [np.where(inside, square, 2 * root - 1), 1 / root, np.where(inside, 0.0, -0.5 / root**3)]
    )


def _cauchy(square):
    return np.stack([np.log1p(square), 1 / (1 + square), -1 / (1 + square) ** 2])


def _plain(square):
    return np.stack([square, np.ones_like(square), np.zeros_like(square)])


def test_motion_and_rest_frequencies_do_not_depend_on_the_unit_of_deviations():
    """A misfit goes with the square of the unit, and nothing else changes."""
    _, problem = made(KINDS[0])
    wide = replace(
        problem, bearing_weight=1e-4 * problem.bearing_weight,
        frequency_weight=1e-4 * problem.frequency_weight,
    )  # fmt: skip
    plain, other = misfit(problem, STATE[None]), misfit(wide, STATE[None])
    np.testing.assert_allclose(other.rest_hz, plain.rest_hz, rtol=1e-9)
    for name in ("value", "gradient", "matrix"):
        scaled = 1e-8 * getattr(plain, name)
        np.testing.assert_allclose(getattr(other, name), scaled, rtol=1e-7)
    covariance = information(wide, STATE).covariance()
    np.testing.assert_allclose(
        covariance, 1e8 * information(problem, STATE).covariance(), rtol=1e-6
    )
    # far below its bend a robust loss is one of squares, its rest frequencies too
    faint = misfit(replace(wide, loss="student"), STATE[None])
    np.testing.assert_allclose(faint.value, other.value, rtol=1e-4)
    np.testing.assert_allclose(faint.rest_hz, plain.rest_hz, rtol=1e-6)


def covariance_of(rows, moves):
    """Schmidt's form: what errors of known covariance, moves by them, do to a fit."""
    shift = np.linalg.solve(rows.T @ rows, rows.T @ np.stack(moves, 1))
    return shift[:6]


def change_of(scene, problem, x, name, index, step):
    """Return the change of the residuals by a change of a fact, per unit."""
    ends = []
    for sign in (1.0, -1.0):
        other = Scene(
            int(scene.sensor.max()) + 1, scene.doppler,
            delayed=scene.delayed, height_m=scene.height_m,
        )  # fmt: skip
        if name == "sound_mps":
            other.sound_mps += sign * step
        else:
            getattr(other, name)[index] += sign * step
        ends.append(other.whitened(problem, x))
    return (ends[0] - ends[1]) / (2 * step)


def same(ours, theirs):
    scale = np.sqrt(np.diag(theirs))
    np.testing.assert_allclose(
        ours / np.outer(scale, scale), theirs / np.outer(scale, scale), atol=2e-3
    )


@pytest.mark.parametrize("doppler", ["interval", "instantaneous"])
def test_a_budget_is_what_misplaced_sensors_and_sound_do_to_a_fit(doppler):
    scene = Scene(3, doppler)
    problem = scene.problem(offsets=True)
    x = beside(scene, problem, STATE)
    rows = scene.slopes(problem, x)
    std_m = np.array([3.0, 0.0, 11.0])
    told = NuisanceDeviations(0.5, 0.0, sensor_position_m=std_m)
    budget = error_budget(
        problem, STATE, information(problem, STATE), told, with_coloured_noise=False
    )
    moves = [
        std_m[k] * change_of(scene, problem, x, "moved", (k, axis), 1.0)
        for k in range(3) for axis in (0, 1)
    ]  # fmt: skip
    shift = covariance_of(rows, moves)
    same(budget.parts["sensor_position_m"], shift @ shift.T)
    sound = 0.5 * change_of(scene, problem, x, "sound_mps", None, 1.0)
    shift = covariance_of(rows, [sound])
    same(budget.parts["sound_speed_mps"], shift @ shift.T)
    white = np.linalg.inv(rows.T @ rows)[:6, :6]
    same(budget.covariance, white + sum(budget.parts.values()))


@pytest.mark.parametrize("doppler", ["interval", "instantaneous"])
def test_a_budget_is_what_own_navigation_and_the_compass_do_to_a_fit(doppler):
    scene = Scene(1, doppler)
    problem = scene.problem(offsets=False)
    x = beside(scene, problem, STATE)
    rows = scene.slopes(problem, x)
    tau, told = 90.0, NuisanceDeviations(0.0, 1.5, 6.0, 0.4, 90.0)
    budget = error_budget(
        problem, STATE, information(problem, STATE), told, with_coloured_noise=False
    )
    turned = np.zeros(len(rows))
    turned[:ROWS] = np.radians(1.5) / BEARING_STD_RAD
    shift = covariance_of(rows, [turned])
    same(budget.parts["compass_deg"], shift @ shift.T)
    time, h = scene.time_s - scene.time_s[0], INTERVAL_S
    sight, z0 = np.zeros((2, ROWS)), scene.whitened(problem, x)
    way = np.exp(x[0]) * np.array([np.sin(x[1]), np.cos(x[1])])
    sight = way + time[:, None] * x[2:4] - scene.own()
    sight /= np.hypot(*sight.T)[:, None]
    totals = np.zeros((2, 6, 6))
    for axis in (0, 1):
        # a rate moves by own velocity along the sight; a place moves both
        moves, at = [], []
        for row in range(ROWS):
            rate = np.zeros(len(z0))
            rate[[ROWS + row, 2 * ROWS + row]] = (
                x[4:6] / SOUND_MPS * sight[row, axis] * problem.frequency_weight[:, row]
            )
            bearing = change_of(scene, problem, x, "row_moved", (0, row, axis), 1.0)
            bearing[ROWS:] = 0.0
            ends = (h, 0.0) if doppler == "interval" else (0.5 * h, 0.5 * h)
            moves += [rate, bearing, rate / h, -rate / h]
            at += [time[row], time[row], time[row] + ends[1], time[row] - ends[0]]
        moves, at = np.stack(moves), np.array(at)
        kernel = np.exp(-np.abs(at[:, None] - at) / tau)
        shift = covariance_of(rows, moves)
        own_velocity = np.arange(at.size) % 4 == 0
        for k, (kept, std) in enumerate(((own_velocity, 0.4), (~own_velocity, 6.0))):
            part = shift[:, kept]
            totals[k] += std**2 * part @ kernel[np.ix_(kept, kept)] @ part.T
    same(budget.parts["own_velocity_mps"], totals[0])
    same(budget.parts["own_position_m"], totals[1])


@pytest.mark.parametrize("kind", KINDS)
def test_the_last_position_and_its_deviation_are_those_of_the_motion_then(kind):
    scene, problem = made(kind)
    covariance = information(problem, STATE).covariance(people=False)
    time = scene.time_s[-1] - scene.time_s[0]
    now, std = seen_at(problem, STATE, covariance[:4, :4], time)
    first = np.flatnonzero(scene.sensor == scene.sensor[0])[-1]

    def polar(q):
        way = np.exp(q[0]) * np.array([np.sin(q[1]), np.cos(q[1])]) + time * q[2:]
        way = way - scene.own()[first]
        place = np.hypot(*way), np.arctan2(*way) % (2 * np.pi)
        return np.array([*place, np.hypot(*q[2:]), np.arctan2(*q[2:]) % (2 * np.pi)])

    np.testing.assert_allclose(now, polar(STATE), rtol=1e-9)
    steps = 1e-5 * np.eye(4)
    slope = np.stack([(polar(STATE + s) - polar(STATE - s)) / 2e-5 for s in steps], 1)
    deviation = np.sqrt(np.diag(slope @ covariance[:4, :4] @ slope.T))
    np.testing.assert_allclose(std, deviation, rtol=1e-6)


def bent_scene(*, noise):
    """Return a scene whose target changes its velocity, the change, and its problem."""
    scene = Scene(1, "instantaneous")
    change = np.array([1.5, 1.0, 140.0])
    scene.change = change
    return scene, change, scene.problem(offsets=False, noise=noise)


def test_the_gain_of_a_change_is_that_of_least_squares_with_it():
    """Sound speed and compass are unknowns with priors; 140 s is between two rows."""
    _, _, problem = bent_scene(noise=1.0)
    straight = Scene(1, "instantaneous")
    x = beside(straight, problem, STATE)
    told = NuisanceDeviations(20.0, 3.0)
    inflation = np.array([1.7, 2.5, 1.0])
    empty = np.empty(0)
    colours = tuple(ColouredNoise(empty, empty, float(each)) for each in inflation)
    found = seek_alteration(problem, STATE, told, colours)
    wide = np.sqrt(np.repeat(inflation, [ROWS, 2 * ROWS, 0]))
    z = straight.whitened(problem, x)[: 3 * ROWS]
    compass = np.where(np.arange(z.size) < ROWS, np.radians(3.0) / BEARING_STD_RAD, 0.0)
    sound = 20.0 * change_of(straight, problem, x, "sound_mps", None, 1.0)
    own = np.column_stack([straight.slopes(problem, x), sound, compass])
    free = own.shape[1] - 2

    def least(columns):
        # sound speed and compass have unit priors, each part of a change one of 4 m/s
        known = np.zeros((columns.shape[1] - free, columns.shape[1]))
        known[:, free:] = np.diag([1.0, 1.0, 0.25, 0.25][: len(known)])
        part = np.concatenate([columns / wide[:, None], known])
        both = np.append(z / wide, np.zeros(len(known)))
        return both - part @ np.linalg.lstsq(part, both, rcond=None)[0]

    gains = []
    apart = ~np.isin(found.instant_s, problem.row_time_s)
    for at in found.instant_s[apart][::6]:
        moves = []
        for axis in (0, 1):
            ends = []
            for sign in (1.0, -1.0):
                other = Scene(1, "instantaneous")
                other.change = np.array([0.0, 0.0, at])
                other.change[axis] = 1e-3 * sign
                ends.append(other.whitened(problem, x))
            moves.append((ends[0] - ends[1]) / 2e-3)
        rest = least(own), least(np.column_stack([own, *moves]))
        gains.append(rest[0] @ rest[0] - rest[1] @ rest[1])
    np.testing.assert_allclose(found.gain[apart][::6], gains, rtol=1e-3)
