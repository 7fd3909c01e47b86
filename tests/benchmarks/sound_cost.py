"""What `run` and `beamform` cost by sample rate, length and number of hydrophones.

A passage of one omni hydrophone, or noise of an array, is written as a file, and each
command is run over it as a process of its own: its CPU time and its peak memory. Prints
Markdown. A table of some 15 CPU minutes, and a day besides:
``python -m tests.benchmarks.sound_cost`` and ``python -m tests.benchmarks.sound_cost day``.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import soundfile

from tests.benchmarks.long_run import scenario
from uwtrack_cli.simulate import simulate_recordings

RATES = ((4e3, 600.0), (48e3, 600.0), (96e3, 600.0), (576e3, 40.0))
"""Sample rates, Hz, and lengths, s."""

ELEMENTS = (64, 128)
ARRAY_RATE_HZ, ARRAY_S = 4000.0, 60.0


class Cost(NamedTuple):
    """What a command took."""

    cpu_s: float
    """CPU time of the process, s."""
    peak_mb: float
    """Peak of its resident memory, MB of 2^20 bytes."""


def cost(*words: object) -> Cost:
    """Run a command of the program and return what it took."""
    line = [sys.executable, "-m", "uwtrack_cli", *map(str, words)]
    process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    said = process.stderr.read().decode()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        msg = f"{line} failed: {said}"
        raise RuntimeError(msg)
    scale = 2**20 if sys.platform == "darwin" else 2**10
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss / scale)


def write_passage(path: Path, rate_hz: float, length_s: float, passages: int = 1) -> None:
    """Write the omni channel of a vessel's passage, or of several, in 16 bits."""
    (recording,) = simulate_recordings(scenario(length_s / 3600.0, passages, rate_hz))
    assert recording.reader is not None
    with soundfile.SoundFile(path, "w", int(rate_hz), 1, "PCM_16") as file:
        for block in recording.reader(1 << 18):
            file.write(block[:, 0])


def write_array(path: Path, elements: int) -> None:
    """Write white noise of a line array with its sensor file."""
    rng = np.random.default_rng(elements)
    noise = 0.1 * rng.standard_normal((int(ARRAY_S * ARRAY_RATE_HZ), elements))
    soundfile.write(path, noise.astype("f4"), int(ARRAY_RATE_HZ), "PCM_16")
    path.with_suffix(".sensor.toml").write_text(
        'id = "a1"\nkind = "array"\ndepth_m = 30.0\nheading_deg = 0.0\n'
        f"channels = {[f'e{k}' for k in range(elements)]}\n"
        f"element_along_m = {[0.5 * k for k in range(elements)]}\n",
        encoding="utf-8",
    )


def rates(folder: Path) -> Iterator[str]:
    """Yield the rows of `run` at several rates."""
    yield "| Hz | s | recipe | CPU s | over that at 4 kHz | peak MB |"
    yield "|---|---|---|---|---|---|"
    for recipe in ("vessel", "auto"):
        at_first = 0.0
        for rate_hz, length_s in RATES:
            path = folder / f"{rate_hz:.0f}.wav"
            if not path.exists():
                write_passage(path, rate_hz, length_s)
            used = cost("run", path, "--recipe", recipe, "--overwrite")
            at_first = at_first or used.cpu_s
            ratio = f"{used.cpu_s / at_first:.2f}" if length_s == RATES[0][1] else ""
            yield (
                f"| {rate_hz:.0f} | {length_s:.0f} | {recipe} | {used.cpu_s:.1f} "
                f"| {ratio} | {used.peak_mb:.0f} |"
            )


def arrays(folder: Path) -> Iterator[str]:
    """Yield the rows of `beamform` of many hydrophones."""
    yield f"\n| hydrophones, {ARRAY_S:.0f} s at 4 kHz | CPU s | peak MB |\n|---|---|---|"
    for elements in ELEMENTS:
        path = folder / f"array{elements}.wav"
        write_array(path, elements)
        used = cost("beamform", path, "--overwrite")
        yield f"| {elements} | {used.cpu_s:.1f} | {used.peak_mb:.0f} |"


def lengths(folder: Path) -> Iterator[str]:
    """Yield the rows of an hour and a day with a passage every two hours and a half."""
    yield "\n| hours at 4 kHz | recipe | CPU s an hour | peak MB |\n|---|---|---|---|"
    for hours in (1.0, 24.0):
        path = folder / f"{hours:.0f}h.wav"
        write_passage(path, 4000.0, 3600.0 * hours, max(1, round(hours / 2.4)))
        used = cost("run", path, "--recipe", "auto", "--overwrite")
        yield f"| {hours:.0f} | auto | {used.cpu_s / hours:.1f} | {used.peak_mb:.0f} |"


def main(words: list[str]) -> None:
    """Print the tables."""
    makers = [lengths] if words == ["day"] else [rates, arrays]
    with tempfile.TemporaryDirectory() as name:
        for maker in makers:
            for row in maker(Path(name)):
                sys.stdout.write(row + "\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
