"""Truth against geometry computed here, and scenarios that are refused."""

import json

import numpy as np
import pytest

from tests.simulate.scenes import DIFAR, OMNI, PASSAGE, TONE, scene, vessel
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate import make_scenario, simulate_recordings, truth


def only(scenario):
    facts = json.loads(json.dumps(truth(scenario)))
    assert len(facts["encounters"]) == 1
    return facts["encounters"][0]


@pytest.mark.parametrize(("side", "bearing"), [("port", 81.0 + 90.0), ("starboard", 351.0)])
def test_encounter_states_the_passage_that_was_asked_for(side, bearing):
    found = only(scene(vessel=[vessel(closest_approach=PASSAGE | {"side": side})]))
    slant = np.hypot(100.0, 19.0)
    assert found["time_s"] == pytest.approx(30.0, abs=1e-9)
    assert found["arrival_time_s"] == pytest.approx(30.0 + slant / 1500.0, abs=1e-9)
    assert found["slant_range_m"] == pytest.approx(slant)
    assert found["horizontal_range_m"] == pytest.approx(100.0)
    assert found["bearing_deg"] == pytest.approx(bearing)
    assert found["course_deg"] == pytest.approx(81.0)
    assert found["side"] == side
    assert found["inside"] is True
    assert found["rest_frequencies_hz"] == [126.0]


def test_knots_and_slant_ranges_mean_the_same_passage():
    way = {k: v for k, v in PASSAGE.items() if k not in ("speed_mps", "horizontal_range_m")}
    way |= {"speed_kn": 8.0 / KNOT_MPS, "slant_range_m": np.hypot(100.0, 19.0)}
    got, asked = (
        only(scene(vessel=[vessel(closest_approach=way)])),
        only(scene(vessel=[vessel()])),
    )
    assert got["speed_mps"] == pytest.approx(asked["speed_mps"])
    assert got["horizontal_range_m"] == pytest.approx(asked["horizontal_range_m"])


def test_passage_outside_the_recording_is_still_listed_and_marked():
    found = only(scene(vessel=[vessel(closest_approach=PASSAGE | {"time_s": 75.0})]))
    assert found["time_s"] == pytest.approx(75.0, abs=1e-9)
    assert found["inside"] is False


def test_noise_alone_and_a_pump_have_no_encounter():
    noise = {"density_db": 60.0}
    assert truth(scene(noise=noise))["encounters"] == []
    assert truth(scene(noise=noise))["vessels"] == []
    pump = {"east_m": 40.0, "course_deg": 0.0, "speed_mps": 0.0}
    still = vessel(closest_approach=None, track=pump)
    assert truth(scene(vessel=[still]))["encounters"] == []


def test_closest_approach_of_two_moving_platforms_is_the_least_distance():
    track = {"east_m": -200.0, "north_m": 30.0, "course_deg": 70.0, "speed_mps": 7.0}
    turn = {"at_s": 20.0, "course_deg": 140.0, "rate_deg_per_s": 5.0}
    boat = DIFAR | {"track": {"course_deg": 340.0, "speed_mps": 3.0, "turn": [turn]}}
    source = vessel(closest_approach=None, track=track)
    found = only(scene(sensor=[boat], vessel=[source]))
    time_s = np.arange(0.0, 60.0, 1e-3)  # by summing velocities, without arcs
    course = np.radians(340.0 + np.clip(5.0 * (time_s - 20.0), 0.0, 160.0))
    east = np.cumsum(3.0 * np.sin(course)) * 1e-3
    north = np.cumsum(3.0 * np.cos(course)) * 1e-3
    away = np.hypot(
        -200.0 + 7.0 * np.sin(np.radians(70.0)) * time_s - east,
        30.0 + 7.0 * np.cos(np.radians(70.0)) * time_s - north,
    )
    assert found["horizontal_range_m"] == pytest.approx(away.min(), abs=0.02)
    assert found["time_s"] == pytest.approx(time_s[away.argmin()], abs=0.1)


def test_track_of_the_truth_passes_the_closest_approach():
    facts = truth(scene(vessel=[vessel()]))
    track = {k: np.array(v) for k, v in facts["vessels"][0]["track"].items()}
    away = np.hypot(track["east_m"], track["north_m"])
    assert track["time_s"][away.argmin()] == 30.0
    assert away.min() == pytest.approx(100.0, abs=1e-3)
    np.testing.assert_allclose(np.diff(track["east_m"]), track["velocity_east_mps"][1:], atol=1e-3)


def test_truth_of_one_sensor_leaves_out_the_other():
    pair = scene(sensor=[OMNI, OMNI | {"id": "h2", "east_m": 50.0}], vessel=[vessel()])
    assert [e["sensor"] for e in truth(pair)["encounters"]] == ["h1", "h2"]
    alone = truth(pair, "h2")
    assert [e["sensor"] for e in alone["encounters"]] == ["h2"]
    assert [s["id"] for s in alone["sensors"]] == ["h2"]


MINIMAL = {"seed": 1, "duration_s": 5.0, "sample_rate_hz": 1000.0, "sensor": [OMNI]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sede": 1}, r"no key 'sede'. Did you mean 'seed'"),
        ({"seed": -1}, r"scenario.seed must be a whole number"),
        ({"seed": 1.5}, r"got 1.5"),
        ({"seed": True}, r"got True"),
        ({"duration_s": float("nan")}, r"duration_s must be a finite number"),
        ({"sensor": []}, "at least one"),
        ({"sensor": [OMNI, OMNI]}, "names of their own"),
        ({"sensor": [{"id": "h1", "depth_m": 3.0}]}, r"sensor\[1\]: give either"),
        ({"sensor": [OMNI | {"kind": "mono"}]}, "'omni', 'difar', 'array', got 'mono'"),
        ({"sensor": {"id": "h1"}}, "must be a list"),
        ({"sensor": [OMNI | {"latitude": 3.0}]}, "go together"),
        ({"vessel": [{"line": []}]}, "exactly one of closest_approach and track"),
        ({"vessel": [vessel(track={"course_deg": 0.0})]}, "exactly one of"),
        ({"vessel": [vessel(line=[{"frequency_hz": 5.0}])]}, "cn0_db_hz"),
        ({"vessel": [vessel(turn=[{"at_s": 3.0, "course_deg": 0.0}])]}, "follow"),
        ({"vessel": ["ferry"]}, r"vessel\[1\] must be a table"),
        ({"start_utc": "noon"}, "like 2024"),
        ({"vessel": [vessel(line=[TONE | {"harmonics": 2}])]}, "fundamental_hz"),
        ({"vessel": [vessel(sounding_s=[3.0, 4.0])]}, "sounding_s must last"),
    ],
)
def test_unclear_scenario_is_refused_with_its_place(changes, message):
    with pytest.raises(OptionError, match=message):
        make_scenario(MINIMAL | changes)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (vessel(line=[{"frequency_hz": 499.0, "source_level_db": 1.0}]), "below"),
        (vessel(line=[{"frequency_hz": 50.0, "cn0_db_hz": 30.0}]), "noise"),
        (
            vessel(broadband={"band_hz": [10.0, 490.0], "source_level_db": 1.0}),
            "0.48 of the sample rate",
        ),
        (vessel(closest_approach=PASSAGE | {"sensor": "h9"}), "h9"),
        (
            vessel(
                closest_approach={k: v for k, v in PASSAGE.items() if k != "horizontal_range_m"}
                | {"slant_range_m": 5.0}
            ),
            "depth difference",
        ),
        (vessel(closest_approach=PASSAGE | {"speed_mps": 900.0}), "sound speed"),
    ],
)
def test_impossible_sound_is_refused_when_it_is_made(source, message):
    with pytest.raises(OptionError, match=message):
        simulate_recordings(scene(vessel=[source]))


def test_vessel_that_comes_back_has_an_encounter_each_time():
    way = [[-300.0, 100.0], [150.0, 100.0], [150.0, -80.0], [-300.0, -80.0]]
    track = {"waypoints_m": way, "speed_mps": 10.0, "turn_radius_m": 40.0}
    source = vessel(closest_approach=None, track=track)
    found = truth(scene(vessel=[source], duration_s=120.0))["encounters"]
    assert [e["side"] for e in found] == ["starboard"] * 3
    ranges = [e["horizontal_range_m"] for e in found]
    assert ranges == pytest.approx([100.0, 150.0, 80.0])
    assert [e["bearing_deg"] for e in found] == pytest.approx([0.0, 90.0, 180.0])


def test_overlapping_turns_and_crowded_waypoints_are_refused():
    turns = [{"at_s": t, "course_deg": c} for t, c in ((35.0, 200.0), (40.0, 0.0))]
    with pytest.raises(OptionError, match="before the last one has ended"):
        truth(scene(vessel=[vessel(turn=turns)]))
    way = [[0.0, 50.0], [30.0, 50.0], [30.0, 90.0]]
    crowded = {"waypoints_m": way, "turn_radius_m": 40.0, "speed_mps": 5.0}
    with pytest.raises(OptionError, match="too close for turn_radius_m"):
        truth(scene(vessel=[vessel(closest_approach=None, track=crowded)]))
