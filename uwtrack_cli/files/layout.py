"""Names and shapes in a product file: groups, axes, elements, chunks.

**Conventions.** A sensor's containers lie in a group of the sensor's name; an
identifier that HDF5 could not hold as a name, or that is the name of a container,
is percent-encoded, and the group's attribute ``sensor`` holds the true one.
Attribute ``absent`` of a container's group lists the fields that are None.
"""

from typing import Any
from urllib.parse import quote

import h5py
import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.registry import CONTAINERS

FORMAT = "uwtrack product"
"""Value of the root attribute ``format``."""

SCHEMA_VERSION = 2
"""Version of the layout that this program writes; `migration` reads the older ones."""

DIMENSION_ONLY = "This is a netCDF dimension but not a netCDF variable."
"""Name of a dimension scale without values, as the netCDF-4 format asks for."""

BOOKKEEPING = frozenset(
    {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_Netcdf4Dimid"}
)
"""Attributes that belong to HDF5's dimension scales."""

CHUNK_BYTES = 1 << 17

LEAST_TEXT_BYTES = 4
"""Width of the shortest text; netCDF readers join texts of one byte into words."""


def sensor_of(container: Container) -> str | None:
    """Return the sensor that a container belongs to, None for a whole file."""
    if container.NAME == "sensor":
        return str(getattr(container, "id"))  # noqa: B009
    own = getattr(container, "sensor", None)
    if isinstance(own, str):
        return own
    for name in container.parts():
        part = getattr(container, name)
        sensor = None if part is None else sensor_of(part)
        if sensor is not None:
            return sensor
    return None


def group_path(sensor: str | None, name: str) -> str:
    """Return the path of a container's group."""
    return f"/{name}" if sensor is None else f"/{safe_name(sensor)}/{name}"


def safe_name(sensor: str) -> str:
    """Return the identifier of a sensor as a name that HDF5 can hold.

    Examples
    --------
    >>> safe_name("h1"), safe_name("a/b"), safe_name(".."), safe_name("lines")
    ('h1', 'a%2Fb', '%2E%2E', '%6Cines')
    """
    name = quote(sensor, safe="")
    if not name.strip("."):
        return "%2E" * len(name) or "%"
    if name in CONTAINERS or name == "history":
        return f"%{ord(name[0]):02X}{name[1:]}"
    return name


def scale_name(kind: type[Container], axis: str) -> str:
    """Return the name of an axis in the file; never that of a column.

    Examples
    --------
    >>> scale_name(CONTAINERS["lines"], "point"), scale_name(CONTAINERS["lines"], "line")
    ('point', 'line_row')
    """
    taken = {*kind.columns(), *kind.parts()}
    return f"{axis}_row" if axis in taken else axis


def is_growing(kind: type[Container], spec: Column) -> bool:
    """Tell whether blocks of a stream add rows to a column."""
    return spec.axes[0] not in kind.FIXED_AXES


def encode(array: NDArray[Any]) -> NDArray[Any]:
    """Return the elements as they are stored: booleans as bytes, text as UTF-8.

    Raises
    ------
    DataError
        A text holds characters that UTF-8 does not have.
    """
    if array.dtype.kind == "b":
        return array.astype(np.int8)
    if array.dtype.kind != "U":
        return np.ascontiguousarray(array)
    try:
        encoded = np.char.encode(array, "utf-8") if array.size else array
    except UnicodeEncodeError as error:
        msg = f"a text cannot be stored as UTF-8: {error}."
        raise DataError(msg) from error
    width = max(LEAST_TEXT_BYTES, encoded.dtype.itemsize if array.size else 0)
    return encoded.astype(h5py.string_dtype("utf-8", width))


def decode(array: NDArray[Any], spec: Column) -> NDArray[Any]:
    """Return stored elements as a column has them.

    Raises
    ------
    DataError
        A text is not UTF-8.
    """
    if spec.dtype.kind == "b":
        return array.astype(np.bool_)
    if spec.dtype.kind != "U":
        return array
    try:
        return np.char.decode(array, "utf-8") if array.size else array.astype("U1")
    except UnicodeDecodeError as error:
        msg = f"a text is not UTF-8: {error}."
        raise DataError(msg) from error


def chunk_shape(shape: tuple[int, ...], itemsize: int, final: bool) -> tuple[int, ...]:
    """Return the chunk of a dataset: whole rows, about 128 kB of them.

    Parameters
    ----------
    shape
        Shape of the rows known so far.
    itemsize
        Bytes of an element.
    final
        Whether no further rows will come, so that a small table gets a small chunk.
    """
    row = max(1, int(np.prod(shape[1:], dtype=np.int64)) * itemsize)
    rows = max(1, CHUNK_BYTES // row)
    if final:
        rows = max(1, min(rows, shape[0]))
    return (rows, *(max(1, size) for size in shape[1:]))
