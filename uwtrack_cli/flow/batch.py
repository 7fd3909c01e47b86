"""One recipe over many recordings: what is done for each of them.

**Method.** A job reads its source, runs the recipe and writes one product, exactly as
`uwtrack run` does; it returns what became of it instead of raising, so that one bad
file is a row of the report. A product counts as complete when it is undamaged and
its own history names this source, recipe and program: there is no other bookkeeping.
"""

import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import DataError, OutputError, UwtrackNote, UwtrackWarning
from uwtrack_cli.files.hdf5.product import (
    ProductWriter,
    Source,
    read_product,
    verify_product,
)
from uwtrack_cli.files.input_ledger import input_ledger, not_an_input
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.flow.concatenate import SLACK_S, join_recordings
from uwtrack_cli.flow.products import (
    history_of_graph,
    run_into_product,
    source_of_recording,
)
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.sources import open_with_options

DONE, RESUMED, FAILED = "done", "resumed", "failed"


@dataclass(frozen=True)
class Job:
    """One product to make; picklable, about a kilobyte."""

    sources: tuple[Path, ...]
    """Recordings, joined in this order if there are several."""
    target: Path
    """Product to write."""
    recipe: Recipe
    """What is run over them."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """How the recordings are opened: the options of `open_with_options`."""
    resume: bool = False
    """Whether a complete product is kept."""
    overwrite: bool = False
    """Whether an existing product may be replaced."""
    slack_s: float = SLACK_S
    """Difference from UTC up to which a file directly follows the one before it, s."""
    may_repeat: bool = False
    """Whether it may run twice: its worker can be lost after the product was placed."""


@dataclass(frozen=True)
class Outcome:
    """What became of a job: a row of the report."""

    source: str
    """First recording, as it was named."""
    target: str
    """Product."""
    status: str
    """'done', 'resumed' or 'failed'."""
    message: str = ""
    """Warnings, or why it failed."""
    n_sources: int = 1
    """Number of recordings that were joined."""
    duration_s: float | None = None
    """Length of the recording, s; None if it could not be opened."""
    cpu_s: float | None = None
    """Processor time that was used, s."""
    encounters: tuple[dict[str, Any], ...] = ()
    """Rows of the encounters found, as JSON objects."""


def run_job(job: Job) -> Outcome:
    """Make a product, and tell how it went.

    Parameters
    ----------
    job
        What to make.
    """
    begin = time.process_time()
    blank = Outcome(
        str(job.sources[0]), str(job.target), FAILED, n_sources=len(job.sources)
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UwtrackWarning)
        try:
            with input_ledger():
                outcome = _make(job, blank)
        except (DataError, OutputError, ValueError) as error:
            outcome = replace(blank, message=str(error))
        except OSError as error:
            outcome = replace(blank, message=f"{error.strerror or error}")
        except MemoryError:
            outcome = replace(blank, message="there is not enough memory for this.")
        except Exception as error:  # noqa: BLE001 - a row, whatever happened
            reason = f"the program failed ({type(error).__name__}: {error})."
            outcome = replace(blank, message=reason)
    warned = [str(w.message) for w in said if _is_warning(w.category)]
    if outcome.status != FAILED and warned:
        outcome = replace(outcome, message=" ".join(dict.fromkeys(warned)))
    return replace(outcome, cpu_s=round(time.process_time() - begin, 3))


def _is_warning(category: type[Warning]) -> bool:
    return issubclass(category, UwtrackWarning) and not issubclass(
        category, UwtrackNote
    )


def _make(job: Job, blank: Outcome) -> Outcome:
    recording, sources, beside = _opened(job)
    begun = replace(blank, duration_s=recording.duration_s)
    if job.target.exists() and (job.resume or job.may_repeat):
        with not_an_input():  # a product that is not complete is made again
            found = _complete(job, recording, sources)
        if found is not None:
            status = RESUMED if job.resume else DONE
            return replace(begun, status=status, encounters=found)
    elif job.target.exists() and not job.overwrite:
        msg = f"{job.target} exists already; give --resume or --overwrite."
        raise OutputError(msg)
    job.target.parent.mkdir(parents=True, exist_ok=True)
    overwrite = job.resume or job.overwrite or job.may_repeat
    with ProductWriter(job.target, overwrite=overwrite, inputs=job.sources) as writer:
        made = run_into_product(recording, job.recipe, writer, sources=sources)
        for container in beside:
            writer.write(container)
    small = [held.container for held in made]
    rows = [row for c in small if isinstance(c, Encounters) for row in json_rows(c)]
    return replace(begun, status=DONE, encounters=tuple(rows))


def finished(job: Job) -> Outcome | None:
    """Return the outcome of a job whose product is complete, though none was told.

    A process can be lost between placing its product and saying so.

    Parameters
    ----------
    job
        What was to be made.
    """
    try:
        with warnings.catch_warnings(), input_ledger(), not_an_input():
            warnings.simplefilter("ignore")  # said when it was run
            recording, sources, _ = _opened(job)
            found = _complete(job, recording, sources)
    except (DataError, OutputError, ValueError, OSError, MemoryError):
        return None
    if found is None:
        return None
    return Outcome(
        str(job.sources[0]),
        str(job.target),
        DONE,
        n_sources=len(job.sources),
        duration_s=recording.duration_s,
        encounters=found,
    )


def _opened(job: Job) -> tuple[Recording, list[Source], list[Container]]:
    """Open what a job reads: the recording, its files, and how they were joined."""
    opened = [open_with_options(path, job.options) for path in job.sources]
    sources = [source_of_recording(r) for r in opened]
    if len(opened) == 1:
        return opened[0], sources, []
    recording, files = join_recordings(opened, slack_s=job.slack_s)
    return recording, sources, [files]


def _complete(
    job: Job, recording: Recording, sources: list[Source]
) -> tuple[dict[str, Any], ...] | None:
    """Return the encounters of a product that need not be made again."""
    if not job.target.is_file() or verify_product(job.target):
        return None
    graph = job.recipe.graph().resolved(recording)
    history = history_of_graph(graph, sources)
    with read_product(job.target) as product:
        before = [step.to_json() for step in product.history]
        if before != [step.to_json() for step in history]:
            return None
        stored = product.read(Recording)
        if not stored.equals(replace(recording, reader=None)):
            return None
        found = product.read_all(Encounters)
        return tuple(row for item in found for row in json_rows(item))
