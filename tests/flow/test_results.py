"""From Python: public names, and the tables of a run as those of the command."""

import ast
import inspect
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

import uwtrack_cli
from uwtrack_cli import Lines, OptionError, UwtrackWarning, read_results, run, to_pandas, to_xarray
from uwtrack_cli.data.base import Container
from uwtrack_cli.files.hdf5.layout import CONTAINERS

START = np.datetime64("2024-05-01T12:01:30", "ns")
ROOT = Path(uwtrack_cli.__file__).parent


@pytest.fixture(scope="session")
def results(short_pass):
    return run(str(short_pass), start_utc=START, keep=["spectrogram", "peaks"])


def test_public_names_are_listed_and_typed():
    assert {"run", "find_peaks", "Encounters", "DataError"} <= set(dir(uwtrack_cli))
    for name in dir(uwtrack_cli):
        assert getattr(uwtrack_cli, name) is not None
    tree = ast.parse((ROOT / "__init__.pyi").read_text())
    stated = {
        alias.asname: node.module
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    homes = {n: f"uwtrack_cli.{home}" for n, home in uwtrack_cli._HOMES.items()}
    assert stated == homes
    assert (ROOT / "py.typed").exists()


def test_every_container_is_public():
    for kind in CONTAINERS.values():
        assert getattr(uwtrack_cli, kind.__name__) is kind


def test_every_public_function_takes_paths_as_text():
    for name in uwtrack_cli.__all__:
        function = getattr(uwtrack_cli, name)
        if inspect.isfunction(function) and name not in {"to_pandas", "to_xarray"}:
            hints = get_type_hints(inspect.unwrap(function))
            for parameter, hint in hints.items():
                if "Path" in str(hint) and parameter != "return":
                    assert "str" in str(hint), f"{name}({parameter}) takes no text"


def test_run_gives_what_the_command_writes(timed_run, results):
    written = read_results(timed_run)
    assert set(results) - set(written) == {"spectrogram", "peaks"}
    for key, container in written.tables.items():
        assert container.equals(results.tables[key]), key


def test_only_what_is_asked_for_is_left_behind(noise_wav):
    before = set(noise_wav.parent.iterdir())
    made = noise_wav.with_name("made.h5")
    words = {"recipe": "vessel", "settings": ["spectrogram.window_s=0.5"]}
    with pytest.warns(UwtrackWarning, match="no sensor file"):
        changed = run(noise_wav, output=str(made), **words)
    assert set(noise_wav.parent.iterdir()) - before == {made}
    (step,) = [s for s in changed.history if s.stage == "spectrogram"]
    assert step.options["window_s"] == 0.5


def test_an_option_that_does_not_exist_is_refused(short_pass):
    with pytest.raises(OptionError, match=r"no option 'start'.*start_utc"):
        run(short_pass, start="2024-05-01")


def test_a_spectrogram_lies_on_time_and_frequency(results):
    grid = results.to_xarray("spectrogram")
    frames = results["spectrogram"].frames
    assert grid.power_density.dims == ("time", "frequency")
    np.testing.assert_array_equal(grid.frequency, results["spectrogram"].frequency_hz)
    passed_ns = (grid.time.values - START).astype(np.int64)
    np.testing.assert_allclose(passed_ns / 1e9, frames.time_s, atol=1e-9)
    moment = grid.sel(time="2024-05-01T12:02:00", frequency=63.0, method="nearest")
    assert moment.power_density.item() == grid.power_density.values[
        np.abs(frames.time_s - 30.0).argmin(), np.abs(grid.frequency.values - 63.0).argmin()
    ]  # fmt: skip
    assert grid.power_density.attrs["units"] == "reference^2/Hz"


def test_decidecades_lie_on_time_and_their_bands(results):
    bands, grid = results["decidecades"], results.to_xarray("decidecades")
    assert grid.level_db.dims == ("time", "band")
    passed_ns = (grid.time.values - START).astype(np.int64)
    np.testing.assert_allclose(passed_ns / 1e9, bands.time_s, atol=1e-9)
    assert grid.centre_hz.dims == ("band",)
    np.testing.assert_array_equal(grid.coords["centre_hz"], bands.centre_hz)


def test_times_are_seconds_where_the_start_is_not_known(results):
    levels = results["levels"]
    unknown = to_xarray(levels, None)
    assert unknown.time.dtype.kind == "M"  # its frames know
    overview = to_xarray(results["overview"])
    assert overview.time.dtype.kind == "f"
    assert overview.time.attrs["units"] == "s"
    assert "time_utc" not in to_pandas(results["overview"])
    assert "time_utc" in results.to_pandas("overview")


def test_encounters_are_the_rows_of_the_command(results):
    (row,) = results.to_pandas().to_dict("records")
    encounters = results["encounters"]
    assert row["speed_mps"] == encounters.speed_mps[0]
    since = (row["time_utc"].tz_localize(None).to_datetime64() - START).astype(np.int64)
    assert since / 1e9 == pytest.approx(encounters.time_s[0], abs=1e-3)
    assert list(row["rest_frequencies_hz"]) == encounters.rest_frequency_hz.tolist()


def test_peaks_have_the_times_of_their_frames(results):
    peaks = results["peaks"]
    table = results.to_pandas("peaks")
    np.testing.assert_array_equal(
        table["time_s"], peaks.frames.time_s[peaks.frame - peaks.frames.first_frame]
    )


def test_every_container_of_a_run_becomes_both_kinds_of_table(results):
    for name in results:
        container = results[name]
        table, grid = results.to_pandas(name), results.to_xarray(name)
        if container.columns():
            assert len(table) == container.sizes()[container.ROW]
        for column, spec in container.columns().items():
            values = getattr(container, column)
            if values is not None and column in grid.variables:
                assert grid[column].shape == values.shape
                if column in grid.data_vars and spec.unit:
                    assert grid[column].attrs["units"] == spec.unit


def test_results_are_read_by_class_and_refused_by_name(results):
    assert isinstance(results.read(Lines), Lines)
    assert len(results) == len(list(results))
    assert "spectrogram" in repr(results)
    with pytest.raises(KeyError):
        results["encounter"]
    with pytest.raises(ValueError, match="holds no motions"):
        results.to_pandas("motions")
    assert all(isinstance(one, Container) for one in results.values())


def test_results_draw_themselves_and_show_as_tables(results, tmp_path):
    figure = results.plot(tmp_path / "a.png", passage=1, units="m/s")
    assert "m/s" in figure.get_label()
    assert figure._repr_png_()[:4] == b"\x89PNG"
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(OptionError, match="no option 'colour'"):
        results.plot(colour="red")
    shown = results._repr_html_()
    assert "encounters" in shown
    assert "passage" in shown
    assert "slant_range_m" in results["encounters"]._repr_html_()
    assert "<script" not in results["recording"]._repr_html_()
