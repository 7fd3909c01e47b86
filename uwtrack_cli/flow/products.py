"""Graphs over recordings and product files, and the products that they make.

**Method.** A run writes its results into the new file while it goes on, and reads back
from there what the whole stages take, so that memory does not grow with the recording.
The command of a single stage is a graph of one step: it reads what passes by in blocks
of frames and small containers whole, found by type and sensor in all the files given.
The output carries the small containers of its sources forward, so that it explains
itself.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Overview, Spectrogram
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.layout import CONTAINERS, sensor_of
from uwtrack_cli.files.hdf5.product import ContainerKey, HistoryStep, Product, ProductWriter, Source
from uwtrack_cli.files.tables.series import sensor_of_rows
from uwtrack_cli.files.text_escaping import file_name
from uwtrack_cli.flow.branches import (
    keys_of_branch,
    maker,
    of_rung,
    sole_keys,
    step_names,
    without_asides,
)
from uwtrack_cli.flow.comparison import is_streamed
from uwtrack_cli.flow.concatenate import lock_of
from uwtrack_cli.flow.engine import Engine, MemorySink, Progress, context_of
from uwtrack_cli.flow.graph import CONTEXT, PASSING, Graph, without_passing
from uwtrack_cli.flow.live_events import LiveWatch, Tell
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.rerun_sources import with_sound
from uwtrack_cli.flow.step import Step, simple_step
from uwtrack_cli.flow.vessel_names import AisVessels, revision

BLOCK_FRAMES = 256
"""Frames read at once: whole tiles of the noise floor."""


class ProductSink:
    """Writes results into a product, and reads them back from there.

    ``graph``: the graph of the run: it says under which name each result is kept.
    """

    def __init__(self, writer: ProductWriter, graph: Graph) -> None:
        self._writer = writer
        self._key_of = graph.product_key
        self._whole: dict[str, Container] = {}
        self._read: dict[str, Container] = {}
        self._ends: dict[str, list[Container]] = {}

    def append(self, step: Step, block: Container) -> None:
        """Write a block of a step's result."""
        self._writer.append(block, self._key_of(step))
        self._ends[step.name] = [*self._ends.get(step.name, [])[-1:], block]

    def write(self, step: Step, container: Container) -> None:
        """Write the whole result of a step."""
        self._whole[step.name] = container
        self._writer.write(container, self._key_of(step))

    def read(self, step: Step) -> Container:
        """Return the whole result of a step."""
        if step.name in self._whole:
            return self._whole[step.name]
        if step.name not in self._read:
            kind = step.stage.output
            self._read[step.name] = self._writer.read_back(kind, self._key_of(step))
        return self._read[step.name]

    def forget(self, kept: Collection[str]) -> None:
        """Let go of streams that were read back, but for those of some steps."""
        self._read = {name: c for name, c in self._read.items() if name in kept}

    def ends(self, step: Step) -> list[Container]:
        """Return what was written whole, or the last two blocks of a stream."""
        whole = self._whole.get(step.name)
        return self._ends.get(step.name, []) if whole is None else [whole]


class Held(NamedTuple):
    """A container with the name under which its product keeps it."""

    container: Container
    """The container."""
    step: str = ""
    """Name of the step that made it; empty for the usual one."""


def run_into_product(  # noqa: PLR0913 (what a run may be given)
    recording: Recording,
    recipe: Recipe,
    writer: ProductWriter,
    *,
    sources: Sequence[Source] = (),
    keep: Sequence[type[Container]] = (),
    progress: Progress | None = None,
    tell: Tell | None = None,
    files: RecordedFiles | None = None,
    vessels: AisVessels | None = None,
    whole: bool = False,
) -> list[Held]:
    """Run a recipe over a recording into a product.

    Parameters
    ----------
    sources
        Files that the recording was read from; the recording itself if not given.
    keep
        Passing containers that are written all the same.
    tell
        Takes events as soon as they are decided; None if nobody waits for them.
    files
        How the recording was joined, if it was; it is written, too, and tells which
        closest approaches are kept.
    vessels
        Vessels of an AIS table, which give the encounters names.
    whole
        Whether streams, which are as long as the sound, are returned whole.

    Returns
    -------
    list[Held]
        Tables of the product, its encounters among them; of a stream the last two
        blocks, unless it is wanted whole.

    Raises
    ------
    OptionError
        The steps of the recipe do not join.
    """
    graph = recipe.graph(keep).resolved(recording)
    sink = ProductSink(writer, graph)
    watch = None if tell is None else LiveWatch(graph, recording, tell)
    revise = revision(recording, files, vessels)
    engine = Engine(graph, context_of(recording), sink, watch, revise)
    if watch is not None:
        watch.attend(engine)
    engine.run_recording(recording, progress)
    graph = engine.graph  # without what live sound was too short for
    recording = recording.ended()
    if files is not None:
        writer.write(files)
    recorders = recording.of_recorders
    for one in (recording, *(one for one in recorders if one is not recording)):
        writer.write(one)
        writer.write(one.sensor)
    for lock in lock_of(recording):
        writer.write(lock)
    sources = sources or list(map(source_of_recording, recorders))
    writer.history = history_of_graph(graph, sources)
    small = [s for s in graph.steps() if s.name in graph.outputs]
    small = [s for s in small if s.stage.output not in PASSING]
    found = [
        (step, one) for step in small for one in ([sink.read(step)] if whole else sink.ends(step))
    ]
    if watch is not None:
        watch.finish([one for _, one in found])
    made = [Held(one, graph.product_key(step)) for step, one in found]
    return [Held(recording), Held(recording.sensor), *made]


def source_into_product(
    steps: Sequence[Step], recording: Recording, writer: ProductWriter, progress: Progress
) -> None:
    """Run a source stage over a recording; a spectrogram gets its overview, too.

    ``steps``: the step, or those of the rungs of a ladder with their overviews.
    """
    first = steps[0]
    if len(steps) == 1:
        steps = [replace(first, is_output=True)]
        if first.stage.output is Spectrogram:
            steps.append(simple_step("overview"))
    recipe = Recipe(first.stage_name, "", tuple(steps))
    run_into_product(recording, recipe, writer, progress=progress)


def stream_into_product(
    step: Step, product: Product, writer: ProductWriter, branch: str | None = None
) -> list[Container]:
    """Apply a map or scan to every sensor of a product; return the last blocks of each.

    Of a sensor these are the last block with frames and the one that ends the stream.

    Raises
    ------
    DataError
        The product has nothing that the stage reads, or several of it.
    """
    kinds = step.stage.inputs[0].kinds
    keys = sole_keys(product, branch, [kind.NAME for kind in kinds])
    streamed = [key for key in keys if is_streamed(product, key)]
    last: list[Container] = []
    for sensor in dict.fromkeys(key.sensor for key in streamed):
        there = {key.name: key for key in streamed if key.sensor == sensor}
        kind = next((k for k in kinds if k.NAME in there), None)
        if kind is None:
            continue
        graph = Graph.of_steps((replace(step, is_output=True),), step.name, (kind,))
        sink = ProductSink(writer, graph)
        engine = Engine(graph, [], sink)
        made_by = there[kind.NAME].step
        for block in product.stream(kind, sensor, BLOCK_FRAMES, made_by):
            engine.push(None, block, None)
        engine.finish()
        last += sink.ends(step)
    if not last:
        raise DataError(_wrong_product(step, [product]))
    for held in small_containers(product, branch):
        if not isinstance(held.container, step.stage.output):
            writer.write(held.container, held.step)
    sources = [source_of_product(product)]
    writer.history = extended_history([product], step, sources, branch)
    return last


def whole_result(step: Step, available: Sequence[Held], products: Sequence[Product]) -> list[Held]:
    """Apply a whole stage; return the containers carried forward, then its result.

    A stage that takes lists sees all sensors at once; any other one is applied to
    each sensor in turn.

    Raises
    ------
    DataError
        The files have nothing that the stage reads, or two different candidates.
    """
    there = _distinct(available)
    wanted = tuple(kind for i in step.stage.inputs for kind in i.kinds)
    if step.stage.output is Encounters:
        there += _sensors_of_rows(there)
    given = [held.container for held in there]
    data = tuple(kind for kind in wanted if kind not in CONTEXT)
    required = [c for c in given if isinstance(c, data)]
    if not any(isinstance(c, wanted) for c in given):
        raise DataError(_wrong_product(step, products))
    if any(i.is_list for i in step.stage.inputs):
        if not required:
            raise DataError(_wrong_product(step, products))
        made = [_apply(step, given)]
    else:
        made = [_apply(step, group) for group in _by_sensor(given, wanted)]
    result = made[0] if len(made) == 1 else type(made[0]).join(made)
    carried = [h for h in there if type(h.container) is not type(result)]
    carried = _with_one_picture(carried)
    # tables of the whole file, which hold the rows of all sensors
    tables: dict[tuple[type[Container], str], list[Container]] = {}
    for held in carried:
        if _is_of_all_sensors(held.container):
            key = (type(held.container), held.step)
            tables.setdefault(key, []).append(held.container)
    rest = [held for held in carried if not _is_of_all_sensors(held.container)]
    rest += [Held(kind.join(several), name) for (kind, name), several in tables.items()]
    return [*rest, Held(result)]


def _sensors_of_rows(held: Sequence[Held]) -> list[Held]:
    """Return the sensor that a table of one sensor places in its rows, if none is there."""
    if any(isinstance(one.container, Sensor) for one in held):
        return []
    tables = [one.container for one in held if isinstance(one.container, Series)]
    return [Held(known) for table in tables if (known := sensor_of_rows(table))]


def _with_one_picture(carried: Sequence[Held]) -> list[Held]:
    """Keep the first overview of each sensor: files of other frames have their own."""
    seen: set[str] = set()
    kept = []
    for held in carried:
        if isinstance(held.container, Overview):
            if held.container.sensor in seen:
                continue
            seen.add(held.container.sensor)
        kept.append(held)
    return kept


def _is_of_all_sensors(container: Container) -> bool:
    """Tell whether the rows of a table name their sensors: one table holds them all."""
    columns = container.columns()
    spec = columns.get("sensor", columns.get("sensors"))
    return spec is not None and not spec.optional


def with_sound_at_hand(
    step: Step, available: Sequence[Held], products: Sequence[Product]
) -> tuple[Step, list[Held]]:
    """Give a stage that reads the recording its sound, if it lies beside a product.

    Returned: the step, which says so where there is no sound, so that it can be made
    again; and what it reads.
    """
    if not any(Recording in wanted.kinds for wanted in step.stage.inputs):
        return step, list(available)
    held = [
        h._replace(container=with_sound(h.container, products))
        if isinstance(h.container, Recording)
        else h
        for h in available
    ]
    found = [h.container for h in held if isinstance(h.container, Recording)]
    can_do_without = "rest_frame_test" in step.stage.defaults
    if can_do_without and found and all(one.reader is None for one in found):
        step = replace(step, options={**step.options, "rest_frame_test": False})
    return step, held


def _apply(step: Step, given: Sequence[Container]) -> Container:
    kinds = tuple({type(c) for c in given})
    every = (*kinds, *(k for i in step.stage.inputs for k in i.kinds))
    sink = MemorySink()
    alone = replace(step, inputs=None)  # what it reads is given, whoever made it
    Engine(Graph.of_steps((alone,), step.name, every), given, sink).finish()
    return sink.read(step)


def small_containers(
    product: Product, branch: str | None = None, keys: Sequence[ContainerKey] | None = None
) -> Iterator[Held]:
    """Read what later files carry: everything that does not only pass by.

    ``keys``: what is meant, where that is known; the branch does not matter then.
    """
    left_out = {"frames", "navigation", *(kind.NAME for kind in PASSING)}
    for key in keys_of_branch(product, branch) if keys is None else keys:
        if key.name not in left_out:  # frames and navigation come with their owners
            container = product.read(CONTAINERS[key.name], key.sensor, key.step)
            container = of_rung(container, product.history, branch)
            yield Held(without_passing(container), key.step)


def history_of_graph(graph: Graph, sources: Sequence[Source]) -> list[HistoryStep]:
    """Return the steps of a resolved graph; sources name the recording's files."""
    return [
        history_step(
            node.step,
            tuple(s for names in node.sources.values() for s in names),
            sources if node.step.stage.kind == "source" else (),
        )
        for node in graph.nodes
    ]


def extended_history(
    products: Sequence[Product], step: Step, sources: Sequence[Source], branch: str | None = None
) -> list[HistoryStep]:
    """Return the histories of several products, extended by a step that read them.

    ``sources``: names and digests of what it read. ``branch``: step whose branch it
    read, where several steps made results of one kind.
    """
    before: list[HistoryStep] = []
    inputs: list[str] = []
    for product in products:
        own = _renamed(product.history, before)
        names = dict(zip(step_names(product), (p.step_name for p in own), strict=True))
        before += [past for past in own if past not in before]
        held = list(keys_of_branch(product, branch))
        if branch is None and step.stage.output is not Presence:
            held = without_asides(product, held)
        for wanted in step.stage.inputs:
            there = [k.NAME for k in wanted.kinds if k.NAME in {h.name for h in held}]
            read = [k for k in held if k.name in there[:1]]  # the first kind that fits
            inputs += [names[made] for k in read if (made := maker(product, k)) in names]
    name = free_name(step.name, {past.step_name for past in before})
    inputs = sorted(set(inputs), key=[past.step_name for past in before].index)
    return [*before, history_step(replace(step, name=name), inputs, sources)]


def _renamed(history: Sequence[HistoryStep], taken: Sequence[HistoryStep]) -> list[HistoryStep]:
    """Return a history whose names do not mean other steps of another history."""
    known = {past.step_name: past for past in taken}
    names: dict[str, str] = {}
    found: list[HistoryStep] = []
    for past in history:
        inputs = tuple(names.get(name, name) for name in past.inputs)
        own = replace(past, name=past.step_name, inputs=inputs)
        if known.get(own.name, own) != own:
            names[own.name] = free_name(own.name, known)
            own = replace(own, name=names[own.name])
        found.append(own)
    return found


def free_name(name: str, taken: Collection[str]) -> str:
    """Return a name, with a number where it is taken."""
    numbered = (name, *(f"{name}-{k}" for k in range(2, 1000)))
    return next(one for one in numbered if one not in taken)


def history_step(step: Step, inputs: Sequence[str], sources: Sequence[Source]) -> HistoryStep:
    """Return what history says of a step that was run: what it read, and how."""
    return HistoryStep.now(step.stage_name, step.values(), sources, name=step.name, inputs=inputs)


def _distinct(available: Sequence[Held]) -> list[Held]:
    """Leave out what several files hold alike."""
    found: list[Held] = []
    for held in available:
        alike = (h for h in found if h.step == held.step)
        if not any(held.container.equals(other.container) for other in alike):
            found.append(held)
    return found


def _by_sensor(
    containers: Sequence[Container], wanted: tuple[type[Container], ...]
) -> Iterator[list[Container]]:
    """Group what belongs to one sensor; what has no sensor goes to every group."""
    common = [c for c in containers if sensor_of(c) is None]
    sensors = list(
        dict.fromkeys(sensor_of(c) for c in containers if isinstance(c, wanted) and sensor_of(c))
    )
    for sensor in sensors or [None]:
        own = [c for c in containers if sensor is not None and sensor_of(c) == sensor]
        yield [*own, *common]


def _wrong_product(step: Step, products: Sequence[Product]) -> str:
    wanted = [kind.NAME for i in step.stage.inputs for kind in i.kinds]
    names = ", ".join(Path(product.name).name for product in products) or "the input"
    held = sorted({n for p in products for ns in p.containers().values() for n in ns})
    return (
        f"{step.stage_name} reads {' or '.join(dict.fromkeys(wanted))}, and {names} "
        f"holds {', '.join(held) or 'nothing of the chain'}; "
        f"`uwtrack info` tells what made it."
    )


def source_of_recording(recording: Recording) -> Source:
    """Name a recording in the history."""
    return Source(name=recording.name, digest=recording.digest)


def source_of_product(product: Product) -> Source:
    """Name a product in the history."""
    return Source(name=file_name(Path(product.name)), digest=product.digest)
