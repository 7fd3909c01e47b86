"""Compare two products by their numbers: what `diff` prints.

**Method.** Containers are matched by sensor and name, their values one by one. Two
numbers agree when ``|a - b| <= atol + rtol * max(|a|, |b|)``; nan agrees with nan.
What only passes by (spectrogram, peaks, families) is read block by block.

**Conventions.** Angles (``_deg``) are compared around the circle, epochs (``_ns``) in
seconds. When a file was made, by which version and from a
source of which name is not compared: that is its history.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.files.hdf5.layout import CONTAINERS
from uwtrack_cli.files.hdf5.product import ContainerKey, Product
from uwtrack_cli.flow.graph import PASSING
from uwtrack_cli.flow.scoring.tolerances import Closeness

BLOCK_FRAMES = 256
NAMES_OF_SOURCES = frozenset({("recording", "name"), ("recording", "digest")})
"""Texts that say which file was read, not what was found."""

Tolerances = Mapping[str, Mapping[str, Closeness]]
Wanted = Callable[[str, str], Closeness]
"""Tolerance of a quantity of a container, both by their names."""


@dataclass(frozen=True)
class Difference:
    """A quantity in which two products differ, and by how much at most."""

    table: str
    """Name of the table."""
    sensor: str | None
    """Identifier of its sensor; None for a table of the whole file."""
    quantity: str
    """Column or single value; empty for the whole table."""
    reason: str
    """In what they differ, in words."""
    n_values: int = 0
    """Number of values compared."""
    n_different: int = 0
    """Number of values outside the tolerance."""
    largest: float = float("nan")
    """Largest absolute difference, in the quantity's unit."""
    largest_relative: float = float("nan")
    """Largest difference relative to the larger magnitude."""
    step: str = ""
    """Name of the step that made the container, where products keep it."""


def compare_products(
    first: Product,
    second: Product,
    *,
    rtol: float = 0.0,
    atol: float = 0.0,
    tolerances: Tolerances | None = None,
) -> list[Difference]:
    """List every quantity in which two products differ by more than is allowed.

    ``rtol``: allowed difference relative to the larger magnitude, 0 or more. ``atol``:
    allowed absolute difference in the unit of each quantity, 0 or more. ``tolerances``:
    tolerances of single quantities, by container and quantity.
    """
    usual, own = Closeness(rtol, atol), tolerances or {}

    def wanted(container: str, quantity: str) -> Closeness:
        return own.get(container, {}).get(quantity, usual)

    found: list[Difference] = []
    keys = {*_keys(first), *_keys(second)}
    for key in sorted(keys, key=lambda key: (key.sensor or "", *key[1:])):
        missing = [p.name for p in (first, second) if key not in p.paths]
        if missing:
            reason = f"is not in {missing[0]}"
            found.append(Difference(key.name, key.sensor, "", reason, step=key.step))
        else:
            different = _compare_streams(first, second, key, wanted)
            found += [replace(item, step=key.step) for item in different]
    return found


def compare_containers(
    first: Container, second: Container, wanted: Wanted, sensor: str | None = None
) -> Iterator[Difference]:
    """Yield the differences of two containers of one kind, parts included."""
    name = first.NAME
    for quantity in first.columns():
        pair = getattr(first, quantity), getattr(second, quantity)
        close = wanted(name, quantity)
        yield from _compare_columns((name, sensor, quantity), *pair, close)
    for quantity in first.scalars():
        pair = getattr(first, quantity), getattr(second, quantity)
        if (name, quantity) in NAMES_OF_SOURCES or any(map(callable, pair)):
            continue
        close = wanted(name, quantity)
        yield from _compare_scalars((name, sensor, quantity), *pair, close)
    for part in first.parts():
        pair = getattr(first, part), getattr(second, part)
        if None not in pair:
            yield from compare_containers(*pair, wanted, sensor)
        elif pair != (None, None):
            yield Difference(name, sensor, part, "is in one of them only")


def _keys(product: Product) -> Iterator[ContainerKey]:
    """Yield what a product holds; parts come with their owners."""
    return (key for key in product.paths if key.name not in {"frames", "navigation"})


def is_streamed(product: Product, key: ContainerKey) -> bool:
    """Tell whether a container passes by in blocks of frames, and is no small table."""
    kind = CONTAINERS[key.name]
    if kind is not Families:
        return kind in PASSING
    return product.has_part(key, "peaks")  # else a table of lasting families


def _compare_streams(
    first: Product, second: Product, key: ContainerKey, wanted: Wanted
) -> list[Difference]:
    sensor, name, step = key
    kind = CONTAINERS[name]
    if not (is_streamed(first, key) and is_streamed(second, key)):
        pair = first.read(kind, sensor, step), second.read(kind, sensor, step)
        return list(compare_containers(*pair, wanted, sensor))
    merged: dict[str, Difference] = {}
    streams = (p.stream(kind, sensor, BLOCK_FRAMES, step) for p in (first, second))
    for one, other in zip_longest(*streams):
        if one is None or other is None:
            return [Difference(name, sensor, "frames", "differ in number")]
        for found in compare_containers(one, other, wanted, sensor):
            before = merged.get(found.quantity)
            merged[found.quantity] = _sum(before, found) if before else found
    return list(merged.values())


def _sum(one: Difference, other: Difference) -> Difference:
    return replace(
        one,
        n_values=one.n_values + other.n_values,
        n_different=one.n_different + other.n_different,
        largest=max(one.largest, other.largest),
        largest_relative=max(one.largest_relative, other.largest_relative),
    )


def _compare_columns(
    key: tuple[str, str | None, str], a: Any, b: Any, close: Closeness
) -> Iterator[Difference]:
    if a is None or b is None:
        if a is not b:
            yield Difference(*key, "is in one of them only")
    elif a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes():
        return
    elif a.shape != b.shape:
        yield Difference(*key, f"has shape {a.shape} and {b.shape}")
    elif a.dtype.kind == "U":
        unequal = int(np.count_nonzero(a != b))
        if unequal:
            yield Difference(*key, "differs", a.size, unequal)
    else:
        yield from _compare_numbers(key, a, b, close)


def _compare_scalars(
    key: tuple[str, str | None, str], a: Any, b: Any, close: Closeness
) -> Iterator[Difference]:
    if a is None or b is None or isinstance(a, str):
        if a != b:
            yield Difference(*key, f"is {a!r} and {b!r}", 1, 1)
    else:
        yield from _compare_numbers(key, np.array([a]), np.array([b]), close)


def _compare_numbers(
    key: tuple[str, str | None, str], a: NDArray[Any], b: NDArray[Any], close: Closeness
) -> Iterator[Difference]:
    if a.dtype.kind in "iu" and b.dtype.kind in "iu":
        apart = np.abs(a.astype(object) - b.astype(object)).astype(float)
        x, y = a.astype(float), b.astype(float)
    else:
        x, y = np.asarray(a, float), np.asarray(b, float)
        with np.errstate(invalid="ignore"):
            apart = np.abs(_around(x - y) if key[2].endswith("_deg") else x - y)
        apart[x == y] = 0.0  # infinities, too
    size = np.maximum(np.abs(x), np.abs(y))
    size[np.isinf(size)] = 0.0  # no share of it is a number
    if key[2].endswith("_ns"):  # a share of the time since 1970 means nothing
        apart, size = apart / NANOSECONDS, np.zeros_like(size)
    unknown = np.isnan(x) & np.isnan(y)
    different = ~unknown & ~(apart <= close.atol + close.rtol * size)
    if not different.any():
        return
    one_sided = int(np.count_nonzero(np.isnan(x) != np.isnan(y)))
    reason = f"differs, {one_sided} known in one only" if one_sided else "differs"
    finite = different & np.isfinite(apart)
    share = np.divide(apart, size, where=size > 0.0, out=np.zeros_like(size))
    yield Difference(
        *key, reason, int(x.size - np.count_nonzero(unknown)),
        int(np.count_nonzero(different)), float(apart[finite].max(initial=0.0)),
        float(share[finite].max(initial=0.0)),
    )  # fmt: skip


def _around(angle_deg: NDArray[Any]) -> NDArray[Any]:
    return np.asarray((angle_deg + 180.0) % 360.0 - 180.0)
