"""Contacts that are two vessels: taken apart, and single ones left whole."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.measured_passages import SENSOR, draw, draw_pair, score_pair
from tests.draws.passage_truth import Scene
from tests.motion.crowded_sound import drift
from tests.motion.passing_vessel import lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters

DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0, compass_std_deg=0.0)
FIRST = Scene(
    speed_mps=4.0, range_m=162.0, rest_hz=(103.7, 155.6, 207.5), closest_s=284.5,
    bearing_deg=209.3, turn=1,
)  # fmt: skip
SECOND = replace(
    FIRST, speed_mps=3.6, range_m=104.0, rest_hz=(141.5, 212.3), closest_s=290.0, bearing_deg=217.5
)


def one_contact(lines):
    return replace(lines, line_contact=np.ones(lines.line_id.size, np.int64))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_two_vessels_on_like_courses_in_one_contact_are_told_apart(seed):
    lines = lines_of_scenes([FIRST, SECOND], np.random.default_rng(seed))
    found = find_encounters(one_contact(lines), sensor=DIFAR)
    assert found.contact.tolist() == [1, 2]
    for row, scene in enumerate((FIRST, SECOND)):
        assert abs(found.time_s[row] - scene.closest_s) < 4 * found.time_std_s[row]
        assert abs(found.speed_mps[row] - scene.speed_mps) < 4 * (found.speed_std_mps[row])
        off = found.bearing_deg[row] - scene.bearing_deg
        assert abs(off) < 4 * found.bearing_std_deg[row]
        rest = found.rest_frequency_hz[found.rest_encounter == row]
        np.testing.assert_allclose(np.sort(rest), scene.rest_hz, atol=0.02)


@pytest.mark.parametrize("jitter", [0.0, 3e-4])
def test_one_vessel_stays_one_though_its_shaft_wanders(jitter):
    rng = np.random.default_rng(4)
    lines = lines_of_scenes([replace(FIRST, rest_hz=(60.0, 90.0, 120.0, 150.0))], rng)
    path = jitter * drift(rng, np.unique(lines.time_s), 20.0)
    factor = 1 + np.interp(lines.time_s, np.unique(lines.time_s), path)
    moved = replace(lines, measured_frequency_hz=lines.measured_frequency_hz * factor)
    found = find_encounters(moved, sensor=DIFAR)
    assert found.n_encounters == 1
    assert found.rest_frequency_hz.size == 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", [960003, pytest.param(960108, marks=pytest.mark.long)])
def test_two_vessels_in_one_contact_of_a_table_are_told_apart(seed):
    """Their bearings and levels are sums, which neither is told from."""
    pair = draw_pair(seed)
    found = find_encounters(series=pair.series, sensor=SENSOR)
    for vessel in score_pair(pair, found):
        assert vessel.reading == "two-targets"
        assert vessel.weight > 0.99
        assert np.nanmax(np.abs(vessel.error / vessel.std)) < 4.0
    assert sorted(found.contact.tolist()) == [1, 2]
    assert found.side.tolist() == ["", ""]
    owners = np.bincount(pair.lines).tolist()
    rest = np.bincount(found.rest_encounter).tolist()
    assert sorted(rest) == sorted(owners)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("turn", 952004), ("frequency-step", 952002)])
def test_one_vessel_of_four_lines_that_changes_something_stays_one(kind, seed):
    series = draw(kind, seed).series
    assert series.frequency_hz.shape[1] == 4
    assert find_encounters(series=series, sensor=SENSOR).n_encounters == 1
