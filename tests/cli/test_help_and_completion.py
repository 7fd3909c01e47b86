"""What helps a person who types: help by name, the nearest command, completion."""

import os
import subprocess
import sys
from importlib import import_module
from inspect import signature
from pathlib import Path

import pytest

from uwtrack_cli import __version__
from uwtrack_cli.cli.app import COMMANDS, GROUPS, load_command
from uwtrack_cli.flow.catalogue import STAGES
from uwtrack_cli.flow.stage import parameter_texts


def test_help_without_a_name_lists_every_command(uwtrack):
    done = uwtrack("help")
    assert done.exit_code == 0
    place = 0
    for title, names in GROUPS.items():  # in their order, under their headings
        place = done.stdout.index(f"\n{title}:\n", place)
        for name in names:
            place = done.stdout.index(f"\n  {name} ", place)


def test_help_with_a_name_is_the_help_of_the_command(uwtrack):
    asked, own = uwtrack("help", "peaks"), uwtrack("peaks", "--help")
    assert asked.exit_code == 0
    assert asked.stdout.replace("uwtrack peaks", "") == own.stdout.replace("uwtrack peaks", "")
    assert "--false-alarm-probability" in asked.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_every_option_in_full_on_eighty_columns(uwtrack, name):
    text = uwtrack(name, "--help").stdout
    assert max(map(len, text.splitlines())) <= 80
    for param in load_command(name).params:
        flags = [flag for flag in param.opts if flag.startswith("-")]
        assert all(flag in text for flag in flags)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_argument_and_option_says_what_it_is(name):
    for param in load_command(name).params:
        assert getattr(param, "help", None), param.name


@pytest.mark.parametrize("name", [n for n in COMMANDS if n not in STAGES])
def test_what_the_docstring_of_a_command_describes_are_its_parameters(name):
    place, _, function = COMMANDS[name].partition(":")
    own = getattr(import_module(f"uwtrack_cli.cli.{place}"), function)
    assert set(parameter_texts(own)) <= set(signature(own).parameters)


@pytest.mark.parametrize(
    ("words", "nearest"),
    [
        (["spectogram", "x.wav"], "'spectrogram'"),
        (["help", "exprot"], "'export'"),
        (["run", "--recpie", "vessel", "x.wav"], "--recipe"),
        (["peaks", "--false-alarm-probabilty", "1e-3", "x.h5"], "--false-alarm"),
    ],
)
def test_a_typing_error_is_told_with_what_is_nearest(uwtrack, words, nearest):
    done = uwtrack(*words)
    assert done.exit_code == 2
    assert nearest in done.stderr


def test_a_word_that_is_near_nothing_is_told_where_all_are(uwtrack):
    done = uwtrack("qqq")
    assert done.exit_code == 2
    assert "uwtrack help" in done.stderr
    assert "Did you mean" not in done.stderr


@pytest.mark.slow
def test_bash_completes_commands_options_and_names(tmp_path):
    script = """
        set -eu
        eval "$(uwtrack --show-completion bash)"
        complete_last() {
            COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
            _uwtrack_completion uwtrack; echo "${COMPREPLY[@]}"
        }
        complete_last uwtrack spec
        complete_last uwtrack run pass.wav --recipe tow
        complete_last uwtrack run pass.wav --start-s 1 --start-s 2 --ov
        complete_last uwtrack sample two-sensors-h
    """
    folder = str(Path(sys.executable).parent)
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True,
        check=True, env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert [line.split() for line in done.stdout.splitlines()] == [
        ["spectrogram"], ["towed-array"], ["--overwrite"],
        ["two-sensors-h1", "two-sensors-h2"],
    ]  # fmt: skip


@pytest.mark.parametrize("typed", ["noise", "nose.wav", "noise.wv"])
def test_a_file_that_is_not_there_is_told_with_what_is_nearest(uwtrack, noise_wav, typed):
    done = uwtrack("run", typed)
    assert done.exit_code == 1
    assert f"{typed} does not exist. Did you mean {noise_wav.name}?" in done.stderr


def test_the_program_runs_as_a_module_where_its_script_is_not_found():
    command = [sys.executable, "-m", "uwtrack_cli", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"uwtrack {__version__}"


def test_samples_are_listed_with_what_they_hold(uwtrack):
    from uwtrack_cli.flow.shipped_recipes import sample_names

    lines = uwtrack("sample").stdout.splitlines()
    assert [line.split()[0] for line in lines] == sample_names()
    assert all(len(line.split()) > 2 for line in lines)


def test_a_program_without_words_is_explained(uwtrack):
    done = uwtrack()
    assert done.exit_code == 0
    assert done.stdout == uwtrack("--help").stdout
