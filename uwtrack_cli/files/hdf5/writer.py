"""Writing a product: whole containers, or blocks of a stream, into one new file.

**Method.** A temporary file is written, gets the line with its checksum, is synced and
renamed (see `atomic`). Every container has an `AppendableGroup`, which takes blocks.

Parts that several containers have in common are stored once. While the file is being
written, every container keeps its parts in its own group. At the end each part moves
to its sensor's group, unless another one of its kind is there: then it is dropped if
the two are the same, and otherwise stays with its owner. Of two `Frames` with one time
base that one is kept which knows the noise, since peaks are sought after the
spectrogram has been written.

What a run reads back of a day is mostly not looked at: noise that only pictures show,
covariances that no fit takes, levels hours away from a passage. Long columns of it are
written into a file without a name, in the folder for temporary files, and mapped: the
system reads the pages that are asked for, and may drop them again.

The HDF5 library writes through a Python file (`FailSafeFile`). A handler
that raises in the midst of such a call leaves the library with half an operation, a
file that it never closes, and an error that is reported when the interpreter is taken
down. So the handlers are replaced by one that takes a note, and what was noted is
raised again afterwards. A write takes a moment, and so does the wait.
"""

import contextlib
import io
import signal
import tempfile
import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from uwtrack_cli import __version__
from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError, OutputError, UwtrackError
from uwtrack_cli.files.atomic import atomic_target
from uwtrack_cli.files.hdf5.appendable_group import AppendableGroup, make_scale, set_text
from uwtrack_cli.files.hdf5.checksum import append_checksum
from uwtrack_cli.files.hdf5.examination import examined
from uwtrack_cli.files.hdf5.history import HistoryStep
from uwtrack_cli.files.hdf5.layout import (
    CHUNK_BYTES,
    FORMAT,
    SCHEMA_VERSION,
    encode,
    group_path,
    sensor_of,
)
from uwtrack_cli.files.hdf5.reader import C, read_whole

LIBVER = ("v110", "v110")
"""HDF5 1.10 and later read the files: object headers carry checksums of their own."""

CACHE_BYTES = CHUNK_BYTES
"""Bytes of chunks that HDF5 holds of each column: the one that is being filled, for
rows are appended, and none is met again. By itself it holds 8 MB, a day of a column."""


LEAST_MAPPED_BYTES = 1 << 18
"""Columns that are read back stay in memory below this: hours of most columns do."""


class ProductStore:
    """The HDF5 file of a product that is not complete: takes containers, then ends."""

    def __init__(self, file: Any) -> None:
        self.file = h5py.File(file, "w", libver=LIBVER, rdcc_nbytes=CACHE_BYTES, rdcc_w0=1.0)
        self.file.attrs["schema_version"] = np.int64(SCHEMA_VERSION)
        self._tops: dict[str, AppendableGroup] = {}
        self._whole: set[str] = set()

    def append(self, block: Container, step: str = "") -> None:
        """Add the rows of a block to its container."""
        path = group_path(sensor_of(block), block.NAME, step)
        if path in self._whole:
            raise DataError(f"{path} is written already and takes no further blocks.")
        if path not in self._tops:
            self._tops[path] = AppendableGroup(self.file, path, block)
            if step:
                set_text(self._tops[path].group.parent, "step", step)
        self._tops[path].append(block)

    def write(self, container: Container, step: str = "") -> None:
        """Write a container that is complete."""
        sensor = sensor_of(container)
        path = group_path(sensor, container.NAME, step)
        if path in self._tops:
            where = "" if sensor is None else f" of sensor {sensor!r}"
            raise DataError(
                f"a file holds one container {container.NAME!r}{where}, got two; "
                f"give the sensors different ids, or write two files."
            )
        self.append(container, step)
        self._whole.add(path)

    def read_back(self, kind: type[C], step: str = "") -> C:
        """Finish a container that was appended, and read it as a product's reader does.

        What is long of it stays on disk.

        Raises
        ------
        DataError
            There is no such container, or there are several.
        """
        found = [
            path
            for path, top in self._tops.items()
            if top.kind is kind
            and path in {group_path(s, kind.NAME, step) for s in (None, top.sensor)}
        ]
        if len(found) != 1:
            raise DataError(f"{len(found)} containers {kind.NAME} were written, one is needed.")
        top = self._tops[found[0]]
        top.finish()
        for group in _all_groups([top]):
            group.name_parts()
        self._whole.add(found[0])
        return read_whole(self.file, found[0], kind, on_disk)

    def finish(self, history: Sequence[HistoryStep]) -> None:
        """Write what is left, and close the file."""
        for top in self._tops.values():
            top.finish()
        for group in self._store_parts_once():
            group.name_parts()
            owner = self.file["/" + group.path.split("/")[1]]
            if group.sensor is not None and "container" not in owner.attrs:
                set_text(owner, "sensor", group.sensor)
        steps = encode(np.array([step.to_json() for step in history], dtype=np.str_))
        dataset = self.file.create_dataset(
            "history", data=steps, maxshape=(None,), chunks=(max(1, steps.size),), fletcher32=True
        )
        set_text(dataset, "units", "1")
        set_text(dataset, "long_name", "What was done, one step per row, as JSON.")
        dataset.dims[0].attach_scale(make_scale(self.file, "step", steps.size))
        set_text(self.file, "format", FORMAT)
        set_text(self.file, "program_version", __version__)
        self.file.attrs["complete"] = np.int8(1)
        self.file.close()

    def _store_parts_once(self) -> list[AppendableGroup]:
        """Move parts to their sensors' groups, once each; return what there is then.

        Parts without parts come first, so that their owners can be compared.
        """
        shared = dict(self._tops)
        owned = [(g, n) for g in _all_groups(self._tops.values()) for n in g.parts]
        for owner, name in sorted(owned, key=lambda own: own[0].parts[own[1]].depth()):
            part = owner.parts[name]
            path = group_path(part.sensor, part.kind.NAME)
            other = shared.get(path)
            if other is None:
                self.file.move(part.path, path)
                shared[path] = part
            elif part.agrees(other):
                owner.parts[name] = other
                if part.n_known() > other.n_known():
                    del self.file[path]
                    self.file.move(part.path, path)
                    other.group, other.datasets = part.group, part.datasets
                else:
                    del self.file[part.path]
        return _all_groups(shared.values())


class ProductWriter:
    """Write a product block by block: `with ProductWriter(path) as writer`.

    The file appears under its name when the block is left without an error, and
    not at all otherwise.

    ``history``: what was done, the last step included.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        history: Sequence[HistoryStep] = (),
        overwrite: bool = False,
        inputs: Sequence[Path] = (),
    ) -> None:
        self.path = Path(path)
        self.history = list(history)
        self._target = atomic_target(self.path, overwrite=overwrite, inputs=inputs)
        self._store: ProductStore | None = None

    def __enter__(self) -> Self:
        """Open the temporary file."""
        with contextlib.ExitStack() as stack:
            temporary = stack.enter_context(self._target)
            file = stack.enter_context(FailSafeFile(temporary, "r+"))
            stack.enter_context(self._finishing(file))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish and place the file, or remove it after an error."""
        self._stack.__exit__(kind, error, trace)

    @property
    def store(self) -> ProductStore:
        """The open file."""
        if self._store is None:
            raise TypeError("a ProductWriter is used in a with-statement.")
        return self._store

    def append(self, block: Container, step: str = "") -> None:
        """Add the rows of a block of a stream."""
        with self._writing():
            self.store.append(block, step)

    def write(self, container: Container, step: str = "") -> None:
        """Write a whole container, under the name of a step if one is given."""
        with self._writing():
            self.store.write(container, step)

    def read_back(self, kind: type[C], step: str = "") -> C:
        """End a container that was appended in blocks, and return it whole."""
        with self._writing():
            return self.store.read_back(kind, step)

    @contextlib.contextmanager
    def _finishing(self, file: "FailSafeFile") -> Iterator[None]:
        """Keep the HDF5 file open; finish it in the end, or just close it.

        HDF5 must be done with the file before Python closes it, whatever happens: it
        would go on to write into it when the last reference to its half is gone.
        """
        self._file = file
        try:
            with self._writing():
                self._store = ProductStore(file)
            yield
            with self._writing():
                self.store.finish(self.history)
                sha256 = append_checksum(file)
            examined.add(sha256)
        except BaseException:
            with signals_held(), contextlib.suppress(OSError, RuntimeError, ValueError):
                if self._store is not None:
                    self._store.file.close()
            raise

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn a failed write into an error of ours, whoever noticed it.

        A signal waits: raised within HDF5 it would leave half an operation.
        """
        noticed: Exception | None = None
        try:
            with signals_held():
                yield
        except UwtrackError:
            raise
        except (OSError, RuntimeError) as error:
            noticed = error
        failure = self._file.failure or noticed
        if failure is not None:
            reason = getattr(failure, "strerror", None) or failure
            raise OutputError(f"cannot write {self.path}: {reason}.") from failure


class FailSafeFile(io.FileIO):
    """An unbuffered file whose failed writes are kept in ``failure``.

    The HDF5 library stops the whole program when a write fails and the file is then
    closed. So its writes go through here: the first failure is kept, everything after
    it is swallowed, HDF5 closes in peace, and the writer raises what was kept.
    """

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of the data, or keep the failure."""
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view) and self.failure is None:
            try:
                done += super().write(view[done:]) or 0
            except OSError as error:
                self.failure = error
        return len(view)

    def flush(self) -> None:
        """Do nothing: there is no buffer.

        HDF5 may ask for it when the interpreter has taken its own classes down.
        """

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file, or keep the failure."""
        if self.failure is None:
            try:
                return super().truncate(size)
            except OSError as error:
                self.failure = error
        return size or 0


def write_product(
    path: Path | str,
    containers: Sequence[Container],
    *,
    history: Sequence[HistoryStep] = (),
    overwrite: bool = False,
    inputs: Sequence[Path | str] = (),
) -> None:
    """Write containers into one new product file.

    Parameters
    ----------
    path
        Where the product shall appear.
    containers
        What it shall hold: at most one of a kind per sensor.
    history
        What was done, the last step included.
    overwrite
        Whether an existing file may be replaced.
    inputs
        Files that were read: none of them may be the target.

    Raises
    ------
    OutputError
        The target exists, is an input, or cannot be written.
    DataError
        Two containers of one kind and sensor.
    """
    with ProductWriter(
        path, history=history, overwrite=overwrite, inputs=[Path(i) for i in inputs]
    ) as writer:
        for container in containers:
            writer.write(container)


def _all_groups(groups: Iterable[AppendableGroup]) -> list[AppendableGroup]:
    """Return groups and those of all their parts, each once."""
    found: dict[str, AppendableGroup] = {}
    for group in groups:
        found[group.path] = group
        found |= {part.path: part for part in _all_groups(group.parts.values())}
    return list(found.values())


def on_disk(values: NDArray[Any]) -> NDArray[Any]:
    """Return a long array as a mapped file with the same values, a short one as it is.

    On a disk that is full it stays in memory, too.

    ``values``: an array of any shape.
    """
    if values.nbytes < LEAST_MAPPED_BYTES:
        return values
    try:
        with tempfile.TemporaryFile(prefix="uwtrack-") as file:
            file.write(np.ascontiguousarray(values).data)
            file.flush()
            mapped = np.memmap(file, values.dtype, "r", shape=values.shape)
    except OSError:
        return values
    return mapped.view(np.ndarray)


ENDING = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
"""Signals that end a program."""


@contextlib.contextmanager
def signals_held() -> Iterator[None]:
    """Meet no signal to end within the block, and every one that came after it.

    In a thread other than the main one, where signals are not met, nothing is done.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held = _Held()
    try:
        for number, handler in held.before.items():
            if callable(handler):  # the system's own do not raise
                signal.signal(number, held.meet)
        yield
    finally:
        held.release()


class _Held:
    """Signals that were held, and who meets them otherwise."""

    def __init__(self) -> None:
        self.before: dict[int, Any] = {n: signal.getsignal(n) for n in ENDING}
        self._noted: list[int] = []
        self._is_holding = True

    def meet(self, number: int, frame: FrameType | None) -> None:
        """Note a signal; pass it on when nothing is held any more.

        The latter is for a handler that an error has kept from being put back.
        """
        if self._is_holding:
            self._noted.append(number)
        else:
            self.before[number](number, frame)

    def release(self) -> None:
        """Put the handlers back, and raise again what came."""
        self._is_holding = False
        for number, handler in self.before.items():
            if callable(handler):
                signal.signal(number, handler)
        for number in self._noted:
            signal.raise_signal(number)
