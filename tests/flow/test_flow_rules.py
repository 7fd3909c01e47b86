"""Small rules of the flow: where is looked again, what differs, who reads which sample."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.flow.made_encounters import encounters_of
from tests.support import recording_of
from uwtrack_cli.data.lines import COASTED, DETECTED
from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.transients import Transients
from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.flow import comparison, information, recorder_folder, rungs, zoom
from uwtrack_cli.flow.batch import FAILED, Outcome
from uwtrack_cli.flow.batch_report import write_report
from uwtrack_cli.flow.concatenate import JoinedReader
from uwtrack_cli.flow.engine import STREAM_SHARE, _share_of
from uwtrack_cli.flow.exports import features
from uwtrack_cli.flow.exports.raven import FileClock
from uwtrack_cli.flow.live_events import _OpenLines
from uwtrack_cli.flow.scoring.tolerances import Closeness, Limits


def rises_of(*rows):
    time_s, half_s, kind = zip(*rows, strict=True)
    return Transients(
        time_s=np.array(time_s), half_length_s=np.array(half_s), kind=np.array(kind),
        spreads=np.full(len(rows), 9.0), least_spreads=7.0, sensor="h1",
    )  # fmt: skip


def passage(time_s, width_s=1.0, status="ok", **more):
    return {
        "time_s": time_s, "range_over_speed_s": width_s, "status": status,
        "arrival_time_s": time_s + 0.1, "change_time_s": time_s + 1.0, **more,
    }  # fmt: skip


def test_segments_to_look_at_reach_ten_seconds_or_five_widths_and_are_joined():
    rises = rises_of((100.0, 1.0, "fall"), (200.0, 4.0, "level"))
    lines = SimpleNamespace(frames=SimpleNamespace(window_s=2.0))
    known = encounters_of(
        passage(300.0, 15.9), passage(400.0, 16.0), passage(500.0, 1.0),
        passage(np.nan, 1.0), passage(600.0, np.nan),
    )  # fmt: skip
    found = zoom._segments(known, rises, lines)
    # quick is less than eight of the long frames; of the others nothing is asked
    assert found == [(90.0, 110.0), (180.0, 220.0), (300.0 - 79.5, 379.5), (490.0, 510.0)]
    assert zoom._segments(known, None, None) == []


@pytest.mark.parametrize(
    ("times", "wanted"),
    [
        ((100.0, 120.0), [(90.0, 130.0)]),  # they touch
        ((100.0, 120.1), [(90.0, 110.0), (110.1, 130.1)]),
        ((120.0, 100.0), [(90.0, 130.0)]),
        # up to a minute together
        ((100.0, 115.0, 130.0, 139.9), [(90.0, 149.9)]),
        ((100.0, 115.0, 130.0, 140.0), [(90.0, 140.0), (130.0, 150.0)]),
    ],
)
def test_segments_that_meet_are_one_of_less_than_a_minute(times, wanted):
    rises = rises_of(*((t, 1.0, "fall") for t in times))
    found = zoom._segments(encounters_of(), rises, None)
    assert found == [pytest.approx(pair) for pair in wanted]


def test_passages_of_a_segment_are_told_in_the_recordings_time_if_well_inside():
    recording = recording_of(np.zeros((400, 1)), 4.0)  # 100 s
    rows = [
        passage(2.1, 2.0), passage(1.9, 2.0), passage(17.9, 2.0), passage(18.1, 2.0),
        passage(10.0, np.nan), passage(np.nan), passage(10.0, extrapolated=True),
    ]  # fmt: skip
    table = encounters_of(*rows)
    found = zoom._placed(table, 40.0, 60.0, recording)
    assert found.time_s == pytest.approx([42.1, 57.9, 50.0])
    assert found.arrival_time_s == pytest.approx(found.time_s + 0.1)
    assert found.change_time_s == pytest.approx(found.time_s + 1.0)
    early = zoom._placed(table, -5.0, 15.0, recording)  # the sound begins at zero
    assert early.time_s == pytest.approx([2.1, 1.9, 10.0])
    late = zoom._placed(encounters_of(passage(9.0), passage(11.0)), 90.0, 110.0, recording)
    assert late.time_s == pytest.approx([99.0])


@pytest.mark.parametrize(
    ("at_s", "is_kept"), [(50.0, True), (52.9, True), (53.1, False), (70.0, False), (82.9, True)]
)
def test_by_the_level_alone_is_kept_what_rises_in_the_whole_recording(at_s, is_kept):
    """Within both widths of a passage that is known, or of a rise of the level."""
    known = encounters_of(passage(50.0, 2.0))
    rises = rises_of((80.0, 2.0, "level"), (70.0, 2.0, "fall"))
    found = encounters_of(passage(at_s, 1.0, "level-only"), passage(at_s, 1.0, "ok"))
    kept = zoom._risen(found, known, rises, None)
    assert kept.status.tolist() == ["level-only"] * is_kept + ["ok"]


def test_a_segment_of_a_recording_knows_when_it_begins():
    sound = np.arange(400.0, dtype=np.float32)[:, None]
    whole = replace(
        recording_of(sound, 4.0), reader=HeldSamples(sound), first_sample=40, start_utc_ns=10**18
    )
    for start_s, first in ((-3.0, 0), (20.25, 81)):
        part = zoom._part(whole, start_s, 30.0)
        assert part.first_sample == 40 + first
        assert part.start_utc_ns == 10**18 + first * 250_000_000
        assert part.n_samples == 120 - first
        read = np.concatenate(list(part.reader(7)))
        assert np.array_equal(read, sound[first:120])
    assert zoom._part(whole, 90.0, 300.0).n_samples == 40


def test_a_segment_of_joined_files_is_their_samples_and_nothing_between():
    one, two = (np.arange(a, b, dtype=np.float32)[:, None] for a, b in ((0, 30), (50, 90)))
    joined = JoinedReader(((0, 30, HeldSamples(one)), (50, 40, HeldSamples(two))), 1)
    whole = np.full((120, 1), np.nan, np.float32)
    whole[:30], whole[50:90] = one, two
    for first, count in ((0, 120), (10, 5), (20, 35), (31, 9), (60, 20), (85, 35)):
        found = joined.segment(first, count)
        assert np.array_equal(found, whole[first : first + count], equal_nan=True)


def difference(a, b, name="range_m", **closeness):
    key = ("encounters", "h1", name)
    found = list(comparison._compare_numbers(key, np.array(a), np.array(b), Closeness(**closeness)))
    assert len(found) <= 1
    return found[0] if found else None


def test_numbers_differ_beyond_both_allowances_together():
    assert difference([100.0], [103.0], atol=1.0, rtol=0.0193) is not None
    assert difference([100.0], [103.0], atol=1.0, rtol=0.0195) is None
    found = difference([1.0, -8.0, 5.0, np.nan, np.nan], [1.5, -10.0, 5.0, 2.0, np.nan])
    assert (found.n_values, found.n_different) == (4, 3)
    assert found.largest == 2.0
    assert found.largest_relative == pytest.approx(0.5 / 1.5)
    assert found.reason == "differs, 1 known in one only"
    assert difference([np.inf, 1.0], [np.inf, 1.1], atol=0.2) is None
    assert difference([np.inf, 1.0], [-np.inf, 1.0], rtol=1.0).n_different == 1
    assert difference([359.5], [0.5], "bearing_deg", atol=1.01) is None
    assert difference([359.5], [0.5], "bearing_deg", atol=0.99).largest == 1.0
    assert difference([359.5], [0.5], "range_m", atol=1.01).largest == 359.0
    epoch = 1_700_000_000_000_000_000
    late = difference([epoch], [epoch + 5], "start_utc_ns", rtol=1e-3)
    assert late.largest == pytest.approx(5e-9)
    assert late.largest_relative == 0.0
    assert difference([epoch], [epoch + 5], "start_utc_ns", atol=6e-9) is None


def test_differences_of_blocks_add_up():
    one = comparison.Difference("levels", "h1", "x", "differs", 10, 2, 0.5, 0.1)
    other = comparison.Difference("levels", "h1", "x", "differs", 7, 3, 0.2, 0.4)
    wanted = comparison.Difference("levels", "h1", "x", "differs", 17, 5, 0.5, 0.4)
    assert comparison._sum(one, other) == wanted


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (Limits(error=2.0), ""), (Limits(error=1.9), "error 2 > 1.9"),
        (Limits(percent=4.9, sigmas=2.5), "percent 5 > 4.9"),
        (Limits(percent=5.0, sigmas=2.4), "sigmas 2.5 > 2.4"),
    ],
)  # fmt: skip
def test_a_limit_is_passed_by_what_is_more(limits, words):
    assert limits.excess(-2.0, -5.0, 2.5) == words
    assert Limits(error=9.0).excess(np.nan, 0.0, 0.0) == "error nan > 9"


def test_a_moment_lies_in_a_file_by_its_samples():
    """Three files of 100, 50 and 80 samples; the second after a gap of 20."""
    recording = replace(recording_of(np.zeros((250, 1)), 10.0), first_sample=0)
    files = SimpleNamespace(
        start_sample=np.array([0, 120, 170]), n_samples=np.array([100, 50, 80]),
        name=np.array(["a", "b", "c"]), first_sample=np.array([30, 0, 5]),
    )  # fmt: skip
    clock = FileClock(recording, files)
    for time_s, file, offset_s, cumulative_s in (
        (0.0, "a", 3.0, 3.0), (9.9, "a", 12.9, 12.9), (11.0, "a", 13.0, 13.0),
        (12.0, "b", 0.0, 13.0), (16.9, "b", 4.9, 17.9), (17.0, "c", 0.5, 18.0),
        (99.0, "c", 8.5, 26.0),
    ):  # fmt: skip
        place = clock.place(time_s)
        assert place.file == file
        assert place[1:] == pytest.approx((offset_s, cumulative_s))
    files.first_sample = None  # files that were read from their first sample on
    assert FileClock(recording, files).place(12.0)[1:] == pytest.approx((0.0, 10.0))
    alone = FileClock(replace(recording, first_sample=30), None)
    assert alone.place(2.0)[1:] == (5.0, 5.0)


def test_progress_of_the_fits_follows_that_of_the_sound():
    said = []
    tell = _share_of(said.append, 200.0)
    for done in (0.0, 0.5, 1.0):
        tell(done)
    share = STREAM_SHARE
    assert said == pytest.approx([200.0 * share, 100.0 * (1.0 + share), 200.0])
    assert _share_of(None, 200.0) is None


def block_of(*rows):
    """Points (line, time, frequency, SNR); nan is a point that coasts."""
    line, time_s, frequency_hz, snr_db = (np.array(c, float) for c in zip(*rows, strict=True))
    return SimpleNamespace(
        line=line.astype(int), time_s=time_s, frequency_hz=frequency_hz,
        measured_snr_db=snr_db,
        association=np.where(np.isnan(snr_db), COASTED, DETECTED),
    )  # fmt: skip


def test_lines_are_told_as_they_begin_and_with_all_of_them_as_they_end():
    said = []
    step = SimpleNamespace(name="track")

    def say(kind, *told, is_final):
        assert kind == "line"
        said.append((*told, is_final))

    lines = _OpenLines(step, say)
    lines.add(block_of((3, 5.0, 101.0, 9.0), (3, 4.0, 99.0, 3.0), (3, 6.0, 100.0, np.nan)))
    lines.add(block_of((3, 7.0, 98.0, 8.0), (5, 7.0, 50.0, np.nan)))
    lines.add(block_of((5, 8.0, 52.0, 7.0)))
    lines.add(SimpleNamespace(line=np.zeros(0, int)))
    lines.finish()
    told = [(f["line"], t, r, final) for t, f, r, final in said]
    assert told == [(3, 4.0, 0, False), (5, 7.0, 0, False), (3, 4.0, 1, True), (5, 7.0, 1, True)]
    assert said[0][1] == {
        "step": "track", "line": 3, "time_s": 4.0, "end_time_s": 6.0,
        "frequency_hz": 100.0, "frequency_low_hz": 99.0, "frequency_high_hz": 101.0,
        "snr_db": 6.0, "n_points": 3,
    }  # fmt: skip
    assert said[1][1]["snr_db"] is None
    last = said[2][1]
    assert (last["end_time_s"], last["frequency_hz"], last["n_points"]) == (7.0, 98.0, 4)
    assert (last["frequency_low_hz"], last["frequency_high_hz"]) == (98.0, 101.0)
    last = said[3][1]
    assert (last["frequency_low_hz"], last["frequency_high_hz"]) == (50.0, 52.0)


@pytest.mark.parametrize(
    ("apart_s", "std_s", "is_twin"),
    [(3.0, 0.0, True), (9.0, 0.0, False), (9.0, 3.0, True), (25.0, 3.0, False)],
)
def test_two_parts_mean_one_passage_as_far_as_their_times_are_sure(apart_s, std_s, is_twin):
    second = 10**9
    own = [
        recorder_folder.OwnSpan(0, 100 * second, frozenset("ab")),
        recorder_folder.OwnSpan(100 * second, 200 * second, frozenset("bc")),
    ]
    times = {
        "one": (99 * second, std_s),
        "two": (round((99 + apart_s) * second), 4.0 * (std_s > 0)),
    }
    found = recorder_folder.distinct_passages([["one"], ["two"]], own, times.get)
    # the later one lies in its own part, and so does the earlier
    assert found == ([["one"], []] if is_twin else [["one"], ["two"]])


@pytest.mark.parametrize(
    ("calibrated", "words"),
    [
        ((False,), "dB re full scale; not calibrated"), ((True,), "dB re 1 uPa"),
        ((True, True), "dB re 1 uPa"),
        ((True, False, False), "dB re full scale; 1 sensors are calibrated"),
    ],
)  # fmt: skip
def test_levels_are_those_of_a_pressure_where_all_sensors_are_calibrated(calibrated, words):
    sensors = [
        Sensor(id=f"h{k}", full_scale_db=160.0 if known else None, depth_m=12.5)
        for k, known in enumerate(calibrated)
    ]
    first, levels = information._sensor_lines(sensors)
    assert levels == f"levels: {words}"
    names = ", ".join(sensor.id for sensor in sensors)
    alone = "sensor: h0, omni, position not known, depth 12.5 m"
    assert first == (alone if len(sensors) == 1 else f"sensors: {names}")
    assert list(information._sensor_lines([])) == []


@pytest.mark.parametrize(
    ("window_s", "share", "fits"),
    [(8.0, None, True), (8.1, None, False), (2.0, 0.25, True), (2.1, 0.25, False)],
)
def test_a_rung_fits_a_recording_or_a_share_of_it(window_s, share, fits):
    options = {"window_s": window_s, "largest_share": share}
    step = SimpleNamespace(values=lambda: options)
    recording = recording_of(np.zeros((80, 1)), 10.0)
    if fits:
        assert rungs._fits(step, recording)
    else:
        with pytest.warns(UwtrackWarning, match=f"the rung of {window_s:g} s is left"):
            assert not rungs._fits(step, recording)


def test_a_sensor_stands_on_the_map_at_its_longitude_and_latitude():
    sensor = Sensor(id="h1", latitude=50.5, longitude=-1.25)
    assert features._sensor(sensor).places == ((-1.25, 50.5),)


def test_a_report_is_written_anew_with_names_as_they_are(tmp_path):
    outcome = Outcome("Küste.wav", str(tmp_path / "Küste.run.h5"), FAILED, "no sound", 1)
    for _ in range(2):
        table, lines = write_report([outcome], tmp_path)
    (line,) = lines.read_text(encoding="utf-8").splitlines()
    assert "Küste.wav" in line
    assert "Küste.wav" in table.read_text(encoding="utf-8")
