"""Small scenarios for the tests, as the tables that a file would hold."""

import numpy as np

from uwtrack_cli.simulate import make_scenario, simulate_recordings

OMNI = {"id": "h1", "depth_m": 22.0, "full_scale_db": 180.0}
DIFAR = OMNI | {"kind": "difar"}
TONE = {"frequency_hz": 126.0, "source_level_db": 170.0}
PASSAGE = {
    "time_s": 30.0,
    "horizontal_range_m": 100.0,
    "speed_mps": 8.0,
    "course_deg": 81.0,
    "side": "port",
}


def vessel(**changes):
    """Return a vessel with one line and no broadband sound."""
    table = {"closest_approach": PASSAGE, "line": [TONE]} | changes
    return {key: value for key, value in table.items() if value is not None}


def scene(**changes):
    """Return a scenario of a minute at 1 kHz: one omni sensor, nothing else."""
    table = {"seed": 7, "duration_s": 60.0, "sample_rate_hz": 1000.0, "sensor": [OMNI]}
    return make_scenario(table | changes)


def listen(scenario, number=0, block_samples=50_000):
    """Return all samples of a sensor in uPa, shape (sample, channel)."""
    recording = simulate_recordings(scenario)[number]
    blocks = list(recording.reader(block_samples))
    scale = scenario.sensors[number].full_scale_upa
    return np.concatenate(blocks).astype(np.float64) * scale
