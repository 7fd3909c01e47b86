"""Noise of a recording that is not white: measured, and what follows from it."""

import numpy as np
import pytest
from scipy.stats import poisson

from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.paths.path_search import (
    MOVE_PENALTY,
    PathSearch,
    best_scores,
    beyond_outer_tiles,
    cell_scores,
)
from uwtrack_cli.lines.paths.recording_noise import RecordingNoise, surrogate_scores
from uwtrack_cli.lines.paths.trace_threshold import SURROGATES, TAILS
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 1024.0
N_FRAMES, PADDING, SLOPE = 120, 2, 2.4
WHITE = SURROGATES[0.5, 2][TAILS[0.5, 2][0].index(N_FRAMES)]


def noise_ratio(seed: int, n_bins: int = 512) -> np.ndarray:
    """Power over noise of half-overlapping Hann frames of white noise, padded twice."""
    size = 2 * n_bins
    window = np.hanning(size + 1)[:-1]
    samples = np.random.default_rng(seed).standard_normal(size * (N_FRAMES + 1) // 2)
    frames = np.stack([samples[k * size // 2 : k * size // 2 + size] for k in range(N_FRAMES)])
    spectrum = np.fft.rfft(frames * window, PADDING * size)[:, : PADDING * n_bins]
    return (np.abs(spectrum) ** 2 / np.sum(window**2)).astype(np.float32)


def scores_of(ratio: np.ndarray, seed: int = 1) -> np.ndarray:
    scores = cell_scores(ratio)
    total, moves = best_scores(scores, MOVE_PENALTY)
    return surrogate_scores(PathSearch([], total, moves, scores), PADDING, seed)


def real_scores(ratio: np.ndarray) -> np.ndarray:
    total, _ = best_scores(cell_scores(ratio), MOVE_PENALTY)
    return total.reshape(-1, 32).max(axis=1)


def test_paths_that_no_line_can_take_score_in_white_noise_as_the_table_says():
    mean = np.mean([scores_of(noise_ratio(seed), seed) for seed in range(12)])
    # the deviation of a score is 4.9, and there are 384 blocks
    assert mean == pytest.approx(WHITE, abs=1.0)


def test_a_low_floor_is_measured_and_leaves_the_stated_rate():
    """What it adds to real paths, it adds to those that no line can take."""
    noise = RecordingNoise(1024, PADDING)
    real, shifted, raised = [], [], []
    for seed in range(20, 32):
        ratio = noise_ratio(seed)
        real.append((real_scores(1.05 * ratio) - real_scores(ratio)).mean())
        low, right = scores_of(1.05 * ratio, seed), scores_of(ratio, seed)
        shifted.append((low - right).mean())
        white = float(right.mean())
        raised.append(noise.note(low, white, SLOPE).mean())
    assert np.mean(real) > 5.0  # 0.2 dB
    assert np.mean(shifted) == pytest.approx(np.mean(real), rel=0.15)
    # twelve windows beside five in which there is thought to be nothing
    assert raised[-1] == pytest.approx(np.mean(shifted) * 12 / 17, rel=0.1)
    assert 1.0 < noise.relative_rate() < 0.5 * np.exp(np.mean(real) / SLOPE)


def test_a_steady_line_too_weak_to_be_found_is_no_excess():
    time_s = np.arange(512 * (N_FRAMES + 1)) / RATE_HZ
    rises = []
    for seed in range(40, 48):
        samples = np.random.default_rng(seed).standard_normal(time_s.size)
        density = 2.0 / RATE_HZ
        tone = np.sqrt(2.0 * density) * np.sin(2 * np.pi * 200.3 * time_s)  # 0 dB
        rises.append([_block_at_line(samples + extra) for extra in (0.0, tone)])
    without, with_line = np.mean(rises, axis=0)
    # the line's own path scores 30 nepers more
    assert with_line - without < 3.0


def _block_at_line(samples: np.ndarray) -> float:
    window = np.hanning(1025)[:-1]
    frames = np.stack([samples[k * 512 : k * 512 + 1024] for k in range(N_FRAMES)])
    power = np.abs(np.fft.rfft(frames * window, 2048)[:, :1024]) ** 2
    ratio = (power / np.sum(window**2)).astype(np.float32)
    return float(scores_of(ratio)[int(200.3 * 2) // 32])


@pytest.mark.parametrize("exponent", [-2.0, -1.0, 0.0, 2.0])
def test_noise_of_a_power_law_goes_on_beyond_the_outer_tiles(exponent: float):
    """The floor is constant there; a power law is known at every frequency."""
    frequency = 50.0 + 0.5 * np.arange(384)
    law = frequency**exponent
    floor = law.copy()
    floor[:16], floor[-16:] = law[16], law[-17]
    factor = beyond_outer_tiles(np.tile(floor, (8, 1)), frequency, PADDING)
    rises = law[:16] > law[16]
    assert factor[:16][rises] == pytest.approx((law / law[16])[:16][rises], rel=0.01)
    assert np.all(factor[:16][~rises] == 1.0)
    assert np.all(factor[20:366] == 1.0)
    assert factor[-1] == pytest.approx(max(law[-1] / law[-17], 1.0), rel=0.02)


def test_an_edge_a_gap_and_silence_are_not_prolonged():
    frequency = 50.0 + 0.5 * np.arange(400)
    floor = np.ones((4, 400))
    floor[:, :32] = 100.0
    assert np.all(beyond_outer_tiles(floor, frequency, PADDING) == 1.0)
    for value in (np.nan, 0.0):
        floor[:] = value
        assert np.all(beyond_outer_tiles(floor, frequency, PADDING) == 1.0)


def traced(samples: np.ndarray, **options: float) -> Lines:
    recording = recording_of(samples.astype(np.float32)[:, None], RATE_HZ)
    blocks = compute_spectrogram(recording, band_hz=(50.0, 250.0))
    return Lines.join(list(trace_lines(blocks, **options)))


def test_noise_that_falls_by_six_decibels_an_octave_keeps_the_stated_rate():
    rate, hours = 20.0, 0.4
    n = round(3600 * hours * RATE_HZ)
    frequency = np.fft.rfftfreq(n, 1.0 / RATE_HZ)
    spectrum = np.fft.rfft(np.random.default_rng(3).standard_normal(n))
    noise = np.fft.irfft(spectrum / np.maximum(frequency, 20.0), n)
    lines = traced(noise / noise.std(), false_lines_per_khz_hour=rate)
    assert lines.line_id.size <= poisson.ppf(0.999, 1.2 * rate * 0.2 * hours)
    assert 0.3 * rate < lines.measured_false_lines_per_khz_hour < 2.0 * rate


def test_noise_that_falls_from_zero_on_starts_no_lines_at_its_knee():
    """Below 22 Hz the ground falls by half within a tile of the noise floor."""
    rate_hz, hours = 256.0, 1.0
    n = round(3600 * hours * rate_hz)
    frequency = np.fft.rfftfreq(n, 1.0 / rate_hz)
    spectrum = np.fft.rfft(np.random.default_rng(6).standard_normal(n))
    noise = np.fft.irfft(spectrum / np.maximum(frequency, 0.5), n)
    samples = (0.1 * noise / noise.std()).astype(np.float32)[:, None]
    blocks = compute_spectrogram(recording_of(samples, rate_hz), band_hz=(5.0, 128.0))
    lines = Lines.join(list(trace_lines(blocks)))
    first_hz = lines.frequency_hz[np.searchsorted(lines.line, lines.line_id)]
    assert np.count_nonzero(first_hz < 22.0) <= poisson.ppf(0.999, 1.5 * 0.017 * hours)


def test_the_measured_rate_is_told_for_windows_that_are_long_enough():
    noise = np.random.default_rng(4).standard_normal(60 * int(RATE_HZ))
    once, again = traced(noise), traced(noise)
    assert once.equals(again)
    assert 0.3 < once.measured_false_lines_per_khz_hour < 2.0
    brief = traced(noise[: 12 * int(RATE_HZ)])
    assert np.isnan(brief.measured_false_lines_per_khz_hour)


def test_silence_before_the_sound_and_no_numbers_at_all_are_traced():
    noise = np.random.default_rng(5).standard_normal(60 * int(RATE_HZ))
    noise[: noise.size // 2] = 0.0
    assert traced(noise).line_id.size == 0
    nothing = traced(np.full(noise.size, np.nan))
    assert nothing.line_id.size == 0
    assert np.isnan(nothing.measured_false_lines_per_khz_hour)
