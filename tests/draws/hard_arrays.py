"""Scenes that are hard for a towed array, with what is true in them, and a score.

`python -m tests.draws.hard_arrays SEED COUNT [KIND ...]` scores draws of each kind.
"""

import sys
import warnings
from dataclasses import replace
from time import process_time
from typing import NamedTuple

import numpy as np

from tests.support import recording_of
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import make_scenario
from uwtrack_cli.simulate.trajectories import array_place, vessel_trajectory

DURATION_S, TURN_S, SPACING_M, TOW_M = 280.0, 110.0, 3.0, 80.0
OWN_MPS, NOISE_DB = 4.0, 62.0
FAR = 5.0
"""Deviations of range or bearing from which a motion is nobody's."""

LIKELY = 0.05
"""Probability from which a mode counts as one of the contact's places."""

KINDS = (
    "crossing", "own-noise", "interferer", "lobes", "lobes-alone", "compass", "bent",
    "elements", "straight",
)  # fmt: skip


def scene(kind, seed):
    """Draw one scene of a kind; own ship goes north, roughly, and turns once."""
    draw = np.random.default_rng([seed, KINDS.index(kind)])
    course = draw.uniform(0.0, 360.0)
    turn = draw.choice([-1.0, 1.0]) * draw.uniform(50.0, 80.0)
    turned = {"at_s": TURN_S, "course_deg": (course + turn) % 360.0, "rate_deg_per_s": 2.0}
    if kind == "bent":  # a slow turn bends the array for two thirds of the record
        turned |= {"at_s": 50.0, "rate_deg_per_s": 0.4}
    own = {"course_deg": course, "speed_mps": OWN_MPS, "turn": [turned]}
    array = {
        "id": "tow", "kind": "array", "depth_m": 20.0, "full_scale_db": 160.0,
        "element_along_m": [SPACING_M * (3.5 - k) for k in range(8)],
        "tow_offset_m": TOW_M, "track": {**own, "turn": [] if kind == "straight" else [turned]},
    }  # fmt: skip
    if kind == "compass":
        array |= {
            "heading_source": "compass", "compass_std_deg": 2.0,
            "compass_error_deg": float(draw.choice([-2.0, 2.0])),
        }  # fmt: skip
    bands = {"lobes": (90.0, 480.0), "lobes-alone": (280.0, 480.0)}.get(kind, (90.0, 235.0))
    side = draw.choice([-1.0, 1.0])
    angles = draw.uniform(40.0, 120.0, 1)
    if kind == "crossing":
        angles = draw.permutation(np.array([55.0, 80.0, 105.0]))
    vessels = [_vessel(draw, course + side * angle, bands) for angle in angles]
    if kind == "crossing":  # towards each other's bearings
        for k, vessel in enumerate(vessels):
            other = vessels[(k + 1) % 3]["track"]
            here = vessel["track"]
            vessel["track"]["course_deg"] = float(np.degrees(np.arctan2(
                other["east_m"] - here["east_m"], other["north_m"] - here["north_m"]
            )) % 360.0)  # fmt: skip
    if kind in {"interferer", "straight"}:
        # 20 dB over the noise in its band at the array, and no lines
        loud = _vessel(draw, course - side * draw.uniform(40.0, 120.0), bands)
        range_m = np.hypot(loud["track"]["east_m"], loud["track"]["north_m"])
        del loud["line"]
        level = NOISE_DB + 20.0 + 20.0 * np.log10(range_m) + 10.0 * np.log10(190.0)
        loud["broadband"] = {"band_hz": [40.0, 240.0], "source_level_db": float(level)}
        vessels.append(loud)
    hidden = []
    if kind == "own-noise":
        hidden.append({
            "source_depth_m": 4.0, "track": {"east_m": 0.0, "north_m": 0.0, **own},
            "line": [{"frequency_hz": float(f), "source_level_db": 118.0}
                     for f in draw.uniform(*bands, 2)],
            "broadband": {"band_hz": [40.0, 240.0], "source_level_db": 128.0},
        })  # fmt: skip
    scenario = make_scenario({
        "seed": seed, "duration_s": DURATION_S,
        "sample_rate_hz": 1000.0 if kind.startswith("lobes") else 500.0,
        "sensor": [array], "vessel": [*vessels, *hidden],
        "noise": {"density_db": NOISE_DB, "reference_hz": 100.0},
    })  # fmt: skip
    return scenario, len(vessels)


def _vessel(draw, bearing_deg, band_hz):
    """A vessel of two or three lines, 15 to 25 dB over the noise of a one-second frame."""
    range_m, bearing = draw.uniform(800.0, 1800.0), np.radians(bearing_deg)
    level = NOISE_DB + draw.uniform(15.0, 25.0) + 20.0 * np.log10(range_m)
    frequencies = draw.uniform(*band_hz, int(draw.integers(2, 4)))
    return {
        "source_depth_m": 4.0,
        "track": {
            "east_m": float(range_m * np.sin(bearing)),
            "north_m": float(range_m * np.cos(bearing)),
            "course_deg": float(draw.uniform(0.0, 360.0)),
            "speed_mps": float(draw.uniform(3.0, 9.0)),
        },
        "line": [{"frequency_hz": float(f), "source_level_db": float(level)} for f in frequencies],
    }


def recording(kind, scenario, seed):
    """Simulate what the array records; channels may be dead or inverted."""
    (made,) = simulate_recordings(scenario)
    if kind != "elements":
        return made
    draw = np.random.default_rng([seed, 99])
    dead, inverted = draw.permutation(8)[:2]
    samples = np.concatenate(list(made.reader(1 << 16)))
    samples[:, dead] = 0.0
    samples[:, inverted] *= -1.0
    return recording_of(samples, made.sample_rate_hz, made.sensor)


class Score(NamedTuple):
    """What the recipe made of one scene."""

    vessels: int = 0
    found: int = 0
    """Vessels that an observable contact is."""
    in_range: int = 0
    """Contacts of vessels whose range lies within 1.96 deviations."""
    in_bearing: int = 0
    matched: int = 0
    """Observable contacts that are a vessel."""
    false: int = 0
    """Observable contacts that are none."""
    seconds: float = 0.0


def analyse(kind, seed):
    """Return motions of one scene, its truth and the CPU time."""
    scenario, count = scene(kind, seed)
    heard = recording(kind, scenario, seed)
    recipe = load_recipe("towed-array")
    if kind.startswith("lobes"):
        recipe = recipe.with_settings(['beamform.above_design="mark"'])
    begin = process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UwtrackWarning)
        made = run_recipe(heard, recipe)
    seconds = process_time() - begin
    (found,) = (item for item in made if isinstance(item, Motions))
    return scenario, count, found, made, seconds


def misses(scenario, found, row, vessel):
    """Return errors of range and bearing of a row over their deviations."""
    time_s = np.array(found.time_s[row])
    here = array_place(scenario.sensors[0], (0.0,) * 3).at(time_s)
    there = vessel_trajectory(scenario.vessels[vessel], scenario).at(time_s)
    east, north = there[0] - here[0], there[1] - here[1]
    off = np.hypot(east, north) - found.range_m[row]
    turn = np.degrees(np.arctan2(east, north)) - found.bearing_deg[row]
    turn = (turn + 180.0) % 360.0 - 180.0
    return abs(off) / found.range_std_m[row], abs(turn) / found.bearing_std_deg[row]


def score(kind, seed, *, told=False):
    """Score one scene; ``told``: print its contacts."""
    scenario, count, found, _, seconds = analyse(kind, seed)
    total = {"vessels": count, "seconds": seconds}
    hits = set()
    names = found.status if hasattr(found, "status") else None
    for contact in np.unique(found.contact):
        rows = np.flatnonzero((found.contact == contact) & (found.weight >= LIKELY))
        best, own = (np.inf, -1, -1, ()), rows[found.observable[rows]]
        for row in own:
            for vessel in range(count):
                off = misses(scenario, found, row, vessel)
                best = min(best, (max(off), vessel, row, off), key=lambda one: one[0])
        if told:
            for row in rows:
                print(  # noqa: T201
                    f"   {contact} mode {found.mode[row]} w {found.weight[row]:.2f} "
                    f"R {found.range_m[row]:.0f}+-{found.range_std_m[row]:.0f} "
                    f"B {found.bearing_deg[row]:.1f}+-{found.bearing_std_deg[row]:.1f} "
                    f"V {found.speed_mps[row]:.1f} C {found.course_deg[row]:.0f} "
                    f"t {found.time_s[row]:.0f}..{found.now_time_s[row]:.0f} "
                    f"obs {found.observable[row]} {found.motion_model[row]} "
                    f"n {found.n_values[row]} chi2 {found.misfit[row]:.0f} {names}"
                    f" far {best[0]:.1f} of vessel {best[1]}"
                )
        if not own.size:
            continue
        if best[0] < FAR:
            hits.add(best[1])
            total["matched"] = total.get("matched", 0) + 1
            total["in_range"] = total.get("in_range", 0) + int(best[3][0] <= 1.96)
            total["in_bearing"] = total.get("in_bearing", 0) + int(best[3][1] <= 1.96)
        else:
            total["false"] = total.get("false", 0) + 1
    total["found"] = len(hits)
    if told:
        for vessel in range(len(scenario.vessels)):
            row = replace_truth(scenario, vessel)
            print(f"   truth {vessel}: {row}")  # noqa: T201
    return Score(**total)


def replace_truth(scenario, vessel):
    """Return range, bearing, speed and course of a vessel at time zero, in words."""
    here = array_place(scenario.sensors[0], (0.0,) * 3).at(np.array(0.0))
    there = vessel_trajectory(scenario.vessels[vessel], scenario).at(np.array(0.0))
    east, north = there[0] - here[0], there[1] - here[1]
    track = scenario.vessels[vessel].track
    lines = [round(line.frequency_hz, 1) for line in scenario.vessels[vessel].lines]
    return (
        f"R {np.hypot(east, north):.0f} B {np.degrees(np.arctan2(east, north)) % 360.0:.1f} "
        f"V {track.speed_mps:.1f} C {track.course_deg:.0f} lines {lines}"
    )


if __name__ == "__main__":
    first, number = int(sys.argv[1]), int(sys.argv[2])
    for which in sys.argv[3:] or KINDS:
        one = [score(which, seed) for seed in range(first, first + number)]
        worst = [first + k for k, each in enumerate(one) if each.false or each.found < each.vessels]
        print(which, Score(*np.sum(one, 0).tolist()), "look at", worst, flush=True)  # noqa: T201
