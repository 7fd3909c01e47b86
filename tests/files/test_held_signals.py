"""A signal never interrupts HDF5 in the midst of a write, and is never lost."""

import gc
import os
import signal
import subprocess
import sys
import threading

import h5py
import numpy as np
import pytest

from tests.support import OMNI, recording_of
from uwtrack_cli.files.hdf5.product import write_product
from uwtrack_cli.files.hdf5.writer import FailSafeFile, ProductStore, signals_held


def n_open_files():
    return h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("owner", "name", "call"),
    [(ProductStore, "__init__", 1), (ProductStore, "append", 1),
     (ProductStore, "finish", 1), (FailSafeFile, "write", 1),
     (FailSafeFile, "write", 5), (FailSafeFile, "truncate", 1)],
)  # fmt: skip
def test_a_signal_within_a_write_waits_for_its_end(tmp_path, monkeypatch, owner, name, call):
    """It comes before the call has done its work, which is done all the same."""
    usual, calls, done, lost = getattr(owner, name), [], [], []

    def interrupted(self, *values):
        calls.append(name)
        if len(calls) == call:
            signal.raise_signal(signal.SIGINT)
        made = usual(self, *values)
        if len(calls) == call:
            done.append(made)
        return made

    monkeypatch.setattr(owner, name, interrupted)
    monkeypatch.setattr(sys, "unraisablehook", lost.append)
    before = n_open_files()
    with pytest.raises(KeyboardInterrupt):
        write_product(tmp_path / "a.h5", [recording_of(np.zeros(9), 10.0), OMNI])
    gc.collect()  # HDF5 lets go of what nobody holds
    assert len(done) >= 1
    assert lost == []
    assert n_open_files() == before
    assert list(tmp_path.iterdir()) == []


def test_every_signal_that_came_is_met_afterwards_in_its_order():
    met = []
    numbers = [signal.SIGTERM, signal.SIGHUP]
    before = {n: signal.signal(n, lambda n, _: met.append(n)) for n in numbers}
    try:
        with signals_held():
            for number in numbers:
                os.kill(os.getpid(), number)
            assert met == []
        assert met == numbers
        os.kill(os.getpid(), signal.SIGTERM)  # the handlers are back
        assert met == [*numbers, signal.SIGTERM]
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_another_thread_holds_nothing():
    handlers = []

    def work():
        with signals_held():
            handlers.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert handlers == [signal.getsignal(signal.SIGINT)]


def test_a_worker_that_is_interrupted_says_nothing():
    """It ends without taking the interpreter down, whose last words nobody reads."""
    program = (
        "import os, signal\n"
        "from uwtrack_cli.flow import executors as worker_pool\n"
        "from multiprocessing import Pipe\n"
        "def run(job, progress):\n"
        "    raise KeyboardInterrupt\n"
        "worker_pool._run = run\n"
        "worker_pool._end_with = lambda parent: None\n"
        "ours, theirs = Pipe()\n"
        "ours.send(None)\n"
        "worker_pool._serve(theirs, os.getppid())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")
