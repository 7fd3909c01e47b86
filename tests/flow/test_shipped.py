"""Recipes and samples are found in a checkout and in an installed package."""

import shutil
import tomllib

import pytest
import soundfile

import uwtrack_cli
from uwtrack_cli.errors import DataError, OutputError
from uwtrack_cli.flow.shipped_recipes import FOLDERS, copy_sample, sample_names, shipped_folder


@pytest.mark.parametrize("name", FOLDERS)
def test_checkout_has_its_folders_at_the_top(name):
    assert shipped_folder(name).name == name
    assert shipped_folder(name).is_dir()


def test_installed_package_carries_its_own_folders(tmp_path, monkeypatch):
    package = tmp_path / "site" / "uwtrack_cli"
    own = package / "_shipped" / "pipelines"
    own.mkdir(parents=True)
    (tmp_path / "site" / "pipelines").mkdir()
    monkeypatch.setattr(uwtrack_cli, "__file__", str(package / "__init__.py"))
    assert shipped_folder("pipelines") == own
    with pytest.raises(DataError, match="lacks its folder sample_data"):
        shipped_folder("sample_data")


@pytest.mark.parametrize("name", ["noise", "two-sensors-h2"])
def test_an_installed_package_makes_the_sound_of_a_sample(tmp_path, monkeypatch, name):
    checkout, names = shipped_folder("sample_data"), sample_names()
    package = tmp_path / "site" / "uwtrack_cli"
    shutil.copytree(
        checkout, package / "_shipped" / "sample_data", ignore=shutil.ignore_patterns("*.wav")
    )
    monkeypatch.setattr(uwtrack_cli, "__file__", str(package / "__init__.py"))
    assert sample_names() == names
    copied = copy_sample(name, tmp_path)
    beside = {path.name for path in checkout.glob(f"{name}.*")}
    assert {path.name for path in copied} == beside
    again, rate = soundfile.read(tmp_path / f"{name}.wav", dtype="int16")
    shipped, same_rate = soundfile.read(checkout / f"{name}.wav", dtype="int16")
    assert rate == same_rate
    assert abs(again.astype(int) - shipped).max() <= 1
    with pytest.raises(OutputError, match="exists already"):
        copy_sample(name, tmp_path)


def test_other_folders_are_not_shipped():
    with pytest.raises(DataError, match="there are pipelines, sample_data"):
        shipped_folder("../etc")


def test_closest_approaches_of_lines_have_levels_of_the_same_frames():
    """Without them an overhead passage was told from its lines alone, 4 deviations off."""
    steps = tomllib.loads((shipped_folder("pipelines") / "auto.toml").read_text())
    usual = {"track": "peaks"}  # what a step reads that names no input

    def frames(name):
        step = steps[name]
        if "window_s" in step:
            return step["window_s"]
        return frames(step.get("input", usual.get(name, "spectrogram")))

    for name, step in steps.items():
        if isinstance(step, dict) and step.get("stage", name) == "cpa":
            lines, levels, *_ = step["input"]
            assert frames(lines) == frames(levels)
