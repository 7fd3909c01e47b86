"""One container out of its group: checked column by column, whole or in part."""

from collections.abc import Mapping
from typing import Any, TypeVar, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import attribute, check_rank, check_type
from uwtrack_cli.files.layout import decode
from uwtrack_cli.files.migration import migrate
from uwtrack_cli.files.registry import part_classes, scalar_types

C = TypeVar("C", bound=Container)
Rows = Mapping[tuple[str, str], slice]
"""Rows to read, by container and axis; axes not named are read whole."""


def read_whole(file: h5py.File, path: str, kind: type[C]) -> C:
    """Read a container in the order that `Container.join` gives its rows."""
    container = read_group(file, path, kind, {})
    own_order = kind.join.__func__ is not Container.join.__func__  # type: ignore[attr-defined]
    return kind.join([container]) if own_order else container


def read_group(file: h5py.File, path: str, kind: type[C], rows: Rows) -> C:
    """Read a container, or some rows of it, with its parts."""
    group = container_group(file, path, kind)
    absent = set(filter(None, str(attribute(group, "absent")).split(",")))
    values: dict[str, Any] = {}
    for name, spec in kind.columns().items():
        if name in absent and spec.optional:
            values[name] = None
        else:
            chosen = rows.get((kind.NAME, spec.axes[0]), slice(None))
            values[name] = read_column(group, name, spec, chosen)
    for name, plain in scalar_types(kind).items():
        values[name] = None if name in absent else _scalar(group, name, plain)
    for name, part in part_classes(kind).items():
        values[name] = None
        if name not in absent:
            target = str(attribute(group, name))
            values[name] = read_group(file, target, part, rows)
    return kind(**values)


def container_group(file: h5py.File, path: str, kind: type[Container]) -> h5py.Group:
    """Return the group of a container, made sure of its kind."""
    group = file.get(path) if path in file else None
    if not isinstance(group, h5py.Group):
        msg = f"there is no group {path}"
        raise DataError(msg)
    if attribute(group, "container") != kind.NAME:
        msg = f"{path} holds no {kind.NAME}"
        raise DataError(msg)
    return group


def part_path(group: h5py.Group, name: str) -> str | None:
    """Return the path of a container's part, None if it has none."""
    if name in str(attribute(group, "absent")).split(","):
        return None
    return str(attribute(group, name))


def column_dataset(group: h5py.Group, name: str, spec: Column) -> h5py.Dataset:
    """Return the dataset of a column, checked but not yet read."""
    if name not in group:
        msg = f"{group.name} lacks the column {name!r}"
        raise DataError(msg)
    dataset = group[name]
    check_rank(dataset, spec)
    none = np.zeros(0, dataset.dtype)
    check_type(dataset.name, _of_today(dataset, none).dtype, spec)
    return dataset


def read_column(group: h5py.Group, name: str, spec: Column, rows: slice) -> Any:
    """Read the rows of a column as the container wants them."""
    dataset = column_dataset(group, name, spec)
    return decode(_of_today(dataset, dataset[rows]), spec)


def _of_today(dataset: h5py.Dataset, values: NDArray[Any]) -> NDArray[Any]:
    """Return elements as they would be stored today."""
    version = int(attribute(dataset.file, "schema_version"))
    container = str(attribute(dataset.parent, "container"))
    return migrate(version, container, dataset.name.rsplit("/", 1)[1], values)


def _scalar(group: h5py.Group, name: str, plain: type) -> Any:
    value = attribute(group, name)
    numeric = isinstance(value, int | float) and plain is not str
    if not (isinstance(value, plain) or numeric):
        msg = f"attribute {name!r} of {group.name} is {value!r}, expected {plain}"
        raise DataError(msg)
    return cast("Any", plain(value))
