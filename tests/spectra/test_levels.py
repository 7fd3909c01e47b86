"""Levels and bearings: stated deviations, whitening, robustness to lines, laws."""

import numpy as np
import pytest

from tests.support import DIFAR, OMNI, recording_of, white_noise
from uwtrack_cli.data.spectra import Levels, Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.spectra.levels import MeasuredLevels, measure_levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 2000.0


def levels_of(samples, sensor=OMNI, **options):
    blocks = compute_spectrogram(recording_of(samples, RATE_HZ, sensor))
    options.setdefault("band_hz", (100.0, 900.0))
    return Levels.join(list(measure_levels(blocks, **options)))


def test_level_is_the_power_in_the_band_and_its_deviation_is_the_stated_one():
    made = levels_of(white_noise(int(RATE_HZ) * 400, 1, density=2.0, rate_hz=RATE_HZ))
    expected_db = 10 * np.log10(2.0 * 800.0)
    assert made.level_db.mean() == pytest.approx(expected_db, abs=0.03)
    scatter = made.excess_db.std() / made.excess_std_db.mean()
    assert scatter == pytest.approx(1.0, abs=0.1)
    assert abs(made.excess_db.mean()) < 0.5


def test_lines_do_not_raise_the_level():
    samples = white_noise(int(RATE_HZ) * 100, 2, rate_hz=RATE_HZ)
    time = np.arange(samples.size) / RATE_HZ
    lines = sum(30 * np.sin(2 * np.pi * f * time) for f in range(120, 900, 60))
    quiet, loud = levels_of(samples), levels_of(samples + lines)
    assert np.abs(quiet.level_db.mean() - loud.level_db.mean()) < 0.2


def test_bearing_and_its_deviation_hold_in_isotropic_noise():
    rng = np.random.default_rng(3)
    n, bearing = int(RATE_HZ) * 600, np.radians(300.0)
    sound = rng.standard_normal(n) * 0.5
    noise = rng.standard_normal((n, 3)) / np.sqrt([1.0, 3.0, 3.0])
    samples = noise + sound[:, None] * [1.0, np.sin(bearing), np.cos(bearing)]
    made = levels_of(samples, DIFAR)
    error = (made.bearing_deg - 300.0) / made.bearing_std_deg
    assert abs(error.mean()) < 4 / np.sqrt(error.size / 1.3)
    assert error.std() == pytest.approx(1.0, abs=0.1)


def test_excess_follows_a_passage_in_colored_noise():
    from scipy.signal import lfilter

    n = int(RATE_HZ) * 600
    time = np.arange(n) / RATE_HZ
    ambient = lfilter([1.0], [1.0, -0.97], white_noise(n, 4, rate_hz=RATE_HZ))
    level = 1.0 / np.sqrt(1.0 + ((time - 300.0) / 20.0) ** 2)
    samples = ambient + 3.0 * level * lfilter(
        [1.0], [1.0, -0.97], white_noise(n, 5, rate_hz=RATE_HZ)
    )
    made = levels_of(samples)
    expected = 10 * np.log10(1 + 9.0 / (1 + ((made.frames.time_s - 300) / 20) ** 2))
    quiet_error = made.excess_db - expected
    assert quiet_error.std() < 0.4
    assert abs(quiet_error.mean()) < 0.6


@pytest.mark.parametrize("n_frames", [16, 48, 2000])
def test_blocks_change_no_bit(n_frames):
    samples = white_noise(3 * int(RATE_HZ) * 200, 6).reshape(-1, 3)
    blocks = list(compute_spectrogram(recording_of(samples, RATE_HZ, DIFAR)))
    whole = Spectrogram.join(blocks)
    n = whole.frames.n_frames
    cut = [whole.take("frame", slice(k, k + n_frames)) for k in range(0, n, n_frames)]
    options = {"band_hz": (100.0, 900.0)}
    first = Levels.join(list(measure_levels(iter(cut), **options)))
    assert first.equals(Levels.join(list(measure_levels(iter([whole]), **options))))
    assert first.frames.equals(whole.frames)


def test_what_is_known_so_far_is_what_the_end_would_give():
    """With tiles that wait, and with some that have left with both sides known."""
    options = {"band_hz": (50.0, 400.0), "n_bands": 4}
    recording = recording_of(white_noise(80 * 64 * 400, 3, rate_hz=1000.0), 1000.0)
    blocks = list(compute_spectrogram(recording, window_s=0.8))
    parts = [b.take("frame", slice(k, k + 100)) for b in blocks
             for k in range(0, b.frames.n_frames, 100)]  # fmt: skip
    scan = measure_levels(iter(parts), **options)
    assert isinstance(scan, MeasuredLevels)
    assert scan.so_far(0.0) is None
    scan.remember(1e9)
    for n_parts, _ in zip(range(1, len(parts) + 1), scan, strict=False):
        if n_parts in {1, 7, len(parts)}:
            end = Levels.join(list(measure_levels(iter(parts[:n_parts]), **options)))
            assert scan.so_far(-np.inf).equals(end)
    part = scan.so_far(1900.0)
    first = int(np.searchsorted(end.frames.time_s, part.frames.time_s[0]))
    assert part.equals(end.take("frame", slice(first, None)))
    assert part.frames.time_s[0] <= 1900.0 < part.frames.time_s[64]


def test_one_block_comes_out_for_each_that_goes_in_before_the_rest():
    samples = white_noise(int(RATE_HZ) * 500, 7)
    blocks = list(compute_spectrogram(recording_of(samples, RATE_HZ)))
    made = list(measure_levels(iter(blocks), band_hz=(100.0, 900.0)))
    assert len(made) == len(blocks) + 1


def test_a_gap_is_nan_and_not_a_level():
    samples = white_noise(int(RATE_HZ) * 100, 8)
    samples[40_000:60_000] = np.nan
    made = levels_of(samples)
    gone = made.frames.valid_fraction < 0.5
    assert gone.any()
    np.testing.assert_array_equal(np.isnan(made.level_db), gone)
    assert np.isnan(made.bearing_deg).all()


def test_silence_has_no_level_and_no_warning():
    made = levels_of(np.zeros(int(RATE_HZ) * 20))
    assert np.isnan(made.excess_db).all()


def test_a_band_outside_the_spectrogram_is_named():
    with pytest.raises(OptionError, match="reaches 0 to 1000 Hz"):
        levels_of(white_noise(20_000, 9), band_hz=(2000.0, 3000.0))


@pytest.mark.parametrize("bits", [16, 24])
@pytest.mark.parametrize("edge", ["steep", "gentle"])
def test_a_band_beyond_the_recorders_filter_has_no_weight(bits, edge):
    """The filter, and then the steps of the samples, are all that is above 350 Hz."""
    from scipy.signal import ellip, firwin, lfilter, sosfilt

    rng = np.random.default_rng(9)
    n, bearing = int(RATE_HZ) * 300, np.radians(300.0)
    sound = rng.standard_normal(n) * 0.4
    noise = rng.standard_normal((n, 3)) / np.sqrt([1.0, 3.0, 3.0])
    samples = noise + sound[:, None] * [1.0, np.sin(bearing), np.cos(bearing)]
    if edge == "steep":
        low = firwin(401, 350.0, fs=RATE_HZ, window=("kaiser", 12.0))
        samples = lfilter(low, 1.0, samples, axis=0)
    else:
        low = ellip(6, 0.1, 100.0, 350.0, fs=RATE_HZ, output="sos")
        samples = sosfilt(low, samples, axis=0)
    samples = np.round(0.02 * samples * 2.0 ** (bits - 1)) / 2.0 ** (bits - 1)
    whole, inside = (levels_of(samples, DIFAR), levels_of(samples, DIFAR, band_hz=(100.0, 330.0)))
    error, least = ((made.bearing_deg - 300.0 + 180.0) % 360.0 - 180.0 for made in (whole, inside))
    # sub-bands are wide beside the filter's edge: some of the sound is lost there
    assert error.std() < 1.3 * least.std()
    scaled = error / whole.bearing_std_deg
    assert scaled.std() == pytest.approx(1.0, abs=0.15)
    # what rises, rises as much as it does inside
    assert np.abs(whole.excess_db - inside.excess_db).mean() < 0.5
