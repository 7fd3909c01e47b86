"""`run` and `recipes`: the whole chain in one pass."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uwtrack_cli.cli.command_factory import (
    Ais,
    AsJson,
    Output,
    Overwrite,
    WithinM,
    parameter,
    with_parameters,
)
from uwtrack_cli.cli.console import progress_bar, put, say, say_wrote
from uwtrack_cli.cli.live_run import LIVE_PARAMETERS, LiveOptions, live_target, run_live
from uwtrack_cli.cli.recording_arguments import SOURCE_PARAMETERS, open_source
from uwtrack_cli.cli.result_output import print_result, say_sensitivity
from uwtrack_cli.cli.targets import PIPE, WANTED_TWICE
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import OptionError, needing
from uwtrack_cli.files.checks import STANDARD_INPUT

if TYPE_CHECKING:
    from uwtrack_cli.flow.products import Held
    from uwtrack_cli.flow.recipe import Recipe
    from uwtrack_cli.flow.vessel_names import AisVessels


def _recipes(incomplete: str) -> list[str]:
    from uwtrack_cli.flow.shipped_recipes import shipped_recipes

    return [name for name in shipped_recipes() if name.startswith(incomplete)]


RecipeName = Annotated[
    str,
    typer.Option(
        "--recipe", help="Name of a shipped recipe, or a TOML file.", autocompletion=_recipes
    ),
]


Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="Override an option: STEP.OPTION=VALUE; may repeat."),
]

SENSOR_EACH = parameter(
    "sensor", list[Path] | None, None, "Sensor file of each recording, in the same "
    "order, or one deployment file.", panel="Recording",
)  # fmt: skip
"""How `run` takes sensors: one for each recording."""

RUN_PARAMETERS = [
    *LIVE_PARAMETERS,
    *(SENSOR_EACH if p.name == "sensor" else p for p in SOURCE_PARAMETERS),
]


@with_parameters(RUN_PARAMETERS)
def run(
    sources: list[Path],
    *,
    recipe: Annotated[str | None, typer.Option(autocompletion=_recipes)] = None,
    settings: Settings = None,
    keep_peaks: bool = False,
    output: Output = None,
    overwrite: Overwrite = False,
    json_output: AsJson = False,
    ais: Ais = None,
    within_m: WithinM = 2000.0,
    **source_options: Any,
) -> None:
    """Run the whole chain over recordings, each read once.

    Writes pass.run.h5 with all results but the spectrogram, and prints the passages. If
    recordings of different sensors overlap in time, one more file has the positions
    from all of them.

    Live sound is read from a pipe (uwtrack run - -o pass.run.h5), from a named pipe, or
    with --follow from a file that is being written. Ctrl-C finishes the open passages
    and writes the file.

    Parameters
    ----------
    sources
        Recordings: WAV, RF64, W64, FLAC or AIFF. Live sound: - or a named pipe.
    recipe
        Name of a shipped recipe, or a TOML file; by default towed-array for line
        arrays, and auto for other sensors.
    keep_peaks
        Store the spectral peaks, too.
    """
    from uwtrack_cli.cli.targets import product_name, write_containers
    from uwtrack_cli.files.atomic import check_target
    from uwtrack_cli.flow.fusion import plan_fusion
    from uwtrack_cli.flow.shipped_recipes import load_recipe

    sensors = _sensor_of_each(sources, source_options["sensor"])
    name = recipe or _usual_recipe(sources, sensors, source_options["channel"])
    chosen = load_recipe(name).with_settings(settings or [])
    if output is not None and len(sources) > 1:
        raise OptionError(f"--output names one file, and there are {len(sources)} recordings.")
    keep: list[type[Container]] = [Peaks, Families] if keep_peaks else []
    live = LiveOptions(**{p.name: source_options.pop(p.name) for p in LIVE_PARAMETERS})
    if live.is_live(sources):
        _refuse_names(ais)
        _run_live(
            sources[0], live, source_options, chosen, keep, output,
            overwrite=overwrite, as_json=json_output,
        )  # fmt: skip
        return
    recordings = [
        open_source(source, {**source_options, "sensor": sensor})
        for source, sensor in zip(sources, sensors, strict=True)
    ]
    vessels = _vessels(ais, within_m, recordings)
    fusion = plan_fusion(chosen, sources, recordings)
    if fusion is not None:  # not after an hour's work
        check_target(fusion.target, overwrite=overwrite, inputs=sources)
    targets = [output or product_name(source, ".run.h5") for source in sources]
    _refuse_twice(sources, targets, as_json=json_output)
    for target in targets:
        if target != PIPE:
            check_target(target, overwrite=overwrite, inputs=sources)
    made: list[Held] = []
    for source, recording, target in zip(sources, recordings, targets, strict=True):
        made += _run_one(
            source, recording, chosen, keep, target, vessels,
            overwrite=overwrite, whole=fusion is not None,
        )  # fmt: skip
    names = map(str, sources)
    _print_all(chosen, made, zip(names, recordings, strict=True), as_json=json_output)
    if fusion is not None:
        fused = fusion.apply(made)
        write_containers(fusion.target, fused, fusion.history(), overwrite=overwrite)
        print_result(fused[-1].container, as_json=False)
        say(f"wrote {fusion.target}")


def _run_live(
    source: Path,
    live: LiveOptions,
    source_options: Mapping[str, Any],
    recipe: "Recipe",
    keep: Sequence[type[Container]],
    output: Path | None,
    *,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Run over sound that is still coming; as JSON its events are printed instead."""
    (sensor,) = _sensor_of_each([source], source_options["sensor"])
    target = live_target(source, output, as_json=as_json)
    options = {**source_options, "sensor": sensor}
    made = run_live(
        source, live, options, recipe, keep, target, overwrite=overwrite, as_json=as_json
    )
    if not as_json:
        ended = [h.container for h in made if isinstance(h.container, Recording)]
        names = [str(source)] if live.follow else ["RECORDING"] * len(ended)
        _print_all(recipe, made, zip(names, ended, strict=True), as_json=False)


def _run_one(
    source: Path,
    recording: Recording,
    recipe: Any,
    keep: Sequence[type[Container]],
    target: Path,
    vessels: "AisVessels | None",
    *,
    overwrite: bool,
    whole: bool,
) -> list["Held"]:
    from uwtrack_cli.cli.targets import writer_for
    from uwtrack_cli.flow.products import run_into_product

    with (
        progress_bar(source.name, recording.duration_s) as done,
        writer_for(target, overwrite=overwrite, inputs=[source]) as writer,
    ):
        made = run_into_product(
            recording, recipe, writer, keep=keep, progress=done, vessels=vessels, whole=whole
        )
    say_sensitivity([held.container for held in made])
    say_wrote(target)
    return made


def _refuse_names(ais: Path | None) -> None:
    """Refuse AIS beside sound whose passages are told before a table can know them."""
    if ais is not None:
        raise OptionError(
            "--ais goes with recordings; of live sound, uwtrack passages --ais names the vessels."
        )


def _vessels(
    ais: Path | None, within_m: float, recordings: Sequence[Recording]
) -> "AisVessels | None":
    """Return the vessels of an AIS table, once every recording is known to fit it."""
    from uwtrack_cli.flow.vessel_names import read_vessels

    if ais is None:
        return None
    vessels = read_vessels(ais, within_m)
    for recording in recordings:
        vessels.check(recording)
    return vessels


def _usual_recipe(
    sources: Sequence[Path], sensors: Sequence[Path | None], channel: int | None
) -> str:
    """Return the recipe for the kind of sensor that made the recordings."""
    from uwtrack_cli.files.tables.sensors import find_sensor
    from uwtrack_cli.flow.shipped_recipes import usual_recipe

    return usual_recipe([
        None
        if channel is not None or source.is_dir()
        or (source == STANDARD_INPUT and sensor is None)
        else find_sensor(source, sensor)
        for source, sensor in zip(sources, sensors, strict=True)
    ])  # fmt: skip


def _sensor_of_each(sources: Sequence[Path], sensors: Sequence[Path] | None) -> list[Path | None]:
    """Return the sensor file of each recording: one each, or one deployment for all."""
    from uwtrack_cli.files.tables.sensors import load_deployment

    if not sensors:
        return [None] * len(sources)
    if len(sensors) == len(sources):
        return list(sensors)
    if len(sensors) == 1 and any(d.files for d in load_deployment(sensors[0])):
        return [sensors[0]] * len(sources)
    raise OptionError(
        f"{len(sources)} recordings take one --sensor each, in the same order, or one "
        f"deployment file with `files` patterns; got {len(sensors)} sensor files."
    )


def _refuse_twice(sources: Sequence[Path], targets: Sequence[Path], *, as_json: bool) -> None:
    """Refuse two results that would be written to one place."""
    if as_json and PIPE in targets:
        raise OptionError(WANTED_TWICE)
    for target in targets:
        clash = [str(s) for s, t in zip(sources, targets, strict=True) if t == target]
        if len(clash) > 1:
            raise OptionError(
                f"{' and '.join(clash)} would both be written to {target}; "
                f"run them apart, with --output."
            )


def _print_all(
    recipe: "Recipe",
    made: Sequence["Held"],
    recordings: Iterable[tuple[str, Recording]],
    *,
    as_json: bool,
) -> None:
    """Print the last result of a recipe, with what was detected beside it."""
    from uwtrack_cli.flow.suggestions import suggestions

    detected = [h.container for h in made if isinstance(h.container, Presence)]
    presence = Presence.join(detected) if detected else None
    kinds: tuple[type[Container], ...] = (Encounters, Motions)
    for kind in kinds:
        found = [h.container for h in made if isinstance(h.container, kind)]
        if found:
            stages = {step.stage_name for step in recipe.graph().steps()}
            passages = [one for one in found if isinstance(one, Encounters)]
            print_result(
                kind.join(found), as_json=as_json, presence=presence,
                suggestions=suggestions(stages, list(recordings), passages),
            )  # fmt: skip
            return


def recipes(
    *,
    show: Annotated[str | None, typer.Option(autocompletion=_recipes)] = None,
    graph: Annotated[str | None, typer.Option(autocompletion=_recipes)] = None,
    output: Output = None,
    overwrite: Overwrite = False,
) -> None:
    """List the shipped recipes, print one with every value, or draw its graph.

    Parameters
    ----------
    show
        Print a recipe as TOML with every default.
    graph
        Print which step reads which, or draw it with -o.
    output
        Picture of --graph: PNG, PDF or SVG.
    """
    from uwtrack_cli.flow.shipped_recipes import load_recipe, shipped_recipes

    if output is not None and graph is None:
        raise OptionError("--output is the picture of a graph: name the recipe with --graph.")
    if show is not None:
        put(load_recipe(show).to_toml().splitlines())
    if graph is not None:
        _graph(load_recipe(graph), output, overwrite=overwrite)
    if show is None and graph is None:
        names = shipped_recipes()
        width = max(map(len, names))
        put(f"{name:{width}}  {load_recipe(name).description}" for name in names)


def _graph(recipe: "Recipe", output: Path | None, *, overwrite: bool) -> None:

    joined = recipe.graph()
    if output is None:
        put(joined.lines())
        return
    with needing("plots need matplotlib", "plot"):
        from uwtrack_cli.plotting.recipe_graph import draw_recipe_graph
    draw_recipe_graph(joined.edges(), recipe.name, output, overwrite=overwrite)
    say(f"wrote {output}")
