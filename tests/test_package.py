"""Wheel and source distribution carry what the program needs, away from the checkout."""

import os
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SHIPPED = ("pipelines/vessel.toml", "sample_data/pass.wav", "sample_data/README.md")


def run(words, **options):
    done = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, check=False,
        **options,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="session")
def distributions(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    words = [sys.executable, "-m", "build", "--no-isolation", "-o", folder, ROOT]
    run(words)
    (wheel,) = folder.glob("*.whl")
    (source,) = folder.glob("*.tar.gz")
    return wheel, source


def test_the_wheel_carries_recipes_and_samples(distributions):
    names = zipfile.ZipFile(distributions[0]).namelist()
    for name in SHIPPED:
        assert f"uwtrack_cli/_shipped/{name}" in names
    assert "uwtrack_cli/studies/reference/clutter.json" in names
    assert {"uwtrack_cli/py.typed", "uwtrack_cli/__init__.pyi"} <= set(names)
    assert not any(name.startswith("tests/") for name in names)


def test_the_source_distribution_carries_recipes_samples_and_tests(distributions):
    with tarfile.open(distributions[1]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for name in (
        *SHIPPED,
        "docs/conf.py",
        "tests/test_package.py",
        "constraints.txt",
        "Makefile",
    ):
        assert name in names


@pytest.mark.timeout(600)
def test_the_demo_runs_from_the_wheel_in_an_empty_environment(distributions, tmp_path):
    venv.create(tmp_path / "env")
    bin_folder = tmp_path / "env" / "bin"
    run([
        # modules that nobody imports need not be compiled
        sys.executable, "-m", "pip", "--python", bin_folder / "python", "install",
        "--quiet", "--no-compile", "--constraint", ROOT / "constraints.txt",
        f"{distributions[0]}[plot]",
    ])  # fmt: skip
    environment = {
        **os.environ,
        "PYTHONPATH": "",
        "PATH": f"{bin_folder}:/usr/bin:/bin",
    }
    rows: list[list[str]] = []
    for words in (
        ["uwtrack", "sample", "pass"],
        ["uwtrack", "run", "pass.wav"],
        ["uwtrack", "plot", "pass.run.h5", "-o", "pass.png"],
    ):
        done = run(words, cwd=tmp_path, env=environment)
        rows += [line.split() for line in done.stderr.splitlines() if "  ok  " in line]
    assert (tmp_path / "pass.png").stat().st_size > 20_000
    assert "wrote pass.png" in done.stderr
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert rows[0] in [line.split() for line in readme.splitlines()]
