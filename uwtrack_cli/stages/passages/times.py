"""The times at which positions are wanted.

**Conventions.** Seconds count from the first sample; a UTC time needs a recording
with a start time.
"""

from datetime import UTC, datetime

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.errors import DataError, OptionError

MOST_TIMES = 100_000
"""Regular times beyond this number are taken for a slip."""


def fix_times(
    approach_s: FloatArray,
    start_utc_ns: int | None,
    at: list[str] | None,
    every_s: float | None,
    until: str | None,
) -> FloatArray:
    """Return the times of the positions, in order.

    Parameters
    ----------
    approach_s
        Times of the closest approaches in seconds.
    start_utc_ns
        Time of the first sample, or None.
    at
        Single times.
    every_s
        Distance of regular times in seconds.
    until
        End of the regular times.

    Examples
    --------
    >>> fix_times(np.array([10.0]), None, ["60", "30.5"], None, None).tolist()
    [30.5, 60.0]
    """
    wanted = [parse_time(text, start_utc_ns) for text in at or []]
    if every_s is not None:
        first = float(np.min(approach_s))
        last = float(np.max(approach_s))
        end = parse_time(until, start_utc_ns) if until is not None else last
        count = int(np.floor(max(end - first, 0.0) / every_s)) + 1
        if count > MOST_TIMES:
            msg = (
                f"every_s {every_s} until {until} makes {count} times; at most "
                f"{MOST_TIMES} are accepted."
            )
            raise OptionError(msg)
        wanted += [first + every_s * number for number in range(count)]
    return np.unique(np.array(wanted or approach_s, float))


def parse_time(text: str, start_utc_ns: int | None) -> float:
    """Return seconds from the first sample of a time given as text.

    Parameters
    ----------
    text
        UTC such as 2026-01-31T12:00:00Z, or seconds from the first sample.
    start_utc_ns
        Time of the first sample, or None.

    Examples
    --------
    >>> parse_time("1970-01-01T00:01:00Z", 0)
    60.0
    """
    try:
        return float(text)
    except ValueError:
        pass
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        msg = (
            f"cannot read the time {text!r}: give UTC such as 2026-01-31T12:00:00Z "
            "or seconds from the first sample."
        )
        raise OptionError(msg) from error
    if start_utc_ns is None:
        msg = (
            f"the time {text!r} is UTC, but the recording has no start time: give "
            "seconds from the first sample, or run again with --start-utc."
        )
        raise DataError(msg)
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    whole = (since.days * 86400 + since.seconds) * NANOSECONDS
    return (whole + since.microseconds * 1000 - start_utc_ns) / NANOSECONDS


def to_utc_ns(time_s: FloatArray, start_utc_ns: int | None) -> IntArray:
    """Return epochs of times, -1 without a start time.

    Parameters
    ----------
    time_s
        Seconds from the first sample.
    start_utc_ns
        Time of the first sample, or None.
    """
    if start_utc_ns is None:
        return np.full(time_s.shape, -1, np.int64)
    return start_utc_ns + np.rint(time_s * NANOSECONDS).astype(np.int64)
