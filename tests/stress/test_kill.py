"""Killed, out of disk, or with a source that changes: no half file, no lost source."""

import os
import resource
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import soundfile

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio import open_recording
from uwtrack_cli.files.product import verify_product

PROGRAM = [sys.executable, "-c", "from uwtrack_cli.cli import main; main()"]
NOISE = np.random.default_rng(1)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    path = tmp_path_factory.mktemp("kill") / "a.wav"
    soundfile.write(path, 0.1 * NOISE.standard_normal(60 * 1000), 1000)
    return path


def start(folder, *words, **options):
    return subprocess.Popen(
        [*PROGRAM, *map(str, words)], cwd=folder, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


def kill_at_random(sound, folder, n_kills, seed):
    """Kill runs at random moments; return how many had placed their product."""
    rng = np.random.default_rng(seed)
    words = ("spectrogram", sound, "-o", "out.h5", "--overwrite")
    begin = time.monotonic()
    whole = start(folder, *words)
    whole.communicate(timeout=120)
    assert whole.returncode == 0
    took_s = time.monotonic() - begin
    before = sound.read_bytes()
    n_placed = 0
    for _ in range(n_kills):
        (folder / "out.h5").unlink(missing_ok=True)
        running = start(folder, *words)
        time.sleep(float(rng.uniform(0.2, 1.1)) * took_s)
        running.kill()
        running.communicate(timeout=60)
        left = {path.name for path in folder.iterdir()}
        assert left <= {"out.h5"}, left
        if left:
            n_placed += 1
            assert verify_product(folder / "out.h5") == []
    assert sound.read_bytes() == before
    return n_placed


def test_a_killed_run_leaves_a_whole_product_or_none(sound, tmp_path):
    kill_at_random(sound, tmp_path, 6, 1)


@pytest.mark.long
def test_a_hundred_killed_runs_leave_whole_products_or_none(sound, tmp_path):
    n_placed = kill_at_random(sound, tmp_path, 100, 2)
    print(f"100 runs killed, {n_placed} after their product was placed")  # noqa: T201
    assert n_placed < 100


def small_disk(limit_bytes):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    return limit


@pytest.mark.parametrize("limit_bytes", [0, 5_000, 200_000])
@pytest.mark.parametrize("command", ["spectrogram", "run"])
def test_a_full_disk_ends_with_a_sentence_and_no_file(
    sound, tmp_path, command, limit_bytes
):
    running = start(
        tmp_path, command, sound, "-o", "out.h5",
        preexec_fn=small_disk(limit_bytes),
    )  # fmt: skip
    _, said = running.communicate(timeout=120)
    assert running.returncode == 1, said
    assert "out.h5" in said.splitlines()[-1]
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_the_product_that_was_there(sound, tmp_path, uwtrack):
    assert uwtrack("run", sound, "-o", "out.h5", "-q").exit_code == 0
    before = (tmp_path / "out.h5").read_bytes()
    running = start(
        tmp_path, "run", sound, "-o", "out.h5", "--overwrite",
        preexec_fn=small_disk(5_000),
    )  # fmt: skip
    running.communicate(timeout=120)
    assert running.returncode == 1
    assert (tmp_path / "out.h5").read_bytes() == before


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("/dev/full", "device or a pipe"),
        ("file/out.h5", "a file, not a folder"),
        ("nowhere/out.h5", "does not exist"),
    ],
)
def test_a_target_that_cannot_be_is_refused_before_work_begins(
    uwtrack, sound, tmp_path, target, words
):
    (tmp_path / "file").write_text("mine")
    for extra in ([], ["--overwrite"]):
        done = uwtrack("run", sound, "-o", target, *extra)
        assert done.exit_code == 1
        assert words in done.stderr
    assert (tmp_path / "file").read_text() == "mine"


def test_standard_output_that_is_full_is_an_error(sound, tmp_path):
    with open("/dev/full", "wb") as full:  # noqa: PTH123 - a device
        done = subprocess.run(
            [*PROGRAM, "run", str(sound), "-o", "out.h5", "--json"], cwd=tmp_path,
            stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120,
        )  # fmt: skip
    assert done.returncode == 1
    assert "No space left" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_closed_pipe_ends_quietly(uwtrack, sound, tmp_path):
    assert uwtrack("run", sound, "-o", "out.h5", "-q").exit_code == 0
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [*PROGRAM, "show", "out.h5", "levels", "--format", "csv"], cwd=tmp_path,
        stdout=writing, stderr=subprocess.PIPE, text=True, check=False, timeout=120,
    )  # fmt: skip
    os.close(writing)
    assert done.returncode == 0
    assert done.stderr == ""


@pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")
def test_a_source_that_changes_while_it_is_read_makes_no_product(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, 0.1 * NOISE.standard_normal(20_000), 1000)
    recording = open_recording(path)

    def disturb():
        with path.open("r+b") as file:
            file.seek(30_000)
            file.write(b"changed")
        os.utime(path, ns=(1, 1))

    blocks = recording.reader(1000)
    next(blocks)
    thread = threading.Thread(target=disturb)
    thread.start()
    thread.join()
    with pytest.raises(DataError, match="changed while it was read"):
        list(blocks)
