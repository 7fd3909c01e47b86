"""Make a product again from its own history.

**Method.** The steps of the history are a recipe. Its first step names what it read:
recordings are opened as the product says they were (sensor, span, channels, start
time are in it), tables are read again, and each source must have the digest that the
history gives. One pass over each recording so gives what commands made one by one.
The new product holds the same kinds of containers as the old one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.product import HistoryStep, Product, read_product, write_product
from uwtrack_cli.flow.catalogue import find_stage
from uwtrack_cli.flow.chain import PASSING, run_recipe
from uwtrack_cli.flow.comparison import is_streamed
from uwtrack_cli.flow.products import whole_stage
from uwtrack_cli.flow.recipe import Recipe, Step
from uwtrack_cli.flow.rerun_sources import SourceFinder, read_tables, reopen


@dataclass(frozen=True)
class Plan:
    """What must be run: sources, the steps over each of them, the steps over all."""

    sources: tuple[HistoryStep, ...]
    each: tuple[Step, ...]
    last: tuple[Step, ...]


def rerun_product(
    path: Path, target: Path, *, sources: Sequence[Path] = (), overwrite: bool = False
) -> None:
    """Make a product again.

    Parameters
    ----------
    path
        The product.
    target
        Where the new one shall appear.
    sources
        Files that it was made of, or folders with them; else they lie beside it.
    overwrite
        Whether an existing file may be replaced.

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
        names = {name for _, name in product.paths}
        history = [
            HistoryStep.now(step.stage, step.options, step.sources)
            for step in product.history
        ]
    kept = [container for container in made if container.NAME in names]
    write_product(
        target, kept, history=history, overwrite=overwrite,
        inputs=[path, *finder.found],
    )  # fmt: skip


def _plan(product: Product) -> Plan:
    steps = product.history
    if not steps:
        msg = f"{product.name} has no history, so it cannot be made again."
        raise DataError(msg)
    sources = tuple(s for s in steps if find_stage(s.stage).kind == "source")
    rest = [_step(s) for s in steps if s not in sources]
    _check_unique(product, rest)
    held = {name for _, name in product.paths}
    has_overview = any(step.stage_name == "overview" for step in rest)
    if sources and "overview" in held and not has_overview:
        rest.insert(0, Step("overview", {}))  # `spectrogram` adds one by itself
    if len(sources) == 1:
        return Plan(sources, tuple(rest), ())
    return Plan(sources, tuple(rest[:-1]), tuple(rest[-1:])) if sources else Plan(
        (), (), tuple(rest)
    )  # fmt: skip


def _check_unique(product: Product, steps: Sequence[Step]) -> None:
    names = [step.stage_name for step in steps]
    for name in names:
        if names.count(name) > 1:
            msg = (
                f"{product.name} was made with {names.count(name)} settings of {name}: "
                f"make each of its sources again by itself."
            )
            raise DataError(msg)


def _step(step: HistoryStep) -> Step:
    return Step(step.stage, find_stage(step.stage).bind(step.options))


def _run(product: Product, plan: Plan, finder: SourceFinder) -> list[Container]:
    streamed = {key[1] for key in product.paths if is_streamed(product, key)}
    available: list[Container] = []
    for source in plan.sources:
        recording, beside = reopen(product, source, finder)
        steps = (_step(source), *plan.each)
        recipe = Recipe("history", "", steps)
        keep = [kind for kind in PASSING if kind.NAME in streamed]
        available += [*run_recipe(recording, recipe, keep=keep), *beside]
    if not plan.sources:
        available += read_tables(product.history, finder)
    for step in plan.last:
        if not available:
            msg = (
                f"{product.name} began with {step.stage_name}, which reads what was "
                f"made before, and its history does not tell how: run the chain again."
            )
            raise DataError(msg)
        available = whole_stage(step, available, [])
    return available
