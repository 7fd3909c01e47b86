"""Times of day as exact integers: nanoseconds since 1970-01-01 UTC."""

import re
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.errors import DataError, OptionError

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
OFFSET = re.compile(r"(?:UTC|GMT)?([+-])(\d{1,2})(?::?([0-5]\d))?")
ISO = re.compile(
    r"(\d{4}-?\d\d-?\d\d)[T _](\d\d:?\d\d(?::?\d\d)?)(?:[.,](\d{1,9}))?"
    r"\s*(Z|UTC|[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)


def parse_utc(text: str, zone: tzinfo = UTC) -> int:
    """Return an ISO 8601 time as ns since 1970-01-01 UTC, exact to the ns.

    ``text``: such as ``2018-01-13T16:12:01.862011Z``. ``zone``: what a time without
    zone is in.

    Raises
    ------
    DataError
        The text is no such time.

    Examples
    --------
    >>> parse_utc("2018-01-13T16:12:01.862011123Z")
    1515859921862011123
    """
    found = ISO.fullmatch(text.strip())
    if found is None:
        raise DataError(f"{text!r} is no time such as 2018-01-13T16:12:01.862Z.")
    date, clock, fraction, own = found.groups()
    try:
        day = datetime.fromisoformat(f"{date}T{clock}")
    except ValueError as error:
        raise DataError(f"{text!r} is no time that exists: {error}.") from error
    if own is not None:
        zone = UTC if own.upper() in {"Z", "UTC"} else named_zone(own)
    return epoch_ns(day, zone) + int((fraction or "").ljust(9, "0"))


def epoch_ns(local: datetime, zone: tzinfo) -> int:
    """Return a local time as ns since 1970-01-01 UTC.

    Raises
    ------
    DataError
        The time exists twice, or not at all, where clocks were changed.
    """
    choices = {local.replace(tzinfo=zone, fold=fold).utcoffset() for fold in (0, 1)}
    if len(choices) > 1:
        raise DataError(
            f"{local} is not one time in {zone}: clocks were changed then; "
            f"give the time with its offset."
        )
    span = local.replace(tzinfo=zone) - EPOCH
    seconds = span.days * 86_400 + span.seconds
    return seconds * NANOSECONDS + span.microseconds * 1_000


def named_zone(name: str) -> tzinfo:
    """Return a time zone by its name or offset from UTC.

    ``name``: such as ``UTC``, ``Asia/Seoul`` or ``+09:00``.

    Raises
    ------
    OptionError
        There is no such zone.
    """
    if name.upper() in {"UTC", "Z", "GMT"}:
        return UTC
    found = OFFSET.fullmatch(name.strip())
    if found is not None:
        sign, hours, minutes = found.groups()
        span = timedelta(hours=int(hours), minutes=int(minutes or 0))
        if span < timedelta(hours=24):
            return timezone(-span if sign == "-" else span)
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise OptionError(
            f"unknown time zone {name!r}; such as UTC, Asia/Seoul or +09:00."
        ) from error


def format_utc(time_ns: int) -> str:
    """Return ns since 1970-01-01 as ISO 8601 text, with milliseconds or finer.

    Examples
    --------
    >>> format_utc(1515859921862000000)
    '2018-01-13T16:12:01.862Z'
    """
    seconds, rest = divmod(int(time_ns), NANOSECONDS)
    day = (EPOCH + timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%S")
    digits = f"{rest:09d}"
    shown = digits.rstrip("0")
    return f"{day}.{shown.ljust(3, '0')}Z"
