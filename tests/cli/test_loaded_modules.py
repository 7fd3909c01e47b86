"""What commands load before they do anything: the start of a short one is its cost."""

import subprocess
import sys

import pytest

from uwtrack_cli.flow.catalogue import STAGES, find_stage, output_class

CODE = """
import sys
from uwtrack_cli.cli import main
try:
    main()
except SystemExit as end:
    print(*sys.modules, file=sys.stderr)
    sys.exit(end.code)
"""


def loaded(folder, *words):
    """Names of the modules that a command has loaded at its end."""
    done = subprocess.run(
        [sys.executable, "-c", CODE, *words], cwd=folder, capture_output=True, text=True, check=True
    )
    return set(done.stderr.splitlines()[-1].split())


def rooms(modules):
    """Rooms of the program that have a module among the names of modules."""
    names = [name.split(".") for name in modules if name.startswith("uwtrack_cli.")]
    return {room for _, room, *rest in names if rest}


def parts_of_scipy(modules):
    """Public packages of scipy among the names of modules."""
    names = {name.split(".")[1] for name in modules if name.startswith("scipy.")}
    return {name for name in names if not name.startswith("_")} - {"version"}


@pytest.mark.parametrize("words", [["--help"], ["--version"]])
def test_help_loads_the_parser_and_no_array(tmp_path, words):
    modules = loaded(tmp_path, *words)
    assert not modules & {"numpy", "rich.console", "typer.rich_utils"}
    of_data = {name for name in modules if name.startswith("uwtrack_cli.data.")}
    assert of_data <= {"uwtrack_cli.data.renamed"}  # names alone, no array


def test_help_of_a_command_loads_no_file_format(tmp_path):
    modules = loaded(tmp_path, "run", "--help")
    assert not modules & {"h5py", "soundfile", "scipy", "rich.console"}


@pytest.mark.parametrize("command", ["info", "show"])
def test_a_look_at_a_product_loads_no_fit(tmp_path, pass_run, command):
    modules = loaded(tmp_path, command, str(pass_run))
    assert not parts_of_scipy(modules)
    assert not rooms(modules) & {"lines", "motion", "presence", "arrays", "plotting"}


def test_a_run_loads_of_scipy_what_it_computes_with(tmp_path, short_pass):
    modules = loaded(tmp_path, "run", str(short_pass), "-o", "short.h5")
    assert parts_of_scipy(modules) <= {"fft", "linalg", "special"}
    assert not rooms(modules) & {"plotting", "simulate", "clutter", "discrimination"}


@pytest.mark.parametrize("name", STAGES)
def test_what_a_stage_makes_is_known_without_it(name):
    assert output_class(STAGES[name]) == find_stage(name).output.__name__
