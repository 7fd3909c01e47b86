"""The commands of the stages: each reads product files and writes one."""

import inspect
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwtrack_cli.cli.command_factory import (
    AsJson,
    Branch,
    Output,
    Overwrite,
    parameter,
    stage_function,
)
from uwtrack_cli.cli.console import progress_bar, say_wrote
from uwtrack_cli.cli.recording_arguments import SOURCE_PARAMETERS, open_sources
from uwtrack_cli.cli.result_output import is_shown, print_result, say_sensitivity
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.directions import Delays
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError
from uwtrack_cli.flow.catalogue import find_stage
from uwtrack_cli.flow.stage import Stage
from uwtrack_cli.flow.step import Step

if TYPE_CHECKING:
    from uwtrack_cli.cli.targets import Inputs


def _argument(name: str, hint: Any, text: str) -> inspect.Parameter:
    return parameter(name, hint, inspect.Parameter.empty, text, is_argument=True)


def _shared(name: str, hint: Any, default: Any = None) -> inspect.Parameter:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=hint)


SOUND = _argument("source", Path, "Recording: WAV, RF64, W64, FLAC or AIFF.")
RECORDERS = _argument(
    "sources", list[Path],
    "Recording of an array, or one of each of several synchronised recorders.",
)  # fmt: skip
ONE_FILE = _argument("source", Path, "Result file; - is standard input.")
FILES = _argument(
    "sources", list[Path], "Result files in any order, or a CSV table; - is standard input."
)
BRANCH = _shared("branch", Branch)
ENDING = [_shared("output", Output), _shared("overwrite", Overwrite, default=False)]
"""What the commands of stages have in common."""

REPLAYS = (".rep", ".dsf")
"""Endings of files of tracks and cuts."""

SIDE_TABLES = {
    "navigation": parameter("own_ship", Path | None, None, "CSV table of own ship's navigation."),
    "roc": parameter("roc", Path | None, None, "CSV table of a measured operating curve."),
}
"""Tables that have an option of their own, by the container they hold."""

SENSORS = parameter(
    "sensors", Path | None, None, "Sensor file for a table whose rows name their sensors."
)

SENSOR_FILE = parameter("sensor", Path | None, None, "Sensor file for a table of measurements.")
"""Option for the sensor of a stage that reads tables of one sensor, which do not hold it."""


def stage_command(name: str) -> Callable[..., None]:
    """Return the function that is the command of a stage."""
    stage = find_stage(name)
    if stage.kind == "source":
        sound = RECORDERS if stage.output is Delays else SOUND
        return stage_function(stage, _source_body(stage), [sound, *SOURCE_PARAMETERS, *ENDING])
    if stage.kind == "whole":
        return stage_function(stage, _whole_body(stage), _whole_parameters(stage))
    return stage_function(stage, _stream_body(stage), [ONE_FILE, BRANCH, *ENDING])


def _whole_parameters(stage: Stage) -> list[inspect.Parameter]:
    wanted = _wanted(stage)
    names = {kind.NAME for kind in wanted}
    parameters = [FILES, BRANCH, *(SIDE_TABLES[n] for n in SIDE_TABLES if n in names)]
    if _takes_sensors(stage):
        parameters.append(SENSORS)
    if (Delays in wanted and stage.output is not Fixes) or (stage.output is Encounters):
        parameters.append(SENSOR_FILE)
    return [*parameters, *ENDING, _shared("json_output", AsJson, default=False)]


def _source_body(stage: Stage) -> Any:
    def body(own: Mapping[str, Any], options: list[dict[str, Any]]) -> None:
        from uwtrack_cli.cli.targets import product_name, writer_for
        from uwtrack_cli.flow.products import source_into_product
        from uwtrack_cli.flow.rungs import rung_steps

        sources: list[Path] = own["sources"] if "sources" in own else [own["source"]]
        steps = [_step(stage, each) for each in options]
        recording = open_sources(sources, own)
        steps = rung_steps(steps, recording)
        target = own["output"] or product_name(sources[0], stage.suffix)
        with (
            progress_bar(stage.name, recording.duration_s) as done,
            writer_for(target, overwrite=own["overwrite"], inputs=sources) as writer,
        ):
            source_into_product(steps, recording, writer, done)
        say_wrote(target)

    return body


def _stream_body(stage: Stage) -> Any:
    def body(own: Mapping[str, Any], options: list[dict[str, Any]]) -> None:
        from uwtrack_cli.cli.targets import open_product, target_for, writer_for
        from uwtrack_cli.flow.branches import refuse_unknown_step
        from uwtrack_cli.flow.products import stream_into_product
        from uwtrack_cli.flow.rungs import rungs_into_product, rungs_of

        source: Path = own["source"]
        branch: str | None = own["branch"]
        target = target_for(own["output"], source, stage.suffix)
        with (
            open_product(source) as product,
            writer_for(target, overwrite=own["overwrite"], inputs=[source]) as writer,
        ):
            refuse_unknown_step([product], branch)
            step = _step(stage, options[0])
            rungs = rungs_of(product, step, branch)
            made = (
                rungs_into_product(step, rungs, product, writer)
                if rungs
                else stream_into_product(step, product, writer, branch)
            )
        say_sensitivity(made)
        say_wrote(target)

    return body


def _step(stage: Stage, options: Mapping[str, Any]) -> Step:
    return Step(stage.name, stage.name, options, settled=frozenset(options))


def _whole_body(stage: Stage) -> Any:
    def body(own: Mapping[str, Any], options: list[dict[str, Any]]) -> None:
        from uwtrack_cli.cli.targets import PIPE, target_for, write_containers
        from uwtrack_cli.files.atomic import check_target
        from uwtrack_cli.flow.products import extended_history, whole_result, with_sound_at_hand

        sources: list[Path] = own["sources"]
        step = _step(stage, options[0])
        with ExitStack() as stack:
            read = _read_sources(stage, own, stack)
            target = target_for(own["output"], sources[0], stage.suffix)
            overwrite = bool(own["overwrite"])
            read.check_sensors_used()
            if target != PIPE:  # not after the work
                check_target(target, overwrite=overwrite)
            step, held = with_sound_at_hand(step, read.held, read.products)
            made = whole_result(step, held, read.products)
            history = extended_history(read.products, step, read.sources, own["branch"])
        write_containers(target, made, history, overwrite=overwrite, inputs=sources)
        result = made[-1].container
        if is_shown(result):
            print_result(result, as_json=own["json_output"])
        say_wrote(target)

    return body


def _takes_sensors(stage: Stage) -> bool:
    """Tell whether a stage reads tables of several sensors."""
    return Series in _wanted(stage) and stage.output in {Motions, Fixes}


def _wanted(stage: Stage) -> tuple[type[Container], ...]:
    return tuple(kind for i in stage.inputs for kind in i.kinds)


def _read_sources(stage: Stage, own: Mapping[str, Any], stack: ExitStack) -> "Inputs":
    from uwtrack_cli.cli.targets import Inputs
    from uwtrack_cli.flow.branches import refuse_unknown_step

    is_presence = stage.output is Presence
    read = Inputs(stack, own["branch"], takes_asides=is_presence)
    if own.get("sensors") is not None:
        read.add_sensors(own["sensors"], is_kept=stage.output is Fixes)
    replays = [path for path in own["sources"] if path.suffix.lower() in REPLAYS]
    if replays:
        read.add_replay(replays, _wanted(stage))
    for source in own["sources"]:
        if source not in replays:
            read.add(source, _wanted(stage))
    refuse_unknown_step(read.products, own["branch"])
    if own.get("sensor") is not None and read.products and stage.output is Encounters:
        raise DataError(
            f"--sensor {own['sensor']} belongs to a table; result files have their own."
        )
    for kind in _wanted(stage):
        asked = {**SIDE_TABLES, "sensor": SENSOR_FILE}.get(kind.NAME)
        if asked is not None and own.get(asked.name) is not None:
            read.add_table(own[asked.name], kind)
    return read
