"""`batch` and `rerun`: many recordings at once, and a product once more."""

import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from uwtrack_cli.cli.command_factory import (
    Ais,
    AsJson,
    Output,
    Overwrite,
    WithinM,
    documented,
    with_parameters,
)
from uwtrack_cli.cli.console import (
    SOME_FAILED,
    is_verbose,
    progress_bar,
    put,
    say,
    show_table,
    unread_too,
)
from uwtrack_cli.cli.recording_arguments import SOURCE_PARAMETERS
from uwtrack_cli.cli.run_commands import RecipeName, Settings
from uwtrack_cli.errors import OptionError, OutputError
from uwtrack_cli.files.text_escaping import shell_word
from uwtrack_cli.flow.shipped_recipes import DEFAULT_RECIPE

if TYPE_CHECKING:
    from uwtrack_cli.flow.batch import Job, Outcome
    from uwtrack_cli.flow.recorder_folder import Joining

PER_FILE = ("start_utc", "start_s", "stop_s")
"""Options of one recording, which mean nothing for many."""


@dataclass(frozen=True)
class ManyOptions:
    """How many recordings are run.

    Parameters
    ----------
    jobs
        Number of processes; by default one for each processor.
    scheduler
        Dask scheduler to run on: tcp://HOST:PORT.
    join
        Join consecutive files of a recorder by their UTC times.
    join_gap_s
        Longest gap in s within a joined recording; by default 600.
    join_slack_s
        Accuracy of the start times in s; by default 1.
    per
        Write one result file for each UTC day, or for each file, of a joined recording.
    overlap_s
        Sound in s that is read before and after each part; by default 900.
    """

    jobs: int | None = None
    scheduler: str | None = None
    join: bool = False
    join_gap_s: float | None = None
    join_slack_s: float | None = None
    per: Literal["day", "file"] | None = None
    overlap_s: float | None = None


OWN_PARAMETERS = documented(ManyOptions, "Many recordings")
"""Options of running many: where, and what belongs together."""

BATCH_PARAMETERS = [*OWN_PARAMETERS, *(p for p in SOURCE_PARAMETERS if p.name not in PER_FILE)]


@with_parameters(BATCH_PARAMETERS)
def batch(
    sources: list[Path],
    *,
    folder: Annotated[Path, typer.Option("--output", "-o")],
    recipe: RecipeName = DEFAULT_RECIPE,
    settings: Settings = None,
    resume: bool = False,
    overwrite: Overwrite = False,
    json_output: AsJson = False,
    ais: Ais = None,
    within_m: WithinM = 2000.0,
    **options: Any,
) -> None:
    """Run a recipe over many recordings; a bad file does not stop the rest.

    Writes the result files, batch.csv and batch.jsonl into the folder. The exit code is
    3 if some recordings failed. After an interrupt, --resume continues. Results of
    other recordings or of another recipe are replaced only with --overwrite; files that
    uwtrack did not write are never replaced. Positions from several sensors: give their
    result files to uwtrack locate.

    Parameters
    ----------
    sources
        Recordings, folders with them, or patterns in quotes.
    folder
        Folder for the result files; it gets the subfolders of the sources.
    resume
        Run only what is missing or out of date.
    """
    from uwtrack_cli.flow.batch_report import check_report
    from uwtrack_cli.flow.batch_sources import describe_recorders, find_recordings, make_jobs
    from uwtrack_cli.flow.shipped_recipes import load_recipe

    own = ManyOptions(**{p.name: options.pop(p.name) for p in OWN_PARAMETERS})
    joining = _joining(own)
    found = find_recordings(sources)
    made = make_jobs(
        found,
        folder,
        load_recipe(recipe).with_settings(settings or []),
        options,
        resume=resume,
        overwrite=overwrite,
        joining=joining,
        ais=ais,
        within_m=within_m,
    )
    if folder.is_file():
        raise OutputError(f"{folder} is a file; --output names the folder of the result files.")
    check_report(folder, found, overwrite=overwrite)
    for text in describe_recorders(found, options, joining):
        say(text)
    outcomes = _run(made, folder, own.jobs, own.scheduler)
    rows = _tell(outcomes, folder, as_json=json_output)
    if any(row["status"] in {"failed", "truncated"} for row in rows):
        raise typer.Exit(SOME_FAILED)


def _joining(own: ManyOptions) -> "Joining | None":
    from uwtrack_cli.flow.recorder_folder import Joining

    given: dict[str, Any] = {
        "max_gap_s": own.join_gap_s,
        "slack_s": own.join_slack_s,
        "per": own.per,
        "overlap_s": own.overlap_s,
    }
    known = {k: v for k, v in given.items() if v is not None}
    if not own.join:
        if known:
            raise OptionError("--join-gap-s, --join-slack-s, --per and --overlap-s go with --join.")
        return None
    for name, value in known.items():
        if name != "per" and not value >= 0.0:
            raise OptionError(f"{name} of --join must be 0 or more, got {value}.")
    if "overlap_s" in known and "per" not in known:
        raise OptionError("--overlap-s goes with --per, which cuts what is joined.")
    return Joining(**known)


def _run(
    made: "Sequence[Job]", folder: Path, jobs: int | None, scheduler: str | None
) -> "list[Outcome]":
    from uwtrack_cli.flow.batch import count_once
    from uwtrack_cli.flow.batch_report import write_report
    from uwtrack_cli.flow.executors import available_processors, run_jobs

    found: dict[int, Outcome] = {}
    wanted = available_processors() if jobs is None else jobs
    folder.mkdir(parents=True, exist_ok=True)
    sound = SoundDone(made)
    try:
        with progress_bar("batch", sum(sound.total_s)) as show:
            for k, outcome in run_jobs(
                made,
                n_workers=min(wanted, len(made)),
                scheduler=scheduler,
                progress=lambda number, done_s: show(*sound.reached(number, done_s)),
            ):
                found[k] = outcome
                show(*sound.ended(k))
                if outcome.status == "failed":
                    say(f"failed: {outcome.source}: {outcome.message}", 1)
    finally:
        outcomes = [outcome for _, outcome in sorted(count_once(made, found).items())]
        for path in write_report(outcomes, folder):
            say(f"wrote {path}", 1)
    return outcomes


class SoundDone:
    """How much of the sound of a batch is done.

    ``jobs``: what is to be made.
    """

    def __init__(self, jobs: "Sequence[Job]") -> None:
        from uwtrack_cli.files.audio.recording_file import sound_s

        is_seen = sys.stderr.isatty()
        self.total_s = [sum(map(sound_s, job.sources)) if is_seen else 0.0 for job in jobs]
        """Length of the sound of each job, s; 0 where nobody looks on."""
        self._done_s = [0.0] * len(jobs)

    def reached(self, number: int, done_s: float) -> tuple[float, str]:
        """Return the seconds that are done of all sound, and the stage of a job."""
        from uwtrack_cli.flow.engine import STREAM_SHARE

        self._done_s[number] = min(done_s, self.total_s[number])
        is_read = done_s >= STREAM_SHARE * self.total_s[number]
        return sum(self._done_s), "closest approaches" if is_read else "reading sound"

    def ended(self, number: int) -> tuple[float, str]:
        """Return the seconds that are done of all sound when a job has ended."""
        self._done_s[number] = self.total_s[number]
        return sum(self._done_s), ""


def _tell(outcomes: "Sequence[Outcome]", folder: Path, *, as_json: bool) -> list[dict[str, Any]]:
    """Print what became of the jobs; return the rows of the report."""
    from uwtrack_cli.flow.batch_report import report_rows

    rows = report_rows(outcomes, folder)
    if as_json:
        with unread_too():
            put([json.dumps(rows, ensure_ascii=False)])
        return rows
    if is_verbose():
        heads = ("source", "status", "passages")
        show_table(
            heads, [(Path(r["source"]).name, r["status"], str(r["n_encounters"])) for r in rows]
        )
    for text in _repeated(rows):
        say(text)
    counts = Counter(row["status"] for row in rows)
    told = ", ".join(f"{n} {status}" for status, n in counts.items())
    if counts.keys() - {"failed", "truncated"}:
        n = sum(r["n_encounters"] for r in rows)
        word = "passage" if n == 1 else "passages"
        told += f"; {n} {word}: uwtrack passages {shell_word(folder)}"
    say(told)
    return rows


def _repeated(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield what went wrong in a batch, what many recordings share but once."""
    found: dict[str, list[str]] = {}
    for row in rows:
        if not row["message"]:
            continue
        source = Path(row["source"])
        told = str(row["message"]).replace(row["source"], source.name)
        if row["status"] in {"failed", "truncated"}:
            about = "" if told.startswith(source.name) else f"{source.name}: "
            line = f"{row['status']}: {about}{told}"
        else:
            line = f"warning: {told}"
        shared = line.replace(source.name, "").replace(Path(row["target"]).name, "")
        found.setdefault(shared, []).append(line)
    for lines in found.values():
        others = len(lines) - 1
        yield lines[0] + (f" (and {others} more like it)" if others else "")


def rerun(
    file: Path,
    *,
    source: list[Path] | None = None,
    output: Output = None,
    overwrite: Overwrite = False,
) -> None:
    """Repeat the computation of a result file from its own history.

    The sources must lie beside the result file, and must not have changed. Without
    --output, pass.run.h5 becomes pass.rerun.run.h5.

    Parameters
    ----------
    file
        Result file to repeat.
    source
        Source file, if it is not beside the result file.
    """
    from uwtrack_cli.flow.rerun import rerun_product

    target = output or file.parent / _again(file.name)
    rerun_product(file, target, sources=source or [], overwrite=overwrite)
    both = f"{shell_word(file)} {shell_word(target)}"
    say(f"wrote {target}; uwtrack diff {both} compares them")


def _again(name: str) -> str:
    stem, _, rest = name.partition(".")
    return f"{stem}.rerun.{rest}" if rest else f"{name}.rerun"
