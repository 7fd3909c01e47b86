"""Targets among false measurements as own ship under way measures them, and one that turns.

`python -m tests.draws.targets_under_way DRAWS` prints errors of turns, by the smoothing.
"""

import sys

import numpy as np

from tests.draws.crossing_targets import DETECTOR, STD_M, table_of
from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.sensor import Navigation

RANGE_STD_M, BEARING_STD_DEG, RATE_STD_MPS = 10.0, 0.5, 0.5
DETECTION, PERIOD_S, REACH_M, FASTEST_MPS = 0.9, 5.0, 5000.0, 20.0
KINDS = {
    "places": (["range", "bearing"], ["m", "deg"]),
    "rates": (["range", "bearing", "range rate"], ["m", "deg", "m/s"]),
    "bearings": (["bearing"], ["deg"]),
}
"""Names and units of what is measured."""
FALSE = {"places": 60.0, "rates": 60.0, "bearings": 4.0}
"""Mean number of false measurements in a scan."""


def detector_of(kind):
    """Return the detector, in cells of 0.001 of all that may be measured."""
    whole = {"places": REACH_M * 360.0, "bearings": 360.0,
             "rates": REACH_M * 360.0 * 2.0 * FASTEST_MPS}[kind]  # fmt: skip
    return Detector(
        detection_probability=DETECTION, cell_volume=whole / 1000.0,
        false_alarm_probability=FALSE[kind] / 1000.0,
    )  # fmt: skip


def ship_of(time_s, place, start_utc_ns=None):
    """Return own ship's navigation."""
    return Navigation(
        time_s=time_s, east_m=place[:, 0], north_m=place[:, 1],
        heading_deg=np.full(time_s.size, np.nan), start_utc_ns=start_utc_ns,
    )  # fmt: skip


def passing(seed, n_targets=1, scans=50, kind="places"):
    """Return scans from a ship that turns, her navigation and the targets' ways."""
    draw = np.random.default_rng(seed)
    time_s = PERIOD_S * np.arange(scans)
    course = np.where(time_s < 0.48 * time_s[-1], 0.3, 1.6)
    step = 8.0 * PERIOD_S * np.stack([np.sin(course), np.cos(course)], axis=1)
    own = np.cumsum(step, axis=0) + np.array([300.0, -200.0])
    own_rate = np.gradient(own, time_s, axis=0)
    first = np.array([[2500.0, 1500.0], [-1500.0, 2500.0]])[:n_targets]
    rate = np.array([[-6.0, 3.0], [5.0, 4.0]])[:n_targets]
    ways = first[:, None] + rate[:, None] * time_s[:, None]
    number, rows = [], []
    for k in range(scans):
        seen = draw.random(n_targets) < DETECTION
        away, opening = (ways[:, k] - own[k])[seen], (rate - own_rate[k])[seen]
        distance = np.hypot(*away.T)
        true = np.stack([
            distance, np.degrees(np.arctan2(away[:, 0], away[:, 1])),
            (away * opening).sum(axis=1) / distance,
        ], axis=1)  # fmt: skip
        std = [RANGE_STD_M, BEARING_STD_DEG, RATE_STD_MPS]
        true += draw.standard_normal(true.shape) * std
        false = draw.poisson(FALSE[kind])
        clutter = draw.random((false, 3)) * [REACH_M, 360.0, 2.0 * FASTEST_MPS]
        clutter[:, 2] -= FASTEST_MPS
        one = [*true, *clutter] or [np.full(3, np.nan)]
        number += [k] * len(one)
        rows += one
    rows = np.array(rows)
    rows[:, 1] %= 360.0
    names, units = KINDS[kind]
    columns = {"places": [0, 1], "rates": [0, 1, 2], "bearings": [1]}[kind]
    table = Scans(
        scan=np.array(number) + 1, time_s=PERIOD_S * np.array(number, float),
        measured=rows[:, columns],
        measured_std=np.tile(np.array(std)[columns], (len(rows), 1)),
        amplitude=np.full(len(rows), np.nan), component=np.array(names),
        component_unit=np.array(units),
    )  # fmt: skip
    return table, ship_of(time_s, own), ways, rate


def turning(seed, turn_degps=3.0, scans=60, density=1e-5):
    """Return scans of one that goes straight, turns by 180 degrees and goes on, and its way."""
    draw = np.random.default_rng(seed)
    begin, end = 20, 20 + round(180.0 / turn_degps)
    fine = np.arange(0.0, scans, 0.1)
    angle = np.radians(turn_degps) * np.clip(fine - begin, 0.0, end - begin)
    angle = (angle if draw.random() < 0.5 else -angle) + draw.uniform(0.0, 2.0 * np.pi)
    way = np.cumsum(2.0 * np.stack([np.sin(angle), np.cos(angle)], axis=1), axis=0)[::10]
    number, rows = [], []
    for k in range(scans):
        heard = [way[k] + 5.0 * draw.standard_normal(2)] * (draw.random() < DETECTION)
        false = draw.poisson(density * 800.0**2)
        heard += list(way[k] + draw.uniform(-400.0, 400.0, (false, 2)))
        heard = heard or [np.full(2, np.nan)]
        number += [k] * len(heard)
        rows += heard
    return table_of(np.array(number), np.array(rows), 1.0), way


def turn_errors(motion, lag, draws):
    """Return the root mean square error of place, m, of turns that are followed, smoothed."""
    squares = []
    for seed in range(draws):
        scans, way = turning(seed)
        track = track_in_clutter(
            scans, threshold="fixed", detector=DETECTOR, motion=motion,
            start=TargetStart(way[0].tolist(), (way[1] - way[0]).tolist(), STD_M, 2.0),
            smoothing_scans=lag,
        )  # fmt: skip
        off = track.state[:, ::2] - way[track.scan - 1]
        squares.append((off**2).sum(axis=1).mean())
    return float(np.sqrt(np.mean(squares)))


def _table(draws):
    """Yield errors of place by motion models and by the lag of smoothing."""
    lags = (0, 2, 5, 10, 20, 1000)
    models = {
        "straight, turns": TargetMotion(acceleration_std=0.3, turn_rate_degps=3.0),
        "straight, accelerations of 3 m/s^2": TargetMotion(acceleration_std=0.3, manoeuvre_std=3.0),
    }
    titles = ["motion models", "filter", *(f"lag {lag}" for lag in lags[1:-1]), "whole"]
    yield "| " + " | ".join(titles) + " |"
    yield "|" + "---|" * len(titles)
    for name, motion in models.items():
        errors = [f"{turn_errors(motion, lag, draws):.1f}" for lag in lags]
        yield f"| {name} | {' | '.join(errors)} |"


if __name__ == "__main__":
    for line in _table(int(sys.argv[1])):
        sys.stdout.write(line + "\n")
