"""Joined files: time never slips, gaps stay gaps, blocks do not matter."""

import numpy as np
import pytest
import soundfile

from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.flow.concatenate import join_recordings
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.exports.raven import FileClock
from uwtrack_cli.flow.recorder_folder import Span, group_spans
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.flow.sources import open_with_options

RATE = 1000


def part(folder, name, samples, start_utc, rate=RATE):
    soundfile.write(folder / name, samples, rate, subtype="FLOAT")
    (folder / name).with_suffix(".sensor.toml").write_text('id = "h1"\n')
    return open_with_options(folder / name, {"start_utc": start_utc})


def ramp(first, n):
    return (np.arange(first, first + n) / 2.0**20).astype(np.float32)


@pytest.mark.parametrize("block", [1, 7, 999, 10_000])
def test_samples_lie_where_utc_puts_them(tmp_path, block):
    one = part(tmp_path, "a.wav", ramp(0, 300), "2024-05-01T12:00:00Z")
    two = part(tmp_path, "b.wav", ramp(2300, 200), "2024-05-01T12:00:02.300Z")
    joined, files = join_recordings([one, two], slack_s=0.1)
    sound = np.concatenate(list(joined.reader(block)))[:, 0]
    assert sound.size == joined.n_samples == 2500
    there = np.isfinite(sound)
    np.testing.assert_array_equal(np.flatnonzero(~there), np.arange(300, 2300))
    np.testing.assert_array_equal(sound[there], ramp(0, 2500)[there])
    np.testing.assert_array_equal(files.start_sample, [0, 2300])


def test_names_of_whole_seconds_never_add_up_to_a_slip(tmp_path):
    lengths = [10_400] * 12  # each name tells the second, rounded down
    begins = np.cumsum([0, *lengths[:-1]])
    parts = [
        part(tmp_path, f"{k}.wav", ramp(first, n),
             f"2024-05-01T12:{first // 60_000:02d}:{first // 1000 % 60:02d}Z")
        for k, (first, n) in enumerate(zip(begins, lengths, strict=True))
    ]  # fmt: skip
    joined, files = join_recordings(parts)
    np.testing.assert_array_equal(files.start_sample, begins)
    sound = np.concatenate(list(joined.reader(4096)))[:, 0]
    np.testing.assert_array_equal(sound, ramp(0, sum(lengths)))


def test_a_drift_beyond_the_slack_shows_as_a_gap_and_not_as_a_slip(tmp_path):
    parts = [
        part(tmp_path, f"{k}.wav", ramp(0, 9_700), f"2024-05-01T12:00:{10 * k:02d}Z")
        for k in range(6)
    ]
    _, files = join_recordings(parts)
    off_s = np.abs(files.start_sample / RATE - 10.0 * np.arange(6))
    assert off_s.max() <= 1.0


@pytest.mark.parametrize(
    ("start", "words"),
    [("2024-05-01T12:00:05Z", "before the file before it ends"), (None, "not known")],
)
def test_what_overlaps_or_has_no_time_is_not_joined(tmp_path, start, words):
    one = part(tmp_path, "a.wav", ramp(0, 10_000), "2024-05-01T12:00:00Z")
    two = part(tmp_path, "b.wav", ramp(0, 10_000), start)
    with pytest.raises(DataError, match=words):
        join_recordings([one, two])


def test_another_rate_is_not_joined(tmp_path):
    one = part(tmp_path, "a.wav", ramp(0, 1000), "2024-05-01T12:00:00Z")
    two = part(tmp_path, "b.wav", ramp(0, 1000), "2024-05-01T12:00:01Z", rate=2000)
    with pytest.raises(DataError, match="differ in sensor, channels or rate"):
        join_recordings([one, two])


def test_files_are_grouped_by_recorder_and_by_gap():
    spans = [
        Span(("a",), 100 * 10**9, 10.0), Span(("b",), 105 * 10**9, 10.0),
        Span(("a",), 0, 99.0), Span(("a",), 5000 * 10**9, 10.0),
    ]  # fmt: skip
    assert group_spans(spans) == [(2, 0), (1,), (3,)]


@pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")
def test_a_passage_cut_by_a_gap_is_one_passage(tmp_path, samples):
    sound, rate = soundfile.read(samples / "mono.wav", dtype="float32")
    facts = (samples / "mono.sensor.toml").read_text()
    halves = []
    for k, (first, last) in enumerate([(0, 110_000), (118_000, len(sound))]):
        path = tmp_path / f"{k}.wav"
        soundfile.write(path, sound[first:last], rate, subtype="FLOAT")
        path.with_suffix(".sensor.toml").write_text(facts)
        start = f"2024-05-03T21:{15 + first // 60_000}:{first // 1000 % 60:02d}Z"
        halves.append(open_with_options(path, {"start_utc": start}))
    joined, _ = join_recordings(halves)
    made = run_recipe(joined, load_recipe("vessel"))
    (encounters,) = [c for c in made if isinstance(c, Encounters)]
    claimed = encounters.status == "ok"
    assert np.count_nonzero(claimed) == 1
    assert encounters.time_s[claimed] == pytest.approx([155.0], abs=1.5)
    (levels,) = [c for c in made if isinstance(c, Levels)]
    gap = (levels.frames.time_s > 111) & (levels.frames.time_s < 117)
    np.testing.assert_array_equal(levels.frames.valid_fraction[gap], 0.0)


def test_raven_times_run_through_the_files_without_the_gap(tmp_path):
    one = part(tmp_path, "a.wav", ramp(0, 10_000), "2024-05-01T12:00:00Z")
    two = part(tmp_path, "b.wav", ramp(0, 10_000), "2024-05-01T12:00:30Z")
    clock = FileClock(*join_recordings([one, two]))
    assert clock.place(4.0) == ("a.wav", 4.0, 4.0)
    assert clock.place(33.0) == ("b.wav", 3.0, 13.0)
    assert clock.place(20.0) == ("a.wav", 10.0, 10.0)
