"""Reading a product: container by container, or in blocks of frames.

**Conventions.** A block holds so many frames and the rows that refer to them: rows
with a column ``frame`` are stored in its order. `Container.join` of the blocks is
what `Product.read` gives, bit for bit.
"""

import contextlib
import tempfile
import weakref
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Self, TypeVar, cast, overload

import h5py
import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data import renamed
from uwtrack_cli.data.base import Column, Container, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines, point_order
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.hdf5.checksum import Checksum
from uwtrack_cli.files.hdf5.container_keys import ContainerHolder, ContainerKey, sole_key
from uwtrack_cli.files.hdf5.examination import attribute, check_stored, open_examined, reading
from uwtrack_cli.files.hdf5.history import HistoryStep
from uwtrack_cli.files.hdf5.layout import (
    CONTAINERS,
    STEPS,
    container_class,
    decode,
    part_classes,
    scalar_types,
)
from uwtrack_cli.files.hdf5.migration import migrate, split_columns, stored_name

C = TypeVar("C", bound=Container)
Rows = Mapping[tuple[str, str], slice]
"""Rows to read, by container and axis; axes not named are read whole."""

Orders = Mapping[tuple[str, str], IntArray]
"""Order in which the rows are wanted, by container and axis; others stay as stored."""

Hold = Callable[[NDArray[Any]], NDArray[Any]]
"""Takes a column, and returns the array that is kept of it."""

MAX_READ_BYTES = 1 << 32
"""Most that is read of a column at once: what is longer is read in blocks."""

INDEXED_AXES: dict[str, tuple[tuple[str, str], ...]] = {
    "spectrogram": (),
    "levels": (),
    "peaks": (("peaks", "peak"),),
    "families": (("peaks", "peak"), ("families", "family")),
}
"""Containers that can be streamed, with the axes whose rows name their frame."""


class Product(ContainerHolder):
    """A product file, open for reading; containers are read when asked for.

    ::

        /                        format, schema_version, program_version, complete
        +- history (step)        one JSON object per stage that was run
        +- encounters/           containers of the whole file
        |  +- time_s (encounter) units, long_name; fletcher32
        |  +- encounter          the axis: a dimension without values
        +- steps/                containers of the whole file by steps with own names
        |  +- second/            step = "second"
        |     +- encounters/
        +- h1/                   sensor = "h1"
           +- sensor/            container, absent, and every scalar by its name
           +- frames/            stored once, named by the attribute ``frames`` of
           +- spectrogram/       ... every container that it belongs to
           +- peaks/
           +- fine/              step = "fine": results of a step with its own name
           |  +- peaks/
           +- lines/
              +- frames/         only where a container's part differs from the
                                 one that its sensor's other containers have

    and behind the HDF5 bytes the line of `checksum`.
    """

    def __init__(self, file: h5py.File, name: str, checksum: Checksum) -> None:
        self.file = file
        self.name = name
        with reading(name):
            self.paths = _container_paths(file)
            self.program_version = str(attribute(file, "program_version"))
            self.schema_version = int(attribute(file, "schema_version"))
            self.digest = checksum.sha256
            self.created_utc = checksum.created_utc
            if self.schema_version < 3:
                self.digest = str(attribute(file, "sha256"))
                self.created_utc = str(attribute(file, "created_utc"))
            self.history_texts = _history(file)
            self.history = list(map(HistoryStep.from_json, self.history_texts))

    def __enter__(self) -> Self:
        """Return the product itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file."""
        self.file.close()

    def containers(self) -> dict[str | None, list[str]]:
        """Return the names of the containers per sensor (None: the whole file)."""
        found: dict[str | None, set[str]] = {}
        for key in self.paths:
            found.setdefault(key.sensor, set()).add(key.name)
        order = list(CONTAINERS)
        return {key: sorted(names, key=order.index) for key, names in found.items()}

    def facts(self, key: ContainerKey) -> dict[str, Any]:
        """Return the single values of a container, and as ``rows`` how many it has.

        Those that the file lacks are left out.
        """
        kind = CONTAINERS[key.name]
        name, spec = next(iter(kind.columns().items()))
        with reading(self.name):
            own = _group(self.file, self.paths[key], kind)
            rows = _dataset(own, name, spec).shape[0]
            return _scalars(own, kind, _absent(own.group)) | {"rows": rows}

    def shapes(self, key: ContainerKey) -> dict[str, tuple[int, ...]]:
        """Return the shapes of a container's columns, as far as it has them."""
        kind = CONTAINERS[key.name]
        with reading(self.name):
            own = _group(self.file, self.paths[key], kind)
            return {
                column: _dataset(own, column, spec).shape
                for column, spec in kind.columns().items()
                if _name(own, column) in own.group
            }

    def has_part(self, key: ContainerKey, part: str) -> bool:
        """Tell whether a container has a part."""
        with reading(self.name):
            own = _group(self.file, self.paths[key], CONTAINERS[key.name])
            return part not in _absent(own.group)

    @overload
    def read_all(self, kind: type[C]) -> list[C]: ...

    @overload
    def read_all(self, kind: str) -> list[Container]: ...

    def read_all(self, kind: type[Container] | str) -> Sequence[Container]:
        """Read the containers of a kind, a class or its name, of all sensors."""
        wanted = container_class(kind) if isinstance(kind, str) else kind
        return [
            self.read(wanted, key.sensor, key.step) for key in self.paths if key.name == wanted.NAME
        ]

    def stream(
        self,
        kind: type[C],
        sensor: str | None = None,
        block_rows: int = 256,
        step: str | None = None,
    ) -> Iterator[C]:
        """Read a container in blocks of frames.

        ``kind``: its class: `Spectrogram`, `Levels`, `Peaks` or `Families`. ``sensor``:
        its sensor; not needed where only one has such a container. ``block_rows``:
        frames in a block, 1 or more. ``step``: the step that made it, as for `read`.

        Raises
        ------
        OptionError
            A block of no frames.
        DataError
            The container does not follow frames, or its rows are not in their order.
        """
        if block_rows < 1:
            raise OptionError(f"a block must have at least 1 frame, got {block_rows}.")
        return self._stream(kind, self._path(kind, sensor, step), block_rows)

    def _stream(self, kind: type[C], path: str, block_rows: int) -> Iterator[C]:
        with reading(self.name):
            yield from _stream(self.file, path, kind, block_rows)

    def _path(self, kind: type[Container], sensor: str | None, step: str | None) -> str:
        return self.paths[sole_key(self.paths, kind, sensor, step, self.name)]

    def _held(self) -> Collection[ContainerKey]:
        return self.paths.keys()

    def _container(self, key: ContainerKey) -> Container:
        with reading(self.name):
            return read_whole(self.file, self.paths[key], CONTAINERS[key.name])


def read_product(path: Path | str) -> Product:
    """Open a product file for reading.

    Raises
    ------
    DataError
        The file is missing, no HDF5, damaged, foreign, incomplete or too new.
    """
    return _opened(Path(path), str(path))


def read_in_child(path: Path) -> Product:
    """Open a product in a process that may be lost: without the examination.

    Raises
    ------
    DataError
        As of `read_product`.
    """
    return _opened(path, str(path), may_be_lost=True)


def read_product_bytes(data: bytes) -> Product:
    """Open a product that was read from a pipe.

    Raises
    ------
    DataError
        The bytes are no product, or a damaged, incomplete or too new one.
    """
    if not data:
        raise DataError("standard input is empty.")
    with contextlib.ExitStack() as stack:
        folder = tempfile.TemporaryDirectory(prefix="uwtrack-")
        path = Path(stack.enter_context(folder)) / "standard-input.h5"
        path.write_bytes(data)
        product = _opened(path, "standard input")
        weakref.finalize(product, stack.pop_all().close)
    return product


def _opened(path: Path, name: str, *, may_be_lost: bool = False) -> Product:
    file, checksum = open_examined(path, name, may_be_lost=may_be_lost)
    try:
        return Product(file, name, checksum)
    except BaseException:
        file.close()
        raise


def _container_paths(file: h5py.File) -> dict[ContainerKey, str]:
    """Return where each container lies: groups are named by what they hold.

    A group of another name is a sensor's, the one of steps, or a step's within them.
    """
    found = {ContainerKey(None, own): f"/{name}" for name in file if (own := _held(name))}
    for name in (n for n in file if not _held(n)):
        group = file[name]
        if not isinstance(group, h5py.Group):
            continue
        is_of_steps = name == STEPS and "sensor" not in group.attrs
        sensor = None if is_of_steps else str(attribute(group, "sensor"))
        for inside in group:
            if own := _held(inside):
                found[ContainerKey(sensor, own)] = f"/{name}/{inside}"
                continue
            of_step = group[inside]
            if "step" not in of_step.attrs:  # a container that this program lacks
                attribute(of_step, "container")
                continue
            step = str(attribute(of_step, "step"))
            for each in of_step:
                if own := _held(each):
                    key = ContainerKey(sensor, own, step)
                    found[key] = f"/{name}/{inside}/{each}"
    return dict(sorted(found.items(), key=lambda row: (row[0].sensor or "", *row[0][1:])))


def _held(group: str) -> str:
    """Return the container that a group is named after; empty if it is none."""
    name = renamed.TABLES.get(group, group)
    return name if name in CONTAINERS else ""


def _history(file: h5py.File) -> list[str]:
    steps = file["history"]
    if not isinstance(steps, h5py.Dataset) or steps.ndim != 1 or steps.dtype.kind != "S":
        raise DataError("/history is no list of texts")
    check_stored(steps)
    return [step.decode() for step in steps[:]]


def read_whole(file: h5py.File, path: str, kind: type[C], hold: Hold = np.asarray) -> C:
    """Read a container in the order that `Container.join` gives its rows.

    ``hold``: takes each column that was read and returns the array that is kept of it.
    """
    orders: Orders = {}
    if kind is Lines:
        # before the points: each column is put in order and held before the next
        own, columns = _group(file, path, kind), kind.columns()
        line, frame = (_column(own, name, columns[name], slice(None)) for name in ("line", "frame"))
        orders = {(kind.NAME, "point"): point_order(line, frame)}
    return _read(file, path, kind, {}, hold, orders)


def _read(
    file: h5py.File,
    path: str,
    kind: type[C],
    rows: Rows,
    hold: Hold = np.asarray,
    orders: Orders = MappingProxyType({}),
) -> C:
    """Read a container, or some rows of it, with its parts."""
    own = _group(file, path, kind)
    absent, stored = _absent(own.group), set(own.group)
    values = _split(own, kind)
    empty: set[str] = set()
    for name, spec in kind.columns().items():
        if name in values:
            continue
        first = spec.axes[0]
        if spec.optional and (name in absent or _name(own, name) not in stored):
            values[name] = None
        elif spec.axes in {(axis,) for axis in empty}:  # no file need be asked
            plain = "U1" if spec.dtype.kind == "U" else spec.dtype
            values[name] = hold(np.zeros(0, plain))
        else:
            axis = kind.NAME, first
            column = _column(own, name, spec, rows.get(axis, slice(None)))
            values[name] = hold(column[orders[axis]] if axis in orders else column)
            if not len(column):
                empty.add(first)
    values |= _scalars(own, kind, absent)
    for name, part in part_classes(kind).items():
        values[name] = None
        if name not in absent:
            where = str(attribute(own.group, name))
            values[name] = _read(file, where, part, rows, hold)
    return kind(**values)


class _Stored(NamedTuple):
    """A container in a file, with what each of its columns asks for."""

    group: h5py.Group
    """Its group."""
    container: str
    """Its name."""
    version: int
    """Version of the layout of the file."""


def _group(file: h5py.File, path: str, kind: type[Container]) -> _Stored:
    """Return the group of a container, made sure of its kind."""
    try:
        group = file[path]
    except KeyError:
        group = None
    if not isinstance(group, h5py.Group):
        raise DataError(f"there is no group {path}")
    if _held(str(attribute(group, "container"))) != kind.NAME:
        raise DataError(f"{path} holds no {kind.NAME}")
    return _Stored(group, kind.NAME, int(attribute(file, "schema_version")))


def _absent(group: h5py.Group) -> set[str]:
    """Return the names of the fields that are None."""
    return set(filter(None, str(attribute(group, "absent")).split(",")))


def _name(own: _Stored, column: str) -> str:
    """Return the name that a column of today has in the file."""
    return stored_name(own.version, own.container, column)


def _dataset(own: _Stored, name: str, spec: Column) -> h5py.Dataset:
    """Return the dataset of a column, checked but not yet read."""
    group, container, version = own
    stored = _name(own, name)
    try:
        dataset = group[stored]
    except KeyError as error:
        raise DataError(f"{group.name} lacks the column {stored!r}") from error
    if not isinstance(dataset, h5py.Dataset) or dataset.ndim != len(spec.axes):
        raise DataError(f"{group.name}/{stored} is no array with the axes {spec.axes}")
    check_stored(dataset)
    dtype = migrate(version, container, name, np.zeros(0, dataset.dtype)).dtype
    kind = {"b": "i1", "U": "S"}.get(spec.dtype.kind, spec.dtype.str[1:])
    if not (dtype.kind == "S" if kind == "S" else dtype.str[1:] == kind):
        raise DataError(f"{dataset.name} holds {dtype}, expected {spec.dtype}")
    return dataset


def _column(own: _Stored, name: str, spec: Column, rows: slice) -> Any:
    """Read the rows of a column as the container wants them."""
    dataset = _dataset(own, name, spec)
    n_rows = len(range(*rows.indices(dataset.shape[0])))
    row_bytes = int(np.prod(dataset.shape[1:], dtype=float)) * dataset.dtype.itemsize
    if n_rows * row_bytes > MAX_READ_BYTES:
        raise DataError(f"{dataset.name} is too large to be read at once")
    return decode(migrate(own.version, own.container, name, dataset[rows]), spec)


def _split(own: _Stored, kind: type[Container]) -> dict[str, Any]:
    """Return the columns that an older version kept together in one."""
    found: dict[str, Any] = {}
    for name, split in split_columns(own.version, kind.NAME).items():
        axes = next(iter(kind.columns().values())).axes
        text = Column(axes, "", np.dtype(np.str_), "", optional=False)
        found |= split(_column(own, name, text, slice(None)))
    return found


def _scalars(own: _Stored, kind: type[Container], absent: set[str]) -> dict[str, Any]:
    """Return the single values that the file has; the others have their defaults."""
    stored, declared = set(own.group.attrs), kind.scalars()
    return {
        name: None if name in absent else _scalar(own.group, name, plain)
        for name, plain in scalar_types(kind).items()
        if name in stored or not _says_nothing(declared[name].default)
    }


def _says_nothing(default: Any) -> bool:
    """Tell whether a default is none, empty, zero or nan: a fact that came later."""
    return default in {None, "", 0.0} or default != default  # noqa: PLR0124 - nan


def _scalar(group: h5py.Group, name: str, plain: type) -> Any:
    value = attribute(group, name)
    numeric = isinstance(value, int | float) and plain is not str
    if not (isinstance(value, plain) or numeric):
        raise DataError(f"attribute {name!r} of {group.name} is {value!r}, expected {plain}")
    return cast("Any", plain(value))


def _stream(file: h5py.File, path: str, kind: type[C], block_rows: int) -> Iterator[C]:
    """Yield a container in blocks of frames."""
    paths = _part_paths(file, path, kind)
    if kind.NAME not in INDEXED_AXES or "frames" not in paths:
        raise DataError(f"{kind.NAME} cannot be read in blocks of frames")
    frames = _group(file, paths["frames"], Frames)
    n_frames = _dataset(frames, "time_s", Frames.columns()["time_s"]).shape[0]
    first = int(attribute(frames.group, "first_frame"))
    begins = dict.fromkeys(INDEXED_AXES[kind.NAME], 0)
    for start in range(0, max(1, n_frames), block_rows):
        stop = min(start + block_rows, n_frames)
        rows: dict[tuple[str, str], slice] = {
            (name, "frame"): slice(start, stop) for name in CONTAINERS
        }
        for name, axis in begins:
            own = _group(file, paths[name], CONTAINERS[name])
            begin = begins[name, axis]
            column = _dataset(own, "frame", CONTAINERS[name].columns()["frame"])
            last = stop == n_frames
            end = column.shape[0] if last else bisect_left(column, first + stop, lo=begin)
            _check_order(column[begin:end], first + start, first + stop, column.name)
            begins[name, axis] = end
            rows[name, axis] = slice(begin, end)
        if ("peaks", "peak") in rows:  # families hold a column of their peaks
            rows["families", "peak"] = rows["peaks", "peak"]
        yield _numbered(_read(file, path, kind, rows), first + start)


def _part_paths(file: h5py.File, path: str, kind: type[Container]) -> dict[str, str]:
    """Return the groups of a container and its parts, by name."""
    found = {kind.NAME: path}
    group = _group(file, path, kind).group
    for name, part in part_classes(kind).items():
        if name not in _absent(group):
            found |= _part_paths(file, str(attribute(group, name)), part)
    return found


def _check_order(frame: object, first: int, stop: int, name: str) -> None:
    rows = np.asarray(frame)
    if rows.size and (rows[0] < first or rows[-1] >= stop or np.any(np.diff(rows) < 0)):
        raise DataError(f"{name} is not in the order of the frames")


def _numbered(block: C, first_frame: int) -> C:
    """Return a block whose frames know the index of their first row."""
    changes: dict[str, object] = {}
    for name in part_classes(type(block)):
        part = getattr(block, name)
        if isinstance(part, Frames):
            changes[name] = replace(part, first_frame=first_frame)
        elif part is not None:
            changes[name] = _numbered(part, first_frame)
    return replace(block, **changes)
