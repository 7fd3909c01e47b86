"""Several sensors: fused by the recipe's own step, and refused before the work."""

import json

import pytest

from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.files.hdf5.product import read_product

START = ("--start-utc", "2024-05-02T06:30:00Z")


@pytest.fixture
def two(uwtrack):
    assert uwtrack("sample", "two-sensors").exit_code == 0
    return ["two-sensors-h1.wav", "two-sensors-h2.wav"]


def test_two_sensors_agree_on_one_track_near_the_truth(two_sensors_run):
    with read_product(two_sensors_run / "two-sensors-h1.fixes.h5") as product:
        fixes = product.read(Fixes)
    truth = json.loads((two_sensors_run / "two-sensors.truth.json").read_text())
    track = truth["vessels"][0]["track"]
    for k, time_s in enumerate(fixes.time_s):
        second = round(float(time_s))
        error_m = [
            fixes.east_m[k] - track["east_m"][second],
            fixes.north_m[k] - track["north_m"][second],
        ]
        # half a second of rounding at 7.2 m/s, and four deviations
        allowed = 3.6 + 4 * max(fixes.covariance_m2[k].diagonal()) ** 0.5
        assert max(map(abs, error_m)) < allowed


@pytest.mark.slow
def test_options_of_the_recipes_own_step_are_used_and_once_more_in_a_rerun(
    uwtrack, two_sensors_run
):
    fused = two_sensors_run / "two-sensors-h1.fixes.h5"
    with read_product(fused) as product:
        assert product.read(Fixes).time_s.size > 4
        assert product.history[-1].options["every_s"] == 20.0
    assert uwtrack("rerun", fused, "-o", "again.h5").exit_code == 0
    assert uwtrack("diff", fused, "again.h5").exit_code == 0


@pytest.mark.slow
def test_runs_of_two_sensors_are_read_as_one_and_made_again(uwtrack, two_sensors_run):
    runs = [two_sensors_run / f"two-sensors-h{k}.run.h5" for k in (1, 2)]
    assert uwtrack("cpa", *runs, "-o", "both.h5").exit_code == 0
    with read_product("both.h5") as product:
        assert set(product.read(Presence).sensor.tolist()) == {"h1", "h2"}
        assert product.read(Encounters).sensor.tolist() == ["h1", "h2"]
        assert set(product.read(Fixes).sensors.tolist()) == {"h1", "h2"}
    source = ("--source", two_sensors_run)
    assert uwtrack("rerun", "both.h5", *source, "-o", "once.h5").exit_code == 0
    assert uwtrack("diff", "both.h5", "once.h5").exit_code == 0


def test_an_existing_fused_file_is_refused_before_the_work(uwtrack, two, tmp_path):
    (tmp_path / "two-sensors-h1.fixes.h5").write_text("precious")
    done = uwtrack("run", *two, *START)
    assert done.exit_code == 1
    assert "--overwrite" in done.stderr
    assert not (tmp_path / "two-sensors-h1.run.h5").exists()
