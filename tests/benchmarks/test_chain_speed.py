"""Speed and memory of the chain, as ratios of CPU time in one process."""

import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from tests.support import recording_of, white_noise
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

pytestmark = pytest.mark.benchmark
RATE_HZ = 4000.0


def cpu_s(function, repeats=5):
    """Smallest CPU time of several runs: the least disturbed one."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        function()
        times.append(time.process_time() - begin)
    return min(times)


def bare_transform(samples, window=4000, hop=2000, fft_length=8000, step=16):
    """Window, transform and square the same frames, and nothing else."""
    from scipy.fft import rfft

    view = np.lib.stride_tricks.sliding_window_view(samples, window)[::hop]
    taper = np.hanning(window + 1)[:-1].astype(np.float32)
    for first in range(0, len(view), step):
        spectrum = rfft(view[first : first + step] * taper, fft_length)
        spectrum.real**2 + spectrum.imag**2


def seconds_of_sound(n_seconds):
    samples = white_noise(int(RATE_HZ) * n_seconds, 1).astype(np.float32)
    t = np.arange(samples.size, dtype=np.float32) / np.float32(RATE_HZ)
    for frequency in (63.0, 126.0, 189.0, 310.0, 700.0):
        samples += np.float32(5.0) * np.sin(2 * np.pi * frequency * t)
    return samples


def test_the_spectrogram_costs_little_more_than_its_transforms(capsys):
    samples = seconds_of_sound(600)
    recording = recording_of(samples, RATE_HZ)

    def ours():
        for _ in compute_spectrogram(recording):
            pass

    ratio = cpu_s(ours) / cpu_s(lambda: bare_transform(samples))
    with capsys.disabled():
        print(f"\nspectrogram: {ratio:.2f} times its bare transforms")
    assert ratio < 1.6


def test_a_run_stays_within_sixty_bare_transforms(capsys):
    """Twelve is the aim and not met: 41 to 48 alone, 47 to 53 beside busy processes.

    Each run stands between bare transforms of the same moment, and the least disturbed
    of a few is taken: the shortest of many bare ones would be compared with a run
    that is never as lucky.
    """
    samples = seconds_of_sound(900)
    recording, recipe = recording_of(samples, RATE_HZ), load_recipe("vessel")
    run_recipe(recording, recipe)  # imports and tables

    def bare():
        for _ in range(8):
            bare_transform(samples)

    ratio = np.inf
    before_s = cpu_s(bare, repeats=1)
    for _ in range(6):
        run_s = cpu_s(lambda: run_recipe(recording, recipe), repeats=1)
        after_s = cpu_s(bare, repeats=1)
        ratio = min(ratio, 16.0 * run_s / (before_s + after_s))
        before_s = after_s
        if ratio < 60.0:  # the least of them is asked, which more runs cannot raise
            break
    with capsys.disabled():
        print(f"\nrun: {ratio:.1f} times, {900 / run_s:.0f} times real time")
    assert ratio < 60.0


def test_a_branch_that_nothing_follows_costs_its_own_stages_alone(capsys):
    """A second spectrogram costs its transforms; the sound is read once for both."""
    recording = recording_of(seconds_of_sound(600), RATE_HZ)
    one = Recipe.from_toml("one", "[spectrogram]\n[levels]\nband_hz = [100.0, 1900.0]\n")
    other = Recipe.from_toml(
        "other",
        "[fine]\nstage = 'spectrogram'\nwindow_s = 0.25\n"
        "[fine-levels]\nstage = 'levels'\nband_hz = [100.0, 1900.0]\n",
    )
    one_kept = tuple(replace(s, is_output=True) for s in one.steps)
    both = replace(one, steps=(*one_kept, *(
        replace(s, inputs=("fine",)) if s.name == "fine-levels" else s
        for s in other.steps
    )))  # fmt: skip
    alone = sum(cpu_s(lambda r=r: run_recipe(recording, r), 3) for r in (one, other))
    ratio = cpu_s(lambda: run_recipe(recording, both), 3) / alone
    with capsys.disabled():
        print(f"\ntwo branches in one run: {ratio:.2f} times the two alone")
    assert ratio < 1.15


MEMORY = """
import sys
from tests.benchmarks.test_chain_speed import repeated_sound
from uwtrack_cli.files.hdf5.product import ProductWriter
from uwtrack_cli.flow.products import run_into_product
from uwtrack_cli.flow.shipped_recipes import load_recipe
with ProductWriter(sys.argv[2]) as writer:
    run_into_product(repeated_sound(int(sys.argv[1])), load_recipe("vessel"), writer)
# not ru_maxrss, which begins with the size of the process that started this one
status = open("/proc/self/status").read()
print(int(status.partition("VmHWM:")[2].split()[0]) / 1024)
"""


def repeated_sound(n_seconds):
    """A recording of any length that holds one minute in memory."""
    minute = seconds_of_sound(60).reshape(-1, 1)
    n_samples = n_seconds * int(RATE_HZ)

    def reader(block):
        for start in range(0, n_samples, block):
            index = np.arange(start, min(start + block, n_samples)) % len(minute)
            yield minute[index]

    recording = recording_of(minute, RATE_HZ)
    return type(recording)(
        sensor=recording.sensor, name="long", sample_rate_hz=RATE_HZ,
        n_samples=n_samples, n_channels=1, reader=reader,
    )  # fmt: skip


def peak_memory_mb(n_seconds, target):
    words = [sys.executable, "-c", MEMORY, str(n_seconds), str(target)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return float(done.stdout)


@pytest.mark.parametrize(
    ("short_s", "long_s"),
    [(600, 3600), pytest.param(3600, 6 * 3600, marks=pytest.mark.long)],
    ids=["ten minutes and an hour", "one hour and six"],
)
def test_memory_stays_under_275_mb_and_grows_by_the_results_alone(
    capsys, tmp_path, short_s, long_s
):
    short = peak_memory_mb(short_s, tmp_path / "short.h5")
    long = peak_memory_mb(long_s, tmp_path / "long.h5")
    growth = (long - short) / ((long_s - short_s) / 3600.0)
    with capsys.disabled():
        print(f"\npeak memory: {short:.0f} MB and {long:.0f} MB, {growth:.0f} MB/h")
    assert long < 275.0
    # five lines without a pause are 36,000 points an hour of about 100 bytes each,
    # held as blocks, joined and in order
    assert growth < 22.0


def test_help_takes_under_three_times_the_import_of_typer_and_rich(capsys):
    def best(code):
        words = [sys.executable, "-c", code]
        times = []
        for _ in range(10):
            begin = children_cpu_s()
            subprocess.run(words, capture_output=True, check=True)
            times.append(children_cpu_s() - begin)
        return min(times)

    program = (
        "import sys; sys.argv=['uwtrack','--help']\n"
        "from uwtrack_cli.cli import main\n"
        "try: main()\nexcept SystemExit: pass"
    )
    ratio = best(program) / best("import typer, rich")
    with capsys.disabled():
        print(f"\n--help: {ratio:.2f} times the import of typer and rich")
    assert ratio < 3.0


def children_cpu_s():
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
