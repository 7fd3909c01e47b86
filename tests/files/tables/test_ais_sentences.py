"""Logs of AIS receivers; the sentences are made by pyais, the times by the test."""

import subprocess
import sys

import numpy as np
import pytest

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.ais import read_ais

pyais = pytest.importorskip("pyais")
START_S = 1714564800  # 2024-05-01T12:00:00Z


def sentences(**fields):
    """The sentences of a message, as a receiver prints them."""
    return [str(part) for part in pyais.encode_dict(fields, talker_id="AI")]


def positions(n=5, mmsi=123456789, **more):
    """Reports of a vessel going north, 10 s apart, with their second of the minute."""
    return [
        sentences(
            type=1, mmsi=mmsi, lat=50.0 + 0.001 * k, lon=-1.5, speed=10.0 + k,
            course=12.5, second=10 * k % 60, **more,
        )[0]
        for k in range(n)
    ]  # fmt: skip


def tagged(sentence, second):
    tag = f"s:station,c:{second}"
    check = 0
    for letter in tag:
        check ^= ord(letter)
    return f"\\{tag}*{check:02X}\\{sentence}"


FORMATS = {
    "tag block": tagged,
    "milliseconds": lambda sentence, second: tagged(sentence, 1000 * second),
    "time before": lambda sentence, second: (
        f"2024-05-01T12:{(second - START_S) // 60:02d}:{second % 60:02d}Z {sentence}"
    ),
    "seconds before": lambda sentence, second: f"{second}.0, {sentence}",
    "seconds behind": lambda sentence, second: f"{sentence},{second}",
}


@pytest.mark.parametrize("form", FORMATS.values(), ids=FORMATS)
def test_a_log_says_what_the_messages_said(tmp_path, form):
    path = tmp_path / "log.nmea"
    lines = [form(line, START_S + 10 * k) for k, line in enumerate(positions())]
    path.write_text("# a receiver\n" + "\n".join(lines) + "\n")
    truth = read_ais(path)
    assert truth.start_utc_ns == START_S * 10**9
    (track,) = truth.tracks
    assert track.vessel == "123456789"
    np.testing.assert_allclose(track.time_s, np.arange(0, 50, 10), atol=1e-6)
    np.testing.assert_allclose(track.first, 50.0 + 0.001 * np.arange(5), atol=1e-6)
    np.testing.assert_allclose(track.second, -1.5, atol=1e-6)
    np.testing.assert_allclose(track.speed_mps, (10.0 + np.arange(5)) * 1852 / 3600)
    np.testing.assert_allclose(track.course_deg, 12.5)


def test_a_report_received_late_keeps_the_second_in_which_it_was_made(tmp_path):
    path = tmp_path / "log.nmea"
    lines = [f"{START_S + 10 * k + 3.4} {line}" for k, line in enumerate(positions())]
    path.write_text("\n".join(lines))
    (track,) = read_ais(path).tracks
    np.testing.assert_allclose(np.diff(track.time_s), 10.0)
    assert read_ais(path).start_utc_ns == START_S * 10**9


def test_names_come_from_static_reports_in_two_sentences(tmp_path):
    parts = sentences(type=5, mmsi=123456789, shipname="FERRY", seq_id=3)
    assert len(parts) == 2
    path = tmp_path / "log.nmea"
    lines = [tagged(line, START_S + 10 * k) for k, line in enumerate(positions())]
    path.write_text("\n".join([*parts, *lines]))
    assert read_ais(path).tracks[0].vessel == "FERRY (123456789)"


def test_damaged_and_foreign_sentences_are_passed_over(tmp_path):
    good = [tagged(line, START_S + 10 * k) for k, line in enumerate(positions())]
    wrong = good[2].rsplit("*", 1)[0] + "*00"
    other = "$GPGGA,120000,5000,N,00130,W,1,08,0.9,5.0,M,46.9,M,,*47"
    path = tmp_path / "log.nmea"
    path.write_text("\n".join([*good[:2], wrong, other, "!AIVDM,1,1", *good[3:]]))
    (track,) = read_ais(path).tracks
    np.testing.assert_allclose(track.time_s, [0, 10, 30, 40])


def test_unknown_speeds_and_courses_are_unknown(tmp_path):
    path = tmp_path / "log.nmea"
    line = sentences(type=1, mmsi=5, lat=50, lon=0, speed=102.3, course=360, second=0)
    path.write_text(tagged(line[0], START_S))
    (track,) = read_ais(path).tracks
    assert track.vessel == "000000005"
    assert np.isnan([track.speed_mps[0], track.course_deg[0]]).all()


def test_a_log_without_times_is_refused(tmp_path):
    path = tmp_path / "log.nmea"
    path.write_text("\n".join(positions()))
    with pytest.raises(DataError, match=r"5 position reports and the time of none"):
        read_ais(path)


def test_without_pyais_its_installation_is_named(tmp_path, monkeypatch):
    path = tmp_path / "log.nmea"
    path.write_text(tagged(positions()[0], START_S))
    monkeypatch.setitem(sys.modules, "pyais.stream", None)
    with pytest.raises(DataError, match=r"pip install 'uwtrack\[ais\]'"):
        read_ais(path)


def test_reading_a_table_does_not_import_pyais(tmp_path):
    path = tmp_path / "ais.csv"
    path.write_text("Time,MMSI,Latitude,Longitude,SOG,COG\n2024-05-01 12:00:00,1,50,0,1,1\n")
    code = (
        "import sys; from pathlib import Path;"
        "from uwtrack_cli.files.tables.ais import read_ais;"
        f"read_ais(Path({str(path)!r})); assert 'pyais' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
