"""What a shell sees: exit codes behind a closed pipe, words that are missing or odd."""

import os
import shlex
import subprocess
import sys

import numpy as np
import pytest
import soundfile

PROGRAM = [sys.executable, "-c", "from uwtrack_cli.cli import main; main()"]


def code_unread(folder, *words):
    """Return the exit code of a command whose standard output nobody reads."""
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run(
            [*PROGRAM, *map(str, words)], cwd=folder, stdout=write,
            stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    finally:
        os.close(write)
    assert "Traceback" not in done.stderr
    assert "Broken pipe" not in done.stderr
    return done.returncode


@pytest.mark.slow
def test_an_exit_code_that_is_an_answer_survives_a_closed_pipe(tmp_path, short_run, timed_run):
    assert code_unread(tmp_path, "diff", short_run, timed_run) == 4
    assert code_unread(tmp_path, "diff", short_run, timed_run, "--json") == 4
    assert code_unread(tmp_path, "show", short_run, "lines") == 0
    whole = short_run.read_bytes()
    (tmp_path / "cut.h5").write_bytes(whole[:-1000])
    assert code_unread(tmp_path, "verify", short_run, "cut.h5") == 1


def test_sound_from_a_file_is_not_overwritten_and_that_is_said_first(tmp_path, noise_wav):
    content = noise_wav.read_bytes()
    with noise_wav.open("rb") as sound:
        done = subprocess.run(
            [*PROGRAM, "run", "-", "-o", "noise.wav", "--overwrite"],
            cwd=tmp_path, stdin=sound, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert sound.seek(0, os.SEEK_CUR) == 0  # before any of it was read
    assert done.returncode == 1
    assert "is read by this command and is not overwritten" in done.stderr
    assert noise_wav.read_bytes() == content


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("run", "noise.wav", "-o", "--overwrite"), "-o takes a value, got the option"),
        (("batch", ".", "--output", "-o", "x"), "--output takes a value"),
        (("run", "noise.wav", "--set", "--json"), "--set takes a value"),
    ],
)
def test_an_option_is_not_the_value_of_another(uwtrack, noise_wav, words, said):
    before = sorted(noise_wav.parent.iterdir())
    done = uwtrack(*words)
    assert done.exit_code == 2
    assert f"error: {said}" in done.stderr
    assert sorted(noise_wav.parent.iterdir()) == before


def test_a_command_that_is_told_runs(uwtrack, tmp_path, noise_wav):
    path = noise_wav.rename(tmp_path / "my 'ship'.wav")
    told = uwtrack("info", path.name).stdout.splitlines()[-1]
    word, *words = shlex.split(told.removeprefix("next: "))
    assert word == "uwtrack"
    assert uwtrack(*words, "--recipe", "vessel").exit_code == 0


def test_info_counts_the_channels_of_the_file(uwtrack, tmp_path):
    sound = 0.1 * np.random.default_rng(2).standard_normal((4000, 2))
    soundfile.write(tmp_path / "stereo.wav", sound, 1000)
    told = uwtrack("info", "stereo.wav").stdout
    assert "4 s at 1000 Hz, 2 channels; read: channel 1" in told


def test_a_misspelt_container_is_guessed(uwtrack, short_run):
    done = uwtrack("show", short_run, "encouters")
    assert done.exit_code == 2
    assert "no table 'encouters'. Did you mean 'encounters'?" in done.stderr
