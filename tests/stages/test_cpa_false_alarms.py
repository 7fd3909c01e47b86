"""How often noise is taken for a passage, and how weak a passage is found."""

from dataclasses import replace

import numpy as np
import pytest

from tests.estimation.passage_truth import Scene
from tests.stages.passing_vessel import levels_of_scene, lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.stages.cpa import find_encounters

DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0)
STILL = Scene(speed_mps=1e-6, rest_hz=(60.0, 120.0), length_s=300.0, closest_s=150.0)


def wandering(lines, rng):
    """Let all lines wander together, as those of a free-running machine do."""
    time = np.unique(lines.time_s)
    steps = 2e-5 * rng.normal(size=time.size)
    path = np.cumsum(steps)
    frequency = lines.measured_frequency_hz * (1 + np.interp(lines.time_s, time, path))
    return replace(lines, measured_frequency_hz=frequency)


def claims(runs, seed, probability):
    """Claims from steady lines, wandering lines and broadband noise."""
    count = 0
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        lines = lines_of_scenes([STILL], rng)
        lines = wandering(lines, rng) if run % 2 else lines
        levels = levels_of_scene(STILL, rng, snr_db=-60.0)
        around = 360 * rng.random(levels.bearing_deg.size)
        levels = replace(levels, bearing_deg=around, bearing_std_deg=around * 0 + 60)
        found = find_encounters(
            lines, levels, DIFAR, false_alarm_probability=probability
        )
        count += found.n_encounters
    return count


def test_noise_is_hardly_ever_taken_for_a_passage():
    assert claims(8, 1, 1e-3) == 0


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_the_false_alarm_rate_is_not_above_the_stated_one():
    runs = 1500
    assert claims(runs, 2, 1e-2) <= runs * 1e-2 + 3 * np.sqrt(runs * 1e-2)


def detections(snr_db, runs=10):
    scene = Scene(length_s=300.0, closest_s=150.0)
    found = 0
    for run in range(runs):
        rng = np.random.default_rng([7, run])
        levels = levels_of_scene(scene, rng, snr_db=snr_db, has_bearing=False)
        found += find_encounters(None, levels, DIFAR).n_encounters
    return found / runs


def test_a_hump_of_3_db_is_found_at_the_same_threshold():
    assert detections(-12.0) <= 0.2
    assert detections(3.0) >= 0.9
