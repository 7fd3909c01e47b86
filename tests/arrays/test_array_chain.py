"""From the sound of a towed array to motions, against the simulated truth."""

import json

import numpy as np
import pytest

from tests.draws.array_scenes import TURN, scene, truth_at
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.files.tables.sensors import find_sensor
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.motion.tma import estimate_motion
from uwtrack_cli.simulate.recordings import simulate_recordings

pytestmark = pytest.mark.filterwarnings("ignore:hydrophones 3 m apart")


def run(scenario, *settings) -> dict[type[Container], Container]:
    (recording,) = simulate_recordings(scenario)
    recipe = load_recipe("towed-array").with_settings(settings)
    return {type(made): made for made in run_recipe(recording, recipe)}


def assert_near_truth(motions, row, scenario, deviations=4.0):
    for name, wanted in truth_at(scenario, motions.time_s[row]).items():
        got = getattr(motions, name)[row]
        stem, unit = name.rsplit("_", 1)
        std = getattr(motions, f"{stem}_std_{unit}")[row]
        error = got - wanted
        if unit == "deg":
            error = (error + 180.0) % 360.0 - 180.0
        assert abs(error) < deviations * std, (name, got, wanted, std)


@pytest.mark.slow
def test_lines_of_a_vessel_on_the_other_side_hold_through_the_turn():
    turn = {"at_s": 110.0, "course_deg": 80.0, "rate_deg_per_s": 2.0}
    made = run(scene(turn=[turn], place=(-1100.0, 300.0)), "beamform.side=starboard")
    lines = made[Lines]
    assert lines.line_contact.tolist() == [1, 1]
    for line in lines.line_id:
        heard = lines.time_s[(lines.line == line) & ~np.isnan(lines.measured_bearing_deg)]
        assert heard.min() < 40.0
        assert heard.max() > 240.0


@pytest.mark.slow
def test_a_vessel_without_lines_is_followed_by_its_noise():
    noise = {"band_hz": [40.0, 240.0], "source_level_db": 152.0}
    scenario = scene(turn=[TURN], broadband=noise)
    made = run(scenario)
    assert made[Lines].line_id.size == 0
    motions = made[Motions]
    assert motions.contact.tolist() == [1]
    assert_near_truth(motions, 0, scenario)
    assert motions.range_std_m[0] < 0.25 * motions.range_m[0]


@pytest.fixture(scope="session")
def turned():
    """What a run makes of the scene with a turn."""
    return run(scene(turn=[TURN]))


def test_a_turn_settles_the_side_and_the_motion(turned):
    scenario = scene(turn=[TURN])
    motions = turned[Motions]
    assert motions.contact.tolist() == [1]
    assert motions.weight[0] > 0.95
    assert_near_truth(motions, 0, scenario)


@pytest.mark.slow
def test_without_a_turn_both_sides_stay_and_mirror_each_other():
    scenario = scene()
    motions = run(scenario)[Motions]
    assert motions.mode.tolist() == [1, 2]
    assert motions.weight == pytest.approx([0.5, 0.5], abs=0.1)
    off = (motions.bearing_deg - 20.0) % 360.0
    assert off.sum() == pytest.approx(360.0, abs=0.1)
    turned = (motions.course_deg - 20.0) % 360.0
    assert turned.sum() == pytest.approx(360.0, abs=0.5)
    assert motions.range_m[1] == pytest.approx(motions.range_m[0], rel=1e-3)
    true = int(np.argmin(np.abs(off - 45.0)))
    assert_near_truth(motions, true, scenario)


@pytest.fixture(scope="session")
def sample(tmp_path_factory, samples):
    folder = tmp_path_factory.mktemp("array")
    for path in samples.glob("towed-array.*"):
        (folder / path.name).write_bytes(path.read_bytes())
    return folder


@pytest.fixture
def in_sample(uwtrack, sample, monkeypatch):
    monkeypatch.chdir(sample)
    return uwtrack


@pytest.mark.slow
def test_run_ends_in_the_motion_of_the_sample(in_sample, sample):
    done = in_sample("run", "towed-array.wav", "--json", "--overwrite")
    assert done.exit_code == 0, done.output
    (motion,) = json.loads(done.stdout)
    truth = json.loads((sample / "towed-array.truth.json").read_text())
    array, vessel = truth["sensors"][0]["track"], truth["vessels"][0]["track"]
    east, north = (
        np.interp(motion["time_s"], vessel["time_s"], vessel[name])
        - np.interp(motion["time_s"], array["time_s"], array[name])
        for name in ("east_m", "north_m")
    )
    wanted = {
        "range_m": np.hypot(east, north),
        "bearing_deg": np.degrees(np.arctan2(east, north)) % 360.0,
        "speed_mps": 6.0,
        "course_deg": 310.0,
    }
    for name, value in wanted.items():
        stem, unit = name.rsplit("_", 1)
        assert abs(motion[name] - value) < 4.0 * motion[f"{stem}_std_{unit}"], name
    assert motion["weight"] > 0.95


@pytest.mark.slow
def test_stage_by_stage_gives_what_run_gives(in_sample):
    for words in (
        ("beamform", "towed-array.wav", "--stop-s", 60),
        ("track", "towed-array.beams.h5"),
        ("tma", "towed-array.lines.h5"),
        ("run", "towed-array.wav", "-o", "whole.run.h5", "--stop-s", 60),
    ):
        done = in_sample(*words, "--overwrite")
        assert done.exit_code == 0, done.output
    with (
        read_product(in_path("towed-array.motions.h5")) as staged,
        read_product(in_path("whole.run.h5")) as whole,
    ):
        assert staged.read(Motions).equals(whole.read(Motions))
        held = {key.name for key in whole.paths}
        assert {"bearing_time", "lines", "sensor", "navigation"} <= held
        assert "peaks" not in held
    with read_product(in_path("towed-array.beams.h5")) as beams:
        peaks = beams.read(Peaks)
        assert peaks.cone_deg is not None
    done = in_sample("rerun", "towed-array.lines.h5", "-o", "again.h5", "--overwrite")
    assert done.exit_code == 0, done.output
    done = in_sample("diff", "towed-array.lines.h5", "again.h5")
    assert done.exit_code == 0, done.output


def in_path(name):
    from pathlib import Path

    return Path.cwd() / name


def test_pictures_of_an_array_are_drawn(in_sample, sample):
    done = in_sample("beamform", "towed-array.wav", "--overwrite", "--stop-s", 60)
    assert done.exit_code == 0, done.output
    done = in_sample("plot", "towed-array.beams.h5", "-o", "b.png", "--overwrite")
    assert done.exit_code == 0, done.output
    assert (sample / "b.png").stat().st_size > 20_000


def test_a_closest_approach_is_refused_and_tma_named(in_sample):
    words = ("run", "towed-array.wav", "--recipe", "vessel", "-o", "v.h5")
    done = in_sample(*words, "--stop-s", 60)
    assert done.exit_code == 1
    assert "uwtrack tma" in " ".join(done.output.split())


def test_own_ship_on_the_command_line_takes_the_place_of_the_sensors(in_sample, sample):
    rows = (sample / "towed-array.nav.csv").read_text().splitlines()
    moved = [rows[0], *(shifted(row) for row in rows[1:])]
    (sample / "other.csv").write_text("\n".join(moved) + "\n")
    done = in_sample(
        "beamform", "towed-array.wav", "--own-ship", "other.csv", "-o", "o.h5",
        "--stop-s", 60, "--overwrite",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "other.csv is taken instead" in " ".join(done.output.split())
    from uwtrack_cli.data.bearing_time import BearingTime

    with read_product(sample / "o.h5") as product:
        record = product.read(BearingTime)
    assert record.east_m.mean() > 900.0


def shifted(row):
    time_s, east_m, rest = row.split(",", 2)
    return f"{time_s},{float(east_m) + 1000.0},{rest}"


def test_own_ship_of_a_fixed_array_is_refused(in_sample, sample):
    text = (sample / "towed-array.sensor.toml").read_text()
    drop = ("navigation", "heading_source", "tow_offset_m")
    lines = [line for line in text.splitlines() if not line.startswith(drop)]
    fixed = sample / "fixed.toml"
    fixed.write_text("\n".join([*lines, "heading_deg = 20.0"]) + "\n")
    done = in_sample(
        "beamform", "towed-array.wav", "--sensor", fixed, "-o", "f.h5",
        "--own-ship", "towed-array.nav.csv",
    )  # fmt: skip
    assert done.exit_code == 1
    assert "leave out one of them" in " ".join(done.output.split())


def test_the_ships_navigation_is_refused_where_the_arrays_is_known(turned):
    from uwtrack_cli.data.bearing_time import BearingTime

    time_s = np.arange(100.0)
    ship = Navigation(time_s=time_s, east_m=time_s, north_m=time_s, heading_deg=0.0 * time_s)
    with pytest.raises(DataError, match="uwtrack beamform"):
        estimate_motion(None, turned[Lines], ship, None, turned[BearingTime], array_heading="auto")


def test_find_sensor_finds_the_array(sample):
    sensor = find_sensor(sample / "towed-array.wav")
    assert sensor is not None
    assert sensor.is_array
