"""The digest of what a product says: shapes, attributes and data.

**Method.** The structure digest is SHA-256 over every object in the order of its
path: kind, element type, shape, and every attribute in the order of its name. The
root digest is SHA-256 over the structure digest and the digests of the datasets,
which are taken over the stored elements in C order, block by block.

**Conventions.** The digest and the mark of completeness are left out, since they
are written last; so is the bookkeeping of dimension scales.
"""

import hashlib
from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from uwtrack_cli.files.layout import BOOKKEEPING

WRITTEN_LAST = frozenset({"sha256", "complete"})
BLOCK_BYTES = 1 << 22


def structure_digest(objects: Mapping[str, h5py.Group | h5py.Dataset]) -> str:
    """Return the digest of all shapes, element types and attributes."""
    total = hashlib.sha256()
    for path in sorted(objects):
        item = objects[path]
        kind = "group"
        if isinstance(item, h5py.Dataset):
            kind = f"{item.dtype.str} {item.shape}"
        _add(total, path.encode(), kind.encode())
        for name in sorted(set(item.attrs) - BOOKKEEPING - WRITTEN_LAST):
            _add(total, name.encode(), _attribute_bytes(item.attrs[name]))
    return total.hexdigest()


def data_digest(dataset: h5py.Dataset) -> str:
    """Return the digest of a dataset's elements, read block by block."""
    total = hashlib.sha256()
    rows, *others = dataset.shape
    row_bytes = max(1, int(np.prod(others, dtype=np.int64)) * dataset.dtype.itemsize)
    step = max(1, BLOCK_BYTES // row_bytes)
    for start in range(0, rows, step):
        total.update(dataset[start : start + step].tobytes())
    return total.hexdigest()


def root_digest(structure: str, data: Mapping[str, str]) -> str:
    """Return the digest of the product from those of its parts."""
    total = hashlib.sha256(structure.encode())
    for path in sorted(data):
        _add(total, path.encode(), data[path].encode())
    return total.hexdigest()


def _add(total: Any, *fields: bytes) -> None:
    for field in fields:
        total.update(f"{len(field)}:".encode())
        total.update(field)


def _attribute_bytes(value: Any) -> bytes:
    if isinstance(value, str):
        return b"text " + value.encode("utf-8", "surrogatepass")
    array = np.asarray(value)
    if array.dtype.kind == "O":
        return b"objects " + repr(array.tolist()).encode()
    return f"{array.dtype.str} {array.shape} ".encode() + array.tobytes()
