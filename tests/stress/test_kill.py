"""Killed, out of disk, or with a source that changes: no half file, no lost source."""

import contextlib
import hashlib
import json
import os
import resource
import signal
import subprocess
import threading
import time
from pathlib import Path

import h5py
import numpy as np
import psutil
import pytest
import soundfile

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.files.hdf5.product import verify_product

NOISE = np.random.default_rng(1)


@pytest.fixture(scope="session")
def sound(tmp_path_factory):
    path = tmp_path_factory.mktemp("kill") / "a.wav"
    soundfile.write(path, 0.1 * NOISE.standard_normal(60 * 1000), 1000)
    return path


@pytest.fixture(scope="session")
def begin(start):
    """Start a command in a folder."""

    def begin(folder, *words, **options):
        return start(
            *words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            text=True, **options,
        )  # fmt: skip

    return begin


COMMANDS = {
    "run": (("run", "a.wav", "-o", "out/a.run.h5", "--overwrite"), {"a.run.h5"}),
    "batch": (
        ("batch", "in", "-o", "out", "--jobs", "2", "--overwrite"),
        {"a.run.h5", "b.run.h5", "batch.csv", "batch.jsonl"},
    ),
    "report": (("report", "made.h5", "-o", "out/made.html", "--overwrite"), {"made.html"}),
    "export": (
        ("export", "made.h5", "--to", "netcdf", "-o", "out/made.nc", "--overwrite"),
        {"made.nc"},
    ),
    "spectrogram": (("spectrogram", "a.wav", "-o", "out/a.h5", "--overwrite"), {"a.h5"}),
}
"""Arguments of each command that is killed, and what it may leave in `out`."""


@pytest.fixture(scope="session")
def place(tmp_path_factory, begin):
    """A folder with what the commands read."""
    folder = tmp_path_factory.mktemp("killed")
    for name in ("in", "out", "temporary"):
        (folder / name).mkdir()
    for name in ("a.wav", "in/a.wav", "in/b.wav"):
        soundfile.write(folder / name, 0.1 * NOISE.standard_normal(20_000), 1000)
    made = begin(folder, "run", "a.wav", "-o", "made.h5")
    made.communicate(timeout=120)
    assert made.returncode == 0
    return folder


def digests(folder):
    return {
        path.relative_to(folder): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.parent.name != "out"
    }


def is_whole(path):
    """Tell whether a file is what a command writes when nothing disturbs it."""
    if path.suffix == ".h5":
        return verify_product(path) == []
    if path.suffix == ".nc":
        with h5py.File(path, "r") as file:
            return "Conventions" in file.attrs
    text = path.read_text()
    if path.suffix == ".jsonl":
        return all(json.loads(line) for line in text.splitlines())
    return text.endswith("</html>\n" if path.suffix == ".html" else "\n")


def empty(folder):
    for path in folder.iterdir():
        path.unlink()


def orphans(folder):
    """Return the processes that still run in a folder."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if Path(process.cwd()) == folder:
                found.append(process)
    return found


def kill_at_random(begin, folder, command, n_kills, seed):
    """Kill a command at random moments; return how often its output was placed."""
    rng = np.random.default_rng(seed)
    words, wanted = COMMANDS[command]
    options = {"env": {**os.environ, "TMPDIR": str(folder / "temporary")}}
    empty(folder / "out")
    begun = time.monotonic()
    whole = begin(folder, *words, **options)
    _, said = whole.communicate(timeout=300)
    assert whole.returncode == 0, said
    assert {path.name for path in (folder / "out").iterdir()} == wanted
    took_s = time.monotonic() - begun
    before = digests(folder)
    n_placed = 0
    for _ in range(n_kills):
        empty(folder / "out")
        running = begin(folder, *words, **options)
        time.sleep(float(rng.uniform(0.2, 1.1)) * took_s)
        running.kill()
        running.wait()
        psutil.wait_procs(orphans(folder), timeout=10)
        assert orphans(folder) == []
        running.communicate()
        left = list((folder / "out").iterdir())
        assert {path.name for path in left} <= wanted
        assert [path for path in left if not is_whole(path)] == []
        n_placed += bool(left)
        assert digests(folder) == before
    return n_placed


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_killed_command_leaves_whole_files_or_none(begin, place, command):
    kill_at_random(begin, place, command, 2, 1)


@pytest.mark.long
@pytest.mark.parametrize("command", COMMANDS)
def test_a_hundred_kills_leave_whole_files_or_none(begin, place, command):
    n_placed = kill_at_random(begin, place, command, 100, 2)
    print(f"{command}: 100 kills, {n_placed} after a file was placed")  # noqa: T201
    assert n_placed < 100


def small_disk(limit_bytes):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    return limit


@pytest.mark.parametrize("limit_bytes", [0, 5_000, 200_000])
@pytest.mark.parametrize("command", ["spectrogram", "run"])
def test_a_full_disk_ends_with_a_sentence_and_no_file(begin, sound, tmp_path, command, limit_bytes):
    running = begin(tmp_path, command, sound, "-o", "out.h5", preexec_fn=small_disk(limit_bytes))
    _, said = running.communicate(timeout=120)
    assert running.returncode == 1, said
    assert "out.h5" in said.splitlines()[-1]
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_the_product_that_was_there(begin, sound, tmp_path, uwtrack):
    assert uwtrack("run", sound, "-o", "out.h5", "-q").exit_code == 0
    before = (tmp_path / "out.h5").read_bytes()
    running = begin(
        tmp_path, "run", sound, "-o", "out.h5", "--overwrite", preexec_fn=small_disk(5_000)
    )
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


def test_standard_output_that_is_full_is_an_error(start, sound, tmp_path):
    with open("/dev/full", "wb") as full:  # noqa: PTH123 - a device
        running = start(
            "run", sound, "-o", "out.h5", "--json", "--recipe", "vessel", cwd=tmp_path,
            stdout=full, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        _, said = running.communicate(timeout=120)
    assert running.returncode == 1
    assert "No space left" in said
    assert "Traceback" not in said


def test_a_closed_pipe_ends_quietly(start, place, tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    running = start(
        "show", place / "made.h5", "levels", "--format", "csv", cwd=tmp_path,
        stdout=writing, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    os.close(writing)
    _, said = running.communicate(timeout=120)
    assert running.returncode == 0
    assert said == ""


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
