"""Wheel and source distribution carry what the program needs, away from the checkout."""

import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent
SHIPPED = ("pipelines/vessel.toml", "sample_data/pass.scenario.toml", "sample_data/README.md")


def run(words, **options):
    done = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, check=False, **options
    )
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
    assert {"uwtrack_cli/py.typed", "uwtrack_cli/__init__.pyi"} <= set(names)
    assert not any(name.startswith(("tests/", "studies/")) for name in names)
    assert distributions[0].stat().st_size < 6_000_000


def test_the_source_distribution_carries_recipes_samples_and_tests(distributions):
    with tarfile.open(distributions[1]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for name in (
        *SHIPPED,
        "docs/conf.py",
        "tests/test_package.py",
        "studies/reference/clutter.json",
        "constraints.txt",
        "constraints.hashes.txt",
        "Makefile",
    ):
        assert name in names


def test_what_is_pinned_by_its_hash_has_the_version_that_the_suite_passes_with():
    def pins(name):
        text = (ROOT / name).read_text().lower().replace("_", "-")
        return dict(re.findall(r"^([a-z0-9.-]+)==([^ \n]+)", text, re.MULTILINE))

    every, hashed = pins("constraints.txt"), pins("constraints.hashes.txt")
    assert {name: every.get(name) for name in hashed} == hashed
    assert {"numpy", "scipy", "h5py", "typer", "rich", "soundfile"} < set(hashed)


def demo(tmp_path, what):
    """Install into an empty environment, and run the program away from the checkout."""
    venv.create(tmp_path / "env")
    bin_folder = tmp_path / "env" / "bin"
    run([
        # modules that nobody imports need not be compiled
        sys.executable, "-m", "pip", "--python", bin_folder / "python", "install",
        "--quiet", "--no-compile", *what,
    ])  # fmt: skip
    environment = {**os.environ, "PYTHONPATH": "", "PATH": f"{bin_folder}:/usr/bin:/bin"}
    for words in (
        ["uwtrack", "sample", "pass"],
        ["uwtrack", "run", "pass.wav", "--stop-s", "20"],
        ["uwtrack", "plot", "pass.run.h5", "-o", "pass.png"],
    ):
        done = run(words, cwd=tmp_path, env=environment)
    assert (tmp_path / "pass.png").stat().st_size > 20_000
    assert "wrote pass.png" in done.stderr


@pytest.mark.slow
def test_the_demo_runs_from_the_wheel(distributions, tmp_path):
    """What it needs comes from this environment, by a path."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    own = tmp_path / "env" / "lib" / version / "site-packages"
    own.mkdir(parents=True)
    (own / "needed.pth").write_text(f"{Path(np.__file__).parents[1]}\n")
    demo(tmp_path, ["--no-deps", distributions[0]])
    assert (own / "uwtrack_cli" / "_shipped").is_dir()


@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_demo_runs_from_the_wheel_in_an_empty_environment(distributions, tmp_path):
    constraint = ["--constraint", ROOT / "constraints.txt"]
    demo(tmp_path, [*constraint, f"{distributions[0]}[plot]"])
