"""A ladder of resolutions: frames of several lengths over one sound, in one product.

**Method.** Each length of frames is a rung: a step of its own, named after its length
(``spectrogram-100ms``, ``peaks-8s``), all in one pass over the sound. What follows takes
all the rungs of a product; stages that follow lines join them at the end
(`lines.multi_resolution`). Rungs are told from other steps by the history: their spectrograms
differ in nothing but the length of their frames.

**Conventions.** Rungs are in the order of their lengths, the shortest first. The picture
that is drawn where no step is named is that of the middle rung.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import OptionError, warn
from uwtrack_cli.files.hdf5.layout import CONTAINERS
from uwtrack_cli.files.hdf5.product import ContainerKey, Product, ProductWriter
from uwtrack_cli.flow.branches import maker, rung_windows_s
from uwtrack_cli.flow.catalogue import find_stage
from uwtrack_cli.flow.comparison import is_streamed
from uwtrack_cli.flow.engine import Engine
from uwtrack_cli.flow.graph import Graph
from uwtrack_cli.flow.products import (
    BLOCK_FRAMES,
    ProductSink,
    free_name,
    history_step,
    small_containers,
    source_of_product,
)
from uwtrack_cli.flow.step import Step, simple_step

CLIMBING: tuple[type[Container], ...] = (Peaks, Families, Lines)
"""What is made of all rungs at once."""

JOINING = "multi-resolution"
"""Stage that joins the lines of the rungs."""


class HeldRung(NamedTuple):
    """What one length of frames gave."""

    key: ContainerKey
    """The container."""
    step: str
    """Name of the step that made it."""
    window_s: float
    """Length of its frames, s."""


def rung_label(window_s: float) -> str:
    """Return what a length of frames is called in the names of steps.

    Examples
    --------
    >>> [rung_label(window_s) for window_s in (8.0, 0.1, 2.5, 0.00025)]
    ['8s', '100ms', '2500ms', '250us']
    """
    for unit, parts in (("s", 1.0), ("ms", 1e3)):
        count = window_s * parts
        if round(count) and abs(count - round(count)) < 1e-6:
            return f"{round(count)}{unit}"
    return f"{round(window_s * 1e6)}us"


def rung_steps(steps: Sequence[Step], recording: Recording) -> list[Step]:
    """Return the steps of a ladder of spectrograms, with a picture of each rung.

    Rungs that are longer than the recording are left out, and it is said.

    ``steps``: a step for each length of frames; a single one is no ladder.

    Raises
    ------
    OptionError
        A length is given twice.
    """
    if len(steps) == 1:
        return list(steps)
    ordered = sorted(steps, key=_window_s)
    for one, two in pairwise(ordered):
        if rung_label(_window_s(one)) == rung_label(_window_s(two)):
            raise OptionError(
                f"--window-s {_window_s(two):g} is given twice; each rung has frames of "
                f"another length."
            )
    if ordered != list(steps):
        lengths = ", ".join(f"{_window_s(step):g}" for step in ordered)
        warn(f"the rungs are taken in the order of their lengths: {lengths} s.")
    kept = [step for step in ordered if _fits(step, recording)] or ordered[:1]
    if len(kept) == 1:
        return kept
    names = [f"{step.stage_name}-{rung_label(_window_s(step))}" for step in kept]
    made: list[Step] = []
    for step, name in zip(kept, names, strict=True):
        picture = simple_step(Overview.NAME)
        if name != names[len(names) // 2]:
            picture = replace(picture, name=f"{picture.name}-{rung_label(_window_s(step))}")
        made.append(replace(step, name=name, is_output=True))
        made.append(replace(picture, inputs=(name,), is_output=True))
    return made


def _window_s(step: Step) -> float:
    return float(step.values()["window_s"])


def _fits(step: Step, recording: Recording) -> bool:
    """Tell whether a rung is no longer than the recording, and say so if not."""
    share = step.values()["largest_share"]
    longest_s = recording.duration_s * (1.0 if share is None else share)
    if _window_s(step) <= longest_s:
        return True
    whole = "" if share is None else f"{share:g} of "
    warn(
        f"the rung of {_window_s(step):g} s is left out: it is longer than {whole}"
        f"{recording.name}, which lasts {recording.duration_s:g} s."
    )
    return False


def rungs_of(product: Product, step: Step, branch: str | None) -> dict[str | None, list[HeldRung]]:
    """Return the rungs of a ladder that a stage takes, by sensor; none if there is none.

    ``branch``: step whose branch alone is read, if one is named.
    """
    if branch is not None or step.stage.output not in CLIMBING:
        return {}
    windows_s = rung_windows_s(product.history)
    for kind in step.stage.inputs[0].kinds:
        held: dict[str | None, list[HeldRung]] = {}
        for key in product.paths:
            made_by = maker(product, key)
            if key.name == kind.NAME and is_streamed(product, key):
                window_s = windows_s.get(made_by, float("nan"))
                held.setdefault(key.sensor, []).append(HeldRung(key, made_by, window_s))
        if held:
            is_ladder = all(
                len({rung.window_s for rung in rungs}) == len(rungs) > 1
                and all(rung.window_s > 0.0 for rung in rungs)
                for rungs in held.values()
            )
            by_length = {
                sensor: sorted(rungs, key=lambda rung: rung.window_s)
                for sensor, rungs in held.items()
            }
            return by_length if is_ladder else {}
    return {}


def rungs_into_product(
    step: Step,
    rungs: Mapping[str | None, Sequence[HeldRung]],
    product: Product,
    writer: ProductWriter,
) -> list[Container]:
    """Apply a map or scan to all rungs of a product; return the last blocks it made.

    Lines are joined to one table for each sensor.

    ``rungs``: the rungs, by sensor.

    Raises
    ------
    OptionError
        No rung can be used with these options.
    """
    steps = _named(step, rungs, product)
    made: list[Container] = []
    done: set[str] = set()
    joins = step.stage.output is Lines
    for own in rungs.values():
        if joins:
            made.append(_joined(steps, own, product, done))
            writer.write(made[-1])
            continue
        for rung, sink in _applied(steps, own, product, writer, done):
            made += sink.ends(steps[rung.step])
    for held in small_containers(product):
        if not isinstance(held.container, step.stage.output):
            writer.write(held.container, held.step)
    sources = [source_of_product(product)]
    kept = {made_by: one for made_by, one in steps.items() if one.name in done}
    writer.history = [
        *product.history,
        *(history_step(one, [made_by], sources) for made_by, one in kept.items()),
    ]
    if joins:
        names = [one.name for one in kept.values()]
        writer.history += [history_step(simple_step(JOINING), names, ())]
    return made


def _named(
    step: Step, rungs: Mapping[str | None, Sequence[HeldRung]], product: Product
) -> dict[str, Step]:
    """Return the step as it is applied to each rung, by the step that made the rung."""
    taken = {past.step_name for past in product.history}
    steps: dict[str, Step] = {}
    for rung in (rung for own in rungs.values() for rung in own):
        if rung.step not in steps:
            name = free_name(f"{step.name}-{rung_label(rung.window_s)}", taken)
            taken.add(name)
            steps[rung.step] = replace(step, name=name, is_output=True)
    return steps


def _joined(
    steps: Mapping[str, Step], rungs: Sequence[HeldRung], product: Product, done: set[str]
) -> Container:
    """Follow the lines of each rung in a file that is not kept, and join them."""
    with (
        TemporaryDirectory(prefix="uwtrack-") as folder,
        ProductWriter(Path(folder) / "rungs.h5") as aside,
    ):
        applied = _applied(steps, rungs, product, aside, done)
        lines = [sink.read(steps[rung.step]) for rung, sink in applied]
        joined: Container = find_stage(JOINING).function(lines)
    return joined


def _applied(
    steps: Mapping[str, Step],
    rungs: Sequence[HeldRung],
    product: Product,
    writer: ProductWriter,
    done: set[str],
) -> list[tuple[HeldRung, ProductSink]]:
    """Apply each rung's own step to it, and say which rungs cannot be used.

    Raises
    ------
    OptionError
        None can.
    """
    made: list[tuple[HeldRung, ProductSink]] = []
    refusals: list[tuple[HeldRung, OptionError]] = []
    for rung in rungs:
        step, kind = steps[rung.step], CONTAINERS[rung.key.name]
        graph = Graph.of_steps((step,), step.name, (kind,))
        sink = ProductSink(writer, graph)
        engine = Engine(graph, [], sink)
        blocks = product.stream(kind, rung.key.sensor, BLOCK_FRAMES, rung.key.step)
        try:
            for block in blocks:
                engine.feed(step.name, block)
            engine.finish()
        except OptionError as error:  # such as a band of a few cells of short frames
            refusals.append((rung, error))
            continue
        made.append((rung, sink))
        done.add(step.name)
    if not made:
        raise refusals[0][1]
    for rung, refusal in refusals:
        warn(f"the rung of {rung.window_s:g} s is left out: {refusal}")
    return made
