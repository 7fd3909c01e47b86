"""Candidates whose fit or check fails: each is a refusal, and everything else is told.

**Method.** What a candidate needs is worked out by `attempted`. Whatever ends it (a matrix
without an inverse, a series that leaves nothing to solve) is noted with the contact and
its reason in the list of `failed_fits` about it, and there is no such candidate.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple, TypeVar

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.errors import UwtrackError
from uwtrack_cli.motion.decision import FIT_FAILED, Rejection, reject

Made = TypeVar("Made")


class FailedFit(NamedTuple):
    """A candidate that could not be worked out."""

    contact: int
    """Contact number, from 1."""
    from_s: float
    """Time of its first measurement, s."""
    to_s: float
    """Time of its last measurement, s."""
    reason: Rejection
    """What ended it."""


_NOTED: ContextVar[list[FailedFit]] = ContextVar("failed fits")


@contextmanager
def failed_fits() -> Iterator[list[FailedFit]]:
    """Give the list in which the failures within are noted."""
    token = _NOTED.set([])
    try:
        yield _NOTED.get()
    finally:
        _NOTED.reset(token)


def attempted(
    make: Callable[[], Made], contacts: tuple[int, ...], time_s: FloatArray
) -> Made | None:
    """Return what is made for some contacts; None, which is noted, if that fails.

    ``time_s`` are the times of their measurements. What is wrong with the input, the
    machine or the program's own warnings is not the candidate's, and is raised.
    """
    try:
        return make()
    except (UwtrackError, OSError, MemoryError, Warning):
        raise
    except Exception as error:  # noqa: BLE001 - a refusal, whatever happened
        reason = reject(FIT_FAILED, kind=type(error).__name__, error=error)
        first_s, last_s = (float(np.min(time_s)), float(np.max(time_s)))
        _NOTED.get([]).append(FailedFit(contacts[0], first_s, last_s, reason))
        return None
