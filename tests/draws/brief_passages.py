"""Passages of seconds to a minute, of small craft and vehicles, and slow weak vessels."""

from dataclasses import replace
from functools import cache

import numpy as np

from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import make_scenario, simulate_recordings

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


def car():
    """Return a short recording of a loud car."""
    return brief_passage(
        3, speed_mps=(25.0, 26.0), range_m=(6.0, 6.5), base_hz=(100.0, 110.0),
        length_s=16.0, sound_speed_mps=343.0,
    )  # fmt: skip


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
