"""What a product file looks like inside: containers, groups, axes, elements, chunks.

A new container is added to `_PLACES` and nowhere else: reading, writing, `info`,
`show` and `diff` all work from this list.

**Conventions.** A sensor's containers lie in a group of the sensor's name; an
identifier that HDF5 could not hold as a name, or that is the name of a container,
is percent-encoded, and the group's attribute ``sensor`` holds the true one.
A result of a step with a name of its own lies in a group of that name within it,
or within the group ``steps`` if it is of the whole file; the attribute ``step`` of that
group holds the name. Attribute ``absent`` of a container's group lists the fields that
are None. Texts are stored with a fixed length, which fletcher32 asks for and which
needs no heap.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import Any, cast, get_args, get_type_hints
from urllib.parse import quote

import h5py
import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.data.options import nearest
from uwtrack_cli.data.renamed import TABLES
from uwtrack_cli.errors import DataError

FORMAT = "uwtrack product"
"""Value of the root attribute ``format``."""

SCHEMA_VERSION = 5
"""Version of the layout that this program writes; `migration` reads the older ones."""

STEPS = "steps"
"""Group of the containers of the whole file that steps with own names made."""

RESERVED = frozenset({"history", "step", STEPS})
"""Names at the root that are no containers: the history, its axis, and `STEPS`."""

DIMENSION_ONLY = "This is a netCDF dimension but not a netCDF variable."
"""Name of a dimension scale without values, as the netCDF-4 format asks for."""

CHUNK_BYTES = 1 << 17

LEAST_TEXT_BYTES = 4
"""Width of the shortest text; netCDF readers join texts of one byte into words."""

_PLACES = {
    "recording": "recording:Recording",
    "files": "recording:RecordedFiles",
    "sensor": "sensor:Sensor",
    "navigation": "sensor:Navigation",
    "lock": "recording:Lock",
    "frames": "frames:Frames",
    "spectrogram": "spectra:Spectrogram",
    "overview": "spectra:Overview",
    "levels": "spectra:Levels",
    "decidecades": "decidecades:Decidecades",
    "fringes": "fringes:Fringes",
    "delays": "directions:Delays",
    "directions": "directions:Directions",
    "bearing_time": "bearing_time:BearingTime",
    "peaks": "peaks:Peaks",
    "families": "peaks:Families",
    "transients": "transients:Transients",
    "lines": "lines:Lines",
    "presence": "presence:Presence",
    "encounters": "encounters:Encounters",
    "radiated": "decidecades:RadiatedLevels",
    "fixes": "encounters:Fixes",
    "motions": "motions:Motions",
    "series": "series:Series",
    "contacts": "scans:Contacts",
    "scans": "scans:Scans",
    "roc": "scans:Roc",
    "target": "targets:Target",
    "decision": "decisions:Decision",
}
"""Module and class of each container, in the order of the chain."""


class _ContainerClasses(Mapping[str, type[Container]]):
    """Classes by name; each is imported when it is first asked for."""

    def __getitem__(self, name: str) -> type[Container]:
        module, _, kind = _PLACES[name].partition(":")
        found = getattr(import_module(f"uwtrack_cli.data.{module}"), kind)
        return cast("type[Container]", found)

    def __contains__(self, name: object) -> bool:
        return name in _PLACES

    def __iter__(self) -> Iterator[str]:
        return iter(_PLACES)

    def __len__(self) -> int:
        return len(_PLACES)


CONTAINERS = _ContainerClasses()
"""Container classes by name, in the order of the chain."""

UNSTORED: frozenset[tuple[str, str]] = frozenset({("recording", "reader"), ("series", "where")})
"""Fields that live in memory only: they read back as None."""


def container_class(name: str) -> type[Container]:
    """Return the container class of a name such as ``"lines"``.

    Raises
    ------
    DataError
        There is no container of that name.
    """
    name = TABLES.get(name, name)
    if name not in CONTAINERS:
        names = ", ".join(CONTAINERS)
        raise DataError(
            f"there is no table {name!r}.{nearest(name, CONTAINERS)} There are: {names}."
        )
    return CONTAINERS[name]


def container_of(class_name: str) -> type[Container]:
    """Return the container class of the class's own name such as ``"Lines"``."""
    ending = f":{class_name}"
    return CONTAINERS[next(n for n, place in _PLACES.items() if place.endswith(ending))]


def part_classes(kind: type[Container]) -> dict[str, type[Container]]:
    """Return the class of every part of a container, by the name of its field."""
    hints = _hints(kind.NAME)
    return {name: _container_in(hints[name]) for name in kind.parts()}


def scalar_types(kind: type[Container]) -> Mapping[str, type]:
    """Return the plain type (str, bool, int or float) of every stored scalar."""
    hints = _hints(kind.NAME)
    return {
        name: _plain(hints[name]) for name in kind.scalars() if (kind.NAME, name) not in UNSTORED
    }


@cache
def _hints(name: str) -> dict[str, Any]:
    return get_type_hints(container_class(name))


def _container_in(hint: object) -> type[Container]:
    for choice in (hint, *get_args(hint)):
        if isinstance(choice, type) and issubclass(choice, Container):
            return choice
    raise TypeError(f"{hint!r} is neither a column, a scalar nor a container.")


def _plain(hint: object) -> type:
    for choice in (hint, *get_args(hint)):
        if choice in {str, bool, int, float} and isinstance(choice, type):
            return choice
    raise TypeError(f"a scalar of type {hint!r} cannot be stored.")


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


def group_path(sensor: str | None, name: str, step: str = "") -> str:
    """Return the path of a container's group.

    ``sensor``: its sensor; None for a container of the whole file. ``step``: name of
    the step that made it, where that is not the name of its stage.
    """
    inside = f"{safe_name(step)}/{name}" if step else name
    if sensor is not None:
        return f"/{safe_name(sensor)}/{inside}"
    return f"/{STEPS}/{inside}" if step else f"/{inside}"  # never a sensor's group


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
    if name in CONTAINERS or name in RESERVED:
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


def is_appendable(kind: type[Container], spec: Column) -> bool:
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
        raise DataError(f"a text cannot be stored as UTF-8: {error}.") from error
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
        raise DataError(f"a text is not UTF-8: {error}.") from error


def chunk_shape(shape: tuple[int, ...], itemsize: int, final: bool) -> tuple[int, ...]:
    """Return the chunk of a dataset: whole rows, about 128 kB of them.

    ``shape``: shape of the rows known so far. ``itemsize``: bytes of an element.
    ``final``: whether no further rows will come, so that a small table gets a small
    chunk.
    """
    row = max(1, int(np.prod(shape[1:], dtype=np.int64)) * itemsize)
    rows = max(1, CHUNK_BYTES // row)
    if final:
        rows = max(1, min(rows, shape[0]))
    return (rows, *(max(1, size) for size in shape[1:]))
