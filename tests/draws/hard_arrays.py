"""Scenes that are hard for a towed array, with what is true in them, and a score.

`python -m tests.draws.hard_arrays SEED COUNT [KIND ...]` scores draws of each kind, and
prints the contacts of a single draw.
"""

import sys
import warnings
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
APART_HZ = 4.0
"""Least distance of lines."""

FAR = 5.0
"""Deviations of range or bearing from which a motion is nobody's."""

LIKELY = 0.05
"""Probability from which a mode counts as one of the contact's places."""

KINDS = (
    "crossing", "own-noise", "interferer", "lobes", "lobes-alone", "compass", "bent",
    "elements", "straight", "pair",
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
    array = _array(kind, own, float(draw.choice([-2.0, 2.0])))
    bands = {
        "lobes": (90.0, 480.0), "lobes-alone": (280.0, 480.0), "pair": (260.0, 480.0)
    }.get(kind, (90.0, 235.0))  # fmt: skip
    # two lines within 1.5 Hz may be one, whoever hears them (docs/limits.md)
    lines = list(draw.permutation(np.arange(*bands, APART_HZ)) + draw.uniform(0.0, 1.0))
    side = draw.choice([-1.0, 1.0])
    angles = draw.uniform(40.0, 120.0, 1)
    if kind == "crossing":
        angles = draw.permutation(np.array([55.0, 80.0, 105.0]))
    vessels = [_vessel(draw, course + side * angle, lines) for angle in angles]
    if kind == "crossing":  # towards each other's bearings
        for k, vessel in enumerate(vessels):
            other = vessels[(k + 1) % 3]["track"]
            here = vessel["track"]
            vessel["track"]["course_deg"] = float(np.degrees(np.arctan2(
                other["east_m"] - here["east_m"], other["north_m"] - here["north_m"]
            )) % 360.0)  # fmt: skip
    if kind in {"interferer", "straight"}:
        # 20 dB over the noise in its band at the array, and no lines
        loud = _vessel(draw, course - side * draw.uniform(40.0, 120.0), lines)
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
                     for f in (lines.pop(), lines.pop())],
            "broadband": {"band_hz": [40.0, 240.0], "source_level_db": 128.0},
        })  # fmt: skip
    scenario = make_scenario({
        "seed": seed, "duration_s": DURATION_S,
        "sample_rate_hz": 500.0 if bands[1] < 250.0 else 1000.0,
        "sensor": [array], "vessel": [*vessels, *hidden],
        "noise": {"density_db": NOISE_DB, "reference_hz": 100.0},
    })  # fmt: skip
    return scenario, len(vessels)


def _array(kind, own, compass_error_deg):
    """Eight hydrophones, or two, behind a ship of this track."""
    array = {
        "id": "tow", "kind": "array", "depth_m": 20.0, "full_scale_db": 160.0,
        "element_along_m": [SPACING_M * (3.5 - k) for k in range(8)],
        "tow_offset_m": TOW_M, "track": {**own, "turn": []} if kind == "straight" else own,
    }  # fmt: skip
    if kind == "pair":
        array["element_along_m"] = [0.75, -0.75]
    if kind == "compass":
        array |= {
            "heading_source": "compass", "compass_std_deg": 2.0,
            "compass_error_deg": compass_error_deg,
        }  # fmt: skip
    return array


def _vessel(draw, bearing_deg, lines_hz):
    """A vessel of two or three lines, 15 to 25 dB over the noise of a one-second frame."""
    range_m, bearing = draw.uniform(800.0, 1800.0), np.radians(bearing_deg)
    level = NOISE_DB + draw.uniform(15.0, 25.0) + 20.0 * np.log10(range_m)
    frequencies = [lines_hz.pop() for _ in range(int(draw.integers(2, 4)))]
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
    """Vessels that a contact is whose likeliest motion is observable."""
    in_range: int = 0
    """Contacts of vessels whose range lies within 1.96 deviations."""
    in_bearing: int = 0
    matched: int = 0
    """Observable contacts that are a vessel."""
    false: int = 0
    """Observable contacts none of whose motions is a vessel's."""
    altered: int = 0
    """Contacts whose likeliest motion is not straight, as that of all vessels is."""
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
    return scenario, count, found, seconds


def truth_at(scenario, vessel, time_s):
    """Return range, m, and bearing, degrees, of a vessel from the array."""
    here = array_place(scenario.sensors[0], (0.0,) * 3).at(np.array(time_s))
    there = vessel_trajectory(scenario.vessels[vessel], scenario).at(np.array(time_s))
    east, north = there[0] - here[0], there[1] - here[1]
    return float(np.hypot(east, north)), float(np.degrees(np.arctan2(east, north)) % 360.0)


def nearest(scenario, count, found, rows):
    """Return the vessel that the modes of a contact miss least, in deviations of each."""
    best = (np.inf, -1, (np.inf, np.inf))
    for row in rows[found.observable[rows]]:
        for vessel in range(count):
            range_m, bearing_deg = truth_at(scenario, vessel, found.time_s[row])
            off = abs(range_m - found.range_m[row]) / found.range_std_m[row]
            turn = (bearing_deg - found.bearing_deg[row] + 180.0) % 360.0 - 180.0
            turn = abs(turn) / found.bearing_std_deg[row]
            best = min(best, (max(off, turn), vessel, (off, turn)))
    return best


def score(kind, seed, *, told=False):
    """Score one scene; ``told``: print its contacts and what is true."""
    scenario, count, found, seconds = analyse(kind, seed)
    total = Score(vessels=count, seconds=seconds)
    hits = set()
    for contact in np.unique(found.contact):
        rows = np.flatnonzero((found.contact == contact) & (found.weight >= LIKELY))
        rows = rows[np.argsort(-found.weight[rows], kind="stable")]
        far, vessel, off = nearest(scenario, count, found, rows)
        if told:
            tell(found, rows, far, vessel)
        altered = total.altered + int(found.motion_model[rows[0]] != "straight")
        total = total._replace(altered=altered)
        if not found.observable[rows[0]]:
            continue
        if far >= FAR:
            total = total._replace(false=total.false + 1)
            continue
        hits.add(vessel)
        within = [int(one <= 1.96) for one in off]
        total = total._replace(
            matched=total.matched + 1,
            in_range=total.in_range + within[0],
            in_bearing=total.in_bearing + within[1],
        )
    if told:
        for vessel, one in enumerate(scenario.vessels):
            lines = [round(line.frequency_hz, 1) for line in one.lines]
            print(f"   truth {vessel}:", truth_at(scenario, vessel, 0.0), one.track, lines)  # noqa: T201
    return total._replace(found=len(hits))


def tell(found, rows, far, vessel):
    """Print the modes of a contact."""
    for row in rows:
        print(  # noqa: T201
            f"   {found.contact[row]} mode {found.mode[row]} w {found.weight[row]:.2f} "
            f"R {found.range_m[row]:.0f}+-{found.range_std_m[row]:.0f} "
            f"B {found.bearing_deg[row]:.1f}+-{found.bearing_std_deg[row]:.1f} "
            f"V {found.speed_mps[row]:.1f} C {found.course_deg[row]:.0f} "
            f"{found.time_s[row]:.0f}..{found.now_time_s[row]:.0f} s, {found.motion_model[row]}, "
            f"{found.n_values[row]} values, misfit {found.misfit[row]:.0f}; "
            f"{far:.1f} deviations from vessel {vessel}"
        )


if __name__ == "__main__":
    first, number = int(sys.argv[1]), int(sys.argv[2])
    for which in sys.argv[3:] or KINDS:
        every = [score(which, first + k, told=number == 1) for k in range(number)]
        worst = [first + k for k, one in enumerate(every) if one.false or one.found < one.vessels]
        print(which, Score(*np.sum(every, 0).tolist()), "look at", worst, flush=True)  # noqa: T201
