"""Passages of seconds in the sound itself, whose lines no tracker follows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.draws.passage_truth import Scene, received, true_motion
from tests.motion.passing_vessel import frames_of, levels_of_scene, lines_of_columns
from tests.support import recording_of
from uwtrack_cli.data.recording import UNENDED, HeldSamples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.own_time import own_time_passages

RATE_HZ, LENGTH_S = 512.0, 64.0
SCENE = Scene(
    speed_mps=10.0, range_m=40.0, rest_hz=(23.0, 46.0, 69.0), closest_s=32.0,
    length_s=LENGTH_S, height_m=0.0,
)  # fmt: skip
TIME = np.arange(int(LENGTH_S * RATE_HZ)) / RATE_HZ
AMPLITUDES = np.sqrt(4 / RATE_HZ * 10 ** (np.array([20.0, 18.0, 16.0]) / 10))
"""Tones of 20, 18 and 16 dB-Hz above noise of unit variance, at their loudest."""


def heard(ratio, loudness):
    """Sound of the scene's lines by their frequency over that at rest, in noise."""
    rng = np.random.default_rng(7)
    sound = rng.standard_normal(TIME.size)
    for rest_hz, amplitude in zip(SCENE.rest_hz, AMPLITUDES, strict=True):
        turns = rest_hz * np.cumsum(ratio) / RATE_HZ
        sound += amplitude * loudness * np.sin(2 * np.pi * (turns + rng.random()))
    samples = sound.astype(np.float32)
    return replace(recording_of(samples, RATE_HZ), reader=HeldSamples(samples[:, None]))


@cache
def passing():
    ratio, _, distance = received(SCENE, TIME, true_motion(SCENE))
    return ratio, SCENE.range_m / distance


@pytest.mark.slow
def test_lines_too_weak_to_be_followed_tell_time_width_and_speed():
    lines = machine()  # all that a tracker has
    levels = levels_of_scene(SCENE, np.random.default_rng(3), snr_db=-60.0, has_bearing=False)
    found = find_encounters(
        lines, levels, Sensor(id="h1", depth_m=22.0), recording=heard(*passing()),
        source_depth_m=22.0,
    )  # fmt: skip
    assert found.status.tolist() == ["ok"]
    truth = {"time_s": 32.0, "range_over_speed_s": 4.0, "speed_mps": 10.0}
    for name, value in truth.items():
        unit = name.rsplit("_", 1)[1]
        std = getattr(found, f"{name.removesuffix('_' + unit)}_std_{unit}")[0]
        assert std < 0.2 * value
        assert abs(getattr(found, name)[0] - value) < 4 * std
    apart_hz = np.abs(found.rest_frequency_hz - np.array(SCENE.rest_hz)[:, None])
    assert apart_hz.min(axis=1).max() < 0.05
    assert (found.rest_line_id == 0).all()


def machine():
    """A steady line of another machine, measured in every frame."""
    frames = frames_of(LENGTH_S)
    count = np.asarray(frames.time_s).size
    one = np.ones(count)
    off_hz = 0.05 * np.random.default_rng(5).standard_normal(count)
    columns = (one.astype(int), 88.0 + off_hz, 0.05 * one, np.nan * one, np.nan * one, 60.0 * one)
    return lines_of_columns(frames, columns, [1], status="steady")


LAG_S = TIME - SCENE.closest_s


@pytest.mark.slow
@pytest.mark.parametrize(
    "ratio", [1.0 - 3e-4 * LAG_S, 2.0 - passing()[0]], ids=["drifts", "climbs"]
)
def test_lines_that_rise_and_fall_by_another_movement_are_no_passage(ratio):
    assert own_time_passages(heard(ratio, passing()[1]), 1500.0) == []


@pytest.mark.slow
def test_a_movement_whose_levels_stay_is_no_passage():
    assert own_time_passages(heard(passing()[0], np.ones(TIME.size)), 1500.0) == []


def test_sound_that_cannot_be_read_again_or_is_still_coming_tells_none():
    once = recording_of(np.zeros(TIME.size, np.float32), RATE_HZ)
    assert own_time_passages(once, 1500.0) == []
    live = replace(heard(*passing()), n_samples=UNENDED)
    assert own_time_passages(live, 1500.0) == []
