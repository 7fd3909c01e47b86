"""`watch`: the recordings of a folder, as they arrive."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uwtrack_cli.cli.batch_commands import PER_FILE
from uwtrack_cli.cli.command_factory import AsJson, with_parameters
from uwtrack_cli.cli.console import SOME_FAILED, put, say, signals_end
from uwtrack_cli.cli.recording_arguments import SOURCE_PARAMETERS
from uwtrack_cli.cli.run_commands import RecipeName, Settings
from uwtrack_cli.data.options import Above, Unit
from uwtrack_cli.flow.shipped_recipes import DEFAULT_RECIPE

if TYPE_CHECKING:
    from uwtrack_cli.flow.batch import Outcome

WATCH_PARAMETERS = [p for p in SOURCE_PARAMETERS if p.name not in PER_FILE]
"""Options of many recordings that read sound."""


@with_parameters(WATCH_PARAMETERS)
def watch(
    folder: Path,
    *,
    output: Annotated[Path, typer.Option("--output", "-o")],
    recipe: RecipeName = DEFAULT_RECIPE,
    settings: Settings = None,
    settle_s: Annotated[float, Unit("s"), Above(0)] = 5.0,
    idle_s: Annotated[float | None, Unit("s"), Above(0)] = None,
    overwrite: bool = False,
    json_output: AsJson = False,
    **options: Any,
) -> None:
    """Run a recipe over the recordings of a folder as they arrive.

    A recording is run when it is complete. The journal watch.jsonl in the output folder
    lists what is done, so that watch continues from there when it is started again.
    What failed for lack of disk space, memory or another file is tried again. Ctrl-C
    ends after the running recording. The exit code is 3 if some recordings failed.

    Parameters
    ----------
    folder
        Folder in which recordings arrive.
    output
        Folder for the result files and the journal.
    settle_s
        A recording is complete after this time without a change.
    idle_s
        End after so many s without a new recording; by default never.
    overwrite
        Continue in the output of another folder or recipe.
    """
    from uwtrack_cli.flow.shipped_recipes import load_recipe
    from uwtrack_cli.flow.watch import WatchTimes, watch_folder

    chosen = load_recipe(recipe).with_settings(settings or [])
    failed: dict[str, bool] = {}
    with _ending() as asked:
        done = watch_folder(
            folder, output, chosen, options, WatchTimes(settle_s, idle_s),
            overwrite=overwrite, is_ending=lambda: bool(asked), tell=say,
        )  # fmt: skip
        for outcome in done:
            failed[outcome.source] = outcome.status == "failed"
            _tell(outcome, output, as_json=json_output)
    if any(failed.values()):
        raise typer.Exit(SOME_FAILED)


@contextmanager
def _ending() -> Iterator[list[bool]]:
    """Give a list that is no longer empty when a signal has asked for the end."""
    asked: list[bool] = []
    with signals_end(lambda: asked.append(True)):
        yield asked


def _tell(outcome: "Outcome", folder: Path, *, as_json: bool) -> None:
    from uwtrack_cli.flow.batch_report import report_rows

    (row,) = report_rows([outcome], folder)
    if as_json:
        put([json.dumps(row, ensure_ascii=False)])
        return
    name = Path(row["source"]).name
    if outcome.status == "failed":
        later = " It is tried again later." if outcome.retry else ""
        say(f"failed: {name}: {row['message']}{later}")
        return
    n = row["n_encounters"]
    say(f"{row['status']}: {name}: {n} encounter{'' if n == 1 else 's'}")
