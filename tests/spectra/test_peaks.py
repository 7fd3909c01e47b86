"""Peaks: false-alarm rate on noise, frequencies at the table's accuracy, bearings."""

import numpy as np
import pytest

from tests.support import DIFAR, recording_of, white_noise
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.estimation.noise_floor import noise_floor
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram


def blocks_of(samples, rate_hz, sensor=None, **options):
    recording = recording_of(samples, rate_hz, *([sensor] if sensor else []))
    return list(compute_spectrogram(recording, **options))


@pytest.mark.parametrize("probability", [1e-2, 1e-3, 1e-4])
def test_noise_exceeds_the_threshold_as_often_as_stated_in_ten_million_cells(probability):
    n_exceeding = n_cells = 0
    for seed in range(2):
        samples = white_noise(4000 * 640, seed)
        for block in blocks_of(samples, 4000.0):
            peaks = find_peaks(block, false_alarm_probability=probability, kept_probability=0.01)
            floor = noise_floor(block.power_density, block.frames.valid_fraction, zero_padding=2)
            factor = 10 ** (peaks.frames.threshold_db / 10)
            exceeding = block.power_density > floor * factor[:, None]
            n_exceeding += exceeding[:, 1:-1].sum()
            n_cells += exceeding[:, 1:-1].size
    assert n_cells > 1e7
    assert n_exceeding / n_cells == pytest.approx(probability, rel=0.1)


SINGLE_FRAME_RMSE = {6: 1.74, 10: 1.72, 15: 1.60, 20: 1.55, 30: 1.56, 40: 1.54}
"""RMSE over the bound of the best Hann estimator, by C/N0 in dB over one second
(the maximum of the transform; 4000 trials each)."""


@pytest.mark.parametrize("cn0_db", list(SINGLE_FRAME_RMSE)[::2])
def test_frequency_error_is_within_five_percent_of_the_best_hann_estimator(cn0_db):
    rng = np.random.default_rng(cn0_db)
    rate, n_trials = 1024, 6000
    amplitude = np.sqrt(2 * 10 ** (cn0_db / 10))
    time = (np.arange(rate) - rate / 2) / rate
    errors, deviations = [], []
    for _ in range(n_trials // 500):
        frequency = 200 + rng.uniform(0, 1, 500)
        phase = rng.uniform(0, 2 * np.pi, 500)
        tones = amplitude * np.cos(2 * np.pi * frequency[:, None] * time + phase[:, None])
        noise = rng.standard_normal(tones.shape) * np.sqrt(rate / 2)
        (block,) = [Spectrogram.join(blocks_of((tones + noise).ravel(), float(rate), overlap=0.0))]
        peaks = find_peaks(block, kept_probability=0.5, false_alarm_probability=0.5)
        truth = frequency[peaks.frame]
        near = np.abs(peaks.frequency_hz - truth) < 2.5
        order = np.argsort(-peaks.level_db[near], kind="stable")
        row, first = np.unique(peaks.frame[near][order], return_index=True)
        error = peaks.frequency_hz[near][order][first] - frequency[row]
        kept = np.abs(error) < 1
        errors.append(error[kept])
        deviations.append(peaks.frequency_std_hz[near][order][first][kept])
    error, deviation = np.concatenate(errors), np.concatenate(deviations)
    bound = 0.390 / np.sqrt(10 ** (cn0_db / 10))
    scatter = 3 / np.sqrt(2 * error.size)
    ratio = np.sqrt(np.mean(error**2)) / bound
    assert ratio < 1.05 * SINGLE_FRAME_RMSE[cn0_db] * (1 + scatter)
    assert np.sqrt(np.mean((error / deviation) ** 2)) == pytest.approx(1.0, abs=0.12)


def test_level_and_snr_of_a_tone_are_those_it_was_made_with():
    rate = 2000.0
    time = np.arange(int(rate) * 64) / rate
    tone = 3.0 * np.sin(2 * np.pi * 300.3 * time)
    samples = tone + white_noise(time.size, 3, density=1e-2, rate_hz=rate)
    peaks = Peaks.join([find_peaks(b) for b in blocks_of(samples, rate)])
    line = np.abs(peaks.frequency_hz - 300.3) < 1
    assert np.median(peaks.level_db[line]) == pytest.approx(10 * np.log10(4.5), abs=0.1)
    assert np.median(peaks.snr_db[line]) == pytest.approx(10 * np.log10(4.5 / 1.5e-2), abs=0.3)
    assert peaks.is_detection[line].all()


def test_bearing_deviation_of_a_tone_in_isotropic_noise_is_the_stated_one():
    rate, bearing = 1000.0, np.radians(70.0)
    time = np.arange(int(rate) * 600) / rate
    tone = np.sin(2 * np.pi * 200.25 * time)
    noise = [white_noise(time.size, s, density=0.02, rate_hz=rate) for s in range(3)]
    samples = np.stack(
        [
            tone + noise[0],
            tone * np.sin(bearing) + noise[1] / np.sqrt(3),
            tone * np.cos(bearing) + noise[2] / np.sqrt(3),
        ],
        axis=1,
    )
    peaks = Peaks.join([find_peaks(b) for b in blocks_of(samples, rate, DIFAR)])
    line = np.abs(peaks.frequency_hz - 200.25) < 0.6
    error = (peaks.bearing_deg[line] - 70.0) / peaks.bearing_std_deg[line]
    assert line.sum() > 1000
    assert np.sqrt(np.mean(error**2)) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("apart_deg", [40.0, 90.0, 180.0])
@pytest.mark.parametrize("snr_db", [12.0, 20.0])
def test_broadband_of_another_vessel_does_not_pull_a_bearing(apart_deg, snr_db):
    rate, ambient, other = 1000.0, 0.02, 0.04
    line_deg = np.radians([70.0, 70.0 + apart_deg])
    time = np.arange(int(rate) * 400) / rate
    noise = [white_noise(time.size, s, density=ambient, rate_hz=rate) for s in range(3)]
    ship = white_noise(time.size, 5, density=other, rate_hz=rate)
    power = (ambient + other) * 1.5 * 10 ** (snr_db / 10)
    tone = np.sqrt(2 * power) * np.sin(2 * np.pi * 200.25 * time)
    samples = np.stack(
        [
            tone + ship + noise[0],
            tone * np.sin(line_deg[0]) + ship * np.sin(line_deg[1]) + noise[1] / np.sqrt(3),
            tone * np.cos(line_deg[0]) + ship * np.cos(line_deg[1]) + noise[2] / np.sqrt(3),
        ],
        axis=1,
    )
    peaks = Peaks.join([find_peaks(b) for b in blocks_of(samples, rate, DIFAR)])
    line = np.abs(peaks.frequency_hz - 200.25) < 0.6
    error = (peaks.bearing_deg[line] - 70.0 + 180.0) % 360.0 - 180.0
    pull_deg = np.degrees(other / (ambient + other) / 10 ** (snr_db / 10))
    weight = peaks.bearing_std_deg[line] ** -2.0
    mean = (weight * error).sum() / weight.sum()
    scatter = error.std() / np.sqrt(line.sum() / 2)
    assert line.sum() > 700
    assert abs(mean) < 0.15 * pull_deg + 3 * scatter
    error = error / peaks.bearing_std_deg[line]
    assert 0.4 < np.sqrt(np.mean(error**2)) < 1.45  # the angle is not looked at


def test_a_gain_shifts_levels_only():
    samples = white_noise(40_000, 5, rate_hz=2000.0)
    first, second = (
        Peaks.join([find_peaks(b) for b in blocks_of(samples * gain, 2000.0)])
        for gain in (1.0, 4.0)
    )
    np.testing.assert_allclose(first.frequency_hz, second.frequency_hz, rtol=1e-12)
    np.testing.assert_allclose(second.level_db - first.level_db, 12.0412, atol=1e-4)
    np.testing.assert_allclose(first.snr_db, second.snr_db, atol=1e-4)


def test_silence_and_gaps_have_no_peaks():
    samples = np.zeros(40_000)
    samples[10_000:30_000] = np.nan
    made = Peaks.join([find_peaks(b) for b in blocks_of(samples, 2000.0)])
    assert made.frequency_hz.size == 0


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"false_alarm_probability": 0.0}, r"at least 1e-09, at most 0\.5\), got 0"),
        ({"kept_probability": 1e-6}, "at least false_alarm_probability"),
        ({"dipole_noise_ratio": -1.0}, "dipole_noise_ratio must be"),
        ({"dipole_noise_ratio": np.nan}, "dipole_noise_ratio must be"),
        ({"band_hz": (3000.0, 4000.0)}, "reaches 0 to 1000 Hz"),
    ],
)
def test_options_out_of_range_are_named(options, text):
    (block,) = blocks_of(white_noise(8_000, 1), 2000.0)
    with pytest.raises(OptionError, match=text):
        find_peaks(block, **options)
