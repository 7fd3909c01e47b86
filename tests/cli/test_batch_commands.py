"""Batches: mirrored, resumable, the same as single runs wherever they run."""

import contextlib
import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
import soundfile

from uwtrack_cli.files.hdf5.checksum import LINE_BYTES
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.flow.batch import Job, run_job
from uwtrack_cli.flow.executors import PATIENCE_S, run_jobs
from uwtrack_cli.flow.shipped_recipes import load_recipe

RATE = 1000
N_MANY = 4
LONG_S = 7200


def tone(seconds, seed, rate=RATE):
    """Noise with a tone that glides through a Doppler curve."""
    time_s = np.arange(int(seconds * rate)) / rate
    glide = 180.0 - 1.5 * np.tanh((time_s - seconds / 2) / 4.0)
    noise = np.random.default_rng(seed).standard_normal(time_s.size)
    return 0.05 * noise + 0.02 * np.sin(2 * np.pi * np.cumsum(glide) / rate)


@pytest.fixture(scope="session")
def tree(tmp_path_factory):
    """A folder of recordings, one of them damaged, in two levels."""
    root = tmp_path_factory.mktemp("tree")
    (root / "north" / "deep").mkdir(parents=True)
    for k, name in enumerate(["a.wav", "north/b.wav", "north/deep/c.wav"]):
        soundfile.write(root / name, tone(12, k), RATE, subtype="PCM_16")
    (root / "north" / "bad.wav").write_text("Dear founder,\n")
    (root / "notes.txt").write_text("not a recording")
    return root


def rows_of(folder):
    lines = (Path(folder) / "batch.jsonl").read_text().splitlines()
    return {Path(row["source"]).name: row for row in map(json.loads, lines)}


def but_the_last_line(path):
    """Return the bytes of a product but those of its time of creation."""
    return path.read_bytes()[:-LINE_BYTES]


@pytest.fixture(scope="session")
def serial(tree, tmp_path_factory):
    """The batch in one process."""
    from typer.testing import CliRunner

    from uwtrack_cli.cli.app import app

    folder = tmp_path_factory.mktemp("serial") / "out"
    words = ["batch", str(tree), "-o", str(folder), "--jobs", "1", "-q"]
    assert CliRunner().invoke(app, words).exit_code == 3
    return folder


def test_the_output_mirrors_the_sources_and_tells_of_the_bad_one(serial):
    assert {str(p.relative_to(serial)) for p in serial.rglob("*") if p.is_file()} == {
        "a.run.h5", "north/b.run.h5", "north/deep/c.run.h5", "batch.csv", "batch.jsonl",
    }  # fmt: skip
    rows = rows_of(serial)
    assert [row["status"] for row in rows.values()].count("done") == 3
    assert rows["bad.wav"]["status"] == "failed"
    assert "no recording that can be read" in rows["bad.wav"]["message"]
    with (serial / "batch.csv").open(newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)].count("failed") == 1


def test_a_batch_is_the_single_runs(uwtrack, tree, serial, tmp_path):
    done = uwtrack("run", tree / "north" / "b.wav", "-o", "b.h5", "-q")
    assert done.exit_code == 0
    done = uwtrack("diff", serial / "north" / "b.run.h5", tmp_path / "b.h5")
    assert done.exit_code == 0, done.output


def test_two_processes_give_what_one_gives(uwtrack, tree, serial):
    done = uwtrack("batch", tree, "-o", "out", "--jobs", 2, "--json")
    assert done.exit_code == 3
    assert [row["status"] for row in json.loads(done.stdout)].count("done") == 3
    made = {path.name: but_the_last_line(path) for path in Path("out").rglob("*.h5")}
    wanted = {path.name: but_the_last_line(path) for path in serial.rglob("*.h5")}
    assert len(made) == 3
    assert made == wanted  # the time of creation is in the last line


def test_resume_redoes_what_is_damaged_cut_short_or_outdated(uwtrack, tree, tmp_path):
    mine = tmp_path / "mine"
    shutil.copytree(tree, mine)
    (mine / "north" / "bad.wav").unlink()
    words = ["batch", "mine", "-o", "out", "--jobs", 1, "--recipe", "vessel"]
    assert uwtrack(*words).exit_code == 0
    again = uwtrack(*words)
    assert again.exit_code == 3
    assert "--resume" in rows_of("out")["a.wav"]["message"]
    assert uwtrack(*words, "--resume").exit_code == 0
    assert {row["status"] for row in rows_of("out").values()} == {"resumed"}
    flipped = bytearray((tmp_path / "out" / "a.run.h5").read_bytes())
    flipped[len(flipped) // 2] ^= 255
    (tmp_path / "out" / "a.run.h5").write_bytes(flipped)
    cut = (tmp_path / "out" / "north" / "b.run.h5").read_bytes()[:-3000]
    (tmp_path / "out" / "north" / "b.run.h5").write_bytes(cut)
    soundfile.write(mine / "north" / "deep" / "c.wav", tone(12, 9), RATE)
    assert uwtrack(*words, "--resume").exit_code == 0
    assert {row["status"] for row in rows_of("out").values()} == {"done"}
    (mine / "a.sensor.toml").write_text('id = "h1"\n')
    assert uwtrack(*words, "--resume").exit_code == 0
    found = {name: row["status"] for name, row in rows_of("out").items()}
    assert found == {"a.wav": "done", "b.wav": "resumed", "c.wav": "resumed"}


def test_a_job_that_runs_twice_finds_its_own_product(tree, tmp_path):
    recipe = load_recipe("vessel")
    job = Job((tree / "a.wav",), tmp_path / "a.h5", recipe, may_repeat=True)
    first, second = run_job(job), run_job(job)
    assert first.status == second.status == "done", second.message
    assert run_job(replace(job, may_repeat=False)).status == "failed"
    ((number, refused),) = run_jobs([replace(job, may_repeat=False)], n_workers=2)
    assert number == 0
    assert "--resume" in refused.message


def test_a_pattern_finds_what_it_names_and_keeps_their_places(uwtrack, tree, tmp_path):
    done = uwtrack("batch", f"{tree}/*/b.wav", "-o", "out", "--jobs", 1)
    assert done.exit_code == 0, done.output
    assert (tmp_path / "out" / "north" / "b.run.h5").exists()


def test_nothing_to_do_is_an_error(uwtrack, tmp_path):
    (tmp_path / "empty").mkdir()
    done = uwtrack("batch", "empty", "-o", "out")
    assert done.exit_code == 1
    assert "holds no recording" in done.stderr


def test_two_sources_never_share_a_product(uwtrack, tmp_path):
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        soundfile.write(tmp_path / folder / "a.wav", tone(1, 1), RATE)
    done = uwtrack("batch", "x", "y", "-o", "out")
    assert done.exit_code == 2
    assert "would both be written to" in done.stderr


@pytest.mark.parametrize("wrong", [["--jobs", 0], ["--join", "--join-gap-s", -1]])
def test_a_wrong_option_is_a_usage_error(uwtrack, tree, wrong):
    assert uwtrack("batch", tree, "-o", "out", *wrong).exit_code == 2


def test_a_scheduler_that_is_not_there_is_named(uwtrack, tree, monkeypatch):
    monkeypatch.setattr("uwtrack_cli.flow.executors.CONNECT_S", 0.5)
    done = uwtrack("batch", tree, "-o", "out", "--scheduler", "tcp://127.0.0.1:9")
    assert done.exit_code == 1
    assert "tcp://127.0.0.1:9 does not answer" in done.stderr


def test_files_of_a_recorder_are_joined_by_their_times(uwtrack, tmp_path):
    sound = tone(24, 3)
    (tmp_path / "day").mkdir()
    for k, name in enumerate(["h1_20240501_120000.wav", "h1_20240501_120012.wav"]):
        part = sound[12_000 * k : 12_000 * (k + 1)]
        soundfile.write(tmp_path / "day" / name, part, RATE, subtype="PCM_16")
    soundfile.write(tmp_path / "day" / "other.wav", tone(12, 4), RATE)
    soundfile.write(tmp_path / "whole.wav", sound, RATE, subtype="PCM_16")
    done = uwtrack("batch", "day", "-o", "out", "--join", "--jobs", 1)
    assert done.exit_code == 0, done.output
    rows = rows_of("out")
    assert rows["h1_20240501_120000.wav"]["n_sources"] == 2
    assert rows["other.wav"]["n_sources"] == 1
    joined = "out/h1_20240501_120000.run.h5"
    assert uwtrack("run", "whole.wav", "--start-utc", "2024-05-01T12:00:00Z", "-q").exit_code == 0
    found = json.loads(uwtrack("diff", joined, "whole.run.h5", "--json").stdout)
    assert {row["container"] for row in found} <= {"files", "recording"}
    again = uwtrack("rerun", joined, "--source", "day", "-o", "again.h5")
    assert again.exit_code == 0, again.output
    assert uwtrack("diff", joined, "again.h5").exit_code == 0


def start_batch(folder, *words):
    """Start a batch whose workers are its children, in a shell that may hang up."""
    program = "from uwtrack_cli.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", program, "batch", "many", "-o", "out", *words],
        cwd=folder, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.fixture
def many(tmp_path):
    """A folder of short recordings."""
    (tmp_path / "many").mkdir()
    write_many(tmp_path)
    return tmp_path


def write_many(folder):
    for k in range(N_MANY):
        path = folder / "many" / f"{k:02d}.wav"
        path.unlink(missing_ok=True)
        soundfile.write(path, tone(12, k), RATE, subtype="PCM_16")


def lengthen(folder, *numbers):
    """Let recordings take long: a worker on one of them is busy until it is ended."""
    first, *others = [folder / "many" / f"{k:02d}.wav" for k in numbers]
    soundfile.write(first, np.tile(tone(60, 1), LONG_S // 60), RATE)
    for path in others:
        path.unlink()
        path.hardlink_to(first)


def wait_for_products(folder, n, limit_s=250):
    begin = time.monotonic()
    while len(list((folder / "out").glob("*.h5"))) < n:
        assert time.monotonic() - begin < limit_s
        time.sleep(0.05)


def leftovers(folder):
    known = (".h5", ".csv", ".jsonl")
    return [p for p in folder.rglob("*") if p.is_file() and p.suffix not in known]


@pytest.mark.slow
def test_an_interrupt_ends_with_130_and_resume_goes_on(uwtrack, many):
    lengthen(many, 1, 2, 3)
    running = start_batch(many, "--jobs", "2")
    wait_for_products(many, 1)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=250)
    assert running.returncode == 130, said
    assert "Traceback" not in said
    assert leftovers(many / "out") == []
    (complete,) = (many / "out").glob("*.h5")
    assert uwtrack("verify", complete).exit_code == 0
    for path in sorted((many / "many").glob("*.wav"))[1:]:
        path.unlink()
        soundfile.write(path, tone(12, 5), RATE, subtype="PCM_16")
    done = uwtrack("batch", "many", "-o", "out", "--resume", "--jobs", 1)
    assert done.exit_code == 0, done.output
    statuses = [row["status"] for row in rows_of("out").values()]
    assert statuses == ["resumed", *["done"] * (N_MANY - 1)]


def workers_of(running, n, limit_s=250):
    """Wait for the worker processes of a batch."""
    begin = time.monotonic()
    while time.monotonic() - begin < limit_s:
        with contextlib.suppress(psutil.Error):
            found = [
                child
                for child in psutil.Process(running.pid).children(recursive=True)
                if "spawn_main" in " ".join(child.cmdline())
            ]
            if len(found) >= n:
                return found
        time.sleep(0.02)
    pytest.fail("the workers did not start")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "code"), [("SIGTERM", 143), ("SIGKILL", -9)])
def test_no_worker_outlives_a_batch_that_is_ended(uwtrack, many, name, code):
    lengthen(many, 1, 2, 3)
    running = start_batch(many, "--jobs", "2")
    workers = workers_of(running, 2)
    wait_for_products(many, 1)
    running.send_signal(getattr(signal, name))
    running.wait(timeout=250)
    _, alive = psutil.wait_procs(workers, timeout=PATIENCE_S + 60)
    assert alive == []
    _, said = running.communicate()
    assert running.returncode == code, said
    assert "Traceback" not in said
    assert leftovers(many / "out") == []
    (complete,) = (many / "out").glob("*.h5")
    assert uwtrack("verify", complete).exit_code == 0
    if name != "SIGKILL":
        assert {row["status"] for row in rows_of("out").values()} <= {"done"}


@pytest.mark.slow
def test_a_worker_without_the_signal_of_its_parents_death_ends_all_the_same(many):
    program = (
        "from uwtrack_cli.flow import executors\n"
        "executors.PR_SET_PDEATHSIG = -1  # no such request\n"
        "from uwtrack_cli.cli import main\n"
        "if __name__ == '__main__': main()\n"
    )
    lengthen(many, 0, 1, 2, 3)
    (many / "program.py").write_text(program)  # a worker imports it, too
    running = subprocess.Popen(
        [sys.executable, "program.py", "batch", "many", "-o", "out", "--jobs", "2"],
        cwd=many, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    workers = workers_of(running, 2)
    worker_on(workers, "00.wav")  # both have begun
    worker_on(workers, "01.wav")
    running.kill()
    running.wait()
    _, alive = psutil.wait_procs(workers, timeout=PATIENCE_S + 60)
    running.communicate()
    assert alive == []


def worker_on(workers, name, limit_s=250):
    """Wait for the worker that has a recording open."""
    begin = time.monotonic()
    while time.monotonic() - begin < limit_s:
        for worker in workers:
            with contextlib.suppress(psutil.Error):
                if any(Path(file.path).name == name for file in worker.open_files()):
                    return worker
        time.sleep(0.02)
    pytest.fail(f"no worker opened {name}")


@pytest.mark.slow
def test_a_lost_worker_costs_its_own_file_and_is_replaced(many):
    """Two recordings are endless; whoever works on them is ended, one by one."""
    lengthen(many, 0, 1)
    running = start_batch(many, "--jobs", "2")
    workers = workers_of(running, 2)
    first, second = (worker_on(workers, f"0{k}.wav") for k in (0, 1))
    first.kill()
    wait_for_products(many, 2)  # of a worker in its place
    second.kill()
    _, said = running.communicate(timeout=250)
    assert running.returncode == 3, said
    rows = rows_of(many / "out")
    assert [rows[f"0{k}.wav"]["status"] for k in range(N_MANY)] == (
        ["failed", "failed", "done", "done"]
    )
    for k in (0, 1):
        message = rows[f"0{k}.wav"]["message"]
        assert "the process that ran it was ended by SIGKILL" in message
    assert {path.name for path in (many / "out").glob("*.h5")} == ({"02.run.h5", "03.run.h5"})


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_cluster_may_lose_a_worker_and_its_end_is_told(uwtrack, many, start):
    """The results stay the same without one worker; without a scheduler, resume goes on."""
    environment = {**os.environ, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "3"}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    scheduler = subprocess.Popen(
        [*dask, "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
         "--scheduler-file", "s.json"],
        cwd=many, env=environment, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    workers = []
    batch = {"cwd": many, "stderr": subprocess.PIPE, "text": True}
    try:
        address = scheduler_address(many / "s.json")
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address]
        workers += [
            subprocess.Popen(
                [*worker, "--nthreads", "1", "--no-nanny", "--no-dashboard",
                 "--local-directory", many / f"w{k}"],
                cwd=many, stderr=subprocess.DEVNULL,
            )
            for k in range(2)
        ]  # fmt: skip
        words = ("batch", "many", "--scheduler", address)
        running = start(*words, "-o", "out", **batch)
        wait_for_products(many, 1)
        workers[0].kill()
        _, said = running.communicate(timeout=250)
        assert running.returncode == 0, said

        made = {path.name: but_the_last_line(path) for path in many.glob("out/*.h5")}
        shutil.rmtree(many / "out")
        lengthen(many, 1, 2, 3)
        running = start(*words, "-o", "out", **batch)
        wait_for_products(many, 1)
        scheduler.kill()
        _, said = running.communicate(timeout=250)
    finally:
        for process in [*workers, scheduler]:
            process.kill()
            process.wait()
    assert running.returncode == 1, said
    assert "Traceback" not in said
    (line,) = said.strip().splitlines()
    assert line.startswith(f"error: the scheduler {address} is lost")
    assert "--resume" in line
    write_many(many)
    done = uwtrack("batch", "many", "-o", "out", "--resume", "--jobs", 1)
    assert "1 resumed" in done.stderr
    local = {path.name: but_the_last_line(path) for path in many.glob("out/*.h5")}
    assert len(local) == N_MANY
    assert made == local


def scheduler_address(path, limit_s=250):
    begin = time.monotonic()
    while time.monotonic() - begin < limit_s:
        if path.exists():
            try:
                return json.loads(path.read_text())["address"]
            except ValueError:
                pass
        time.sleep(0.1)
    pytest.fail("the scheduler did not start")


@pytest.mark.slow
def test_a_product_is_made_again_from_its_history(uwtrack, short_pass, tmp_path):
    for name in ("pass.wav", "pass.sensor.toml"):
        (tmp_path / name).write_bytes((short_pass.parent / name).read_bytes())
    words = ["--start-s", 5, "--set", "peaks.kept_probability=0.02", "--recipe"]
    words += ["vessel", "--start-utc", "2024-05-01T12:00:00Z", "-o", "p.h5"]
    done = uwtrack("run", "pass.wav", *words)
    assert done.exit_code == 0, done.output
    again = uwtrack("rerun", "p.h5", "-o", "again.h5")
    assert again.exit_code == 0, again.output
    done = uwtrack("diff", "p.h5", "again.h5")
    assert done.exit_code == 0, done.output
    with read_product("p.h5") as one, read_product("again.h5") as other:
        assert one.paths.keys() == other.paths.keys()
        assert [s.to_json() for s in one.history] == [s.to_json() for s in other.history]


def test_a_fit_of_a_table_is_made_again(uwtrack, tmp_path):
    time_s = np.arange(0.0, 200.0)
    ahead = 6.0 * (time_s - 100.0)
    shift = -6.0 / 1500.0 * ahead / np.hypot(ahead, 200.0)
    lines = [f"{t},{300 * (1 + s):.5f},0.05" for t, s in zip(time_s, shift, strict=True)]
    table = "time_s,frequency_hz,frequency_std_hz\n" + "\n".join(lines) + "\n"
    (tmp_path / "series.csv").write_text(table)
    assert uwtrack("cpa", "series.csv", "-o", "s.h5").exit_code == 0
    assert uwtrack("rerun", "s.h5", "-o", "again.h5").exit_code == 0
    assert uwtrack("diff", "s.h5", "again.h5").exit_code == 0


def test_a_source_that_changed_or_is_gone_is_named(uwtrack, noise_wav, tmp_path):
    assert uwtrack("run", noise_wav, "-q").exit_code == 0
    soundfile.write(noise_wav, tone(10, 77, 2000), 2000, subtype="PCM_16")
    done = uwtrack("rerun", "noise.run.h5")
    assert done.exit_code == 1
    assert "digest differs" in done.stderr
    noise_wav.unlink()
    gone = uwtrack("rerun", "noise.run.h5")
    assert gone.exit_code == 1
    assert "--source" in gone.stderr
    assert not (tmp_path / "noise.rerun.run.h5").exists()
