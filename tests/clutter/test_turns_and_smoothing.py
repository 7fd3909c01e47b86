"""Turn models and smoothing: the batch solution, laws, and drawn turns."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.crossing_targets import DETECTOR, STD_M, table_of
from tests.draws.targets_under_way import turning
from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.errors import OptionError

QUIET = TargetMotion(acceleration_std=0.3)
TURNS = replace(QUIET, turn_rate_degps=3.0)


def follow(scans, way, motion=TURNS, **options):
    """Follow one target from where it is."""
    start = TargetStart(way[0].tolist(), (way[1] - way[0]).tolist(), STD_M, 2.0)
    return track_in_clutter(
        scans, threshold="fixed", motion=motion, start=start, **({"detector": DETECTOR} | options)
    )


def test_a_target_that_turns_is_followed_closer_with_a_turn_model():
    squares = {}
    manoeuvres = replace(QUIET, manoeuvre_std=3.0)
    for name, motion in (("turns", TURNS), ("manoeuvres", manoeuvres)):
        squares[name] = []
        for seed in range(25):
            scans, way = turning(seed)
            track = follow(scans, way, motion)
            off = track.state[:, ::2] - way[track.scan - 1]
            assert np.hypot(*off[-1]) < 50.0
            squares[name].append((off[20:] ** 2).sum(axis=1).mean())
    assert np.mean(squares["turns"]) < 0.75 * np.mean(squares["manoeuvres"])


def test_the_turn_model_says_when_and_where_to_it_turned():
    scans, way = turning(3, density=1e-7)
    step = np.diff(way, axis=0)
    # from the first axis to the second
    left = np.sign(step[30, 0] * step[31, 1] - step[30, 1] * step[31, 0])
    said = []
    for lag in (0, 1000):
        probability = follow(scans, way, smoothing_scans=lag).model_probability
        assert probability.shape[1] == 3
        np.testing.assert_allclose(probability.sum(axis=1), 1.0)
        assert probability[10, 0] > 0.6
        said.append(left * (probability[25:55, 1] - probability[25:55, 2]).mean())
    assert said[0] > 0.35
    assert said[1] > 0.9


def test_turns_outside_a_plane_are_refused():
    scans = table_of(np.arange(3), np.ones((3, 2)), 1.0)
    strange = replace(scans, component_unit=np.array(["m", "Hz"]))
    with pytest.raises(OptionError, match="one unit; these have 'm', 'Hz'"):
        follow(strange, np.ones((2, 2)))


def _clear(seed, scans=15):
    """Return scans of a target alone, always detected, and what is known before."""
    draw = np.random.default_rng(seed)
    rate = 20.0 + np.cumsum(0.3 * draw.standard_normal((scans, 2)), axis=0)
    way = np.cumsum(rate, axis=0)
    return table_of(np.arange(scans), way + STD_M * draw.standard_normal(way.shape), 1.0), way


def _batch(measured, start, last):
    """Return all states of one axis by the normal equations of motion and measurements."""
    count = last + 1
    information, push = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
    # the start is told at the first scan
    information[:2, :2] += np.diag([1.0 / STD_M**2, 1.0 / 4.0])
    push[:2] += [start[0] / STD_M**2, start[1] / 4.0]
    for k in range(count):
        information[2 * k, 2 * k] += 1.0 / STD_M**2
        push[2 * k] += measured[k] / STD_M**2
        if k:
            # a constant acceleration over the step, and a little for the rank
            noise = 0.09 * np.array([[0.25, 0.5], [0.5, 1.0]]) + 1e-9 * np.eye(2)
            slope = np.hstack([-np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2)])
            part = slice(2 * k - 2, 2 * k + 2)
            information[part, part] += slope.T @ np.linalg.solve(noise, slope)
    covariance = np.linalg.inv(information)
    return (covariance @ push).reshape(-1, 2), covariance


@pytest.mark.parametrize("lag", [1, 4, 99])
def test_without_clutter_it_is_the_least_squares_solution_of_all_scans_it_may_use(lag):
    scans, way = _clear(1)
    sure = Detector(detection_probability=1.0, cell_volume=900.0, false_alarm_probability=1e-12)
    found = follow(scans, way, QUIET, detector=sure, gate=10.0, smoothing_scans=lag)
    assert found.smoothing_scans == lag
    for scan in range(15):
        last = min(scan + lag, 14)
        for axis in (0, 1):
            start = [way[0, axis], way[1, axis] - way[0, axis]]
            state, covariance = _batch(scans.measured[:, axis], start, last)
            own = slice(2 * axis, 2 * axis + 2)
            np.testing.assert_allclose(found.state[scan, own], state[scan], atol=2e-3)
            part = slice(2 * scan, 2 * scan + 2)
            np.testing.assert_allclose(
                found.state_covariance[scan, own, own], covariance[part, part], rtol=2e-3
            )


def test_models_that_are_alike_are_smoothed_as_one():
    scans, way = _clear(2)
    one = follow(scans, way, QUIET, smoothing_scans=5)
    alike = replace(QUIET, manoeuvre_std=0.3 * (1.0 + 1e-9))
    two = follow(scans, way, alike, smoothing_scans=5)
    np.testing.assert_allclose(two.state, one.state, atol=1e-4)
    np.testing.assert_allclose(two.state_covariance, one.state_covariance, rtol=1e-4)


def test_the_longer_the_lag_the_smaller_the_error_and_the_deviation_says_so():
    squares, sizes, scores = {}, {}, {}
    for lag in (0, 3, 1000):
        squares[lag], sizes[lag], scores[lag] = [], [], []
        for seed in range(15):
            scans, way = turning(seed)
            track = follow(scans, way, smoothing_scans=lag)
            off = track.state[5:-5, ::2] - way[track.scan[5:-5] - 1]
            place = track.state_covariance[5:-5, ::2, ::2]
            solved = np.linalg.solve(place, off[..., None])[..., 0]
            squares[lag].append((off**2).sum(axis=1).mean())
            sizes[lag].append((off * solved).sum(axis=1).mean())
            scores[lag].append(track.score[-1])
    assert np.mean(squares[3]) < 0.5 * np.mean(squares[0])
    assert np.mean(squares[1000]) < 0.85 * np.mean(squares[3])
    # two components; straight and turning ways have less than the accelerations assumed
    for lag in squares:
        assert 0.8 < np.mean(sizes[lag]) < 2.4
    np.testing.assert_allclose(scores[1000], scores[0])
