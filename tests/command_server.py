"""The program, imported once: scripts of the documents call `uwtrack` a hundred times.

Most of such a call was the start of Python and its imports. Here one process imports
everything, and forks for each call: a small program of the name `uwtrack` hands over
its words, folder, environment and open files, passes signals on, and ends with the same
exit code. Killed, it takes the process that answers with it.
"""

import atexit
import contextlib
import importlib
import io
import json
import os
import pkgutil
import resource
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import uwtrack_cli
from uwtrack_cli.cli.app import app

LATE = (
    "geographiclib.geodesic", "h5py", "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_pdf", "rich.progress", "scipy.fft", "scipy.optimize",
    "scipy.signal", "scipy.special", "scipy.stats", "soundfile", "typer.rich_utils",
)  # fmt: skip
"""What functions import in their bodies, since it is slow."""

STUB = """#!{python} -IS
import array, json, os, resource, signal, socket, struct, sys
server = socket.socket(socket.AF_UNIX)
server.connect({address!r})
limit = resource.getrlimit(resource.RLIMIT_FSIZE)
ignored = [n for n in {signals} if signal.getsignal(n) == signal.SIG_IGN]
call = [sys.argv[1:], os.getcwd(), dict(os.environ), limit, ignored]
call = json.dumps(call).encode()
files = array.array("i", [0, 1, 2])
server.sendmsg([struct.pack("q", len(call))], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, files)])
server.sendall(call)
(child,) = struct.unpack("i", server.recv(4))
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    if number not in ignored:
        signal.signal(number, lambda number, _: os.kill(child, number))
status = server.recv(4)
code = struct.unpack("i", status)[0] if status else 70
if code < 0:
    signal.signal(-code, signal.SIG_DFL)
    os.kill(os.getpid(), -code)
os._exit(code)
"""
"""The program that hands its call over; signals go on to the process that answers."""

PASSED_ON = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGXFSZ]
"""Signals that a program may have been started to ignore."""


@contextlib.contextmanager
def command_server(folder: Path) -> Iterator[Path]:
    """Serve calls of `uwtrack`; yield the folder with the program of that name."""
    address = str(folder / "calls")
    program = folder / "bin" / "uwtrack"
    program.parent.mkdir()
    signals = [int(number) for number in PASSED_ON]
    stub = STUB.format(python=sys.executable, address=address, signals=signals)
    program.write_text(stub)
    program.chmod(0o755)
    words = [sys.executable, "-m", "tests.command_server", address]
    root = Path(__file__).parent.parent
    with subprocess.Popen(words, cwd=root, stdout=subprocess.PIPE) as server:
        assert server.stdout is not None
        assert server.stdout.readline() == b"ready\n"
        try:
            yield program.parent
        finally:
            server.kill()


def serve(address: str) -> None:
    """Import the program and fork for every call, until killed."""
    import_all()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    with socket.socket(socket.AF_UNIX) as calls:
        calls.bind(address)
        calls.listen(16)
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        while True:
            call, _ = calls.accept()
            if os.fork() == 0:
                calls.close()
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                answer(call)
            call.close()


def import_all() -> None:
    """Import what commands import when they are called."""
    for package in pkgutil.walk_packages(uwtrack_cli.__path__, "uwtrack_cli."):
        importlib.import_module(package.name)
    for name in LATE:
        importlib.import_module(name)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        app(["show", "--schema", "encounters"])  # typer and rich import late, too


def answer(call: socket.socket) -> None:
    """Run one call in a child of its own, and send its exit code."""
    head, files, _, _ = socket.recv_fds(call, 8, 3)
    (size,) = struct.unpack("q", head)
    text = b""
    while len(text) < size:
        text += call.recv(size - len(text))
    words, folder, environment, limit, ignored = json.loads(text)
    child = os.fork()
    if child == 0:
        call.close()
        for number, file in enumerate(files):
            os.dup2(file, number)
            os.close(file)
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        tempfile.tempdir = None
        resource.setrlimit(resource.RLIMIT_FSIZE, tuple(limit))
        for number in PASSED_ON:
            signal.signal(number, usual_handler(number, ignored))
        be_the_program(words)
    for file in files:
        os.close(file)
    call.sendall(struct.pack("i", child))
    ended = os.pidfd_open(child)
    ready, _, _ = select.select([ended, call], [], [])
    if ended not in ready:  # whoever called was killed, and so is what it called
        os.kill(child, signal.SIGKILL)
    _, status, used = os.wait4(child, 0)
    if log := environment.get("COMMAND_TIMES"):
        cpu_s = used.ru_utime + used.ru_stime
        with Path(log).open("a") as file:
            file.write(f"{cpu_s:7.2f} {time.strftime('%X')} {' '.join(words)}\n")
    with contextlib.suppress(OSError):
        call.sendall(struct.pack("i", os.waitstatus_to_exitcode(status)))
    os._exit(0)


def usual_handler(number: int, ignored: list[int]) -> Any:
    """Return the handler with which Python begins."""
    if number in ignored:
        return signal.SIG_IGN
    python = {signal.SIGINT: signal.default_int_handler, signal.SIGXFSZ: signal.SIG_IGN}
    return python.get(signal.Signals(number), signal.SIG_DFL)


def be_the_program(words: list[str]) -> None:
    """Be the console script, and never return."""
    from uwtrack_cli.cli import main

    sys.modules["__main__"] = types.ModuleType("__main__")
    sys.argv = ["uwtrack", *words]
    code: object = 1
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code
    finally:
        atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code if isinstance(code, int) else int(code is not None))


if __name__ == "__main__":
    serve(sys.argv[1])
