"""Combs: fundamentals of which no tooth is heard alone, and what is no comb."""

import numpy as np
import pytest

from tests.draws.comb_sounds import RATE_HZ, comb_samples, passage_factor
from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import OptionError
from uwtrack_cli.lines.comb_search.tooth_table import drift_sums
from uwtrack_cli.lines.combs import find_combs
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

BAND_HZ = (5.0, 300.0)
SECONDS = 130.0


def combs(sound: np.ndarray | Recording, window_s: float = 4.0, **options) -> Lines:
    """What the stage finds in frames of one length."""
    recording = sound if isinstance(sound, Recording) else recording_of(sound, RATE_HZ)
    blocks = compute_spectrogram(recording, window_s=window_s, band_hz=BAND_HZ)
    return Lines.join(list(find_combs(blocks, **options)))


def weak_comb(seed: int = 0, **options) -> np.ndarray:
    """Twelve teeth of 8.3 Hz, each 7 dB below the noise in 1 Hz."""
    return comb_samples(8.3 * np.arange(2, 14), -7.0, seconds=SECONDS, seed=seed, **options)


@pytest.mark.parametrize("climb", [-40, -7, 0, 3, 33])
def test_a_drift_has_its_greatest_sum_where_it_is(climb):
    """Cells along a straight line, by the definition of one."""
    values = np.zeros((64, 300), np.float32)
    frame = np.arange(64)
    values[frame, np.rint(150 + climb * ((frame + 0.5) / 64 - 0.5)).astype(int)] = 1.0
    sums = drift_sums(values, 48)
    row, cell = np.unravel_index(sums.argmax(), sums.shape)
    assert sums.max() >= 0.7 * 64
    assert abs(row - 48 - climb) <= 1
    assert abs(cell - 150) <= 1


def test_sums_without_a_drift_are_sums_over_the_frames():
    values = np.random.default_rng(3).standard_normal((2, 32, 50))
    assert np.allclose(drift_sums(values, 5)[:, 5], values.sum(axis=1))


def test_a_comb_is_found_of_which_no_tooth_is_heard():
    found = combs(weak_comb())
    assert found.families.spacing_hz == pytest.approx([8.3], rel=5e-4)
    assert found.families.log10_chance[0] < -4
    order = np.rint(found.frequency_hz / 8.3)
    assert np.abs(found.frequency_hz - 8.3 * order).max() < 0.2
    teeth = {round(float(np.median(found.frequency_hz[found.line == k])) / 8.3)
             for k in found.line_id}  # fmt: skip
    assert len(teeth & set(range(2, 14))) >= 8  # two in three
    assert set(found.line_contact) == {1}


def test_its_deviation_holds():
    """Normal errors exceed twice their deviation in 5 %; half of them .67 of it."""
    off = []
    for seed in range(8):
        families = combs(weak_comb(100 + seed)).families
        if families.family.size:
            off.append((families.spacing_hz[0] - 8.3) / families.spacing_std_hz[0])
    assert len(off) >= 6
    assert np.mean(np.abs(off) < 2.0) >= 0.75
    assert np.median(np.abs(off)) > 0.05


def test_blocks_do_not_matter():
    parts = [recording_of(weak_comb(2), RATE_HZ, block=n) for n in (999, 1 << 17)]
    one, two = (combs(part) for part in parts)
    assert one.equals(two)


def test_a_live_sound_is_known_so_far():
    """Of the windows that were searched, as the whole has them."""
    sound = recording_of(np.concatenate([weak_comb(2)] * 2), RATE_HZ, block=8000)
    stream = find_combs(compute_spectrogram(sound, window_s=4.0, band_hz=BAND_HZ))
    stream.remember(1e6)
    assert stream.so_far(0.0) is None
    known = [stream.so_far(0.0) for _ in stream]
    last = known[-2]  # before the sound has ended
    assert last is not None
    assert last.families.spacing_hz == pytest.approx([8.3], rel=5e-4)
    assert 60.0 < np.ptp(last.time_s) < 2.0 * SECONDS


def test_a_gain_changes_levels_alone():
    one, two = (combs(k * weak_comb(2)) for k in (1.0, 8.0))
    assert np.allclose(one.frequency_hz, two.frequency_hz, rtol=1e-6)
    assert np.allclose(two.measured_level_db - one.measured_level_db, 18.06, atol=0.01)


def test_all_teeth_bend_by_one_factor():
    factor = passage_factor(SECONDS, 65.0, 9.0, 900.0)
    found = combs(weak_comb(5, factor=factor))
    assert found.families.family.size == 1
    assert found.families.spacing_hz == pytest.approx([8.3], rel=2e-3)
    truth = np.interp(found.time_s, np.arange(factor.size) / RATE_HZ, factor)
    ratio = found.frequency_hz / (8.3 * np.rint(found.frequency_hz / 8.3))
    assert np.sqrt(np.mean((ratio / truth - 1.0) ** 2)) < 2e-4


@pytest.mark.parametrize("tones", [(), (123.4,), (60.0, 97.3, 151.1, 233.9)])
def test_noise_and_strays_are_no_comb(tones):
    """A single loud tone is none, nor are some that share nothing."""
    sound = comb_samples(np.array(tones), 25.0, seconds=SECONDS, seed=11)
    found = combs(sound, false_combs_per_hour=0.05)
    assert found.line_id.size == found.families.family.size == 0


def test_a_family_may_lack_its_fundamental():
    sound = comb_samples(9.31 * np.array([2, 3, 4]), 15.0, seconds=SECONDS, seed=4)
    assert combs(sound).families.spacing_hz == pytest.approx([9.31], rel=1e-3)


def test_two_ships_four_percent_apart():
    """The spacings are neither a third nor a quarter of these."""
    teeth = np.arange(3, 13)
    tones = np.concatenate([8.0 * teeth, 8.32 * teeth])
    found = combs(comb_samples(tones, 3.0, seconds=SECONDS, seed=6))
    assert np.sort(found.families.spacing_hz) == pytest.approx([8.0, 8.32], rel=2e-3)


def test_a_comb_that_begins_and_ends():
    """Noise before and after has no points; silence in a gap has none either."""
    noise = comb_samples(np.zeros(0), 0.0, seconds=330.0, seed=8)
    sound = np.concatenate([noise[:200_000], weak_comb(7), noise[200_000:]])
    found = combs(sound)
    assert found.families.spacing_hz == pytest.approx([8.3], rel=1e-3)
    assert found.time_s.min() > 200.0 - 40.0
    assert found.time_s.max() < 330.0 + 40.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"band_hz": (5.0, 9.0)}, "combs needs at least"),
        ({"fundamental_hz": (0.5, 0.8)}, "make frames longer"),
        ({"false_combs_per_hour": 0.0}, "false_combs_per_hour"),
        ({"teeth": 2}, "teeth"),
    ],
)
def test_what_cannot_be_searched_is_refused(options, words):
    with pytest.raises(OptionError, match=words):
        combs(weak_comb(), **options)


def test_a_short_recording_has_none():
    found = combs(np.zeros(3000), window_s=1.0)
    assert found.line_id.size == 0


@pytest.mark.parametrize("rate_ps", [-9e-5, 9e-5])
def test_a_machine_that_drifts_more_than_is_asked_for(rate_ps):
    """What is refined beyond the greatest drift is no place of the table."""
    factor = 1.0 + rate_ps * (np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ - 65.0)
    tones, options = 8.3 * np.arange(2, 36), {"seconds": SECONDS, "seed": 31}
    sound = comb_samples(tones, 6.0, factor=factor, **options)
    found = combs(sound, drift_ps=3e-5)
    assert np.isfinite(found.frequency_hz).all()


def test_any_noise_is_searched_whatever_is_asked():
    """Thresholds below what noise reaches try every comb, those of noise alone too."""
    sound = comb_samples(np.zeros(0), 0.0, seconds=SECONDS, seed=21)
    found = combs(sound, false_combs_per_hour=1e5)
    assert np.isfinite(found.frequency_hz).all()
    assert np.isfinite(found.families.spacing_hz).all()
