"""Files that appear whole or not at all.

**Method.** The result is written to a file without a name in the folder of its
target (Linux; elsewhere to a hidden one beside it), synced, and put in place by one
link, or one rename where a file is replaced. Whatever goes wrong before that, the
target keeps what it had; a killed program leaves nothing at all. A file that the
command reads is never replaced (see `input_ledger`).
"""

import contextlib
import os
import secrets
from collections.abc import Iterator, Sequence
from pathlib import Path

from uwtrack_cli.errors import OutputError
from uwtrack_cli.files.input_ledger import refusal, refuse_input

NAMELESS = Path("/proc/self/fd")
"""Where Linux shows open files, those without a name included."""


@contextlib.contextmanager
def atomic_target(
    path: Path, *, overwrite: bool = False, inputs: Sequence[Path] = ()
) -> Iterator[Path]:
    """Give a temporary path to write to; put it in place when all went well.

    Raises
    ------
    OutputError
        The target exists, is an input, or cannot be written.
    """
    target = check_target(path, overwrite=overwrite, inputs=inputs)
    temporary: Path | None = None
    try:
        handle, temporary = _scratch(target)
        try:
            yield temporary
            os.fsync(handle)
            _put(temporary, target, overwrite=overwrite)
        finally:
            os.close(handle)
            if temporary.parent != NAMELESS:
                temporary.unlink(missing_ok=True)
    except OSError as error:
        is_ours = temporary is None or error.filename in {None, str(temporary)}
        if isinstance(error, OutputError) or not is_ours:
            raise
        raise OutputError(f"cannot write {path}: {error.strerror or error}.") from error


def write_text(
    path: Path, text: str, *, overwrite: bool = False, inputs: Sequence[Path] = ()
) -> None:
    """Write a file of text, whole or not at all, as `atomic_target` does."""
    with atomic_target(path, overwrite=overwrite, inputs=inputs) as temporary:
        temporary.write_text(text, encoding="utf-8")


def check_target(path: Path, *, overwrite: bool, inputs: Sequence[Path] = ()) -> Path:
    """Return the real path of a target that may be written, before work begins.

    Raises
    ------
    OutputError
        The target exists, is an input, or its folder cannot take it.
    """
    path = Path(path)
    try:
        target = path.resolve()
        _check_folder(path, target.parent)
        _check_existing(path, target, overwrite=overwrite, inputs=inputs)
    except (OSError, RuntimeError, ValueError) as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(
            f"cannot write {path}: {getattr(error, 'strerror', None) or error}."
        ) from error
    return target


def _check_folder(path: Path, folder: Path) -> None:
    if not folder.exists():
        raise OutputError(
            f"cannot write {path}: the folder {folder} does not exist; make it first."
        )
    if not folder.is_dir():
        raise OutputError(f"cannot write {path}: {folder} is a file, not a folder.")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"cannot write {path}: no permission to write in {folder}.")


def _check_existing(path: Path, target: Path, *, overwrite: bool, inputs: Sequence[Path]) -> None:
    if not target.exists():
        return
    if target.is_dir():
        raise OutputError(f"cannot write {path}: it is a folder; name a file in it with -o.")
    refuse_input(path)
    for source in inputs:
        if Path(source).exists() and target.samefile(source):
            raise OutputError(refusal(path))
    if not target.is_file():
        raise OutputError(f"cannot write {path}: it is a device or a pipe, not a regular file.")
    if not overwrite:
        raise OutputError(f"{path} exists already; give --overwrite to replace it.")


def _hidden(target: Path) -> Path:
    return target.with_name(f".{target.name[:200]}.{secrets.token_hex(4)}.part")


def _scratch(target: Path) -> tuple[int, Path]:
    """Open a file to write to, without a name where the system has such files."""
    if hasattr(os, "O_TMPFILE") and NAMELESS.is_dir():
        with contextlib.suppress(OSError):  # a file system that lacks them
            handle = os.open(target.parent, os.O_TMPFILE | os.O_RDWR, 0o666)
            return handle, NAMELESS / str(handle)
    path = _hidden(target)
    return os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666), path


def _put(temporary: Path, target: Path, *, overwrite: bool) -> None:
    refuse_input(target)  # it may have been read after it was checked
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        if not overwrite:
            _link(temporary, target, folder)
        elif temporary.parent == NAMELESS:
            named = _hidden(target)
            _link(temporary, named, folder)
            named.replace(target)
        else:
            temporary.replace(target)
        with contextlib.suppress(OSError):  # some file systems cannot sync a folder
            os.fsync(folder)
    finally:
        os.close(folder)


def _link(temporary: Path, target: Path, folder: int) -> None:
    try:
        os.link(temporary, target.name, dst_dir_fd=folder, follow_symlinks=True)
    except FileExistsError as error:
        raise OutputError(
            f"{target} appeared meanwhile; give --overwrite to replace it."
        ) from error
    except OSError:
        if temporary.parent == NAMELESS:
            raise
        temporary.replace(target)  # a file system without links
