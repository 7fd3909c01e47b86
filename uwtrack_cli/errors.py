"""What can go wrong, one class per kind of mistake.

Each class is also the builtin that a Python user would expect to catch. The
command line turns the two branches into exit codes: data errors end with 1 and
usage errors with 2.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager


class UwtrackError(Exception):
    """Base of everything that uwtrack raises on purpose."""


class DataError(UwtrackError, ValueError):
    """An input is missing, damaged, of the wrong kind or contradicts itself."""


class MissingError(DataError):
    """An input is not there, or cannot be read now: trying again later may help."""


class OutputError(UwtrackError, OSError):
    """A result cannot be written: it exists already, or the target refuses."""


class OptionError(UwtrackError, ValueError):
    """An option has a value that the program does not accept."""


class UwtrackWarning(UserWarning):
    """Something was repaired or assumed; the message says what to do about it."""


class UwtrackNote(UwtrackWarning):
    """Something does not follow from the input; the result says so in its place."""


def warn(text: str) -> None:
    """Warn the caller of a function of something that it repaired or assumed."""
    warnings.warn(text, UwtrackWarning, stacklevel=3)


def note(text: str) -> None:
    """Tell the caller of a function what does not follow; the result has it, too."""
    warnings.warn(text, UwtrackNote, stacklevel=3)


@contextmanager
def needing(what: str, extra: str, kind: type[UwtrackError] = DataError) -> Iterator[None]:
    """Say how a library that is asked for within is installed.

    ``what``: who needs which library. ``extra``: the extra of the package that has it.

    Raises
    ------
    UwtrackError
        It is not installed: ``kind``.
    """
    try:
        yield
    except ImportError as error:
        msg = f"{what} ({error}); pip install 'uwtrack[{extra}]'."
        raise kind(msg) from error
