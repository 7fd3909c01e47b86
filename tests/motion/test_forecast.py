"""Bearing, range and Doppler of a target along two known ways."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.forecast import forecast_contact

C = 1500.0


def straight(place, velocity, *, start_s=0.0, stop_s=600.0, **facts):
    time = np.array([start_s, stop_s])
    east, north = (np.array(place)[:, None] + np.array(velocity)[:, None] * time).tolist()
    return Navigation(
        time_s=time, east_m=east, north_m=north, heading_deg=np.full(2, np.nan), **facts
    )


def test_sound_is_heard_as_the_arrivals_of_its_periods_say():
    """Each period of a tone is followed from where it was made to where it is heard."""
    own, target = ([0.0, 0.0], [3.0, 4.0]), ([2000.0, 1500.0], [-8.0, 2.0])
    found = forecast_contact(
        straight(*own), straight(*target), rest_frequencies_hz=[150.0], every_s=1.0
    )
    made = np.arange(0.0, 590.0, 1e-2)
    there = np.array(target[0])[:, None] + np.array(target[1])[:, None] * made
    heard = made.copy()
    for _ in range(60):
        here = np.array(own[0])[:, None] + np.array(own[1])[:, None] * heard
        heard = made + np.hypot(*(there - here)) / C
    cycles = 150.0 * made
    rate = np.gradient(cycles, heard)
    inside = (found.time_s > 5.0) & (found.time_s < 580.0)
    due = np.interp(found.time_s[inside], heard, rate)
    assert found.frequency_hz[inside, 0] == pytest.approx(due, abs=1e-4)
    here = np.array(own[0])[:, None] + np.array(own[1])[:, None] * heard
    angle = np.degrees(np.unwrap(np.arctan2(*(there - here)))) % 360.0
    assert found.bearing_deg[inside] == pytest.approx(
        np.interp(found.time_s[inside], heard, angle), abs=1e-3
    )


def test_clocks_and_grids_are_brought_together_or_refused():
    own = straight([0, 0], [0, 0], origin_latitude=50.0, origin_longitude=1.0, start_utc_ns=10**18)
    target = straight([0, 0], [0, 0], origin_latitude=50.01, origin_longitude=1.0,
                      start_utc_ns=10**18 + 100 * 10**9)  # fmt: skip
    found = forecast_contact(own, target, every_s=100.0)
    assert found.time_s[0] == 100.0
    assert found.bearing_deg == pytest.approx(0.0, abs=1e-6)
    assert found.range_m == pytest.approx(1112.5, abs=1.0)  # 36 seconds of arc, WGS 84
    with pytest.raises(DataError, match="latitudes and longitudes and the other"):
        forecast_contact(own, straight([0, 0], [0, 0], start_utc_ns=10**18))
    with pytest.raises(DataError, match="UTC times and the other none"):
        forecast_contact(straight([0, 0], [0, 0], start_utc_ns=1), straight([9, 9], [0, 0]))
    late = straight([9, 9], [0, 0], start_s=700.0, stop_s=900.0)
    with pytest.raises(DataError, match="share no time"):
        forecast_contact(straight([0, 0], [0, 0]), late)


NAV = "time_s,east_m,north_m\n0,{0},0\n600,{0},600\n"


def test_the_command_writes_a_table_that_tma_reads(uwtrack, tmp_path):
    (tmp_path / "own.csv").write_text("time_s,east_m,north_m\n0,0,0\n300,0,1500\n600,900,2700\n")
    (tmp_path / "target.csv").write_text(NAV.format(3000))
    words = ["forecast", "own.csv", "target.csv", "--rest-frequency-hz", 150]
    done = uwtrack(*words, "-o", "heard.csv", "--json")
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)
    assert rows[0]["range_m"] == pytest.approx(3000.0, abs=3.0)
    assert rows[0]["frequencies_hz"][0] == pytest.approx(150.0, abs=0.1)
    assert uwtrack(*words).stdout.startswith("time_s,bearing_deg,frequency_hz\n0.000,")
    assert uwtrack(*words, "-o", "heard.csv").exit_code == 1
    found = uwtrack(
        "tma", "heard.csv", "--own-ship", "own.csv", "--misfit-bearing-std-deg", 0.5,
        "--misfit-frequency-std-hz", 0.05, "--sound-speed-mps", 1500, "--json",
    )  # fmt: skip
    assert found.exit_code == 0, found.output
    best = json.loads(found.stdout)[0]
    assert best["speed_mps"] == pytest.approx(1.0, abs=0.2)
    assert best["range_m"] == pytest.approx(3000.0, rel=0.02)


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["--every-s", 0], 2, "--every-s must be"),
        (["--rest-frequency-hz", -5], 2, "--rest-frequency-hz must be"),
        (["--sound-speed-mps", 5], 2, "--sound-speed-mps must be"),
    ],
)
def test_what_cannot_be_asked_is_refused(uwtrack, tmp_path, words, code, told):
    (tmp_path / "own.csv").write_text(NAV.format(0))
    done = uwtrack("forecast", "own.csv", "own.csv", *words)
    assert done.exit_code == code
    assert told in done.stderr


@pytest.mark.skipif("UWTRACK_REAL_DATA" not in os.environ, reason="real data")
def test_the_tracks_of_a_real_file_give_the_ranges_of_its_cuts(uwtrack):
    """The file's own cuts have bearing in whole degrees and range in yards."""
    folder = Path(os.environ["UWTRACK_REAL_DATA"]) / "debrief"
    tracks = folder / "sen_tracks.rep"
    words = ["forecast", tracks, tracks, "--names", "Frigate", "New_SSK"]
    done = uwtrack(*words, "--every-s", 60, "--json")
    rows = {row["time_utc"][11:19]: row for row in json.loads(done.stdout)}
    off, turned = [], []
    for line in (folder / "sen_frig_sensor.dsf").read_text().splitlines()[:40]:
        words = line.split()
        at = ":".join([words[2][:2], words[2][2:4], words[2][4:6]])
        off.append(rows[at]["range_m"] / 0.9144 / float(words[7]) - 1.0)
        turned.append((rows[at]["bearing_deg"] - float(words[6]) + 180.0) % 360.0 - 180.0)
    assert np.median(np.abs(off)) < 0.02
    assert np.median(np.abs(turned)) < 1.0
    unnamed = uwtrack("forecast", tracks, tracks)
    assert unnamed.exit_code == 1
    assert "give --names OWN TARGET, it has Frigate, New_SSK" in unnamed.stderr
