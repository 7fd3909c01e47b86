"""Compare two products by their numbers: what `diff` prints.

**Method.** Containers are matched by sensor and name, their values one by one. Two
numbers agree when ``|a - b| <= atol + rtol * max(|a|, |b|)``; nan agrees with nan.
What only passes by (spectrogram, peaks, families) is read block by block.

**Conventions.** Angles (``_deg``) are compared around the circle, epochs (``_ns``) in
seconds. Texts that hold
JSON are compared by their numbers. When a file was made, by which version and from a
source of which name is not compared: that is its history.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.files.product import Product
from uwtrack_cli.files.reading import container_group, part_path
from uwtrack_cli.files.registry import CONTAINERS
from uwtrack_cli.flow.chain import PASSING
from uwtrack_cli.flow.tolerances import Closeness

BLOCK_FRAMES = 256
NAMES_OF_SOURCES = frozenset({("recording", "name"), ("recording", "digest")})
"""Texts that say which file was read, not what was found."""

Tolerances = Mapping[str, Mapping[str, Closeness]]


@dataclass(frozen=True)
class Difference:
    """A quantity in which two products differ, and by how much at most."""

    container: str
    sensor: str | None
    quantity: str
    reason: str
    n_values: int = 0
    n_different: int = 0
    largest: float = float("nan")
    largest_relative: float = float("nan")


@dataclass
class Comparison:
    """Options of a comparison, and the differences found so far."""

    default: Closeness = field(default_factory=Closeness)
    tolerances: Tolerances = field(default_factory=dict)

    def closeness(self, container: str, quantity: str) -> Closeness:
        """Return the tolerance of a quantity."""
        return self.tolerances.get(container, {}).get(quantity, self.default)


def compare_products(
    first: Product,
    second: Product,
    *,
    rtol: float = 0.0,
    atol: float = 0.0,
    tolerances: Tolerances | None = None,
) -> list[Difference]:
    """List every quantity in which two products differ by more than is allowed.

    Parameters
    ----------
    first
        One product, open for reading.
    second
        The other one.
    rtol
        Allowed difference relative to the larger magnitude, 0 or more.
    atol
        Allowed absolute difference in the unit of each quantity, 0 or more.
    tolerances
        Tolerances of single quantities, by container and quantity.
    """
    wanted = Comparison(Closeness(rtol, atol), tolerances or {})
    found: list[Difference] = []
    keys = sorted(
        {*_keys(first), *_keys(second)}, key=lambda key: (key[0] or "", key[1])
    )
    for sensor, name in keys:
        missing = [
            p.name for p in (first, second) if (sensor, name) not in set(_keys(p))
        ]
        if missing:
            reason = f"is not in {missing[0]}"
            found.append(Difference(name, sensor, "", reason))
        else:
            found += _compare_streams(first, second, (sensor, name), wanted)
    return found


def compare_containers(
    first: Container, second: Container, wanted: Comparison, sensor: str | None = None
) -> Iterator[Difference]:
    """Yield the differences of two containers of one kind, parts included."""
    name = first.NAME
    for quantity in first.columns():
        pair = getattr(first, quantity), getattr(second, quantity)
        close = wanted.closeness(name, quantity)
        yield from _compare_columns((name, sensor, quantity), *pair, close)
    for quantity in first.scalars():
        pair = getattr(first, quantity), getattr(second, quantity)
        if (name, quantity) in NAMES_OF_SOURCES or any(map(callable, pair)):
            continue
        close = wanted.closeness(name, quantity)
        yield from _compare_scalars((name, sensor, quantity), *pair, close)
    for part in first.parts():
        pair = getattr(first, part), getattr(second, part)
        if None not in pair:
            yield from compare_containers(*pair, wanted, sensor)
        elif pair != (None, None):
            yield Difference(name, sensor, part, "is in one of them only")


def _keys(product: Product) -> Iterator[tuple[str | None, str]]:
    """Yield what a product holds; parts come with their owners."""
    for sensor, names in product.containers().items():
        for name in names:
            if name not in {"frames", "navigation"}:
                yield sensor, name


def is_streamed(product: Product, key: tuple[str | None, str]) -> bool:
    """Tell whether a container passes by in blocks of frames, and is no small table.

    Parameters
    ----------
    product
        The product that holds it.
    key
        Its sensor and its name.
    """
    kind = CONTAINERS[key[1]]
    if kind is not Families:
        return kind in PASSING
    group = container_group(product.file, product.paths[key], kind)
    return part_path(group, "peaks") is not None  # else a table of lasting families


def _compare_streams(
    first: Product, second: Product, key: tuple[str | None, str], wanted: Comparison
) -> list[Difference]:
    sensor, name = key
    kind = CONTAINERS[name]
    if not (is_streamed(first, key) and is_streamed(second, key)):
        pair = first.read(kind, sensor), second.read(kind, sensor)
        return list(compare_containers(*pair, wanted, sensor))
    merged: dict[str, Difference] = {}
    streams = (p.stream(kind, sensor, BLOCK_FRAMES) for p in (first, second))
    for one, other in zip_longest(*streams):
        if one is None or other is None:
            return [Difference(name, sensor, "frames", "differ in number")]
        for found in compare_containers(one, other, wanted, sensor):
            before = merged.get(found.quantity)
            merged[found.quantity] = _sum(before, found) if before else found
    return list(merged.values())


def _sum(one: Difference, other: Difference) -> Difference:
    return Difference(
        one.container,
        one.sensor,
        one.quantity,
        one.reason,
        one.n_values + other.n_values,
        one.n_different + other.n_different,
        max(one.largest, other.largest),
        max(one.largest_relative, other.largest_relative),
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
        pairs = zip(a.ravel(), b.ravel(), strict=True)
        unequal = sum(not _same_text(str(x), str(y), close) for x, y in pairs)
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
    key: tuple[str, str | None, str],
    a: NDArray[Any],
    b: NDArray[Any],
    close: Closeness,
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
    if key[2].endswith("_ns"):  # a share of the time since 1970 means nothing
        apart, size = apart / NANOSECONDS, np.zeros_like(size)
    unknown = np.isnan(x) & np.isnan(y)
    different = ~unknown & ~(apart <= close.atol + close.rtol * size)
    if not different.any():
        return
    one_sided = int(np.count_nonzero(np.isnan(x) != np.isnan(y)))
    reason = f"differs, {one_sided} known in one only" if one_sided else "differs"
    told = different & np.isfinite(apart)
    yield Difference(
        *key,
        reason,
        int(x.size - np.count_nonzero(unknown)),
        int(np.count_nonzero(different)),
        float(apart[told].max(initial=0.0)),
        float(
            np.divide(apart, size, where=size > 0.0, out=np.zeros_like(size))[told].max(
                initial=0.0
            )
        ),
    )


def _around(angle_deg: NDArray[Any]) -> NDArray[Any]:
    return np.asarray((angle_deg + 180.0) % 360.0 - 180.0)


def _same_text(a: str, b: str, close: Closeness) -> bool:
    if a == b:
        return True
    try:
        return _same_json(json.loads(a), json.loads(b), close)
    except (ValueError, RecursionError):
        return False


def _same_json(a: Any, b: Any, close: Closeness) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same_json(a[k], b[k], close) for k in a)
    if isinstance(a, list) and isinstance(b, list):
        pairs = zip(a, b, strict=False)
        return len(a) == len(b) and all(_same_json(x, y, close) for x, y in pairs)
    numbers = isinstance(a, int | float) and isinstance(b, int | float)
    if numbers and not isinstance(a, bool) and not isinstance(b, bool):
        return bool(abs(a - b) <= close.atol + close.rtol * max(abs(a), abs(b)))
    return bool(a == b)
