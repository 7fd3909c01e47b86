"""What is given is used or refused, and what is left out is said."""

import csv
import json

import numpy as np
import pytest
import soundfile
import xarray as xr

from uwtrack_cli import find_sensor, read_product
from uwtrack_cli.cli.console import say_wrote
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import RecordedFiles
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import write_product
from uwtrack_cli.flow.concatenate import join_recordings
from uwtrack_cli.flow.sources import open_with_options


@pytest.fixture(scope="session")
def omni(tmp_path_factory, samples):
    """The result of one hydrophone at a known place: a passage without a position."""
    from typer.testing import CliRunner

    from uwtrack_cli.cli.app import app

    folder = tmp_path_factory.mktemp("omni")
    facts = (samples / "mono.sensor.toml").read_text()
    lines = [li for li in facts.splitlines() if not li.startswith(("east", "north"))]
    plan = folder / "m1.toml"
    plan.write_text("\n".join(["latitude = 35.0", "longitude = 128.5", *lines]) + "\n")
    path = folder / "mono.run.h5"
    words = ["run", samples / "mono.wav", "--sensor", plan, "-o", path, "-q"]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return path


def test_a_joined_recording_is_exported_to_netcdf(uwtrack, tmp_path):
    parts = []
    for k in range(2):
        path = tmp_path / f"h1_20240501_1200{20 * k:02d}.wav"
        soundfile.write(path, np.zeros(20_000), 1000)
        path.with_suffix(".sensor.toml").write_text('id = "h1"\n')
        parts.append(open_with_options(path, {}))
    recording, files = join_recordings(parts)
    write_product(tmp_path / "day.run.h5", [recording, recording.sensor, files])
    done = uwtrack("export", "day.run.h5", "--to", "netcdf", "-o", "day.nc")
    assert done.exit_code == 0, done.output
    with xr.open_dataset("day.nc", engine="h5netcdf") as data:
        expected = np.array(files.start_utc_ns)
        np.testing.assert_array_equal(data["h1_files_start_utc_ns"], expected)


def test_a_table_of_an_omni_sensor_holds_its_passage(uwtrack, omni):
    assert uwtrack("export", omni, "--to", "csv", "-o", "a.csv").exit_code == 0
    with open("a.csv", newline="") as file:  # noqa: PTH123 - beside the command
        (row,) = csv.DictReader(file)
    with read_product(omni) as product:
        time_s = float(product.read(Encounters).time_s[0])
    assert float(row["time_s"]) == pytest.approx(time_s, abs=1e-3)


@pytest.mark.parametrize("form", ["geojson", "kml"])
def test_a_map_says_which_passages_have_no_place_on_it(uwtrack, omni, form):
    done = uwtrack("export", omni, "--to", form, "-o", "map")
    assert done.exit_code == 0
    assert "1 of 1 encounters" in done.stderr
    assert "bearing" in done.stderr


def test_a_table_without_rows_is_said(uwtrack, omni):
    words = ["export", omni, "--to", "csv", "--container", "fixes", "-o", "f.csv"]
    done = uwtrack(*words)
    assert done.exit_code == 0
    assert "has no fixes" in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        ["spectrogram", "x.wav", "--sensor", "a.toml", "--sensor", "b.toml"],
        ["spectrogram", "x.wav", "-o", "a.h5", "--output=b.h5"],
        ["batch", "x.wav", "-o", "a", "-o", "b"],
        ["show", "x.h5", "lines", "--sensor", "a", "--sensor", "b"],
        ["score", "x.h5", "--truth", "a.json", "--truth", "b.json"],
    ],
)
def test_an_option_of_one_value_takes_no_second(uwtrack, words):
    done = uwtrack(*words)
    assert done.exit_code == 2
    assert "is given twice" in done.stderr


def test_options_of_several_values_are_given_again(uwtrack, noise_wav):
    settings = ["--set", "cpa.source_depth_m=4", "--set", "cpa.spreading_db=15"]
    assert uwtrack("run", noise_wav, *settings).exit_code == 0
    history = json.loads(uwtrack("info", "noise.run.h5", "--json").stdout)["history"]
    given = [step["options"] for step in history if step["stage"] == "cpa"]
    assert len(given) == 2  # of the frames of one second, and of four
    for options in given:
        assert (options["source_depth_m"], options["spreading_db"]) == (4.0, 15.0)


@pytest.mark.parametrize("folder", [".", "..", "sub"])
def test_a_folder_is_no_recording(uwtrack, tmp_path, folder):
    (tmp_path / "sub").mkdir()
    done = uwtrack("run", folder)
    assert done.exit_code == 1
    assert done.stderr.startswith("error:")
    assert "batch" in done.stderr
    assert "Traceback" not in done.output


def test_paths_are_texts_or_paths_and_containers_have_names(tmp_path, omni):
    assert find_sensor(str(tmp_path / "x.wav")) is None
    (tmp_path / "x.sensor.toml").write_text('id = "h7"\n')
    found = find_sensor(str(tmp_path / "x.wav"))
    assert found is not None
    assert found.id == "h7"
    with read_product(str(omni)) as product:
        assert product.read("encounters").equals(product.read(Encounters))
        assert [c.NAME for c in product.read_all("sensor")] == [Sensor.NAME]
        with pytest.raises(DataError, match="there is no table 'vessels'"):
            product.read("vessels")
        with pytest.raises(DataError, match="holds no files"):
            product.read(RecordedFiles.NAME)


def test_standard_output_is_no_file_that_was_written(uwtrack, noise_wav, capsys):
    done = uwtrack("spectrogram", noise_wav, "-o", "-")
    assert done.exit_code == 0
    assert "wrote" not in done.stderr
    say_wrote("a.h5")
    assert capsys.readouterr().err == "wrote a.h5\n"


def test_passages_go_to_standard_output_by_its_sign(uwtrack, omni, tmp_path):
    done = uwtrack("passages", omni, "--to", "jsonl", "-o", "-", "--fresh")
    assert done.exit_code == 0
    assert json.loads(done.stdout)["sensor"] == "m1"
    assert not (tmp_path / "-").exists()
