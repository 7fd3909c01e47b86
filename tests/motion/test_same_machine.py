"""Contacts that are one machine: teeth of one comb, and gears that follow each other."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.passage_truth import Scene
from tests.motion.passing_vessel import lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.candidates import examine_contacts
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors
from uwtrack_cli.motion.passage.same_machine import contact_ends, is_next_gear, is_of_comb

DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0, compass_std_deg=0.0)
FIRST_GEAR = np.array([30.25, 60.5, 90.75])
CHANGE_S, PAUSE_S, RATIO = 150.0, 4.0, 1.227
SLOW = Scene(
    speed_mps=3.6, range_m=650.0, rest_hz=tuple(FIRST_GEAR), closest_s=21.5, length_s=480.0, turn=1
)


def two_gears(after_hz, pause_s=PAUSE_S, seed=1):
    """The lines of a vessel that changes its gear, a contact before and one after."""
    after = replace(SLOW, rest_hz=tuple(after_hz))
    rng = np.random.default_rng(seed)
    lines = lines_of_scenes([SLOW, after], rng)
    contact = lines.line_contact[lines.line - 1]
    is_heard = np.where(contact == 1, lines.time_s < CHANGE_S, lines.time_s > CHANGE_S + pause_s)
    # frames as short as a second tell a fiftieth of a hertz
    noise = 0.03 * rng.standard_normal(lines.time_s.size)
    return replace(
        lines,
        measured_frequency_hz=np.where(is_heard, lines.measured_frequency_hz + noise, np.nan),
        measured_frequency_std_hz=np.full(noise.size, 0.03),
        measured_bearing_deg=np.where(is_heard, lines.measured_bearing_deg, np.nan),
    )


def test_a_passage_in_two_gears_is_one():
    lines = two_gears(RATIO * FIRST_GEAR)
    # levels that follow the range would show it in the first gear alone
    lines = replace(lines, measured_level_db=np.full(lines.time_s.size, np.nan))
    found = find_encounters(lines, None, DIFAR)
    assert found.n_encounters == 1
    assert found.rest_frequency_hz.size == 6
    assert abs(found.time_s[0] - SLOW.closest_s) < 4 * found.time_std_s[0]
    width_s = SLOW.range_m / SLOW.speed_mps
    off = abs(found.range_over_speed_s[0] - width_s)
    assert off < 4 * found.range_over_speed_std_s[0] < width_s


@pytest.mark.parametrize(
    ("after_hz", "pause_s", "is_next"),
    [
        (RATIO * FIRST_GEAR, PAUSE_S, True),
        (RATIO * FIRST_GEAR[1:], PAUSE_S, True),
        (RATIO * FIRST_GEAR[:1], PAUSE_S, False),
        (1.8 * FIRST_GEAR, PAUSE_S, False),
        (RATIO * FIRST_GEAR * [1.0, 1.1, 0.95], PAUSE_S, False),
        (RATIO * FIRST_GEAR, 40.0, False),
        (RATIO * FIRST_GEAR, -40.0, False),
    ],
    ids=["gear", "fewer", "one", "octave", "no ratio", "later", "beside"],
)
def test_lines_go_on_in_another_gear_by_one_ratio_and_at_once(after_hz, pause_s, is_next):
    lines = two_gears(after_hz, pause_s)
    ends = contact_ends(lines, (1, 2))
    assert is_next_gear(ends[1], ends[2], lines.frames.window_s) == is_next
    assert not is_next_gear(ends[2], ends[1], lines.frames.window_s)


def test_strangers_are_hardly_ever_teeth_of_a_comb():
    rng = np.random.default_rng(3)
    comb_hz = np.array([77.9, 194.75, 233.7, 272.65])
    std = np.full(4, 0.02)
    own = rng.uniform(30.0, 400.0, (2000, 2))
    assert sum(is_of_comb(comb_hz, std, hz, std[:2]) for hz in own) <= 4
    teeth = 38.95 * np.array([[3, 4], [1, 6]]) + 0.02 * rng.standard_normal((2, 2))
    assert all(is_of_comb(comb_hz, std, hz, std[:2]) for hz in teeth)
    # and four strangers have no comb
    none = rng.uniform(30.0, 400.0, (2000, 4))
    assert sum(is_of_comb(hz, std, hz[:2], std[:2]) for hz in none) <= 4


@pytest.mark.parametrize("is_tooth", [True, False])
def test_lines_of_its_comb_are_the_vessels_though_they_agree_less(is_tooth):
    """Two lines that are heard for a while tell a time that is a second off."""
    whole = Scene(speed_mps=4.0, range_m=35.0, rest_hz=(78.0, 195.0, 234.0, 273.0),
                  closest_s=230.0, length_s=480.0, height_m=10.0)  # fmt: skip
    rest_hz = (117.0, 156.0) if is_tooth else (121.3, 143.8)
    part = replace(whole, rest_hz=rest_hz, closest_s=228.8)
    lines = lines_of_scenes([whole, part], np.random.default_rng(2))
    is_part = lines.line > len(whole.rest_hz)
    is_heard = ~is_part | (np.abs(lines.time_s - 234.0) < 30.0)
    rng = np.random.default_rng(7)
    noise_hz, noise_deg = 0.02 * is_part, 10.0 * is_part
    frequency_hz = lines.measured_frequency_hz + noise_hz * rng.standard_normal(is_part.size)
    bearing_deg = lines.measured_bearing_deg + noise_deg * rng.standard_normal(is_part.size)
    lines = replace(
        lines,
        measured_frequency_hz=np.where(is_heard, frequency_hz, np.nan),
        measured_frequency_std_hz=lines.measured_frequency_std_hz + noise_hz,
        measured_bearing_deg=np.where(is_heard, bearing_deg, np.nan),
        measured_bearing_std_deg=lines.measured_bearing_std_deg + noise_deg,
    )
    medium = nuisance_priors(DIFAR, None, None, 3.0, 2.0).medium
    found = examine_contacts(lines, medium, 1e-3)[0]
    assert len(found) == (1 if is_tooth else 2)
    assert abs(found[0].fit.theta[0, 0] - whole.closest_s) < 0.3
