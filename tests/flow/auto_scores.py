"""Recipe `auto` beside the recipes that know what passes, on drawn recordings.

Prints tables in Markdown, in an hour or so; its two numbers are recordings of each kind
and the first seed, and kinds may follow:
python -m tests.flow.auto_scores 40 7000 vessel none
"""

import sys
import time
import warnings
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np

from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import make_scenario, simulate_recordings
from uwtrack_cli.simulate.random_passages import draw_scenario

RATE_HZ = 8000.0


def brief_passage(seed, *, speed_mps, range_m, base_hz, length_s, sound_speed_mps):
    """Draw one passage that takes seconds, past a sensor of unknown direction."""
    rng = np.random.default_rng([seed, 77])
    base, strength = rng.uniform(*base_hz), rng.uniform(28.0, 48.0)
    return make_scenario({
        "seed": int(rng.integers(2**31)),
        "duration_s": length_s,
        "sample_rate_hz": RATE_HZ,
        "sound_speed_mps": sound_speed_mps,
        "sensor": [{"id": "h1", "depth_m": 4.0, "full_scale_db": 175.0}],
        "vessel": [{
            "source_depth_m": float(rng.uniform(0.5, 3.0)),
            "closest_approach": {
                "time_s": float(rng.uniform(0.2, 0.8) * length_s),
                "horizontal_range_m": float(np.exp(rng.uniform(*np.log(range_m)))),
                "speed_mps": float(rng.uniform(*speed_mps)),
                "course_deg": float(rng.uniform(0.0, 360.0)),
                "side": "port",
            },
            "line": [
                {"frequency_hz": float(base * n),
                 "cn0_db_hz": float(strength - rng.uniform(0.0, 8.0))}
                for n in range(1, 4 + int(rng.integers(0, 6)))
            ],
            "frequency_jitter": {"fraction": 1e-4, "correlation_s": 10.0},
            "broadband": {
                "band_hz": [50.0, 3500.0], "snr_db": float(rng.uniform(0.0, 25.0)),
                "slope_db_per_decade": -10.0,
            },
        }],
        "noise": {"density_db": 60.0, "slope_db_per_decade": -15.0},
    })  # fmt: skip


def small_craft(seed):
    """Draw a fast boat close by: d/v of some seconds."""
    return brief_passage(
        seed, speed_mps=(8.0, 20.0), range_m=(5.0, 40.0), base_hz=(20.0, 80.0),
        length_s=120.0, sound_speed_mps=1500.0,
    )  # fmt: skip


def vehicle(seed):
    """Draw a vehicle in air: d/v of tenths of a second to some seconds."""
    return brief_passage(
        seed, speed_mps=(12.0, 45.0), range_m=(4.0, 25.0), base_hz=(60.0, 200.0),
        length_s=60.0, sound_speed_mps=343.0,
    )  # fmt: skip


def lines_alone(draw):
    """Leave the broadband of what passes out: its level hardly rises."""

    def drawn(seed):
        scenario = draw(seed)
        vessels = tuple(replace(one, broadband=None) for one in scenario.vessels)
        return replace(scenario, vessels=vessels)

    return drawn


def weak_vessel(seed):
    """Draw a slow vessel with steady lines that are too weak for single frames."""
    rng = np.random.default_rng([seed, 78])
    base, strength = rng.uniform(20.0, 60.0), rng.uniform(4.0, 16.0)
    return make_scenario({
        "seed": int(rng.integers(2**31)),
        "duration_s": 480.0,
        "sample_rate_hz": 4000.0,
        "sensor": [{"id": "h1", "depth_m": 20.0, "full_scale_db": 175.0}],
        "vessel": [{
            "source_depth_m": 3.0,
            "closest_approach": {
                "time_s": float(rng.uniform(160.0, 320.0)),
                "horizontal_range_m": float(rng.uniform(60.0, 300.0)),
                "speed_mps": float(rng.uniform(3.0, 8.0)),
                "course_deg": 0.0,
                "side": "port",
            },
            "line": [
                {"frequency_hz": float(base * n), "cn0_db_hz": float(strength)}
                for n in range(1, 4 + int(rng.integers(0, 8)))
            ],
            "frequency_jitter": {"fraction": 1e-5, "correlation_s": 30.0},
        }],
        "noise": {"density_db": 60.0, "slope_db_per_decade": -15.0},
    })  # fmt: skip


def car():
    """Return a short recording of a loud car."""
    return brief_passage(
        3, speed_mps=(25.0, 26.0), range_m=(6.0, 6.5), base_hz=(100.0, 110.0),
        length_s=16.0, sound_speed_mps=343.0,
    )  # fmt: skip


KINDS = {
    "vessel": (
        lambda seed: draw_scenario(seed, n_vessels=1, sample_rate_hz=4000.0),
        ("vessel", "auto"),
    ),
    "small craft": (small_craft, ("vessel", "small-craft", "auto")),
    "vehicle": (vehicle, ("vessel", "vehicle", "auto")),
    "small craft, lines": (lines_alone(small_craft), ("small-craft", "auto")),
    "vehicle, lines": (lines_alone(vehicle), ("vehicle", "auto")),
    "weak": (
        weak_vessel,
        (
            "vessel",
            "vessel spectrogram.window_s=4",
            "weak-lines",
            "weak-lines spectrogram.window_s=4",
            "auto",
        ),
    ),
    "disturbances": (
        lambda seed: draw_scenario(
            seed, n_vessels=0, sample_rate_hz=4000.0, duration_s=300.0
        ),
        ("vessel", "auto"),
    ),
    "noise": (
        lambda seed: draw_scenario(
            seed, n_vessels=0, kinds=[], sample_rate_hz=4000.0, duration_s=300.0
        ),
        ("vessel", "auto"),
    ),
}
"""Kinds of recordings with the recipes, and settings, that are run over them."""


def recipe_of(words):
    """Return a recipe with the settings that follow its name."""
    name, *settings = words.split()
    return load_recipe(name).with_settings(settings)


def in_memory(scenario):
    """Simulate the only recording of a scenario, and hold its sound."""
    (recording,) = simulate_recordings(scenario)
    sound = np.concatenate(list(recording.reader(1 << 18)))
    return replace(recording, reader=HeldSamples(sound))


@cache
def car_by_auto():
    """Return the recording of the car, and what `auto` makes of it; two tests ask."""
    recording = in_memory(car())
    return recording, run_recipe(recording, load_recipe("auto"))


def passages(scenario):
    """Return time, d/v and speed of what truly passes."""
    depth = scenario.sensors[0].depth_m
    found = []
    for vessel in scenario.vessels:
        one = vessel.closest_approach
        if one is not None:
            slant = np.hypot(one.horizontal_range_m, depth - vessel.source_depth_m)
            found.append((one.time_s, slant / one.speed_mps, one.speed_mps))
    return found


def scores(scenario, table, evidence):
    """Count what a table finds, and what it finds wrongly; add its rows' evidence."""
    counts = Counter()
    asked = table.rest_frame_evidence
    asked = np.full(table.n_encounters, np.nan) if asked is None else asked
    free = set(range(table.n_encounters))
    for time_s, width_s, speed_mps in passages(scenario):
        counts["passages"] += 1
        reach = max(1.0, width_s)
        near = [k for k in free if abs(table.time_s[k] - time_s) < reach]
        if not near:
            continue
        best = min(near, key=lambda k: (table.status[k] == "level-only",
                                        abs(table.time_s[k] - time_s)))  # fmt: skip
        free.discard(best)
        counts["found"] += 1
        evidence["true"].append(asked[best])
        off = [(table.range_over_speed_s[best] - width_s)
               / table.range_over_speed_std_s[best]]  # fmt: skip
        if np.isfinite(table.speed_mps[best]):
            counts["with speed"] += 1
            off.append((table.speed_mps[best] - speed_mps) / table.speed_std_mps[best])
        counts["beyond 3 deviations"] += bool(np.max(np.abs(off)) > 3)
        counts["beyond 5 deviations"] += bool(np.max(np.abs(off)) > 5)
    for k in free:
        kind = "level-only" if table.status[k] == "level-only" else "with lines"
        counts[f"false, {kind}"] += 1
        evidence["false"].append(asked[k])
    return counts


SHARES = (0.0, 0.1, 0.5, 0.9, 1.0)
"""Quantiles of the evidence that are told."""

HEADS = ("passages", "found", "with speed", "beyond 3 deviations",
         "beyond 5 deviations", "false, with lines", "false, level-only")  # fmt: skip


def main(runs, seed, *wanted):
    """Print one row for each kind of recording and recipe; all kinds unless named."""
    warnings.simplefilter("ignore")
    out = sys.stdout
    out.write(
        "# Recipe auto beside the recipes that know what passes\n\n"
        f"Made by `python -m tests.flow.auto_scores {runs} {seed}`: {runs} recordings of "
        "each kind. Cost is CPU time over that of `vessel` on the same recordings.\n\n"
        f"| recordings | recipe | {' | '.join(HEADS)} | cost |\n"
        f"|---|---|{'---|' * (len(HEADS) + 1)}\n"
    )
    notes = []
    evidence = {"true": [], "false": []}
    for kind in wanted or KINDS:
        draw, recipes = KINDS[kind]
        counts = {name: Counter() for name in recipes}
        cost = Counter()
        for number in range(seed, seed + runs):
            scenario = draw(number)
            recording = in_memory(scenario)
            if number == seed:  # what is computed once is nobody's cost
                run_recipe(recording, load_recipe("vessel"))
            for name in recipes:
                begin = time.process_time()
                made = run_recipe(recording, recipe_of(name))
                cost[name] += time.process_time() - begin
                table = next(c for c in made if isinstance(c, Encounters))
                one = scores(scenario, table, evidence)
                counts[name].update(one)
                if one["passages"] > one["found"] or any(
                    one[head] for head in HEADS[3:]
                ):
                    notes.append(f"{kind} {number} {name}: {dict(one)}")
        for name in recipes:
            row = " | ".join(str(counts[name][head]) for head in HEADS)
            ratio = f"{cost[name] / cost['vessel']:.1f}" if cost["vessel"] else ""
            out.write(f"| {kind} | {name} | {row} | {ratio} |\n")
            out.flush()
    for truth, values in evidence.items():
        known = [value for value in values if np.isfinite(value)]
        told = np.quantile(known, SHARES) if known else []
        out.write(
            f"\nRest-frame evidence of {len(known)} {truth} rows with lines, at "
            f"{', '.join(map(str, SHARES))}: {', '.join(f'{v:.2f}' for v in told)}\n"
        )
    out.write("\n```text\n" + "\n".join(notes) + "\n```\n")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3]), *sys.argv[3:])
