"""One container's group while it is being written: datasets that grow.

**Method.** Blocks are kept until they are worth a write, then joined and appended,
so that the size of a block changes neither values nor speed. Text is kept to the
end, because its stored width is that of the longest. Every dataset's digest is
taken while it passes, so that nothing is read back.
"""

import hashlib
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.layout import (
    DIMENSION_ONLY,
    chunk_shape,
    encode,
    is_growing,
    scale_name,
)
from uwtrack_cli.files.registry import scalar_types

PENDING_BYTES = 1 << 22
"""Blocks are written when they have come to so many bytes together."""


class GrowingGroup:
    """A group that takes blocks of one container and becomes its stored form."""

    def __init__(self, group: h5py.Group, kind: type[Container]) -> None:
        self.group = group
        self.kind = kind
        self.absent: set[str] = set()
        self.pending: dict[str, list[NDArray[Any]]] = {}
        self.pending_bytes = 0
        self.datasets: dict[str, h5py.Dataset] = {}
        self.hashes: dict[str, Any] = {}
        self.first: Container | None = None
        self.last: Container | None = None

    def append(self, block: Container) -> None:
        """Take the rows of a block; its single values count if it is the last."""
        for name, spec in self.kind.columns().items():
            values = getattr(block, name)
            self._check_presence(name, values)
            if values is None or not is_growing(self.kind, spec):
                continue
            self.pending.setdefault(name, []).append(values)
            if spec.dtype.kind != "U":
                self.pending_bytes += values.nbytes
        rowless = self.first is not None and not _has_rows(self.first)
        if self.first is None or (rowless and _has_rows(block)):
            self.first = block
        self.last = block
        if self.pending_bytes > PENDING_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the rows that wait; texts wait on for the longest of them."""
        self._flush(final=False)

    def finish(self) -> None:
        """Write what is left, label every axis and list the absent fields."""
        self._flush(final=True)
        self._write_facts()
        sizes: dict[str, int] = {}
        for name, dataset in self.datasets.items():
            for axis, size in zip(
                self.kind.columns()[name].axes, dataset.shape, strict=True
            ):
                sizes.setdefault(axis, size)
        for axis, size in sizes.items():
            self._label(axis, size)
        self.group.attrs["absent"] = ",".join(sorted(self.absent))

    def digests(self) -> dict[str, str]:
        """Return the digest of every column."""
        return {name: total.hexdigest() for name, total in self.hashes.items()}

    def _write_facts(self) -> None:
        """Write what does not grow as `Container.join` has it."""
        block = self._summary()
        for name, spec in self.kind.columns().items():
            values = getattr(block, name)
            if values is not None and not is_growing(self.kind, spec):
                self._write(name, spec, encode(values), final=True)
        self.group.attrs["container"] = self.kind.NAME
        for name, plain in scalar_types(self.kind).items():
            value = getattr(block, name)
            if value is None:
                self.absent.add(name)
                continue
            try:
                stored = np.int8(value) if plain is bool else plain(value)
                self.group.attrs[name] = stored
            except (ValueError, TypeError, OverflowError) as error:
                msg = f"{self.kind.NAME}.{name} cannot be stored: {error}."
                raise DataError(msg) from error

    def _summary(self) -> Container:
        """Return a container with the single values and fixed axes of all blocks."""
        if self.first is None or self.last is None:
            msg = f"no block of {self.kind.NAME} was written."
            raise DataError(msg)
        if self.first is self.last:
            return self.last
        return self.kind.join([self.first, self.last])

    def _check_presence(self, name: str, values: NDArray[Any] | None) -> None:
        if self.last is None and values is None:
            self.absent.add(name)
        elif (values is None) != (name in self.absent):
            msg = f"some blocks of {self.kind.NAME} have {name}, others have not."
            raise DataError(msg)

    def _flush(self, *, final: bool) -> None:
        columns = self.kind.columns()
        for name in list(self.pending):
            if columns[name].dtype.kind == "U" and not final:
                continue
            blocks = self.pending.pop(name)
            try:
                rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
            except ValueError as error:
                msg = f"blocks of {self.kind.NAME}.{name} differ in shape: {error}."
                raise DataError(msg) from error
            self._write(name, columns[name], encode(rows), final=final)
        self.pending_bytes = 0

    def _write(
        self, name: str, spec: Column, rows: NDArray[Any], *, final: bool
    ) -> None:
        if name not in self.datasets:
            fixed = final or not is_growing(self.kind, spec)
            self.datasets[name] = self._create(name, spec, rows, final=fixed)
            self.hashes[name] = hashlib.sha256()
        dataset = self.datasets[name]
        if dataset.shape[1:] != rows.shape[1:]:
            msg = (
                f"a block of {self.kind.NAME}.{name} has rows of shape "
                f"{rows.shape[1:]}, those before it {dataset.shape[1:]}."
            )
            raise DataError(msg)
        if rows.shape[0]:
            start = dataset.shape[0]
            dataset.resize(start + rows.shape[0], axis=0)
            dataset[start:] = rows
            self.hashes[name].update(rows.reshape(-1).view(np.uint8))

    def _create(
        self, name: str, spec: Column, rows: NDArray[Any], *, final: bool
    ) -> h5py.Dataset:
        dataset = self.group.create_dataset(
            name,
            shape=(0, *rows.shape[1:]),
            maxshape=(None,) * rows.ndim,
            chunks=chunk_shape(rows.shape, rows.dtype.itemsize, final),
            dtype=rows.dtype,
            fletcher32=True,
        )
        dataset.attrs["units"] = spec.unit or "1"
        dataset.attrs["long_name"] = spec.description
        if spec.dtype.kind == "b":
            dataset.attrs["dtype"] = "bool"  # as xarray marks booleans in netCDF
        return dataset

    def _label(self, axis: str, size: int) -> None:
        name = scale_name(self.kind, axis)
        scale = make_scale(self.group, name, size)
        for column, dataset in self.datasets.items():
            for position, own in enumerate(self.kind.columns()[column].axes):
                if own == axis:
                    dataset.dims[position].attach_scale(scale)


def _has_rows(block: Container) -> bool:
    return any(
        getattr(block, name).shape[0]
        for name, spec in block.columns().items()
        if getattr(block, name) is not None and is_growing(type(block), spec)
    )


def make_scale(group: h5py.Group, name: str, size: int) -> h5py.Dataset:
    """Make a dimension without values: it names an axis and takes no room."""
    scale = group.create_dataset(
        name, shape=(size,), maxshape=(None,), chunks=(1024,), dtype="i1",
        fletcher32=True,
    )  # fmt: skip
    scale.make_scale(DIMENSION_ONLY)
    scale.attrs["units"] = "1"
    scale.attrs["long_name"] = f"Axis {name} (an axis without values of its own)."
    return scale
