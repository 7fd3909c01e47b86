"""What passes within seconds is looked at again in shorter frames."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.brief_passages import car, car_by_auto, passages
from tests.flow.made_encounters import encounters_of
from tests.motion.test_sub_bands import TIME, levels_of
from tests.support import recording_of, white_noise
from uwtrack_cli.data.encounters import MAINS, TOO_FAST, Encounters
from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.data.transients import Transients
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.flow.zoom import zoom_in


def encounters_in(made):
    return [item for item in made if isinstance(item, Encounters)]


def falling_line():
    """Lines that fall within a second, half a minute after the first sample."""
    return Transients(
        time_s=np.array([30.0]), half_length_s=np.array([0.5]), kind=np.array(["fall"]),
        spreads=np.array([9.0]), least_spreads=7.0, sensor="h1",
    )  # fmt: skip


@pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackNote")
def test_a_vehicle_is_found_without_being_expected():
    ((time_s, width_s, speed_mps),) = passages(car())
    (found,) = encounters_in(car_by_auto()[1])
    assert found.status.tolist() == ["ok"]
    assert abs(found.time_s[0] - time_s) < 4 * found.time_std_s[0] + 0.02
    for value, truth in (("speed_mps", speed_mps), ("range_over_speed_s", width_s)):
        stem, unit = value.rsplit("_", 1)
        std = getattr(found, f"{stem}_std_{unit}")[0]
        assert abs(getattr(found, value)[0] - truth) < 3 * std
    assert found.rest_frame_evidence[0] > 0.1


def test_sound_that_does_not_rise_is_not_read_for_shorter_frames(monkeypatch):
    sound = white_noise(40 * 2000, 1, rate_hz=2000.0).astype(np.float32)[:, None]
    recording = recording_of(sound, 2000.0)
    looked = []
    held = replace(recording, reader=HeldSamples(sound))
    monkeypatch.setattr(
        HeldSamples, "segment", lambda *place: looked.append(place[1:]) or sound[:0]
    )
    run_recipe(held, load_recipe("vessel"))  # seeks passages in the vessel's own time
    by_vessel = looked.copy()
    looked.clear()
    (found,) = encounters_in(run_recipe(held, load_recipe("auto")))
    assert found.n_encounters == 0
    assert looked == by_vessel


@pytest.mark.parametrize(
    ("kind", "half_length_s", "n_recipes"),
    [("fall", 2.0, 2), ("level", 0.3, 2), ("level", 1.0, 1), ("lines", 0.3, 1), ("climb", 1.0, 0)],
)
def test_only_what_needs_them_is_looked_at_in_the_shortest_frames(
    kind, half_length_s, n_recipes, monkeypatch
):
    sound = np.zeros((60 * 1000, 1), np.float32)
    recording = replace(recording_of(sound, 1000.0), reader=HeldSamples(sound))
    rises = Transients(
        time_s=np.array([30.0]), half_length_s=np.array([half_length_s]),
        kind=np.array([kind]), spreads=np.array([9.0]), least_spreads=7.0, sensor="h1",
    )  # fmt: skip
    looked = []
    monkeypatch.setattr(
        "uwtrack_cli.flow.zoom._passages", lambda part, _: looked.append(part.duration_s)
    )
    zoom_in([encounters_of()], rises, recording=recording)
    assert looked == [20.0] * n_recipes


def test_segments_whose_sound_has_passed_are_told():
    """A reader that cannot go back: sound made on the way, or a pipe."""
    passed = recording_of(np.zeros((60 * 1000, 1), np.float32), 1000.0)
    rises = Transients(
        time_s=np.array([30.0, 31.0]), half_length_s=np.full(2, 2.0),
        kind=np.array(["fall", "level"]), spreads=np.full(2, 9.0), least_spreads=7.0,
        sensor="h1",
    )  # fmt: skip
    known = encounters_of({"time_s": 31.0, "range_over_speed_s": 2.0, "status": "ok"})
    with pytest.warns(UwtrackWarning, match=r"1 segment of memory.wav, from 20 s on.* again"):
        found = zoom_in([known], rises, recording=passed)
    assert found.time_s.tolist() == [31.0]
    # nothing to look at is nothing left out
    zoom_in([known], recording=passed)


@pytest.mark.parametrize(("kind", "n_found"), [("level", 1), ("fall", 0)])
def test_the_level_alone_must_rise_in_the_whole_recording_too(kind, n_found, monkeypatch):
    """Within twenty seconds a crest of swell has the shape of a passage."""
    sound = np.zeros((60 * 1000, 1), np.float32)
    recording = replace(recording_of(sound, 1000.0), reader=HeldSamples(sound))
    rises = Transients(
        time_s=np.array([30.0]), half_length_s=np.array([0.5]), kind=np.array([kind]),
        spreads=np.array([9.0]), least_spreads=7.0, sensor="h1",
    )  # fmt: skip
    row = {"time_s": 10.5, "range_over_speed_s": 1.0, "status": "level-only"}
    crest = encounters_of(row)
    monkeypatch.setattr("uwtrack_cli.flow.zoom._passages", lambda *_: crest)
    found = zoom_in([encounters_of()], rises, recording=recording, recipes=["vessel"])
    assert found.n_encounters == n_found


def test_what_is_too_fast_for_water_is_told_where_nothing_passes(monkeypatch):
    """The look that refuses it leaves no other trace."""
    sound = np.zeros((60 * 1000, 1), np.float32)
    recording = replace(recording_of(sound, 1000.0), reader=HeldSamples(sound))
    rises = falling_line()
    look = replace(
        encounters_of(), refused_contact=np.array([2]), refused_sensor=np.array(["h1"]),
        refused_from_s=np.array([9.0]), refused_to_s=np.array([11.0]),
        refused_reason=np.array(["149 m/s"]), refused_code=np.array([TOO_FAST]),
        refused_probability=np.array([np.nan]), refused_motion_model=np.array([""]),
        refused_motion_model_probability=np.array([np.nan]),
        refused_alternative_motion_model=np.array([""]), refused_alternative_motion_model_probability=np.array([np.nan]),
    )  # fmt: skip
    monkeypatch.setattr("uwtrack_cli.flow.zoom._passages", lambda *_: look)
    asked = {"recording": recording, "recipes": ["vessel"]}
    with pytest.warns(UwtrackWarning, match="a passage that is none: 149 m/s"):
        zoom_in([encounters_of()], rises, **asked)
    known = {"time_s": 50.0, "range_over_speed_s": 1.0, "status": "ok"}
    zoom_in([encounters_of(known)], rises, **asked)  # warnings are errors
    look = replace(look, refused_code=np.array([MAINS]))
    zoom_in([encounters_of()], rises, **asked)


@pytest.mark.parametrize(("ratio", "n_found"), [(20.0, 1), (1.0, 0)])
def test_a_rise_of_the_level_must_stand_out_of_the_swell(ratio, n_found, monkeypatch):
    sound = np.zeros((240 * 1000, 1), np.float32)
    recording = replace(recording_of(sound, 1000.0), reader=HeldSamples(sound))
    rises = Transients(
        time_s=np.array([120.5]), half_length_s=np.array([2.0]),
        kind=np.array(["level"]), spreads=np.array([9.0]), least_spreads=7.0, sensor="h1",
    )  # fmt: skip
    row = {"time_s": 10.0, "range_over_speed_s": 1.6, "status": "level-only"}
    monkeypatch.setattr("uwtrack_cli.flow.zoom._passages", lambda *_: encounters_of(row))
    swell = 10 ** (0.3 * np.cos(2 * np.pi * (TIME - 120.5) / 10.0))
    law = 1 / (1 + ((TIME - 120.5) / 1.6) ** 2)
    levels = levels_of(np.repeat((swell + ratio * law)[None], 8, axis=0))
    found = zoom_in(
        [encounters_of()], rises, recording=recording, levels=levels, recipes=["vessel"]
    )
    assert found.n_encounters == n_found


def test_frames_of_other_lengths_add_their_passages_once():
    """What both have seen is one row; contact numbers of the first table stay."""
    recording = recording_of(np.zeros((60 * 1000, 1), np.float32), 1000.0)
    both = {"time_s": 20.0, "range_over_speed_s": 8.0}
    first = encounters_of(both)
    longer = encounters_of(both, {"time_s": 45.0, "range_over_speed_s": 8.0})
    found = zoom_in([first, longer], recording=recording)
    assert found.time_s.tolist() == [20.0, 45.0]
    assert found.contact.tolist() == [1, 2]


def test_a_table_that_is_made_again_is_not_kept():
    graph = load_recipe("auto").graph()
    assert "cpa" not in graph.outputs
    assert "long-cpa" not in graph.outputs
    assert "zoom" in graph.outputs
    (zoom,) = [s for s in graph.steps() if s.name == "zoom"]
    assert graph.product_key(zoom) == ""


def test_a_recording_shorter_than_the_long_frames_is_read_in_shorter_ones():
    sound = white_noise(3 * 4000, 1, rate_hz=4000.0).astype(np.float32)[:, None]
    held = replace(recording_of(sound, 4000.0), reader=HeldSamples(sound))
    (found,) = encounters_in(run_recipe(held, load_recipe("auto")))
    assert found.n_encounters == 0


def test_shorter_frames_report_from_the_probability_that_is_asked(monkeypatch):
    asked = []

    def passages(_, graph):
        (last,) = [one for one in graph.steps() if one.stage.output is Encounters]
        asked.append(last.options["probability"])

    monkeypatch.setattr("uwtrack_cli.flow.zoom._passages", passages)
    sound = np.zeros((60 * 1000, 1), np.float32)
    recording = replace(recording_of(sound, 1000.0), reader=HeldSamples(sound))
    rises = falling_line()
    zoom_in([encounters_of()], rises, recording=recording, probability=0.8)
    assert asked
    assert set(asked) == {0.8}


def test_without_the_sound_there_is_nothing_to_look_at():
    with pytest.raises(DataError, match="run the recording itself"):
        zoom_in([encounters_of()])


def test_an_unknown_recipe_is_named():
    recording = recording_of(np.zeros((10, 1)), 10.0)
    with pytest.raises(OptionError, match="no recipe 'vehicles'"):
        zoom_in([encounters_of()], recording=recording, recipes=["vehicles"])
