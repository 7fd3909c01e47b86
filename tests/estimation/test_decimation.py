"""Decimation: what passes, what folds, when it happened, and no influence of blocks."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support import recording_of, white_noise
from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.estimation.decimation import (
    PASS_SHARE,
    Decimator,
    decimated_blocks,
    decimated_stretch,
    usual_decimation,
)

FACTORS = [2, 3, 4, 8, 12, 32]


def decimated(samples, factor, block=1 << 18):
    samples = np.asarray(samples, np.float32).reshape(len(samples), -1)
    decimator = Decimator(factor)
    parts = [
        decimator.feed(samples[first : first + block]) for first in range(0, len(samples), block)
    ]
    return np.concatenate([*parts, decimator.finish(samples.shape[1])])


def tone(cycles_per_sample, n_samples):
    return np.cos(2 * np.pi * cycles_per_sample * np.arange(n_samples))


@pytest.mark.parametrize("factor", FACTORS)
def test_tones_of_the_pass_band_keep_level_and_time(factor):
    for share in (0.0, 0.1, 0.5, 0.7, PASS_SHARE):
        n_samples = 400 * factor
        made = decimated(tone(share / (2 * factor), n_samples), factor)[:, 0]
        expected = tone(share / 2, n_samples // factor)
        assert made.size == expected.size
        inner = slice(60, -60)
        # 0.05 dB are 0.6 % of the amplitude
        np.testing.assert_allclose(made[inner], expected[inner], atol=1e-3)


@pytest.mark.parametrize("factor", FACTORS)
def test_what_folds_into_the_pass_band_is_eighty_decibels_down(factor):
    n_samples = 600 * factor
    for image in range(1, factor // 2 + 1):
        for share in (-PASS_SHARE, -0.3, 0.01, 0.4, PASS_SHARE):
            shifted = (2 * image + share) / (2 * factor)
            made = decimated(tone(shifted, n_samples), factor)[60:-60, 0]
            assert 10 * np.log10(2 * np.mean(made**2)) < -80.0


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("n_channels", [1, 3])
def test_blocks_change_no_bit(factor, n_channels):
    samples = white_noise(30_011 * n_channels, 3).reshape(-1, n_channels)
    whole = decimated(samples, factor)
    assert len(whole) == 30_011 // factor
    for block in (1, 777, 4096):
        if block == 1:
            few = samples[:3000]
            assert decimated(few, factor, 1).tobytes() == decimated(few, factor).tobytes()
        else:
            assert decimated(samples, factor, block).tobytes() == whole.tobytes()


def test_channels_do_not_touch_each_other():
    samples = white_noise(20_000, 4).reshape(-1, 2)
    both = decimated(samples, 8)
    for k in range(2):
        assert both[:, k].tobytes() == decimated(samples[:, k], 8)[:, 0].tobytes()


def test_a_lost_sample_takes_along_what_is_made_of_it_and_no_more():
    samples = white_noise(80_000, 5)
    holed = samples.copy()
    holed[40_000:48_000] = np.nan
    whole, found = decimated(samples, 8)[:, 0], decimated(holed, 8)[:, 0]
    is_lost = np.isnan(found)
    assert is_lost[5000:6000].all()
    assert 1000 <= is_lost.sum() < 1000 + 2 * 20
    np.testing.assert_array_equal(found[~is_lost], whole[~is_lost])


def test_sound_that_does_not_change_stays_the_same_everywhere():
    made = decimated(np.full(40_000, 0.3), 8)[40:-40]
    assert np.ptp(made) == 0.0
    assert made[0, 0] == pytest.approx(0.3, rel=1e-4)


@pytest.mark.parametrize(
    ("rate_hz", "highest_hz", "factor"),
    [
        (4000.0, 2000.0, 1),  # reaches up to the Nyquist frequency
        (4000.0, 10.0, 1),
        (8000.0, 800.0, 1),
        (19_999.0, 2000.0, 1),
        (20_000.0, 2000.0, 2),
        (20_000.0, 4000.0, 2),
        (20_000.0, 4000.1, 1),  # just above 0.8 of 5 kHz
        (96_000.0, 2000.0, 8),
        (96_000.0, 4800.0, 8),
        (96_000.0, 4801.0, 4),
        (576_000.0, 4000.0, 32),
        (96_000.0, None, 1),
        (96_000.0, 60_000.0, 1),
    ],
)
def test_a_band_decides_how_far_the_rate_is_reduced(rate_hz, highest_hz, factor):
    assert usual_decimation(rate_hz, highest_hz) == factor


def test_a_stretch_that_is_read_again_is_the_sound_of_that_time_without_its_offset():
    samples = white_noise(50_000, 6)[:, None].astype("f4") + np.float32(30.0)
    recording = replace(recording_of(samples, 1000.0), reader=HeldSamples(samples))
    whole = np.concatenate(list(decimated_blocks(recording.reader, 4, 999)))[:, 0]
    found = decimated_stretch(recording, 10.001, 30.0, 4)
    assert (found.rate_hz, found.start_s) == (250.0, 10.004)
    sound = np.concatenate(list(found.blocks))
    assert len(sound) == (30_000 - 10_004) // 4
    expected = whole[2501:7500] - samples[10_004:30_000].mean()
    np.testing.assert_allclose(sound[40:-40], expected[40:-40], atol=1e-3)
    assert np.abs(sound[:40]).max() < 6 * sound.std()  # nothing jumps at its begin
