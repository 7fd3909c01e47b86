"""Events of live sound: in time, and in accord with the file."""

import io
import json
from datetime import UTC, datetime

import jsonschema
import numpy as np
import pytest
import soundfile

from tests.flow.live_day import compare, measure
from tests.support import recording_of, white_noise
from uwtrack_cli.cli.json_schemas import json_schema
from uwtrack_cli.flow.live_events import WITHDRAWN, LiveWatch, _Passages
from uwtrack_cli.simulate import make_scenario, simulate_recordings
from uwtrack_cli.spectra.levels import condense, measure_levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE = 1000
PASS_S, WIDTH_S = 40.0, 6.0


def scenario():
    vessel = {
        "name": "launch",
        "closest_approach": {
            "time_s": PASS_S, "horizontal_range_m": 60.0, "speed_mps": 10.0,
            "course_deg": 90.0, "side": "port",
        },
        "line": [{"fundamental_hz": 60.0, "harmonics": 3, "cn0_db_hz": 40.0}],
    }  # fmt: skip
    sensor = {"id": "h1", "kind": "omni", "depth_m": 10.0, "full_scale_db": 155.0}
    return make_scenario(
        {"seed": 3, "duration_s": 110.0, "sample_rate_hz": float(RATE),
         "sensor": [sensor], "vessel": [vessel],
         "noise": {"density_db": 70.0, "slope_db_per_decade": -17.0}}
    )  # fmt: skip


@pytest.fixture(scope="session")
def told(tmp_path_factory):
    """A simulated passage through `run -`: its events, the folder with the file, and how
    much sound was taken beyond what was said to have come whenever more had come, s."""
    from typer.testing import CliRunner

    from uwtrack_cli.cli.app import app

    folder = tmp_path_factory.mktemp("told")
    (recording,) = simulate_recordings(scenario())
    sound = np.concatenate(list(recording.reader(1 << 16)))
    soundfile.write(folder / "pass.wav", sound, RATE, "PCM_16")
    content = (folder / "pass.wav").read_bytes()

    words = ["run", "-", "--json", "-o", str(folder / "live.h5")]
    words += ["--start-utc", "2024-05-01T12:00:00Z"]
    ahead_s, advanced = [], LiveWatch.advanced

    def noted(watch, now_s):
        ahead_s.append(watch._recording.reader.n_samples / RATE - now_s)
        advanced(watch, now_s)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LiveWatch, "advanced", noted)
        done = CliRunner().invoke(app, words, input=content)
    assert done.exit_code == 0, done.output
    return done.stdout, folder, ahead_s


def events_of(text, kind):
    rows = [json.loads(line) for line in text.splitlines()]
    return [row for row in rows if row["event"] == kind]


def test_a_passage_is_told_in_time_and_as_the_file_has_it(told, uwtrack):
    events = events_of(told[0], "encounter")
    first, *_, last = events
    assert not first["final"]
    assert first["decided_s"] - first["time_s"] <= 2 * WIDTH_S + 30.0
    assert [event["revision"] for event in events] == list(range(len(events)))
    assert [event["final"] for event in events[:-1]] == [False] * (len(events) - 1)
    assert last["final"]
    assert last["decided_s"] - last["time_s"] <= 4 * WIDTH_S + 90.0
    shown = uwtrack("show", told[1] / "live.h5", "encounters", "--format", "json")
    (in_file,) = json.loads(shown.stdout)
    for event in (first, last):
        for name in ("time", "speed"):
            unit = {"time": "s", "speed": "mps"}[name]
            std = event[f"{name}_std_{unit}"]
            truth = {"time": PASS_S, "speed": 10.0}[name]
            assert abs(event[f"{name}_{unit}"] - truth) < 4.0 * std + 1e-3 * truth
            if event is last:
                off = event[f"{name}_{unit}"] - in_file[f"{name}_{unit}"]
                assert abs(off) <= std
    assert last["status"] == in_file["status"] == "ok"
    assert last["time_utc"] == in_file["time_utc"]


def test_no_sound_waits_for_frames_that_are_longer(told):
    """`auto` has frames of 0.1 to 12 s: what is told rests on what has come by then."""
    assert len(told[2]) > 40
    assert min(told[2]) >= 0.0
    assert max(told[2]) <= 2.0


@pytest.mark.slow
def test_the_file_is_that_of_the_sound_run_at_once(told, uwtrack):
    folder = told[1]
    start = ("--start-utc", "2024-05-01T12:00:00Z", "-q")
    assert uwtrack("run", folder / "pass.wav", *start).exit_code == 0
    done = uwtrack("diff", folder / "pass.run.h5", folder / "live.h5")
    assert done.exit_code == 0, done.stdout


def test_every_event_has_its_keys_and_every_line_an_end(told):
    check = jsonschema.Draft202012Validator(json_schema("events"))
    for line in told[0].splitlines():
        check.validate(json.loads(line))
    lines = events_of(told[0], "line")
    begin = datetime(2024, 5, 1, 12, tzinfo=UTC)
    for row in map(json.loads, told[0].splitlines()):
        if row.get("time_s") is not None:
            since = datetime.fromisoformat(row["time_utc"]) - begin
            assert since.total_seconds() == pytest.approx(row["time_s"], abs=1e-3)
    ended = {row["line"] for row in lines if row["final"]}
    assert ended == {row["line"] for row in lines}
    spans = [row["end_time_s"] - row["time_s"] for row in lines if row["final"]]
    assert max(spans) > 60.0


def test_what_is_heard_is_told_before_it_passes_and_agrees_with_the_file(told, uwtrack):
    events = events_of(told[0], "presence")
    vessel = [event for event in events if event["n_lines"] >= 3]
    assert {event["segment"] for event in vessel} == {vessel[0]["segment"]}
    assert [event["revision"] for event in vessel] == list(range(len(vessel)))
    assert vessel[0]["from_s"] < PASS_S
    assert not vessel[0]["final"]
    assert vessel[-1]["final"]
    shown = uwtrack("show", told[1] / "live.h5", "presence", "--format", "json")
    in_file = [row for row in json.loads(shown.stdout) if row["n_lines"] >= 3]
    assert len(in_file) == 1
    for key in ("kind", "n_lines", "spacing_hz"):
        assert [vessel[-1][key]] == [row[key] for row in in_file]
    (number,) = {event["contact"] for event in events_of(told[0], "encounter")}
    assert vessel[-1]["encounter"] == number
    ends = {event["segment"] for event in events if event["final"]}
    assert ends == {event["segment"] for event in events}


def test_the_last_word_on_everything_is_that_of_the_file(told, uwtrack):
    """And what was final before the end has not changed since; `live_day` asks a day."""
    shown = [
        uwtrack("show", told[1] / "live.h5", name, "--format", "json")
        for name in ("encounters", "presence")
    ]
    events = [json.loads(line) for line in told[0].splitlines()]
    found = compare(events, *(json.loads(one.stdout) for one in shown), 140.0)
    assert found["n_paired"] == found["n_told"] == found["n_encounters"] == 1
    assert found["n_withdrawn"] == found["n_changed_after_final"] == 0
    assert found["greatest_difference_in_deviations"] < 1.0
    assert found["told_after_2_widths_s"] <= 30.0
    assert found["final_after_4_widths_s"] <= 90.0
    assert found["n_presence_told_the_same"] == found["n_presence"] > 0


@pytest.mark.long
def test_the_events_of_a_drawn_hour_are_those_of_its_file(tmp_path):
    found = measure(tmp_path, 1.0, 3, 500.0)
    assert found["files_equal"]
    assert found["n_paired"] == found["n_told"] == found["n_encounters"] == 3
    assert found["n_changed_after_final"] == 0
    assert found["greatest_difference_in_deviations"] < 1.0
    assert found["told_after_2_widths_s"] <= 30.0
    assert found["final_after_4_widths_s"] <= 90.0


def test_noise_with_a_gap_is_told_as_a_gap_and_as_nothing_else(uwtrack):
    sound = 0.1 * np.random.default_rng(5).standard_normal(90 * RATE)
    sound[20 * RATE : 25 * RATE] = np.nan
    memory = io.BytesIO()
    soundfile.write(memory, sound, RATE, "FLOAT", format="WAV")
    words = ("run", "-", "--json", "-o", "n.h5")
    done = uwtrack(*words, input=memory.getvalue())
    assert done.exit_code == 0, done.output
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert not [row for row in rows if row["event"] == "encounter"]
    (gap,) = [row for row in rows if row["event"] == "gap"]
    facts = {key: gap[key] for key in ("time_s", "duration_s", "final", "revision")}
    assert facts == {"time_s": 20.0, "duration_s": 5.0, "final": True, "revision": 0}


def test_condensed_blocks_give_the_same_levels():
    """A scan takes what it condensed in the place of a block, to the bit."""
    recording = recording_of(white_noise(120 * RATE, 2, rate_hz=RATE), RATE)
    blocks = list(compute_spectrogram(recording, window_s=0.5))
    options = {"band_hz": (50.0, 400.0), "n_bands": 8}
    whole = list(measure_levels(iter(blocks), **options))
    small = [condense(block, **options) for block in blocks]
    assert sum(b.nbytes for b in small) < 0.5 * sum(b.nbytes for b in blocks)
    again = list(measure_levels(iter(small), **options))
    assert all(a.equals(b) for a, b in zip(whole, again, strict=True))


def passage(time_s, speed_mps=5.0, std=0.1, **more):
    return {
        "status": "ok", "time_s": time_s, "time_std_s": std, "speed_mps": speed_mps,
        "speed_std_mps": std, "range_over_speed_s": 20.0,
        "range_over_speed_std_s": std, "horizontal_range_over_speed_s": 20.0,
        "rest_frequencies_hz": [60.0], "reasons": {}, **more,
    }  # fmt: skip


@pytest.fixture
def passages():
    said = []

    def say(kind, time_s, row, revision, *, is_final):
        said.append((row["contact"], revision, is_final, row["status"], time_s))
        assert kind == "encounter"

    return _Passages(say), said


def test_a_revision_is_told_for_news_only(passages):
    known, said = passages
    known.see(passage(100.0), 160.0)
    known.see(passage(100.05), 160.0)  # within a deviation
    known.see(passage(100.4), 400.0)  # moved
    known.see(passage(100.4, std=0.01), 160.0)  # much sharper
    known.see(passage(160.0), 160.0)  # another one
    known.see(passage(100.0, rest_frequencies_hz=[91.0]), 160.0)  # another machine
    assert said == [
        (1, 0, False, "ok", 100.0),
        (1, 1, False, "ok", 100.4),
        (1, 2, False, "ok", 100.4),
        (2, 0, False, "ok", 160.0),
        (3, 0, False, "ok", 100.0),
    ]


def test_what_more_sound_does_not_confirm_is_withdrawn(passages):
    known, said = passages
    known.see(passage(100.0), 160.0)
    known.see(passage(300.0), 160.0)
    assert not known.some_are_due(239.0)
    assert known.some_are_due(240.0)
    known.decide([passage(300.0)], 240.0)
    assert said[-1] == (1, 1, True, WITHDRAWN, 100.0)
    known.decide([passage(300.1)], 440.0)
    assert said[-1] == (2, 1, True, "ok", 300.1)
    known.see(passage(299.0), 400.0)  # it is decided
    assert len(said) == 4


def test_the_whole_sound_has_the_last_word(passages):
    known, said = passages
    for time_s in (100.0, 300.0, 500.0):
        known.see(passage(time_s), 160.0)
        known.decide([passage(time_s)], time_s + 140.0)
    del said[:]
    known.finish([passage(100.05), passage(305.0), passage(700.0)])
    assert sorted(said) == [
        (2, 2, True, "ok", 305.0),
        (3, 2, True, WITHDRAWN, 500.0),
        (4, 0, True, "ok", 700.0),
    ]
