"""Open a recording as the options of a command or a batch say.

**Method.** The audio of a sonobuoy is taken apart into omni, east and north. A recorder
whose clock is known to be fast or slow has the sample rate that it had in truth, so that
every frequency and time after it is right; spans are told in true seconds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from uwtrack_cli.acoustics.geodesy import magnetic_declination_deg
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.options import convert
from uwtrack_cli.data.recording import UNENDED, Recording
from uwtrack_cli.data.sensor import Sensor, SoundSpeed
from uwtrack_cli.errors import DataError, note, warn
from uwtrack_cli.files.audio.live_recording import NOW, RawSound, live_span, open_live_recording
from uwtrack_cli.files.audio.recording_file import open_recording, span_in
from uwtrack_cli.files.audio.start_time import find_start_utc_ns
from uwtrack_cli.files.checks import STANDARD_INPUT
from uwtrack_cli.files.tables.navigation import read_navigation
from uwtrack_cli.files.tables.sensors import find_sensor
from uwtrack_cli.flow.sonobuoy import demultiplex
from uwtrack_cli.spectra.demultiplex import RATE_HZ

NO_OPTIONS: dict[str, Any] = {
    "sensor": None, "sensor_sound_speed_mps": None, "own_ship": None,
    "start_utc": None, "time_zone": "UTC", "time_pattern": None, "channel": None, "start_s": None,
    "stop_s": None, "allow_truncated": False,
}  # fmt: skip
"""Options of opening, when nothing is asked for."""


def joined(recordings: Sequence[Recording]) -> Recording:
    """Return the one recording, or those of several recorders as that of one array.

    Raises
    ------
    DataError
        The recorders have no time or place in common.
    """
    if len(recordings) == 1:
        return recordings[0]
    from uwtrack_cli.arrays.recorders import join_recorders

    return join_recorders(recordings)


def open_with_options(
    path: Path, options: Mapping[str, Any], sensor: Sensor | None = None
) -> Recording:
    """Open a recording with its sensor and start time.

    ``options``: those of ``NO_OPTIONS``; what is not there keeps its value from there.
    ``sensor``: the sensor, instead of that of a file.

    Raises
    ------
    DataError
        The file is missing, a folder, or no recording.
    OptionError
        The sound speed is not positive, or an option does not fit the recording.
    """
    if path.is_dir():
        raise DataError(f"{path} is a folder, not a file; uwtrack batch runs over what it holds.")
    chosen = {**NO_OPTIONS, **options}
    start_utc_ns = find_start_utc_ns(
        path,
        start_utc=chosen["start_utc"],
        time_pattern=chosen["time_pattern"],
        time_zone=chosen["time_zone"],
    )
    recording = open_file(
        path,
        sensor=sensor or find_sensor(path, chosen["sensor"]),
        start_utc_ns=start_utc_ns,
        channel=chosen["channel"],
        start_s=chosen["start_s"],
        stop_s=chosen["stop_s"],
        allow_truncated=chosen["allow_truncated"],
    )
    return _as_told(recording, chosen)


def open_live_with_options(
    path: Path,
    options: Mapping[str, Any],
    *,
    raw: RawSound | None = None,
    idle_s: float | None = None,
    sensor: Sensor | None = None,
) -> Recording:
    """Open sound that is still coming, with its sensor and start time.

    ``path``: ``-`` for standard input, a named pipe, or a file that is being written.
    ``options``: those of ``NO_OPTIONS``; ``start_utc`` may be ``now``. ``raw``: what
    the samples are, where there is no header. ``idle_s``: the sound has ended when
    nothing came for so long, s; None waits for ever. ``sensor``: as for a recording.

    Raises
    ------
    DataError
        There is no sound, or it is of a kind that cannot be read so.
    OptionError
        An option does not fit.
    """
    chosen = {**NO_OPTIONS, **options}
    is_now = chosen["start_utc"] == "now"
    named = None if path == STANDARD_INPUT else path
    start_utc_ns: int | None = NOW
    if not is_now:
        start_utc_ns = find_start_utc_ns(
            Path() if named is None else named,
            start_utc=chosen["start_utc"],
            time_pattern=None if named is None else chosen["time_pattern"],
            time_zone=chosen["time_zone"],
        )
    has_file = named is not None or chosen["sensor"] is not None
    recording = open_live(
        path,
        sensor=sensor or (find_sensor(path, chosen["sensor"]) if has_file else None),
        start_utc_ns=start_utc_ns,
        channel=chosen["channel"],
        start_s=chosen["start_s"],
        stop_s=chosen["stop_s"],
        raw=raw,
        idle_s=idle_s,
    )
    return _as_told(recording, chosen)


def _as_told(recording: Recording, chosen: Mapping[str, Any]) -> Recording:
    """Put in what is told of the sensor beside its file."""
    sensor = recording.sensor
    if chosen["own_ship"] is not None:
        sensor = _with_own_ship(sensor, chosen["own_ship"])
    if chosen["sensor_sound_speed_mps"] is not None:
        speed = convert("--sound-speed-mps", SoundSpeed, chosen["sensor_sound_speed_mps"])
        sensor = replace(sensor, sound_speed_mps=speed)
    return replace(recording, sensor=from_true_north(sensor, recording.start_utc_ns))


def _with_own_ship(sensor: Sensor, path: Path) -> Sensor:
    if sensor.heading_source == "fixed":
        raise DataError(
            f"array {sensor.id!r} has heading_deg in its sensor file, so it is fixed, "
            f"and --own-ship {path} moves it: leave out one of them."
        )
    if sensor.navigation is not None:
        warn(f"{path} is taken instead of the navigation of sensor {sensor.id!r}.")
    return replace(sensor, navigation=read_navigation(path))


def from_true_north(sensor: Sensor, start_utc_ns: int | None) -> Sensor:
    """Return a sensor whose compass offset holds the declination, where that is asked.

    ``start_utc_ns``: start of its recording, ns since 1970-01-01 UTC.

    Raises
    ------
    DataError
        Place or time is not known, or there is no model for them.
    """
    if sensor.north == "compass":
        warn(
            f"bearings of sensor {sensor.id!r} are from the north of its compass: give "
            f'declination_deg in its sensor file, in degrees or as "place".'
        )
    if sensor.north != "place":
        return sensor
    latitude, longitude = sensor.latitude, sensor.longitude
    if sensor.navigation is not None:
        latitude = sensor.navigation.origin_latitude
        longitude = sensor.navigation.origin_longitude
    if latitude is None or longitude is None or start_utc_ns is None:
        lacks = "start of its recording" if latitude is not None else "latitude"
        raise DataError(
            f'declination_deg = "place" of sensor {sensor.id!r} needs latitude, longitude '
            f"and the start of the recording (--start-utc); there is no {lacks}."
        )
    begin = datetime.fromtimestamp(start_utc_ns / NANOSECONDS, UTC)
    new_year = [datetime(begin.year + k, 1, 1, tzinfo=UTC) for k in (0, 1)]
    share = (begin - new_year[0]) / (new_year[1] - new_year[0])
    year = begin.year + share
    try:
        declination_deg = magnetic_declination_deg(latitude, longitude, year)
    except ImportError as error:
        raise DataError(
            f'declination_deg = "place" needs pygeomag ({error}); pip install '
            f"'uwtrack[declination]', or give the declination in degrees."
        ) from error
    except ValueError as error:
        raise DataError(f"{error}; give declination_deg in degrees.") from error
    note(
        f"sensor {sensor.id!r} is given a declination of {declination_deg:.2f} degrees, "
        f"of the World Magnetic Model."
    )
    offset_deg = sensor.compass_offset_deg + declination_deg
    return replace(sensor, compass_offset_deg=offset_deg, north=None)


def open_file(
    path: Path, *, sensor: Sensor | None, start_s: float | None, stop_s: float | None, **how: Any
) -> Recording:
    """Open a recording; the audio of a buoy as omni, east and north.

    As `open_recording`, with its options and errors; the sample rate is without the
    clock error of the sensor, and the span is in true seconds.
    """
    start_s, stop_s = _by_clock(sensor, start_s), _by_clock(sensor, stop_s)
    if sensor is None or not sensor.is_multiplexed:
        return _in_true_time(
            open_recording(path, sensor=sensor, start_s=start_s, stop_s=stop_s, **how)
        )
    whole = demultiplex(open_recording(path, sensor=sensor, **how))
    span = span_in(path, whole.n_samples, RATE_HZ, start_s, stop_s)
    return _in_true_time(whole.part(*span))


def open_live(
    path: Path, *, sensor: Sensor | None, start_s: float | None, stop_s: float | None, **how: Any
) -> Recording:
    """Open sound that is still coming; the audio of a buoy as omni, east and north.

    As `open_live_recording`, with its options and errors; times as of `open_file`.
    """
    start_s, stop_s = _by_clock(sensor, start_s), _by_clock(sensor, stop_s)
    if sensor is None or not sensor.is_multiplexed:
        return _in_true_time(
            open_live_recording(path, sensor=sensor, start_s=start_s, stop_s=stop_s, **how)
        )
    first, last = live_span(RATE_HZ, start_s, stop_s)
    whole = demultiplex(open_live_recording(path, sensor=sensor, **how))
    return _in_true_time(whole.part(first, UNENDED if last is None else last))


def _by_clock(sensor: Sensor | None, time_s: float | None) -> float | None:
    """Return a time since the first sample as the recorder's clock counts it."""
    if sensor is None or time_s is None:
        return time_s
    return time_s / _clock_share(sensor)


def _clock_share(sensor: Sensor) -> float:
    """Return a frequency in a recording over what it is in truth."""
    return 1.0 + 1e-6 * (sensor.clock_error_ppm or 0.0)


def _in_true_time(recording: Recording) -> Recording:
    """Return a recording with the sample rate that its recorder had in truth."""
    rate_hz = recording.sample_rate_hz / _clock_share(recording.sensor)
    true = replace(recording, sample_rate_hz=rate_hz)
    if true.start_utc_ns is None:
        return true
    first = recording.first_sample
    late_ns = true.elapsed_ns(first) - recording.elapsed_ns(first)
    return replace(true, start_utc_ns=true.start_utc_ns + late_ns)
