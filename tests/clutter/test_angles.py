"""Bearings, and ranges with bearings: laws of the circle, and truth at stated rates."""

import math
from dataclasses import replace

import numpy as np
import pytest

from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.clutter.scan_table import scan_table
from uwtrack_cli.data.scans import Scans

RANGE_STD_M, BEARING_STD_DEG, CELL = 10.0, 1.0, 30.0 * 2.0
FALSE_ALARM, ACCELERATION = 0.02, 0.05
DETECTOR = Detector(
    snr_db=15.0, false_alarm_probability=FALSE_ALARM, cell_volume=CELL,
    false_alarm_range=(1e-4, FALSE_ALARM),
)  # fmt: skip
DETECTION = FALSE_ALARM ** (1.0 / (1.0 + 10.0**1.5))


def table_of(lists, units, std):
    """Return scans of measurements (with amplitudes last), 5 s apart."""
    lists = [np.reshape(each, (-1, 3)) for each in lists]
    empty = np.full((1, 3), np.nan)
    rows = np.concatenate([each if len(each) else empty for each in lists])
    number = np.repeat(np.arange(1, len(lists) + 1), [max(len(e), 1) for e in lists])
    return Scans(
        scan=number, time_s=5.0 * number, measured=rows[:, :2],
        measured_std=np.tile(std, (number.size, 1)), amplitude=rows[:, 2],
        component=["z_1", "z_2"], component_unit=units,
    )  # fmt: skip


def polar_run(seed, scans=40, turn_deg=0.0):
    """Return range-bearing scans of a target in clutter, its true states and a start."""
    rng = np.random.default_rng(seed)
    state = np.array([1500.0, -3.0, -2500.0, 5.0])
    lists, truth = [], []
    lowest = math.sqrt(-2.0 * math.log(FALSE_ALARM))
    for _ in range(scans):
        push = ACCELERATION * rng.standard_normal(2)
        state[::2] += 5.0 * state[1::2] + 12.5 * push
        state[1::2] += 5.0 * push
        truth.append(state.copy())
        distance = math.hypot(state[0], state[2])
        bearing = math.degrees(math.atan2(state[0], state[2]))
        count = rng.poisson(FALSE_ALARM * 800.0 * 40.0 / CELL)
        false = np.stack([
            distance + rng.uniform(-400.0, 400.0, count),
            bearing + rng.uniform(-20.0, 20.0, count),
            np.sqrt(lowest**2 + 2.0 * rng.standard_exponential(count)),
        ], axis=1)  # fmt: skip
        own = [
            distance + RANGE_STD_M * rng.standard_normal(),
            bearing + BEARING_STD_DEG * rng.standard_normal(),
            math.sqrt(2.0 * (1.0 + 10.0**1.5) * rng.standard_exponential()),
        ]
        lists.append(np.vstack([own, false]) if own[2] > lowest else false)
    for each in lists:
        each[:, 1] = (each[:, 1] + turn_deg) % 360.0
    scans = table_of(lists, ["m", "deg"], [RANGE_STD_M, BEARING_STD_DEG])
    angle = math.radians(turn_deg)
    turned = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    truth = np.array(truth)
    truth[:, ::2], truth[:, 1::2] = truth[:, ::2] @ turned.T, truth[:, 1::2] @ turned.T
    start = turned @ np.array([[1500.0, -3.0], [-2500.0, 5.0]])
    begin = TargetStart(
        position=list(start[:, 0]), velocity=list(start[:, 1]), position_std=50.0,
        velocity_std=2.0, time_s=0.0,
    )  # fmt: skip
    return scans, truth, begin


def follow(scans, begin, **options):
    """Follow the target of a run."""
    return track_in_clutter(
        scans, detector=DETECTOR, motion=TargetMotion(acceleration_std=ACCELERATION),
        start=begin, **options,
    )  # fmt: skip


def test_ranges_and_bearings_give_a_track_with_true_deviations():
    squares, lost, expected, found = [], 0, [], []
    for seed in range(60):
        scans, truth, begin = polar_run(seed)
        target = follow(scans, begin, threshold="fixed")
        error = target.state - truth
        far = np.hypot(error[:, 0], error[:, 2]).max() > 400.0
        lost += far
        if far:
            continue
        squares += [
            e @ np.linalg.solve(p, e)
            for e, p in zip(error[10:], target.state_covariance[10:], strict=True)
        ]
        expected.append(target.expected_clutter.mean())
        found.append(target.validated.mean())
    assert lost <= 6
    # four states; the tails of tracks nearly lost make the mean a little larger
    assert 3.3 < np.mean(squares) < 5.2
    assert 0.90 < np.mean(np.array(squares) < 9.488) < 0.985
    # all that was validated is the target's or false
    assert np.mean(found) == pytest.approx(np.mean(expected) + DETECTION, rel=0.08)


@pytest.mark.parametrize("threshold", ["fixed", "prior", "posterior", "region"])
def test_turning_the_compass_turns_the_track_and_nothing_else(threshold):
    scans, _, begin = polar_run(3)
    turned, _, other = polar_run(3, turn_deg=130.0)
    one = follow(scans, begin, threshold=threshold)
    two = follow(turned, other, threshold=threshold)
    angle = math.radians(130.0)
    east = one.state[:, 0] * math.cos(angle) + one.state[:, 2] * math.sin(angle)
    north = -one.state[:, 0] * math.sin(angle) + one.state[:, 2] * math.cos(angle)
    np.testing.assert_allclose(two.state[:, 0], east, atol=1e-6)
    np.testing.assert_allclose(two.state[:, 2], north, atol=1e-6)
    np.testing.assert_allclose(two.score, one.score, atol=1e-8)
    assert two.component.tolist() == ["east", "north"]
    assert two.component_unit.tolist() == ["m", "m"]


def test_order_of_range_and_bearing_does_not_matter():
    scans, _, begin = polar_run(4)
    swapped = replace(
        scans, measured=scans.measured[:, ::-1],
        measured_std=scans.measured_std[:, ::-1], component_unit=["deg", "m"],
    )  # fmt: skip
    np.testing.assert_array_equal(follow(swapped, begin).state, follow(scans, begin).state)


def test_the_track_begins_at_the_strongest_range_and_bearing():
    scans = table_of([[[1000.0, 90.0, 9.0]], [[1000.0, 90.0, 9.0]]], ["m", "deg"], [10.0, 1.0])
    target = follow(scans, TargetStart(velocity_std=1.0))
    assert target.scan.tolist() == [2]
    np.testing.assert_allclose(target.state[0, ::2], [1000.0, 0.0], atol=0.2)
    across = math.radians(1.0) * 1000.0
    assert target.state_std[0, 0] == pytest.approx(10.0 / math.sqrt(2.0), rel=0.1)
    assert target.state_std[0, 2] == pytest.approx(across / math.sqrt(2.0), rel=0.1)


def test_converted_measurements_have_neither_bias_nor_wrong_covariance():
    rng = np.random.default_rng(5)
    n, true = 200_000, np.array([2000.0 * math.sin(0.6), 2000.0 * math.cos(0.6)])
    rows = np.stack([
        2000.0 + 20.0 * rng.standard_normal(n),
        math.degrees(0.6) + 6.0 * rng.standard_normal(n), np.full(n, 9.0),
    ], axis=1)  # fmt: skip
    scans = table_of([rows], ["m", "deg"], [20.0, 6.0])
    table = scan_table(scans, scans.measured_std, "places")
    error = table.measured - true
    scatter = np.cov(error.T)
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=4.0 * 210.0 / math.sqrt(n))
    np.testing.assert_allclose(
        table.covariance.mean(axis=0), scatter, atol=0.03 * np.trace(scatter)
    )


def bearing_scans(offset_deg, sign=1.0):
    """Return bearings that pass 20 degrees in clutter, with frequencies."""
    rng = np.random.default_rng(8)
    lists = []
    for k in range(30):
        own = [[350.0 + k + 0.3 * rng.standard_normal(), 100.0, 9.0]]
        false = np.stack(
            [350.0 + k + rng.uniform(-30.0, 30.0, 3), rng.uniform(95.0, 105.0, 3), np.full(3, 4.0)],
            axis=1,
        )
        scan = np.vstack([own, false])
        scan[:, 0] = sign * (scan[:, 0] + offset_deg)
        lists.append(scan)
    return table_of(lists, ["deg", "Hz"], [0.3, 0.5])


@pytest.mark.parametrize("threshold", ["fixed", "prior", "posterior", "region"])
def test_a_bearing_passes_north_as_any_other_direction(threshold):
    begin = TargetStart(
        position=[350.0, 100.0], velocity=[0.2, 0.0], position_std=1.0, velocity_std=0.2, time_s=5.0
    )
    detector = replace(DETECTOR, cell_volume=1.0)
    options = {
        "threshold": threshold, "detector": detector,
        "motion": TargetMotion(acceleration_std=0.01, manoeuvre_std=0.1),
    }  # fmt: skip
    over = bearing_scans(0.0)
    wrapped = replace(over, measured=over.measured % [360.0, 1e9])
    north = track_in_clutter(wrapped, start=begin, **options)
    away = track_in_clutter(
        bearing_scans(-200.0), start=replace(begin, position=[150.0, 100.0]), **options
    )
    assert np.all((north.state[:, 0] >= 0.0) & (north.state[:, 0] < 360.0))
    np.testing.assert_allclose((north.state[:, 0] - away.state[:, 0]) % 360.0, 200.0, atol=1e-6)
    np.testing.assert_allclose(north.state[:, 1:], away.state[:, 1:], atol=1e-6)
    assert north.state[-1, 0] == pytest.approx(19.0, abs=1.0)
    assert not north.lost.any()
