"""Recordings of a folder as they arrive: each one is run once, when it is complete.

**Method.** The folder is listed again and again. A recording is complete when it has
not changed for a while and holds as much sound as its header says; one that does not
say so, or says otherwise, is awaited ten times as long and then taken for what it is.
What became of a recording is a line of the journal in the folder of the products,
synced before the next one is begun. After a kill the journal says what is done; a product
that was placed but not noted is recognised by its own history and kept.

**Conventions.** A recording that changes after it was run is run again. One that failed is
not tried again until it changes; but where the reason may pass (a full disk, an input
that is not there yet) it is, after a minute and then twice as long each time, up to an
hour. A journal that was removed ends the watch: nothing could be noted any more.
"""

import contextlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from io import FileIO
from pathlib import Path
from typing import Any, Self

from uwtrack_cli.errors import DataError, OutputError
from uwtrack_cli.files.audio.header import sample_bytes
from uwtrack_cli.flow.batch import FAILED, Job, Outcome, not_ours, run_job
from uwtrack_cli.flow.batch_report import report_rows
from uwtrack_cli.flow.batch_sources import FoundRecording, find_recordings, make_jobs, other_source
from uwtrack_cli.flow.recipe import Recipe

JOURNAL = "watch.jsonl"
"""Name of the journal in the folder of the products."""

LOOK_S = 1.0
"""The folder is listed again after so long, s."""

PATIENCE = 10.0
"""How many times longer a recording is awaited whose header says that it is not whole."""

RETRY_S = 60.0, 3600.0
"""What failed for a reason that may pass is tried again after the first of these times,
s, then after twice as long each time, up to the second."""

BEGIN = b'{"source": '
"""How every line of a journal begins."""

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

    Raises
    ------
    OutputError
        The file of this name is no journal of a watch.
    DataError
        Another program writes it.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / JOURNAL
        self.failed: dict[str, bool] = {}
        """Recordings that failed when they were run last, and whether to try again."""
        self._done: dict[str, Stamp] = {}
        self._file = self.path.open("a+b", buffering=0)
        try:
            _lock(self._file)
            self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        """Return the journal, open and locked."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the journal."""
        self._file.close()

    @property
    def sources(self) -> list[str]:
        """Recordings that are done."""
        return list(self._done)

    def is_done(self, source: Path, stamp: Stamp) -> bool:
        """Tell whether a recording was run as it is now."""
        return self._done.get(str(source)) == stamp

    def note(self, row: Mapping[str, Any], stamp: Stamp) -> None:
        """Add what became of a recording, safe from a kill or a loss of power.

        ``row``: its row of the report. ``stamp``: size and time of change of the
        recording when it was run.

        Raises
        ------
        OSError
            It cannot be written, and the journal is as it was.
        """
        facts = {**row, "size_bytes": stamp[0], "modified_ns": stamp[1]}
        text = json.dumps(facts, ensure_ascii=False) + "\n"
        line = text.encode("utf-8", "surrogatepass")  # a name may be any bytes
        end = os.fstat(self._file.fileno()).st_size
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError:
            self._file.truncate(end)
            raise
        self._take(facts)

    def check_there(self) -> None:
        """Refuse to go on without the journal.

        Raises
        ------
        OutputError
            It was removed, or its folder was.
        """
        with contextlib.suppress(OSError):
            if os.path.samestat(self.path.stat(), os.fstat(self._file.fileno())):
                return
        folder = self.path.parent
        lost = self.path if folder.is_dir() else folder
        raise OutputError(f"{lost} was removed while it was in use: the watch ends.")

    def _read(self) -> None:
        """Read what was noted; half a line that a kill has left is removed."""
        self._file.seek(0)
        end = 0
        for line in self._file.readall().splitlines(keepends=True):
            if not line.endswith(b"\n") and line[: len(BEGIN)] == BEGIN[: len(line)]:
                break
            try:
                self._take(json.loads(line))
            except (ValueError, KeyError, TypeError) as error:
                raise OutputError(not_ours(self.path)) from error
            end += len(line)
        self._file.truncate(end)

    def _take(self, row: Mapping[str, Any]) -> None:
        source = str(row["source"])
        stamp = int(row["size_bytes"]), int(row["modified_ns"])
        self.failed.pop(source, None)
        if row.get("status") == FAILED:
            self.failed[source] = bool(row.get("retry"))
        if not self.failed.get(source):
            self._done[source] = stamp


def watch_folder(
    folder: Path,
    output: Path,
    recipe: Recipe,
    options: Mapping[str, Any],
    times: WatchTimes,
    *,
    overwrite: bool = False,
    is_ending: Callable[[], bool] = lambda: False,
    tell: Callable[[str], None] = lambda _: None,
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
    overwrite
        Whether products of another job, and the journal of another folder, may be
        taken over.
    is_ending
        Asked between two recordings: whether to end.
    tell
        Takes what a person should know of the watch itself, in sentences.

    Yields
    ------
    Outcome
        What became of a recording, when it is noted in the journal.

    Raises
    ------
    DataError
        The folder does not exist, or another program has the journal.
    OutputError
        The journal is of another folder or no journal, or was removed meanwhile.
    """
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder that can be watched.")
    output.mkdir(parents=True, exist_ok=True)
    make = partial(
        make_jobs, folder=output, recipe=recipe, options=options, resume=True, overwrite=overwrite
    )
    make([])  # what is wrong for all recordings ends the watch before it begins
    said: set[str] = set()

    def jobs() -> list[Job]:
        found, wrong = _jobs(folder, make)
        if wrong not in {"", *said}:
            said.add(wrong)
            tell(wrong)
        return found

    with Journal(output) as journal:
        if not overwrite:
            _refuse_other(journal, folder)
        if journal.failed:
            tell(_failures(journal))
        yield from _watch(jobs, journal, times, is_ending)


def _watch(
    jobs: Callable[[], list[Job]],
    journal: Journal,
    times: WatchTimes,
    is_ending: Callable[[], bool],
) -> Iterator[Outcome]:
    """Run what is complete and not done, again and again; ``jobs``: all there are now."""
    arrivals = _Arrivals(times.settle_s)
    last_s = time.monotonic()
    while not is_ending():
        journal.check_there()
        for job, stamp in arrivals.complete(jobs(), journal):
            outcome = _run(job, stamp, journal)
            if outcome.retry:
                arrivals.put_off(job.sources[0], stamp)
            yield outcome
            last_s = time.monotonic()
            if is_ending():
                return
        if arrivals.n_waiting:
            last_s = time.monotonic()
        if times.idle_s is not None and time.monotonic() - last_s >= times.idle_s:
            return
        time.sleep(min(LOOK_S, times.settle_s, times.idle_s or LOOK_S))


def _refuse_other(journal: Journal, folder: Path) -> None:
    """Refuse the journal of another folder, whose products have the same names."""
    found: list[FoundRecording] = []
    with contextlib.suppress(DataError):  # there is no recording yet
        found = find_recordings([folder])
    other = other_source(journal.sources, found, [folder])
    if other:
        raise OutputError(
            f"{journal.path} is the journal of another folder, of {other}: name another "
            f"folder with --output, or give --overwrite to go on with it."
        )


def _failures(journal: Journal) -> str:
    """Say how many recordings of a journal failed, and when they are tried again."""
    n, now = len(journal.failed), sum(journal.failed.values())
    counts = [f"{now} now"] * (now > 0) + [f"{n - now} when they change"] * (n > now)
    recordings = "1 recording" if n == 1 else f"{n} recordings"
    again = " and ".join(counts)
    return f"{journal.path}: {recordings} failed before; tried again: {again}."


def _jobs(
    folder: Path, make: Callable[[Sequence[FoundRecording]], list[Job]]
) -> tuple[list[Job], str]:
    """Return a job for every recording that is there now, and why there is none."""
    try:
        found = find_recordings([folder])
    except DataError:  # there is none yet
        return [], ""
    try:
        return make(found), ""
    except DataError as error:  # a sensor file that is being changed
        return [], str(error)


def _run(job: Job, stamp: Stamp, journal: Journal) -> Outcome:
    """Run a job and note it, unless its recording has changed meanwhile."""
    outcome = run_job(job)
    journal.check_there()
    (row,) = report_rows([outcome], journal.path.parent)
    if outcome.status != FAILED or _stamp(job.sources[0]) == stamp:
        try:
            journal.note(row, stamp)
        except OSError as error:  # a product that is there is recognised next time
            said = f"cannot write {journal.path}: {error.strerror or error}."
            message = outcome.message or said
            return replace(outcome, status=FAILED, message=message, retry=True)
    return outcome


class _Arrivals:
    """Recordings that are awaited, and since when each one has not changed."""

    def __init__(self, settle_s: float) -> None:
        self._settle_s = settle_s
        self._since: dict[Path, tuple[Stamp, float]] = {}
        self._later: dict[Path, tuple[Stamp, float, float]] = {}

    @property
    def n_waiting(self) -> int:
        """Recordings that are not complete yet."""
        return len(self._since)

    def put_off(self, path: Path, stamp: Stamp) -> None:
        """Leave a recording for a while, unless it changes."""
        first_s, longest_s = RETRY_S
        known, _, pause_s = self._later.get(path, (None, 0.0, 0.0))
        pause_s = min(2.0 * pause_s, longest_s) if known == stamp else first_s
        self._later[path] = stamp, time.monotonic() + pause_s, pause_s

    def _is_put_off(self, path: Path, stamp: Stamp) -> bool:
        known, until_s, _ = self._later.get(path, (None, 0.0, 0.0))
        return known == stamp and time.monotonic() < until_s

    def complete(self, jobs: list[Job], journal: Journal) -> Iterator[tuple[Job, Stamp]]:
        """Yield what is complete and not done, the oldest recording first."""
        there = {job.sources[0]: job for job in jobs}
        stamps = {path: _stamp(path) for path in there}
        open_ = {
            p: s for p, s in stamps.items()
            if s and not (journal.is_done(p, s) or self._is_put_off(p, s))
        }  # fmt: skip
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
        return counted is None or not (
            counted.is_truncated or (counted.is_unstated and not counted.is_open)
        )
    return False


def _stamp(path: Path) -> Stamp | None:
    """Return size and time of change; None for a file that is gone."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_size, facts.st_mtime_ns


def _lock(file: FileIO) -> None:
    """Refuse a journal that another program writes, where the system can tell."""
    try:
        import fcntl
    except ImportError:  # a system without such locks
        return
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise DataError(
            f"{file.name} is written by another uwtrack watch; end that one first."
        ) from error
