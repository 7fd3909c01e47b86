"""Apply one stage to product files: what a command of the chain does.

**Method.** Streamed containers are read and written in blocks of frames; small ones
are read whole, found by type and sensor in all the files given. The output carries
the small containers of its sources forward, so that it explains itself.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.layout import sensor_of
from uwtrack_cli.files.product import HistoryStep, Product, ProductWriter, Source
from uwtrack_cli.files.registry import CONTAINERS
from uwtrack_cli.flow.chain import PASSING, apply_stream, apply_whole
from uwtrack_cli.flow.recipe import Recipe, Step

BLOCK_FRAMES = 256
"""Frames read at once: whole tiles of the noise floor."""


def history_of(
    products: Sequence[Product], step: Step, sources: Sequence[Source]
) -> list[HistoryStep]:
    """Return the histories of the sources, extended by a step."""
    before: list[HistoryStep] = []
    for product in products:
        before += [past for past in product.history if past not in before]
    return [*before, HistoryStep.now(step.stage_name, step.values(), sources)]


def stream_stage(
    step: Step, product: Product, writer: ProductWriter
) -> list[Container]:
    """Apply a map or scan to every sensor of a product; return the last blocks of each.

    Of a sensor these are the last block with frames and the one that ends the stream.

    Raises
    ------
    DataError
        The product has nothing that the stage reads.
    """
    kinds = step.stage.inputs[0].kinds
    last: list[Container] = []
    for sensor, names in product.containers().items():
        kind = next((k for k in kinds if k.NAME in names), None)
        if kind is None:
            continue
        ends: list[Container] = []
        for block in apply_stream(step, product.stream(kind, sensor, BLOCK_FRAMES)):
            writer.append(block)
            ends = [*ends[-1:], block]
        last += ends
    if not last:
        raise DataError(_wrong_product(step, [product]))
    for container in small_containers(product):
        if container.NAME != step.stage.output.NAME:
            writer.write(container)
    return last


def whole_stage(
    step: Step, available: Sequence[Container], products: Sequence[Product]
) -> list[Container]:
    """Apply a whole stage; return its result and the containers carried forward.

    A stage that takes lists sees all sensors at once; any other one is applied to
    each sensor in turn.

    Raises
    ------
    DataError
        The files have nothing that the stage reads, or two different candidates.
    """
    there = _distinct(available)
    wanted = tuple(kind for i in step.stage.inputs for kind in i.kinds)
    required = [c for c in there if isinstance(c, step.stage.inputs[0].kinds)]
    if not any(isinstance(c, wanted) for c in there):
        raise DataError(_wrong_product(step, products))
    if any(i.is_list for i in step.stage.inputs):
        if not required:
            raise DataError(_wrong_product(step, products))
        made = [apply_whole(step, there)]
    else:
        made = [apply_whole(step, group) for group in _by_sensor(there, wanted)]
    result = made[0] if len(made) == 1 else type(made[0]).join(made)
    carried = [c for c in there if type(c) is not type(result)]
    several = [c for c in carried if isinstance(c, Encounters)]
    if len(several) > 1:
        rest = [c for c in carried if not isinstance(c, Encounters)]
        carried = [*rest, Encounters.join(several)]
    return [*carried, result]


def small_containers(product: Product) -> Iterator[Container]:
    """Read what later files carry: everything that does not only pass by."""
    passing = {kind.NAME for kind in PASSING}
    for sensor, names in product.containers().items():
        parts = _part_names(names)
        for name in names:
            if name not in passing and name not in parts:
                yield product.read(CONTAINERS[name], sensor)


def _part_names(names: Sequence[str]) -> set[str]:
    """Names that are stored as parts of others and come back with them."""
    return {"frames", "navigation"} & set(names)


def _distinct(containers: Sequence[Container]) -> list[Container]:
    found: list[Container] = []
    for container in containers:
        if not any(container.equals(other) for other in found):
            found.append(container)
    return found


def _by_sensor(
    containers: Sequence[Container], wanted: tuple[type[Container], ...]
) -> Iterator[list[Container]]:
    """Group what belongs to one sensor; what has no sensor goes to every group."""
    common = [c for c in containers if sensor_of(c) is None]
    sensors = list(
        dict.fromkeys(
            sensor_of(c) for c in containers if isinstance(c, wanted) and sensor_of(c)
        )
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
    return Source(name=Path(product.name).name, digest=product.digest)


def history_of_recipe(recipe: Recipe, recording: Recording) -> list[HistoryStep]:
    """Return one step per stage of a recipe; the first names the recording."""
    sources = [source_of_recording(recording)]
    return [
        HistoryStep.now(step.stage_name, step.values(), sources if k == 0 else [])
        for k, step in enumerate(recipe.steps)
    ]
