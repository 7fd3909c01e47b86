"""Run the steps of a recipe over one recording, reading it once.

**Method.** Blocks of spectrogram are pushed through maps and scans in the order of the
recipe; a scan is a generator that gives one block for each block it takes, and its
rest when the input ends. Every branch so sees the same blocks, and none is held. What
the stages made is joined, out of memory if it is much, and the whole stages follow on
the small tables.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.spill import Spill
from uwtrack_cli.flow.recipe import Recipe, Step
from uwtrack_cli.flow.stage import Input, Stage

PASSING: tuple[type[Container], ...] = (Spectrogram, Peaks, Families)
"""Containers too large to keep: they pass by and only what follows from them stays."""

Progress = Callable[[float], None]
"""Called with the time in seconds that has been dealt with."""


def run_recipe(
    recording: Recording,
    recipe: Recipe,
    *,
    keep: Sequence[type[Container]] = (),
    progress: Progress | None = None,
) -> list[Container]:
    """Run a recipe over a recording.

    Parameters
    ----------
    recording
        The recording, opened for reading.
    recipe
        The steps; the first must make the spectrogram.
    keep
        Passing containers that are wanted in the result all the same.
    progress
        Called after each block.

    Returns
    -------
    list[Container]
        The recording's facts, the sensor and every container made, in the order of
        the recipe.

    Raises
    ------
    OptionError
        A step has no source in the recipe.
    """
    streamed = [step for step in recipe.steps if step.stage.kind != "whole"]
    if not streamed or streamed[0].stage.kind != "source":
        msg = f"recipe {recipe.name} must begin with a [spectrogram] table."
        raise OptionError(msg)
    _check_outputs(recipe)
    made: list[Container] = [recording, recording.sensor]
    made += _stream(recording, streamed, set(PASSING) - set(keep), progress)
    for step in recipe.steps:
        if step.stage.kind == "whole":
            made.append(apply_whole(step, made))
    return made


def _stream(
    recording: Recording,
    steps: Sequence[Step],
    passing: Collection[type[Container]],
    progress: Progress | None,
) -> list[Container]:
    """Push the recording through all maps and scans; return what stays of it."""
    source, nodes = steps[0], [StreamNode(step) for step in steps[1:]]
    with Spill() as kept:

        def push(block: Container, nodes: Sequence[StreamNode]) -> None:
            for made in _passed_on(block, nodes):
                if type(made) not in passing:
                    kept.append(made)

        for block in source.stage.function(recording, **source.options):
            push(block, nodes)
            if progress is not None:
                progress(_end_s(block))
        for position, node in enumerate(nodes):
            for rest in node.finish():
                push(rest, nodes[position + 1 :])
        return kept.joined()


def _check_outputs(recipe: Recipe) -> None:
    """Refuse two stages that make the same: their rows would be mixed."""
    makers: dict[type[Container], str] = {}
    for step in recipe.steps:
        first = makers.setdefault(step.stage.output, step.stage_name)
        if first != step.stage_name:
            msg = (
                f"recipe {recipe.name} has two stages that make "
                f"{step.stage.output.NAME}, {first} and {step.stage_name}; keep one."
            )
            raise OptionError(msg)


def apply_stream(step: Step, blocks: Iterator[Container]) -> Iterator[Container]:
    """Apply a map or scan to a stream of blocks."""
    node = StreamNode(step)
    for block in blocks:
        yield node.push(block)
    yield from node.finish()


def apply_whole(step: Step, available: Sequence[Container]) -> Container:
    """Apply a whole stage to what is there, found by type.

    Raises
    ------
    DataError
        An input is missing, or there are two candidates for it.
    """
    stage = step.stage
    inputs = [_find_input(stage, wanted, available) for wanted in stage.inputs]
    if all(found is None for found in inputs):
        wanted = " or ".join(k.NAME for i in stage.inputs for k in i.kinds)
        msg = f"{stage.name} needs {wanted}, and the input has none of them."
        raise DataError(msg)
    made: Container = stage.function(*inputs, **step.options)
    return made


def _find_input(stage: Stage, wanted: Input, available: Sequence[Container]) -> Any:
    found = [c for c in available if isinstance(c, wanted.kinds)]
    names = " or ".join(kind.NAME for kind in wanted.kinds)
    if wanted.is_list:
        if not found and not wanted.is_optional:
            msg = f"{stage.name} needs {names}, and the input has none."
            raise DataError(msg)
        return found
    if len(found) > 1:
        msg = f"{stage.name} takes one {names}, and the input has {len(found)}."
        raise DataError(msg)
    if not found and not wanted.is_optional:
        there = ", ".join(sorted({c.NAME for c in available})) or "nothing"
        msg = f"{stage.name} needs {names}, and the input has {there}."
        raise DataError(msg)
    return found[0] if found else None


class StreamNode:
    """A map or scan that blocks are pushed into."""

    def __init__(self, step: Step) -> None:
        self._step = step
        self.kinds = step.stage.inputs[0].kinds
        self._waiting: list[Container] = []
        self._results: Iterator[Container] | None = None
        if step.stage.kind == "scan":
            self._results = step.stage.function(self._feed(), **step.options)

    def _feed(self) -> Iterator[Container]:
        while self._waiting:
            yield self._waiting.pop()

    def push(self, block: Container) -> Container:
        """Give one block and take the one that follows from it."""
        if self._results is None:
            made: Container = self._step.stage.function(block, **self._step.options)
            return made
        self._waiting.append(block)
        return next(self._results)

    def finish(self) -> Iterator[Container]:
        """Take what the stage still holds."""
        return iter(()) if self._results is None else self._results


def _passed_on(block: Container, nodes: Sequence[StreamNode]) -> Iterator[Container]:
    """Push a block through; yield it and what each stage makes of it."""
    yield block
    latest: dict[type[Container], Container] = {type(block): block}
    for node in nodes:
        source = _latest(latest, node.kinds)
        if source is not None:
            made = node.push(source)
            yield made
            latest.pop(type(made), None)
            latest[type(made)] = made


def _latest(
    made: dict[type[Container], Container], kinds: tuple[type[Container], ...]
) -> Container | None:
    """Return the container made last among those that a stage can read."""
    return next((made[k] for k in reversed(list(made)) if k in kinds), None)


def _end_s(block: Container) -> float:
    return float(block.frames.time_s[-1]) if isinstance(block, Spectrogram) else 0.0
