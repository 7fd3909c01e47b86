"""Transients of lines and level within seconds, against the law of noise and of a passage."""

import numpy as np
import pytest

from tests.support import recording_of, white_noise
from uwtrack_cli.data.transients import CLIMB, FALL, LEVEL, LINES, Transients
from uwtrack_cli.errors import OptionError
from uwtrack_cli.spectra.spectrogram import compute_spectrogram
from uwtrack_cli.spectra.transients import CELL_PROBABILITY, _cells, find_transients, heights

RATE_HZ = 4000.0
HOP_S = 0.5
FRAMES = {"window_s": 0.1, "zero_padding": 1, "band_hz": (40.0, 2000.0)}


def in_noise(level_db, seed=1):
    return level_db + np.random.default_rng(seed).normal(0.0, 0.3, len(level_db))


TIME = HOP_S * (1 + np.arange(1200))


def test_a_rise_of_a_second_stands_out():
    """10 log(1 + S / (1 + x^2)), the law of a passage at a ratio of 10 dB."""
    hump = 10 * np.log10(1 + 10 / (1 + ((TIME - 300.0) / 1.0) ** 2))
    height = heights(in_noise(hump), 2, 0.25)
    assert abs(TIME[np.argmax(height)] - 300.0) < 1.0
    assert height.max() > 15.0


@pytest.mark.parametrize("half", [1, 2, 4])
@pytest.mark.parametrize(
    "level",
    [
        0.0 * TIME,
        np.where(TIME > 300.0, 10.0, 0.0),
        6.0 * np.sin(2 * np.pi * TIME / 10.0),
        10 * np.log10(1 + 10 / (1 + ((TIME - 300.0) / 40.0) ** 2)),
        np.clip(TIME - 250.0, 0.0, 10.0),
    ],
    ids=["steady", "step", "swell", "slow passage", "onset of rain"],
)
def test_what_is_no_rise_of_seconds_does_not(level, half):
    assert heights(in_noise(level), half, 0.25).max() < 6.0


def test_a_knock_is_no_rise():
    level = in_noise(0.0 * TIME)
    level[600:602] += 30.0
    assert heights(level, 4, 0.25).max() < 6.0


def rises_in(sound, block=None, **options):
    recording = recording_of(sound.astype(np.float32), RATE_HZ, block=block)
    blocks = compute_spectrogram(recording, **FRAMES)
    return Transients.join(list(find_transients(blocks, **options)))


def test_noise_exceeds_the_factor_as_often_as_is_stated():
    """Rohling (1983), eq. 33: a million cells of noise, of which 1e-4 exceed it."""
    noise = white_noise(int(300 * RATE_HZ), 3)
    frames = compute_spectrogram(recording_of(noise, RATE_HZ), **FRAMES)
    ratio = np.concatenate([_cells(block).ratio for block in frames])
    expected = CELL_PROBABILITY * ratio.size
    # neighbouring cells and frames exceed it together: some thrice the variance
    assert abs(np.count_nonzero(ratio > 1) - expected) < 5 * np.sqrt(3 * expected)


def sweep(seconds, middle_s, width_s, amplitude, rest_hz=700.0, mach=0.09):
    """The tone of a passage in air, as loud as its range says; level hardly changes."""
    time = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    lag = (time - middle_s) / width_s
    frequency = rest_hz * (1 - mach * lag / np.sqrt(1 + lag**2))
    tone = np.sin(2 * np.pi * np.cumsum(frequency) / RATE_HZ)
    return amplitude * tone / np.sqrt(1 + lag**2)


def test_a_tone_that_sweeps_within_seconds_rises_where_the_level_does_not():
    noise = white_noise(int(60 * RATE_HZ), 5, density=1e-3)
    tones = [sweep(60.0, 31.0, 0.5, 0.8, rest_hz) for rest_hz in (450.0, 700.0, 1150.0)]
    passing = noise + sum(tones)
    found = rises_in(passing)
    assert found.kind.tolist() == [FALL] * found.time_s.size
    assert found.time_s.size
    assert np.all(np.abs(found.time_s - 31.0) < 2.0)
    assert np.all(found.spreads > found.least_spreads)
    # lines of 25 dB in 1 Hz, which move the level of the whole band by a decibel or so
    rise_db = 10 * np.log10(
        np.var(passing[int(30.5 * RATE_HZ) : int(31.5 * RATE_HZ)]) / np.var(noise)
    )
    assert rise_db < 2.0


@pytest.mark.parametrize(("mach", "kind"), [(0.09, FALL), (-0.09, CLIMB), (0.0, LINES)])
def test_lines_that_fall_keep_their_frequency_or_climb_are_told_apart(mach, kind):
    noise = white_noise(int(40 * RATE_HZ), 5, density=1e-3)
    tones = [sweep(40.0, 21.0, 0.5, 0.8, rest_hz, mach) for rest_hz in (450.0, 700.0, 1150.0)]
    found = rises_in(noise + sum(tones))
    assert found.time_s.size
    assert set(found.kind.tolist()) == {kind}


def test_a_steady_tone_and_noise_alone_do_not_rise():
    noise = white_noise(int(120 * RATE_HZ), 6)
    time = np.arange(noise.size) / RATE_HZ
    for tone in (0.0, 10.0):
        sound = noise + tone * np.sin(2 * np.pi * 301.0 * time)
        assert rises_in(sound).time_s.size == 0


def test_broadband_that_swells_for_a_second_rises_in_level():
    noise = white_noise(int(60 * RATE_HZ), 7)
    time = np.arange(noise.size) / RATE_HZ
    found = rises_in(noise * np.sqrt(1 + 3 / (1 + ((time - 20.0) / 0.6) ** 2)))
    assert set(found.kind.tolist()) == {LEVEL}
    assert np.all(np.abs(found.time_s - 20.0) < 1.0)


def test_blocks_have_no_influence(monkeypatch):
    monkeypatch.setattr("uwtrack_cli.spectra.transients.STRETCH_FRAMES", 320)
    monkeypatch.setattr("uwtrack_cli.spectra.transients.CONTEXT_FRAMES", 160)
    sound = white_noise(int(60 * RATE_HZ), 5) + sweep(60.0, 31.0, 0.5, 60.0)
    whole = rises_in(sound)
    assert whole.time_s.size
    recording = recording_of(sound, RATE_HZ)
    (spectra,) = [list(compute_spectrogram(recording, **FRAMES))]
    cut = [b.take("frame", slice(k, k + 16))
           for b in spectra for k in range(0, b.frames.n_frames, 16)]  # fmt: skip
    again = Transients.join(list(find_transients(iter(cut))))
    np.testing.assert_array_equal(again.time_s, whole.time_s)
    np.testing.assert_array_equal(again.spreads, whole.spreads)


def test_what_is_known_so_far_is_what_the_end_would_give():
    """A tone of half a second in a minute of noise, told while the sound goes on."""
    sound = white_noise(round(60 * RATE_HZ), 12, rate_hz=RATE_HZ)
    time_s = np.arange(sound.size) / RATE_HZ
    near = np.abs(time_s - 30.0) < 0.5
    sound[near] += 40.0 * np.sin(2 * np.pi * 700.0 * time_s[near])
    blocks = list(compute_spectrogram(recording_of(sound, RATE_HZ), **FRAMES))
    parts = [b.take("frame", slice(k, k + 64)) for b in blocks
             for k in range(0, b.frames.n_frames, 64)]  # fmt: skip
    scan = find_transients(iter(parts))
    scan.remember(1e9)
    assert scan.so_far(0.0) is None
    told = []
    for n_parts, _ in zip(range(1, len(parts) + 1), scan, strict=False):
        if n_parts % 4 == 0:
            known = scan.so_far(-np.inf)
            assert known.equals(Transients.join(list(find_transients(iter(parts[:n_parts])))))
            told.append(known.time_s.size)
    assert told[0] == 0 < told[-1]
    assert scan.so_far(40.0).time_s.size == 0


def test_silence_does_not_rise():
    sound = white_noise(int(30 * RATE_HZ), 8)
    sound[: sound.size // 2] = 0.0
    assert rises_in(sound).time_s.size == 0
    assert rises_in(0.0 * sound).time_s.size == 0


def test_a_height_below_one_is_refused():
    with pytest.raises(OptionError, match="least_spreads"):
        rises_in(white_noise(8000, 1), least_spreads=0.5)
