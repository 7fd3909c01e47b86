"""How often `pdaf` goes on with another target that crosses its own among false measurements."""

import numpy as np

from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.data.scans import Scans

SCANS, SPEED, STD_M, DETECTION, DENSITY, REACH_M = 50, 20.0, 5.0, 0.9, 1e-5, 400.0


def crossing(seed, angle_deg):
    """Return scans of two targets that meet half way, and their ways (scan, 2)."""
    draw = np.random.default_rng(seed)
    lag = np.arange(SCANS) - SCANS / 2.0
    half = np.radians(0.5 * angle_deg)
    ways = [
        SPEED * lag[:, np.newaxis] * np.array([np.cos(half), side * np.sin(half)])
        for side in (1.0, -1.0)
    ]
    number, place = [], []
    for scan in range(SCANS):
        heard = [
            way[scan] + STD_M * draw.standard_normal(2)
            for way in ways
            if draw.random() < DETECTION
        ]
        false = draw.poisson(DENSITY * (2.0 * REACH_M) ** 2)
        heard += list(ways[0][scan] + draw.uniform(-REACH_M, REACH_M, (false, 2)))
        heard = heard or [np.full(2, np.nan)]
        number += [scan] * len(heard)
        place += heard
    scans = Scans(
        scan=np.array(number) + 1,
        time_s=np.array(number, float),
        measured=np.array(place),
        measured_std=np.full((len(place), 2), STD_M),
        amplitude=np.full(len(place), np.nan),
        component=np.array(["east", "north"]),
        component_unit=np.array(["m", "m"]),
    )
    return scans, ways


def end_of(seed, angle_deg):
    """Return whether the track ends at its own target, the other one or neither."""
    scans, (own, other) = crossing(seed, angle_deg)
    target = track_in_clutter(
        scans, threshold="fixed",
        detector=Detector(
            detection_probability=DETECTION, cell_volume=900.0,
            false_alarm_probability=900.0 * DENSITY,
        ),
        motion=TargetMotion(acceleration_std=0.3),
        start=TargetStart(
            position=own[0].tolist(), velocity=(own[1] - own[0]).tolist(),
            position_std=STD_M, velocity_std=2.0,
        ),
    )  # fmt: skip
    place = target.state[-1, [0, 2]]
    near = [np.hypot(*(place - way[-1])) for way in (own, other)]
    if min(near) > 10.0 * STD_M:
        return "lost"
    return "own" if near[0] < near[1] else "other"
