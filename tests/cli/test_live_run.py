"""`run` on live sound: the product is that of the same sound run at once."""

import io
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
import typer
from typer.testing import CliRunner

from uwtrack_cli.cli.app import app
from uwtrack_cli.cli.console import guard, signals_end
from uwtrack_cli.files.hdf5.product import verify_product

PROGRAM = [sys.executable, "-c", "from uwtrack_cli.cli import main; main()"]
PIPES = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
RATE = 1000
NOISE = 0.1 * np.random.default_rng(6).standard_normal(20 * RATE)
WITH_A_GAP = np.concatenate([NOISE, np.full(RATE, np.nan), NOISE]).astype("<f4")


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """A folder with half a minute of noise with a tone, and its product."""
    rng = np.random.default_rng(4)
    time_s = np.arange(30 * RATE) / RATE
    values = 0.1 * rng.standard_normal(time_s.size) + 0.1 * np.sin(600.0 * time_s)
    folder = tmp_path_factory.mktemp("recorded")
    soundfile.write(folder / "a.wav", values, RATE, "PCM_16")
    words = ["run", str(folder / "a.wav"), "-o", str(folder / "whole.h5"), "-q"]
    assert CliRunner().invoke(app, words).exit_code == 0
    return folder


@pytest.fixture
def sound(recorded, tmp_path):
    """The sound alone, in the folder of the test."""
    return Path(shutil.copy(recorded / "a.wav", tmp_path))


def unstated(content):
    """Return a WAV file as a program writes it into a pipe."""
    return content[:40] + struct.pack("<I", 0xFFFFFFFF) + content[44:]


@pytest.mark.slow
@pytest.mark.parametrize("form", ["whole", "unstated", "raw"])
def test_sound_from_a_pipe_makes_the_product_of_the_file(uwtrack, recorded, sound, form):
    content = sound.read_bytes()
    words = ["run", "-", "-o", "live.h5", "-q"]
    if form == "unstated":
        content = unstated(content)
    if form == "raw":
        content, words = content[44:], [*words, "--raw", "s16le", "--rate-hz", RATE]
    assert uwtrack(*words, input=content).exit_code == 0
    done = uwtrack("diff", recorded / "whole.h5", "live.h5")
    assert done.exit_code == 0, done.stdout
    assert verify_product(sound.parent / "live.h5") == []


@pytest.mark.slow
def test_a_followed_file_makes_the_same_product(uwtrack, recorded, sound):
    done = uwtrack("run", "--follow", sound, "--idle-s", "0.3", "-q")
    assert done.exit_code == 0
    assert uwtrack("diff", recorded / "whole.h5", "a.run.h5").exit_code == 0


def test_a_recipe_with_two_sources_reads_a_pipe_once(uwtrack, sound, tmp_path):
    (tmp_path / "two.toml").write_text(
        "[spectrogram]\n[levels]\nband_hz = [50.0, 400.0]\noutput = true\n"
        '[fine]\nstage = "spectrogram"\nwindow_s = 0.25\n'
        '[fine-levels]\nstage = "levels"\ninput = "fine"\nband_hz = [50.0, 400.0]\n'
        "output = true\n"
    )
    recipe = ("--recipe", "two.toml", "-q")
    assert uwtrack("run", "a.wav", *recipe).exit_code == 0
    content = sound.read_bytes()
    assert uwtrack("run", "-", "-o", "l.h5", *recipe, input=content).exit_code == 0
    assert uwtrack("diff", "a.run.h5", "l.h5").exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sample", "recipe"),
    [
        ("propeller", "presence"),
        ("small-array", "small-array"),
        ("towed-array", "towed-array"),
        ("pass", "auto"),
        ("mono", "weak-lines"),
    ],
)
@pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")
def test_every_sensor_and_recipe_works_live_with_events(uwtrack, samples, tmp_path, sample, recipe):
    """Looked at after 20 s, by way of envelope and arrays, too; the file is the same."""
    facts = soundfile.info(samples / f"{sample}.wav")
    values, rate_hz = soundfile.read(
        samples / f"{sample}.wav", frames=26 * facts.samplerate, dtype="int16"
    )
    soundfile.write(tmp_path / "cut.wav", values, rate_hz, "PCM_16")
    words = ["--sensor", samples / f"{sample}.sensor.toml", "--recipe", recipe, "-q"]
    words += ["--start-utc", "2024-05-01T12:00:00Z", "-o"]
    content = (tmp_path / "cut.wav").read_bytes()
    done = uwtrack("run", "-", "--json", *words, "live.h5", input=content)
    assert done.exit_code == 0, done.output
    assert all(json.loads(line)["event"] for line in done.stdout.splitlines())
    assert uwtrack("run", "cut.wav", *words, "file.h5").exit_code == 0
    same = uwtrack("diff", "live.h5", "file.h5")
    assert same.exit_code == 0, same.stdout


@pytest.mark.slow
def test_a_pipe_writes_to_a_pipe(start, sound):
    done = start("run", "-", "-q", **PIPES)
    product, said = done.communicate(sound.read_bytes(), timeout=250)
    assert done.returncode == 0, said
    assert product.startswith(b"\x89HDF")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_ends_the_sound_and_the_second_the_command(number):
    ended = []

    def run():
        with guard(debug=True), signals_end(lambda: ended.append(number)):
            os.kill(os.getpid(), number)
            assert ended == [number]
            os.kill(os.getpid(), number)
            signal.pause()

    with pytest.raises(typer.Exit) as raised:
        run()
    assert raised.value.exit_code == 128 + number
    assert ended == [number]


@pytest.mark.parametrize(
    ("words", "content", "code", "said"),
    [
        (("-",), b"", 1, "is empty: no sound came"),
        (("-",), b"%PDF-1.4 of no use", 1, "is no WAV sound"),
        (("-", "--raw", "s16le"), b"", 2, "needs --rate-hz"),
        (("-", "--rate-hz", "8000"), b"", 2, "go with --raw"),
        (("-", "--follow"), b"", 2, "is a pipe: leave it out"),
        (("-", "a.wav"), b"", 2, "live sound is run alone"),
        ((".", "--follow"), b"", 2, "watch . -o DIR runs what arrives"),
        (("-",), b"<!DOCTYPE html>", 1, "ffmpeg -i FILE -f wav - makes it"),
        (("a.wav", "--raw", "s16le"), b"", 2, "--raw is for sound that comes through"),
        (("a.wav", "--idle-s", "3"), b"", 2, "--idle-s is for sound that comes"),
        (("-", "--raw", "s16le", "--rate-hz", "1000"), bytes(99), 1, "too short for"),
        (("-", "--raw", "u8", "--rate-hz", "1000"), b"12.5, 3\n" * 999, 1, "gives text"),
        (("-", "--start-utc", "soon"), b"x", 2, "cannot be understood"),
    ],
)
@pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")
def test_what_cannot_be_run_live_is_one_sentence(
    uwtrack, sound, tmp_path, words, content, code, said
):
    where = [] if "a.wav" in words else ["-o", "out.h5"]
    done = uwtrack("run", *words, *where, input=content)
    assert done.exit_code == code, done.output
    assert said in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {sound.name}


def test_events_and_product_do_not_share_standard_output(uwtrack, sound):
    done = uwtrack("run", "-", "--json", input=sound.read_bytes())
    assert done.exit_code == 2
    assert "give -o FILE" in done.stderr


PLAIN = ("--recipe", "vessel")
RAW_FLOATS = ("--raw", "f32le", "--rate-hz", str(RATE))


@pytest.mark.slow
@pytest.mark.parametrize("output", ["closed", "full"])
def test_events_that_cannot_be_printed_do_not_cost_the_file(tmp_path, output):
    with open("/dev/full", "wb") as full:  # noqa: PTH123 - a device
        done = subprocess.run(
            [*PROGRAM, "run", "-", "-o", "a.h5", "--json", *RAW_FLOATS, *PLAIN],
            cwd=tmp_path,
            input=WITH_A_GAP.tobytes(), stdout=full, stderr=subprocess.PIPE, check=False,
            timeout=250, preexec_fn=(lambda: os.close(1)) if output == "closed" else None,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert verify_product(tmp_path / "a.h5") == []
    assert done.stderr.count(b"events are no longer printed") == (output == "full")


def test_a_closed_standard_output_takes_no_product(tmp_path):
    done = subprocess.run(
        [*PROGRAM, "run", "-", *RAW_FLOATS], cwd=tmp_path, input=WITH_A_GAP.tobytes(),
        stderr=subprocess.PIPE, check=False, timeout=120,
        preexec_fn=lambda: os.close(1),
    )  # fmt: skip
    assert done.returncode == 2
    assert b"standard output is closed" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_sound_that_is_only_silence_is_said(uwtrack):
    memory = io.BytesIO()
    soundfile.write(memory, np.zeros(20 * RATE), RATE, "PCM_16", format="WAV")
    done = uwtrack("run", "-", "-o", "s.h5", input=memory.getvalue())
    assert done.exit_code == 0
    assert "is silent" in done.stderr


def test_sound_that_does_not_change_is_no_sound_and_said(uwtrack):
    """A converter that is stuck: rounding alone would show steady lines."""
    stuck = np.full(60 * RATE, 77, "<i2").tobytes()
    raw = ("--raw", "s16le", "--rate-hz", RATE)
    done = uwtrack("run", "-", "-o", "s.h5", *raw, input=stuck)
    assert done.exit_code == 0
    assert "does not change: every sample is 0.00235" in " ".join(done.stderr.split())
    assert "no vessel was found" in done.stderr
    shown = uwtrack("show", "s.h5", "presence", "--format", "json")
    assert json.loads(shown.stdout) == []


def test_a_converter_that_sticks_for_a_while_is_said(uwtrack):
    """For ten minutes within noise, and for half a minute, as of a file."""
    noise = np.random.default_rng(6).integers(-3000, 3000, 6000).astype("<i2")
    stuck = np.full(600 * 100, 77, "<i2")
    sound = np.concatenate([noise, stuck, noise, stuck[:3000], noise])
    raw = ("--raw", "s16le", "--rate-hz", 100, *PLAIN)
    done = uwtrack("run", "-", "-o", "s.h5", *raw, input=sound.tobytes())
    assert done.exit_code == 0
    said = " ".join(done.stderr.split())
    assert said.count("does not change") == 1
    times = "60.0 to 660.0 s, 720.0 to 750.0 s"
    assert f"standard input does not change from {times}" in said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_finishes_the_product(uwtrack, start, tmp_path, number):
    """The sound has a gap, whose event says that all before it has been worked on."""
    rng = np.random.default_rng(6)
    sound = 0.1 * rng.standard_normal(60 * RATE).astype("<f4")
    sound[30 * RATE : 31 * RATE] = np.nan
    words = ["-o", "cut.h5", "--start-utc", "now", "--json", *PLAIN]
    running = start("run", "-", *words, *RAW_FLOATS, cwd=tmp_path, **PIPES)
    running.stdin.write(sound.tobytes())
    running.stdin.flush()
    assert json.loads(running.stdout.readline())["event"] == "gap"
    running.send_signal(number)
    _, said = running.communicate(timeout=250)
    assert running.returncode == 0, said
    assert b"finishing what is open" in said
    assert verify_product(tmp_path / "cut.h5") == []
    shown = uwtrack("show", "cut.h5", "recording", "--format", "json")
    facts = json.loads(shown.stdout)
    assert 31 * RATE <= facts["n_samples"] <= 60 * RATE
    assert facts["start_utc_ns"] > 1.7e18


def test_frames_that_are_longer_than_live_sound_are_left_out_and_said(uwtrack, sound):
    header, samples = sound.read_bytes()[:44], sound.read_bytes()[44:]
    piped = uwtrack("run", "-", "-o", "short.h5", input=header + samples[: 2 * RATE * 3])
    assert piped.exit_code == 0
    assert "lasts 3 s, less than a frame of slow-spectrogram" in piped.stderr
    held = uwtrack("info", "short.h5", "-v").stdout
    assert "slow" not in held
