"""A vessel without a line: told by its fringes, live as in the file."""

import json

import numpy as np
import pytest
import soundfile
from typer.testing import CliRunner

from uwtrack_cli.cli.app import app
from uwtrack_cli.simulate import make_scenario, simulate_recordings

RATE_HZ = 8000.0
TIME_S, WIDTH_S = 24.0, np.hypot(80.0, 23.5) / 10.0

VESSEL = {
    "name": "launch", "source_depth_m": 3.0, "surface_image": 0.9,
    "closest_approach": {
        "time_s": TIME_S, "horizontal_range_m": 80.0, "speed_mps": 10.0,
        "course_deg": 60.0, "side": "port",
    },
    "broadband": {"band_hz": [100.0, 3700.0], "snr_db": 0.0},
}  # fmt: skip
SENSOR = {"id": "f1", "kind": "omni", "depth_m": 26.0, "full_scale_db": 150.0}


@pytest.mark.long
def test_a_passage_told_by_fringes_is_the_same_live_and_in_the_file(tmp_path, uwtrack):
    (recording,) = simulate_recordings(
        make_scenario({
            "seed": 5, "duration_s": 50.0, "sample_rate_hz": RATE_HZ,
            "sensor": [SENSOR], "vessel": [VESSEL], "noise": {"density_db": 70.0},
        })
    )  # fmt: skip
    sound = np.concatenate(list(recording.reader(1 << 16)))
    path = tmp_path / "pass.wav"
    soundfile.write(path, sound, int(RATE_HZ), "PCM_16")
    words = ["run", "-", "--json", "-o", str(tmp_path / "live.h5")]
    live = CliRunner().invoke(app, words, input=path.read_bytes())
    assert live.exit_code == 0, live.output
    events = [json.loads(line) for line in live.stdout.splitlines()]
    last = [one for one in events if one["event"] == "encounter"][-1]
    done = uwtrack("run", path, "--json", "-o", tmp_path / "file.h5")
    (row,) = json.loads(done.stdout)
    assert (last["status"], last["final"]) == ("no-speed", True)
    for name in ("time_s", "time_std_s", "range_over_speed_s", "probability"):
        assert last[name] == row[name]
    assert abs(row["time_s"] - TIME_S) < 3.0 * row["time_std_s"]
    off_s = abs(row["range_over_speed_s"] - WIDTH_S)
    assert off_s < 3.0 * row["range_over_speed_std_s"]
    same = uwtrack("diff", tmp_path / "live.h5", tmp_path / "file.h5")
    assert same.exit_code == 0, same.output
