"""The spectrogram against scipy's Welch, and the laws of a streaming stage."""

import numpy as np
import pytest
from scipy.signal import welch

from tests.support import DIFAR, recording_of, white_noise
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 2000.0


def spectrogram(samples, sensor=None, block=None, rate_hz=RATE_HZ, **options):
    recording = recording_of(samples, rate_hz, sensor or Sensor(id="h1"), block)
    return Spectrogram.join(list(compute_spectrogram(recording, **options)))


@pytest.mark.parametrize("zero_padding", [1, 2], ids=["natural", "padded"])
@pytest.mark.parametrize("overlap", [0.5, 0.75])
def test_mean_density_of_noise_is_welchs(zero_padding, overlap):
    samples = white_noise(40_000, seed=1, rate_hz=RATE_HZ).astype(np.float32)
    made = spectrogram(samples, zero_padding=zero_padding, overlap=overlap)
    window = int(RATE_HZ)
    frequency, expected = welch(
        samples.astype(float), RATE_HZ, nperseg=window, detrend=False,
        noverlap=round(window * overlap), nfft=window * zero_padding,
    )  # fmt: skip
    np.testing.assert_allclose(made.frequency_hz, frequency)
    mean = made.power_density.astype(float).mean(axis=0)
    np.testing.assert_allclose(mean, expected, rtol=1e-5)


def test_density_of_a_strong_tone_is_welchs_to_a_millionth_of_its_peak():
    time = np.arange(20_000) / RATE_HZ
    samples = np.sin(2 * np.pi * 123.4 * time).astype(np.float32)
    made = spectrogram(samples, zero_padding=1)
    _, expected = welch(samples.astype(float), RATE_HZ, nperseg=2000, noverlap=1000, detrend=False)
    mean = made.power_density.astype(float).mean(axis=0)
    assert np.max(np.abs(mean - expected)) < 1e-6 * expected.max()


def test_density_integrates_to_the_mean_square():
    samples = white_noise(60_000, seed=2, density=3.0, rate_hz=RATE_HZ)
    made = spectrogram(samples)
    power = made.power_density.sum(axis=1).mean() * made.frames.bin_hz
    assert power == pytest.approx(np.mean(samples**2), rel=0.02)


@pytest.mark.parametrize("block", [777, 4001, 100_000])
@pytest.mark.parametrize("decimation", [1, 4])
def test_how_the_sound_is_read_changes_no_bit(block, decimation):
    samples = white_noise(3 * 50_000, seed=3).reshape(-1, 3)
    options = {"decimation": decimation, "window_s": 0.25}
    whole = spectrogram(samples, DIFAR, **options)
    assert spectrogram(samples, DIFAR, block, **options).equals(whole)


def test_decimation_keeps_the_density_in_its_pass_band():
    samples = white_noise(400_000, seed=4, density=2.0, rate_hz=16_000.0)
    made = spectrogram(samples, rate_hz=16_000.0, decimation=8, window_s=0.5)
    kept = made.frequency_hz < 0.8 * 1000.0
    assert made.power_density[:, kept].mean() == pytest.approx(2.0, rel=0.02)
    assert made.frames.sample_rate_hz == 16_000.0
    assert made.frames.time_s[0] == pytest.approx(0.25)


def test_intensity_points_to_the_source():
    rng = np.random.default_rng(5)
    sound, bearing = rng.standard_normal(20_000), np.radians(250.0)
    samples = np.stack([sound, sound * np.sin(bearing), sound * np.cos(bearing)], 1)
    made = spectrogram(samples, DIFAR)
    angle = np.degrees(np.arctan2(made.intensity_east, made.intensity_north)) % 360
    np.testing.assert_allclose(angle, 250.0, atol=0.01)


@pytest.mark.parametrize(
    ("sensor", "expected_deg"),
    [
        (Sensor(id="a", kind="difar", channels="omni,x,y", heading_deg=30.0), 70.0),
        (Sensor(id="a", kind="difar", channels="omni,east,north", compass_offset_deg=5.0), 45.0),
        (
            Sensor(
                id="a",
                kind="difar",
                channels="omni,x,y",
                navigation=Navigation(
                    time_s=[0.0, 100.0],
                    east_m=[0.0, 0.0],
                    north_m=[0.0, 0.0],
                    heading_deg=[350.0, 350.0],
                ),
            ),
            30.0,
        ),
    ],
    ids=["heading", "compass", "navigation"],
)
def test_axes_are_turned_to_north_where_bearings_are_made(sensor, expected_deg):
    rng = np.random.default_rng(6)
    sound, bearing = rng.standard_normal(8_000), np.radians(40.0)
    samples = np.stack([sound, sound * np.sin(bearing), sound * np.cos(bearing)], 1)
    made = spectrogram(samples, sensor)
    angle = np.degrees(np.arctan2(made.intensity_east, made.intensity_north)) % 360
    np.testing.assert_allclose(angle, expected_deg, atol=0.01)


def test_missing_samples_lower_the_valid_fraction_and_nothing_else():
    samples = white_noise(20_000, seed=7, rate_hz=RATE_HZ)
    gap = samples.copy()
    gap[10_000:12_000] = np.nan
    whole, holed = spectrogram(samples), spectrogram(gap)
    touched = (holed.frames.start_sample + 2000 > 10_000) & (holed.frames.start_sample < 12_000)
    assert np.isfinite(holed.power_density).all()
    assert (holed.frames.valid_fraction[touched] < 1).all()
    assert holed.frames.valid_fraction.min() == 0.0
    np.testing.assert_array_equal(holed.power_density[~touched], whole.power_density[~touched])


def test_calibration_scales_to_micropascal():
    sensor = Sensor(id="a", sensitivity_db_re_v_per_upa=-160.0, gain_db=20.0, adc_peak_v=1.0)
    samples = white_noise(20_000, seed=8, rate_hz=RATE_HZ)
    calibrated, raw = spectrogram(samples, sensor), spectrogram(samples)
    ratio = calibrated.power_density.sum(axis=1) / raw.power_density.sum(axis=1)
    np.testing.assert_allclose(10 * np.log10(ratio), 140.0, atol=1e-4)
    assert spectrogram(samples, sensor).reference == "1 uPa"


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"window_s": 100.0}, DataError, "less than one window"),
        ({"window_s": 0.001}, OptionError, "at least 16"),
        ({"window_s": 1e308}, OptionError, r"window_s .*at most 3600\)"),
        ({"decimation": 2**63}, OptionError, "beyond 64 bits"),
        ({"overlap": 1.0}, OptionError, "overlap must be"),
        ({"zero_padding": 0}, OptionError, r"zero_padding .*at least 1, at most 8\), got 0"),
        ({"band_hz": (900.0, 100.0)}, OptionError, "band_hz must be increasing"),
        ({"band_hz": (5000.0, 6000.0)}, OptionError, "highest"),
        ({"decimation": 0}, OptionError, "decimation must be"),
    ],
)
def test_options_out_of_range_are_named_with_what_is_accepted(options, error, text):
    with pytest.raises(error, match=text):
        spectrogram(white_noise(8_000, seed=9), **options)
