"""When a recording began: from an option, the name of its file, or its header.

**Method.** Every preset that fits the file name is tried; the time counts only if
all of them agree. A pattern of one's own is written as for `strptime` and may stand
anywhere in the name. Where the name tells nothing, the date in the header counts (ICRD
of a WAV file, DATE of a FLAC file) if it is a time with its zone: days and local times
are of whoever edited the file.
"""

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path

import soundfile

from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.audio.opening import open_sound
from uwtrack_cli.files.utc import epoch_ns, format_utc, named_zone, parse_utc

PRESETS: dict[str, str] = {
    "soundtrap": r"(?<!\d)\d{3,10}\.(?P<yy>\d\d)(?P<m>\d\d)(?P<d>\d\d)"
    r"(?P<H>\d\d)(?P<M>\d\d)(?P<S>\d\d)(?!\d)",
    "date_time": r"(?<!\d)(?P<Y>\d{4})(?P<m>\d\d)(?P<d>\d\d)[_-]"
    r"(?P<H>\d\d)(?P<M>\d\d)(?P<S>\d\d)(?:[_.-](?P<f>\d{3}))?(?!\d)",
    "short": r"(?<!\d)(?P<yy>\d\d)(?P<m>\d\d)(?P<d>\d\d)[_-]"
    r"(?P<H>\d\d)(?P<M>\d\d)(?P<S>\d\d)(?!\d)",
    "digits": r"(?<!\d)(?P<Y>(?:19|20)\d\d)(?P<m>\d\d)(?P<d>\d\d)"
    r"(?P<H>\d\d)(?P<M>\d\d)(?P<S>\d\d)(?!\d)",
    "separated": r"(?<!\d)(?P<Y>\d{4})[-_](?P<m>\d\d)[-_](?P<d>\d\d)[-_ ]"
    r"(?P<H>\d\d)[-_:.](?P<M>\d\d)[-_:.](?P<S>\d\d)(?:\.(?P<f>\d{3,9}))?(?!\d)",
    "iso": r"(?<!\d)(?P<Y>\d{4})-?(?P<m>\d\d)-?(?P<d>\d\d)T"
    r"(?P<H>\d\d)[-_:]?(?P<M>\d\d)[-_:]?(?P<S>\d\d)(?:[.,](?P<f>\d{1,9}))?"
    r"(?P<z>Z)?(?!\d)",
}
"""File names of the usual recorders: soundtrap is `serial.yymmddHHMMSS`, date_time
`NAME_YYYYMMDD_HHMMSS[_mmm]`, short `NAME_yymmdd_HHMMSS`, digits `YYYYMMDDHHMMSS`,
separated `YYYY-MM-DD_HH-MM-SS`, iso `YYYYMMDDTHHMMSSZ`."""

DIRECTIVES = {
    "Y": r"(?P<Y>\d{4})", "y": r"(?P<yy>\d\d)", "m": r"(?P<m>\d\d)",
    "d": r"(?P<d>\d\d)", "j": r"(?P<j>\d{3})", "H": r"(?P<H>\d\d)",
    "M": r"(?P<M>\d\d)", "S": r"(?P<S>\d\d)", "f": r"(?P<f>\d{1,9})",
    "%": "%",
}  # fmt: skip


ZONED = re.compile(r"T.*(Z|[+-]\d\d:?\d\d)$")
"""A date that is a time with its zone."""


def find_start_utc_ns(
    path: Path,
    *,
    start_utc: str | None = None,
    time_pattern: str | None = None,
    time_zone: str = "UTC",
) -> int | None:
    """Return the time of the first sample, ns since 1970-01-01 UTC.

    ``path``: the recording; its name is looked at, then its header. ``start_utc``: the
    time itself, ISO 8601. ``time_pattern``: name of a preset, or a pattern such as
    ``H1_%Y%m%d-%H%M%S``. ``time_zone``: time zone of the name (and of a time without
    zone): a name or an offset.

    Returns
    -------
    int or None
        None if nothing says when the recording began.

    Raises
    ------
    DataError
        The name fits two different times, or not the pattern that was given.
    OptionError
        The pattern, the zone or the time cannot be understood.
    """
    clock = named_zone(time_zone)
    if start_utc is not None:
        try:
            return parse_utc(start_utc, clock)
        except DataError as error:
            raise OptionError(f"the start time cannot be understood: {error}") from error
    patterns = PRESETS if time_pattern is None else _patterns(time_pattern)
    found = {
        time: name
        for name, pattern in patterns.items()
        for time in _times(path.name, pattern, clock)
    }
    if len(found) > 1:
        listed = ", ".join(f"{format_utc(t)} ({found[t]})" for t in sorted(found))
        raise DataError(
            f"the name {path.name} fits several times: {listed}; "
            f"give --time-pattern or --start-utc."
        )
    if not found and time_pattern is not None:
        raise DataError(f"the name {path.name} does not fit the pattern {time_pattern!r}.")
    return next(iter(found)) if found else _start_in_header(path)


def _start_in_header(path: Path) -> int | None:
    """Return the time that the header of a file tells with its zone, None without one."""
    if not path.is_file():  # what still comes through a pipe is not to be taken from it
        return None
    try:
        with open_sound(path) as file:
            date = file.date
        return parse_utc(date) if ZONED.search(date) else None
    except (soundfile.SoundFileError, OSError, DataError):
        return None  # whoever reads the sound tells what is wrong with it


def check_clock_options(time_pattern: str | None = None, time_zone: str | None = None) -> None:
    """Refuse what no recording could be read with, before the first one is read.

    ``time_pattern``: name of a preset, or a pattern, as for `find_start_utc_ns`.
    ``time_zone``: name of a zone, or an offset.

    Raises
    ------
    OptionError
        The pattern or the zone cannot be understood.
    """
    named_zone(time_zone or "UTC")
    if time_pattern is not None:
        _patterns(time_pattern)


def _patterns(text: str) -> dict[str, str]:
    if text in PRESETS:
        return {text: PRESETS[text]}
    if "%" not in text:
        raise OptionError(
            f"unknown time pattern {text!r}: give one such as '%Y%m%d_%H%M%S', "
            f"or a preset: {', '.join(PRESETS)}."
        )
    expression = ""
    pieces = re.split(r"%(.)", text)
    for literal, directive in zip(pieces[::2], [*pieces[1::2], ""], strict=True):
        expression += re.escape(literal)
        if directive and directive not in DIRECTIVES:
            raise OptionError(
                f"time pattern {text!r}: %{directive} is not understood; "
                f"accepted are {', '.join('%' + name for name in DIRECTIVES)}."
            )
        expression += DIRECTIVES.get(directive, "")
    try:
        fields = set(re.compile(expression).groupindex)
    except re.error as error:
        raise OptionError(f"time pattern {text!r} uses a directive twice.") from error
    if not fields & {"Y", "yy"} or not ("j" in fields or {"m", "d"} <= fields):
        raise OptionError(
            f"time pattern {text!r} names no day: it needs %Y or %y, and %m with %d or %j."
        )
    return {text: expression}


def _times(name: str, pattern: str, zone: tzinfo) -> Iterator[int]:
    """Yield every time that a pattern finds in a name."""
    for found in re.finditer(pattern, name):
        fields = {k: v for k, v in found.groupdict().items() if v is not None}
        try:
            local = _local(fields)
        except ValueError:
            continue  # digits that are no date
        fraction = int(fields.get("f", "").ljust(9, "0"))
        yield epoch_ns(local, UTC if "z" in fields else zone) + fraction


def _local(fields: dict[str, str]) -> datetime:
    year = int(fields["Y"]) if "Y" in fields else 2000 + int(fields["yy"])
    hour, minute, second = (int(fields.get(key, "0")) for key in "HMS")
    if "j" in fields:
        new_year = datetime(year, 1, 1, hour, minute, second)  # noqa: DTZ001
        return new_year + timedelta(days=int(fields["j"]) - 1)
    month, day = int(fields["m"]), int(fields["d"])
    return datetime(year, month, day, hour, minute, second)  # noqa: DTZ001
