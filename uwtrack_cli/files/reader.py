"""Reading a product: lazily, container by container or in blocks of frames."""

import io
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import h5py

from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import attribute, reading
from uwtrack_cli.files.history import HistoryStep
from uwtrack_cli.files.opening import open_file
from uwtrack_cli.files.reading import C, read_whole
from uwtrack_cli.files.registry import CONTAINERS
from uwtrack_cli.files.streaming import stream_group


class Product:
    """A product file, open for reading; containers are read when asked for.

    ::

        /                        format, schema_version, program_version,
        |                        created_utc, complete, sha256
        +- history (step)        one JSON object per stage that was run
        +- encounters/           containers of the whole file
        |  +- time_s (encounter) units, long_name; fletcher32
        |  +- encounter          the axis: a dimension without values
        +- h1/                   sensor = "h1"
           +- sensor/            container, absent, and every scalar by its name
           +- frames/            stored once, named by the attribute ``frames`` of
           +- spectrogram/       ... every container that it belongs to
           +- peaks/
           +- lines/
              +- frames/         only where a container's part differs from the
                                 one that its sensor's other containers have
    """

    def __init__(self, file: h5py.File, name: str) -> None:
        self.file = file
        self.name = name
        with reading(name):
            self.paths = _container_paths(file)
            self.digest = str(attribute(file, "sha256"))
            self.created_utc = str(attribute(file, "created_utc"))
            self.program_version = str(attribute(file, "program_version"))
            self.schema_version = int(attribute(file, "schema_version"))
            self.history = _history(file)

    def __enter__(self) -> Self:
        """Return the product itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file."""
        self.file.close()

    def containers(self) -> dict[str | None, list[str]]:
        """Return the names of the containers per sensor (None: the whole file)."""
        found: dict[str | None, list[str]] = {}
        for sensor, name in self.paths:
            found.setdefault(sensor, []).append(name)
        order = list(CONTAINERS)
        return {key: sorted(names, key=order.index) for key, names in found.items()}

    def read(self, kind: type[C], sensor: str | None = None) -> C:
        """Read a container.

        Parameters
        ----------
        kind
            Its class, such as `Lines`.
        sensor
            Its sensor; not needed where only one has such a container.

        Raises
        ------
        DataError
            There is none, or several and no sensor is named, or it is damaged.
        """
        path = self._path(kind, sensor)
        with reading(self.name):
            return read_whole(self.file, path, kind)

    def read_all(self, kind: type[C]) -> list[C]:
        """Read the containers of a kind of all sensors."""
        return [
            self.read(kind, sensor) for sensor, name in self.paths if name == kind.NAME
        ]

    def stream(
        self, kind: type[C], sensor: str | None = None, block_rows: int = 256
    ) -> Iterator[C]:
        """Read a container in blocks of frames.

        Parameters
        ----------
        kind
            Its class: `Spectrogram`, `Levels`, `Peaks` or `Families`.
        sensor
            Its sensor; not needed where only one has such a container.
        block_rows
            Frames in a block.
        """
        return self._stream(kind, self._path(kind, sensor), block_rows)

    def _stream(self, kind: type[C], path: str, block_rows: int) -> Iterator[C]:
        with reading(self.name):
            yield from stream_group(self.file, path, kind, block_rows)

    def _path(self, kind: type[Container], sensor: str | None) -> str:
        found = {
            own: path
            for (own, name), path in self.paths.items()
            if name == kind.NAME and sensor in (None, own)
        }
        if len(found) == 1:
            return next(iter(found.values()))
        if found:
            sensors = ", ".join(sorted(map(repr, found)))
            msg = f"{self.name} holds {kind.NAME} of several sensors: {sensors}."
            raise DataError(msg)
        of = "" if sensor is None else f" of sensor {sensor!r}"
        held = ", ".join(sorted({name for _, name in self.paths})) or "nothing"
        msg = f"{self.name} holds no {kind.NAME}{of}; it holds: {held}."
        raise DataError(msg)


def read_product(path: Path | str) -> Product:
    """Open a product file for reading.

    Raises
    ------
    DataError
        The file is missing, no HDF5, damaged, foreign, incomplete or too new.
    """
    path = Path(path)
    return _opened(open_file(path, str(path)), str(path))


def read_product_bytes(data: bytes, name: str = "standard input") -> Product:
    """Open a product that was read from a pipe.

    Raises
    ------
    DataError
        The bytes are no product, or a damaged, incomplete or too new one.
    """
    if not data:
        msg = f"{name} is empty."
        raise DataError(msg)
    return _opened(open_file(io.BytesIO(data), name), name)


def _opened(file: h5py.File, name: str) -> Product:
    try:
        return Product(file, name)
    except BaseException:
        file.close()
        raise


def _container_paths(file: h5py.File) -> dict[tuple[str | None, str], str]:
    found: dict[tuple[str | None, str], str] = {}
    for group in _groups(file):
        if "container" in group.attrs:
            found[None, str(attribute(group, "container"))] = group.name
            continue
        sensor = str(attribute(group, "sensor"))
        for inner in _groups(group):
            found[sensor, str(attribute(inner, "container"))] = inner.name
    known = {key: path for key, path in found.items() if key[1] in CONTAINERS}
    return dict(sorted(known.items(), key=lambda row: (row[0][0] or "", row[0][1])))


def _groups(group: h5py.Group) -> list[h5py.Group]:
    return [item for item in group.values() if isinstance(item, h5py.Group)]


def _history(file: h5py.File) -> list[HistoryStep]:
    steps = file["history"]
    if (
        not isinstance(steps, h5py.Dataset)
        or steps.ndim != 1
        or steps.dtype.kind != "S"
    ):
        msg = "/history is no list of texts"
        raise DataError(msg)
    return [HistoryStep.from_json(step.decode()) for step in steps[:]]
