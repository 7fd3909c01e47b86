"""Recordings of a folder as they arrive: each one is run once, when it is complete.

**Method.** The folder is listed again and again. A recording is complete when it has
not changed for a while and holds as much sound as its header says; one that does not
say so, or says otherwise, is awaited ten times as long and then taken for what it is.
What became of a recording is a line of the journal in the folder of the products,
synced before the next one is begun. After a kill the journal says what is done; a product
that was placed but not noted is recognised by its own history and kept.

**Conventions.** A recording that changes after it was run is run again. One that failed is
not tried again until it changes.
"""

import contextlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Self

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.header import sample_bytes
from uwtrack_cli.flow.batch import FAILED, Job, Outcome, run_job
from uwtrack_cli.flow.batch_report import report_rows
from uwtrack_cli.flow.batch_sources import find_recordings, make_jobs
from uwtrack_cli.flow.recipe import Recipe

JOURNAL = "watch.jsonl"
"""Name of the journal in the folder of the products."""

LOOK_S = 1.0
"""The folder is listed again after so long, s."""

PATIENCE = 10.0
"""How many times longer a recording is awaited whose header says that it is not whole."""

Stamp = tuple[int, int]
"""Size in bytes and time of change in ns: whether a file is still the same."""


@dataclass(frozen=True)
class WatchTimes:
    """When a recording is complete, and when nothing more is expected."""

    settle_s: float = 5.0
    """A recording that did not change for so long is complete, s."""
    idle_s: float | None = None
    """The watch ends when nothing was waited for or run for so long, s; None: never."""


class Journal:
    """What became of every recording, one line of JSON each; written by one program.

    ``folder``: folder of the products.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / JOURNAL
        self._file: BinaryIO = self.path.open("a+b")
        try:
            _lock(self._file)
            self._done = self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        """Return the journal, open and locked."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the journal."""
        self._file.close()

    def is_done(self, source: Path, stamp: Stamp) -> bool:
        """Tell whether a recording was run as it is now."""
        return self._done.get(str(source)) == stamp

    def note(self, row: Mapping[str, Any], source: Path, stamp: Stamp) -> None:
        """Add what became of a recording, safe from a kill or a loss of power.

        ``stamp``: size and time of change of the recording when it was run.
        """
        self._done[str(source)] = stamp
        facts = {**row, "size_bytes": stamp[0], "modified_ns": stamp[1]}
        self._file.write(json.dumps(facts, ensure_ascii=False).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self) -> dict[str, Stamp]:
        """Read what was noted; half a line that a kill has left is removed."""
        self._file.seek(0)
        done: dict[str, Stamp] = {}
        end = 0
        for line in self._file:
            if not line.endswith(b"\n"):
                break
            end += len(line)
            try:
                row = json.loads(line)
                stamp = int(row["size_bytes"]), int(row["modified_ns"])
                done[str(row["source"])] = stamp
            except (ValueError, KeyError, TypeError) as error:
                msg = (
                    f"{self.path} is no journal of uwtrack watch ({error}); "
                    f"move it away, or name another folder with --output."
                )
                raise DataError(msg) from error
        self._file.truncate(end)
        return done


def watch_folder(
    folder: Path,
    output: Path,
    recipe: Recipe,
    options: Mapping[str, Any],
    times: WatchTimes,
    is_ending: Callable[[], bool] = lambda: False,
) -> Iterator[Outcome]:
    """Run a recipe over the recordings of a folder as they arrive.

    Parameters
    ----------
    folder
        Folder with recordings, in folders of its own, too.
    output
        Folder of the products and of the journal.
    options
        How recordings are opened: the options of `open_with_options`.
    times
        When a recording is complete, and when the watch ends.
    is_ending
        Asked between two recordings: whether to end.

    Yields
    ------
    Outcome
        What became of a recording, when it is noted in the journal.

    Raises
    ------
    DataError
        The folder does not exist, or another program has the journal.
    """
    if not folder.is_dir():
        msg = f"{folder} is no folder that can be watched."
        raise DataError(msg)
    output.mkdir(parents=True, exist_ok=True)
    arrivals = _Arrivals(times.settle_s)
    with Journal(output) as journal:
        last_s = time.monotonic()
        while not is_ending():
            jobs = _jobs(folder, output, recipe, options)
            for job, stamp in arrivals.complete(jobs, journal):
                yield _run(job, stamp, journal, output)
                last_s = time.monotonic()
                if is_ending():
                    return
            if arrivals.n_waiting:
                last_s = time.monotonic()
            if times.idle_s is not None and time.monotonic() - last_s >= times.idle_s:
                return
            time.sleep(min(LOOK_S, times.settle_s, times.idle_s or LOOK_S))


def _jobs(
    folder: Path, output: Path, recipe: Recipe, options: Mapping[str, Any]
) -> list[Job]:
    """Return a job for every recording that is there now."""
    try:
        found = find_recordings([folder])
    except DataError:  # there is none yet
        return []
    return make_jobs(found, output, recipe, options, resume=True)


def _run(job: Job, stamp: Stamp, journal: Journal, output: Path) -> Outcome:
    """Run a job and note it, unless its recording has changed meanwhile."""
    outcome = run_job(job)
    (row,) = report_rows([outcome], output)
    if outcome.status != FAILED or _stamp(job.sources[0]) == stamp:
        journal.note(row, job.sources[0], stamp)
    return outcome


class _Arrivals:
    """Recordings that are awaited, and since when each one has not changed."""

    def __init__(self, settle_s: float) -> None:
        self._settle_s = settle_s
        self._since: dict[Path, tuple[Stamp, float]] = {}

    @property
    def n_waiting(self) -> int:
        """Recordings that are not complete yet."""
        return len(self._since)

    def complete(
        self, jobs: list[Job], journal: Journal
    ) -> Iterator[tuple[Job, Stamp]]:
        """Yield what is complete and not done, the oldest recording first."""
        there = {job.sources[0]: job for job in jobs}
        stamps = {path: _stamp(path) for path in there}
        open_ = {p: s for p, s in stamps.items() if s and not journal.is_done(p, s)}
        self._since = {p: known for p, known in self._since.items() if p in open_}
        for path, stamp in sorted(open_.items(), key=lambda item: item[1][1]):
            if self._is_settled(path, stamp):
                self._since.pop(path, None)
                yield there[path], stamp

    def _is_settled(self, path: Path, stamp: Stamp) -> bool:
        now_s = time.monotonic()
        known, since_s = self._since.get(path, (stamp, now_s))
        if known != stamp:
            since_s = now_s
        self._since[path] = stamp, since_s
        age_s = max(now_s - since_s, time.time() - stamp[1] / 1e9)
        needed_s = self._settle_s * (1.0 if _is_whole(path) else PATIENCE)
        return age_s >= needed_s


def _is_whole(path: Path) -> bool:
    """Tell whether a recording holds as much sound as its header says."""
    with contextlib.suppress(OSError):
        counted = sample_bytes(path)
        return counted is None or not (counted.is_truncated or counted.is_unstated)
    return False


def _stamp(path: Path) -> Stamp | None:
    """Return size and time of change; None for a file that is gone."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_size, facts.st_mtime_ns


def _lock(file: BinaryIO) -> None:
    """Refuse a journal that another program writes, where the system can tell."""
    try:
        import fcntl
    except ImportError:  # a system without such locks
        return
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        msg = f"{file.name} is written by another uwtrack watch; end that one first."
        raise DataError(msg) from error
