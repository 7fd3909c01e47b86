"""The commands about files, as a shell pipeline uses them."""

import csv
import io
import json
import shutil

import numpy as np
import pytest
import soundfile
from typer import Exit


@pytest.fixture
def product(short_run, tmp_path):
    shutil.copy(short_run, tmp_path / "pass.run.h5")
    return "pass.run.h5"


def test_the_encounters_as_json_have_the_promised_keys(uwtrack, product):
    done = uwtrack("show", product, "encounters", "--format", "json")
    (row,) = json.loads(done.stdout)
    assert {
        "contact", "sensor", "status", "time_utc", "time_s", "time_std_s",
        "arrival_time_s", "speed_mps", "speed_std_mps", "slant_range_m",
        "slant_range_std_m", "horizontal_range_m", "range_over_speed_s",
        "range_over_speed_std_s", "course_deg", "course_std_deg", "bearing_deg",
        "bearing_std_deg", "side", "rest_frequencies_hz", "rest_frequencies_std_hz",
        "sound_speed_mps", "received_level_db", "extrapolated", "ambiguities", "reasons",
    } <= set(row)  # fmt: skip
    assert row["time_utc"] is None
    assert "start time" in row["reasons"]["time_utc"]


def test_the_sample_passage_is_found_within_the_bands_of_a_clean_recording(
    uwtrack, samples, pass_run
):
    done = uwtrack("show", pass_run, "encounters", "--format", "json")
    (row,) = json.loads(done.stdout)
    truth = json.loads((samples / "pass.truth.json").read_text())["encounters"][0]
    assert row["status"] == "ok"
    assert row["side"] == truth["side"] == "port"
    assert row["time_s"] == pytest.approx(truth["time_s"], abs=1.0)
    assert row["speed_mps"] == pytest.approx(truth["speed_mps"], rel=0.015)
    assert row["slant_range_m"] == pytest.approx(truth["slant_range_m"], rel=0.03)
    assert row["course_deg"] == pytest.approx(truth["course_deg"], abs=1.5)
    assert row["time_utc"].startswith("2024-05-01T12:02:28")
    assert abs(row["speed_mps"] - truth["speed_mps"]) < 4 * row["speed_std_mps"]
    assert abs(row["slant_range_m"] - truth["slant_range_m"]) < 4 * row["slant_range_std_m"]


@pytest.mark.parametrize("form", ["csv", "json", "jsonl", "table"])
@pytest.mark.parametrize("container", ["encounters", "lines", "levels", "sensor"])
def test_every_container_is_shown_in_every_form(uwtrack, product, container, form):
    done = uwtrack("show", product, container, "--format", form)
    assert done.exit_code == 0
    assert done.stderr == ""
    if form == "csv":
        rows = list(csv.reader(io.StringIO(done.stdout)))
        assert len({len(row) for row in rows}) == 1
    elif form == "jsonl":
        assert [json.loads(line) for line in done.stdout.splitlines()]
    elif form == "json":
        json.loads(done.stdout)


def test_info_names_containers_units_and_history(uwtrack, product):
    text = uwtrack("info", product, "-v").stdout
    assert "lines of h1" in text
    assert "frequency_hz [Hz]" in text
    assert "window_s=1.0" in text
    facts = json.loads(uwtrack("info", product, "--json").stdout)
    assert facts["history"][0]["sources"][0]["name"] == "pass.wav"
    assert len(facts["sha256"]) == 64


def test_info_fits_ten_lines(uwtrack, product, short_pass):
    lines = uwtrack("info", product).stdout.splitlines()
    assert len(lines) <= 10
    facts = dict(line.split(": ", 1) for line in lines)
    assert facts["sound"] == "pass.wav, 2 min 0 s at 2000 Hz, 3 channels"
    assert facts["start"].startswith("not known")
    assert facts["gaps"] == "none"
    assert facts["levels"] == "dB re 1 uPa"
    assert facts["passages"] == "1 (1 ok)"
    assert "depth 22 m" in facts["sensor"]
    sound = uwtrack("info", short_pass).stdout.splitlines()
    assert sound[1:4] == [lines[1], lines[2], lines[4]]
    refused = uwtrack("info", short_pass, "--json")
    assert (refused.exit_code, "--json describes result files" in refused.stderr) == (2, True)


def test_info_of_a_folder_tells_what_follows(uwtrack, tmp_path):
    (tmp_path / "day").mkdir()
    for minute in (0, 1, 3):
        path = tmp_path / "day" / f"h1_20240501_12{minute:02d}00.wav"
        soundfile.write(path, np.zeros(60_000), 1000)
    first, follows = uwtrack("info", "day").stdout.splitlines()
    assert first == "day: 3 recordings"
    assert "3 files from h1_20240501_120000.wav on" in follows
    assert "with 1 gap of 60.0 s together: --join" in follows


def test_info_of_a_joined_recording_tells_its_gaps(uwtrack, tmp_path):
    rng = np.random.default_rng(5)
    (tmp_path / "day").mkdir()
    for second in (0, 30):
        path = tmp_path / "day" / f"h1_20240501_1200{second:02d}.wav"
        soundfile.write(path, 0.1 * rng.standard_normal(20_000), 1000)
    done = uwtrack("batch", "day", "-o", "out", "--join", "--jobs", 1)
    assert done.exit_code == 0, done.output
    text = uwtrack("info", "out/h1_20240501_120000.run.h5").stdout
    assert "gaps: 1 of 10.0 s together, between 2 files" in text
    assert "start: 2024-05-01 12:00:00.000 UTC" in text
    assert "levels: dB re full scale; not calibrated" in text


def test_verify_tells_a_sound_file_from_a_damaged_one(uwtrack, product, tmp_path):
    assert uwtrack("verify", product).stdout == "pass.run.h5: ok\n"
    damaged = bytearray((tmp_path / product).read_bytes())
    middle = len(damaged) // 2
    damaged[middle : middle + 64] = bytes(64)
    (tmp_path / "damaged.h5").write_bytes(damaged)
    done = uwtrack("verify", product, "damaged.h5")
    assert done.exit_code == 1
    assert "damaged.h5: ok" not in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_a_page_is_drawn(uwtrack, product, tmp_path, suffix):
    assert uwtrack("plot", product, "-o", f"pass.{suffix}").exit_code == 0
    assert (tmp_path / f"pass.{suffix}").stat().st_size > 20_000


@pytest.mark.slow
def test_a_product_comes_through_a_pipe_and_goes_on_through_one(uwtrack, product, tmp_path):
    data = (tmp_path / product).read_bytes()
    done = uwtrack("cpa", "-", input=data)
    assert done.exit_code == 0
    (tmp_path / "piped.h5").write_bytes(done.stdout_bytes)
    (tmp_path / "file.h5").write_bytes(data)
    assert uwtrack("cpa", "file.h5", "-o", "filed.h5").exit_code == 0
    piped, filed = (
        uwtrack("show", name, "encounters", "--format", "json").stdout
        for name in ("piped.h5", "filed.h5")
    )
    assert piped == filed


def test_recipes_are_listed_and_shown_with_every_default(uwtrack):
    assert "vessel" in uwtrack("recipes").stdout
    text = uwtrack("recipes", "--show", "vessel").stdout
    assert "false_alarm_probability = 0.0001" in text
    assert "[track.feedback]" in text


def test_samples_are_listed_and_copied(uwtrack, tmp_path):
    assert "pass" in uwtrack("sample").stdout.split()
    assert uwtrack("sample", "noise", "-o", "here").exit_code == 0
    assert (tmp_path / "here" / "noise.wav").exists()
    assert (tmp_path / "here" / "noise.truth.json").exists()
    again = uwtrack("sample", "noise", "-o", "here")
    assert again.exit_code == 1
    assert "--overwrite" in again.stderr


def test_a_scenario_is_simulated_with_its_truth(uwtrack, tmp_path):
    (tmp_path / "s.toml").write_text(
        "seed = 1\nduration_s = 5.0\nsample_rate_hz = 1000.0\n"
        'sound_speed_mps = 1500.0\n[[sensor]]\nid = "a"\ndepth_m = 10.0\nfull_scale_db = 140.0\n'
        "[noise]\ndensity_db = 60.0\n"
    )
    done = uwtrack("simulate", "s.toml", "-o", "s.wav")
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "s.truth.json").read_text())["encounters"] == []
    assert (tmp_path / "s.sensor.toml").exists()


def test_the_version_is_data(uwtrack):
    assert uwtrack("--version").stdout.startswith("uwtrack 0.")


def test_quiet_says_nothing(uwtrack, noise_wav):
    done = uwtrack("run", noise_wav, "-q")
    assert done.exit_code == 0
    assert done.output == ""


@pytest.mark.slow
def test_an_interrupt_that_python_could_not_pass_on_is_not_lost():
    import gc
    import signal
    import time
    import weakref

    from uwtrack_cli.cli.console import guard

    class Thing:
        pass

    def interrupt_here(_):
        signal.raise_signal(signal.SIGINT)

    def work():
        thing = Thing()
        watch = weakref.ref(thing, interrupt_here)
        with guard(debug=False):
            del thing
            gc.collect()
            assert watch() is None
            time.sleep(5.0)

    gc.collect()  # an interrupt must not meet what other tests have left to be closed
    with pytest.raises(Exit) as done:
        work()
    assert done.value.exit_code == 130


def test_a_table_comes_through_standard_input_as_from_a_file(uwtrack, tmp_path):
    time = np.arange(-60.0, 61.0, 2.0)
    shift = -5.0 / 1500.0 * 5.0 * time / np.sqrt(150.0**2 + (5.0 * time) ** 2)
    rows = [f"{t + 60:g},{100.0 * (1 + s):.6f},0.01" for t, s in zip(time, shift, strict=True)]
    text = "time_s,frequency_hz,frequency_std_hz\n" + "\n".join(rows) + "\n"
    (tmp_path / "series.csv").write_text(text)
    made = [
        uwtrack("cpa", source, "-o", name, "--json", input=text)
        for source, name in (("series.csv", "a.h5"), ("-", "b.h5"))
    ]
    assert [done.exit_code for done in made] == [0, 0]
    assert made[0].stdout == made[1].stdout
    assert '"status": "ok"' in made[0].stdout
    shown = uwtrack("show", "b.h5", "series", "--format", "csv").stdout
    again = uwtrack("cpa", "-", "-o", "c.h5", "--json", input=shown)
    assert again.stdout == made[0].stdout
