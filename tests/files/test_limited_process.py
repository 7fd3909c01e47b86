"""Whatever happens to the child, the parent gets an answer and goes on."""

import contextlib
import os
import resource
import signal
import time
from pathlib import Path

import pytest

from uwtrack_cli.errors import DataError
from uwtrack_cli.files import limited_process
from uwtrack_cli.files.limited_process import run_limited


@pytest.fixture(params=["forked", "spawned"], autouse=True)
def _way(request, monkeypatch):
    """Both ways to make the child."""
    monkeypatch.setattr(limited_process, "CAN_FORK", request.param == "forked")


def crash():
    os.kill(os.getpid(), signal.SIGSEGV)


def wait():
    time.sleep(60)


def spin():
    while True:
        pass


def claim():
    return len(bytearray(4 << 30))


def refuse():
    msg = "it is no good."
    raise DataError(msg)


def fail():
    return 1 / 0


def recurse():
    return recurse()


def answer(text="x"):
    return ["answer", 1_000_000 * text]


def run(what, *arguments, seconds=20.0):
    function = f"tests.files.test_limited_process:{what}"
    return run_limited(function, *arguments, seconds=seconds)


def test_arguments_and_a_long_answer_pass_through():
    assert run("answer", "y") == ["answer", 1_000_000 * "y"]


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ("crash", "ends the process"),
        ("claim", "too much memory"),
        ("recurse", "too much memory"),
        ("refuse", "it is no good"),
        ("fail", "ZeroDivisionError"),
    ],
)
def test_what_goes_wrong_is_a_sentence(what, reason):
    with pytest.raises(DataError, match=reason):
        run(what)


@pytest.mark.slow
@pytest.mark.parametrize(("what", "seconds"), [("spin", 0.3), ("wait", 0.2)])
def test_time_is_limited_and_nothing_is_left_behind(what, seconds):
    begin, before = time.monotonic(), children()
    with pytest.raises(DataError, match="too long"):
        run(what, seconds=seconds)
    assert time.monotonic() - begin < 250.0
    assert children() == before


def children():
    """Children of this process, the ended ones that nobody has waited for among them."""
    if not Path("/proc/self/stat").exists():
        pytest.skip("the system does not list processes")
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it ends while it is looked at
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            found |= {stat.parent.name} if parent == os.getpid() else set()
    return found


def test_the_child_may_see_first_that_time_is_up(monkeypatch):
    received = limited_process._received
    monkeypatch.setattr(
        limited_process, "_received", lambda pipe, until: received(pipe, until + 20.0)
    )
    with pytest.raises(DataError, match="too long"):
        run("wait", seconds=0.1)


def test_the_limits_hold_for_the_child_alone():
    before = resource.getrlimit(resource.RLIMIT_AS)
    run("answer")
    assert resource.getrlimit(resource.RLIMIT_AS) == before
