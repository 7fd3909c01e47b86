"""Work on untrusted files in a process of its own, with limits on time and memory.

**Method.** A library that meets a forged file may crash, never return or claim all
memory, and no check beforehand can exclude that. The work is therefore done in a
child process with limits on memory and on processor time; what it returns comes back
as JSON. If it dies, only the child is lost. (Time by the clock is limited loosely,
since a machine may be busy with other things.) Where the system can fork (Linux), the child costs
milliseconds; elsewhere it is a new interpreter.
"""

import contextlib
import importlib
import json
import math
import os
import select
import signal
import subprocess
import sys
import time
import warnings
from typing import Any, NoReturn

from uwtrack_cli.errors import DataError, UwtrackError

CAN_FORK = sys.platform == "linux"
MEMORY_BYTES = 1 << 29
"""What the child may claim beyond what this process has already."""

CLOCK = 10.0
"""How much longer than its processor time the child may take by the clock."""

_TIME_SIGNALS = (signal.SIGXCPU, signal.SIGALRM) if hasattr(signal, "SIGXCPU") else ()
"""What ends a child that took too long; there are none on Windows."""

TOO_LONG = json.dumps(["refused", "reading it takes too long"]).encode()


def run_limited(function: str, *arguments: str, seconds: float) -> Any:
    """Return what a function returns, run in a child process with limits.

    ``function``: its module and name, ``package.module:name``; it takes the arguments,
    and returns what JSON can hold. ``seconds``: processor time that the
    child may take.

    Raises
    ------
    DataError
        The function raised one, or the child died, or it took too long or too much
        memory.
    """
    run = _forked if CAN_FORK else _spawned
    answer = run(function, arguments, seconds)
    try:
        kind, value = json.loads(answer)
    except ValueError:
        kind, value = "refused", "reading it ends the process that reads it"
    if kind == "refused":
        raise DataError(value)
    return value


def _answer(function: str, arguments: tuple[str, ...], seconds: float) -> bytes:
    """Run the function within the limits, and return its answer."""
    _limit(seconds)
    module, name = function.split(":")
    kind, value = "refused", "reading it takes too much memory"
    try:
        found = getattr(importlib.import_module(module), name)(*arguments)
        kind, value = "done", found
    except UwtrackError as error:
        value = str(error)
    except (MemoryError, RecursionError):
        pass
    except Exception as error:  # noqa: BLE001 - whatever a library makes of it
        value = f"reading it fails ({type(error).__name__})"
    return json.dumps([kind, value]).encode()


def _limit(seconds: float) -> None:
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        used = int(time.process_time()) + 1
        most = used + math.ceil(seconds)
        resource.setrlimit(resource.RLIMIT_CPU, (most, most + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pages = int(open("/proc/self/statm").read().split()[0])  # noqa: PTH123, SIM115
        limit = pages * os.sysconf("SC_PAGE_SIZE") + MEMORY_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _forked(function: str, arguments: tuple[str, ...], seconds: float) -> bytes:
    receive, send = os.pipe()
    with warnings.catch_warnings():  # other threads do not matter: the child uses none
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        _be_the_child(send, function, arguments, seconds)
    os.close(send)
    try:
        answer = _received(receive, time.monotonic() + CLOCK * seconds)
    except TimeoutError:
        answer = TOO_LONG
    finally:
        os.close(receive)
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    # Parent and child watch the same clock: on a busy machine either may see it first.
    is_late = os.WIFSIGNALED(status) and os.WTERMSIG(status) in _TIME_SIGNALS
    return TOO_LONG if is_late else answer


def _be_the_child(send: int, function: str, arguments: tuple[str, ...], seconds: float) -> NoReturn:
    """Answer and end, without ever returning into what the parent was doing."""
    try:
        for number in (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT,
                       signal.SIGTERM, signal.SIGALRM):  # fmt: skip
            signal.signal(number, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, CLOCK * seconds)  # parent may be killed
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        answer = _answer(function, arguments, seconds)
        while answer:
            answer = answer[os.write(send, answer) :]
    finally:
        os._exit(0)


def _received(receive: int, until: float) -> bytes:
    parts: list[bytes] = []
    while True:
        ready, _, _ = select.select([receive], [], [], max(0.0, until - time.monotonic()))
        if not ready:
            raise TimeoutError
        part = os.read(receive, 1 << 16)
        if not part:
            return b"".join(parts)
        parts.append(part)


def _spawned(function: str, arguments: tuple[str, ...], seconds: float) -> bytes:
    try:
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-m", __name__, function, str(seconds), *arguments],
            stdin=subprocess.DEVNULL, capture_output=True, timeout=CLOCK * seconds, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return TOO_LONG
    is_late = -done.returncode in _TIME_SIGNALS
    return TOO_LONG if is_late else done.stdout


if __name__ == "__main__":
    sys.stdout.buffer.write(_answer(sys.argv[1], tuple(sys.argv[3:]), float(sys.argv[2])))
