"""Ranges and bearings from own ship under way: laws of the frame, and truth."""

import math

import numpy as np
import pytest

from tests.draws.crossing_targets import table_of
from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import DataError, OptionError

RANGE_STD_M, BEARING_STD_DEG, FALSE_ALARM, CELL = 10.0, 0.5, 0.002, 60.0
DETECTOR = Detector(
    detection_probability=0.9, false_alarm_probability=FALSE_ALARM, cell_volume=CELL
)
OPTIONS = {
    "threshold": "fixed", "detector": DETECTOR,
    "motion": TargetMotion(acceleration_std=0.02),
}  # fmt: skip


def ship_of(time_s, place, start_utc_ns=None):
    """Return own ship's navigation."""
    return Navigation(
        time_s=time_s, east_m=place[:, 0], north_m=place[:, 1],
        heading_deg=np.full(time_s.size, np.nan), start_utc_ns=start_utc_ns,
    )  # fmt: skip


def passing(seed, n_targets=1, scans=50):
    """Return scans from a ship that turns, her navigation and the targets' ways."""
    draw = np.random.default_rng(seed)
    time_s = 5.0 * np.arange(scans)
    course = np.where(time_s < 120.0, 0.3, 1.6)
    step = 40.0 * np.stack([np.sin(course), np.cos(course)], axis=1)
    own = np.cumsum(step, axis=0) + np.array([300.0, -200.0])
    first = np.array([[2500.0, 1500.0], [-1500.0, 2500.0]])[:n_targets]
    rate = np.array([[-6.0, 3.0], [5.0, 4.0]])[:n_targets]
    ways = first[:, None] + rate[:, None] * time_s[:, None]
    number, rows = [], []
    for k in range(scans):
        away = ways[:, k] - own[k]
        away = away[draw.random(n_targets) < 0.9]
        true = np.stack([
            np.hypot(*away.T), np.degrees(np.arctan2(away[:, 0], away[:, 1]))
        ], axis=1)  # fmt: skip
        true += draw.standard_normal(true.shape) * [RANGE_STD_M, BEARING_STD_DEG]
        false = draw.poisson(FALSE_ALARM / CELL * 5000.0 * 360.0)
        clutter = draw.random((false, 2)) * [5000.0, 360.0]
        number += [k] * (len(true) + false)
        rows += [*true, *clutter]
    rows = np.array(rows)
    rows[:, 1] %= 360.0
    scans = Scans(
        scan=np.array(number) + 1, time_s=5.0 * np.array(number, float), measured=rows,
        measured_std=np.tile([RANGE_STD_M, BEARING_STD_DEG], (len(rows), 1)),
        amplitude=np.full(len(rows), np.nan), component=np.array(["range", "bearing"]),
        component_unit=np.array(["m", "deg"]),
    )  # fmt: skip
    return scans, ship_of(time_s, own), ways, rate


def test_a_ship_that_lies_elsewhere_shifts_the_track_and_nothing_else():
    scans, _, ways, rate = passing(1)
    begin = ways[0, 0] - [300.0, -200.0]

    def follow(place, navigation=None):
        return track_in_clutter(
            scans, navigation=navigation, **OPTIONS,
            start=TargetStart(place.tolist(), rate[0].tolist(), 50.0, 2.0),
        )  # fmt: skip

    there = np.array([4e3, -7e3])
    lying = ship_of(np.array([0.0, 300.0]), np.tile(there, (2, 1)))
    here, shifted = follow(begin), follow(begin + there, lying)
    np.testing.assert_allclose(
        shifted.state, here.state + np.array([there[0], 0.0, there[1], 0.0]), atol=1e-6
    )
    np.testing.assert_allclose(shifted.score, here.score, atol=1e-8)
    np.testing.assert_allclose(shifted.expected_clutter, here.expected_clutter)


def test_a_target_is_followed_past_a_ship_that_turns():
    squares, lost = [], 0
    for seed in range(40):
        scans, ship, ways, rate = passing(seed)
        track = track_in_clutter(
            scans, navigation=ship, **OPTIONS,
            start=TargetStart(ways[0, 0].tolist(), rate[0].tolist(), 50.0, 2.0),
        )  # fmt: skip
        error = track.state[:, ::2] - ways[0][track.scan - 1]
        if np.hypot(*error[-1]) > 300.0:
            lost += 1
            continue
        place = track.state_covariance[:, ::2, ::2]
        squares += [
            e @ np.linalg.solve(p, e)
            for e, p in zip(error[10:], place[10:], strict=True)
        ]
    assert lost <= 2
    # she moves straight, so that the deviations, which allow for more, are not exceeded
    assert 0.5 < np.mean(squares) < 2.4


def test_two_targets_are_found_from_a_ship_that_turns():
    counts = []
    for seed in range(6):
        scans, ship, ways, _ = passing(seed, n_targets=2)
        target = track_in_clutter(
            scans, navigation=ship, targets="auto", **OPTIONS,
            start=TargetStart(velocity_std=10.0),
        )  # fmt: skip
        ends = target.state[target.scan == 50][:, ::2]
        away = np.hypot(*(ends[:, None] - ways[None, :, -1]).transpose(2, 0, 1))
        counts.append(int((away.min(axis=0) < 150.0).sum()) - max(len(ends) - 2, 0))
    assert np.mean(counts) >= 1.9


def test_navigation_of_anything_but_ranges_and_bearings_is_refused():
    scans = table_of(np.arange(3), np.ones((3, 2)), 1.0)
    ship = ship_of(np.array([0.0, 9.0]), np.zeros((2, 2)))
    start = TargetStart([1.0, 1.0], None, 1.0, 1.0)
    with pytest.raises(OptionError, match="leave --own-ship out"):
        track_in_clutter(scans, navigation=ship, start=start, **OPTIONS)


@pytest.mark.parametrize(
    ("times", "start_utc_ns", "message"),
    [
        ([0.0, 100.0], None, "it must cover them"),
        ([0.0], None, "two rows or more"),
        ([0.0, 0.0], None, "rising times"),
        ([0.0, 300.0], 10, "both in time_utc"),
    ],
)
def test_navigation_that_does_not_fit_is_refused(times, start_utc_ns, message):
    scans, *_ = passing(1)
    ship = ship_of(np.array(times), np.zeros((len(times), 2)), start_utc_ns)
    with pytest.raises(DataError, match=message):
        track_in_clutter(
            scans, navigation=ship, start=TargetStart(velocity_std=1.0), **OPTIONS
        )


def test_the_command_takes_own_ship(uwtrack, tmp_path):
    scans, ship, ways, rate = passing(2)
    rows = np.column_stack([scans.scan, scans.time_s, scans.measured])
    np.savetxt(
        tmp_path / "scans.csv", rows, "%.6f", ",", comments="",
        header="scan,time_s,z_1 [m],z_2 [deg]",
    )  # fmt: skip
    np.savetxt(
        tmp_path / "ship.csv", np.column_stack([ship.time_s, ship.east_m, ship.north_m]),
        "%.6f", ",", comments="", header="time_s,east_m,north_m",
    )  # fmt: skip
    done = uwtrack(
        "pdaf", tmp_path / "scans.csv", "--own-ship", tmp_path / "ship.csv",
        "--threshold", "fixed", "--measured-std", RANGE_STD_M, BEARING_STD_DEG,
        "--detector-detection-probability", 0.9, "--detector-cell-volume", CELL,
        "--motion-acceleration-std", 0.02, "--start-position", *ways[0, 0],
        "--start-velocity", *rate[0], "--start-position-std", 50,
        "--start-velocity-std", 2, "-o", tmp_path / "t.h5",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    end = float(done.stderr.split("east = ")[1].split(" ")[0])
    assert math.isclose(end, ways[0, -1, 0], abs_tol=60.0)
