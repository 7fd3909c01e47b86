r"""Logs of AIS receivers: NMEA 0183 sentences, decoded by pyais.

**Conventions.** A position report carries the second of its minute alone, so the log
must say when each sentence was received: by a tag block (``\c:1714564800*..\``), by a
time before the sentence (ISO 8601, or seconds since 1970) or by seconds since 1970
behind it. Sentences with a wrong checksum, other messages and other sentences are passed
over; names come from the static reports.

**References.** ITU-R M.1371-5 (2014), annex 8; IEC 61162-1 (tag blocks and sentences).
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray, TextArray
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.utc import parse_utc

MAX_BYTES = 1 << 30
"""Largest log that is read: some ten million sentences."""

SENTENCE = re.compile(rb"[!$][A-Z]{2}VD[MO],(\d),(\d)[^*\r\n]*\*[0-9A-Fa-f]{2}")
TAG_TIME = re.compile(rb"\\(?:[^\\]*,)?c:(\d{9,16})[,*\\]")
SECONDS = re.compile(r"(\d{9,10})(?:\.(\d+))?")
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
        rows.append(
            (report.mmsi, sent_ns, report.lat, report.lon, speed, report.course)
        )
    if not rows:
        msg = (
            f"{path} holds {n_timeless} position reports and the time of none of them; a "
            f"sentence carries the second of its minute alone. Keep a log with tag "
            f"blocks (c:) or with a time before each sentence."
        )
        raise DataError(msg)
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
    try:
        from pyais.exceptions import AISBaseException
        from pyais.stream import IterMessages
    except ImportError as error:
        msg = f"AIS sentences need pyais ({error}); pip install 'uwtrack[ais]'."
        raise DataError(msg) from error
    if path.stat().st_size > MAX_BYTES:
        msg = f"{path} is larger than {MAX_BYTES >> 20} MB; split it."
        raise DataError(msg)
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
                    self.time_ns = _received_ns(
                        line[: found.start()], line[found.end() :]
                    )
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
