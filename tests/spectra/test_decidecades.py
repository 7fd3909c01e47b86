"""Decidecade levels: bands of the standard, power of noise and tones, blocks, gaps."""

import numpy as np
import pytest

from tests.support import recording_of, white_noise
from uwtrack_cli.data.decidecades import Decidecades
from uwtrack_cli.errors import DataError
from uwtrack_cli.spectra.decidecades import measure_decidecades
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 4000.0
NOMINAL = (16, 20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250, 315, 400, 500, 630,
           800, 1000, 1250, 1600)  # fmt: skip
"""IEC 61260-1, table E.1, as far as the spectrogram reaches."""


def levels_of(samples, average_s=1.0, **options):
    blocks = compute_spectrogram(recording_of(samples, RATE_HZ), **options)
    return Decidecades.join(list(measure_decidecades(blocks, average_s=average_s)))


def test_bands_are_those_of_the_standard():
    made = levels_of(white_noise(40_000, 1, rate_hz=RATE_HZ), band_hz=(13.5, 2000.0))
    np.testing.assert_allclose(made.centre_hz, NOMINAL, rtol=0.02)


def test_white_noise_has_its_power_in_each_band():
    noise = white_noise(int(RATE_HZ) * 300, 2, density=3.0, rate_hz=RATE_HZ)
    made = levels_of(noise, average_s=10.0)
    width = made.centre_hz * (10**0.05 - 10**-0.05)
    expected = 10.0 * np.log10(3.0 * width)
    scatter = 10.0 / np.log(10.0) / np.sqrt(width * 300.0)
    mean = 10.0 * np.log10(np.mean(10.0 ** (0.1 * made.level_db.astype(float)), axis=0))
    assert np.abs((mean - expected) / scatter).max() < 4.0


def test_a_tone_is_in_its_band_alone_with_its_mean_square():
    time = np.arange(int(RATE_HZ) * 20) / RATE_HZ
    made = levels_of(8.0 * np.sin(2 * np.pi * 503.0 * time))
    level = made.level_db.mean(axis=0)
    at = np.argmin(np.abs(made.centre_hz - 500.0))
    assert level[at] == pytest.approx(10.0 * np.log10(32.0), abs=0.01)
    assert np.delete(level, at).max() < level[at] - 40.0


@pytest.mark.parametrize("average_s", [0.5, 1.0, 7.0])
def test_blocks_have_no_influence(average_s):
    noise = white_noise(int(RATE_HZ) * 60, 3, rate_hz=RATE_HZ)
    block = list(compute_spectrogram(recording_of(noise, RATE_HZ)))
    cut = [one.take("frame", slice(k, k + 3)) for one in block for k in range(0, 999, 3)]
    cut = [one for one in cut if one.frames.n_frames]
    whole, parts = (
        Decidecades.join(list(measure_decidecades(iter(b), average_s=average_s)))
        for b in (block, cut)
    )
    np.testing.assert_allclose(parts.time_s, whole.time_s)
    np.testing.assert_allclose(parts.level_db, whole.level_db, atol=1e-4)
    np.testing.assert_allclose(np.diff(whole.time_s)[:-1], average_s)


def test_missing_samples_are_not_counted():
    noise = white_noise(int(RATE_HZ) * 30, 4, rate_hz=RATE_HZ)
    noise[int(RATE_HZ) * 10 : int(RATE_HZ) * 14] = np.nan
    made = levels_of(noise)
    lost = (made.time_s > 10.8) & (made.time_s < 13.2)
    assert np.isnan(made.level_db[lost]).all()
    assert np.isfinite(made.level_db[~lost & (made.time_s < 9)]).all()


def test_a_spectrogram_without_a_whole_band_is_refused():
    with pytest.raises(DataError, match="holds no decidecade band"):
        levels_of(white_noise(40_000, 1, rate_hz=RATE_HZ), band_hz=(100.0, 110.0))
