"""Files of recorders: which follow each other, where they are cut, what counts once."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from uwtrack_cli.data.recording import GUARD_S
from uwtrack_cli.errors import DataError, UwtrackWarning
from uwtrack_cli.files.utc import parse_utc
from uwtrack_cli.flow.concatenate import clip_recording, join_recordings
from uwtrack_cli.flow.exports.raven import FileClock
from uwtrack_cli.flow.recorder_folder import (
    DAY_NS,
    Joining,
    OwnSpan,
    Span,
    distinct_passages,
    find_span,
    group_spans,
    plan_parts,
    remarks,
)
from uwtrack_cli.flow.sources import open_with_options

S = 10**9
MIDNIGHT = parse_utc("2024-05-02T00:00:00Z")
RATE = 1000


def files(starts_s, length_s=20.0, recorder=("a", 1000, 1)):
    return [Span(recorder, MIDNIGHT + round(s * S), length_s) for s in starts_s]


def test_a_clock_set_back_begins_another_recording():
    before = files(range(-100, 100, 20))
    after = files(range(53, 153, 20))  # goes on at 100 s, as if it were 53 s
    spans = before + after
    groups = group_spans(spans)
    assert groups == [tuple(range(10)), tuple(range(10, 15))]
    paths = [Path(f"{k:02d}.wav") for k in range(15)]
    said = list(remarks(paths, spans, Joining(), is_joined=True))
    assert said[0] == "10 files from 00.wav on follow each other without a gap."
    assert any("10.wav begins 47.0 s before 09.wav ends" in text for text in said)


def test_another_rate_is_another_recording_and_said():
    slow = files([0, 20], recorder=("a", 1000, 1))
    fast = files([40, 60], recorder=("a", 2000, 1))
    assert group_spans(slow + fast) == [(0, 1), (2, 3)]
    paths = [Path(f"{k}.wav") for k in range(4)]
    said = " ".join(remarks(paths, slow + fast, Joining(), is_joined=False))
    assert "from 1000 to 2000 Hz at 2.wav" in said
    assert "--join --per day" in said


def test_hours_without_sound_are_a_gap_of_the_day_that_is_said_with_its_length():
    spans = files([-40_000, -39_980, -5_000, -4_980])
    paths = [Path(f"{k}.wav") for k in range(4)]
    (part,) = plan_parts(spans, Joining(per="day"))
    assert part.files == (0, 1, 2, 3)
    by_day = list(remarks(paths, spans, Joining(per="day"), is_joined=True))
    assert by_day == ["4 files from 0.wav on follow each other with 1 gap of 34960.0 s together."]
    apart = list(remarks(paths, spans, Joining(), is_joined=True))
    assert len(apart) == 2
    assert all("2 files" in text for text in apart)


def test_parts_tile_the_recording_and_read_beside_themselves():
    spans = files(range(-100, 100, 20))
    one, two = plan_parts(spans, Joining(per="day", overlap_s=30.0))
    assert (one.files, two.files) == (tuple(range(7)), tuple(range(3, 10)))
    assert (one.own_ns[1], two.own_ns[0]) == (MIDNIGHT, MIDNIGHT)
    assert (one.first, two.first) == (0, 5)
    assert (one.label, two.label) == ("2024-05-01", "2024-05-02")
    assert one.own_ns[0] < spans[0].start_utc_ns
    parts = plan_parts(spans, Joining(per="file", overlap_s=30.0))
    assert [part.first for part in parts] == list(range(10))
    edges = [part.own_ns for part in parts]
    assert all(a[1] == b[0] for a, b in itertools.pairwise(edges))


def test_a_file_over_midnight_is_in_both_days_and_a_gap_in_none():
    over = files([-10.0], length_s=20.0)
    assert [p.label for p in plan_parts(over, Joining(per="day"))] == ["2024-05-01", "2024-05-02"]
    apart = files([0.0, 3.0 * DAY_NS / S])
    labels = [p.label for p in plan_parts(apart, Joining(per="day"))]
    assert labels == ["2024-05-02", "2024-05-05"]


def own(begin_s, end_s, *names):
    return OwnSpan(round(begin_s * S), round(end_s * S), frozenset(names))


def time_of(row):
    return None if row is None else (round(row * S), 0.1)


def test_a_passage_at_the_cut_counts_once_wherever_its_estimates_lie():
    owns = [own(0, 100, "a", "b"), own(100, 200, "b", "c")]
    for here, there in ((99.9, 100.1), (100.1, 99.9), (99.8, 99.9), (100.1, 100.3)):
        kept = distinct_passages([[50.0, here], [there, 150.0]], owns, time_of)
        assert sum(map(len, kept)) == 3
    kept = distinct_passages([[100.2], [100.1]], owns, time_of)
    assert kept == [[], [100.1]]  # it is the later part's own


def test_two_vessels_at_the_cut_are_two():
    owns = [own(0, 100, "a", "b"), own(100, 200, "b")]
    kept = distinct_passages([[99.0, 101.0], [99.1, 101.1]], owns, time_of)
    assert sum(map(len, kept)) == 2
    kept = distinct_passages([[99.0], [99.1, 130.0]], owns, time_of)
    assert sum(map(len, kept)) == 2


def test_times_that_are_not_sure_are_one_passage_farther_apart():
    owns = [own(0, 100, "a", "b"), own(100, 200, "b")]
    for apart_s, count in ((11.0, 1), (30.0, 2)):
        parts = [[90.0], [90.0 + apart_s]]
        kept = distinct_passages(parts, owns, lambda row: (round(row * S), 4.0))
        assert sum(map(len, kept)) == count


def test_parts_of_other_recordings_have_passages_of_their_own():
    apart = [own(0, 100, "a"), own(100, 200, "z"), None]
    kept = distinct_passages([[99.9], [100.1], [100.0]], apart, time_of)
    assert kept == [[99.9], [100.1], [100.0]]
    unknown = distinct_passages([[None], [None]], [own(0, 1, "a"), own(1, 2, "a")], time_of)
    assert unknown == [[None], [None]]


def test_short_parts_share_a_passage_over_several_of_them():
    owns = [own(20 * k, 20 * k + 20, k, k + 1) for k in range(8)]
    near = [[70.0 + 0.1 * k] if abs(20 * k + 10 - 70) <= GUARD_S else [] for k in range(8)]
    kept = distinct_passages(near, owns, time_of)
    assert kept == [[], [], [], [70.3], [], [], [], []]


def written(folder, name, samples):
    soundfile.write(folder / name, samples, RATE, subtype="FLOAT")
    (folder / name).with_suffix(".sensor.toml").write_text('id = "h1"\n')
    return open_with_options(folder / name, {})


def test_a_clipped_recording_is_the_sound_of_its_span(tmp_path):
    ramp = (np.arange(10_000) / 2.0**20).astype(np.float32)
    whole = written(tmp_path, "h1_20240501_120000.wav", ramp)
    start = whole.start_utc_ns
    part = clip_recording(whole, start + 2 * S, start + 5 * S)
    assert (part.first_sample, part.n_samples) == (2000, 3000)
    assert part.start_utc_ns == start + 2 * S
    np.testing.assert_array_equal(next(iter(part.reader(9000)))[:, 0], ramp[2000:5000])
    np.testing.assert_array_equal(part.segment(1.0, 2.0)[:, 0], ramp[3000:4000])
    assert clip_recording(whole, start - S, start + 60 * S) is whole
    assert clip_recording(whole, start + 60 * S, start + 70 * S) is None


def test_raven_counts_what_a_part_left_out_of_its_first_file(tmp_path):
    one = written(tmp_path, "h1_20240501_120000.wav", np.zeros(10_000))
    two = written(tmp_path, "h1_20240501_120010.wav", np.zeros(10_000))
    clipped = clip_recording(one, one.start_utc_ns + 4 * S, two.start_utc_ns)
    span = (one.start_utc_ns, two.start_utc_ns)
    clock = FileClock(*join_recordings([clipped, two], own_ns=span))
    assert clock.place(1.0) == ("h1_20240501_120000.wav", 5.0, 5.0)
    assert clock.place(8.0) == ("h1_20240501_120010.wav", 2.0, 12.0)


class BreaksOff:
    """A reader that cannot go on after so many samples."""

    def __init__(self, n_samples):
        self.n_samples = n_samples

    def __call__(self, _):
        yield np.zeros((self.n_samples, 1), np.float32)
        msg = "a.wav cannot be read further."
        raise DataError(msg)


@pytest.mark.filterwarnings("ignore:channel 1 of .* does not change")
@pytest.mark.parametrize("block", [7, 300, 5000])
def test_where_a_file_breaks_off_the_rest_is_a_gap(tmp_path, block):
    one = written(tmp_path, "h1_20240501_120000.wav", np.zeros(1000))
    swing = np.resize([0.5, -0.5], 1000)
    two = written(tmp_path, "h1_20240501_120001.wav", swing)
    broken = replace(one, reader=BreaksOff(400))
    joined, _ = join_recordings([broken, two])
    with pytest.warns(UwtrackWarning, match="rest of the file is a gap"):
        sound = np.concatenate(list(joined.reader(block)))[:, 0]
    assert np.isnan(sound[400:1000]).all()
    np.testing.assert_array_equal(sound[1000:], swing)
    changed = replace(one, reader=BreaksOff(1000))
    with pytest.raises(DataError, match="cannot be read further"):
        list(join_recordings([changed, two])[0].reader(block))


def test_a_local_time_that_exists_twice_has_no_span(tmp_path):
    path = tmp_path / "h1_20241027_023000.wav"  # clocks were set back at 03:00
    soundfile.write(path, np.zeros(1000), RATE)
    assert find_span(path, {"time_zone": "Europe/Paris"}) is None
    assert find_span(path, {"time_zone": "+02:00"}).start_utc_ns == parse_utc(
        "2024-10-27T00:30:00Z"
    )
