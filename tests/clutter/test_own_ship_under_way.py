"""Ranges and bearings from own ship under way: laws of the frame, and truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.draws.crossing_targets import table_of
from tests.draws.targets_under_way import (
    BEARING_STD_DEG,
    DETECTION,
    FALSE,
    RANGE_STD_M,
    detector_of,
    passing,
    ship_of,
)
from uwtrack_cli.clutter.options import TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.errors import DataError, OptionError

OPTIONS = {
    "threshold": "fixed", "detector": detector_of("places"),
    "motion": TargetMotion(acceleration_std=0.02),
}  # fmt: skip


def error(track, ways, rate, scan=-1):
    """Return error of place and velocity after a scan, and its square by the covariance."""
    way = ways[0][track.scan[scan] - 1]
    off = track.state[scan] - np.stack([way, rate[0]], axis=1).ravel()
    return off, off @ np.linalg.solve(track.state_covariance[scan], off)


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
        squares += [e @ np.linalg.solve(p, e) for e, p in zip(error[10:], place[10:], strict=True)]
    assert lost <= 2
    # she moves straight, so that the deviations, which allow for more, are not exceeded
    assert 0.5 < np.mean(squares) < 2.4


def test_two_targets_are_found_from_a_ship_that_turns():
    counts = []
    for seed in range(6):
        scans, ship, ways, _ = passing(seed, n_targets=2)
        target = track_in_clutter(
            scans, navigation=ship, targets="auto", **OPTIONS, start=TargetStart(velocity_std=10.0)
        )
        ends = target.state[target.scan == 50][:, ::2]
        away = np.hypot(*(ends[:, None] - ways[None, :, -1]).transpose(2, 0, 1))
        counts.append(int((away.min(axis=0) < 150.0).sum()) - max(len(ends) - 2, 0))
    assert np.mean(counts) >= 1.9


def test_a_range_rate_makes_the_velocity_better_and_says_so():
    squares = {"places": [], "rates": []}
    speeds = {"places": [], "rates": []}
    for seed in range(20):
        for kind, found in squares.items():
            scans, ship, ways, rate = passing(seed, scans=5, kind=kind)
            track = track_in_clutter(
                scans, navigation=ship,
                start=TargetStart(ways[0, 0].tolist(), None, 50.0, 6.0),
                **(OPTIONS | {"detector": detector_of(kind)}),
            )  # fmt: skip
            off, square = error(track, ways, rate)
            found.append(square)
            away = ways[0, 4] - [ship.east_m[4], ship.north_m[4]]
            speeds[kind].append((off[1::2] @ away / np.hypot(*away)) ** 2)
    assert 2.0 < np.mean(squares["rates"]) < 6.0
    assert np.mean(speeds["rates"]) < 0.5 * np.mean(speeds["places"])


def test_a_track_begins_with_the_range_rate_of_its_first_measurement():
    scans, ship, ways, _ = passing(3, scans=2, kind="rates")
    near = np.hypot(*(scans.measured[:, :2] - _true(ways, ship)[scans.scan - 1]).T)
    one = np.flatnonzero((scans.scan == 1) & (near < 60.0))[:1]
    rows = np.concatenate([one, np.flatnonzero(scans.scan == 2)])
    track = track_in_clutter(
        scans.take("row", rows), navigation=ship, start=TargetStart(velocity_std=6.0),
        **(OPTIONS | {"detector": detector_of("rates")}),
    )  # fmt: skip
    place = ways[0, 0] - np.array([ship.east_m[0], ship.north_m[0]])
    along = place / np.hypot(*place)
    radial = along @ track.state_covariance[0][1::2, 1::2] @ along
    across = np.array([-along[1], along[0]])
    free = across @ track.state_covariance[0][1::2, 1::2] @ across
    assert np.sqrt(radial) < 0.7
    assert np.sqrt(free) > 4.0


def _true(ways, ship):
    """Return true ranges and bearings of the first target, in the scans' units."""
    away = ways[0] - np.stack([ship.east_m, ship.north_m], axis=1)
    bearing = np.degrees(np.arctan2(away[:, 0], away[:, 1])) % 360.0
    return np.stack([np.hypot(*away.T), bearing], axis=1)


BEARINGS = OPTIONS | {"detector": detector_of("bearings")}


def test_bearings_alone_find_the_place_once_own_ship_has_turned():
    squares, widths, lost = [], [], 0
    for seed in range(30):
        scans, ship, ways, rate = passing(seed, kind="bearings")
        start = TargetStart((ways[0, 0] + [250.0, -250.0]).tolist(), None, 400.0, 5.0)
        track = track_in_clutter(scans, navigation=ship, start=start, **BEARINGS)
        _, square = error(track, ways, rate)
        if square > 40.0:
            lost += 1
            continue
        squares.append(square)
        before = np.trace(track.state_covariance[20][::2, ::2])
        widths.append(np.trace(track.state_covariance[-1][::2, ::2]) / before)
    assert lost <= 3
    assert 0.8 < np.mean(squares) < 5.5
    assert np.median(widths) < 0.1


def test_tracks_begin_at_bearings_alone_with_filters_at_several_ranges():
    squares, extra = [], 0
    for seed in range(12):
        scans, ship, ways, rate = passing(seed, kind="bearings")
        found = track_in_clutter(
            scans, navigation=ship, targets="auto",
            start=TargetStart(velocity_std=6.0, range_m=(500.0, 8000.0)), **BEARINGS,
        )  # fmt: skip
        assert found.model_probability.shape[1] == 1
        ends = [error(one, ways, rate)[1] for one in found.targets if one.scan[-1] == 50]
        squares += sorted(ends)[:1]
        extra += len(ends) - 1
    assert sum(square < 20.0 for square in squares) >= 10
    assert extra <= 3


def test_a_bearing_seen_from_beside_leads_to_the_same_track_as_its_mirror():
    """The law of mirrors: what is east of north lies west of it, and turns the other way."""
    scans, ship, ways, rate = passing(4, kind="bearings", scans=20)
    start = TargetStart(ways[0, 0].tolist(), rate[0].tolist(), 300.0, 4.0)
    one = track_in_clutter(scans, navigation=ship, start=start, **BEARINGS)
    flip = np.array([-1.0, -1.0, 1.0, 1.0])
    other = track_in_clutter(
        replace(scans, measured=(-scans.measured) % 360.0),
        navigation=replace(ship, east_m=-ship.east_m),
        start=TargetStart(
            (ways[0, 0] * [-1, 1]).tolist(), (rate[0] * [-1, 1]).tolist(), 300.0, 4.0
        ),
        **BEARINGS,
    )
    np.testing.assert_allclose(other.state, one.state * flip, atol=1e-6)
    np.testing.assert_allclose(other.score, one.score, atol=1e-8)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (TargetStart(velocity_std=1.0), "--start-range-m LEAST GREATEST"),
        (TargetStart([1.0, 1.0], None, 1.0, 1.0, range_m=(1.0, 2.0)), "leave it out"),
        (TargetStart([1.0], None, 1.0, 1.0), "2 numbers for each target"),
    ],
)
def test_starts_that_do_not_fit_bearings_are_refused(start, message):
    scans, ship, *_ = passing(1, kind="bearings", scans=3)
    with pytest.raises(OptionError, match=message):
        track_in_clutter(scans, navigation=ship, start=start, **BEARINGS)


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
        track_in_clutter(scans, navigation=ship, start=TargetStart(velocity_std=1.0), **OPTIONS)


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
        "--detector-detection-probability", DETECTION, "--detector-cell-volume", 1800,
        "--detector-false-alarm-probability", FALSE["places"] / 1000.0,
        "--motion-acceleration-std", 0.02, "--start-position", *ways[0, 0],
        "--start-velocity", *rate[0], "--start-position-std", 50,
        "--start-velocity-std", 2, "-o", tmp_path / "t.h5",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    end = float(done.stderr.split("east = ")[1].split(" ")[0])
    assert math.isclose(end, ways[0, -1, 0], abs_tol=60.0)
