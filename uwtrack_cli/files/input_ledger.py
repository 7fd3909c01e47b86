"""The files that a command reads: none of them is ever replaced by an output.

**Method.** Whatever opens a file for reading passes its path through `as_input`,
which notes the file by device and inode and by its real path. `refuse_input` is asked
before work begins and once more before an output is put in place, so that a file
counts by whatever name it is reached, and a file that is read late counts, too.

**Conventions.** Notes are kept inside `input_ledger` only, so that a program that
uses the library may replace what it has read. What a command only looks at to decide
whether to make it again is read inside `not_an_input`.
"""

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO, TypeVar

from uwtrack_cli.errors import OutputError

P = TypeVar("P", Path, io.BytesIO, Path | io.BytesIO)
Identity = tuple[int, int] | str
"""Device and inode of a file, or its real path."""

_ledger: ContextVar[set[Identity] | None] = ContextVar("input_ledger", default=None)


@contextlib.contextmanager
def input_ledger() -> Iterator[None]:
    """Protect from here on whatever is read; a ledger inside another one joins it."""
    if _ledger.get() is not None:
        yield
        return
    token = _ledger.set(set())
    try:
        yield
    finally:
        _ledger.reset(token)


@contextlib.contextmanager
def not_an_input() -> Iterator[None]:
    """Read without protecting: a product that is looked at and may be made again."""
    token = _ledger.set(None)
    try:
        yield
    finally:
        _ledger.reset(token)


def as_input(source: P) -> P:
    """Note a file that is about to be read, and return it.

    ``source``: the file; what lies in memory needs no protection.
    """
    noted = _ledger.get()
    if noted is not None and isinstance(source, Path):
        noted.update(_identities(source))
    return source


def standard_input() -> BinaryIO | None:
    """Return standard input, None without one; a file redirected to it is noted."""
    if sys.stdin is None or sys.stdin.closed:
        return None
    noted = _ledger.get()
    if noted is not None:
        with contextlib.suppress(OSError, ValueError):  # a stream without a file
            status = os.fstat(sys.stdin.fileno())
            noted.add((status.st_dev, status.st_ino))
    return sys.stdin.buffer


def read_standard_input() -> bytes:
    """Return all that standard input holds."""
    stream = standard_input()
    return b"" if stream is None else stream.read()


def refuse_input(target: Path) -> None:
    """Refuse an output that would replace a file that was read.

    Raises
    ------
    OutputError
        The target is an input of this command.
    """
    noted = _ledger.get()
    if noted and not noted.isdisjoint(_identities(target)):
        raise OutputError(refusal(target))


def refusal(target: Path) -> str:
    """Say that an input is not overwritten."""
    return (
        f"{target} is read by this command and is not overwritten; name another file with --output."
    )


def _identities(path: Path) -> Iterator[Identity]:
    with contextlib.suppress(OSError, ValueError):
        status = path.stat()
        if status.st_ino:  # some network file systems have no such number
            yield status.st_dev, status.st_ino
    with contextlib.suppress(OSError, ValueError, RuntimeError):
        yield os.path.normcase(os.path.realpath(path))
