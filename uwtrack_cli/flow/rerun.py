"""Repeat the computation of a result file from its own history.

**Method.** The steps of the history are a recipe. Its first step names what it read:
recordings are opened as the product says they were (sensor, span, channels, start
time are in it), tables are read again, and each source must have the digest that the
history gives. One pass over each recording so gives what commands made one by one.
The new product holds the same kinds of containers as the old one.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import RecordedFiles
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.layout import sensor_of
from uwtrack_cli.files.hdf5.product import HistoryStep, Product, ProductWriter, Source, read_product
from uwtrack_cli.flow.branches import maker
from uwtrack_cli.flow.catalogue import find_stage
from uwtrack_cli.flow.comparison import is_streamed
from uwtrack_cli.flow.concatenate import lock_of
from uwtrack_cli.flow.engine import Engine, MemorySink, context_of
from uwtrack_cli.flow.graph import PASSING, Graph, without_passing
from uwtrack_cli.flow.products import Held, whole_result
from uwtrack_cli.flow.rerun_sources import SourceFinder, read_tables, reopen
from uwtrack_cli.flow.step import Step, simple_step
from uwtrack_cli.flow.vessel_names import AisVessels, read_vessels, revision


@dataclass(frozen=True)
class Plan:
    """What must be run."""

    sources: tuple[tuple[HistoryStep, ...], ...]
    """The steps that read each recording, for every recording."""
    each: tuple[tuple[Step, ...], ...]
    """Steps over each recording, in the order of `sources`."""
    last: tuple[Step, ...]
    """Steps over what came of all recordings and tables."""
    is_of_products: bool = False
    """Whether recordings were run by themselves, and their products then read as one."""


def rerun_product(
    path: Path, target: Path, *, sources: Sequence[Path] = (), overwrite: bool = False
) -> None:
    """Make a product again.

    ``sources``: files that it was made of, or folders with them; else they lie beside
    it.

    Raises
    ------
    DataError
        A source is missing or has changed, or the history does not tell enough.
    OutputError
        The target exists, is an input, or cannot be written.
    """
    with read_product(path) as product:
        plan = _plan(product)
        finder = SourceFinder(path, tuple(sources))
        made = _run(product, plan, finder)
        kept = {
            (
                key.sensor,
                key.name,
                key.step if plan.is_of_products else maker(product, key),
            ): key.step
            for key in product.paths
        }
        history = [
            HistoryStep.now(
                past.stage, past.options, past.sources, name=past.step_name, inputs=past.inputs
            )
            for past in product.history
        ]
    inputs = [path, *finder.found]
    with ProductWriter(target, history=history, overwrite=overwrite, inputs=inputs) as writer:
        for held in made:
            found = (sensor_of(held.container), held.container.NAME)
            for key in {(*found, held.step), (*found, "")} & kept.keys():
                writer.write(held.container, kept[key])


def _plan(product: Product) -> Plan:
    history = product.history
    if not history:
        raise DataError(f"{product.name} has no history, so it cannot be made again.")
    readers = [s for s in history if find_stage(s.stage).kind == "source"]
    rest = [_step(s) for s in history if s not in readers]
    _check_unique(product, rest)
    held = {key.name for key in product.paths}
    has_overview = any(step.stage_name == "overview" for step in rest)
    if readers and "overview" in held and not has_overview:
        rest.insert(0, simple_step("overview"))  # older histories leave it out
    of_recording: dict[tuple[Source, ...], list[HistoryStep]] = {}
    for reader in readers:
        of_recording.setdefault(reader.sources, []).append(reader)
    sources = tuple(map(tuple, of_recording.values()))
    if len(sources) < 2:
        alone = (tuple(rest),) * len(sources)
        return Plan(sources, alone, () if sources else tuple(rest))
    names = [{reader.step_name for reader in each} for each in sources]
    if len(set().union(*names)) < sum(map(len, names)):
        # one chain over all recordings, and a step that reads what came of them
        return Plan(sources, (tuple(rest[:-1]),) * len(sources), tuple(rest[-1:]))
    own = _by_recording(names, rest)
    told = {step.name for steps in own for step in steps}
    last = tuple(step for step in rest if step.name not in told)
    return Plan(sources, own, last, is_of_products=True)


def _by_recording(
    readers: Sequence[set[str]], steps: Sequence[Step]
) -> tuple[tuple[Step, ...], ...]:
    """Return the steps that read what came of one recording alone, for each of them.

    ``readers``: names of the steps that read each recording.
    """
    origin = {name: {row} for row, own in enumerate(readers) for name in own}
    for step in steps:
        read = (origin.get(name, set()) for name in step.inputs or ())
        origin[step.name] = set().union(*read)
    return tuple(
        tuple(step for step in steps if origin[step.name] == {row}) for row in range(len(readers))
    )


def _check_unique(product: Product, steps: Sequence[Step]) -> None:
    names = [step.name for step in steps]
    for name in names:
        if names.count(name) > 1:  # a history of a program that did not name steps
            raise DataError(
                f"{product.name} was made with {names.count(name)} settings of {name}: "
                f"make each of its sources again by itself."
            )


def _step(past: HistoryStep) -> Step:
    options = find_stage(past.stage).bind(past.options)
    inputs = past.inputs or None
    return Step(past.step_name, past.stage, options, inputs, is_output=True)


def _run(product: Product, plan: Plan, finder: SourceFinder) -> list[Held]:
    """Return what the plan gives, with the names of the steps that made it."""
    streamed = {key.name for key in product.paths if is_streamed(product, key)}
    kept_kinds = [kind for kind in PASSING if kind.NAME in streamed]
    made: list[Held] = []
    vessels = _vessels(product, finder)
    for readers, own in zip(plan.sources, plan.each, strict=True):
        recording, beside = reopen(product, readers[0], finder)
        steps = tuple(_passing(s, streamed) for s in (*map(_step, readers), *own))
        graph = Graph.over_recording(steps, "the history").resolved(recording)
        sink = MemorySink()
        joined = [c for c in beside if isinstance(c, RecordedFiles)]
        revise = revision(recording, next(iter(joined), None), vessels)
        engine = Engine(graph, context_of(recording), sink, revise=revise)
        engine.run_recording(recording)
        beside += lock_of(recording)
        made += map(Held, (recording, recording.sensor, *beside))
        kept = [step for step in graph.steps() if step.name in graph.outputs]
        if plan.is_of_products:
            kept = _as_held(product, kept)
        made += [Held(without_passing(sink.read(step), kept_kinds), step.name) for step in kept]
    if plan.is_of_products:
        named = {key.step for key in product.paths}
        made = [one if one.step in named else one._replace(step="") for one in made]
    if not plan.sources:
        made += map(Held, read_tables(product.history, finder))
    for step in plan.last:
        if not made:
            raise DataError(
                f"{product.name} began with {step.stage_name}, which reads what was "
                f"made before, and its history does not tell how: run the chain again."
            )
        if step.inputs:  # encounters that a later step made again are not read
            made = [
                held
                for held in made
                if held.step in step.inputs
                or not held.step
                or not isinstance(held.container, Encounters)
            ]
        *carried, result = whole_result(step, made, [])
        made = [*carried, result._replace(step=step.name)]
    return made


def _as_held(product: Product, steps: Sequence[Step]) -> list[Step]:
    """Return the steps whose results the product of one recording held.

    Of several results of a kind without a place of its own that is the last.
    """
    named = {key.step for key in product.paths}
    last = {step.stage.output: step.name for step in steps}
    return [step for step in steps if step.name in named or last[step.stage.output] == step.name]


def _vessels(product: Product, finder: SourceFinder) -> AisVessels | None:
    """Return the AIS vessels that gave the encounters of a product their names."""
    for encounters in product.read_all(Encounters):
        if encounters.ais_name and encounters.ais_within_m is not None:
            table = Source(name=encounters.ais_name, digest=encounters.ais_digest)
            return read_vessels(finder.find(table), encounters.ais_within_m)
    return None


def _passing(step: Step, kept: Collection[str]) -> Step:
    """Return a step whose result is not kept where the product does not hold it."""
    made = step.stage.output
    return replace(step, is_output=made not in PASSING or made.NAME in kept)
