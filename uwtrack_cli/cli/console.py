"""What the user sees: words on standard error, data on standard output."""

import _thread
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import typer

from uwtrack_cli.errors import DataError, OptionError, OutputError, UwtrackNote, UwtrackWarning
from uwtrack_cli.files.text_escaping import plain_text

if TYPE_CHECKING:  # slow to import, and most commands draw nothing
    from rich.console import Console
    from rich.progress import Progress

DONE, FAILED, USAGE, SOME_FAILED, OUTSIDE = 0, 1, 2, 3, 4
"""Exit codes of the program; ended by a signal it is 128 and the signal's number."""

MOST_WORDS = 2000
"""Characters of an error that are shown: it may quote an input of any length."""

ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Signals that end a command in the same order as an interrupt does."""


class EndedError(KeyboardInterrupt):
    """A signal came that asks the program to end."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


_verbosity = 0


def set_verbosity(level: int) -> None:
    """Choose how much is said: -1 errors only, 0 results, 1 details."""
    global _verbosity  # noqa: PLW0603 - the one setting of the process's screen
    _verbosity = level


def is_verbose() -> bool:
    """Tell whether the user asked for details."""
    return _verbosity > 0


def say(text: str, level: int = 0) -> None:
    """Write a line to standard error unless the user asked for less."""
    if _verbosity >= level:
        with suppress(OSError):  # the terminal is gone
            print(plain_text(text), file=sys.stderr)


def say_wrote(target: Path) -> None:
    """Say which file was written; what went to standard output is no file."""
    if str(target) != "-":
        say(f"wrote {target}")


def put(lines: Iterable[str]) -> None:
    """Write lines of data to standard output."""
    for line in lines:
        print(plain_text(line))


TABLE_COLUMNS = 80
"""Characters in a line of a table that goes to a file or another program.

``COLUMNS`` of the environment counts instead, where it is set.
"""


def show_table(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    is_data: bool = False,
    spare: Sequence[str] = (),
) -> list[str]:
    """Draw a table for people, with fewer columns where all of them do not fit.

    ``is_data``: whether the table is what was asked for, and goes to standard output;
    else it goes to standard error, beside data, and is left out by ``--quiet``.
    ``spare``: titles of the columns that are left out of a narrow table, the first one
    first.

    Returned: the titles of the columns that were left out.
    """
    if _verbosity < 0 and not is_data:
        return []
    from rich.table import Table

    console = _console(stderr=not is_data)
    width = console.width if console.is_terminal else screen_columns(TABLE_COLUMNS)
    kept = _fitting(heads, rows, spare, width)
    left_out = [head for k, head in enumerate(heads) if k not in kept]
    heads = [heads[k] for k in kept]
    rows = [[row[k] for k in kept] for row in rows]
    table = Table(box=None, pad_edge=False)
    for head in heads:
        table.add_column(head, justify="right", overflow="fold")
    for row in rows:
        table.add_row(*map(plain_text, row))
    if not console.is_terminal:  # what still does not fit is not broken there
        needed = console.measure(table, options=console.options.update(width=1 << 20))
        console = _console(stderr=not is_data, width=max(160, needed.maximum))
    console.print(table)
    return left_out


def screen_columns(usual: int) -> int:
    """Return how many characters fit a line: what the environment says, else as usual."""
    told = os.environ.get("COLUMNS", "")
    return int(told) if told.isdecimal() and int(told) > 0 else usual


def _fitting(
    heads: Sequence[str], rows: Sequence[Sequence[str]], spare: Sequence[str], width: int
) -> list[int]:
    """Return the numbers of the columns that fit, without the spare ones if need be."""
    cells = [[head, *(row[k] for row in rows)] for k, head in enumerate(heads)]
    widths = [max(len(plain_text(cell)) for cell in column) for column in cells]
    kept = list(range(len(heads)))
    for title in spare:
        if sum(widths[k] + 2 for k in kept) - 2 <= width:
            break
        kept = [k for k in kept if heads[k] != title]
    return kept


def _console(*, stderr: bool = True, width: int | None = None) -> "Console":
    """Return a console for text in which no mark is markup."""
    from rich.console import Console

    return Console(stderr=stderr, width=width, markup=False, emoji=False, highlight=False)


@contextmanager
def progress_bar(title: str, total: float, things: str = "") -> Iterator[Callable[..., None]]:
    """Show how much sound a run has worked on, on a terminal and after two seconds only.

    ``total``: sound to work on, s, or the number of ``things``, if these are named.
    """
    import time

    begin = time.monotonic()
    bars: list[Progress] = []

    def update(done_s: float, stage: str = "") -> None:
        if not bars and _verbosity >= 0 and time.monotonic() - begin > 2.0:
            bars.append(_started_bar(title, total, things))
        for bar in bars:
            bar.update(bar.task_ids[0], completed=done_s, stage=stage)

    try:
        yield update
    finally:
        for bar in bars:
            with suppress(OSError):  # the terminal is gone
                bar.stop()


def _started_bar(title: str, total: float, things: str) -> "Progress":
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
    from rich.text import Text

    class DoneAndTimeLeft(ProgressColumn):
        """How much is done, and how long the rest takes at the pace so far."""

        def render(self, task: Task) -> Text:
            elapsed_s = task.elapsed or 0.0
            return Text(progress_text(task.completed, total, elapsed_s, things))

    console = _console()
    bar = Progress(
        TextColumn("{task.description}", markup=False), BarColumn(bar_width=20),
        DoneAndTimeLeft(), TextColumn("{task.fields[stage]}", markup=False),
        console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip
    bar.add_task(plain_text(title), total=total, stage="")
    bar.start()
    return bar


def progress_text(done: float, total: float, elapsed_s: float, things: str = "") -> str:
    """Return how much is done, and how long the rest takes at the pace so far.

    ``done``, ``total``: seconds of sound, or numbers of ``things``.

    Examples
    --------
    >>> progress_text(1800.0, 7200.0, 60.0)
    '0:30:00 of 2:00:00, 0:03:00 left'
    >>> progress_text(3, 4, 60.0, "pages")
    '3 of 4 pages, 0:00:20 left'
    """
    if things:
        text = f"{done:.0f} of {total:.0f} {things}"
    else:
        read, whole = (timedelta(seconds=round(each)) for each in (done, total))
        text = f"{read} of {whole}"
    if not done > 0.0:
        return text
    left_s = elapsed_s * max(0.0, total - done) / done
    return f"{text}, {timedelta(seconds=round(left_s))} left"


@contextmanager
def guard(*, debug: bool) -> Iterator[None]:
    """Turn errors into one sentence and an exit code; a closed pipe ends quietly."""
    # signals that end a program are an interrupt, once; nohup has SIGHUP ignored
    ending = _signals_to(_end, ENDING, lambda own: own is signal.SIG_DFL)
    with warnings.catch_warnings(), _interrupts_kept(), ending:
        warnings.showwarning = _show_warning
        warnings.simplefilter("always", UwtrackWarning)
        try:
            yield
            sys.stdout.flush()
        except BrokenPipeError:
            _leave_output()
            raise typer.Exit(DONE) from None
        except KeyboardInterrupt as error:
            number = _number_of(error)
            say("interrupted" if number == signal.SIGINT else "terminated", -1)
            raise typer.Exit(128 + number) from None
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
def unread_too() -> Iterator[None]:
    """Go on where the reader of what is printed has gone: the exit code is the answer."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        _leave_output()


def _leave_output() -> None:
    """Drop what is still to be printed: its reader is gone."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _signals_to(
    meet: Callable[[int, FrameType | None], None],
    numbers: Sequence[int],
    is_replaced: Callable[[Any], bool],
) -> Iterator[None]:
    """Let a function meet signals whose handlers may be replaced, in the main thread."""
    is_main = threading.current_thread() is threading.main_thread()
    before = {number: signal.getsignal(number) for number in (numbers if is_main else ())}
    for number, handler in before.items():
        if is_replaced(handler):
            signal.signal(number, meet)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def signals_end(end: Callable[[], None]) -> Iterator[None]:
    """Let the first signal to end call a function; the next one ends the command.

    ``end``: ends what is waited for, so that the command goes on to its own end.
    """
    before = {number: signal.getsignal(number) for number in [signal.SIGINT, *ENDING]}

    def meet(number: int, _: FrameType | None) -> None:
        for other, handler in before.items():
            signal.signal(other, handler)
        say(f"{signal.Signals(number).name}: finishing what is open; once more to stop")
        end()

    with _signals_to(meet, list(before), lambda own: own is not signal.SIG_IGN):  # nohup
        yield


def _end(number: int, _: FrameType | None) -> None:
    for other in ENDING:  # what is under way then is not disturbed again
        signal.signal(other, signal.SIG_IGN)
    raise EndedError(number)


def _number_of(error: BaseException | None) -> int:
    """Return the number of the signal that an interrupt came from."""
    return error.number if isinstance(error, EndedError) else int(signal.SIGINT)


@contextmanager
def _interrupts_kept() -> Iterator[None]:
    """Raise an interrupt again that came while Python could not pass it on.

    In the middle of a weak reference's callback it would be printed and lost.
    """
    before = sys.unraisablehook

    def hook(lost: Any) -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt):
            # from another thread: here it would be lost again
            number = _number_of(lost.exc_value)
            if number in ENDING:
                signal.signal(number, _end)
            threading.Timer(0.05, _thread.interrupt_main, [number]).start()
        else:
            before(lost)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


def _sentence(error: BaseException) -> str:
    """Return what an error says; not more than a screen of it."""
    text = _words(error)
    if len(text) <= MOST_WORDS:
        return text
    half = MOST_WORDS // 2
    return f"{text[:half]} ... {text[-half:]}"


def _words(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "there is not enough memory for this."
    if isinstance(error, OSError) and not isinstance(error, OutputError):
        name = f"{error.filename}: " if error.filename else ""
        return f"{name}{error.strerror or error}."
    return str(error)


def _show_warning(
    message: Warning | str, category: type[Warning], *_: object, **__: object
) -> None:
    if issubclass(category, UwtrackNote):
        say(f"note: {message}", 1)
    elif issubclass(category, UwtrackWarning):
        say(f"warning: {message}")
