"""Writing a product: whole containers, or blocks of a stream, into one new file."""

import contextlib
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import h5py

from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import OutputError, UwtrackError
from uwtrack_cli.files.atomic import atomic_target
from uwtrack_cli.files.guarded import GuardedFile
from uwtrack_cli.files.history import HistoryStep
from uwtrack_cli.files.seal import append_seal, sealed
from uwtrack_cli.files.store import LIBVER, ProductStore


class ProductWriter:
    """Write a product block by block: `with ProductWriter(path) as writer`.

    The file appears under its name when the block is left without an error, and
    not at all otherwise.

    Parameters
    ----------
    path
        Where the product shall appear.
    history
        What was done, the last step included.
    overwrite
        Whether an existing file may be replaced.
    inputs
        Files being read: none of them may be the target.
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
            file = stack.enter_context(GuardedFile(temporary, "r+"))
            stack.enter_context(self._sealing(file))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Seal and place the file, or remove it after an error."""
        self._stack.__exit__(kind, error, trace)

    @property
    def store(self) -> ProductStore:
        """The open file."""
        if self._store is None:
            msg = "a ProductWriter is used in a with-statement."
            raise TypeError(msg)
        return self._store

    def append(self, block: Container) -> None:
        """Add a block of a stream: rows are added along every axis that grows."""
        with self._writing():
            self.store.append(block)

    def write(self, container: Container) -> None:
        """Write a whole container."""
        with self._writing():
            self.store.write(container)

    @contextlib.contextmanager
    def _sealing(self, file: GuardedFile) -> Iterator[None]:
        """Keep the HDF5 file open; seal it in the end, or just close it."""
        self._file = file
        with self._writing():
            store = ProductStore(h5py.File(file, "w", libver=LIBVER))
        self._store = store
        try:
            yield
            with self._writing():
                store.seal(self.history)
                store.file.close()
                append_seal(file)
        except BaseException:
            with contextlib.suppress(OSError, RuntimeError, ValueError):
                store.file.close()
            raise

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn a failed write into an error of ours, whoever noticed it."""
        noticed: Exception | None = None
        try:
            yield
        except UwtrackError:
            raise
        except (OSError, RuntimeError) as error:
            noticed = error
        failure = self._file.failure or noticed
        if failure is not None:
            reason = getattr(failure, "strerror", None) or failure
            msg = f"cannot write {self.path}: {reason}."
            raise OutputError(msg) from failure


def write_product(
    path: Path | str,
    containers: Sequence[Container],
    *,
    history: Sequence[HistoryStep] = (),
    overwrite: bool = False,
    inputs: Sequence[Path] = (),
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
        path, history=history, overwrite=overwrite, inputs=inputs
    ) as writer:
        for container in containers:
            writer.write(container)


def product_to_bytes(
    containers: Sequence[Container], *, history: Sequence[HistoryStep] = ()
) -> bytes:
    """Return a product as bytes, for a pipe: HDF5 cannot be written to one."""
    memory = io.BytesIO()
    with h5py.File(memory, "w", libver=LIBVER) as file:
        store = ProductStore(file)
        for container in containers:
            store.write(container)
        store.seal(history)
    return sealed(memory.getvalue())
