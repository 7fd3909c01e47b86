"""Whether a path names a file that can be read, and the digest of its bytes."""

import difflib
import hashlib
import os
import stat
from pathlib import Path

from uwtrack_cli.errors import DataError, MissingError
from uwtrack_cli.files.input_ledger import as_input

STANDARD_INPUT = Path("-")
"""How standard input is named."""


def is_pipe(path: Path) -> bool:
    """Tell whether a path is standard input, a named pipe or a device: read once."""
    if path == STANDARD_INPUT:
        return True
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


def _nearest(path: Path) -> str:
    """Return which file of the folder may be meant, as a sentence; else nothing."""
    try:
        names = [entry.name for entry in os.scandir(path.parent) if entry.is_file()]
    except OSError:
        return ""
    same = [name for name in names if Path(name).stem == path.name]
    near = same or difflib.get_close_matches(path.name, names, 1, cutoff=0.8)
    return f" Did you mean {path.with_name(near[0])}?" if near else ""


def check_readable(path: Path) -> None:
    """Refuse a path that is no readable regular file.

    Raises
    ------
    DataError
        The file is a folder, a device or empty; a `MissingError` if it is missing or
        not readable.
    """
    try:
        if not path.exists():
            raise MissingError(f"{path} does not exist.{_nearest(path)}")
        if path.is_dir():
            raise DataError(f"{path} is a folder, not a file.")
        if not path.is_file():
            raise DataError(f"{path} is a device or a pipe, not a regular file.")
        with as_input(path).open("rb") as handle:
            if not handle.read(1):
                raise DataError(f"{path} is empty.")
    except OSError as error:
        raise MissingError(f"cannot read {path}: {error.strerror or error}.") from error


def file_digest(path: Path) -> str:
    """Return the SHA-256 digest of the bytes of a file, read block by block.

    Raises
    ------
    DataError
        The file cannot be read.
    """
    try:
        with as_input(path).open("rb") as handle:
            return hashlib.file_digest(handle, "sha256").hexdigest()
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}.") from error
