"""What the user sees: words on standard error, data on standard output."""

import _thread
import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from uwtrack_cli.errors import DataError, OptionError, OutputError, UwtrackWarning

DONE, FAILED, USAGE, SOME_FAILED, OUTSIDE, INTERRUPTED = 0, 1, 2, 3, 4, 130
"""Exit codes of the program."""

_verbosity = 0


def set_verbosity(level: int) -> None:
    """Choose how much is said: -1 errors only, 0 results, 1 details."""
    global _verbosity  # noqa: PLW0603 - the one setting of the process's screen
    _verbosity = level


def say(text: str, level: int = 0) -> None:
    """Write a line to standard error unless the user asked for less."""
    if _verbosity >= level:
        print(_printable(text), file=sys.stderr)


def put(lines: Iterable[str]) -> None:
    """Write lines of data to standard output."""
    for line in lines:
        print(_printable(line))


def _printable(text: str) -> str:
    """Write out what is no text: a name in a damaged file may hold any bytes."""
    return text.encode("utf-8", "backslashreplace").decode()


def show_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Draw a table for people on standard error."""
    if _verbosity < 0:
        return
    table = Table(box=None, pad_edge=False)
    for head in heads:
        table.add_column(head, justify="right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    console = Console(stderr=True)
    if not console.is_terminal:
        console = Console(stderr=True, width=160)
    console.print(table)


@contextmanager
def progress_bar(title: str, total_s: float) -> Iterator[Callable[[float], None]]:
    """Show how far a run is, on a terminal and after two seconds only."""
    import time

    console = Console(stderr=True)
    quiet = _verbosity < 0 or not console.is_terminal
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), "{task.percentage:3.0f} %",
        TimeRemainingColumn(), console=console, transient=True, disable=quiet,
    )  # fmt: skip
    task = bar.add_task(title, total=total_s)
    begin, started = time.monotonic(), False

    def update(done_s: float) -> None:
        nonlocal started
        if not started and time.monotonic() - begin > 2.0:
            bar.start()
            started = True
        bar.update(task, completed=done_s)

    try:
        yield update
    finally:
        if started:
            bar.stop()


@contextmanager
def guard(*, debug: bool) -> Iterator[None]:
    """Turn errors into one sentence and an exit code; a closed pipe ends quietly."""
    with warnings.catch_warnings(), _interrupts_kept():
        warnings.showwarning = _show_warning
        warnings.simplefilter("always", UwtrackWarning)
        try:
            yield
            sys.stdout.flush()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(DONE) from None
        except KeyboardInterrupt:
            say("interrupted", -1)
            raise typer.Exit(INTERRUPTED) from None
        except (OptionError, DataError, OutputError, OSError, MemoryError) as error:
            if debug:
                raise
            say(f"error: {_sentence(error)}", -1)
            code = USAGE if isinstance(error, OptionError) else FAILED
            raise typer.Exit(code) from None
        except Exception as error:
            if debug or isinstance(error, typer.Exit):
                raise
            kind = type(error).__name__
            say(f"error: the program failed ({kind}: {error}); see --debug.", -1)
            raise typer.Exit(FAILED) from None


@contextmanager
def _interrupts_kept() -> Iterator[None]:
    """Raise an interrupt again that came while Python could not pass it on.

    In the middle of a weak reference's callback it would be printed and lost.
    """
    before = sys.unraisablehook

    def hook(lost: Any) -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt):
            # from another thread: here it would be lost again
            threading.Timer(0.05, _thread.interrupt_main).start()
        else:
            before(lost)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


def _sentence(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "there is not enough memory for this."
    if isinstance(error, OSError) and not isinstance(error, OutputError):
        name = f"{error.filename}: " if error.filename else ""
        return f"{name}{error.strerror or error}."
    return str(error)


def _show_warning(
    message: Warning | str, category: type[Warning], *_: object, **__: object
) -> None:
    if issubclass(category, UwtrackWarning):
        say(f"warning: {message}")
