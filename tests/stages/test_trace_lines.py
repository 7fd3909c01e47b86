"""Track-before-detect: laws, false lines, many lines, gaps, bearings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import poisson

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.flow.studies.line_sound import listen
from uwtrack_cli.flow.studies.trace_noise import noise_recording
from uwtrack_cli.stages.spectrogram import compute_spectrogram
from uwtrack_cli.stages.trace import trace_lines

RATE_HZ = 1024.0


def sound(
    tones: list[tuple[float, float]], length_s: float = 90.0, seed: int = 1, **options
) -> list[Spectrogram]:
    """Noise of variance one with steady tones: frequency and SNR in 1 Hz."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(length_s * RATE_HZ)) / RATE_HZ
    samples = rng.standard_normal(time.size)
    for frequency, snr_db in tones:
        amplitude = np.sqrt(4.0 * 10.0 ** (snr_db / 10.0) / RATE_HZ)
        samples += amplitude * np.cos(2 * np.pi * frequency * time + rng.uniform(0, 6))

    def read(block: int):
        for start in range(0, time.size, block):
            yield 0.05 * samples[start : start + block, None].astype(np.float32)

    recording = Recording(
        sensor=Sensor(id="h1"), name="t", sample_rate_hz=RATE_HZ,
        n_samples=time.size, n_channels=1, reader=read,
    )  # fmt: skip
    return list(compute_spectrogram(recording, **options))


def joined(blocks: list[Spectrogram], **options) -> Lines:
    return Lines.join(list(trace_lines(iter(blocks), **options)))


def cut(whole: Spectrogram, start: int, stop: int) -> Spectrogram:
    block = whole.take("frame", slice(start, stop))
    return replace(block, frames=replace(block.frames, first_frame=start))


@pytest.mark.parametrize("block", [16, 64, 176])
def test_the_cut_into_blocks_changes_no_bit(block: int) -> None:
    whole = Spectrogram.join(sound([(150.0, 6.0), (301.2, 12.0)]))
    n = whole.frames.n_frames
    blocks = [cut(whole, k, min(k + block, n)) for k in range(0, n, block)]
    out = list(trace_lines(iter(blocks)))
    assert [b.frames.n_frames for b in out[: len(blocks)]] == [
        b.frames.n_frames for b in blocks
    ]
    assert Lines.join(out).equals(joined([whole]))


def test_many_lines_of_unequal_strength_are_found_once_each() -> None:
    tones = [(80.0, 6.0), (130.0, 30.0), (137.0, 8.0), (222.3, 4.0), (380.0, 15.0)]
    lines = joined(sound(tones))
    found = sorted(float(np.median(lines.frequency_hz[lines.line == k]))
                   for k in lines.line_id)  # fmt: skip
    assert len(found) == len(tones)
    assert np.allclose(found, [f for f, _ in tones], atol=0.2)


def test_a_line_through_many_windows_keeps_its_number_and_every_frame() -> None:
    blocks = sound([(200.0, 8.0)], length_s=300.0)
    lines = joined(blocks)
    frames = np.sort(lines.frame[lines.line == lines.line_id[0]])
    n_frames = sum(b.frames.n_frames for b in blocks)
    assert lines.line_id.size == 1
    assert np.array_equal(frames, np.unique(frames))
    assert frames.size >= n_frames - 4


def test_false_lines_in_noise_come_at_the_stated_rate() -> None:
    rate, hours = 60.0, 0.4
    blocks = list(compute_spectrogram(noise_recording(11, hours)))
    count = joined(blocks, false_lines_per_khz_hour=rate).line_id.size
    expected = rate * 2.046 * hours
    # the stated rate, with a fifth for the fit of the tail
    assert poisson.ppf(0.001, 0.7 * expected) <= count
    assert count <= poisson.ppf(0.999, 1.2 * expected)


def test_a_line_of_the_stated_weakest_snr_is_heard_about_every_other_time() -> None:
    blocks = sound([], length_s=70.0)
    weakest_db = joined(blocks, false_lines_per_khz_hour=4.8).weakest_line_snr_db
    # cell to 1 Hz: the Hann window's noise bandwidth of 1.5 bins
    snr_db = weakest_db + 10 * np.log10(1.5)
    heard = np.mean([listen("trace", snr_db, seed).is_heard for seed in range(40)])
    assert 0.2 <= heard <= 0.8


def test_a_gap_is_no_evidence_against_a_line() -> None:
    whole = Spectrogram.join(sound([(180.0, 10.0)], length_s=120.0))
    effort = whole.frames.effort.copy()
    effort[80:112] = 0.0
    power = whole.power_density.copy()
    power[80:112] = 0.0
    frames = replace(whole.frames, effort=effort)
    lines = joined([replace(whole, frames=frames, power_density=power)])
    assert lines.line_id.size == 1
    assert not np.isin(np.arange(80, 112), lines.frame).any()
    assert lines.frame.max() > 220


def test_smoothed_frequencies_hold_their_stated_deviations() -> None:
    scores = []
    for seed in range(10):
        lines = joined(sound([(203.3, 10.0)], seed=seed))
        error = lines.frequency_hz - 203.3
        scores.append(error**2 / lines.frequency_covariance[:, 0, 0])
    nees = float(np.concatenate(scores).mean())
    # a steady tone is smoother than the model, so errors are small, never large
    assert nees < 1.2


@pytest.mark.parametrize(
    "options",
    [
        {"false_lines_per_khz_hour": 0.0},
        {"window_frames": 30},
        {"window_frames": 122},
        {"shortest_frames": 2},
        {"band_hz": (100.0, 110.0)},
    ],
)
def test_options_out_of_range_are_refused(options: dict) -> None:
    with pytest.raises(OptionError, match=r"got|holds"):
        joined(sound([], length_s=20.0), **options)


def test_frames_whose_noise_is_not_known_are_refused_with_the_known_ones() -> None:
    with pytest.raises(OptionError, match=r"overlap 0\.5 with zero padding 2"):
        joined(sound([], length_s=20.0, overlap=0.25))
