"""Several vessels without lines in one recording: all, once each, and no others."""

from types import SimpleNamespace

import numpy as np
import pytest

from studies.seatrial import analyse
from tests.draws.passage_truth import Scene
from tests.motion.crowded_sound import arrival_s, crowded_levels, drawn_scene
from tests.motion.passing_vessel import lines_of_scenes
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.candidates import examine
from uwtrack_cli.motion.passage.encounter_rows import MOST_FRAMES, Row, add_levels
from uwtrack_cli.motion.passage.model.measurements import PassageData, make_blocks
from uwtrack_cli.simulate import make_scenario

DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0, compass_std_deg=0.0)
CROWDS = {
    "apart": ([(150.0, 250.0), (450.0, 250.0)], [10.0, 10.0]),
    "overlapping": ([(250.0, 250.0), (350.0, 250.0)], [10.0, 10.0]),
    "on a flank": ([(200.0, 250.0), (350.0, 120.0)], [15.0, 5.0]),
    "three": ([(120.0, 150.0), (300.0, 250.0), (480.0, 100.0)], [10.0, 6.0, 3.0]),
}


def crowd(name):
    places, snrs_db = CROWDS[name]
    scenes = [
        Scene(closest_s=t, range_m=d, bearing_deg=40.0 + 110 * k, turn=(-1) ** k)
        for k, (t, d) in enumerate(places)
    ]
    return scenes, snrs_db


def errors(found, scenes):
    """Errors of time, width and bearing in stated deviations, vessel by vessel."""
    width = np.array([scene.range_m / scene.speed_mps for scene in scenes])
    arrival = np.array([arrival_s(scene) for scene in scenes])
    bearing = np.array([scene.bearing_deg for scene in scenes])
    off = (found.bearing_deg - bearing + 180) % 360 - 180
    return np.array(
        [
            (found.time_s - arrival) / found.time_std_s,
            (found.range_over_speed_s - width) / found.range_over_speed_std_s,
            off / found.bearing_std_deg,
        ]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "has_bearing"), [*((name, True) for name in CROWDS), ("three", False)]
)
def test_every_passage_is_found_once(name, has_bearing):
    scenes, snrs_db = crowd(name)
    rng = np.random.default_rng(3)
    levels = crowded_levels(scenes, snrs_db, rng, has_bearing=has_bearing)
    found = find_encounters(None, levels, DIFAR)
    assert found.status.tolist() == ["level-only"] * len(scenes)
    assert len(set(found.contact)) == len(scenes)
    off = errors(found, scenes)
    assert np.all(np.abs(off[:2]) < 4)
    if has_bearing:
        assert np.all(np.abs(off[2]) < 4)
        sides = ["starboard" if scene.turn > 0 else "port" for scene in scenes]
        assert found.side.tolist() == sides
    level = np.abs(found.received_level_db - snrs_db - 100.0)
    assert np.all(level < 4 * found.received_level_std_db + 0.1)


@pytest.mark.parametrize(
    ("spreading_db", "has_bearing"), [(10.0, False), (15.0, True), (25.0, False)]
)
def test_one_passage_under_another_law_of_spreading_is_one(spreading_db, has_bearing):
    levels = crowded_levels(
        [Scene()], [15.0], np.random.default_rng(5),
        has_bearing=has_bearing, spreading_db=spreading_db,
    )  # fmt: skip
    assert find_encounters(None, levels, DIFAR).n_encounters == 1


@pytest.mark.slow
@pytest.mark.parametrize("has_bearing", [False, True], ids=["omni", "vector"])
def test_a_background_that_drifts_is_no_vessel(has_bearing):
    for seed in range(2):
        levels = crowded_levels(
            [], [], np.random.default_rng(seed), has_bearing=has_bearing, drift_db=2.5
        )
        found = find_encounters(None, levels, DIFAR)
        assert not np.isfinite(found.time_s).any()


@pytest.mark.slow
def test_a_vessel_without_lines_is_found_beside_one_with_lines():
    scenes, snrs_db = crowd("apart")
    rng = np.random.default_rng(6)
    lines = lines_of_scenes(scenes[:1], rng)
    found = find_encounters(lines, crowded_levels(scenes, snrs_db, rng), DIFAR)
    assert found.status.tolist() == ["ok", "level-only"]
    assert found.contact.tolist() == [1, 2]
    assert abs(found.speed_mps[0] - 6.0) < 4 * found.speed_std_mps[0]
    assert np.all(np.abs(errors(found, scenes)[1:]) < 4)


def test_bearings_that_may_be_any_show_no_passage():
    """Heard in one cell of noise at the edge of a vessel's broadband: neighbours that share
    their noise are alike, and looked like a path that turns once a scale was fitted."""
    time_s = np.array([35, 35.5, 38.5, 39, 41.5, 43.5, 44, 47, 48, 48.5, 49, 51, 53, 54, 54.5,
                       57, 61.5])  # fmt: skip
    bearing = np.array([33.2, 194.35, 340.91, 24.28, 80.95, 324.51, 310.27, 334.45, 69.47,
                        164.54, *[155.82] * 5, 134.59, 114.98])  # fmt: skip
    std = np.array([*[103.13] * 4, 50.3, 53.91, 49.74, 62.33, 51.19, *[103.13] * 8])
    none = np.empty((0, time_s.size))
    data = PassageData(time_s, none, none, bearing[None], std[None], none, none)
    blocks = make_blocks(data)
    assert np.array_equal(blocks.bearing.weight[0, 0] > 0, std < 100.0)
    assert examine(data, (1,), np.empty(0, int), Medium(1500.0), 1e-3) is None


def test_a_line_that_follows_by_chance_does_not_spoil_the_broadbands_passage():
    scene = Scene(range_m=500.0)
    rng = np.random.default_rng(8)
    chance = Scene(speed_mps=90.0, range_m=7500.0, rest_hz=(890.0,), turn=scene.turn)
    lines = lines_of_scenes([chance], rng)
    heard = (lines.time_s > 260.0) & (lines.time_s < 290.0)
    levels = crowded_levels([scene], [12.0], rng)
    alone = find_encounters(None, levels, DIFAR)
    found = find_encounters(lines.take("point", heard), levels, DIFAR)
    assert found.status.tolist() == alone.status.tolist() == ["level-only"]
    assert found.time_s[0] == pytest.approx(alone.time_s[0], abs=1e-6)


def test_the_broadband_of_two_vessels_with_lines_makes_no_third():
    scenes, snrs_db = crowd("overlapping")
    rng = np.random.default_rng(7)
    lines = lines_of_scenes(scenes, rng)
    found = find_encounters(lines, crowded_levels(scenes, snrs_db, rng), DIFAR)
    assert found.status.tolist() == ["ok", "ok"]
    level = np.abs(found.received_level_db - snrs_db - 100.0)
    assert np.all(level < 4 * found.received_level_std_db + 0.1)


def vessel(time_s, range_m, course_deg, snr_db):
    return {
        "source_depth_m": 3.0,
        "closest_approach": {
            "time_s": time_s, "horizontal_range_m": range_m, "speed_mps": 6.0,
            "course_deg": course_deg, "side": "port",
        },
        "broadband": {"band_hz": [100.0, 900.0], "snr_db": snr_db},
    }  # fmt: skip


@pytest.mark.filterwarnings("ignore:no position for the encounter")
@pytest.mark.parametrize("kind", [pytest.param("omni", marks=pytest.mark.long), "difar"])
def test_two_vessels_without_lines_are_found_in_their_sound(kind):
    scenario = make_scenario({
            "seed": 4, "duration_s": 480.0, "sample_rate_hz": 2000.0,
            "sensor": [
                {"id": "h1", "kind": kind, "depth_m": 25.0, "full_scale_db": 175.0}
            ],
            "vessel": [vessel(150.0, 150.0, 80.0, 5.0), vessel(320.0, 200.0, 200.0, 8.0)],
            "noise": {"density_db": 70.0, "slope_db_per_decade": -10.0},
        },
    )  # fmt: skip
    (found,) = analyse(scenario)
    assert found.status.tolist() == ["level-only"] * 2
    slant = np.hypot([150.0, 200.0], 22.0)
    arrival = np.array([150.0, 320.0]) + slant / 1500.0
    assert np.all(np.abs(found.time_s - arrival) < 4 * found.time_std_s)
    width = np.abs(found.range_over_speed_s - slant / 6.0)
    assert np.all(width < 4 * found.range_over_speed_std_s)
    if kind == "difar":
        off = (found.course_deg - [80.0, 200.0] + 180) % 360 - 180
        assert np.all(np.abs(off) < 4 * found.course_std_deg)


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("has_bearing", [False, True], ids=["omni", "vector"])
def test_deviations_of_two_passages_hold(has_bearing):
    off, n_found, runs = [], 0, 100
    for run in range(runs):
        rng = np.random.default_rng([11, run])
        first = rng.uniform(120.0, 300.0)
        scenes = [drawn_scene(rng, first), drawn_scene(rng, first + rng.uniform(120.0, 200.0))]
        snrs_db = rng.uniform(5.0, 15.0, 2)
        levels = crowded_levels(scenes, snrs_db, rng, has_bearing=has_bearing)
        found = find_encounters(None, levels, DIFAR)
        assert found.n_encounters <= 2
        if found.n_encounters == 2:
            n_found += 1
            off.append(errors(found, scenes)[: 3 if has_bearing else 2])
    assert n_found >= 0.9 * runs
    times = np.abs(np.concatenate([item[[0, -1]].ravel() for item in off]))
    assert (times <= 3).mean() >= 0.98
    if has_bearing:
        assert 0.4 <= np.median(times) <= 1.0


class Heard:
    """A fit of which only the law of its level is asked for."""

    def __init__(self, time_s, width_s):
        self.time_s, self.range_over_speed_s = time_s, np.array([width_s])

    def law(self, time_s):
        u = (time_s - self.time_s) / self.range_over_speed_s
        return SimpleNamespace(spread=-np.log1p(u**2)[None])


def test_the_level_of_a_passage_is_that_over_the_background_of_its_own_time():
    """A day of a harbour: by night it is quieter by 10 dB, and three vessels pass."""
    rng = np.random.default_rng(11)
    time = 0.5 * np.arange(3 * MOST_FRAMES)
    background_db = np.where(time < time[-1] / 2, 80.0, 90.0)
    truth = [(4000.0, 20.0, 90.0), (4100.0, 30.0, 86.0), (25000.0, 40.0, 96.0)]
    fits = [Heard(time_s, width_s) for time_s, width_s, _ in truth]
    power = 10 ** (background_db / 10)
    for fit, (_, _, level_db) in zip(fits, truth, strict=True):
        power += 10 ** (level_db / 10) * np.exp(fit.law(time).spread[0])
    level_db = 10 * np.log10(power) + 0.5 * rng.normal(size=time.size)
    frames = SimpleNamespace(time_s=time)
    levels = SimpleNamespace(frames=frames, level_db=level_db)
    rows = [Row(k, "ok") for k in range(len(truth))]
    for row, (time_s, _, _) in zip(rows, truth, strict=True):
        row.values["time_s"] = time_s
    add_levels(rows, levels, fits, SimpleNamespace(reference="full scale"))
    for row, (_, _, true_db) in zip(rows, truth, strict=True):
        off = row.values["received_level_db"] - true_db
        assert abs(off) < 4 * row.values["received_level_std_db"]
        assert row.values["received_level_std_db"] < 0.5
