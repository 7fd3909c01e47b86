"""How often `pdaf` goes on with another target that crosses its own among false measurements."""

import numpy as np

from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.data.scans import Scans

SCANS, SPEED, STD_M, DETECTION, DENSITY, REACH_M = 50, 20.0, 5.0, 0.9, 1e-5, 400.0

DETECTOR = Detector(
    detection_probability=DETECTION, cell_volume=900.0, false_alarm_probability=900.0 * DENSITY
)


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
            way[scan] + STD_M * draw.standard_normal(2) for way in ways if draw.random() < DETECTION
        ]
        false = draw.poisson(DENSITY * (2.0 * REACH_M) ** 2)
        heard += list(ways[0][scan] + draw.uniform(-REACH_M, REACH_M, (false, 2)))
        heard = heard or [np.full(2, np.nan)]
        number += [scan] * len(heard)
        place += heard
    return table_of(np.array(number), np.array(place), 1.0), ways


def end_of(seed, angle_deg):
    """Return whether the track ends at its own target, the other one or neither."""
    scans, (own, other) = crossing(seed, angle_deg)
    target = track_in_clutter(
        scans, threshold="fixed",
        detector=DETECTOR,
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


def ends_of_both(seed, angle_deg):
    """Return at whose place each of two tracks ends that were told of both targets."""
    scans, ways = crossing(seed, angle_deg)
    tracks = track_in_clutter(
        scans, threshold="fixed",
        detector=DETECTOR, motion=TargetMotion(acceleration_std=0.3),
        start=TargetStart(
            position=np.concatenate([way[0] for way in ways]).tolist(),
            velocity=np.concatenate([way[1] - way[0] for way in ways]).tolist(),
            position_std=STD_M, velocity_std=2.0,
        ),
    )  # fmt: skip
    return [at_end(track, ways) for track in tracks.targets]


def at_end(track, ways):
    """Return the target at which a track ends, from 0; None where it is lost."""
    away = [np.hypot(*(track.state[-1, [0, 2]] - way[-1])) for way in ways]
    return int(np.argmin(away)) if min(away) <= 10.0 * STD_M else None


def false_only(seed, scans, density, period_s):
    """Return scans of false measurements alone."""
    draw = np.random.default_rng(seed)
    count = draw.poisson(density * (2.0 * REACH_M) ** 2, scans)
    number = np.repeat(np.arange(scans), np.maximum(count, 1))
    place = draw.uniform(-REACH_M, REACH_M, (number.size, 2))
    place[np.isin(number, np.flatnonzero(count == 0))] = np.nan
    return table_of(number, place, period_s)


def table_of(number, place, period_s):
    """Return scans of places without amplitudes."""
    return Scans(
        scan=number + 1, time_s=period_s * number, measured=place,
        measured_std=np.full(place.shape, STD_M), amplitude=np.full(number.size, np.nan),
        component=np.array(["east", "north"]), component_unit=np.array(["m", "m"]),
    )  # fmt: skip
