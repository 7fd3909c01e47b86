"""Recordings that arrive are run once, when they are whole, and never lost by a kill."""

import json
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest
import soundfile

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import verify_product
from uwtrack_cli.flow import watch
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.flow.watch import JOURNAL, Journal, WatchTimes, watch_folder

RATE = 1000
TIMES = WatchTimes(settle_s=5.0, idle_s=20.0)
NOISE = 0.1 * np.random.default_rng(8).standard_normal(20 * RATE)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "in").mkdir()
    return tmp_path


def write(path, sound=NOISE):
    soundfile.write(path, sound, RATE, "PCM_16")
    return path.read_bytes()


class Clock:
    """A clock that only sleeping advances, and what happens at its times."""

    def __init__(self):
        self.now_s = 1000.0
        self.deeds = {}
        self.epoch_s = time.time()

    def monotonic(self):
        return self.now_s

    def time(self):
        return self.epoch_s  # files look fresh: their times of change are real

    def sleep(self, seconds):
        self.now_s += seconds
        for at_s in [at_s for at_s in self.deeds if at_s <= self.now_s]:
            self.deeds.pop(at_s)()


@pytest.fixture
def clock(monkeypatch):
    found = Clock()
    monkeypatch.setattr(watch, "time", found)
    monkeypatch.setattr(watch, "run_job", found_jobs(found))
    return found


def found_jobs(clock):
    """Note the jobs with the time of the clock; the second name of bad ones fails."""
    clock.ran = []

    def run(job):
        (source,) = job.sources
        clock.ran.append((source.name, clock.now_s - 1000.0))
        status = "failed" if "bad" in source.name else "done"
        return watch.Outcome(str(source), str(job.target), status)

    return run


def watched(folder, times=TIMES):
    recipe = load_recipe("vessel")
    return list(watch_folder(folder / "in", folder / "out", recipe, {}, times))


def test_a_recording_is_run_when_it_has_settled(folder, clock):
    clock.deeds = {1007.0: lambda: write(folder / "in" / "b.wav")}
    write(folder / "in" / "a.wav")
    watched(folder)
    (a, a_s), (b, b_s) = clock.ran
    assert (a, b) == ("a.wav", "b.wav")
    assert 5.0 <= a_s <= 7.0
    assert 12.0 <= b_s <= 14.0


def test_a_recording_that_is_being_written_is_awaited(folder, clock):
    """It grows once a minute; its header promises more than is there for so long."""
    path = folder / "in" / "slow.wav"
    content = write(path)
    path.write_bytes(content[:10_000])

    def grow(n_bytes):
        return lambda: path.write_bytes(content[:n_bytes])

    clock.deeds = {1030.0: grow(20_000), 1060.0: grow(len(content))}
    watched(folder)
    ((_, ran_s),) = clock.ran
    assert 65.0 <= ran_s <= 67.0


def test_a_recording_that_stays_too_short_is_taken_in_the_end(folder, clock):
    path = folder / "in" / "cut.wav"
    content = write(path)
    path.write_bytes(content[:10_000])
    watched(folder)
    ((_, ran_s),) = clock.ran
    assert 50.0 <= ran_s <= 52.0


def test_what_changed_is_run_again_and_what_failed_is_not(folder, clock):
    for name in ("a.wav", "bad.wav"):
        write(folder / "in" / name)
    watched(folder)
    assert [name for name, _ in clock.ran] == ["a.wav", "bad.wav"]
    watched(folder)
    assert len(clock.ran) == 2
    write(folder / "in" / "a.wav", NOISE[:5000])
    watched(folder)
    assert [name for name, _ in clock.ran] == ["a.wav", "bad.wav", "a.wav"]


def test_a_recording_that_goes_away_is_forgotten(folder, clock):
    path = folder / "in" / "gone.wav"
    write(path)
    clock.deeds = {1002.0: path.unlink}
    watched(folder)
    assert clock.ran == []


def test_half_a_line_of_the_journal_is_removed(folder):
    (folder / "out").mkdir()
    path = folder / "out" / JOURNAL
    whole = {"source": "/x/a.wav", "size_bytes": 7, "modified_ns": 9}
    path.write_text(json.dumps(whole) + "\n" + '{"source": "/x/b')
    with Journal(folder / "out") as journal:
        assert journal.is_done(watch.Path("/x/a.wav"), (7, 9))
        assert not journal.is_done(watch.Path("/x/a.wav"), (8, 9))
        journal.note({"source": "/x/c.wav"}, (1, 2))
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    assert [row["source"] for row in rows] == ["/x/a.wav", "/x/c.wav"]


@pytest.mark.parametrize("lost", ["out", f"out/{JOURNAL}"])
def test_a_watch_whose_output_was_removed_ends(folder, clock, uwtrack, lost):
    def remove():
        path = folder / lost
        shutil.rmtree(path) if path.is_dir() else path.unlink()

    write(folder / "in" / "a.wav")
    clock.deeds = {1010.0: remove, 1011.0: lambda: write(folder / "in" / "b.wav")}
    done = uwtrack("watch", "in", "-o", "out", "--idle-s", "20")
    assert done.exit_code == 1
    assert f"error: {lost} was removed while it was in use" in done.stderr
    assert [name for name, _ in clock.ran] == ["a.wav"]
    assert not (folder / lost).exists()


def full_disk(monkeypatch, n_failures):
    """Let the disk be full for the next files that are written."""
    left = iter(range(n_failures))
    sync = watch.os.fsync

    def fsync(handle):
        if next(left, None) is not None:
            raise OSError(28, "No space left on device")
        sync(handle)

    monkeypatch.setattr("os.fsync", fsync)


def last_row(folder):
    return json.loads((folder / "out" / JOURNAL).read_text().splitlines()[-1])


def test_what_a_full_disk_has_stopped_is_tried_again(folder, uwtrack, monkeypatch):
    """First product and journal cannot be written, then the product, then nothing."""
    monkeypatch.setattr(watch, "RETRY_S", (0.2, 0.2))
    write(folder / "in" / "a.wav")
    full_disk(monkeypatch, 2)
    done = uwtrack(*WORDS, "--idle-s", "1")
    assert done.exit_code == 0, done.output
    assert "No space left on device. It is tried again later." in done.stderr
    assert last_row(folder)["status"] == "done"
    assert not verify_product(folder / "out" / "a.run.h5")


def test_what_failed_for_want_of_another_file_is_tried_again(folder, uwtrack):
    for name in ("a.wav", "bad.wav"):
        write(folder / "in" / name)
    (folder / "in" / "bad.wav").write_text("no sound")
    (folder / "in" / "a.sensor.toml").write_text('id = "h1"\nnavigation = "n.csv"\n')
    assert uwtrack(*WORDS, "--idle-s", "0.3").exit_code == 3
    (folder / "in" / "n.csv").write_text("time_s,east_m,north_m\n0,0,0\n60,30,0\n")
    done = uwtrack(*WORDS, "--idle-s", "0.3")
    said = "2 recordings failed before; tried again: 1 now and 1 when they change."
    assert f"out/{JOURNAL}: {said}" in done.stderr
    assert done.exit_code == 0, done.output
    assert last_row(folder)["target"] == "a.run.h5"
    assert last_row(folder)["status"] == "done"
    again = uwtrack(*WORDS, "--idle-s", "0.3")
    assert "1 recording failed before; tried again: 1 when they change." in again.stderr


def test_two_watches_do_not_share_a_journal(folder):
    (folder / "out").mkdir()
    with Journal(folder / "out"), pytest.raises(DataError, match="another uwtrack"):
        Journal(folder / "out")


PLAIN = ("--recipe", "vessel")
WORDS = ("watch", "in", "-o", "out", "--settle-s", "0.1", *PLAIN)


def test_the_products_are_those_of_a_batch(folder, uwtrack):
    write(folder / "in" / "a.wav")
    (folder / "in" / "bad.wav").write_text("no sound")
    done = uwtrack(*WORDS, "--idle-s", "0.3", "--json")
    assert done.exit_code == 3
    rows = {row["target"]: row for row in map(json.loads, done.stdout.splitlines())}
    assert rows["a.run.h5"]["status"] == "done"
    assert rows["bad.run.h5"]["status"] == "failed"
    assert uwtrack("run", "in/a.wav", "-o", "b.h5", "-q", *PLAIN).exit_code == 0
    assert uwtrack("diff", "out/a.run.h5", "b.h5").exit_code == 0
    again = uwtrack(*WORDS, "--idle-s", "0.3", "--json")
    assert (again.exit_code, again.stdout) == (0, "")


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("watch", "nowhere", "-o", "out"), 1, "is no folder that can be watched"),
        ((*WORDS, "--idle-s", "0"), 2, "--idle-s must be a number (s, above 0)"),
        ((*WORDS, "--settle-s", "-1"), 2, "given twice"),
    ],
)
def test_a_watch_that_cannot_be_is_one_sentence(folder, uwtrack, words, code, said):
    assert folder.exists()
    done = uwtrack(*words)
    assert done.exit_code == code
    assert said in done.stderr


@pytest.fixture
def watching(start, folder):
    """Start a watch of the folder."""

    def begin(*words):
        return start(
            *WORDS, *words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    return begin


def test_a_signal_ends_the_watch_after_the_recording(folder, watching):
    write(folder / "in" / "a.wav")
    running = watching("--json")
    assert json.loads(running.stdout.readline())["status"] == "done"
    running.send_signal(signal.SIGTERM)
    _, said = running.communicate(timeout=250)
    assert running.returncode == 0, said


def kill_and_go_on(folder, watching, n_recordings, n_kills, seed):
    """Kill a watch at random moments; what it has noted is not done again."""
    rng = np.random.default_rng(seed)
    for k in range(n_recordings):
        sound = 0.1 * rng.standard_normal(20 * RATE)
        write(folder / "in" / f"{k:02}.wav", sound)
    journal = folder / "out" / JOURNAL
    noted = {}
    for _ in range(n_kills):
        running = watching()
        time.sleep(float(rng.uniform(0.1, 1.0)))
        running.kill()
        running.communicate()
        lines = journal.read_text().splitlines() if journal.exists() else []
        assert len(lines) >= len(noted)
        for row in map(json.loads, lines):
            made_ns = (folder / "out" / row["target"]).stat().st_mtime_ns
            assert noted.setdefault(row["target"], made_ns) == made_ns
        products = list(folder.glob("out/*.h5"))
        assert [path for path in products if verify_product(path)] == []
        assert len(products) <= len(noted) + 1  # one placed, and not noted yet
    running = watching("--idle-s", "0.3")
    running.communicate(timeout=600)
    assert running.returncode == 0
    rows = [json.loads(line) for line in journal.read_text().splitlines()]
    assert sorted(row["target"] for row in rows) == [f"{k:02}.run.h5" for k in range(n_recordings)]
    assert len(list(folder.glob("out/*"))) == n_recordings + 1
    return len(noted)


def test_after_a_kill_a_watch_goes_on_where_it_was(folder, watching):
    kill_and_go_on(folder, watching, 3, 2, 1)


def test_kills_within_one_long_sound_lose_nothing_of_it(folder, watching, uwtrack):
    """While it is written, and while it is run; the journal has it once, and whole."""
    rng = np.random.default_rng(5)
    path, whole = folder / "in" / "long.wav", folder / "whole.wav"
    content = write(whole, 0.1 * rng.standard_normal(120 * RATE))
    for share in (0.3, 0.7):  # the header promises more: it is awaited
        path.write_bytes(content[: int(share * len(content))])
        running = watching()
        time.sleep(float(rng.uniform(0.2, 0.6)))
        running.kill()
        running.communicate()
        assert list(folder.glob("out/*.h5")) == []
    path.write_bytes(content)
    for _ in range(2):
        running = watching()
        time.sleep(float(rng.uniform(0.2, 0.8)))
        running.kill()
        running.communicate()
    running = watching("--idle-s", "0.3")
    running.communicate(timeout=600)
    assert running.returncode == 0
    journal = (folder / "out" / JOURNAL).read_text().splitlines()
    rows = [json.loads(line) for line in journal]
    # while it stood still it may have been taken for a truncated one
    assert [row["target"] for row in rows if row["status"] == "done"] == ["long.run.h5"]
    assert rows[-1]["status"] == "done"
    assert uwtrack("run", "in/long.wav", "-q", "-o", "at-once.h5", *PLAIN).exit_code == 0
    assert uwtrack("diff", "at-once.h5", "out/long.run.h5").exit_code == 0
    assert len(list(folder.glob("out/*"))) == 2


@pytest.mark.long
def test_fifty_kills_lose_no_recording(folder, watching):
    n_noted = kill_and_go_on(folder, watching, 40, 50, 2)
    print(f"50 kills, {n_noted} recordings noted before the last one")  # noqa: T201


def test_the_sources_stay_as_they_are(folder, uwtrack):
    content = write(folder / "in" / "a.wav")
    shutil.copy(folder / "in" / "a.wav", folder / "in" / "b.wav")
    assert uwtrack(*WORDS, "--idle-s", "0.3").exit_code == 0
    assert sorted(p.name for p in (folder / "in").iterdir()) == ["a.wav", "b.wav"]
    assert (folder / "in" / "a.wav").read_bytes() == content
