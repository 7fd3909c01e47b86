"""Sample tables for the analyses that read tables instead of sound.

**Conventions.** Each sample is a CSV file as `CLI` users write it, with the truth in a
JSON file beside it: `bearings` (with `own-ship`) for target motion, `scans` for one
target in clutter, `contacts` (with `observer`) for the test which of two moves.
"""

import json
from collections.abc import Iterable, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from studies.clutter_scans import ClutterScene, constant_velocity_truth, simulate_scan
from studies.repeater import RepeaterScene, simulate_repeater
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.files.atomic import write_text

SEED = 2003


def write_sample_tables(folder: Path) -> tuple[Path, ...]:
    """Write all sample tables with their truth; existing files are replaced.

    Returned: the files written.
    """
    written: list[Path] = []
    for make in (_bearings, _scans, _contacts):
        for name, text in make(np.random.default_rng(SEED)).items():
            path = folder / name
            write_text(path, text, overwrite=True)
            written.append(path)
    return tuple(written)


def _bearings(rng: np.random.Generator) -> dict[str, str]:
    """Draw a vessel at 20 km from a ship that turns twice (Chang et al. 2003, T3)."""
    time_s = np.arange(0.0, 6000.0, 20.0)
    legs = [(0.0, 5.0, 300.0), (1500.0, 8.0, 240.0), (4500.0, 5.0, 300.0)]
    own, own_rate = _legs(time_s, legs)
    course, bearing, speed = np.radians(135.0), np.radians(270.0), 8.0 * KNOT_MPS
    rate = speed * np.array([np.sin(course), np.cos(course)])
    start = 20_000.0 * np.array([np.sin(bearing), np.cos(bearing)])
    apart = start + rate * time_s[:, None] - own
    range_m = np.hypot(*apart.T)
    opening = np.sum(apart * (rate - own_rate), axis=1) / range_m
    seen_deg = np.degrees(np.arctan2(*apart.T)) + rng.standard_normal(time_s.size)
    heard_hz = 650.0 * (1.0 - opening / 1480.0)
    heard_hz += 0.25 * rng.standard_normal(time_s.size)
    heads = ("time_s", "bearing_deg", "bearing_std_deg", "frequency_hz", "frequency_std_hz")
    rows = zip(time_s, seen_deg % 360.0, np.ones_like(time_s), heard_hz,
               np.full_like(time_s, 0.25), strict=True)  # fmt: skip
    ship = [*legs, (6000.0, 5.0, 300.0)]
    truth = {"range_m": 20_000.0, "bearing_deg": 270.0, "speed_mps": speed,
             "course_deg": 135.0, "rest_frequencies_hz": [650.0],
             "sound_speed_mps": 1480.0}  # fmt: skip
    return {
        "bearings.csv": _csv(heads, rows),
        "own-ship.csv": _csv(("time_s", "speed_kn", "course_deg"), ship),
        "bearings.truth.json": _json(truth),
    }


def _legs(
    time_s: FloatArray, legs: Sequence[tuple[float, float, float]]
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities on straight legs of (start s, speed kn, course deg)."""
    starts = np.array([leg[0] for leg in legs])
    speed = KNOT_MPS * np.array([leg[1] for leg in legs])
    course = np.radians([leg[2] for leg in legs])
    rate = speed[:, None] * np.stack([np.sin(course), np.cos(course)], axis=1)
    spent = np.clip(time_s[:, None] - starts, 0.0, [*np.diff(starts), np.inf])
    leg = np.searchsorted(starts, time_s, side="right") - 1
    return spent @ rate, rate[leg]


def _scans(rng: np.random.Generator) -> dict[str, str]:
    """Draw a target at 70 m/s among some twenty false echoes in a scan."""
    scene = ClutterScene(false_alarm=0.03, signal_to_noise=31.6)
    start = np.array([[-1750.0, 50.0, 1750.0, -50.0]])
    states = constant_velocity_truth(
        rng, start, scans=50, interval_s=1.0, acceleration_std=np.sqrt(10.0)
    )
    rows: list[tuple[Any, ...]] = []
    for k, state in enumerate(states):
        scan = simulate_scan(rng, state[:, ::2], scene)
        rows += [
            (k + 1, k + 1.0, *place, amplitude, 5**0.5, 5**0.5)
            for place, amplitude in zip(scan.measured[0], scan.amplitude[0], strict=True)
            if np.isfinite(amplitude)
        ]
    heads = ("scan", "time_s", "z_1 [m]", "z_2 [m]", "amplitude", "std_1", "std_2")
    truth = {"time_s": list(range(1, 51)), "z_1_m": states[:, 0, 0].tolist(),
             "z_2_m": states[:, 0, 2].tolist()}  # fmt: skip
    return {"scans.csv": _csv(heads, rows), "scans.truth.json": _json(truth)}


def _contacts(rng: np.random.Generator) -> dict[str, str]:
    """Draw two echoes that look alike: 1 moves, 2 is a drifting repeater."""
    scene = RepeaterScene(aspect_deg=80.0)
    drawn = simulate_repeater(rng, scene, 1)
    deviations = (scene.range_std_m, scene.bearing_std_deg, scene.range_rate_std_mps)
    rows = [
        (contact, t, r, deviations[0], b % 360.0, deviations[1], d, deviations[2])
        for contact, table in ((1, drawn.source), (2, drawn.repeater))
        for t, (r, b, d) in zip(drawn.time_s, table[:, 0], strict=True)
        if np.isfinite(r)
    ]
    rows.sort(key=itemgetter(1))
    heads = ("contact", "time_s", "range_m", "range_std_m", "bearing_deg",
             "bearing_std_deg", "range_rate_mps", "range_rate_std_mps")  # fmt: skip
    ship = zip(drawn.navigation_time_s, *drawn.own_ship_m.T, strict=True)
    return {
        "contacts.csv": _csv(heads, rows),
        "observer.csv": _csv(("time_s", "east_m", "north_m"), ship),
        "contacts.truth.json": _json({"moving_contact": 1, "repeater_contact": 2}),
    }


def _csv(heads: Sequence[str], rows: Iterable[Iterable[float]]) -> str:
    lines = [",".join(f"{value:.6g}" for value in row) for row in rows]
    return "\n".join([",".join(heads), *lines]) + "\n"


def _json(truth: dict[str, Any]) -> str:
    return json.dumps(truth) + "\n"
