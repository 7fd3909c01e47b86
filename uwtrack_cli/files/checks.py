"""What a product file must be before anything of it is believed or allocated.

**Method.** Every link is looked at before it is followed: only plain (hard) links
count, and an object met twice is refused, so that no link leads out of the file or
in circles. A dataset's elements must lie in the file: products are stored without
compression, so an array larger than its file is a lie. No attribute is read before
its size is known. Nothing is ever unpickled.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from uwtrack_cli.data.base import Column
from uwtrack_cli.errors import DataError

MAX_OBJECTS = 100_000
MAX_ATTRIBUTE_BYTES = 1 << 20
HDF5_ERRORS = (
    OSError, RuntimeError, KeyError, ValueError, TypeError, UnicodeError,
    AttributeError, IndexError, OverflowError, MemoryError,
)  # fmt: skip


@contextlib.contextmanager
def reading(name: str) -> Iterator[None]:
    """Turn what HDF5 says of a damaged file into an error of ours."""
    try:
        yield
    except DataError:
        raise
    except HDF5_ERRORS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        msg = f"{name} is damaged: {reason}. Make it again from its source."
        raise DataError(msg) from error


def check_readable(path: Path) -> None:
    """Refuse a path that is no readable regular file.

    Raises
    ------
    DataError
        The file is missing, a folder, a device, empty or not readable.
    """
    try:
        if not path.exists():
            msg = f"{path} does not exist."
            raise DataError(msg)
        if path.is_dir():
            msg = f"{path} is a folder, not a file."
            raise DataError(msg)
        if not path.is_file():
            msg = f"{path} is a device or a pipe, not a regular file."
            raise DataError(msg)
        with path.open("rb") as handle:
            if not handle.read(1):
                msg = f"{path} is empty."
                raise DataError(msg)
    except OSError as error:
        msg = f"cannot read {path}: {error.strerror or error}."
        raise DataError(msg) from error


def attribute(item: Any, name: str) -> Any:
    """Return a scalar attribute as str, bool, int or float.

    Raises
    ------
    DataError
        The attribute is missing, too large, an array, or of a foreign type.
    """
    key = name.encode()
    if not h5py.h5a.exists(item.id, key):
        msg = f"{item.name} lacks the attribute {name!r}"
        raise DataError(msg)
    handle = h5py.h5a.open(item.id, key)
    type_class = handle.get_type().get_class()
    known = (h5py.h5t.INTEGER, h5py.h5t.FLOAT, h5py.h5t.STRING)
    if handle.shape != () or type_class not in known:
        msg = f"attribute {name!r} of {item.name} is no single number or text"
        raise DataError(msg)
    if handle.get_storage_size() > MAX_ATTRIBUTE_BYTES:
        msg = f"attribute {name!r} of {item.name} is too large"
        raise DataError(msg)
    value = item.attrs[name]
    if isinstance(value, bytes):
        return value.decode()
    return value.item() if isinstance(value, np.generic) else value


def safe_objects(file: h5py.File) -> dict[str, Any]:
    """Return every object of a file by its path, without following foreign links.

    Raises
    ------
    DataError
        A link leads elsewhere, an object is met twice or is of a foreign kind.
    """
    found: dict[str, Any] = {"/": file}
    seen = {_address(file)}
    todo = [("", file)]
    while todo:
        prefix, group = todo.pop()
        for name in group:
            path = f"{prefix}/{name}"
            item = _object(group, name, path)
            if _address(item) in seen or len(found) > MAX_OBJECTS:
                msg = f"{path} is linked twice, or there are too many objects"
                raise DataError(msg)
            seen.add(_address(item))
            found[path] = item
            if isinstance(item, h5py.Group):
                todo.append((path, item))
            else:
                check_storage(item)
    return found


def check_storage(dataset: h5py.Dataset) -> None:
    """Refuse a dataset whose elements do not lie, plainly, in the file itself.

    Raises
    ------
    DataError
        Elements elsewhere, a foreign filter, or more of them than the file holds.
    """
    name = dataset.name
    if dataset.is_virtual or dataset.external:
        msg = f"{name} keeps its elements in other files"
        raise DataError(msg)
    plist = dataset.id.get_create_plist()
    filters = {plist.get_filter(i)[0] for i in range(plist.get_nfilters())}
    if filters - {h5py.h5z.FILTER_FLETCHER32}:
        msg = f"{name} uses a filter that products do not have"
        raise DataError(msg)
    if dataset.dtype.kind not in "iufS":
        dtype = h5py.check_string_dtype(dataset.dtype)
        if dtype is None or dtype.length is None:
            msg = f"{name} has elements of a type that products do not have"
            raise DataError(msg)
    if dataset.is_scale:
        return  # names an axis: holds no elements, and is never read
    size = int(np.prod([float(n) for n in dataset.shape])) * dataset.dtype.itemsize
    if size > dataset.id.get_storage_size() or size > dataset.file.id.get_filesize():
        msg = f"{name} claims {size} bytes, more than the file holds"
        raise DataError(msg)


def check_rank(dataset: Any, spec: Column) -> None:
    """Refuse what is no dataset of the rank of a column.

    Raises
    ------
    DataError
        No dataset, or wrong rank.
    """
    if not isinstance(dataset, h5py.Dataset) or dataset.ndim != len(spec.axes):
        msg = f"{dataset.name} is no array with the axes {spec.axes}"
        raise DataError(msg)


def check_type(name: str, dtype: np.dtype[Any], spec: Column) -> None:
    """Refuse elements that are not of the type of a column.

    Raises
    ------
    DataError
        Wrong element type.
    """
    kind = {"b": "i1", "U": "S"}.get(spec.dtype.kind, spec.dtype.str[1:])
    if not (dtype.kind == "S" if kind == "S" else dtype.str[1:] == kind):
        msg = f"{name} holds {dtype}, expected {spec.dtype}"
        raise DataError(msg)


def _object(group: h5py.Group, name: str, path: str) -> Any:
    link = group.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        msg = f"{path} is a link to elsewhere, which products do not have"
        raise DataError(msg)
    item = group[name]
    if not isinstance(item, h5py.Group | h5py.Dataset):
        msg = f"{path} is neither a group nor a dataset"
        raise DataError(msg)
    return item


def _address(item: Any) -> int:
    return int(h5py.h5o.get_info(item.id).addr)
