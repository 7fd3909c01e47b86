"""Start times: exact, from names as recorders write them, never guessed."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import soundfile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.audio.recording_file import write_wav
from uwtrack_cli.files.audio.start_time import PRESETS, find_start_utc_ns
from uwtrack_cli.files.utc import format_utc, parse_utc


def start_of(name, **options):
    time_ns = find_start_utc_ns(Path("x_20200101_000000") / name, **options)
    return None if time_ns is None else format_utc(time_ns)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("671379494.190101003015.wav", "2019-01-01T00:30:15.000Z"),  # SoundTrap
        ("5146.220131235959.wav", "2022-01-31T23:59:59.000Z"),
        ("NAVE_20160112_130211.wav", "2016-01-12T13:02:11.000Z"),
        ("NAVE_20160112_130211_123.wav", "2016-01-12T13:02:11.123Z"),  # PAMGuard
        ("20190101_120000.WAV", "2019-01-01T12:00:00.000Z"),  # AudioMoth
        ("site-20190101-120000.flac", "2019-01-01T12:00:00.000Z"),
        ("icListenHF_20160112T130211.500Z.wav", "2016-01-12T13:02:11.500Z"),
        ("20160112T130211Z.wav", "2016-01-12T13:02:11.000Z"),
        ("x_2016-01-12_13-02-11.wav", "2016-01-12T13:02:11.000Z"),
        ("20160112130211.wav", "2016-01-12T13:02:11.000Z"),
        ("H1_160112_130211.wav", "2016-01-12T13:02:11.000Z"),
        ("20200229_000000.wav", "2020-02-29T00:00:00.000Z"),
        ("20190229_000000.wav", None),  # no such day
        ("20160112_250000.wav", None),
        ("NATURE11_09_02_21_20_2701.flac", None),
        ("pass.wav", None),
        ("channel_12345678.wav", None),
    ],
)
def test_names_of_the_usual_recorders_give_their_time(name, expected):
    assert start_of(name) == expected


def test_name_with_two_times_is_refused_and_lists_them():
    with pytest.raises(DataError) as caught:
        start_of("a_20160112_130211_to_20160113_130211.wav")
    assert "2016-01-12T13:02:11.000Z" in str(caught.value)
    assert "2016-01-13T13:02:11.000Z" in str(caught.value)
    assert start_of("20160112_130211_20160112130211.wav") == "2016-01-12T13:02:11.000Z"


def test_option_wins_over_the_name_and_is_exact():
    name = Path("20160112_130211.wav")
    time_ns = find_start_utc_ns(name, start_utc="2018-01-13T16:12:01.862011123Z")
    oracle = np.datetime64("2018-01-13T16:12:01.862011123", "ns").astype(np.int64)
    assert time_ns == oracle


@pytest.mark.parametrize(
    ("zone", "expected"),
    [
        ("UTC", "2016-07-12T13:02:11.000Z"),
        ("Asia/Seoul", "2016-07-12T04:02:11.000Z"),
        ("+09:00", "2016-07-12T04:02:11.000Z"),
        ("UTC+9", "2016-07-12T04:02:11.000Z"),
        ("-0330", "2016-07-12T16:32:11.000Z"),
        ("America/New_York", "2016-07-12T17:02:11.000Z"),
    ],
)
def test_time_zone_applies_to_names_and_times_without_one(zone, expected):
    assert start_of("a_20160712_130211.wav", time_zone=zone) == expected
    given_text = "2016-07-12 13:02:11"
    assert start_of("a.wav", start_utc=given_text, time_zone=zone) == expected
    own = start_of("20160712T130211Z.wav", time_zone=zone)
    assert own == "2016-07-12T13:02:11.000Z"


@pytest.mark.parametrize("zone", ["Mars/Base", "+25:00", "../../etc/passwd", "", "a\0"])
def test_unknown_time_zone_is_refused(zone):
    with pytest.raises(OptionError, match="unknown time zone"):
        start_of("a_20160712_130211.wav", time_zone=zone)


@pytest.mark.parametrize("name", ["20161030_023000.wav", "20160327_023000.wav"])
def test_hour_that_a_clock_change_repeats_or_skips_is_refused(name):
    with pytest.raises(DataError, match="clocks were changed"):
        start_of(name, time_zone="Europe/Berlin")
    assert start_of(name, time_zone="+01:00") is not None


@pytest.mark.parametrize(
    ("pattern", "name", "expected"),
    [
        ("H1_%Y%m%d-%H%M%S", "H1_20160112-130211.wav", "2016-01-12T13:02:11.000Z"),
        ("%d.%m.%y %Hh%M", "12.01.16 13h02.wav", "2016-01-12T13:02:00.000Z"),
        ("%Y_%j_%H", "buoy2016_060_07.wav", "2016-02-29T07:00:00.000Z"),
        ("%Y%m%d%H%M%S.%f", "20160112130211.25.wav", "2016-01-12T13:02:11.250Z"),
        ("100%%_%Y%m%d", "100%_20160112.wav", "2016-01-12T00:00:00.000Z"),
        ("date_time", "671379.190101003015_20160112_130211.wav", "2016-01-12T13:02:11.000Z"),
    ],
)
def test_pattern_of_ones_own_is_found_in_the_name(pattern, name, expected):
    assert start_of(name, time_pattern=pattern) == expected


def test_pattern_that_does_not_fit_or_is_none_is_refused():
    with pytest.raises(DataError, match="does not fit the pattern"):
        start_of("pass.wav", time_pattern="soundtrap")
    for pattern in ("nonsense", "%Q", "%Y%Y", "%", "%Y", "%H%M%S"):
        with pytest.raises(OptionError, match="pattern"):
            start_of("pass.wav", time_pattern=pattern)
    for text in ("yesterday", "2016-13-01T00:00:00Z", "2016-01-01", ""):
        with pytest.raises(OptionError, match="start time"):
            start_of("pass.wav", start_utc=text)


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(
    st.datetimes(datetime(1970, 1, 2), datetime(2099, 12, 31), timezones=st.just(UTC))  # noqa: DTZ001
)
def test_every_time_survives_writing_and_reading(moment):
    text = moment.isoformat()
    time_ns = parse_utc(text)
    assert time_ns == np.datetime64(moment.replace(tzinfo=None), "ns").astype(np.int64)
    assert parse_utc(format_utc(time_ns)) == time_ns


def test_presets_are_documented_by_name():
    from uwtrack_cli.files.audio import start_time

    text = Path(start_time.__file__).read_text()
    documented = text[text.index('"""File names of the usual') :]
    assert all(name in documented for name in PRESETS)


@pytest.mark.parametrize("name", ["a.wav", "b.flac", "c.rf64"])
def test_a_start_that_was_written_is_read_to_the_nanosecond_unless_the_name_tells(name, tmp_path):
    time_ns = parse_utc("2024-05-02T06:30:00.250000001Z")
    for start, named in (
        (time_ns, name),
        (None, f"none-{name}"),
        (time_ns, f"20190101_120000{name}"),
    ):
        write_wav(tmp_path / named, iter([np.zeros((9, 1), np.float32)]), 4e3, start_utc_ns=start)
    assert find_start_utc_ns(tmp_path / name) == time_ns
    assert find_start_utc_ns(tmp_path / f"none-{name}") is None
    told = find_start_utc_ns(tmp_path / f"20190101_120000{name}")
    assert format_utc(told) == "2019-01-01T12:00:00.000Z"


@pytest.mark.parametrize("date", ["2024-05-02", "2024", "2024-05-02T06:30:00", "T99Z"])
def test_a_date_in_a_header_without_time_and_zone_is_no_start(date, tmp_path):
    with soundfile.SoundFile(tmp_path / "a.wav", "w", 4000, 1) as file:
        file.date = date
        file.write(np.zeros(9))
    assert find_start_utc_ns(tmp_path / "a.wav") is None
