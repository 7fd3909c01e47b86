"""`run` and `recipes`: the whole chain in one pass."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from uwtrack_cli.cli.doors import AsJson, Output, Overwrite, command
from uwtrack_cli.cli.results import print_result
from uwtrack_cli.cli.screen import progress_bar, put, say
from uwtrack_cli.cli.sensitivity import say_sensitivity
from uwtrack_cli.cli.sources import SOURCE_PARAMETERS, open_source, with_parameters
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import OptionError

DEFAULT_RECIPE = "vessel"

RecipeName = Annotated[
    str, typer.Option("--recipe", help="Name of a shipped recipe, or a TOML file.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="Override an option: STAGE.OPTION=VALUE; may repeat."),
]


def register(app: typer.Typer, name: str) -> None:
    """Add the command of a name."""
    named = {"run": with_parameters(run, SOURCE_PARAMETERS), "recipes": recipes}
    command(app, name)(named[name])


def run(
    *,
    sources: Annotated[
        list[Path],
        typer.Argument(help="Recordings: WAV, RF64, W64, FLAC or AIFF."),
    ],
    recipe: RecipeName = DEFAULT_RECIPE,
    settings: Settings = None,
    keep_peaks: Annotated[
        bool, typer.Option("--keep-peaks", help="Store the spectral peaks, too.")
    ] = False,
    output: Output = None,
    overwrite: Overwrite = False,
    json_output: AsJson = False,
    **source_options: Any,
) -> None:
    """Run the whole chain over recordings, each read once.

    Writes pass.run.h5 with everything but the spectrogram and prints the encounters.
    Recordings of different sensors that overlap in time are fused into one more file.
    """
    from uwtrack_cli.cli.targets import write_containers
    from uwtrack_cli.files.atomic import check_target
    from uwtrack_cli.flow.fusion import plan_fusion
    from uwtrack_cli.flow.shipped import load_recipe

    chosen = load_recipe(recipe).with_settings(settings or [])
    if output is not None and len(sources) > 1:
        msg = f"--output names one file, and there are {len(sources)} recordings."
        raise OptionError(msg)
    keep: list[type[Container]] = [Peaks, Families] if keep_peaks else []
    recordings = [open_source(source, source_options) for source in sources]
    fusion = plan_fusion(chosen, sources, recordings)
    if fusion is not None:  # not after an hour's work
        check_target(fusion.target, overwrite=overwrite, inputs=sources)
    made: list[Container] = []
    for source, recording in zip(sources, recordings, strict=True):
        target = _target(source, output)
        made += _run_one(source, recording, chosen, keep, target, overwrite=overwrite)
    _print_all(made, as_json=json_output)
    if fusion is not None:
        fused = fusion.apply(made)
        write_containers(fusion.target, fused, fusion.history(), overwrite=overwrite)
        print_result(fused[-1], as_json=False)
        say(f"wrote {fusion.target}")


def _target(source: Path, output: Path | None) -> Path:
    from uwtrack_cli.cli.targets import product_name

    return output or product_name(source, ".run.h5")


def _run_one(
    source: Path,
    recording: Recording,
    recipe: Any,
    keep: Sequence[type[Container]],
    target: Path,
    *,
    overwrite: bool,
) -> list[Container]:
    from uwtrack_cli.cli.targets import PIPE, write_containers
    from uwtrack_cli.files.atomic import check_target
    from uwtrack_cli.flow.chain import run_recipe
    from uwtrack_cli.flow.products import history_of_recipe

    if target != PIPE:  # not after an hour's work
        check_target(target, overwrite=overwrite, inputs=[source])
    with progress_bar(source.name, recording.duration_s) as done:
        made = run_recipe(recording, recipe, keep=keep, progress=done)
    history = history_of_recipe(recipe, recording)
    write_containers(target, made, history, overwrite=overwrite, inputs=[source])
    say_sensitivity(made)
    say(f"wrote {target}")
    return made


def _print_all(made: Sequence[Container], *, as_json: bool) -> None:
    found = [c for c in made if isinstance(c, Encounters)]
    if found:
        print_result(Encounters.join(found), as_json=as_json)


def recipes(
    *,
    show: Annotated[
        str | None,
        typer.Option("--show", help="Print a recipe as TOML with every default."),
    ] = None,
) -> None:
    """List the shipped recipes, or print one with every value."""
    from uwtrack_cli.flow.shipped import load_recipe, shipped_recipes

    if show is not None:
        put([load_recipe(show).to_toml().rstrip("\n")])
        return
    names = shipped_recipes()
    width = max(map(len, names))
    put(f"{name:{width}}  {load_recipe(name).description}" for name in names)
