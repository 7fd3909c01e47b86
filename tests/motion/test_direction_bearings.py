"""Of several sources that an array hears at once, a contact has its own."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.passage_truth import Scene
from tests.motion.passing_vessel import levels_of_scene, lines_of_scenes
from tests.motion.test_cpa import DIFAR, SCENE, deviations
from uwtrack_cli.data.directions import Directions
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.model.direction_bearings import (
    bearing_series,
    sources_in_time,
    with_directions,
)


def directions_of(time_s, bearings_deg, loudness, rng, std_deg=2.0):
    """Directions of some sources, the loudest of each frame first, errors drawn.

    Returned with the source that each row is.
    """
    order = np.argsort(-np.array(loudness), axis=0)
    rows = [(t, k, s) for k in range(time_s.size) for t, s in enumerate(order[:, k])]
    rank, frame, source = np.array(rows).T
    bearing = np.array(bearings_deg)[source, frame]
    bearing = (bearing + std_deg * rng.standard_normal(bearing.size)) % 360.0
    n, unknown = bearing.size, np.full(bearing.size, np.nan)
    nothing = np.zeros(0)
    made = Directions(
        frame=frame, time_s=time_s[frame], source=rank + 1,
        bearing_deg=bearing, bearing_std_deg=np.full(n, std_deg),
        elevation_deg=np.zeros(n), elevation_std_deg=np.full(n, std_deg),
        slowness_ratio=np.ones(n), slowness_ratio_std=unknown, snr_db=unknown,
        level_db=unknown, range_m=unknown, range_std_m=unknown,
        lobe_frame=np.zeros(0, np.int64), lobe_bearing_deg=nothing,
        lobe_elevation_deg=nothing, lobe_weight=nothing,
        false_alarm_probability=1e-3, band_low_hz=100.0, band_high_hz=900.0,
        method="beams", ambiguity="none", reference="full scale", sensor="a",
    )  # fmt: skip
    return made, source


def passing(time_s, closest_s, width_s, bearing_deg, turn=1.0):
    """Bearing and loudness of a vessel on a straight way."""
    along = (time_s - closest_s) / width_s
    return bearing_deg + turn * np.degrees(np.arctan(along)), 1.0 / (1.0 + along**2)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_source_is_one_contact_while_the_loudest_changes(seed):
    """Two boats on either side; the loudest of the frame is now one, now the other."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, 200.0)
    boats = passing(time_s, 80.0, 15.0, 40.0), passing(time_s, 120.0, 20.0, 230.0, -1.0)
    found, source = directions_of(time_s, *zip(*boats, strict=True), rng)
    assert 0.2 < np.mean(source[found.source == 1]) < 0.8
    owner = sources_in_time(found)
    assert all(np.unique(owner[source == k]).size == 1 for k in (0, 1))
    assert set(owner) == {1, 2}
    passages = find_encounters(directions=found)
    assert passages.contact.size == 2
    order = np.argsort(passages.time_s)
    errors = passages.time_s[order] - np.array([80.0, 120.0])
    assert np.all(np.abs(errors) < 4.0 * passages.time_std_s[order])
    assert np.all(passages.time_std_s < 2.0)


def test_single_false_directions_are_no_contact():
    rng, time_s = np.random.default_rng(3), np.arange(0.0, 200.0)
    bearing, loud = passing(time_s, 80.0, 15.0, 40.0)
    noise = rng.uniform(0.0, 360.0, time_s.size)
    found, source = directions_of(time_s, [bearing, noise], [loud, 0.0 * loud], rng)
    seldom = (source == 0) | (rng.random(source.size) < 0.03)
    found = found.take("direction", np.flatnonzero(seldom))
    series = bearing_series(found)
    assert set(series.contact) == {1}
    assert series.time_s.size >= 195


@pytest.mark.slow
def test_a_contact_with_lines_has_the_source_beside_them():
    """A louder vessel elsewhere, heard in every frame, is not the one that passes."""
    rng = np.random.default_rng(4)
    scene: Scene = replace(SCENE, turn=1)
    levels = levels_of_scene(scene, rng, has_bearing=False)
    lines = lines_of_scenes([scene], rng)
    time_s = np.asarray(levels.frames.time_s)
    truth = levels_of_scene(scene, np.random.default_rng(5)).bearing_deg
    other = np.full(time_s.size, scene.bearing_deg + 120.0)
    loud = np.where(np.abs(time_s - scene.closest_s) < 20.0, [[2.0], [1.0]], [[1.0], [2.0]])
    found, _ = directions_of(time_s, [truth, other], loud, rng, std_deg=1.0)
    passages = find_encounters(lines, levels, DIFAR, directions=found)
    assert passages.status.tolist() == ["ok"]
    assert np.all(np.abs(deviations(passages, 0, scene)) < 4.0)
    course = (scene.bearing_deg + 90.0) % 360.0
    assert abs(passages.course_deg[0] - course) < 4.0 * passages.course_std_deg[0]


def test_a_direction_counts_for_one_frame_of_the_levels():
    rng = np.random.default_rng(6)
    levels = levels_of_scene(SCENE, rng, has_bearing=False)
    time_s = np.asarray(levels.frames.time_s)[::4]
    found, _ = directions_of(time_s, [np.full(time_s.size, 70.0)], [time_s], rng)
    made = with_directions(levels, found)
    assert np.count_nonzero(np.isfinite(made.bearing_deg)) == time_s.size
