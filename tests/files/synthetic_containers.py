"""Containers of every class with arbitrary contents, for the laws of the codec."""

from typing import Any

import numpy as np

from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.files.hdf5.layout import part_classes, scalar_types

FIXED_SIZES = {
    "parameter": 4,
    "parameter_too": 4,
    "coordinate": 2,
    "coordinate_too": 2,
    "state": 2,
    "state_too": 2,
}
TEXTS = ("", "ok", "Ærø", "level-only", "{}", "海")


def synthetic(
    kind: type[Container],
    n_rows: int,
    *,
    seed: int = 1,
    sensor: str = "h1",
    with_optional: bool = True,
    **fixed: Any,
) -> Any:
    """Make a container; every axis has a length of its own."""
    rng = np.random.default_rng(seed)
    sizes: dict[str, int] = {}
    values: dict[str, Any] = {}
    for name, spec in kind.columns().items():
        for axis in spec.axes:
            size = FIXED_SIZES.get(axis, n_rows + len(sizes) if n_rows else 0)
            sizes.setdefault(axis, size)
        shape = tuple(sizes[axis] for axis in spec.axes)
        values[name] = _array(rng, spec, shape)
        if spec.owner:
            values[name] = rng.integers(0, max(1, sizes[spec.owner]), shape)
        if spec.optional and not with_optional:
            values[name] = None
    scalars = {str: "x", bool: True, int: 3, float: 2.5}
    values |= {name: scalars[plain] for name, plain in scalar_types(kind).items()}
    if "sensor" in scalar_types(kind):
        values["sensor"] = sensor
    if kind.NAME == "sensor":
        values["id"] = sensor
    for name, part in part_classes(kind).items():
        values[name] = synthetic(part, n_rows, seed=seed, sensor=sensor)
    values |= fixed
    return kind.join([kind(**values)])


def _array(rng: np.random.Generator, spec: Column, shape: tuple[int, ...]) -> Any:
    if spec.dtype.kind == "U":
        return rng.choice(np.array(TEXTS), shape)
    if spec.dtype.kind == "b":
        return rng.random(shape) < 0.5
    if spec.dtype.kind in "iu":
        return rng.integers(0, 100, shape).astype(spec.dtype)
    values = rng.normal(size=shape).astype(spec.dtype)
    values[rng.random(shape) < 0.2] = np.nan
    return values
