"""One recipe over many recordings: what is done for each of them.

**Method.** A job reads its source, runs the recipe and writes one product, exactly as
`uwtrack run` does; it returns what became of it instead of raising, so that one bad
file is a row of the report. Of files that are joined, one that cannot be read is a gap,
and one that ends too early a gap from there on; both are told. A product counts as
complete when it is undamaged and its own history names this source, recipe and program:
there is no other bookkeeping. One of the same recording and recipe that is damaged or out
of date is made again. One of another job is replaced with ``overwrite`` only, and a
file that is no product never. What the products of many jobs say of themselves is read in
one child process with limits (see `examination`), so that their files need no other one.
"""

import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from uwtrack_cli import __version__
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.renamed import with_old_keys
from uwtrack_cli.errors import DataError, MissingError, OutputError, UwtrackNote, UwtrackWarning
from uwtrack_cli.files.hdf5.product import (
    HistoryStep,
    Product,
    ProductWriter,
    Source,
    is_product,
    read_many,
    read_product,
    source_of,
)
from uwtrack_cli.files.input_ledger import input_ledger, not_an_input
from uwtrack_cli.files.tables.json_rows import json_rows, nested
from uwtrack_cli.files.text_escaping import file_name
from uwtrack_cli.files.utc import parse_utc
from uwtrack_cli.flow.concatenate import clip_recording, join_recordings
from uwtrack_cli.flow.engine import Progress
from uwtrack_cli.flow.products import history_of_graph, run_into_product, source_of_recording
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.recorder_folder import Joining, OwnSpan, distinct_passages
from uwtrack_cli.flow.sources import open_with_options
from uwtrack_cli.flow.vessel_names import WITHIN_M, read_vessels

DONE, RESUMED, FAILED, TRUNCATED = "done", "resumed", "failed", "truncated"

Statement = dict[str, Any]
"""What a product says of itself, as JSON: of which recording, by which steps, what."""


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
    """Whether a product of another job may be replaced."""
    joining: Joining | None = None
    """How the recordings are joined; None is one recording by itself."""
    own_ns: tuple[int, int] | None = None
    """Span whose closest approaches are kept, ns since 1970-01-01 UTC; None is all."""
    ais: Path | None = None
    """AIS table that gives the vessels their names."""
    within_m: float = WITHIN_M
    """Range within which its vessels are expected to be detected, m."""
    may_repeat: bool = False
    """Whether it may run twice: its worker can be lost after the product was placed."""
    statement: Statement | None = None
    """What the product that is there says; None if it has not been read."""

    def failed(self, message: str = "") -> "Outcome":
        """Return the outcome if it fails, which others are made of, too."""
        names = str(self.sources[0]), str(self.target)
        return Outcome(*names, FAILED, message, n_sources=len(self.sources))


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
    faults: tuple[dict[str, Any], ...] = ()
    """Recordings that could not be joined whole: source, status ('failed', 'truncated'),
    message."""
    retry: bool = False
    """Whether it failed for what may pass: disk, memory, or an input that is not there."""


def looked_over(jobs: Mapping[int, Job]) -> Iterator[tuple[int, Job]]:
    """Yield jobs with their numbers, those that resume with what their products say."""
    there = [j.target for j in jobs.values() if j.resume and j.target.is_file()]
    statements = _statements(there)
    known = frozenset(there)
    for number, job in jobs.items():
        said = next(statements) if job.target in known else None
        yield number, replace(job, statement=said)


def _statements(paths: Sequence[Path]) -> Iterator[Statement | None]:
    """Yield what products say of themselves; None for one that cannot be read."""
    for said in read_many(f"{__name__}:statement_of", paths):
        yield None if isinstance(said, DataError) else said


def statement_of(product: Product) -> Statement:
    """Return what a product says of itself, as JSON."""
    facts = [product.facts(key) for key in product.paths if key.name == Encounters.NAME]
    found = product.read_all(Encounters) if any(one["rows"] for one in facts) else []
    return {
        "history": product.history_texts,
        "recordings": [nested(recording) for recording in product.read_all(Recording)],
        "encounters": [with_old_keys(row) for one in found for row in json_rows(one)],
        "names": [[f.get("ais_digest", ""), f.get("ais_within_m")] for f in facts],
    }


def run_job(job: Job, progress: Progress | None = None) -> Outcome:
    """Make a product, and return how it went.

    ``progress``: called with the seconds of sound that are done.
    """
    begin = time.process_time()
    blank = job.failed()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UwtrackWarning)
        try:
            with input_ledger():
                outcome = _make(job, progress)
        except (MissingError, OutputError) as error:
            outcome = replace(blank, message=str(error), retry=True)
        except (DataError, ValueError) as error:
            outcome = replace(blank, message=str(error))
        except OSError as error:
            outcome = replace(blank, message=f"{error.strerror or error}", retry=True)
        except MemoryError:
            reason = "there is not enough memory for this."
            outcome = replace(blank, message=reason, retry=True)
        except Exception as error:  # noqa: BLE001 - a row, whatever happened
            reason = f"the program failed ({type(error).__name__}: {error})."
            outcome = replace(blank, message=reason)
    warned = [str(w.message) for w in said if _is_warning(w.category)]
    if outcome.status != FAILED and warned:
        outcome = replace(outcome, message=" ".join(dict.fromkeys(warned)))
    return replace(outcome, cpu_s=round(time.process_time() - begin, 3))


def _is_warning(category: type[Warning]) -> bool:
    return issubclass(category, UwtrackWarning) and not issubclass(category, UwtrackNote)


@dataclass(frozen=True)
class _Opened:
    """What a job reads."""

    recording: Recording
    """The recording, joined if there are several."""
    sources: list[Source]
    """Its files, for the history."""
    files: RecordedFiles | None = None
    """How they were joined."""
    faults: tuple[dict[str, Any], ...] = ()
    """Files that could not be read, or not to their end."""

    def begun(self, job: Job) -> Outcome:
        """Return the outcome of a job that has opened this, so far."""
        n_sources, duration_s = len(self.sources), self.recording.duration_s
        return replace(job.failed(), n_sources=n_sources, duration_s=duration_s, faults=self.faults)


def _make(job: Job, progress: Progress | None) -> Outcome:
    opened = _opened(job)
    recording = opened.recording
    vessels = None if job.ais is None else read_vessels(job.ais, job.within_m)
    if vessels is not None:
        vessels.check(recording)
    begun = opened.begun(job)
    is_there = job.target.exists()
    if is_there:
        with not_an_input():  # a product that is not complete is made again
            found = _kept(job, recording, opened.sources)
        if found is not None:
            status = RESUMED if job.resume else DONE
            return replace(begun, status=status, encounters=found)
    job.target.parent.mkdir(parents=True, exist_ok=True)
    replaces = is_there or job.may_repeat
    with ProductWriter(job.target, overwrite=replaces, inputs=job.sources) as writer:
        made = run_into_product(
            recording,
            job.recipe,
            writer,
            sources=opened.sources,
            files=opened.files,
            vessels=vessels,
            progress=progress,
        )
    small = [held.container for held in made]
    rows = [row for c in small if isinstance(c, Encounters) for row in json_rows(c)]
    return replace(begun, status=DONE, encounters=tuple(rows))


def count_once(jobs: Sequence[Job], outcomes: Mapping[int, Outcome]) -> dict[int, Outcome]:
    """Return outcomes in which a passage of two parts of a recording stands once.

    ``outcomes``: what became of the jobs, by their numbers.
    """
    numbers = sorted(outcomes)
    owns = [
        OwnSpan(*own, frozenset(map(str, jobs[k].sources)))
        if (own := jobs[k].own_ns) is not None
        else None
        for k in numbers
    ]
    rows = [outcomes[k].encounters for k in numbers]
    kept = distinct_passages(rows, owns, _time_of)
    return {
        k: replace(outcomes[k], encounters=tuple(own)) for k, own in zip(numbers, kept, strict=True)
    }


def _time_of(row: Mapping[str, Any]) -> tuple[int, float] | None:
    time_utc = row["time_utc"]
    return None if time_utc is None else (parse_utc(time_utc), row["time_std_s"] or 0.0)


def finished(job: Job) -> Outcome | None:
    """Return the outcome of a job whose product is complete, though none was told.

    A process can be lost between placing its product and saying so.
    """
    try:
        with warnings.catch_warnings(), input_ledger(), not_an_input():
            warnings.simplefilter("ignore")  # said when it was run
            opened = _opened(job)
            now = replace(job, statement=None)
            found = _complete(now, opened.recording, opened.sources)
    except (DataError, OutputError, ValueError, OSError, MemoryError):
        return None
    if found is None:
        return None
    return replace(opened.begun(job), status=DONE, encounters=found)


def _opened(job: Job) -> _Opened:
    """Open what a job reads: the recording, its files, and how they were joined."""
    if job.joining is None:
        recording = open_with_options(job.sources[0], job.options)
        return _Opened(recording, [source_of_recording(recording)])
    there: list[Recording] = []
    faults: list[dict[str, Any]] = []
    for path in job.sources:
        found, fault = _what_is_there(path, job.options)
        if fault is not None:
            faults.append(fault)
        if found is not None and job.own_ns is not None:
            overlap_ns = round(job.joining.overlap_s * NANOSECONDS)
            begin, end = job.own_ns
            found = clip_recording(found, begin - overlap_ns, end + overlap_ns)
        if found is not None:
            there.append(found)
    if not there:
        raise DataError(faults[0]["message"] if faults else "there is no sound to join.")
    sources = [source_of_recording(recording) for recording in there]
    if len(there) == 1 and job.own_ns is None:
        return _Opened(there[0], sources, None, tuple(faults))
    slack_s = job.joining.slack_s
    recording, files = join_recordings(there, slack_s=slack_s, own_ns=job.own_ns)
    return _Opened(recording, sources, files, tuple(faults))


def _what_is_there(
    path: Path, options: Mapping[str, Any]
) -> tuple[Recording | None, dict[str, Any] | None]:
    """Open a file as far as it can be read; tell what is wrong with it."""
    try:
        return open_with_options(path, options), None
    except (DataError, OSError) as error:
        fault = {"source": str(path), "status": FAILED, "message": str(error)}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UwtrackWarning)
        try:
            recording = open_with_options(path, {**options, "allow_truncated": True})
        except (DataError, OSError):
            return None, fault
    message = " ".join(str(w.message) for w in said if str(path) in str(w.message))
    fault |= {"status": TRUNCATED, "message": f"{message} The rest is a gap."}
    return recording, fault


def _kept(
    job: Job, recording: Recording, sources: list[Source]
) -> tuple[dict[str, Any], ...] | None:
    """Return the encounters of a product that stays; None if it is made again.

    Raises
    ------
    OutputError
        What is there is of another job, or no product: it is not replaced.
    """
    name = job.target.name
    may_stay = job.resume or job.may_repeat
    found = _complete(job, recording, sources) if may_stay else None
    if found is not None:
        return found
    if not is_product(job.target):
        raise OutputError(not_ours(job.target))
    if may_stay:
        other = "" if job.overwrite else _other_job(job)
        if other:
            raise OutputError(
                f"{name} was made {other}: give --overwrite to replace it, or name "
                f"another folder with --output."
            )
    elif not job.overwrite:
        raise OutputError(f"{name} exists already; give --resume or --overwrite.")
    return None


def not_ours(path: Path) -> str:
    """Say that a file is not replaced, since the program did not write it."""
    return (
        f"{path} was not written by uwtrack and is not replaced: move it away, or name "
        f"another folder with --output."
    )


def _complete(
    job: Job, recording: Recording, sources: list[Source]
) -> tuple[dict[str, Any], ...] | None:
    """Return the encounters of a product that need not be made again."""
    if not job.target.is_file():
        return None
    said = job.statement or next(_statements([job.target]))
    if said is None:
        return None
    graph = job.recipe.graph().resolved(recording)
    history = [step.to_json() for step in history_of_graph(graph, sources)]
    known = {
        "history": history,
        "recordings": [nested(replace(recording, reader=None))],
        "names": [_names(job)] * len(said["names"]),
    }
    is_complete = all(said[key] == value for key, value in known.items())
    return tuple(said["encounters"]) if is_complete else None


def _other_job(job: Job) -> str:
    """Tell in which way a product is not of this job; empty if it is, or is damaged.

    What another version of the program made is of this job: its recipes may differ.
    """
    try:
        product = read_product(job.target)
    except DataError:
        return ""
    with product:
        made_of = {source.name for step in product.history for source in step.sources}
        if made_of.isdisjoint(map(file_name, job.sources)):
            others = f" and {len(made_of) - 1} more" if len(made_of) > 1 else ""
            return f"of {min(made_of, default='something else')}{others}"
        if product.program_version == __version__ and not _is_of_recipe(product, job):
            return "by another recipe"
    return ""


def _is_of_recipe(product: Product, job: Job) -> bool:
    """Tell whether a recipe, run over the recording of a product, makes it."""
    recordings = product.read_all(Recording)
    if len(recordings) != 1:
        return False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UwtrackWarning)  # the run says it
        graph = job.recipe.graph().resolved(recordings[0])
    wanted = [_settings(step) for step in history_of_graph(graph, [])]
    return wanted == [_settings(step) for step in product.history]


def _settings(step: HistoryStep) -> str:
    """Return what a step does, whatever it read and whichever version it is of."""
    return replace(step, sources=(), versions={}).to_json()


def _names(job: Job) -> list[Any]:
    """Return what gives the encounters of a job their names: AIS table and range."""
    if job.ais is None:
        return ["", None]
    return [source_of(job.ais).digest, job.within_m]
