"""REP and DSF files of track analysts: ships' tracks, bearings and frequencies.

**Conventions.** A line is a position of a track, ``YYMMDD HHMMSS.SSS NAME @@ DD MM SS.SS H
DDD MM SS.SS H course speed depth`` (degrees, knots, metres), or a cut of a sensor on a
track: ``;SENSOR:`` has bearing and range, ``;SENSOR2:`` bearing, ambiguous bearing,
frequency and range, ``;SENSOR3:`` bearing, its accuracy, frequency, its accuracy and range;
date, track, symbol and the sensor's own place (or NULL) stand before, the sensor's name and
a free text after. A leg of a target is a solution, ``;TMA_RB:``, where it begins: bearing, range,
its name, orientation and half axes of its 95 % ellipse (yards), course, speed, depth and text,
seen from the track that is named. What is not known is NULL or NaN. Ranges (yards) are not used: the motion
is estimated without them. Other lines that begin with a semicolon are drawings and
comments. A DSF file has cuts alone; their places come from the tracks of another file.

Each sensor has one contact, of its own number, since nobody says which of them heard the same
target; a text ``contact N``, as `export` writes it, says so: these numbers are common to all
sensors. Of an ambiguous bearing, whose line has no place for its deviation, that text has it.
A sensor whose name several ships have is called by its ship's name, too.

**References.** Debrief, Replay file format (debrief.info).
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NoReturn

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, places_on_grid, to_latitude_longitude
from uwtrack_cli.constants import KNOT_MPS, NANOSECONDS
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.options import shown
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError, note
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.input_ledger import as_input

SUFFIXES = (".rep", ".dsf")
MAX_BYTES = 1 << 26
"""Largest file that is read."""

WORD = re.compile(r'"[^"]*"|\S+')
NUMBER = r"(\d{1,12}(?:\.\d{1,12})?(?:e[+-]?\d{1,3})?)"
CONTACT = re.compile(
    rf"contact (\d{{1,9}})(?: bearing_std_deg {NUMBER})?(?: frequency_std_hz {NUMBER})?"
)
"""What `export` writes behind a cut: its contact, and deviations for which its line has no
place."""
NOT_KNOWN = {"NULL", "NAN", ""}
YARD_M = 0.9144
HALF_95 = 2.448
"""Half axes of an ellipse of 95 %, in deviations."""
SLACK_NS = 60 * NANOSECONDS
"""Time by which a cut may lie beyond the track of its ship."""

VALUES = {
    ";SENSOR:": ("bearing", "range"),
    ";SENSOR2:": ("bearing", "mirrored", "frequency", "range"),
    ";SENSOR3:": ("bearing", "bearing_std", "frequency", "frequency_std", "range"),
}
"""Numbers of a cut by the tag of its line."""

STDS = ("bearing_std", "frequency_std")

LIMITS = {
    "bearing": (-360.0, 360.0),
    "mirrored": (-360.0, 360.0),
    "bearing_std": (1e-9, 180.0),
    "frequency": (1e-9, 1e9),
    "frequency_std": (1e-12, 1e9),
    "range": (0.0, 1e9),
}


@dataclass
class _Track:
    """Positions of a ship, as they stand in a file."""

    time_ns: list[int] = field(default_factory=list)
    """Times, ns since 1970-01-01 UTC."""
    latitude: list[float] = field(default_factory=list)
    """Latitudes, degrees."""
    longitude: list[float] = field(default_factory=list)
    """Longitudes, degrees."""


@dataclass(frozen=True)
class _Cut:
    """What a sensor measured at one time."""

    where: str
    """File and line."""
    time_ns: int
    """Time, ns since 1970-01-01 UTC."""
    track: str
    """Name of the ship that carries the sensor."""
    sensor: str
    """Name of the sensor."""
    place: tuple[float, float] | None
    """Latitude and longitude of the sensor, degrees; None where the line has none."""
    values: dict[str, float]
    """What was measured, by quantity with its unit."""
    text: str
    """Label of the line."""


class _Line:
    """The words of a line, taken one after the other; errors name the line."""

    def __init__(self, path: Path, number: int, text: str) -> None:
        self.where = f"{path}, line {number}"
        self._words = WORD.findall(text)
        self._next = 0

    def fail(self, reason: str) -> NoReturn:
        raise DataError(f"{self.where}: {reason}")

    def word(self, what: str) -> str:
        if self._next >= len(self._words):
            self.fail(f"the line ends before its {what}.")
        self._next += 1
        return str(self._words[self._next - 1].strip('"').strip())

    def rest(self) -> str:
        return " ".join(self._words[self._next :])

    def number(self, what: str, low: float, high: float) -> float:
        """Return a number within limits; nan where it is not known."""
        word = self.word(what)
        if word.upper() in NOT_KNOWN:
            return np.nan
        try:
            value = float(word)
        except ValueError:
            self.fail(f"{what} must be a number, got {shown(word)}.")
        return self.within(what, value, low, high)

    def within(self, what: str, value: float, low: float, high: float) -> float:
        """Return a number that lies within limits."""
        if not low <= value <= high:
            self.fail(f"{what} must lie from {low:g} to {high:g}, got {value:.12g}.")
        return value

    def time_ns(self) -> int:
        date, clock = self.word("date"), self.word("time")
        if not (date.isdigit() and len(date) in {6, 8}):
            self.fail(f"the date must be YYMMDD, got {shown(date)}.")
        whole, _, part = clock.partition(".")
        if not (whole.isdigit() and len(whole) == 6 and (part or "0").isdigit()):
            self.fail(f"the time must be HHMMSS.SSS, got {shown(clock)}.")
        form = "%y%m%d%H%M%S" if len(date) == 6 else "%Y%m%d%H%M%S"
        try:
            moment = datetime.strptime(date + whole, form).replace(tzinfo=UTC)
        except ValueError:
            self.fail(f"there is no time {date[:40]} {clock[:40]} (YYMMDD HHMMSS.SSS).")
        since = moment - datetime(1970, 1, 1, tzinfo=UTC)
        own = round(float(f"0.{part or 0}") * NANOSECONDS)
        return (since.days * 86400 + since.seconds) * NANOSECONDS + own

    def place(self) -> tuple[float, float] | None:
        """Return latitude and longitude in degrees; None for NULL."""
        first = self.word("place")
        if first.upper() in NOT_KNOWN:
            return None
        self._next -= 1
        return self._angle("latitude", 90, "NS"), self._angle("longitude", 180, "EW")

    def _angle(self, what: str, most: int, sides: str) -> float:
        degrees = self.number(f"{what} degrees", 0, most)
        minutes = self.number(f"{what} minutes", 0, 60)
        seconds = self.number(f"{what} seconds", 0, 60)
        side = self.word(f"{what}'s hemisphere").upper()
        if side not in tuple(sides):
            self.fail(f"the {what} must end with {' or '.join(sides)}, got {side[:40]}.")
        angle = degrees + minutes / 60.0 + seconds / 3600.0
        if not angle <= most:
            self.fail(f"the {what} is no angle up to {most} degrees.")
        return angle if side == sides[0] else -angle


def read_replay(paths: Sequence[Path]) -> Series:
    """Read the cuts of sensors from REP and DSF files, and where they were made.

    ``paths``: the files; tracks of one serve the cuts of another.

    Raises
    ------
    DataError
        A line is not as the format has it, there are no cuts, or a track does not
        cover them.
    """
    tracks, cuts = _read(paths)
    if not cuts:
        names = ", ".join(map(str, paths))
        raise DataError(
            f"{names} has tracks and no bearings or frequencies (;SENSOR: lines); give "
            f"the file that has them, too."
        )
    cuts = _unrepeated(cuts)
    start_ns = min(cut.time_ns for cut in cuts)

    def column(name: str) -> FloatArray:
        return np.array([cut.values.get(name, np.nan) for cut in cuts])

    mirrored = column("mirrored")
    contact, is_named = _contacts(cuts)
    series = Series(
        contact=contact,
        contact_numbers="common" if is_named else "own",
        time_s=np.array([(cut.time_ns - start_ns) / NANOSECONDS for cut in cuts]),
        bearing_deg=column("bearing") % 360.0,
        bearing_std_deg=column("bearing_std"),
        frequency_hz=_lines(column("frequency")),
        frequency_std_hz=_lines(column("frequency_std"), column("frequency")),
        level_db=column("level"),
        level_std_db=column("level"),
        mirrored_bearing_deg=mirrored % 360.0 if np.isfinite(mirrored).any() else None,
        start_utc_ns=start_ns,
        where=lambda row: cuts[row].where,
    )
    placed = _placed(series, cuts, tracks)
    if any(np.isfinite(cut.values["range"]) for cut in cuts):
        note("the ranges of the cuts are not used.")
    return placed


def read_replay_track(path: Path, name: str | None = None, flag: str | None = None) -> Navigation:
    """Read the track of a ship of a REP file.

    ``name``: name of the ship; None where the file has one ship alone. ``flag``: option
    that gives the name, for the message; None if there is none.

    Raises
    ------
    DataError
        There is no such ship, or several where none is named.
    """
    tracks, _ = _read([path])
    if name is not None:
        tracks = {key: one for key, one in tracks.items() if key == name} or tracks
    if len(tracks) != 1 or (name is not None and name not in tracks):
        names = ", ".join(list(tracks)[:10]) or "none"
        wanted = "have the track of one ship to be own ship's" if flag is None else (
            f"tell which track is meant: give {flag}" if name is None
            else f"have a track {shown(name)}"
        )  # fmt: skip
        raise DataError(f"{path} must {wanted}, it has {names}.")
    (track,) = tracks.values()
    order = np.unique(np.array(track.time_ns), return_index=True)[1]
    time_ns = np.array(track.time_ns)[order]
    latitude, longitude = np.array(track.latitude), np.array(track.longitude)
    origin = Origin(float(latitude[order[0]]), float(longitude[order[0]]))
    east, north = places_on_grid(latitude[order], longitude[order], origin)
    return Navigation(
        time_s=(time_ns - time_ns[0]) / NANOSECONDS,
        east_m=east,
        north_m=north,
        heading_deg=np.full(east.size, np.nan),
        origin_latitude=origin.latitude,
        origin_longitude=origin.longitude,
        start_utc_ns=int(time_ns[0]),
    )


def _read(paths: Sequence[Path]) -> tuple[dict[str, _Track], list[_Cut]]:
    tracks: dict[str, _Track] = {}
    cuts: list[_Cut] = []
    for path in paths:
        for number, text in _texts(path):
            words = text.split(maxsplit=1)
            tag = words[0].upper()
            if tag in VALUES:
                line = _Line(path, number, words[1] if len(words) > 1 else "")
                cuts.append(_cut(line, tag))
            elif not tag.startswith(";"):
                _add_position(_Line(path, number, text), tracks)
    return tracks, cuts


def _texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file that are not empty, with their numbers."""
    check_readable(path)
    if path.stat().st_size > MAX_BYTES:
        raise DataError(f"{path} is larger than {MAX_BYTES >> 20} MB; split it.")
    try:
        with as_input(path).open(encoding="utf-8-sig", errors="strict") as file:
            for number, text in enumerate(file, 1):
                if text.strip():
                    yield number, text
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is no REP or DSF file ({error}).") from error


def _cut(line: _Line, tag: str) -> _Cut:
    time_ns, track = line.time_ns(), line.word("track")
    line.word("symbol")
    place = line.place()
    values = {name: line.number(name, *LIMITS[name]) for name in VALUES[tag]}
    sensor, text = line.word("sensor"), line.rest()
    told = CONTACT.fullmatch(text)
    for name, value in zip(STDS, told.groups()[1:] if told else (), strict=False):
        if value is not None and name not in values:
            values[name] = line.within(name, float(value), *LIMITS[name])
    return _Cut(line.where, time_ns, track, sensor, place, values, text)


def _add_position(line: _Line, tracks: dict[str, _Track]) -> None:
    time_ns, name = line.time_ns(), line.word("track")
    line.word("symbol")
    place = line.place()
    if place is None or not np.all(np.isfinite(place)):
        line.fail(f"the position of {name[:80]} is missing.")
    track = tracks.setdefault(name, _Track())
    track.time_ns.append(time_ns)
    track.latitude.append(place[0])
    track.longitude.append(place[1])


def _unrepeated(cuts: list[_Cut]) -> list[_Cut]:
    """Return the cuts in the order of time, each once, and say how many are repeated."""
    seen: dict[tuple[object, ...], _Cut] = {}
    first = ""
    for cut in cuts:
        values = tuple(repr(value) for value in cut.values.values())
        key = (cut.time_ns, cut.track, cut.sensor, cut.place, values)
        if key in seen:
            first = first or cut.where
        seen.setdefault(key, cut)
    if first:
        note(f"{len(cuts) - len(seen)} repeated cuts are left out, the first in {first}.")
    return sorted(seen.values(), key=lambda cut: cut.time_ns)


def _contacts(cuts: Sequence[_Cut]) -> tuple[IntArray, bool]:
    """Return the contact that the cuts name, else one number for each sensor.

    And whether they name it.
    """
    named = [CONTACT.fullmatch(cut.text) for cut in cuts]
    if all(named):
        return np.array([int(match[1]) for match in named if match], np.int64), True
    names = _sensors(cuts)
    order = list(dict.fromkeys(names))
    return np.array([1 + order.index(name) for name in names], np.int64), False


def _sensors(cuts: Sequence[_Cut]) -> list[str]:
    """Return the sensor of every cut, with its ship's name where several have it."""
    ships = {(cut.track, cut.sensor) for cut in cuts}
    count = Counter(sensor for _, sensor in ships)
    return [cut.sensor if count[cut.sensor] == 1 else f"{cut.track} {cut.sensor}" for cut in cuts]


def _lines(values: FloatArray, heard: FloatArray | None = None) -> FloatArray:
    """Return a column of frequencies as a table of one line, or of none."""
    known = values if heard is None else heard
    return values[:, np.newaxis] if np.isfinite(known).any() else np.zeros((values.size, 0))


def _placed(series: Series, cuts: Sequence[_Cut], tracks: dict[str, _Track]) -> Series:
    """Say of every cut where it was made; without any place own ship is to be given."""
    if not tracks and all(cut.place is None for cut in cuts):
        hosts = list(dict.fromkeys(cut.track for cut in cuts))
        if len(hosts) > 1:
            raise DataError(
                f"the cuts are of several ships ({', '.join(hosts[:10])}) whose tracks "
                f"are missing: give the REP file that has them, too."
            )
        names = list(dict.fromkeys(_sensors(cuts)))
        if series.contact_numbers == "own" and len(names) > 1:
            words = ", ".join(f"{n} is {name}" for n, name in enumerate(names, 1))
            note(f"each sensor is a contact of its own: {words}.")
        return series
    names = _sensors(cuts)
    places = np.array([cut.place or _on_track(cut, tracks) for cut in cuts])
    origin = Origin(*map(float, places[0]))
    east, north = places_on_grid(places[:, 0], places[:, 1], origin)
    return replace(
        series,
        sensor=np.array(names, np.str_),
        sensor_east_m=east,
        sensor_north_m=north,
        origin=f"sensor {names[0]}",
        origin_latitude=origin.latitude,
        origin_longitude=origin.longitude,
    )


def _on_track(cut: _Cut, tracks: dict[str, _Track]) -> tuple[float, float]:
    """Return where the ship of a cut was."""
    track = tracks.get(cut.track)
    if track is None:
        has = ", ".join(list(tracks)[:10]) or "none"
        raise DataError(f"{cut.where}: there is no track of {cut.track[:80]}, but of {has}.")
    time, first = np.unique(np.array(track.time_ns), return_index=True)
    if not time[0] - SLACK_NS <= cut.time_ns <= time[-1] + SLACK_NS:
        raise DataError(f"{cut.where}: the track of {cut.track[:80]} does not cover the time.")
    since = (time - time[0]) / NANOSECONDS
    at = (cut.time_ns - int(time[0])) / NANOSECONDS
    longitude = np.unwrap(np.array(track.longitude)[first], period=360.0)
    latitude = np.interp(at, since, np.array(track.latitude)[first])
    return float(latitude), float(np.interp(at, since, longitude))


def replay_lines(
    series: Sequence[Series], told: Sequence[Fixes | Motions], *, with_tracks: bool
) -> Iterator[str]:
    """Yield the lines of a REP file, or of a DSF file: cuts alone.

    ``told`` says which contacts of the sensors were joined. ``with_tracks``: whether tracks of sensors and vessels are written.

    Raises
    ------
    DataError
        A time is not known as UTC, or a table has several lines.
    """
    for one in (_as_joined(table, told) for table in series):
        if one.start_utc_ns is None:
            raise DataError("REP and DSF need UTC, and the table has seconds alone: give time_utc.")
        places = _latitudes(one)
        if with_tracks and places is not None and one.sensor is not None:
            yield from _sensor_tracks(one, places)
        yield from _cut_lines(one, places)
    if with_tracks:
        for each in told:
            yield from _fix_lines(each) if isinstance(each, Fixes) else _leg_lines(each)


def _as_joined(series: Series, told: Sequence[Fixes | Motions]) -> Series:
    """Return a table with the contacts to which those of its sensors were joined."""
    contact = series.contact.copy()
    for one in told:
        columns = (one.pairing_contact, one.pairing_sensor, one.pairing_number)
        target, sensor, number = columns
        share = one.pairing_share
        if target is None or sensor is None or number is None or share is None:
            continue
        names = np.empty(0, np.str_) if series.sensor is None else series.sensor
        for k in np.argsort(share, kind="stable"):  # the likeliest comes last
            is_meant = (names == sensor[k]) & (series.contact == number[k])
            contact[is_meant] = target[k]
        return replace(series, contact=contact)
    return series


def _latitudes(series: Series) -> tuple[FloatArray, FloatArray] | None:
    east, north = series.sensor_east_m, series.sensor_north_m
    if series.origin_latitude is None or series.origin_longitude is None:
        return None
    if east is None or north is None:
        return None
    origin = Origin(series.origin_latitude, series.origin_longitude)
    return to_latitude_longitude(east, north, origin)


def _sensor_tracks(series: Series, places: tuple[FloatArray, FloatArray]) -> Iterator[str]:
    names = np.empty(0, np.str_) if series.sensor is None else series.sensor
    for name in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == name)
        _, first = np.unique(series.time_s[rows], return_index=True)
        own = rows[first]
        speed, course = _ways(series, own)
        for number, row in enumerate(own):
            time_ns = _epoch(series, row)
            place = _place_words(places[0][row], places[1][row])
            yield (
                f"{_moment(time_ns)} {_name(name)} @A {place} {course[number]:.1f} "
                f"{speed[number] / KNOT_MPS:.2f} 0"
            )


def _ways(series: Series, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return speed (m/s) and course (degrees) of a sensor at its rows."""
    east, north = series.sensor_east_m, series.sensor_north_m
    if rows.size < 2 or east is None or north is None:
        return np.zeros(rows.size), np.zeros(rows.size)
    time = series.time_s[rows]
    rate = [np.gradient(values[rows], time) for values in (east, north)]
    return np.hypot(*rate), np.degrees(np.arctan2(*rate)) % 360.0


def _cut_lines(series: Series, places: tuple[FloatArray, FloatArray] | None) -> Iterator[str]:
    mirrored = series.mirrored_bearing_deg
    if series.frequency_hz.shape[1] > 1:
        raise DataError(
            f"a REP or DSF cut has one frequency, and the table has "
            f"{series.frequency_hz.shape[1]} lines."
        )
    unknown = np.full(series.time_s.size, np.nan)
    has_line = series.frequency_hz.shape[1] == 1
    frequency = series.frequency_hz[:, 0] if has_line else unknown
    frequency_std = series.frequency_std_hz[:, 0] if has_line else unknown
    for row in range(series.time_s.size):
        sensor = "sensor" if series.sensor is None else str(series.sensor[row])
        place = "NULL"
        if places is not None:
            place = _place_words(places[0][row], places[1][row])
        text = f"contact {series.contact[row]}"
        if mirrored is not None and np.isfinite(mirrored[row]):
            tag = ";SENSOR2:"
            values = [series.bearing_deg[row], mirrored[row], frequency[row]]
            text += _stds(series.bearing_std_deg[row], frequency_std[row])
        else:
            tag = ";SENSOR3:"
            values = [
                series.bearing_deg[row], series.bearing_std_deg[row], frequency[row],
                frequency_std[row],
            ]  # fmt: skip
        numbers = " ".join("NULL" if np.isnan(value) else f"{value:.10g}" for value in values)
        yield (
            f"{tag} {_moment(_epoch(series, row))} {_name(sensor)} @A {place} {numbers} "
            f"NULL {_name(sensor)} {text}"
        )


def _stds(bearing_std_deg: float, frequency_std_hz: float) -> str:
    """Return the deviations for which a cut of two bearings has no place."""
    text = "" if np.isnan(bearing_std_deg) else f" bearing_std_deg {bearing_std_deg:.10g}"
    if np.isnan(frequency_std_hz):
        return text
    return f"{text} frequency_std_hz {frequency_std_hz:.10g}"


def _fix_lines(fixes: Fixes) -> Iterator[str]:
    """Yield the tracks of vessels: the best mode of every contact."""
    for row in range(fixes.time_s.size):
        place = fixes.latitude[row], fixes.longitude[row]
        if fixes.mode[row] != 1 or fixes.time_utc_ns[row] < 0 or np.isnan(place).any():
            continue
        course, speed = fixes.course_deg[row], fixes.speed_mps[row] / KNOT_MPS
        if np.isnan(course):  # the format has no empty course: what lies still has none
            course = speed = 0.0
        yield (
            f"{_moment(int(fixes.time_utc_ns[row]))} CONTACT_{fixes.contact[row]} @C "
            f"{_place_words(*place)} {course:.1f} {speed:.2f} 0"
        )


def _leg_lines(motions: Motions) -> Iterator[str]:
    """Yield every leg of the best mode of every contact as a solution."""
    for row in np.flatnonzero((motions.mode == 1) & (motions.time_utc_ns >= 0)):
        legs = motions.ragged("legs", int(row))
        for leg in legs:
            state = [leg[name] for name in ("range_m", "bearing_deg", "speed_mps", "course_deg")]
            if not np.isfinite(state).all():
                continue
            since_s = leg["start_s"] - motions.time_s[row]
            time_ns = int(motions.time_utc_ns[row]) + round(since_s * NANOSECONDS)
            along = leg["range_std_m"]
            across = np.radians(leg["bearing_std_deg"]) * leg["range_m"]
            turned = leg["bearing_deg"] + (0.0 if along >= across else 90.0)
            axes = sorted((HALF_95 * along / YARD_M, HALF_95 * across / YARD_M))
            owner = "sensor" if motions.reference is None else str(motions.reference[row])
            yield (
                f";TMA_RB: {_moment(time_ns)} {_name(owner or 'sensor')} @C "
                f"{leg['bearing_deg']:.2f} {leg['range_m'] / YARD_M:.0f} "
                f"CONTACT_{motions.contact[row]} {turned % 180.0:.1f} {axes[1]:.0f} "
                f"{axes[0]:.0f} {leg['course_deg']:.1f} {leg['speed_mps'] / KNOT_MPS:.2f} 0 "
                f"leg {leg['number']} of {len(legs)}"
            )


def _epoch(series: Series, row: int) -> int:
    return (series.start_utc_ns or 0) + round(float(series.time_s[row]) * NANOSECONDS)


def _moment(time_ns: int) -> str:
    """Return a time as YYYYMMDD HHMMSS.SSS, which says the century, too."""
    whole = (time_ns + 500_000) // 1_000_000
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(milliseconds=whole)
    return f"{moment:%Y%m%d %H%M%S}.{moment.microsecond // 1000:03d}"


def _name(name: str) -> str:
    plain = name.replace('"', "'")
    return f'"{plain}"' if not plain or any(c.isspace() for c in plain) else plain


def _place_words(latitude: float, longitude: float) -> str:
    longitude = (longitude + 180.0) % 360.0 - 180.0
    north, east = "S" if latitude < 0 else "N", "W" if longitude < 0 else "E"
    return f"{_sexagesimal(latitude)} {north} {_sexagesimal(longitude)} {east}"


def _sexagesimal(angle: float) -> str:
    total = round(abs(angle) * 3600.0 * 10_000)
    minutes, seconds = divmod(total, 600_000)
    return f"{minutes // 60:02d} {minutes % 60:02d} {seconds / 10_000:07.4f}"
