"""Lines that move together for seconds, in contacts that do something else for minutes."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.passage_truth import Scene
from tests.motion.crowded_sound import drift
from tests.motion.passing_vessel import lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.moving_lines import lines_together

SENSOR = Sensor(id="h1", depth_m=22.0)
SCENE = Scene(
    speed_mps=8.0, range_m=64.0, rest_hz=(41.0, 61.5, 82.0), closest_s=150.0, length_s=300.0
)
NEAR_S, WANDER = 40.0, 2e-3


def taken_over(seed, *, keeps_level=False):
    """Lines of a vessel that are a wandering machine's from five d/v before and behind.

    The machine's levels stay; ``keeps_level`` leaves them so all the time.
    """
    rng = np.random.default_rng(seed)
    lines = lines_of_scenes([SCENE], rng, has_bearing=False)
    near = np.abs(lines.time_s - SCENE.closest_s) < NEAR_S
    rest = np.array(SCENE.rest_hz)[lines.line - 1]
    time = np.unique(lines.time_s)
    path = np.interp(lines.time_s, time, WANDER * drift(rng, time, 20.0))
    away = rest * (1 + path) + 0.01 * rng.normal(size=rest.size)
    level = np.where(near & (not keeps_level), lines.measured_level_db, 94.0)
    level = level + 0.5 * rng.normal(size=level.size)
    return replace(
        lines,
        measured_frequency_hz=np.where(near, lines.measured_frequency_hz, away),
        measured_frequency_std_hz=np.full(rest.size, 0.01),
        measured_level_db=level,
        measured_snr_db=level - 84.0,
    )


def test_lines_that_pass_for_seconds_are_found_in_what_wanders_for_minutes():
    found = find_encounters(taken_over(0), sensor=SENSOR)
    assert found.status.tolist() == ["ok"]
    for name, truth in (("time", 150.0), ("range_over_speed", 8.0), ("speed", 8.0)):
        unit = "mps" if name == "speed" else "s"
        value, std = (getattr(found, f"{name}{part}_{unit}")[0] for part in ("", "_std"))
        assert abs(value - truth) < 4 * std
    assert set(found.rest_line_id) == {1, 2, 3}


@pytest.mark.parametrize("seed", range(3))
def test_lines_together_need_levels_that_follow_the_range(seed):
    first = lines_together(taken_over(seed), 1500.0)[0]
    assert abs(first.time_s - SCENE.closest_s) < 4.0  # half of d/v
    assert first.width_s == pytest.approx(8.0, rel=0.5)
    assert first.lines.tolist() == [1, 2, 3]
    machine = lines_together(taken_over(seed, keeps_level=True), 1500.0)
    assert all(abs(one.time_s - SCENE.closest_s) > 16.0 for one in machine)
