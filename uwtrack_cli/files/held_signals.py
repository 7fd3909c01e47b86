"""Signals that come while HDF5 writes are met when it is done.

**Method.** The HDF5 library writes through a Python file (`FailSafeFile`). A handler
that raises in the midst of such a call leaves the library with half an operation, a
file that it never closes, and an error that is reported when the interpreter is taken
down. So the handlers are replaced by one that takes a note, and what was noted is
raised again afterwards. A write takes a moment, and so does the wait.
"""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

ENDING = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)
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
