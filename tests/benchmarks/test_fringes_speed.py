"""CPU time of fringes against the plain way, on ten minutes with a passage.

The search correlates image and law, so that all times of an R/v are one transform; the
plain way shifts and stacks the rows for each time, as D'Spain and Kuperman (1999) do for
each range. What is fitted after it costs no more than some searches. The image of sound
of a high rate is made after cheap halvings, and costs little more than that of a low one.
"""

import time

import numpy as np
import pytest
import soundfile

from tests.draws.fringe_rates import MACH
from tests.draws.fringe_sounds import draw_power, fringes_of
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.motion.evidence.fringe_panel import panel_of
from uwtrack_cli.motion.evidence.fringes import (
    LEAST_WIDTH_S,
    WIDTH_STEP,
    FringeEvidence,
    fringe_passages,
)
from uwtrack_cli.spectra.fringes import measure_fringes
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

PLACES = 40
"""Times that the plain way is measured at, of each R/v."""


@pytest.fixture(scope="module")
def fringes():
    frequency, power, _ = draw_power(71, is_deep=True)
    return fringes_of(frequency, power)


def stacked(panel, time_s, width_s):
    """Return the energy of the stack of rows, each shifted as the law says."""
    lag = (panel.time_s - time_s) / width_s
    near = np.abs(lag) < 5.0
    shift = np.rint(0.5 * np.log1p(lag[near] ** 2) / panel.cell).astype(int)
    total = np.zeros(panel.value.shape[1] + shift.max(initial=0))
    first = total.size - panel.value.shape[1]
    for row, by in zip(panel.value[near], shift, strict=True):
        total[first - by : total.size - by] += row
    return float((total**2).sum())


def plain_search_s(fringes):
    """Return the CPU time of the same grid by shifting and stacking, s."""
    spent_s, span_s = 0.0, float(fringes.time_s[-1] - fringes.time_s[0])
    width_s = LEAST_WIDTH_S
    while width_s < span_s:
        panel = panel_of(fringes, min(width_s / 16.0, span_s / 48.0), 2)
        places = np.linspace(*panel.time_s[[0, -1]], PLACES)
        begin = time.process_time()
        for place in places:
            stacked(panel, place, width_s)
        each_s = (time.process_time() - begin) / PLACES
        spent_s += each_s * panel.time_s.size
        width_s *= WIDTH_STEP
    return spent_s


@pytest.mark.benchmark
def test_the_search_costs_less_than_shifting_and_stacking(fringes, capsys):
    FringeEvidence(fringes, MACH).proposals()  # slow imports
    begin = time.process_time()
    FringeEvidence(fringes, MACH).proposals()
    search_s = time.process_time() - begin
    begin = time.process_time()
    assert fringe_passages(fringes, MACH)
    whole_s = time.process_time() - begin
    plain_s = plain_search_s(fringes)
    with capsys.disabled():
        print(
            f"\nfringes: search {search_s / plain_s:.2f} of shifting and stacking, "
            f"all {whole_s / search_s:.1f} searches ({whole_s:.1f} s of CPU time)"
        )
    assert search_s < 0.2 * plain_s
    assert whole_s < 8.0 * search_s


def image_s(path):
    """Return the CPU time of reading, decimation, spectrogram and image, s."""
    begin = time.process_time()
    recording = open_recording(path, sensor=Sensor(id="h1"))
    frames = compute_spectrogram(recording, window_s=0.5, zero_padding=1, band_hz=(40.0, 7000.0))
    assert sum(block.shade.shape[0] for block in measure_fringes(frames))
    return time.process_time() - begin


def bare_s(path):
    """Return the CPU time of reading the samples alone, s."""
    begin = time.process_time()
    for _ in soundfile.blocks(path, blocksize=1 << 18, dtype="int16"):
        pass
    return time.process_time() - begin


@pytest.mark.benchmark
def test_the_image_of_a_high_rate_costs_little_more(tmp_path, capsys):
    rng, spent, bare = np.random.default_rng(1), {}, {}
    for rate_hz in (24_000, 192_000):
        path = tmp_path / f"{rate_hz}.wav"
        noise = 0.1 * rng.standard_normal(120 * rate_hz, np.float32)
        soundfile.write(path, noise, rate_hz, subtype="PCM_16")
        spent[rate_hz] = min(image_s(path) for _ in range(3))
        bare[rate_hz] = min(bare_s(path) for _ in range(3))
    low, high = spent.values()
    with capsys.disabled():
        print(
            f"\nfringes: the image at 192 kHz costs {high / low:.1f} of that at 24 kHz, "
            f"{bare[192_000] / high:.2f} of it bare reading ({high:.2f} s for 120 s)"
        )
    assert high < 6.0 * low
