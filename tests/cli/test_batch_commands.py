"""Batches: mirrored, resumable, the same as single runs wherever they run."""

import contextlib
import csv
import json
import os
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
from uwtrack_cli.flow.executors import run_jobs
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.flow.worker_pool import PATIENCE_S

RATE = 1000
N_MANY = 6


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
        soundfile.write(root / name, tone(20, k), RATE, subtype="PCM_16")
    (root / "north" / "bad.wav").write_text("Dear founder,\n")
    (root / "notes.txt").write_text("not a recording")
    return root


def rows_of(folder):
    lines = (Path(folder) / "batch.jsonl").read_text().splitlines()
    return {Path(row["source"]).name: row for row in map(json.loads, lines)}


def assert_same_products(uwtrack, one, other):
    names = sorted(p.relative_to(one) for p in Path(one).rglob("*.h5"))
    assert names == sorted(p.relative_to(other) for p in Path(other).rglob("*.h5"))
    assert len(names) == 3
    for name in names:
        done = uwtrack("diff", Path(one) / name, Path(other) / name)
        assert done.exit_code == 0, done.output


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
    for name in ("a", "north/b", "north/deep/c"):
        target = tmp_path / "single" / f"{name}.run.h5"
        target.parent.mkdir(parents=True, exist_ok=True)
        assert uwtrack("run", tree / f"{name}.wav", "-o", target, "-q").exit_code == 0
    assert_same_products(uwtrack, serial, tmp_path / "single")


def test_two_processes_give_what_one_gives(uwtrack, tree, serial):
    done = uwtrack("batch", tree, "-o", "out", "--jobs", 2, "--json")
    assert done.exit_code == 3
    assert [row["status"] for row in json.loads(done.stdout)].count("done") == 3
    assert_same_products(uwtrack, serial, "out")


def test_resume_redoes_what_is_damaged_cut_short_or_outdated(uwtrack, tree, tmp_path):
    import shutil

    mine = tmp_path / "mine"
    shutil.copytree(tree, mine)
    (mine / "north" / "bad.wav").unlink()
    words = ["batch", "mine", "-o", "out", "--jobs", 1]
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
    soundfile.write(mine / "north" / "deep" / "c.wav", tone(20, 9), RATE)
    assert uwtrack(*words, "--resume").exit_code == 0
    assert {row["status"] for row in rows_of("out").values()} == {"done"}
    assert uwtrack(*words, "--resume", "--set", "cpa.source_depth_m=4").exit_code == 0
    assert {row["status"] for row in rows_of("out").values()} == {"done"}
    (mine / "a.sensor.toml").write_text('id = "h1"\n')
    last = ["--resume", "--set", "cpa.source_depth_m=4"]
    assert uwtrack(*words, *last).exit_code == 0
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
        soundfile.write(tmp_path / folder / "a.wav", tone(20, 1), RATE)
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
    sound = tone(40, 3)
    (tmp_path / "day").mkdir()
    for k, name in enumerate(["h1_20240501_120000.wav", "h1_20240501_120020.wav"]):
        part = sound[20_000 * k : 20_000 * (k + 1)]
        soundfile.write(tmp_path / "day" / name, part, RATE, subtype="PCM_16")
    soundfile.write(tmp_path / "day" / "other.wav", tone(20, 4), RATE)
    soundfile.write(tmp_path / "whole.wav", sound, RATE, subtype="PCM_16")
    done = uwtrack("batch", "day", "-o", "out", "--join", "--jobs", 1)
    assert done.exit_code == 0, done.output
    rows = rows_of("out")
    assert rows["h1_20240501_120000.wav"]["n_sources"] == 2
    assert rows["other.wav"]["n_sources"] == 1
    joined = "out/h1_20240501_120000.run.h5"
    assert uwtrack("run", "whole.wav", "--start-utc", "2024-05-01T12:00:00Z",
                   "-q").exit_code == 0  # fmt: skip
    found = json.loads(uwtrack("diff", joined, "whole.run.h5", "--json").stdout)
    assert {row["container"] for row in found} <= {"files", "recording"}
    again = uwtrack("rerun", joined, "--source", "day", "-o", "again.h5")
    assert again.exit_code == 0, again.output
    assert uwtrack("diff", joined, "again.h5").exit_code == 0


PROGRAM = [sys.executable, "-c", "from uwtrack_cli.cli import main; main()"]


def start_batch(folder, *words):
    return subprocess.Popen(
        [*PROGRAM, "batch", "many", "-o", "out", *words],
        cwd=folder, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.fixture
def many(tmp_path):
    (tmp_path / "many").mkdir()
    for k in range(N_MANY):
        soundfile.write(tmp_path / "many" / f"{k:02d}.wav", tone(15, k), RATE)
    return tmp_path


def lengthen(folder):
    """Let all recordings but the first take long: a worker on one of them is busy."""
    _, second, *others = sorted((folder / "many").glob("*.wav"))
    soundfile.write(second, tone(7200, 1), RATE)
    for path in others:
        path.unlink()
        path.hardlink_to(second)


def wait_for_products(folder, n, limit_s=120):
    begin = time.monotonic()
    while len(list((folder / "out").glob("*.h5"))) < n:
        assert time.monotonic() - begin < limit_s
        time.sleep(0.05)


def leftovers(folder):
    known = (".h5", ".csv", ".jsonl")
    return [p for p in folder.rglob("*") if p.is_file() and p.suffix not in known]


def test_an_interrupt_ends_with_130_and_resume_goes_on(uwtrack, many):
    running = start_batch(many, "--jobs", "2")
    wait_for_products(many, 1)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert running.returncode == 130, said
    assert "Traceback" not in said
    assert leftovers(many / "out") == []
    complete = list((many / "out").glob("*.h5"))
    assert 1 <= len(complete) < N_MANY
    assert uwtrack("verify", *complete).exit_code == 0
    done = uwtrack("batch", "many", "-o", "out", "--resume", "--jobs", 1)
    assert done.exit_code == 0, done.output
    statuses = [row["status"] for row in rows_of("out").values()]
    assert statuses.count("resumed") == len(complete)
    assert len(statuses) == N_MANY


def workers_of(running, n, limit_s=60):
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


@pytest.mark.parametrize(
    ("name", "code"), [("SIGTERM", 143), ("SIGHUP", 129), ("SIGKILL", -9)]
)
def test_no_worker_outlives_a_batch_that_is_ended(uwtrack, many, name, code):
    lengthen(many)
    running = start_batch(many, "--jobs", "2")
    workers = workers_of(running, 2)
    wait_for_products(many, 1)
    running.send_signal(getattr(signal, name))
    running.wait(timeout=60)
    _, alive = psutil.wait_procs(workers, timeout=PATIENCE_S + 5)
    assert alive == []
    _, said = running.communicate()
    assert running.returncode == code, said
    assert "Traceback" not in said
    assert leftovers(many / "out") == []
    complete = list((many / "out").glob("*.h5"))
    assert 1 <= len(complete) < N_MANY
    assert uwtrack("verify", *complete).exit_code == 0
    if name != "SIGKILL":
        assert {row["status"] for row in rows_of("out").values()} <= {"done"}


def test_a_worker_without_the_signal_of_its_parents_death_ends_all_the_same(many):
    program = (
        "from uwtrack_cli.flow import worker_pool\n"
        "worker_pool.PR_SET_PDEATHSIG = -1  # no such request\n"
        "from uwtrack_cli.cli import main\n"
        "if __name__ == '__main__': main()\n"
    )
    lengthen(many)
    (many / "program.py").write_text(program)  # a worker imports it, too
    running = subprocess.Popen(
        [sys.executable, "program.py", "batch", "many", "-o", "out", "--jobs", "2"],
        cwd=many, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    workers = workers_of(running, 2)
    wait_for_products(many, 1)
    running.kill()
    running.wait()
    _, alive = psutil.wait_procs(workers, timeout=PATIENCE_S + 5)
    running.communicate()
    assert alive == []


def test_a_lost_worker_costs_its_own_file_and_is_replaced(many):
    running = start_batch(many, "--jobs", "2")
    workers = workers_of(running, 2)
    wait_for_products(many, 1)
    os.kill(workers[0].pid, signal.SIGKILL)
    psutil.wait_procs(workers[:1], timeout=5)
    after = workers_of(running, 2)
    _, said = running.communicate(timeout=200)
    assert workers[1].pid in {worker.pid for worker in after}
    rows = rows_of(many / "out").values()
    failed = [row for row in rows if row["status"] == "failed"]
    assert len(failed) <= 1  # none if it was lost just after it placed its product
    assert running.returncode == (3 if failed else 0), said
    for row in failed:
        assert "the process that ran it was ended by SIGKILL" in row["message"]
    assert len(rows) == N_MANY
    assert len(list((many / "out").glob("*.h5"))) == N_MANY - len(failed)


def but_the_last_line(path):
    return path.read_bytes()[:-LINE_BYTES]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_cluster_that_loses_a_worker_gives_the_same_results(uwtrack, many):
    environment = {**os.environ, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "3"}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    scheduler = subprocess.Popen(
        [*dask, "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
         "--scheduler-file", "s.json"],
        cwd=many, env=environment, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    workers = []
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
        running = start_batch(many, "--scheduler", address)
        wait_for_products(many, 2)
        workers[0].kill()
        _, said = running.communicate(timeout=200)
        assert running.returncode == 0, said
    finally:
        for process in [*workers, scheduler]:
            process.kill()
            process.wait()
    assert uwtrack("batch", "many", "-o", "local", "--jobs", 1).exit_code == 0
    made = {path.name: but_the_last_line(path) for path in many.glob("out/*.h5")}
    assert len(made) == N_MANY
    local = {path.name: but_the_last_line(path) for path in many.glob("local/*.h5")}
    assert made == local  # the time of creation is in the last line


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_scheduler_that_is_lost_ends_with_a_sentence_and_resume_goes_on(
    uwtrack, many
):
    lengthen(many)
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    started = [
        subprocess.Popen(
            [*dask, "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
             "--scheduler-file", "s.json"], cwd=many, stderr=subprocess.DEVNULL,
        )
    ]  # fmt: skip
    try:
        address = scheduler_address(many / "s.json")
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address]
        started.append(
            subprocess.Popen(
                [*worker, "--nthreads", "1", "--no-nanny", "--no-dashboard",
                 "--local-directory", many / "w"], cwd=many, stderr=subprocess.DEVNULL,
            )
        )  # fmt: skip
        running = start_batch(many, "--scheduler", address)
        wait_for_products(many, 1)
        started[0].kill()
        _, said = running.communicate(timeout=200)
    finally:
        for process in started:
            process.kill()
            process.wait()
    assert running.returncode == 1, said
    assert "Traceback" not in said
    (line,) = said.strip().splitlines()
    assert line.startswith(f"error: the scheduler {address} is lost")
    assert "--resume" in line
    for path in sorted((many / "many").glob("*.wav"))[1:]:
        path.unlink()
    done = uwtrack("batch", "many", "-o", "out", "--resume", "--jobs", 1)
    assert "1 resumed" in done.stderr


def scheduler_address(path, limit_s=60):
    begin = time.monotonic()
    while time.monotonic() - begin < limit_s:
        if path.exists():
            try:
                return json.loads(path.read_text())["address"]
            except ValueError:
                pass
        time.sleep(0.1)
    pytest.fail("the scheduler did not start")


@pytest.mark.parametrize("chain", ["run", "commands"])
def test_a_product_is_made_again_from_its_history(uwtrack, short_pass, tmp_path, chain):
    for name in ("pass.wav", "pass.sensor.toml"):
        (tmp_path / name).write_bytes((short_pass.parent / name).read_bytes())
    if chain == "run":
        words = [["run", "pass.wav", "--start-s", 5, "--set", "peaks.kept_probability=0.02",
                  "--start-utc", "2024-05-01T12:00:00Z", "-o", "p.h5"]]  # fmt: skip
    else:
        words = [
            ["spectrogram", "pass.wav", "--stop-s", 60, "--window-s", 0.5],
            ["peaks", "pass.spectrogram.h5"],
            ["track", "pass.peaks.h5", "-o", "p.h5"],
        ]
    for line in words:
        done = uwtrack(*line)
        assert done.exit_code == 0, done.output
    again = uwtrack("rerun", "p.h5", "-o", "again.h5")
    assert again.exit_code == 0, again.output
    done = uwtrack("diff", "p.h5", "again.h5")
    assert done.exit_code == 0, done.output
    with read_product("p.h5") as one, read_product("again.h5") as other:
        assert one.paths.keys() == other.paths.keys()
        assert [s.to_json() for s in one.history] == [
            s.to_json() for s in other.history
        ]


def test_a_fit_of_a_table_is_made_again(uwtrack, tmp_path):
    time_s = np.arange(0.0, 200.0)
    ahead = 6.0 * (time_s - 100.0)
    shift = -6.0 / 1500.0 * ahead / np.hypot(ahead, 200.0)
    lines = [
        f"{t},{300 * (1 + s):.5f},0.05" for t, s in zip(time_s, shift, strict=True)
    ]
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
