"""Where jobs run: in this process, in local processes, or on a Dask cluster.

**Method.** All three give the same outcomes, since a job depends on nothing but
itself. A local process that dies costs the job that it ran (see `worker_pool`). On a
cluster the scheduler gives the jobs of a lost worker to others.

**Conventions.** Outcomes come as they are ready, with the number of their job. An
interrupt ends the running jobs at once; none of them leaves half a file.
"""

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, as_completed
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.flow.batch import Job, Outcome, looked_over, run_job
from uwtrack_cli.flow.worker_pool import run_in_processes

CONNECT_S = 10.0
RETRIES = 3


def available_processors() -> int:
    """Return how many processors this program may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def run_jobs(
    jobs: Sequence[Job], *, n_workers: int = 1, scheduler: str | None = None
) -> Iterator[tuple[int, Outcome]]:
    """Run jobs and yield their outcomes as they are ready.

    ``n_workers``: local processes, 1 or more; one means in this process. ``scheduler``:
    address of a Dask scheduler to run on instead.

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
        for number, job in looked_over(numbered):
            yield number, run_job(job)
        return
    if scheduler is None:
        yield from run_in_processes(
            looked_over(numbered), min(n_workers, len(numbered))
        )
        return
    for number in [n for n, job in numbered.items() if _is_refused(job)]:
        yield number, run_job(numbered.pop(number))
    sent = {
        number: replace(job, may_repeat=not job.overwrite)
        for number, job in numbered.items()
    }
    yield from _on_cluster(sent, scheduler)


def _is_refused(job: Job) -> bool:
    """Tell whether a product was there before, so that a job may not repeat itself."""
    return job.target.exists() and not (job.resume or job.overwrite)


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
    with _without_logs(), client:
        pool = client.get_executor(pure=False, retries=RETRIES)
        futures = {pool.submit(run_job, job): number for number, job in jobs.items()}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except (CancelledError, OSError, TimeoutError) as error:
            reason = str(error) or type(error).__name__
            msg = (
                f"the scheduler {address} is lost ({reason}); what was made is kept: "
                f"start one again and give --resume."
            )
            raise DataError(msg) from error
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
