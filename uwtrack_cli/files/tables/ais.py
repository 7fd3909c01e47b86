r"""AIS: where ships said that they were.

**Conventions.** A CSV table has one row per message, in any order, under the usual names
of columns (MMSI, time, latitude, longitude, SOG in knots, COG in degrees); a log of
sentences is known by its first ones. The values that AIS
reserves for "not available" (SOG 102.3, COG 360, latitude 91, longitude 181) are
not used. A damaged row is left out, and it is said how many there are; a table of which
most rows are damaged is refused. Times without a zone are UTC; a number is seconds since 1970. In
tables of the Danish agency, whose line of names begins with ``# Timestamp``, the day
stands first.

A log has NMEA 0183 sentences, decoded by pyais. A position report carries the second of
its minute alone, so the log must say when each sentence was received: by a tag block (``\c:1714564800*..\``), by a
time before the sentence (ISO 8601, or seconds since 1970) or by seconds since 1970
behind it. Sentences with a wrong checksum, other messages and other sentences are passed
over; names come from the static reports.

**References.** ITU-R M.1371-5 (2014), annex 8, table 48: position report; IEC 61162-1: tag
blocks and sentences.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uwtrack_cli.constants import KNOT_MPS, NANOSECONDS
from uwtrack_cli.data.base import Cells, FloatArray, IntArray, TextArray
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.errors import DataError, needing
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.tables.csv_table import Table, read_table, table_times
from uwtrack_cli.files.utc import format_utc, parse_utc

MAX_BYTES = 1 << 30
"""Largest log that is read: some ten million sentences."""

SENTENCE = re.compile(rb"[!$][A-Z]{2}VD[MO],(\d),(\d)[^*\r\n]*\*[0-9A-Fa-f]{2}")
TAG_TIME = re.compile(rb"\\(?:[^\\]*,)?c:(\d{9,16})[,*\\]")
SECONDS = re.compile(r"(\d{9,10})(?:\.(\d+))?")
"""A time as seconds since 1970, from 1973 on."""
TIME_BEHIND = re.compile(rb"\s*[,;\s]\s*(\d{9,10}(?:\.\d+)?)\s*$")
POSITION_REPORTS = frozenset({1, 2, 3, 18, 19, 27})
"""Messages that say where a ship was."""
STATIC_REPORTS = frozenset({5, 19, 24})
"""Messages that say what a ship is called."""


LATEST_S = 5
"""Most that the receiver's clock may be behind the ship's, s."""

LONGEST_DELAY_S = 30
"""Delay beyond which the second of a report is not believed, s."""


@dataclass(frozen=True)
class AisMessages:
    """Position reports of all vessels, in any order; arrays of shape (message,)."""

    start_utc_ns: int | None
    """UTC epoch of time zero, ns."""
    time_s: FloatArray
    """When each was sent, s."""
    mmsi: TextArray
    """Number of the vessel."""
    latitude: FloatArray
    """Latitude in degrees; 91 is unknown."""
    longitude: FloatArray
    """Longitude in degrees; 181 is unknown."""
    speed_kn: FloatArray
    """Speed over ground in knots; nan or 102.3 is unknown."""
    course_deg: FloatArray
    """Course over ground in degrees; nan or 360 is unknown."""
    names: Mapping[str, str]
    """Names of vessels, by number."""


def is_sentence_log(path: Path) -> bool:
    """Tell whether a file begins as a log of AIS sentences does."""
    with as_input(path).open("rb") as file:
        return SENTENCE.search(file.read(1 << 16)) is not None


def read_sentences(path: Path) -> AisMessages:
    """Read the position reports of a log.

    ``path``: text with one sentence in a line.

    Raises
    ------
    DataError
        pyais is not installed, no report has a time, or the log holds none.
    """
    rows: list[tuple[int, int, float, float, float, float]] = []
    names: dict[str, str] = {}
    n_timeless = 0
    for report, received_ns in _reports(path):
        if report.msg_type in STATIC_REPORTS:
            name = str(getattr(report, "shipname", None) or "").strip(" @")
            if name:
                names[f"{report.mmsi:09d}"] = name
        if report.msg_type not in POSITION_REPORTS:
            continue
        if received_ns is None:
            n_timeless += 1
            continue
        sent_ns = received_ns - _delay_ns(received_ns, getattr(report, "second", 60))
        is_long_range = report.msg_type == 27  # there 63 knots is "not available"
        speed = np.nan if is_long_range and report.speed >= 63 else report.speed
        rows.append((report.mmsi, sent_ns, report.lat, report.lon, speed, report.course))
    if not rows:
        raise DataError(
            f"{path} holds {n_timeless} position reports and the time of none of them; a "
            f"sentence carries the second of its minute alone. Keep a log with tag "
            f"blocks (c:) or with a time before each sentence."
        )
    mmsi, time_ns, *columns = zip(*rows, strict=True)
    start_ns = min(time_ns)
    latitude, longitude, speed_kn, course_deg = map(np.array, columns)
    return AisMessages(
        start_utc_ns=start_ns,
        time_s=(np.array(time_ns, np.int64) - start_ns) / NANOSECONDS,
        mmsi=np.array([f"{number:09d}" for number in mmsi]),
        latitude=latitude,
        longitude=longitude,
        speed_kn=speed_kn,
        course_deg=course_deg,
        names=names,
    )


def _reports(path: Path) -> Iterator[tuple[Any, int | None]]:
    """Yield the decoded messages of a log, and when they were received, ns."""
    with needing("AIS sentences need pyais", "ais"):
        from pyais.exceptions import AISBaseException
        from pyais.stream import IterMessages
    if path.stat().st_size > MAX_BYTES:
        raise DataError(f"{path} is larger than {MAX_BYTES >> 20} MB; split it.")
    log = _Log(path)
    for sentence in IterMessages(iter(log)):
        if not sentence.is_valid:
            continue
        try:
            report = sentence.decode()
        except (AISBaseException, ValueError):
            continue  # a damaged payload with a right checksum
        yield report, log.time_ns


class _Log:
    """The sentences of a log, and when the last one read was received."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.time_ns: int | None = None

    def __iter__(self) -> Iterator[bytes]:
        with as_input(self.path).open("rb") as file:
            for line in file:
                found = SENTENCE.search(line[:4096])
                if found is None:
                    continue
                if found[2] == b"1":  # the parts that follow belong to the first
                    self.time_ns = _received_ns(line[: found.start()], line[found.end() :])
                yield found[0]


def _delay_ns(received_ns: int, second: int) -> int:
    """Return how long before its reception a report says that it was made."""
    if not 0 <= second < 60:
        return 0
    ahead_ns = LATEST_S * NANOSECONDS
    delay_ns = received_ns - second * NANOSECONDS + ahead_ns
    delay_ns = delay_ns % (60 * NANOSECONDS) - ahead_ns
    return delay_ns if delay_ns <= LONGEST_DELAY_S * NANOSECONDS else 0


def _received_ns(before: bytes, behind: bytes) -> int | None:
    """Return when a sentence was received, by what stands around it."""
    tag = TAG_TIME.search(before)
    if tag:
        number = int(tag[1])
        # receivers write seconds or milliseconds
        return number * (NANOSECONDS if number < 10**11 else NANOSECONDS // 1000)
    text = before.split(b"\\")[0].decode("ascii", "replace").strip(" \t,;[]")
    if not text:
        after = TIME_BEHIND.match(behind)
        if after is None:
            return None
        text = after[1].decode()
    seconds = SECONDS.fullmatch(text)
    if seconds:
        fraction = (seconds[2] or "").ljust(9, "0")[:9]
        return int(seconds[1]) * NANOSECONDS + int(fraction)
    try:
        return parse_utc(text)
    except DataError:
        return None


COLUMNS = {
    "time_utc": Cells(needed=True, aliases=(
        "time", "basedatetime", "base_date_time", "date_time_utc", "received_time",
        "timestamp_utc",
    )),
    "mmsi": Cells(needed=True),
    "latitude": Cells(-91.0, 91.0, needed=True, aliases=("latitude_degrees",)),
    "longitude": Cells(-181.0, 181.0, needed=True, aliases=("longitude_degrees",)),
    "speed_kn": Cells(0.0, 1e4, needed=True, aliases=(
        "sog", "sog_knots", "sog_kn", "speed_over_ground", "speed",
    )),
    "course_deg": Cells(0.0, 1e4, needed=True, aliases=(
        "cog", "cog_degrees", "cog_deg", "course_over_ground", "course",
    )),
    "name": Cells(aliases=("vesselname", "vessel_name", "shipname", "ship_name")),
}  # fmt: skip
"""Columns of a table; values for "not available" are among those accepted."""

NUMBERS = ("latitude", "longitude", "speed_kn", "course_deg")
ALIASES = {alias: name for name, cells in COLUMNS.items() for alias in cells.aliases}
DAY_FIRST = "# Timestamp"
"""Begin of the line of names in tables of the Danish Maritime Authority."""

DAY_MONTH = re.compile(r"(\d\d)/(\d\d)/(\d{4}) (.+)")
NO_SPEED_KN, NO_COURSE_DEG = 102.25, 360.0
POSITION_STD_M = 10.0
"""Deviation of a position: AIS calls those better than 10 m accurate."""


def read_ais(path: Path) -> Truth:
    """Read an AIS table as the truth of where vessels were.

    ``path``: CSV with time, MMSI, latitude, longitude, speed and course over ground, or
    a log of NMEA 0183 sentences.

    Raises
    ------
    DataError
        The table lacks a column, most of its rows are damaged, or a log has no times.
    """
    check_readable(path)
    messages = read_sentences(path) if is_sentence_log(path) else _read_csv(path)
    known = (np.abs(messages.latitude) <= 90.0) & (np.abs(messages.longitude) <= 180.0)
    vessel = np.unique(messages.mmsi, return_inverse=True)[1]
    # by vessel and time; of equal times the first message counts
    order = np.lexsort((messages.time_s, vessel))
    order = order[known[order]]
    is_first = np.diff(vessel[order], prepend=-1) != 0
    is_first |= np.diff(messages.time_s[order], prepend=-np.inf) > 0.0
    order = order[is_first]
    parts = np.split(order, np.flatnonzero(np.diff(vessel[order])) + 1)
    return Truth(
        name=path.name,
        start_utc_ns=messages.start_utc_ns,
        is_geographic=True,
        tracks=tuple(_track(messages, rows) for rows in parts if rows.size),
        position_std_m=POSITION_STD_M,
    )


def _read_csv(path: Path) -> AisMessages:
    table = read_table(path, heading=DAY_FIRST, may_be_damaged=True)
    cells = {ALIASES.get(name, name): column for name, column in table.cells.items()}
    if len(cells) < len(table.cells):
        raise DataError(f"{path} names a quantity in two columns: {', '.join(table.cells)}.")
    table = Table(path, cells, table.lines, table.damaged)
    table.need(*(name for name, own in COLUMNS.items() if own.needed))
    cells.pop("time_s", None)
    is_day_first = _begins_with(path, DAY_FIRST)
    cells["time_utc"] = [_iso(cell, is_day_first=is_day_first) for cell in cells["time_utc"]]
    time_s, start_ns = table_times(table)
    columns = [table.measured(name, COLUMNS[name]) for name in NUMBERS]
    kept = table.undamaged()
    latitude, longitude, speed_kn, course_deg = (column[kept] for column in columns)
    table = table.rows(kept)
    numbers = table.cells["mmsi"]
    names = dict[str, str]()
    for number, name in zip(numbers, table.cells.get("name", ()), strict=False):
        if name.strip():  # messages may lack it
            names.setdefault(number, name)
    return AisMessages(
        start_utc_ns=start_ns,
        time_s=time_s[kept],
        mmsi=np.array(numbers),
        latitude=latitude,
        longitude=longitude,
        speed_kn=speed_kn,
        course_deg=course_deg,
        names=names,
    )


def _begins_with(path: Path, text: str) -> bool:
    with as_input(path).open(encoding="utf-8-sig") as file:
        return file.read(len(text)) == text


def _iso(cell: str, *, is_day_first: bool) -> str:
    """Return a time of an agency in the form that all tables have, others unchanged."""
    if SECONDS.fullmatch(cell):
        return format_utc(int(float(cell) * NANOSECONDS))
    found = DAY_MONTH.fullmatch(cell) if is_day_first else None
    if found is None:
        return cell
    day, month, year, clock = found.groups()
    return f"{year}-{month}-{day}T{clock}"


def _track(messages: AisMessages, rows: IntArray) -> VesselTrack:
    mmsi = str(messages.mmsi[rows[0]])
    name = messages.names.get(mmsi)
    speed_kn, course_deg = messages.speed_kn[rows], messages.course_deg[rows]
    return VesselTrack(
        vessel=f"{name} ({mmsi})" if name else mmsi,
        time_s=messages.time_s[rows],
        first=messages.latitude[rows],
        second=messages.longitude[rows],
        speed_mps=np.where(speed_kn < NO_SPEED_KN, speed_kn, np.nan) * KNOT_MPS,
        course_deg=np.where(course_deg < NO_COURSE_DEG, course_deg, np.nan),
    )
