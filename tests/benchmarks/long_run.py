"""Run a long simulated recording through a recipe, and print what it cost as JSON.

Run as ``python -m tests.benchmarks.long_run HOURS PASSAGES RATE_HZ [RECIPE]``. The
sound is made block by block while it is read, so that neither disk nor memory holds
it; what making it costs is not counted.
"""

import json
import resource
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import Samples
from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import Scenario, make_scenario, simulate_recordings

HEARD_S = 160.0


@dataclass
class Metered:
    """A reader that takes the time of making the sound."""

    reader: object
    cpu_s: float = field(default=0.0)

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        blocks = self.reader(block_samples)
        while True:
            begin = time.process_time()
            block = next(blocks, None)
            self.cpu_s += time.process_time() - begin
            if block is None:
                return
            yield block


def scenario(hours: float, n_passages: int, rate_hz: float) -> Scenario:
    """Passages spread over the time, each heard for some minutes."""
    duration_s = 3600.0 * hours
    step_s = duration_s / max(n_passages, 1)
    rng = np.random.default_rng(7)
    vessels = []
    for k in range(n_passages):
        time_s = (k + 0.5) * step_s
        reach_s = min(HEARD_S, 0.45 * step_s)
        vessels.append(
            {
                "name": f"v{k + 1}",
                "sounding_s": [time_s - reach_s, time_s + reach_s],
                "closest_approach": {
                    "time_s": time_s,
                    "horizontal_range_m": float(rng.uniform(150, 300)),
                    "speed_mps": float(rng.uniform(5, 9)),
                    "course_deg": float(rng.uniform(0, 360)),
                    "side": "port",
                },
                "line": [
                    {"fundamental_hz": float(rng.uniform(30, 45)), "harmonics": 4,
                     "step_db": -1.0, "cn0_db_hz": 38.0},
                ],
                "broadband": {"band_hz": [80.0, 0.45 * rate_hz], "snr_db": 6.0},
            }
        )  # fmt: skip
    sensor = {"id": "h1", "kind": "difar", "depth_m": 22.0, "full_scale_db": 155.0,
              "east_m": 0.0, "north_m": 0.0}  # fmt: skip
    table = {
        "seed": 5, "duration_s": duration_s, "sample_rate_hz": rate_hz,
        "sensor": [sensor], "vessel": vessels,
        "noise": {"density_db": 70.0, "slope_db_per_decade": -17.0},
    }  # fmt: skip
    return make_scenario(table)


def main(hours: float, n_passages: int, rate_hz: float, recipe: str) -> dict:
    """Run the recipe, and return memory, processor time and encounters."""
    (recording,) = simulate_recordings(scenario(hours, n_passages, rate_hz))
    reader = Metered(recording.reader)
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UwtrackWarning)
        made = run_recipe(replace(recording, reader=reader), load_recipe(recipe))
    cpu_s = time.process_time() - begin - reader.cpu_s
    (encounters,) = [c for c in made if isinstance(c, Encounters)]
    claimed = np.isin(encounters.status, ["ok", "extrapolated", "level-only"])
    return {
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "cpu_s": cpu_s,
        "cpu_s_per_hour": cpu_s / hours,
        "simulation_cpu_s": reader.cpu_s,
        "times_s": encounters.time_s[claimed].tolist(),
        "statuses": encounters.status[claimed].tolist(),
    }


if __name__ == "__main__":
    asked = [float(word) for word in sys.argv[1:4]]
    chosen = sys.argv[4] if len(sys.argv) > 4 else "vessel"
    found = main(asked[0], int(asked[1]), asked[2], chosen)
    sys.stdout.write(json.dumps(found))
