"""REP and DSF: what is written reads back, the samples read, and errors name the line."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.draws.buoy_contacts import scene
from tests.draws.sensor_tables import buoys
from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.errors import DataError, UwtrackNote
from uwtrack_cli.files.tables.replay import read_replay, read_replay_track, replay_lines
from uwtrack_cli.motion.locate import locate_vessels

REAL = Path(os.environ.get("UWTRACK_REAL_DATA", "/nowhere")) / "debrief"
POSITION = "700103 013425.000 Frigate @A 26 27 14.91 N 51 21 52.49 E 149.3 12 0\n"
CUT = ";SENSOR: 700103 013425.000 Frigate @A NULL 80 12496 Optic some message\n"


def written(tmp_path, text, name="a.rep"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_what_is_written_reads_back(tmp_path):
    made, *_ = buoys(1, rows=5)
    start = 1_714_521_600_000_000_000
    made = replace(
        made, start_utc_ns=start, origin_latitude=-35.0, origin_longitude=179.99,
        mirrored_bearing_deg=(made.bearing_deg + 40.0) % 360.0,
        bearing_std_deg=made.time_s * 1e-3 + 1.25,
        frequency_hz=100.0 + made.time_s[:, np.newaxis],
        frequency_std_hz=np.full((made.time_s.size, 1), 3e-5),
    )  # fmt: skip
    lines = list(replay_lines([made], [], with_tracks=True))
    path = written(tmp_path, "\n".join(lines))
    read = read_replay([path])
    assert read.start_utc_ns == start
    assert read.sensor.tolist() == made.sensor.tolist()
    assert np.unique(read.contact).tolist() == [1]
    np.testing.assert_allclose(read.time_s, made.time_s, atol=1e-3)
    np.testing.assert_allclose(read.bearing_deg, made.bearing_deg, atol=1e-6)
    np.testing.assert_allclose(read.mirrored_bearing_deg, made.mirrored_bearing_deg, atol=1e-6)
    for name in ("bearing_std_deg", "frequency_hz", "frequency_std_hz"):
        np.testing.assert_allclose(getattr(read, name), getattr(made, name))
    for name in ("sensor_east_m", "sensor_north_m"):
        off = getattr(read, name) - getattr(made, name)
        np.testing.assert_allclose(off, off[0], atol=0.1)  # another origin
    cuts = list(replay_lines([made], [], with_tracks=False))
    assert len(cuts) == made.time_s.size
    plain = replace(made, mirrored_bearing_deg=None)
    read = read_replay([written(tmp_path, "\n".join(replay_lines([plain], [], with_tracks=False)))])
    np.testing.assert_allclose(read.bearing_std_deg, made.bearing_std_deg)


def test_cuts_stand_where_the_track_was_and_repeated_ones_count_once(tmp_path):
    later = POSITION.replace("013425", "013625").replace("14.91 N", "24.91 N")
    cut = CUT.replace("013425", "013525")
    path = written(tmp_path, f"{POSITION}{later};; a comment\n{CUT}{cut}{cut}")
    with pytest.warns(UwtrackNote, match=r"1 repeated cuts .* line 6|not used"):
        read = read_replay([path])
    assert read.time_s.tolist() == [0.0, 60.0]
    # five of the ten seconds of arc to the north
    assert read.sensor_north_m[1] == pytest.approx(5.0 / 3600.0 * 110_780.0, rel=1e-3)
    assert read_replay_track(path).time_s.tolist() == [0.0, 120.0]


@pytest.mark.parametrize(
    ("text", "words"),
    {
        POSITION: "tracks and no bearings",
        CUT.replace("700103", "03/01/1970"): r"line 1: the date must be YYMMDD",
        CUT.replace("700103", "701303"): r"line 1: there is no time",
        CUT.replace("013425.000", "01:34:25"): r"line 1: the time must be HHMMSS",
        CUT.replace(" 80 ", " eighty "): r"line 1: bearing must be a number",
        CUT.replace(" 80 ", " 480 "): r"line 1: bearing must lie from -360 to 360",
        CUT.replace("some message", "contact 1 bearing_std_deg 999"): r"line 1: .* 180",
        CUT[:45]: r"line 1: .*(ends before|must)",
        POSITION.replace(" N ", " Q ") + CUT: r"latitude must end with N or S",
        POSITION + CUT.replace("Frigate", "Corvette"): "no track of Corvette",
        POSITION + CUT.replace("013425", "053425"): "line 2: the track .* not cover",
        "hello world, these are rows of text\n": "line 1: the date must be",
    }.items(),
)
def test_a_file_that_is_wrong_is_refused_with_its_line(text, words, tmp_path):
    with pytest.raises(DataError, match=words):
        read_replay([written(tmp_path, text)])


@pytest.mark.skipif(not REAL.is_dir(), reason="no real data")
def test_the_samples_of_the_format_read():
    with pytest.warns(UwtrackNote):
        series = read_replay([REAL / "sen_frig_sensor.dsf", REAL / "sen_tracks.rep"])
    names, counts = np.unique(series.sensor, return_counts=True)
    assert dict(zip(names.tolist(), counts.tolist(), strict=True)) == {
        "Frigate_Optic": 47, "Frigate_Optic2": 16, "Frigate_Optic3": 16,
        "Frigate_Optic4": 10, "Frigate Optic5": 6,
    }  # fmt: skip
    optic = series.sensor == "Frigate_Optic"
    assert series.bearing_deg[optic][:3].tolist() == [80.0, 78.0, 77.0]
    assert np.isfinite(series.mirrored_bearing_deg).any()
    assert read_replay_track(REAL / "uk_track.rep").time_s.size > 390


def test_legs_are_solutions_where_they_begin_as_debrief_reads_them():
    """;TMA_RB: date time ownship symbol bearing range name, orientation and half axes of
    the ellipse in yards, course, speed, depth, text (Debrief, ImportTMA_RngBrg)."""
    told = {
        "start_s": [0.0, 3060.0], "end_s": [3000.0, 6000.0], "range_m": [9144.0, 4572.0],
        "range_std_m": [914.4, 91.44], "bearing_deg": [45.0, 350.0],
        "bearing_std_deg": [0.1, 5.0], "speed_mps": [5.14444, 2.57222],
        "speed_std_mps": [0.1, 0.1], "course_deg": [90.0, 180.0],
        "course_std_deg": [1.0, 1.0], "alteration_time_s": [np.nan, 3030.0],
        "alteration_time_std_s": [np.nan, 5.0],
    }  # fmt: skip
    motions = synthetic(
        Motions, 1, contact=[7], mode=[1], time_s=[0.0], reference=["buoy 1"],
        time_utc_ns=[1_767_225_600_000_000_000], leg_motion=[0, 0], leg_number=[1, 2],
        **{f"leg_{key}": values for key, values in told.items()},
    )  # fmt: skip
    first, second = replay_lines([], [motions], with_tracks=True)
    assert first == (
        ';TMA_RB: 20260101 000000.000 "buoy 1" @C 45.00 10000 CONTACT_7 45.0 2448 43 '
        "90.0 10.00 0 leg 1 of 2"
    )
    # the far axis is across the line of sight here
    assert second == (
        ';TMA_RB: 20260101 005100.000 "buoy 1" @C 350.00 5000 CONTACT_7 80.0 1068 245 '
        "180.0 5.00 0 leg 2 of 2"
    )
    assert list(replay_lines([], [motions], with_tracks=False)) == []


def test_cuts_have_the_contact_to_which_those_of_their_sensors_were_joined(tmp_path):
    series, _, _ = scene(4100, boats=1, rows=8, miss=0.0, drift_mps=0.0)
    series = replace(
        series, start_utc_ns=1_700_000_000_000_000_000, origin_latitude=50.0, origin_longitude=-5.0
    )
    found = locate_vessels(series=series, at=["600"])
    lines = list(replay_lines([series], [found], with_tracks=True))
    (tmp_path / "a.rep").write_text("\n".join(lines))
    again = read_replay([tmp_path / "a.rep"])
    assert again.contact_numbers == "common"
    assert set(again.contact) == set(found.contact)
    assert np.unique(series.contact).size > 1
