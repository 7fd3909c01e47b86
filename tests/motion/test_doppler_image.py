"""Passages in air that show as a pattern which shifts in log frequency."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.passage_truth import Scene, received, true_motion
from tests.motion.passing_vessel import levels_of_scene
from tests.support import recording_of
from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.evidence.doppler_image import (
    DopplerImage,
    DopplerLaw,
    doppler_evidence,
    level_hump,
    shifts,
)
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, SOUND_MPS = 6000.0, 343.0
SCENE = Scene(
    speed_mps=25.0, range_m=8.0, rest_hz=(180.0, 240.0, 330.0, 510.0, 760.0),
    closest_s=4.0, length_s=8.0, height_m=0.0, sound_speed_mps=SOUND_MPS,
)  # fmt: skip
TIME = np.arange(int(SCENE.length_s * RATE_HZ)) / RATE_HZ


def sound_of(ratio, loudness, seed, snr_db=30.0):
    """Sound of the scene's lines by their frequency over that at rest, in noise."""
    rng = np.random.default_rng(seed)
    sound = rng.standard_normal(TIME.size)
    amplitude = np.sqrt(4 / RATE_HZ * 10 ** (snr_db / 10))
    for rest_hz in SCENE.rest_hz:
        turns = rest_hz * np.cumsum(ratio) / RATE_HZ
        sound += amplitude * loudness * np.sin(2 * np.pi * (turns + rng.random()))
    samples = sound.astype(np.float32)
    return replace(recording_of(samples, RATE_HZ), reader=HeldSamples(samples[:, None]))


def passing(seed, snr_db=30.0):
    ratio, _, distance = received(SCENE, TIME, true_motion(SCENE))
    return sound_of(ratio, SCENE.range_m / distance, seed, snr_db)


def test_shifts_are_those_of_the_retarded_law():
    law = np.array([[4.0, 0.32, 25.0 / SOUND_MPS, 0.0]])
    ratio = received(SCENE, TIME, true_motion(SCENE))[0]
    np.testing.assert_allclose(shifts(TIME, law)[0], np.log(ratio), atol=1e-6)


def test_the_law_is_found_from_a_place_that_is_roughly_right():
    found = doppler_evidence(passing(1), 4.15, 0.45)
    assert found.evidence > 50.0
    assert found.law.time_s == pytest.approx(4.0, abs=0.05)
    assert found.law.width_s == pytest.approx(0.32, rel=0.25)
    assert found.law.mach * SOUND_MPS == pytest.approx(25.0, rel=0.1)


def test_deviations_of_the_course_are_those_of_its_errors():
    ratios = []
    for seed in range(3):
        found = doppler_evidence(passing(seed), 4.0, 0.32)
        course = found.course
        known = np.isfinite(course.shift) & (np.abs(course.time_s - 4.0) < 1.0)
        assert np.count_nonzero(known) > 10
        truth = np.interp(course.time_s, TIME, np.log(received(SCENE, TIME, true_motion(SCENE))[0]))
        off = (course.shift - truth)[known]
        ratios += ((off - off.mean()) / course.shift_std[known]).tolist()
    # the logarithm of a clear tone scatters less than that of noise: too wide, never narrow
    assert 0.25 < np.std(ratios) < 1.2


OTHERS = {
    "nothing": (1.0, 0.0),
    "tones that stay": (1.0, 1.0),
    "a steady drift": (np.exp(-0.01 * (TIME - 4.0)), 1.0),
    "a step": (np.where(TIME > 4.0, 0.9, 1.0), 1.0),
    "a rise where a passage falls": (np.exp(0.07 * np.tanh((TIME - 4.0) / 0.3)), 1.0),
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_passes_nowhere_has_no_evidence(name):
    ratio, loudness = (np.broadcast_to(one, TIME.shape) for one in OTHERS[name])
    found = doppler_evidence(sound_of(ratio, loudness, 1), 4.0, 0.32)
    assert found.evidence < 10.0


def test_no_pattern_gains_nothing():
    rng = np.random.default_rng(5)
    for _ in range(5):
        noise = rng.standard_normal(int(4 * RATE_HZ))
        image = DopplerImage(noise, RATE_HZ, 0.0, 0.1)
        assert image.gain(DopplerLaw(2.0, 0.3, 0.07)) < 0.0


LEVELS = {
    "a vehicle": (np.log10(1.0 / (1.0 + ((TIME - 4.0) / 0.32) ** 2) + 0.02), 1.0),
    "an engine that slows down": (-np.tanh((TIME - 4.0) / 0.3), -0.3),
    "a drift": (0.2 * (TIME - 4.0), -0.3),
}


@pytest.mark.parametrize("name", LEVELS)
def test_a_level_that_rises_and_falls_is_told_from_one_that_follows_the_engine(name):
    course, sign = LEVELS[name]
    rng = np.random.default_rng(9)
    scene = replace(SCENE, length_s=80.0, closest_s=40.0)
    levels = levels_of_scene(scene, rng)
    at_s = 4.0 + 0.1 * (np.asarray(levels.frames.time_s) - 40.0)
    drawn = 10.0 * np.interp(at_s, TIME, course) + rng.normal(size=at_s.size)
    gain = level_hump(replace(levels, excess_db=drawn), 40.0, 3.2)
    assert gain > 5.0 if sign > 0 else gain < 1.0


def test_without_its_sound_or_with_too_little_of_it_nothing_is_said():
    recording = passing(1)
    assert doppler_evidence(replace(recording, n_samples=300), 0.02, 0.32) is None


def test_a_vehicle_whose_lines_are_in_no_table_has_time_range_and_speed():
    recording = passing(2, snr_db=32.0)
    blocks = measure_levels(compute_spectrogram(recording, window_s=0.1))
    found = find_encounters(
        levels=Levels.join(list(blocks)), sensor=Sensor(id="h1"), recording=recording,
        sound_speed_mps=SOUND_MPS,
    )  # fmt: skip
    assert found.status.tolist() == ["ok"]
    truth = {"time_s": 4.0, "range_over_speed_s": 0.32, "speed_mps": 25.0}
    for name, value in truth.items():
        unit = name.rsplit("_", 1)[1]
        std = getattr(found, f"{name.removesuffix('_' + unit)}_std_{unit}")[0]
        assert abs(getattr(found, name)[0] - value) < 3.5 * std
        assert std < 0.2 * value
