"""Recordings of passages drawn by lot, from ranges fixed before anything was tuned.

5-15 knots, 80-500 m, either side, one to six lines, strong to weak; and by class: two
vessels, mono, a weak line without broadband, surface image, jitter of the shaft up to
1e-3, a passage cut short, a turn, noise only.
"""

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.simulate import make_scenario

CLASSES = (
    "plain", "two", "mono", "weak-line", "image", "jitter", "truncated", "turn", "noise",
)  # fmt: skip
BAND_OF = {
    "plain": "clean", "mono": "clean", "two": "hard", "weak-line": "hard",
    "image": "hard", "jitter": "robust", "truncated": "robust", "turn": "robust",
}  # fmt: skip
BANDS = {
    "clean": {"speed": 0.015, "range": 0.03, "width": 0.03, "time": 1.0, "course": 1.5},
    "hard": {"speed": 0.04, "range": 0.08, "width": 0.08, "time": 2.0, "course": 3.0},
    "robust": {"speed": 0.08, "range": 0.15, "width": 0.15, "time": 5.0, "course": 8.0},
}
LENGTH_S, RATE_HZ, DEPTH_M = 480.0, 2000.0, 25.0


def draw(kind, seed):
    """Return a scenario of a class."""
    rng = np.random.default_rng([seed, CLASSES.index(kind)])
    vessels = [] if kind == "noise" else [_vessel(kind, rng)]
    if kind == "two":
        other = _vessel(kind, rng)
        other["closest_approach"]["time_s"] = float(
            vessels[0]["closest_approach"]["time_s"] + rng.uniform(-60, 60)
        )
        vessels.append(other)
    mono = kind == "mono"
    return make_scenario({
            "seed": int(rng.integers(2**31)),
            "duration_s": LENGTH_S,
            "sample_rate_hz": RATE_HZ,
            "sensor": [
                {
                    "id": "h1", "kind": "omni" if mono else "difar",
                    "depth_m": DEPTH_M, "full_scale_db": 175.0,
                }
            ],
            "vessel": vessels,
            "noise": {"density_db": 70.0, "slope_db_per_decade": -10.0},
        },
    )  # fmt: skip


def _vessel(kind, rng):
    time = rng.uniform(0.4, 0.6) * LENGTH_S
    if kind == "truncated":
        time = LENGTH_S - rng.uniform(10.0, 40.0)
    count = 1 if kind == "weak-line" else int(rng.integers(1, 7))
    strength = rng.uniform(20, 23) if kind == "weak-line" else rng.uniform(22, 40)
    base = rng.uniform(25.0, 90.0)
    table = {
        "source_depth_m": 3.0,
        "surface_image": 0.9 if kind == "image" else 0.0,
        "closest_approach": {
            "time_s": float(time),
            "horizontal_range_m": float(rng.uniform(80.0, 500.0)),
            "speed_mps": float(rng.uniform(5.0, 15.0) * KNOT_MPS),
            "course_deg": float(rng.uniform(0.0, 360.0)),
            "side": str(rng.choice(["port", "starboard"])),
        },
        "line": [
            {
                "frequency_hz": float(base * number),
                "cn0_db_hz": float(strength - rng.uniform(0, 5)),
            }
            for number in range(2, 2 + count)
        ],
        "frequency_jitter": {
            "fraction": float(10 ** rng.uniform(-4, -3)) if kind == "jitter" else 0.0
        },
    }
    if kind != "weak-line":
        table["broadband"] = {
            "band_hz": [100.0, 900.0], "snr_db": float(rng.uniform(-5.0, 12.0))
        }  # fmt: skip
    if kind == "turn":
        table["turn"] = [
            {
                "at_s": float(time + rng.uniform(80, 120)),
                "course_deg": float(
                    table["closest_approach"]["course_deg"] + rng.choice([-60.0, 60.0])
                )
                % 360,
            }
        ]
    return table
