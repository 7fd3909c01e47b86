"""The sound itself against a passage: tones that are steady in the vessel's own time."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.draws.passage_truth import Scene, received, true_motion
from tests.motion.passing_vessel import lines_of_scenes
from tests.support import recording_of
from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.candidates import examine_contacts
from uwtrack_cli.motion.passage.checks.rest_frame import ask_the_sound, rest_frame
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors
from uwtrack_cli.motion.passage.model.unknowns import RAMP, Change

RATE_HZ = 512.0
SCENE = Scene(speed_mps=6.0, range_m=150.0, rest_hz=(120.0,), closest_s=150.0, length_s=300.0)
DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0)


def sound_of(ratio, loudness):
    """A line whose frequency has a given ratio to the rest frequency, in noise."""
    rng = np.random.default_rng(4)
    phase = 2 * np.pi * SCENE.rest_hz[0] * np.cumsum(ratio) / RATE_HZ
    noise = 2.0 * rng.standard_normal(ratio.size)
    sound = (loudness * np.sin(phase) + noise).astype(np.float32)
    return replace(recording_of(sound, RATE_HZ), reader=HeldSamples(sound[:, None]))


def shift_at(time):
    ratio, _, distance = received(SCENE, time, true_motion(SCENE))
    return ratio - 1, SCENE.range_m / distance


@cache
def fitted(scene):
    """The passage that the frequencies of a scene's line show, which nothing changes."""
    lines = lines_of_scenes([scene], np.random.default_rng(1))
    (item,), _ = examine_contacts(lines, nuisance_priors(DIFAR, None, None, 22.0, 2.0).medium, 1e-3)
    return item


def found_with(shift, loudness):
    lines = lines_of_scenes([SCENE], np.random.default_rng(1))
    return find_encounters(lines, None, DIFAR, None, sound_of(1 + shift, loudness))


TIME = np.arange(int(SCENE.length_s * RATE_HZ)) / RATE_HZ


@pytest.mark.slow
def test_the_sound_of_a_passage_is_steadier_in_the_vessels_own_time():
    found = found_with(*shift_at(TIME))
    assert found.status.tolist() == ["ok"]
    # the sweep of a true passage is resolved 4 to 32 times: ln 2 or so on the mean
    assert 0.2 < found.rest_frame_evidence[0] < 1.5
    assert found.misfit[0] < 0.05


def drift():
    shift, loudness = shift_at(TIME)
    near = np.abs(TIME - SCENE.closest_s) < 3 * SCENE.range_m / SCENE.speed_mps
    slope = np.polyfit(TIME[near] - SCENE.closest_s, shift[near], 1)[0]
    return slope * (TIME - SCENE.closest_s), loudness


def step():
    shift, loudness = shift_at(TIME)
    return np.where(SCENE.closest_s > TIME, shift.max(), shift.min()), loudness


@pytest.mark.parametrize(
    "sound", [lambda: (0 * TIME, 1 + 0 * TIME), drift, step], ids=["steady", "drift", "step"]
)
def test_the_sound_of_a_machine_that_changes_its_speed_speaks_against_it(sound):
    shift, loudness = sound()
    asked = ask_the_sound(fitted(SCENE), sound_of(1 + shift, loudness))
    assert asked.rest_frame_evidence < -0.2


@pytest.mark.parametrize("passes", [True, False])
def test_a_passage_beside_a_ramp_must_be_steadier_than_the_ramp_alone(passes):
    """The frequencies of a machine that runs up are neither constant, nor a drift of
    the whole stretch, nor a step: all of them are blurred, and the passage less."""
    slope, at_s = 2e-4, SCENE.closest_s
    item = fitted(SCENE)

    def shift(time):
        return (1 + passes * shift_at(time)[0]) * (1 + slope * np.maximum(time - at_s, 0.0)) - 1

    fit = replace(
        item.fit,
        theta=np.concatenate([item.fit.theta, [[slope, 0.0]]], axis=1),
        change=Change(RAMP, np.array([at_s]), np.ones(1)),
    )
    value = np.broadcast_to(shift(item.blocks.time_s), item.blocks.shift.value.shape)
    blocks = replace(
        item.blocks, value=np.concatenate([value, item.blocks.value[:, value.shape[1] :]], axis=1)
    )
    found = rest_frame(sound_of(1 + shift(TIME), shift_at(TIME)[1]), fit, blocks)
    assert found.rival == "frequency-ramp"
    assert (found.evidence > 0.2) == passes
    assert (found.evidence < -0.2) != passes


def test_a_drift_like_the_passage_says_nothing_against_bearings_that_turn():
    """A slow vessel far off: within 60 degrees of its course its lines fall straight."""
    slow = replace(SCENE, speed_mps=1.6, range_m=620.0, closest_s=190.0, length_s=480.0)
    item = fitted(slow)
    time = np.arange(int(slow.length_s * RATE_HZ)) / RATE_HZ
    ratio, _, _ = received(slow, time, true_motion(slow))
    sound = sound_of(ratio, 1.0)
    asked = [rest_frame(sound, item.fit, item.blocks, turns=turns) for turns in (0, 1)]
    assert [heard.rival for heard in asked] == ["frequency-ramp", "frequency-step"]
    assert abs(asked[0].evidence) < 0.05
    assert asked[1].evidence > 0.15
    steady = rest_frame(sound_of(np.ones(time.size), 1.0), item.fit, item.blocks, turns=True)
    assert steady.evidence < -0.2


def test_lines_that_are_not_in_the_sound_have_no_tones():
    """A tracker may join noise to a line that moves: its sound holds no tone."""
    shift, loudness = shift_at(TIME)
    silent = ask_the_sound(fitted(SCENE), sound_of(1 + shift, 0.0 * loudness))
    assert silent.evidence["tones"] < 10.0
    heard = ask_the_sound(fitted(SCENE), sound_of(1 + shift, 0.5 * loudness))
    assert heard.evidence["tones"] > 100.0


@pytest.mark.slow
def test_without_the_sound_the_passage_stands_and_says_so():
    """Its reader cannot go back."""
    sound = np.zeros(int(SCENE.length_s * RATE_HZ))
    lines = lines_of_scenes([SCENE], np.random.default_rng(1))
    found = find_encounters(lines, None, DIFAR, None, recording_of(sound, RATE_HZ))
    assert found.status.tolist() == ["ok"]
    assert np.isnan(found.rest_frame_evidence[0])
    assert found.reasons(0)["rest_frame_evidence"] == "the sound is not at hand"


def test_a_passage_of_less_than_some_samples_is_not_asked():
    """A candidate may be as narrow as it likes: it is refused by its frames, later."""
    item = fitted(SCENE)
    theta = item.fit.theta.copy()
    theta[0, 1] = np.log(1e-3)  # of the range: d/v of less than a millisecond
    narrow = replace(item.fit, theta=theta)
    assert narrow.range_over_speed_s[0] * RATE_HZ < 1.0
    assert rest_frame(sound_of(1 + shift_at(TIME)[0], 1.0), narrow, item.blocks) is None
