"""Real sound, not only ours: every recording ends with an honest result.

The folder comes from UWTRACK_REAL_DATA; without it these tests are skipped.
"""

import json
import os
from pathlib import Path

import pytest

FOLDER = Path(os.environ.get("UWTRACK_REAL_DATA", ""))
pytestmark = [
    pytest.mark.skipif(
        not os.environ.get("UWTRACK_REAL_DATA"), reason="UWTRACK_REAL_DATA is not set"
    )
]


def encounters(uwtrack, path, *words):
    done = uwtrack("run", path, "-o", "real.run.h5", "--json", *words)
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.mark.long
def test_the_train_passes_at_its_known_speed(uwtrack):
    """By `auto`, whose row is that of `vehicle` here; acceptance holds it, too."""
    path = FOLDER / "train" / "traindoppler.wav"
    (train,) = encounters(uwtrack, path, "--sound-speed-mps", 343)
    assert train["speed_mps"] == pytest.approx(34.1, rel=0.03)
    assert train["time_s"] == pytest.approx(9.60, abs=0.1)
    assert abs(train["speed_mps"] - 34.1) < 3 * train["speed_std_mps"]


@pytest.mark.slow
def test_electrical_hum_is_no_vessel(uwtrack):
    (path,) = (FOLDER / "orcasound").glob("*.flac")
    assert encounters(uwtrack, path) == []


def test_a_ship_that_does_not_pass_gives_lines_and_no_encounter(uwtrack):
    assert encounters(uwtrack, FOLDER / "ships" / "kennicott_31.wav") == []
    lines = json.loads(uwtrack("show", "real.run.h5", "lines", "--format", "json").stdout)
    assert lines


@pytest.mark.slow
def test_a_car_without_lines_gives_range_over_speed_alone(uwtrack):
    (path,) = (FOLDER / "cars").glob("*.wav")
    (car,) = encounters(uwtrack, path, "--sound-speed-mps", 340)
    assert car["status"] == "level-only"
    assert car["speed_mps"] is None
    assert car["reasons"]["speed_mps"]
    known_s = 6.0 / (30 * 0.44704)
    assert abs(car["range_over_speed_s"] - known_s) < 3 * car["range_over_speed_std_s"]
