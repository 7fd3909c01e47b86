"""A recorder's folder: every passage once, whatever became of single files."""

import csv
import json
import os
import shutil
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import soundfile

from uwtrack_cli.flow.batch_sources import find_recordings, make_jobs
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import make_scenario, simulate_recordings

RATE, FILE_S, N_FILES = 1000, 20, 32
TIMES_S = (100.0, 300.3, 520.0)
"""Closest approaches of three vessels; midnight is at 300 s."""
START = datetime(2024, 5, 1, 23, 55)  # noqa: DTZ001 - the recorder's own clock
BATCH = ("--join", "--jobs", 1, "--sensor", "m1.toml", "--recipe", "vessel")


def name(k):
    return f"m1_{START + timedelta(seconds=FILE_S * k):%Y%m%d_%H%M%S}.wav"


@pytest.fixture(scope="session")
def day(tmp_path_factory):
    """A day of short files, a hundredth of a day long; each vessel has gone by the next."""
    vessels = [
        {
            "name": f"v{k}",
            "source_depth_m": 3.0,
            "closest_approach": {
                "time_s": time_s, "horizontal_range_m": 60.0 + 5.0 * k,
                "speed_mps": 5.0 + 0.5 * k, "course_deg": 200.0, "side": "starboard",
            },
            "line": [
                {"frequency_hz": float(f), "cn0_db_hz": 18.0}
                for f in (60 + 11 * k, 150 + 13 * k, 300 + 17 * k)
            ],
            "broadband": {"band_hz": [80.0, 450.0], "snr_db": 3.0,
                          "slope_db_per_decade": -20.0},
        }
        for k, time_s in enumerate(TIMES_S)
    ]  # fmt: skip
    table = {
        "seed": 7, "duration_s": float(FILE_S * N_FILES), "sample_rate_hz": float(RATE),
        "sensor": [{"id": "m1", "depth_m": 15.0, "full_scale_db": 145.0}],
        "vessel": vessels,
        "noise": {"density_db": 70.0, "reference_hz": 1000.0,
                  "slope_db_per_decade": -17.0},
    }  # fmt: skip
    (recording,) = simulate_recordings(make_scenario(table))
    sound = np.concatenate(list(recording.reader(1 << 16)))
    folder = tmp_path_factory.mktemp("recorder") / "day"
    folder.mkdir()
    n = FILE_S * RATE
    for k in range(N_FILES):
        soundfile.write(folder / name(k), sound[n * k : n * (k + 1)], RATE, "PCM_16")
    return folder


@pytest.fixture
def recorder(uwtrack, tmp_path):
    """The command, beside the sensor's file."""
    (tmp_path / "m1.toml").write_text('id = "m1"\ndepth_m = 15.0\nfull_scale_db = 145\n')
    return uwtrack


def seconds_of_passages(uwtrack, folder):
    done = uwtrack("passages", folder, "--to", "json", "--fresh")
    assert done.exit_code == 0, done.output
    times = [row["time_utc"] for row in json.loads(done.stdout)]
    zone = [datetime.fromisoformat(text).replace(tzinfo=None) for text in times]
    return [(time - START).total_seconds() for time in zone]


@pytest.mark.slow
def test_a_day_has_a_row_for_each_vessel_also_at_midnight(recorder, day, tmp_path):
    (tmp_path / "day").mkdir()
    for k in range(22):  # the third vessel is not there yet
        (tmp_path / "day" / name(k)).symlink_to(day / name(k))
    words = ["--per", "day", "--overlap-s", 100]
    done = recorder("batch", "day", "-o", "out", *BATCH, *words)
    assert done.exit_code == 0, done.output
    assert "22 files from m1_20240501_235500.wav on follow each other" in done.stderr
    assert "2 done; 2 passages" in done.stderr
    found = seconds_of_passages(recorder, "out")
    assert found == pytest.approx(TIMES_S[:2], abs=1.5)
    counted = recorder("passages", "out", "--per", "day", "--to", "csv").stdout
    assert counted.splitlines() == [
        "day,passages,hours,passages_per_hour",
        "2024-05-01,1,0.083,12",  # 300 of 440 s
        "2024-05-02,1,0.039,25.714",
    ]
    assert recorder("report", "out", "-o", "out.html").exit_code == 0
    assert "2 passages in 0.1 hours of sound" in Path("out.html").read_text()
    part = "out/m1_2024-05-02.run.h5"
    again = recorder("rerun", part, "--source", "day", "-o", "again.h5")
    assert again.exit_code == 0, again.output
    assert recorder("diff", part, "again.h5").exit_code == 0


@pytest.mark.slow
def test_bad_files_and_a_clock_set_back_cost_no_passage(recorder, day, tmp_path):
    bad = tmp_path / "bad"
    shutil.copytree(day, bad)
    with (bad / name(9)).open("r+b") as file:
        file.truncate(20_000)
    (bad / name(19)).unlink()
    (bad / name(30)).write_bytes(b"no sound")
    for k in range(23, N_FILES):  # from here on the clock is 47 s late
        late = START + timedelta(seconds=FILE_S * k - 47)
        (bad / name(k)).rename(bad / f"m1_{late:%Y%m%d_%H%M%S}.wav")
    done = recorder("batch", bad, "-o", "out", *BATCH)
    assert done.exit_code == 3
    assert "22 files" in done.stderr
    assert "with 2 gaps of 30.0 s together" in done.stderr
    assert "begins 47.0 s before" in done.stderr
    with (tmp_path / "out" / "batch.csv").open(newline="") as file:
        rows = {row["source"].rpartition("/")[2]: row for row in csv.DictReader(file)}
    status = [row["status"] for row in rows.values()]
    assert sorted(status) == ["done", "done", "failed", "truncated"]
    assert "9.978 s are there" in rows[name(9)]["message"]
    late = [time - (47.0 if time > 460.0 else 0.0) for time in TIMES_S]
    found = seconds_of_passages(recorder, "out")
    assert found == pytest.approx(sorted(late), abs=1.5)


def test_a_new_file_costs_its_own_part(recorder, tmp_path):
    (tmp_path / "in").mkdir()
    rng = np.random.default_rng(3)
    for k in range(13, 18):
        sound = 0.1 * rng.standard_normal(FILE_S * RATE)
        soundfile.write(tmp_path / "in" / name(k), sound, RATE, "PCM_16")
    options = BATCH[1:]
    words = ["batch", "in", "-o", "out", *BATCH]
    words += ["--per", "day", "--overlap-s", 30]
    assert recorder(*words).exit_code == 0
    soundfile.write(tmp_path / "in" / name(18), sound, RATE, "PCM_16")
    done = recorder(*words, "--resume", "--json")
    assert done.exit_code == 0, done.output
    status = {row["target"]: row["status"] for row in json.loads(done.stdout)}
    assert status == {"m1_2024-05-01.run.h5": "resumed", "m1_2024-05-02.run.h5": "done"}
    alone = recorder("batch", "in", "-o", "apart", *options, "--json")
    assert "--join makes one recording of them" in alone.stderr
    assert len(json.loads(alone.stdout)) == 6


def test_a_sensor_file_that_is_missing_is_told_once_before_the_work(recorder, day, tmp_path):
    done = recorder("batch", day, "-o", "out", "--sensor", "none.toml")
    assert done.exit_code == 1
    assert done.stderr.strip() == "error: none.toml does not exist."
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("recorder")
def test_what_a_job_reads_is_named_from_everywhere(day, tmp_path):
    """A worker of a cluster has another working directory."""
    options = {"sensor": Path("m1.toml"), "time_zone": "UTC"}
    found = find_recordings([Path(os.path.relpath(day))])
    jobs = make_jobs(found, Path("out"), load_recipe("vessel"), options)
    assert len(jobs) == N_FILES
    for job in jobs:
        assert job.options == {"sensor": tmp_path / "m1.toml", "time_zone": "UTC"}
        assert all(path.is_absolute() for path in (*job.sources, job.target))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--per", "day"], "go with --join"),
        (["--join", "--overlap-s", 10], "--overlap-s goes with --per"),
        (["--join", "--per", "day", "--overlap-s", -1], "must be 0 or more"),
        (["--time-zone", "Mars/Olympus"], "unknown time zone 'Mars/Olympus'"),
        (["--time-pattern", "names"], "unknown time pattern 'names'"),
    ],
)
def test_what_suits_no_file_is_refused_once(recorder, day, words, said, tmp_path):
    done = recorder("batch", day, "-o", "out", *words)
    assert done.exit_code == 2
    assert said in done.stderr
    assert done.stderr.count("error") == 1
    assert not (tmp_path / "out").exists()
