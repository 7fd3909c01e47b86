"""The spectrum of the envelope: depth and rate against theory, and honest limits."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support import DIFAR, OMNI, recording_of, white_noise
from uwtrack_cli.data.spectra import MODULATION, Spectrogram
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.spectra.demon import demodulate, resolve_demon
from uwtrack_cli.spectra.peaks import find_peaks

RATE_HZ = 4000.0


def modulated(duration_s, depth, rate_hz, seed=1, fs=RATE_HZ):
    """White noise whose power is 1 + depth cos(2 pi rate t)."""
    n = round(duration_s * fs)
    power = 1.0 + depth * np.cos(2 * np.pi * rate_hz * np.arange(n) / fs)
    return white_noise(n, seed) * np.sqrt(power)


def demon(samples, sensor=OMNI, block=None, fs=RATE_HZ, **options):
    recording = recording_of(samples, fs, sensor, block)
    return Spectrogram.join(list(demodulate(recording, **options)))


def line_power(made, rate_hz):
    """Mean square at a rate above the noise beside it."""
    density = made.power_density.mean(axis=0)
    near = np.abs(made.frequency_hz - rate_hz) < 0.4
    beside = np.abs(np.abs(made.frequency_hz - rate_hz) - 1.5) < 1.0
    step = made.frequency_hz[1] - made.frequency_hz[0]
    return float((density[near] - np.median(density[beside])).sum() * step)


@pytest.mark.parametrize("rate_hz", [1.5, 9.6, 30.0])
def test_a_modulated_noise_gives_a_line_of_half_its_squared_depth(rate_hz):
    made = demon(modulated(200.0, 0.3, rate_hz))
    density = made.power_density.mean(axis=0)
    found = made.frequency_hz[np.argmax(density)]
    assert abs(found - rate_hz) <= made.frequency_hz[1] - made.frequency_hz[0]
    # a Hann window of T seconds squared passes modulation at f by its own transform
    short_s = 0.8 / 50.0
    time = (np.arange(1000) + 0.5) / 1000 - 0.5
    squared = np.cos(np.pi * time) ** 4
    passed = (squared * np.cos(2 * np.pi * rate_hz * short_s * time)).sum()
    expected = 0.5 * (0.3 * passed / squared.sum()) ** 2
    assert line_power(made, rate_hz) == pytest.approx(expected, rel=0.15)
    assert made.reference == MODULATION


@pytest.mark.parametrize("block", [777, 50_001])
@pytest.mark.parametrize("sensor", [OMNI, DIFAR], ids=["omni", "difar"])
def test_how_the_sound_is_read_changes_no_bit(block, sensor):
    width = 3 if sensor is DIFAR else 1
    samples = white_noise(40 * 4000 * width, seed=3).reshape(-1, width)
    whole = demon(samples, sensor, window_s=4.0)
    assert demon(samples, sensor, block, window_s=4.0).equals(whole)


def test_a_gain_changes_nothing_and_a_shift_moves_times_alone():
    samples = modulated(60.0, 0.5, 8.0)
    one, loud = demon(samples), demon(samples * np.float32(16.0))
    assert loud.power_density.tobytes() == one.power_density.tobytes()
    hop = one.frames.hop_samples
    later = demon(np.concatenate([white_noise(hop, 9), samples]))
    # beyond the reach of the running mean
    np.testing.assert_allclose(
        later.power_density[3:15], one.power_density[2:14], rtol=1e-3, atol=1e-6
    )


def test_the_rate_of_a_vector_sensor_has_the_bearing_of_what_turns():
    vessel, bearing = modulated(240.0, 0.8, 9.6), np.radians(250.0)
    n = vessel.size
    steady = np.radians(20.0)
    other = white_noise(n, 5)
    parts = [
        vessel + other,
        vessel * np.sin(bearing) + other * np.sin(steady),
        vessel * np.cos(bearing) + other * np.cos(steady),
    ]
    samples = np.stack(parts, 1) + 0.5 * white_noise(3 * n, 6).reshape(n, 3)
    peaks = find_peaks(demon(samples, DIFAR))
    near = np.abs(peaks.frequency_hz - 9.6) < 0.1
    angle = np.radians(peaks.bearing_deg[near])
    mean = np.degrees(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())) % 360
    # a louder steady ship from elsewhere does not turn it
    assert mean == pytest.approx(250.0, abs=6.0)
    off = (peaks.bearing_deg[near] - 250.0) / peaks.bearing_std_deg[near]
    assert np.median(np.abs(off)) < 2.0


def test_two_tones_that_beat_in_one_band_are_no_rate():
    n = round(120 * RATE_HZ)
    time = np.arange(n) / RATE_HZ
    tones = np.cos(2 * np.pi * 450 * time) + np.cos(2 * np.pi * 457.3 * time)
    noise = white_noise(n, 8)
    sound = noise + 0.3 * noise.std() * tones
    several, one = demon(sound), demon(sound, n_bands=1)
    assert line_power(several, 7.3) < 0.1 * line_power(one, 7.3)


def test_swell_is_taken_out_by_the_running_mean():
    n = round(300 * RATE_HZ)
    level_db = 6.0 * np.sin(2 * np.pi * 0.1 * np.arange(n) / RATE_HZ)
    made = demon(white_noise(n, 2) * 10 ** (level_db / 20))
    plain = demon(white_noise(n, 2))
    high = made.frequency_hz >= 0.5
    ratio = made.power_density.mean(axis=0) / plain.power_density.mean(axis=0)
    assert ratio[high].max() < 1.3


def test_missing_samples_lower_the_valid_fraction_and_stay_where_they_are():
    samples = modulated(120.0, 0.3, 9.6)
    gap = samples.copy()
    gap[200_000:220_000] = np.nan
    whole, holed = demon(samples), demon(gap)
    centre, half = holed.frames.time_s, 0.5 * holed.frames.window_s
    touched = (centre + half > 50.0) & (centre - half < 55.0)
    assert (holed.frames.valid_fraction[~touched] == 1).all()
    assert (holed.frames.valid_fraction[touched] < 1).all()
    far = (centre + half < 47.0) | (centre - half > 58.0)
    assert (holed.power_density[far] == whole.power_density[far]).all()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"band_hz": (400.0, 2500.0)}, r"reaches above 2000 Hz, all that memory.wav holds"),
        ({"band_hz": (400.0, 450.0)}, "too narrow: it must be 250 Hz wide"),
        ({"rate_hz": (0.2, 500.0), "band_hz": (400.0, 1800.0)}, "need a sample rate of"),
        ({"rate_hz": (10.0, 10.2)}, "at least 8 are needed"),
        ({"band_hz": (1800.0, 400.0)}, "increasing"),
    ],
)
def test_what_does_not_fit_the_sound_is_refused_in_a_sentence(options, text):
    with pytest.raises(OptionError, match=text):
        demodulate(recording_of(white_noise(80_000, 1), RATE_HZ), **options)


def test_a_window_longer_than_the_sound_is_refused_with_the_remedy():
    with pytest.raises(DataError, match=r"lasts 20 s, less than one window of 30 s"):
        demodulate(recording_of(white_noise(80_000, 1), RATE_HZ), window_s=30.0)


@pytest.mark.parametrize(
    ("duration_s", "fs", "why"),
    [(2.0, 4000.0, "lasts 2 s, .* need 3 s"), (60.0, 100.0, "need 1000 Hz or more")],
)
def test_a_recording_without_room_for_rates_has_no_frame_and_says_so(duration_s, fs, why):
    recording = recording_of(white_noise(round(duration_s * fs), 1), fs)
    with pytest.warns(UwtrackWarning, match=why):
        (block,) = demodulate(recording)
    assert block.frames.n_frames == 0
    assert find_peaks(block).frame.size == 0


def test_the_overlap_is_as_stated_in_a_short_recording():
    """`trace` knows the noise of that overlap alone."""
    made = demon(white_noise(3 * 4000, 1))
    assert made.frames.window_samples == 4 * made.frames.hop_samples


def test_the_band_and_the_window_follow_the_recording():
    recording = recording_of(white_noise(48_000, 1), 2000.0)
    open_options = {"band_hz": None, "window_s": None, "rate_hz": (0.2, 50.0), "decimation": None}
    found = resolve_demon(recording, open_options)
    assert found == {"band_hz": (225.0, 900.0), "window_s": 8.0, "decimation": 1}
    fast = replace(recording, sample_rate_hz=96_000.0)
    found = resolve_demon(fast, open_options)
    assert (found["band_hz"], found["decimation"]) == ((400.0, 8000.0), 4)
