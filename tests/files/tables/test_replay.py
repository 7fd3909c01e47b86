"""REP and DSF: what is written reads back, the samples read, and errors name the line."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.draws.sensor_tables import buoys
from uwtrack_cli.errors import DataError, UwtrackNote
from uwtrack_cli.files.tables.replay import (
    read_replay,
    read_replay_track,
    replay_lines,
)

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
    np.testing.assert_allclose(
        read.mirrored_bearing_deg, made.mirrored_bearing_deg, atol=1e-6
    )
    for name in ("bearing_std_deg", "frequency_hz", "frequency_std_hz"):
        np.testing.assert_allclose(getattr(read, name), getattr(made, name))
    for name in ("sensor_east_m", "sensor_north_m"):
        off = getattr(read, name) - getattr(made, name)
        np.testing.assert_allclose(off, off[0], atol=0.1)  # another origin
    cuts = list(replay_lines([made], [], with_tracks=False))
    assert len(cuts) == made.time_s.size
    plain = replace(made, mirrored_bearing_deg=None)
    read = read_replay(
        [written(tmp_path, "\n".join(replay_lines([plain], [], with_tracks=False)))]
    )
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
