"""Bands that are cut out of sound: a tone is what it was, and what is beside stays out."""

import numpy as np
import pytest

from tests.support import white_noise
from uwtrack_cli.estimation.narrow_bands import narrow_bands

RATE_HZ, LENGTH_S = 800.0, 60.0
TIME = np.arange(int(LENGTH_S * RATE_HZ)) / RATE_HZ


def cut(sound, centre_hz, half_hz, block=5000):
    blocks = np.split(sound.astype(np.float32), range(block, sound.size, block))
    return narrow_bands(blocks, RATE_HZ, np.array(centre_hz), np.array(half_hz))


@pytest.mark.parametrize("centre_hz", [100.2, 31.7, 333.3])
def test_a_tone_keeps_height_and_phase_and_loses_the_frequency_of_the_band(centre_hz):
    sound = 3.0 + 2.0 * np.cos(2 * np.pi * (centre_hz + 0.5) * TIME + 0.3)
    bands = cut(sound, [centre_hz, 200.0], [12.0, 5.0])
    assert [band.centre_hz for band in bands] == [centre_hz, 200.0]
    for band, half_hz in zip(bands, (12.0, 5.0), strict=True):
        assert band.rate_hz == pytest.approx(2 * half_hz, rel=0.02)
        assert band.sound.size == pytest.approx(LENGTH_S * band.rate_hz, abs=1.0)
    own_s = np.arange(bands[0].sound.size) / bands[0].rate_hz
    turned = bands[0].sound * np.exp(-2j * np.pi * 0.5 * own_s - 0.3j)
    np.testing.assert_allclose(turned[24:-24], 2.0, atol=0.01)
    # what the tone's begin and end spill over, and nothing of the offset
    assert np.abs(bands[1].sound[10:-10]).max() < 0.002


def test_noise_keeps_its_density():
    sound = white_noise(TIME.size, 1, density=2.0, rate_hz=RATE_HZ)
    (band,) = cut(sound, [150.0], [20.0])
    power = np.abs(np.fft.fft(band.sound)) ** 2 / band.sound.size / band.rate_hz
    inner = np.abs(np.fft.fftfreq(band.sound.size)) < 0.4
    # an analytic signal has twice the density of what is real, on one side
    assert power[inner].mean() == pytest.approx(4.0, rel=0.05)


def test_blocks_change_no_bit():
    sound = white_noise(TIME.size, 2)
    whole = cut(sound, [60.0, 90.0], [3.0, 8.0], block=sound.size - 1)
    parts = cut(sound, [60.0, 90.0], [3.0, 8.0], block=777)
    for one, other in zip(whole, parts, strict=True):
        assert one.sound.tobytes() == other.sound.tobytes()


def test_a_band_may_reach_beyond_zero_and_beyond_the_sound():
    sound = np.cos(2 * np.pi * 2.0 * TIME) + np.cos(2 * np.pi * 398.0 * TIME)
    for band in cut(sound, [3.0, 397.0], [10.0, 10.0]):
        off_hz = -1.0 if band.centre_hz < 100.0 else 1.0
        own_s = np.arange(band.sound.size) / band.rate_hz
        turned = band.sound * np.exp(-2j * np.pi * off_hz * own_s)
        assert abs(turned[40:-40].mean()) == pytest.approx(1.0, abs=0.02)
