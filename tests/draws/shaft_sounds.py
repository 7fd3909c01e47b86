"""How many teeth of slow shafts `auto` finds, and whether it names their spacing.

Shafts of 0.5 to 3.5 Hz, log-uniform, with 12 to 29 neighbouring multiples of 9 to 20 dB
in 1 Hz (every third to fifth 4 dB louder: the blades), far off and nearly steady, five
minutes each.
"""

import numpy as np


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
    vessel = {"name": "tanker", "source_depth_m": 5.0, "closest_approach": passage, "line": lines}
    sensor = {"id": "h1", "kind": "omni", "east_m": 0.0, "north_m": 0.0,
              "depth_m": 30.0, "sensitivity_db_re_v_per_upa": -165.0, "gain_db": 20.0,
              "adc_peak_v": 1.0}  # fmt: skip
    noise = {"density_db": 70.0, "reference_hz": 1000.0, "slope_db_per_decade": -8.0}
    return {
        "seed": int(rng.integers(2**31)), "duration_s": 300.0, "sample_rate_hz": 1000.0,
        "sound_speed_mps": 1500.0, "sensor": [sensor], "vessel": [vessel],
        "noise": noise,
    }, shaft_hz  # fmt: skip
