"""Part of targets: drawn scenes of several, of own ship under way, of turns, of repeaters."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from tests.acceptance.outcomes import Outcome
from tests.clutter.test_several_targets import AUTO, MOTION, stone_soup, told
from tests.draws.contact_pairs import BEARING_STD_DEG, error_rates
from tests.draws.crossing_targets import DETECTOR, STD_M, crossing, ends_of_both, false_only
from tests.draws.targets_under_way import FALSE, detector_of, passing, turning
from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.flow.scoring.track_scores import gospa

Case = Callable[[Path], Outcome]

INSIDE_95 = {2: 5.99, 4: 9.49}
"""Quantiles of chi-square with so many degrees of freedom."""


def takeovers(seed: int, count: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Count pairs that cross at 10 degrees and whose tracks change them, or lose one."""
    ends = [ends_of_both(number, 10.0) for number in range(seed, seed + count)]
    return {"counts": {
        "takeovers": [sum(one == [1, 0] or one[0] == one[1] for one in ends), count],
        "lost of two": [sum(None in one for one in ends), count],
    }}  # fmt: skip


def against_stone_soup(seed: int, count: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Compare tracks told of their starts, and without any, with Stone Soup's JPDA."""
    same, near = 0, 0
    for number in range(seed, seed + count):
        scans, ways = crossing(number, 40.0)
        theirs = stone_soup(scans, told(ways))
        ours = track_in_clutter(
            scans, threshold="fixed", detector=DETECTOR, motion=MOTION, start=told(ways)
        )
        same += all(
            np.abs(one.state - states).max() < 1e-9
            for one, states in zip(ours.targets, theirs, strict=True)
        )
        auto = track_in_clutter(scans, **AUTO)
        distance = np.zeros(2)
        for scan in range(5, 50):
            true = np.array([way[scan] for way in ways])
            for k, places in enumerate(
                (auto.state[auto.scan == scan + 1][:, ::2], theirs[:, scan, ::2])
            ):
                distance[k] += gospa(places, true, cutoff_m=10.0 * STD_M).distance_m
        near += bool(distance[0] <= 1.15 * distance[1])
    return {"counts": {"states of Stone Soup": [same, count],
                       "GOSPA of Stone Soup, without a start": [near, count]}}  # fmt: skip


def clutter_alone(seed: int, scans: int, rate: float, folder: Path) -> Outcome:  # noqa: ARG001
    """Count the tracks that clutter begins, and those that are stated at most."""
    density, detection, period_s = 3e-5, 0.6, 10.0
    target = track_in_clutter(
        false_only(seed, scans, density, period_s), targets="auto", threshold="fixed",
        false_tracks_per_hour=rate,
        detector=Detector(
            detection_probability=detection, cell_volume=900.0,
            false_alarm_probability=900.0 * density,
        ),
        motion=TargetMotion(acceleration_std=0.01), start=TargetStart(velocity_std=3.0),
    )  # fmt: skip
    stated = round(rate * scans * period_s / 3600.0)
    return {"counts": {"false tracks of those stated": [len(target.targets), stated]}}


def under_way(kind: str, seed: int, count: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Follow one target from a ship that turns; is it where its ellipse says?"""
    lost, inside, kept = 0, 0, 0
    for number in range(seed, seed + count):
        scans, ship, ways, rate = passing(number, kind=kind)
        track = track_in_clutter(
            scans, navigation=ship, threshold="fixed", detector=detector_of(kind),
            motion=TargetMotion(acceleration_std=0.02),
            start=TargetStart((ways[0, 0] + 100.0).tolist(), None, 150.0, 5.0),
        )  # fmt: skip
        off = track.state[-1] - np.stack([ways[0, -1], rate[0]], axis=1).ravel()
        square = off @ np.linalg.solve(track.state_covariance[-1], off)
        if track.lost[-1] or square > 40.0:
            lost += 1
            continue
        kept += 1
        inside += bool(square < INSIDE_95[4])
    return {"counts": {f"lost under way, {kind}": [lost, count],
                       f"ellipses under way, {kind}": [inside, kept]}}  # fmt: skip


def turns(seed: int, count: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Follow one that turns by 180 degrees, and smooth it over the whole record."""
    lost, inside, of = 0, 0, 0
    for number in range(seed, seed + count):
        scans, way = turning(number)
        start = TargetStart(way[0].tolist(), (way[1] - way[0]).tolist(), STD_M, 2.0)
        track = track_in_clutter(
            scans, threshold="fixed", detector=DETECTOR, start=start,
            motion=TargetMotion(acceleration_std=0.3, turn_rate_degps=3.0),
            smoothing_scans=scans.scan.size,
        )  # fmt: skip
        off = track.state[:, ::2] - way[track.scan - 1]
        if np.hypot(*off[-1]) > 10.0 * STD_M:
            lost += 1
            continue
        # scans ten apart, whose errors share little
        place = track.state_covariance[5::10, ::2, ::2]
        solved = np.linalg.solve(place, off[5::10, :, None])[..., 0]
        square = (off[5::10] * solved).sum(axis=1)
        inside, of = inside + int((square < INSIDE_95[2]).sum()), of + square.size
    return {"counts": {"lost in turns": [lost, count], "smoothed ellipses of turns": [inside, of]}}


def repeaters(
    data: str,
    seed: int,
    pairs: int,
    has_history: bool,
    folder: Path,  # noqa: ARG001
) -> Outcome:
    """Count the wrong verdicts on sources and their repeaters, and readings refused."""
    counts = {}
    for row in error_rates(seed, pairs, "as assumed", data, has_history=has_history):
        accepted = f"{100 * row.error:g} %"
        counts[f"wrong of pairs at {accepted}"] = [row.wrong, pairs]
        counts[f"neither of pairs at {accepted}"] = [row.neither, pairs]
    return {"counts": counts}


def cases(seed: int) -> dict[str, Case]:
    """Return all cases of targets."""
    made: dict[str, Case] = {
        f"repeaters, {data} bearings, {'after one contact' if history else 'at once'}":
            partial(repeaters, data, seed, 200, history)
        for data in BEARING_STD_DEG for history in (True, False)
    }  # fmt: skip
    made["two that cross at 10 degrees"] = partial(takeovers, seed, 100)
    made["two against Stone Soup"] = partial(against_stone_soup, seed, 6)
    made["clutter alone"] = partial(clutter_alone, seed, 600, 300.0)
    for kind in FALSE:
        made[f"own ship under way, {kind}"] = partial(under_way, kind, seed, 40)
    made["turns"] = partial(turns, seed, 30)
    return made
