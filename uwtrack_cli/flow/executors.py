"""Where jobs run: in this process, in local processes, or on a Dask cluster.

**Method.** All three give the same outcomes, since a job depends on nothing but
itself. A local process that dies takes its pool along; what was not finished is then
run again, each job in a process of its own, so that only the deadly one fails. On a
cluster the scheduler does the same: it gives the jobs of a lost worker to others.

**Conventions.** Outcomes come as they are ready, with the number of their job. An
interrupt ends the running jobs at once; none of them leaves half a file.
"""

import multiprocessing
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from typing import Any

from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.flow.batch import FAILED, Job, Outcome, run_job

CONNECT_S = 10.0
RETRIES = 3


def available_processors() -> int:
    """Return how many processors this program may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def run_jobs(
    jobs: Sequence[Job], *, n_workers: int = 1, scheduler: str | None = None
) -> Iterator[tuple[int, Outcome]]:
    """Run jobs and yield their outcomes as they are ready.

    Parameters
    ----------
    jobs
        What to make.
    n_workers
        Local processes, 1 or more; one means in this process.
    scheduler
        Address of a Dask scheduler to run on instead.

    Raises
    ------
    OptionError
        Less than one worker, or Dask is not installed.
    DataError
        The scheduler does not answer.
    """
    if n_workers < 1:
        msg = f"--jobs must be 1 or more, got {n_workers}."
        raise OptionError(msg)
    numbered = dict(enumerate(jobs))
    if scheduler is None and n_workers == 1:
        for number, job in numbered.items():
            yield number, run_job(job)
        return
    for number in [n for n, job in numbered.items() if _is_refused(job)]:
        yield number, run_job(numbered.pop(number))
    sent = {
        number: replace(job, may_repeat=not job.overwrite)
        for number, job in numbered.items()
    }
    if scheduler is not None:
        yield from _on_cluster(sent, scheduler)
    else:
        yield from _on_processes(sent, n_workers)


def _is_refused(job: Job) -> bool:
    """Tell whether a product was there before, so that a job may not repeat itself."""
    return job.target.exists() and not (job.resume or job.overwrite)


def _on_processes(
    jobs: Mapping[int, Job], n_workers: int
) -> Iterator[tuple[int, Outcome]]:
    left = dict(jobs)
    try:
        with _pool(n_workers) as pool:
            for number, outcome in _outcomes(pool, jobs):
                del left[number]
                yield number, outcome
    except BrokenProcessPool:
        for number, job in left.items():
            yield number, _alone(job)


def _alone(job: Job) -> Outcome:
    """Run a job in a process of its own."""
    try:
        with _pool(1) as pool:
            return pool.submit(_interruptible, job).result()
    except BrokenProcessPool:
        return Outcome(
            str(job.sources[0]),
            str(job.target),
            FAILED,
            "the process that ran it died; was there not enough memory?",
            len(job.sources),
        )


def _pool(n_workers: int) -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(n_workers, context, initializer=_ignore_interrupt)


def _outcomes(pool: Executor, jobs: Mapping[int, Job]) -> Iterator[tuple[int, Outcome]]:
    futures = {pool.submit(_interruptible, job): n for n, job in jobs.items()}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BaseException:
        for future in futures:
            future.cancel()
        for child in multiprocessing.active_children():
            if child.pid is not None:
                os.kill(child.pid, signal.SIGINT)
        raise


def _ignore_interrupt() -> None:
    """Let the main process decide: an idle worker ends with its pool."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interruptible(job: Job) -> Outcome:
    """Run a job so that an interrupt ends it and removes what it has begun."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return run_job(job)
    except KeyboardInterrupt:
        return Outcome(str(job.sources[0]), str(job.target), FAILED, "interrupted")
    finally:
        _ignore_interrupt()


def _on_cluster(jobs: Mapping[int, Job], address: str) -> Iterator[tuple[int, Outcome]]:
    try:
        from distributed import Client
    except ImportError as error:
        msg = f"--scheduler needs Dask ({error}); pip install 'uwtrack[cluster]'."
        raise OptionError(msg) from error
    try:
        client: Any = Client(  # type: ignore[no-untyped-call]
            address, timeout=CONNECT_S, set_as_default=False
        )
    except (OSError, ValueError, TypeError) as error:
        msg = f"the scheduler {address} does not answer ({error})."
        raise DataError(msg) from error
    with client:
        pool = client.get_executor(pure=False, retries=RETRIES)
        futures = {pool.submit(run_job, job): number for number, job in jobs.items()}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            for future in futures:
                future.cancel()
