"""Where jobs run: in this process, in local processes, or on a Dask cluster.

**Method.** All three give the same outcomes, since a job depends on nothing but
itself. A local process that dies costs the job that it ran. On a
cluster the scheduler gives the jobs of a lost worker to others.

Each local worker has a pipe of its own, so that the death of one names the job
that it cost: that job fails, a new worker takes the place, and the others go on. A
worker ends when the program that started it is gone, however it went. While it waits
for a job it meets the end of its pipe. While it works, Linux sends it the signal that
it asked for (prctl(2), PR_SET_PDEATHSIG), and on every system a thread waits for the
end of the parent.

**Conventions.** Outcomes come as they are ready, with the number of their job. An
interrupt ends the running jobs at once; none of them leaves half a file.

Interrupts and hang-ups are for the parent, which then interrupts its
workers; SIGTERM ends a worker. Both let it remove what it has begun.
"""

import contextlib
import ctypes
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import connection, get_context, parent_process
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import Any, NoReturn

from uwtrack_cli.errors import DataError, OptionError, needing
from uwtrack_cli.flow.batch import Job, Outcome, finished, looked_over, run_job
from uwtrack_cli.flow.engine import Progress

JobProgress = Callable[[int, float], None]
"""Takes the number of a job and the seconds of its sound that are done."""

CONNECT_S = 10.0
SENT_EVERY_S = 0.5
RETRIES = 3


def available_processors() -> int:
    """Return how many processors this program may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def _nothing(_number: int, _done_s: float) -> None:
    """Take progress that nobody looks at."""


def run_jobs(
    jobs: Sequence[Job],
    *,
    n_workers: int = 1,
    scheduler: str | None = None,
    progress: JobProgress = _nothing,
) -> Iterator[tuple[int, Outcome]]:
    """Run jobs and yield their outcomes as they are ready.

    ``n_workers``: local processes, 1 or more; one means in this process. ``scheduler``:
    address of a Dask scheduler to run on instead. ``progress``: called with the number
    of a job and the seconds of its sound that are done; on a cluster it is not.

    Raises
    ------
    OptionError
        Less than one worker, or Dask is not installed.
    DataError
        The scheduler does not answer.
    """
    if n_workers < 1:
        raise OptionError(f"--jobs must be 1 or more, got {n_workers}.")
    numbered = dict(enumerate(jobs))
    if scheduler is None and n_workers == 1:
        for number, job in looked_over(numbered):
            yield number, run_job(job, partial(progress, number))
        return
    if scheduler is None:
        yield from run_in_processes(looked_over(numbered), min(n_workers, len(numbered)), progress)
        return
    for number in [n for n, job in numbered.items() if _is_refused(job)]:
        yield number, run_job(numbered.pop(number))
    sent = {number: replace(job, may_repeat=not job.overwrite) for number, job in numbered.items()}
    yield from _on_cluster(sent, scheduler)


def _is_refused(job: Job) -> bool:
    """Tell whether a product was there before, so that a job may not repeat itself."""
    return job.target.exists() and not (job.resume or job.overwrite)


def _on_cluster(jobs: Mapping[int, Job], address: str) -> Iterator[tuple[int, Outcome]]:
    with needing("--scheduler needs Dask", "cluster", OptionError):
        from distributed import Client
    try:
        client: Any = Client(  # type: ignore[no-untyped-call]
            address, timeout=CONNECT_S, set_as_default=False
        )
    except (OSError, ValueError, TypeError) as error:
        raise DataError(f"the scheduler {address} does not answer ({error}).") from error
    with _without_logs(), client:
        pool = client.get_executor(pure=False, retries=RETRIES)
        futures = {pool.submit(run_job, job): number for number, job in jobs.items()}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except (CancelledError, OSError, TimeoutError) as error:
            reason = str(error) or type(error).__name__
            raise DataError(
                f"the scheduler {address} is lost ({reason}); what was made is kept: "
                f"start one again and give --resume."
            ) from error
        finally:
            for future in futures:
                future.cancel()


@contextmanager
def _without_logs() -> Iterator[None]:
    """Keep to ourselves what Dask logs of a lost scheduler: one sentence says it."""
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


PATIENCE_S = 10.0
"""How long a worker may take to remove what it has begun, s."""

PR_SET_PDEATHSIG = 1
HELD = {signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)}
"""Signals that a terminal sends to all its processes, and the parent deals with."""


@dataclass
class Worker:
    """A process, the parent's end of the pipe to it, and its job with its number."""

    process: BaseProcess
    pipe: connection.Connection
    number: int = 0
    job: Job | None = None


def run_in_processes(
    jobs: Iterable[tuple[int, Job]], n_workers: int, progress: JobProgress = _nothing
) -> Iterator[tuple[int, Outcome]]:
    """Run jobs in local processes and yield their outcomes as they are ready.

    ``jobs``: what to make, with its number. ``n_workers``: how many processes, 1 or
    more. ``progress``: as for `run_jobs`.
    """
    waiting = iter(jobs)
    workers = [_start() for _ in range(n_workers)]
    try:
        while True:
            for worker in [worker for worker in workers if worker.job is None]:
                _give(worker, *next(waiting, (0, None)))
            busy = [worker for worker in workers if worker.job is not None]
            if not busy:
                return
            ready = connection.wait([worker.pipe for worker in busy])
            for worker in [worker for worker in busy if worker.pipe in ready]:
                answer = _answer(worker)
                if isinstance(answer, float):
                    progress(worker.number, answer)
                    continue
                worker.job = None
                if worker.pipe.closed:
                    workers[workers.index(worker)] = _start()
                yield worker.number, answer
    finally:
        _end(workers)


def _start() -> Worker:
    """Start a worker; it holds back a terminal's signals until it can meet them."""
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, os.getpid()), daemon=True)
    with _held_back():
        process.start()
    theirs.close()
    return Worker(process, ours)


@contextlib.contextmanager
def _held_back() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, HELD)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _give(worker: Worker, number: int, job: Job | None) -> None:
    """Give a worker a job, if there is one."""
    worker.number, worker.job = number, job
    if job is not None:
        with contextlib.suppress(OSError):  # it died: its answer tells
            worker.pipe.send(job)


def _answer(worker: Worker) -> Outcome | float:
    """Return what a worker sent: an outcome, or the seconds of sound that are done."""
    assert worker.job is not None  # noqa: S101 - for the type checker
    try:
        answer: Outcome | float = worker.pipe.recv()
    except (EOFError, OSError):
        answer = _lost(worker, worker.job)
    return answer


def _lost(worker: Worker, job: Job) -> Outcome:
    """Say how a worker ended that took its job along; its pipe is closed."""
    worker.pipe.close()
    worker.process.join(PATIENCE_S)
    if (outcome := finished(job)) is not None:
        return outcome
    code = worker.process.exitcode
    how = f"ended with code {code}"
    if code is not None and code < 0:
        how = f"was ended by {signal.Signals(-code).name}"
    message = f"the process that ran it {how}; was there not enough memory?"
    return job.failed(message)


def _end(workers: Sequence[Worker]) -> None:
    """End all workers, those in the middle of a job by an interrupt."""
    for worker in workers:
        pid = worker.process.pid
        if worker.job is not None and pid is not None and worker.process.is_alive():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGINT)
        worker.pipe.close()
    deadline = time.monotonic() + PATIENCE_S
    for worker in workers:
        worker.process.join(max(0.0, deadline - time.monotonic()))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()


def _serve(pipe: connection.Connection, parent_pid: int) -> None:
    """Run jobs as they come, until the pipe or the parent ends."""
    _end_with(parent_pid)
    for held in HELD:
        signal.signal(held, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, HELD)
    code = 0
    try:
        while True:
            pipe.send(_run(pipe.recv(), _now_and_then(pipe)))
    except (EOFError, OSError, KeyboardInterrupt):
        pass  # the parent is gone, or has interrupted a worker between two jobs
    except SystemExit as ending:
        code = int(ending.code or 0)
    # What was begun is removed. An interpreter that takes itself down would still let
    # HDF5 close files whose Python half is gone, and report it.
    os._exit(code)


def _now_and_then(pipe: connection.Connection) -> Progress:
    """Return what sends the seconds of sound that are done, at most twice a second."""
    last = time.monotonic()

    def send(done_s: float) -> None:
        nonlocal last
        if time.monotonic() - last > SENT_EVERY_S:
            last = time.monotonic()
            pipe.send(float(done_s))

    return send


def _run(job: Job, progress: Progress) -> Outcome:
    """Run a job so that a signal ends it and removes what it has begun."""
    signal.signal(signal.SIGTERM, _exit)
    signal.signal(signal.SIGINT, _interrupt)
    try:
        return run_job(job, progress)
    except KeyboardInterrupt:
        return job.failed("interrupted")
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _exit(number: int, _: FrameType | None) -> NoReturn:
    sys.unraisablehook = _send_again
    raise SystemExit(128 + number)


def _interrupt(_: int, __: FrameType | None) -> NoReturn:
    sys.unraisablehook = _send_again
    raise KeyboardInterrupt


def _send_again(lost: Any) -> None:
    """Send a signal again that came while Python could not pass it on.

    What else goes wrong while a process ends is not worth a word.
    """
    number = {KeyboardInterrupt: signal.SIGINT, SystemExit: signal.SIGTERM}.get(lost.exc_type)
    if number is not None:  # from another thread: here it would be lost again
        threading.Timer(0.05, os.kill, [os.getpid(), number]).start()


def _end_with(parent_pid: int) -> None:
    """Make sure that this process ends soon after its parent."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent_pid:  # it ended before it could be watched
        raise SystemExit(128 + signal.SIGTERM)
    threading.Thread(target=_watch_parent, daemon=True).start()


def _watch_parent() -> None:
    parent = parent_process()
    assert parent is not None  # noqa: S101 - this is a worker
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE_S)
    os._exit(128 + signal.SIGTERM)
