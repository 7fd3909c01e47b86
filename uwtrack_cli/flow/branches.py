"""Which of several results of one kind is meant: that of the branch of a step.

**Method.** The history of a product says which step made a result and what that step
read. The branch of a step is the step itself, all that it follows from and all that
follows from it. Of several results of one kind that one is taken which the step itself
made, or else which lies in the branch; of lines that were joined from several rungs, the
points of the branch's own. Where no step is named, lines that `presence` or `multi-resolution` alone
read are not meant, nor those that a step reads after other lines, nor what was read
for a table alone that a later step has made again, nor the picture of an envelope beside
that of the sound.
"""

from collections.abc import Collection, Iterable, Sequence
from typing import TypeVar

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.spectra import Overview, Spectrogram
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.layout import container_of
from uwtrack_cli.files.hdf5.product import ContainerKey, HistoryStep, Product
from uwtrack_cli.flow.catalogue import STAGES, output_class

C = TypeVar("C", bound=Container)

GATHERING = frozenset({"presence", "multi-resolution"})
"""Stages that gather the lines of several steps: what they alone read is told by them."""


def maker(product: Product, key: ContainerKey) -> str:
    """Return the name of the step that made a container, empty if it is not known."""
    if key.step:
        return key.step
    named = {other.step for other in product.paths if other.name == key.name}
    made = (
        past.step_name
        for past in reversed(product.history)
        if past.step_name not in named and key.name in output_names(past)
    )
    return next(made, "")


def output_names(past: HistoryStep) -> tuple[str, ...]:
    """Return the names of what a step of a history made, as far as they are known."""
    if past.stage not in STAGES:
        return ()
    made = container_of(output_class(STAGES[past.stage]))
    part = getattr(made, "STANDS_FOR", "")
    return (made.NAME, part) if part else (made.NAME,)


def keys_of_branch(product: Product, step: str | None) -> list[ContainerKey]:
    """Return what a product holds; of several results of a kind those of a branch.

    ``step``: a step of the branch; everything is returned if it is None, or if the
    product was made without such a step.
    """
    keys = list(product.paths)
    if step is None or step not in step_names(product):
        return keys
    branch = _branch(product.history, step)
    windows_s = rung_windows_s(product.history)
    if step in windows_s:  # a rung's own picture
        branch |= {n for n, window_s in windows_s.items() if window_s == windows_s[step]}
    found: list[ContainerKey] = []
    for key in keys:
        others = [k for k in keys if (k.sensor, k.name) == (key.sensor, key.name)]
        inside = [k for k in others if maker(product, k) == step]
        inside = inside or [k for k in others if maker(product, k) in branch]
        if key in (inside or others):
            found.append(key)
    return found


def sole_keys(product: Product, step: str | None, kinds: Collection[str]) -> list[ContainerKey]:
    """Return `keys_of_branch` after checking that some kinds are there but once.

    ``step``: a step of the branch; None if none was named. ``kinds``: names of the
    containers of which one for each sensor can be used.

    Raises
    ------
    DataError
        There are several; the steps that made them are named.
    """
    keys = keys_of_branch(product, step)
    if step is None:
        keys = without_asides(product, keys)
    keys = _with_usual_pictures(keys)
    for key in keys:
        others = [k for k in keys if (k.sensor, k.name) == (key.sensor, key.name)]
        if key.name in kinds and len(others) > 1:
            refuse_unknown_step([product], step)
            of = "" if key.sensor is None else f" of {key.sensor}"
            names = ", ".join(maker(product, k) or key.name for k in others)
            raise DataError(
                f"{product.name} holds {key.name}{of} of several steps: {names}; "
                f"name one of them with --step."
            )
    return keys


def without_asides(product: Product, keys: Sequence[ContainerKey]) -> list[ContainerKey]:
    """Leave out what is meant only where it is named, if there is more of its kind.

    That is what is gathered by `presence` or `multi-resolution`, and the picture of an envelope.

    ``keys``: some of what it holds.
    """
    aside = [key for key in keys if _is_aside(product, key)]
    return [
        key
        for key in keys
        if key not in aside
        or not any(
            (other.sensor, other.name) == (key.sensor, key.name) and other not in aside
            for other in keys
        )
    ]


def _with_usual_pictures(keys: Sequence[ContainerKey]) -> list[ContainerKey]:
    """Leave out pictures of other rungs, where there is one that needs no naming."""
    usual = {key.sensor for key in keys if key.name == Overview.NAME and not key.step}
    return [
        key for key in keys if key.name != Overview.NAME or not key.step or key.sensor not in usual
    ]


def rung_windows_s(history: Sequence[HistoryStep]) -> dict[str, float]:
    """Return the length of the frames of each step that follows from one rung alone, s.

    Rungs of a ladder are spectrograms that differ in nothing but this length.

    ``history``: the history of a product.
    """
    sources = [past for past in history if past.stage == Spectrogram.NAME]
    alike = [
        {name: value for name, value in past.options.items() if name != "window_s"}
        for past in sources
    ]
    if len(sources) < 2 or any(each != alike[0] for each in alike):
        return {}
    after = {past.step_name: _reached(past.step_name, _edges(history)) for past in sources}
    found: dict[str, float] = {}
    for past in history:
        own = [rung for rung in sources if past.step_name in after[rung.step_name]]
        if len(own) == 1:
            found[past.step_name] = float(own[0].options["window_s"])
    return found


def of_rung(container: C, history: Sequence[HistoryStep], step: str | None) -> C:
    """Return joined lines with the points of one rung alone, where one is named.

    ``container``: what was read of a product; only joined lines are changed.
    ``history``: the history of the product. ``step``: a step that follows from one
    rung, or that it follows from; None for all.
    """
    if step is None or not isinstance(container, Lines):
        return container
    window_s = rung_windows_s(history).get(step)
    return container if window_s is None else container.of_window(window_s)


def _is_aside(product: Product, key: ContainerKey) -> bool:
    name = maker(product, key)
    if key.name == Overview.NAME:
        stages = {past.step_name: past.stage for past in product.history}
        made = [past for past in product.history if past.step_name == name]
        return any(stages.get(one) == "demon" for past in made for one in past.inputs)
    readers = [past for past in product.history if name in past.inputs]
    held = {maker(product, other) for other in product.paths}
    return bool(readers) and all(
        past.step_name not in held or _reads_beside(product, past, name) for past in readers
    )


def _reads_beside(product: Product, past: HistoryStep, name: str) -> bool:
    """Tell whether a step gathers a result, or reads these lines after other ones."""
    if past.stage in GATHERING:
        return True
    made = {other.step_name: output_names(other) for other in product.history}
    lines = [one for one in past.inputs if Lines.NAME in made.get(one, ())]
    return name in lines[1:]


def read_of_branch(product: Product, kind: type[C], sensor: str | None, step: str | None) -> C:
    """Read a container, of several results of its kind that of a branch.

    ``kind``: class of the container. ``sensor``: its sensor; not needed where only one
    has such a container. ``step``: a step of the branch; not needed where only one step
    made such a container.

    Raises
    ------
    DataError
        There is none, or several and no sensor or step is named.
    """
    keys = sole_keys(product, step, {kind.NAME})
    made_by = {key.step for key in keys if key.name == kind.NAME and sensor in (None, key.sensor)}
    found = product.read(kind, sensor, made_by.pop() if len(made_by) == 1 else None)
    return of_rung(found, product.history, step)


def step_names(product: Product) -> list[str]:
    """Return the names of the steps that made a product."""
    return [past.step_name for past in product.history]


def refuse_unknown_step(products: Sequence[Product], step: str | None) -> None:
    """Refuse the name of a step that made nothing of what is in some products.

    Raises
    ------
    DataError
        None of the products was made with such a step.
    """
    known = dict.fromkeys(name for p in products for name in step_names(p))
    if step is not None and step not in known:
        names = ", ".join(product.name for product in products) or "the input"
        steps = ", ".join(known) or "none"
        raise DataError(f"{names} was made without a step {step!r}; its steps: {steps}.")


def _branch(history: Sequence[HistoryStep], step: str) -> set[str]:
    """Return a step with all that it follows from and all that follows from it."""
    edges = _edges(history)
    back = _reached(step, [(after, before) for before, after in edges])
    return back | _reached(step, edges)


def _edges(history: Sequence[HistoryStep]) -> list[tuple[str, str]]:
    return [(source, past.step_name) for past in history for source in past.inputs]


def _reached(step: str, edges: Iterable[tuple[str, str]]) -> set[str]:
    found = {step}
    pairs = list(edges)
    while new := {b for a, b in pairs if a in found} - found:
        found |= new
    return found
