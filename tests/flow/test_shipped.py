"""Recipes and samples are found in a checkout and in an installed package."""

import tomllib

import pytest

import uwtrack_cli
from uwtrack_cli.errors import DataError
from uwtrack_cli.flow.shipped_recipes import FOLDERS, shipped_folder


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
            lines, levels = step["input"]
            assert frames(lines) == frames(levels)
