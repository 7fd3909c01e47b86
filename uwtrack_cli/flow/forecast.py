"""Two tracks of files to a table of what one hears of the other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.files.tables.navigation import read_navigation
from uwtrack_cli.files.tables.replay import SUFFIXES, read_replay_track
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.motion.forecast import forecast_contact


@dataclass(frozen=True)
class ForecastRow:
    """What is heard at one time."""

    time_s: float
    """Time from own platform's first row, s."""
    time_utc: str | None
    """The same as UTC; None where the tracks have none."""
    bearing_deg: float
    """Compass bearing of the sound."""
    range_m: float
    """Horizontal range to where it was made, m."""
    range_rate_mps: float
    """How fast the sound's way grows, m/s."""
    frequencies_hz: list[float]
    """Frequency of every tone that was asked for, Hz."""


def forecast_tracks(
    paths: tuple[Path, Path],
    names: tuple[str, str] | None,
    *,
    rest_frequencies_hz: Sequence[float],
    every_s: float,
    sound_speed_mps: float,
) -> list[ForecastRow]:
    """Return what the ship of one track hears of the other.

    ``paths``: files of own track and the target's: CSV tables, or REP files. ``names``:
    names of the tracks in REP files; None where each has one alone.
    ``rest_frequencies_hz``, ``every_s``, ``sound_speed_mps``: as for
    `forecast_contact`.

    Raises
    ------
    DataError
        A file is wrong, or the tracks cannot be compared.
    """
    own, target = (
        _track(path, name) for path, name in zip(paths, names or (None, None), strict=True)
    )
    found = forecast_contact(
        own, target, rest_frequencies_hz=rest_frequencies_hz, every_s=every_s,
        sound_speed_mps=sound_speed_mps,
    )  # fmt: skip
    return [
        ForecastRow(
            time_s=round(time_s, 6),
            time_utc=_utc(found.start_utc_ns, time_s),
            bearing_deg=float(found.bearing_deg[row]),
            range_m=float(found.range_m[row]),
            range_rate_mps=float(found.range_rate_mps[row]),
            frequencies_hz=found.frequency_hz[row].tolist(),
        )
        for row, time_s in enumerate(found.time_s.tolist())
    ]


def table_lines(rows: Sequence[ForecastRow]) -> Iterator[str]:
    """Yield the lines of a table of bearings and frequencies, as `tma` reads it.

    ``rows``: what is heard, at least one row.
    """
    count = len(rows[0].frequencies_hz)
    tones = ["frequency_hz", *(f"frequency_hz_{k}" for k in range(2, count + 1))]
    time = "time_s" if rows[0].time_utc is None else "time_utc"
    yield ",".join([time, "bearing_deg", *tones[:count]])
    for row in rows:
        values = [f"{row.bearing_deg:.4f}", *(f"{f:.5f}" for f in row.frequencies_hz)]
        yield ",".join([row.time_utc or f"{row.time_s:.3f}", *values])


def _track(path: Path, name: str | None) -> Navigation:
    if path.suffix.lower() in SUFFIXES:
        return read_replay_track(path, name, "--names OWN TARGET")
    return read_navigation(path)


def _utc(start_utc_ns: int | None, time_s: float) -> str | None:
    if start_utc_ns is None:
        return None
    return format_utc(start_utc_ns + round(time_s * 1e9))
