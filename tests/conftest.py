"""Fixtures that several folders of tests share."""

import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile
from typer.testing import CliRunner, Result

from tests.command_server import command_server
from tests.shared_commands import write_program
from uwtrack_cli.flow.shipped_recipes import shipped_folder

USUAL_TIMEOUT_S = 300


def pytest_configure():
    """Let an interrupt interrupt: a shell starts what it runs behind deaf to it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items):
    """Begin with single long tests: at the end, a process would wait for the other."""

    def is_long(item):
        mark = item.get_closest_marker("timeout")
        return mark is not None and mark.args[0] > USUAL_TIMEOUT_S

    items.sort(key=is_long, reverse=True)


@pytest.fixture
def uwtrack(monkeypatch, tmp_path):
    """Run a command line in an empty folder; the result has exit_code and texts."""
    from uwtrack_cli.cli.app import app

    monkeypatch.chdir(tmp_path)

    def run(*words: object, **options: object):
        return CliRunner().invoke(app, [str(w) for w in words], **options)

    return run


@pytest.fixture(scope="session")
def program(tmp_path_factory) -> Iterator[Path]:
    """The folder of an `uwtrack` for scripts, which needs no start."""
    with command_server(tmp_path_factory.mktemp("program")) as folder:
        yield folder


@pytest.fixture(scope="session")
def shared_program(program, tmp_path_factory) -> Path:
    """The folder of an `uwtrack` that runs the same costly command once."""
    folder = tmp_path_factory.mktemp("shared")
    return write_program(folder, program / "uwtrack", Path(__file__).parent.parent)


@pytest.fixture(scope="session")
def start(program) -> Callable[..., subprocess.Popen]:
    """Start a command line as a process of its own that may be sent signals."""

    def begin(*words: object, **options: object) -> subprocess.Popen:
        command = [str(program / "uwtrack"), *map(str, words)]
        return subprocess.Popen(command, **options)

    return begin


@pytest.fixture(scope="session")
def samples() -> Path:
    """The folder of the shipped sample recordings."""
    return shipped_folder("sample_data")


@pytest.fixture(scope="session")
def short_pass(tmp_path_factory, samples) -> Path:
    """The middle of the sample passage: enough for every stage, and quick."""
    folder = tmp_path_factory.mktemp("short")
    sound, rate = soundfile.read(samples / "pass.wav", start=180_000, frames=240_000)
    soundfile.write(folder / "pass.wav", sound, rate, subtype="PCM_16")
    facts = (samples / "pass.sensor.toml").read_text()
    (folder / "pass.sensor.toml").write_text(facts)
    return folder / "pass.wav"


@pytest.fixture(scope="session")
def pass_run(tmp_path_factory, samples) -> Path:
    """The product of the sample passage with its start time, to be read only."""
    from uwtrack_cli.cli.app import app

    path = tmp_path_factory.mktemp("pass") / "pass.run.h5"
    words = ["run", str(samples / "pass.wav"), "-o", str(path), "-q"]
    done = CliRunner().invoke(app, [*words, "--start-utc", "2024-05-01T12:00:00Z"])
    assert done.exit_code == 0, done.output
    path.chmod(0o444)
    return path


@pytest.fixture(scope="session")
def short_run(short_pass) -> Path:
    """The product of the middle of the passage, to be copied or read only."""
    return _product(short_pass, "short.run.h5")[0]


@pytest.fixture(scope="session")
def timed_result(short_pass) -> tuple[Path, Result]:
    """The same with its start time, and what its run printed."""
    start = ("--start-utc", "2024-05-01T12:01:30Z")
    return _product(short_pass, "timed.run.h5", *start)


@pytest.fixture(scope="session")
def timed_run(timed_result) -> Path:
    """The same with its start time."""
    return timed_result[0]


def _product(sound: Path, name: str, *words: str) -> tuple[Path, Result]:
    from uwtrack_cli.cli.app import app

    path = sound.with_name(name)
    done = CliRunner().invoke(app, ["run", str(sound), "-o", str(path), *words])
    assert done.exit_code == 0, done.output
    path.chmod(0o444)
    return path, done


@pytest.fixture(scope="session")
def two_sensors_run(tmp_path_factory) -> Path:
    """A folder with the sample of two sensors, and its products: a fix each 20 s."""
    from uwtrack_cli.cli.app import app

    folder = tmp_path_factory.mktemp("two-sensors")
    sounds = [str(folder / f"two-sensors-h{k}.wav") for k in (1, 2)]
    for words in (
        ["sample", "two-sensors", "--output", str(folder)],
        ["run", *sounds, "-q", "--start-utc", "2024-05-02T06:30:00Z",
         "--recipe", "vessel", "--set", "locate.every_s=20.0",
         "--set", "locate.until='200'"],
    ):  # fmt: skip
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.output
    return folder


@pytest.fixture
def noise_wav(tmp_path) -> Path:
    """Ten seconds of one channel of noise."""
    rng = np.random.default_rng(1)
    path = tmp_path / "noise.wav"
    soundfile.write(path, 0.1 * rng.standard_normal(20_000), 2000, subtype="PCM_16")
    return path
