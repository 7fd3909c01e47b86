"""`score` and `diff` at the shell: what CI relies on."""

import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner


@pytest.fixture(scope="session")
def runs(tmp_path_factory, short_pass, timed_run, pass_run):
    """The sample passage, its middle, and that with a source depth that is another."""
    from uwtrack_cli.cli.app import app

    folder = tmp_path_factory.mktemp("runs")
    shutil.copy(pass_run, folder / "one.h5")
    shutil.copy(timed_run, folder / "short.h5")
    words = ["run", str(short_pass), "--start-utc", "2024-05-01T12:01:30Z"]
    words += ["-q", "-o", str(folder / "depth.h5")]
    done = CliRunner().invoke(app, [*words, "--set", "cpa.source_depth_m=4"])
    assert done.exit_code == 0, done.output
    return folder


def test_a_sample_passes_its_score(uwtrack, runs, samples, tmp_path):
    (tmp_path / "t.toml").write_text(
        "[encounters]\nmissed = 0\nfalse = 0\nside = {}\n"
        "time_s = { error = 1.0, sigmas = 4 }\n"
        "speed_mps = { percent = 1.5, sigmas = 4 }\n"
        "slant_range_m = { percent = 3.0, sigmas = 4 }\n"
        "course_deg = { error = 1.5 }\n"
        "rest_frequency_hz = { error = 0.05 }\n"
        "[fixes]\ngospa_m = { error = 20 }\nposition_m = { sigmas = 4 }\n"
    )
    words = ["score", runs / "one.h5", "--truth", samples / "pass.truth.json"]
    done = uwtrack(*words, "--tolerance", "t.toml", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert {row["quantity"] for row in found["scores"]} >= {
        "time_s", "speed_mps", "slant_range_m", "course_deg", "bearing_deg", "side",
        "rest_frequency_hz[63]", "position_m",
    }  # fmt: skip
    assert found["identities"][0]["vessel"] == "ferry (1)"
    table = uwtrack(*words)
    assert table.stdout == ""
    assert "sigmas" in table.stderr
    assert "GOSPA" in table.stderr


def test_a_score_outside_its_limits_ends_with_four(uwtrack, runs, samples, tmp_path):
    (tmp_path / "t.toml").write_text("[encounters]\nspeed_mps = { error = 1e-9 }\n")
    done = uwtrack(
        "score", runs / "one.h5", "--truth", samples / "pass.truth.json",
        "--tolerance", "t.toml", "-q",
    )  # fmt: skip
    assert done.exit_code == 4
    assert "outside: contact 1 of h1, speed_mps: error" in done.stderr


def test_a_missed_vessel_ends_with_four(uwtrack, runs, samples, tmp_path):
    truth = json.loads((samples / "pass.truth.json").read_text())
    truth["encounters"][0]["time_s"] = 20.0
    (tmp_path / "other.truth.json").write_text(json.dumps(truth))
    (tmp_path / "t.toml").write_text("[encounters]\nmissed = 0\nfalse = 0\n")
    done = uwtrack("score", runs / "one.h5", "--truth", "other.truth.json", "--tolerance", "t.toml")
    assert done.exit_code == 4
    assert "missed: ferry (1)" in done.stderr
    assert "1 encounters false, 0 accepted" in done.stderr


def test_the_same_run_has_the_same_numbers(uwtrack, runs):
    done = uwtrack("diff", runs / "one.h5", runs / "one.h5")
    assert done.exit_code == 0
    assert done.stdout == ""


def test_a_changed_option_shows_in_the_numbers(uwtrack, runs):
    done = uwtrack("diff", runs / "short.h5", runs / "depth.h5")
    assert done.exit_code == 4
    assert "encounters.slant_range_m" in done.stdout
    rows = json.loads(uwtrack("diff", runs / "short.h5", runs / "depth.h5", "--json").stdout)
    kinds = {row["container"] for row in rows}
    assert kinds == {"encounters", "fixes", "presence", "radiated"}
    files = runs / "short.h5", runs / "depth.h5"
    near = uwtrack("diff", *files, "--atol", 1, "--rtol", 1)
    assert near.exit_code == 0


@pytest.mark.parametrize("wrong", [["--rtol", "-1"], ["--atol", "nan"]], ids=str)
def test_a_tolerance_below_zero_is_a_usage_error(uwtrack, runs, wrong):
    assert uwtrack("diff", runs / "one.h5", runs / "one.h5", *wrong).exit_code == 2


def test_a_truth_that_is_none_is_refused(uwtrack, runs, tmp_path):
    (tmp_path / "x.json").write_text("[1, 2]")
    done = uwtrack("score", runs / "one.h5", "--truth", "x.json")
    assert done.exit_code == 1
    assert "no truth file" in done.stderr


def test_a_table_with_times_and_its_sensor_is_scored_against_ais(uwtrack, tmp_path):
    """A vessel at 6 m/s passes 200 m north of 35 N 128.5 E; the table is in UTC."""
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, 300.0, 2.0)
    east_m = 6.0 * (time_s - 150.0)
    closing = 6.0 * east_m / np.hypot(200.0, east_m)
    frequency_hz = 150.0 * (1.0 - closing / 1500.0) + 0.01 * rng.normal(size=150)
    bearing_deg = np.degrees(np.arctan2(east_m, 200.0)) + rng.normal(size=150)
    utc = [f"2024-05-01T12:{int(t) // 60:02d}:{int(t) % 60:02d}Z" for t in time_s]
    heads = "time_utc,bearing_deg,bearing_std_deg,frequency_hz,frequency_std_hz"
    rows = zip(utc, bearing_deg % 360.0, frequency_hz, strict=True)
    lines = [f"{t},{b:.3f},1,{f:.4f},0.01" for t, b, f in rows]
    (tmp_path / "t.csv").write_text("\n".join([heads, *lines]))
    (tmp_path / "m1.toml").write_text(
        'id = "m1"\nlatitude = 35.0\nlongitude = 128.5\ndepth_m = 20.0\n'
    )
    lines = [
        f"123456789,{t},{35.0 + 200.0 / 110_940.0:.7f},{128.5 + x / 91_290.0:.7f},11.66,90"
        for t, x in list(zip(utc, east_m, strict=True))[::15]
    ]
    heads = "mmsi,time_utc,latitude,longitude,speed_kn,course_deg"
    (tmp_path / "ais.csv").write_text("\n".join([heads, *lines]))
    made = uwtrack("cpa", "t.csv", "--sensor", "m1.toml", "-o", "e.h5")
    assert made.exit_code == 0, made.output
    (row,) = json.loads(uwtrack("show", "e.h5", "encounters", "--format", "json").stdout)
    assert row["sensor"] == "m1"
    assert row["horizontal_range_m"] == pytest.approx(200.0, abs=10.0)
    found = json.loads(uwtrack("score", "e.h5", "--truth", "ais.csv", "--json").stdout)
    errors = {one["quantity"]: one["sigmas"] for one in found["scores"]}
    assert abs(errors["speed_mps"]) < 4.0
    assert abs(errors["time_s"]) < 4.0
    named = uwtrack("passages", "e.h5", "--ais", "ais.csv", "--fresh", "--to", "json")
    assert json.loads(named.stdout)[0]["mmsi"] == "123456789"
    assert uwtrack("rerun", "e.h5", "-o", "again.h5").exit_code == 0
    assert uwtrack("diff", "e.h5", "again.h5").exit_code == 0
    # a table that says in its rows where it was heard needs no sensor file
    lines = (tmp_path / "t.csv").read_text().splitlines()
    placed = [f"{lines[0]},sensor,sensor_latitude,sensor_longitude"]
    placed += [f"{line},m2,35.0,128.5" for line in lines[1:]]
    (tmp_path / "p.csv").write_text("\n".join(placed))
    assert uwtrack("cpa", "p.csv", "-o", "p.h5").exit_code == 0
    found = json.loads(uwtrack("score", "p.h5", "--truth", "ais.csv", "--json").stdout)
    assert {one["quantity"] for one in found["scores"]} >= {"speed_mps", "time_s"}
    named = uwtrack("passages", "p.h5", "--ais", "ais.csv", "--fresh", "--to", "json")
    assert json.loads(named.stdout)[0]["mmsi"] == "123456789"
    assert uwtrack("rerun", "p.h5", "-o", "p_again.h5").exit_code == 0
    assert uwtrack("diff", "p.h5", "p_again.h5").exit_code == 0
    refused = uwtrack("cpa", "e.h5", "--sensor", "m1.toml", "-o", "x.h5")
    assert "belongs to a table; result files have their own" in refused.stderr
