"""The image of fringes: density of noise and tones, blocks, gaps, bands."""

import numpy as np
import pytest

from tests.support import recording_of, white_noise
from uwtrack_cli.data.fringes import MIDDLE, STEP_DB, Fringes
from uwtrack_cli.spectra.fringes import measure_fringes
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 8000.0


def spectra_of(samples, rate_hz=RATE_HZ):
    recording = recording_of(samples, rate_hz)
    return list(compute_spectrogram(recording, window_s=0.5, zero_padding=1))


def image_of(blocks, **options):
    return Fringes.join(list(measure_fringes(iter(blocks), **options)))


def test_white_noise_has_its_density_in_every_cell():
    made = image_of(spectra_of(white_noise(480_000, 1, density=3.0, rate_hz=RATE_HZ)))
    step = np.diff(np.log2(made.frequency_hz))
    np.testing.assert_allclose(step, 1.0 / 64.0)
    assert made.frequency_hz[-1] < 0.44 * RATE_HZ
    octave = np.log2(made.frequency_hz)
    line = made.level_db[:, None] + made.slope_db[:, None] * (octave - octave.mean())
    level = line + STEP_DB * (made.shade.astype(float) - MIDDLE)
    density = (10.0 ** (0.1 * level)).mean(axis=0)
    # about the fourth root of the independent values of each cell, over two minutes
    assert np.abs(density / 3.0 - 1.0).max() < 0.45
    assert density[200:].mean() == pytest.approx(3.0, rel=0.02)


def test_a_tone_stands_in_its_cell():
    time = np.arange(int(RATE_HZ) * 20) / RATE_HZ
    noise = white_noise(time.size, 2, rate_hz=RATE_HZ)
    made = image_of(spectra_of(noise + 5.0 * np.sin(2 * np.pi * 1003.0 * time)))
    brightest = made.frequency_hz[np.argmax(made.shade.mean(axis=0))]
    assert brightest == pytest.approx(1003.0, rel=2.0 ** (1 / 64) - 1.0)


def test_blocks_change_no_bit():
    blocks = spectra_of(white_noise(int(RATE_HZ) * 61, 3, rate_hz=RATE_HZ))
    cut = [b.take("frame", slice(k, k + 3)) for b in blocks for k in range(0, 999, 3)]
    whole, parts = image_of(blocks), image_of([b for b in cut if b.frames.n_frames])
    for name in Fringes.columns():
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_a_gap_has_no_sound_and_no_neighbour():
    samples = white_noise(int(RATE_HZ) * 30, 4, rate_hz=RATE_HZ)
    samples[int(10.2 * RATE_HZ) : int(11.4 * RATE_HZ)] = np.nan
    made = image_of(spectra_of(samples))
    is_silent = (made.shade == 0).all(axis=1)
    assert (is_silent == (made.shade == 0).any(axis=1)).all()
    assert np.isnan(made.level_db[is_silent]).all()
    assert 9.0 < made.time_s[is_silent].min() < 10.3
    assert 11.3 < made.time_s[is_silent].max() < 12.5


def test_a_recording_below_the_band_has_rows_without_cells():
    made = image_of(spectra_of(white_noise(12_000, 5, rate_hz=200.0), 200.0))
    assert made.time_s.size
    assert made.shade.shape[1] == 0
