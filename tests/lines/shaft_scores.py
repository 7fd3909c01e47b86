"""How many teeth of slow shafts `auto` finds, and whether it names their spacing.

Shafts of 0.5 to 3.5 Hz, log-uniform, with 12 to 29 neighbouring multiples of 9 to 20 dB
in 1 Hz (every third to fifth 4 dB louder: the blades), far off and nearly steady, five
minutes each. ``python -m tests.lines.shaft_scores 12 0`` prints a line for each draw and
the counts with exact intervals.
"""

import sys

import numpy as np
from scipy.stats import binomtest

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import make_scenario, simulate_recordings


def draw(seed: int) -> tuple[dict, float]:
    """Return a scenario and the rate of its shaft."""
    rng = np.random.default_rng([991, seed])
    shaft_hz = float(np.exp(rng.uniform(np.log(0.5), np.log(3.5))))
    n_teeth, blades = int(rng.integers(12, 30)), int(rng.integers(3, 6))
    orders = int(rng.integers(3, 12)) + np.arange(n_teeth)
    lines = [
        {
            "frequency_hz": float(shaft_hz * order),
            "cn0_db_hz": float(rng.uniform(9, 16) + 4 * (order % blades == 0)),
        }
        for order in orders[shaft_hz * orders > 6.0]
    ]
    passage = {"time_s": 150.0, "horizontal_range_m": 4000.0, "speed_mps": 2.0,
               "course_deg": 80.0, "side": "port"}  # fmt: skip
    vessel = {"name": "tanker", "source_depth_m": 5.0, "closest_approach": passage,
              "line": lines}  # fmt: skip
    sensor = {"id": "h1", "kind": "omni", "east_m": 0.0, "north_m": 0.0,
              "depth_m": 30.0, "sensitivity_db_re_v_per_upa": -165.0, "gain_db": 20.0,
              "adc_peak_v": 1.0}  # fmt: skip
    noise = {"density_db": 70.0, "reference_hz": 1000.0, "slope_db_per_decade": -8.0}
    return {
        "seed": int(rng.integers(2**31)), "duration_s": 300.0, "sample_rate_hz": 1000.0,
        "sound_speed_mps": 1500.0, "sensor": [sensor], "vessel": [vessel],
        "noise": noise,
    }, shaft_hz  # fmt: skip


def score(seed: int) -> tuple[float, int, int, bool]:
    """Return shaft, teeth, teeth found, and whether a vessel of this spacing is told."""
    scenario, shaft_hz = draw(seed)
    (recording,) = simulate_recordings(make_scenario(scenario))
    made = run_recipe(recording, load_recipe("auto"))
    true_hz = [line["frequency_hz"] for line in scenario["vessel"][0]["line"]]
    found_hz = np.array([
        np.median(lines.frequency_hz[lines.line == one])
        for lines in made if isinstance(lines, Lines) for one in lines.line_id
    ])  # fmt: skip
    apart = np.abs(np.subtract.outer(true_hz, np.append(found_hz, np.inf)))
    n_found = int((apart.min(axis=1) < 0.15 * shaft_hz).sum())
    (presence,) = [item for item in made if isinstance(item, Presence)]
    is_named = np.abs(presence.spacing_hz - shaft_hz) < 0.02
    return shaft_hz, len(true_hz), n_found, bool(is_named.any())


def main(count: int, seed: int) -> None:
    """Print the table and its counts."""
    print("| seed | shaft Hz | teeth | found | spacing named |")
    print("|---|---|---|---|---|")
    rows = []
    for one in range(seed, seed + count):
        rows.append(score(one))
        shaft_hz, teeth, found, named = rows[-1]
        said = "yes" if named else "no"
        print(f"| {one} | {shaft_hz:.2f} | {teeth} | {found} | {said} |", flush=True)
    for low, high in ((0.5, 0.9), (0.9, 3.5)):
        part = [row for row in rows if low <= row[0] < high]
        if part:
            named = sum(row[3] for row in part)
            whole = sum(row[2] >= 0.9 * row[1] for row in part)
            held = binomtest(named, len(part)).proportion_ci(method="exact")
            print(
                f"{low} to {high} Hz: {named} of {len(part)} named "
                f"({100 * held.low:.0f} to {100 * held.high:.0f} %), nine in ten teeth "
                f"found in {whole}; {sum(row[2] for row in part)} of "
                f"{sum(row[1] for row in part)} teeth"
            )


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
