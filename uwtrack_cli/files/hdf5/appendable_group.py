"""The group of a container that is being written: blocks are appended to its columns.

**Method.** Blocks are kept until they are worth a write, then joined and appended, so
that the size of a block changes neither values nor bytes. Text is kept to the end,
because its stored width is that of the longest.
"""

from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.layout import (
    CONTAINERS,
    DIMENSION_ONLY,
    chunk_shape,
    encode,
    is_appendable,
    part_classes,
    scalar_types,
    scale_name,
    sensor_of,
)

PENDING_BYTES = 1 << 17
"""Blocks are written when they have come to so many bytes together: a product has a
dozen groups that wait, and a quiet sensor takes hours to fill what is larger."""

COMPARED_BYTES = 1 << 22
"""Bytes of two columns that are compared at once."""

TIME_BASE = ("start_sample", "time_s", "valid_fraction")
"""Columns of frames that must agree for one to stand for the other."""


class AppendableGroup:
    """The group of one container, which takes blocks, with those of its parts."""

    def __init__(
        self, file: h5py.File, path: str, block: Container, sensor: str | None = None
    ) -> None:
        kind = CONTAINERS.get(block.NAME)
        if kind is not type(block):
            raise DataError(f"{type(block).__name__} is not a table that files can hold.")
        self.kind = kind
        self.group = file.create_group(path)
        own = sensor_of(block)
        self.sensor = sensor if own is None else own
        self.absent = _absent(block)
        self.parts = {
            name: AppendableGroup(file, f"{path}/{name}", getattr(block, name), self.sensor)
            for name in part_classes(kind)
            if name not in self.absent
        }
        self.is_finished = False
        self.facts: dict[str, Any] = {}
        self.datasets: dict[str, h5py.Dataset] = {}
        self._pending: dict[str, list[NDArray[Any]]] = {}
        self._pending_bytes = 0
        self._first = self._last = block

    @property
    def path(self) -> str:
        """Path of the group at this moment."""
        return str(self.group.name)

    def append(self, block: Container) -> None:
        """Take the rows of a block; its single values count if it is the last."""
        if _absent(block) != self.absent:
            names = ", ".join(sorted(_absent(block) ^ self.absent))
            raise DataError(f"some blocks of {self.kind.NAME} have {names}, others have not.")
        for name, spec in self._columns(appendable=True):
            values = getattr(block, name)
            is_known = name in self._pending or name in self.datasets
            if is_known and not values.shape[0]:
                continue  # tables of a stream come at its end, and nothing before
            self._pending.setdefault(name, []).append(_its_own(values))
            self._pending_bytes += values.nbytes if spec.dtype.kind != "U" else 0
        if not _has_rows(self._first) and _has_rows(block):
            self._first = block
        self._last = block
        if self._pending_bytes > PENDING_BYTES:
            self.write_pending()
        for name, part in self.parts.items():
            part.append(getattr(block, name))

    def write_pending(self, *, final: bool = False) -> None:
        """Write the rows that wait; texts wait on for the longest of them."""
        for name, spec in self._columns(appendable=True):
            if name in self._pending and (final or spec.dtype.kind != "U"):
                blocks = self._pending.pop(name)
                try:
                    rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
                except ValueError as error:
                    raise DataError(
                        f"blocks of {self.kind.NAME}.{name} differ in shape: {error}."
                    ) from error
                self._write(name, spec, encode(rows), final=final)
        self._pending_bytes = 0

    def finish(self) -> None:
        """Write what is left and the single values, and label every axis, once."""
        if self.is_finished:
            return
        self.is_finished = True
        self.write_pending(final=True)
        block = self._last
        if self._first is not block:
            block = self.kind.join([self._first, block])
        for name, spec in self._columns(appendable=False):
            self._write(name, spec, encode(getattr(block, name)), final=True)
        self._write_scalars(block)
        sizes: dict[str, int] = {}
        for name, dataset in self.datasets.items():
            axes = self.kind.columns()[name].axes
            sizes |= dict(zip(axes, dataset.shape, strict=True))
        for axis, size in sizes.items():
            self._label(axis, size)
        for part in self.parts.values():
            part.finish()

    def name_parts(self) -> None:
        """Let the group name the groups of its parts, and what it does not have."""
        for name, part in self.parts.items():
            set_text(self.group, name, part.path)
        set_text(self.group, "absent", ",".join(sorted(self.absent)))

    def agrees(self, other: "AppendableGroup") -> bool:
        """Tell whether one of two parts may stand for both."""
        if (self.absent, repr(self.facts)) != (other.absent, repr(other.facts)):
            return False
        if any(part is not other.parts[name] for name, part in self.parts.items()):
            return False
        names = TIME_BASE if self.kind.NAME == "frames" else tuple(self.datasets)
        return all(_same(self.datasets[n], other.datasets[n]) for n in names)

    def depth(self) -> int:
        """Return how deep its parts are nested."""
        return max((1 + part.depth() for part in self.parts.values()), default=0)

    def n_known(self) -> int:
        """Return the number of frames whose noise is known; 0 for any other part."""
        if self.kind.NAME != "frames":
            return 0
        return int(np.isfinite(self.datasets["threshold_db"][:]).sum())

    def _columns(self, *, appendable: bool) -> Iterator[tuple[str, Column]]:
        for name, spec in self.kind.columns().items():
            if name not in self.absent and appendable == is_appendable(self.kind, spec):
                yield name, spec

    def _write(self, name: str, spec: Column, rows: NDArray[Any], *, final: bool) -> None:
        if name not in self.datasets:
            self.datasets[name] = dataset = self.group.create_dataset(
                name,
                shape=(0, *rows.shape[1:]),
                maxshape=(None,) * rows.ndim,
                chunks=chunk_shape(rows.shape, rows.dtype.itemsize, final),
                dtype=rows.dtype,
                fletcher32=True,
            )
            set_text(dataset, "units", spec.unit or "1")
            set_text(dataset, "long_name", spec.description)
            if spec.dtype.kind == "b":
                set_text(dataset, "dtype", "bool")  # as xarray marks booleans
        dataset = self.datasets[name]
        if dataset.shape[1:] != rows.shape[1:]:
            raise DataError(
                f"a block of {self.kind.NAME}.{name} has rows of shape "
                f"{rows.shape[1:]}, those before it {dataset.shape[1:]}."
            )
        if rows.shape[0]:
            start = dataset.shape[0]
            dataset.resize(start + rows.shape[0], axis=0)
            dataset[start:] = rows

    def _write_scalars(self, block: Container) -> None:
        set_text(self.group, "container", self.kind.NAME)
        for name, plain in scalar_types(self.kind).items():
            value = getattr(block, name)
            if value is None:
                self.absent.add(name)
                continue
            try:
                self.facts[name] = plain(value)
                if plain is str:
                    set_text(self.group, name, str(value))
                else:
                    stored = np.int8(value) if plain is bool else plain(value)
                    self.group.attrs[name] = stored
            except (ValueError, TypeError, OverflowError) as error:
                raise DataError(f"{self.kind.NAME}.{name} cannot be stored: {error}.") from error

    def _label(self, axis: str, size: int) -> None:
        scale = make_scale(self.group, scale_name(self.kind, axis), size)
        for column, dataset in self.datasets.items():
            for position, own in enumerate(self.kind.columns()[column].axes):
                if own == axis:
                    dataset.dims[position].attach_scale(scale)


def set_text(item: Any, name: str, text: str) -> None:
    """Set an attribute to a text of fixed length.

    Raises
    ------
    DataError
        The text holds characters that UTF-8 does not have.
    """
    if name in item.attrs:
        del item.attrs[name]
    value = encode(np.array([text], np.str_))
    item.attrs.create(name, value[0], shape=(), dtype=value.dtype)


def make_scale(group: h5py.Group, name: str, size: int) -> h5py.Dataset:
    """Make a dimension without values: it names an axis and takes no room."""
    scale = group.create_dataset(
        name, shape=(size,), maxshape=(None,), chunks=(1024,), dtype="i1", fletcher32=True
    )
    scale.make_scale(DIMENSION_ONLY)
    set_text(scale, "units", "1")
    set_text(scale, "long_name", f"Axis {name} (an axis without values of its own).")
    return scale


def _its_own(values: NDArray[Any]) -> NDArray[Any]:
    """Return an array that does not keep the larger one alive of which it is a part."""
    whole = values.base
    is_part = isinstance(whole, np.ndarray) and whole.nbytes > values.nbytes
    return values.copy() if is_part else values


def _absent(block: Container) -> set[str]:
    """Return the names of the columns and parts that are None."""
    names = (*block.columns(), *block.parts())
    return {name for name in names if getattr(block, name) is None}


def _has_rows(block: Container) -> bool:
    return any(
        getattr(block, name).shape[0]
        for name, spec in block.columns().items()
        if getattr(block, name) is not None and is_appendable(type(block), spec)
    )


def _same(one: h5py.Dataset, other: h5py.Dataset) -> bool:
    """Tell whether two datasets hold the same elements, bit for bit."""
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    row = max(1, int(np.prod(one.shape[1:], dtype=np.int64)) * one.dtype.itemsize)
    step = max(1, COMPARED_BYTES // row)
    return all(
        one[start : start + step].tobytes() == other[start : start + step].tobytes()
        for start in range(0, one.shape[0], step)
    )
