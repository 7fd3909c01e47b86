"""Blocks of a long stream, kept on disk until they are wanted whole.

**Method.** Blocks are held in memory as long as they are few. Then they move to a
nameless file, as a product's do, and are read back in the end: what a stream leaves
behind takes no memory while the stream goes on, and no holes remain in it.
"""

import os
import tempfile
from types import TracebackType
from typing import Self

import h5py

from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import OutputError
from uwtrack_cli.files.guarded import GuardedFile
from uwtrack_cli.files.store import LIBVER, ProductStore

HELD_BYTES = 1 << 22
"""Blocks move to disk when they have come to so many bytes together."""


class Spill:
    """Takes blocks of several containers, and gives each container whole."""

    def __init__(self) -> None:
        self._held: list[Container] = []
        self._held_bytes = 0
        self._file: GuardedFile | None = None
        self._store: ProductStore | None = None

    def __enter__(self) -> Self:
        """Return the spill itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give up the file, if there is one."""
        if self._store is not None:
            self._store.file.close()
        if self._file is not None:
            self._file.close()

    def append(self, block: Container) -> None:
        """Take a block.

        Raises
        ------
        OutputError
            There is no room for it.
        """
        self._held.append(block)
        self._held_bytes += block.nbytes
        if self._held_bytes > HELD_BYTES:
            self._move(self._opened())

    def joined(self) -> list[Container]:
        """Join the blocks of each container, in the order of their first blocks.

        Raises
        ------
        OutputError
            There is no room for them.
        """
        if self._store is not None:
            self._move(self._store)
            try:
                return self._store.read_back()
            finally:  # what could not be written cannot be read back
                self._check()
        blocks: dict[type[Container], list[Container]] = {}
        for block in self._held:
            blocks.setdefault(type(block), []).append(block)
        self._held = []
        return [kind.join(blocks[kind]) for kind in blocks]

    def _opened(self) -> ProductStore:
        if self._store is None:
            try:
                handle, name = tempfile.mkstemp(prefix="uwtrack-")
                os.unlink(name)  # noqa: PTH108 - the file goes with its handle
            except OSError as error:
                raise OutputError(_no_room(error)) from error
            self._file = GuardedFile(handle, "r+")
            self._store = ProductStore(h5py.File(self._file, "w", libver=LIBVER))
        return self._store

    def _move(self, store: ProductStore) -> None:
        for block in self._held:
            store.append(block)
        self._held, self._held_bytes = [], 0
        store.flush()
        self._check()

    def _check(self) -> None:
        failure = None if self._file is None else self._file.failure
        if failure is not None:
            raise OutputError(_no_room(failure)) from failure


def _no_room(error: OSError) -> str:
    folder = tempfile.gettempdir()
    return (
        f"cannot keep a long recording's results in {folder}: "
        f"{error.strerror or error}; set TMPDIR to a folder with room."
    )
