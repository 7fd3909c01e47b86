"""Results in the words and digits of a short table, for screens and reports.

**Conventions.** A column in which nothing is known is left out, and that of the readings
where all are straight, or all move. Times are UTC where the
start of every recording is known, and seconds from the first sample where not.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.presence import STILL
from uwtrack_cli.files.utc import format_utc, parse_utc

Row = dict[str, Any]
NOT_KNOWN = "-"

UNSURE = "unsure"
"""A reading as a passage that is not told, as noise alone gives it too often."""

MOST_LISTED = 3
"""Numbers of a list that a cell has."""


@dataclass(frozen=True)
class Head:
    """A column of a summary: title, key of the value, digits, key of its deviation."""

    title: str
    """Heading of the column."""
    key: str
    """Key of the value in a row."""
    digits: int | None = None
    """Decimals; None for text."""
    std: str | None = None
    """Key of the standard deviation; None without one."""
    usual: str | None = None
    """Text that every row has unless something matters; a column of it is left out."""

    def text(self, row: Row) -> str:
        """Return the cell of a row; a dash stands for what is not known."""
        value = row.get(self.key)
        if value is None:
            return NOT_KNOWN
        if isinstance(value, dict):  # a vessel
            chance = value["probability"]
            return f"{value['name']}" + ("" if chance is None else f" {100 * chance:.0f} %")
        if isinstance(value, list):  # numbers of which there may be any count
            shown = [f"{one:.{self.digits or 0}f}" for one in value[:MOST_LISTED]]
            more = ["..."] if len(value) > MOST_LISTED else []
            return " ".join([*shown, *more]) or NOT_KNOWN
        if self.digits is None:
            return str(value)
        deviation = row.get(self.std) if self.std else None
        if deviation is None:
            return f"{value:.{self.digits}f}"
        digits = max(self.digits, _digits(deviation))
        return f"{value:.{digits}f} ± {deviation:.{digits}f}"


class _Interval(Head):
    """An interval; an end that the data leave open is not written."""

    def text(self, row: Row) -> str:
        """Return the cell of a row."""
        low, high = (row.get(self.key.format(end)) for end in ("low", "high"))
        if low is None and high is None:
            return NOT_KNOWN
        digits = self.digits or 0
        if high is None:
            return f"> {low:.{digits}f}"
        if low is None:
            return f"< {high:.{digits}f}"
        return f"{low:.{digits}f} to {high:.{digits}f}"


class _SegmentModel(Head):
    """Motion model of a segment: of one that is no passage with its probability.

    A passage that noise alone gives too often to be told is not named as one.
    """

    def text(self, row: Row) -> str:
        """Return the cell of a row."""
        value = row.get(self.key)
        if value is None or row.get("encounter") is not None:
            return super().text(row)
        if value not in STILL:
            return UNSURE
        return f"{value} {row['motion_model_probability']:.2f}"


SUMMARIES: dict[str, tuple[Head, ...]] = {
    "encounters": (
        Head("passage", "passage"),
        Head("contact", "contact"),
        Head("sensor", "sensor"),
        Head("vessel", "vessel"),
        Head("status", "status"),
        Head("time s", "time_s", 1, "time_std_s"),
        Head("speed m/s", "speed_mps", 2, "speed_std_mps"),
        Head("range m", "slant_range_m", 1, "slant_range_std_m"),
        Head("range/speed s", "range_over_speed_s", 2, "range_over_speed_std_s"),
        Head("course deg", "course_deg", 1, "course_std_deg"),
        Head("bearing deg", "bearing_deg", 1, "bearing_std_deg"),
        Head("side", "side"),
        Head("motion model", "motion_model", usual="straight"),
    ),
    "fixes": (
        Head("contact", "contact"),
        Head("mode", "mode"),
        Head("weight", "weight", 3),
        Head("time s", "time_s", 1),
        Head("east m", "east_m", 1, "east_std_m"),
        Head("north m", "north_m", 1, "north_std_m"),
        Head("latitude", "latitude", 6),
        Head("longitude", "longitude", 6),
        Head("± east m", "east_std_m", 0),
        Head("± north m", "north_std_m", 0),
        Head("speed m/s", "speed_mps", 2),
        Head("course deg", "course_deg", 1),
        Head("motion model", "motion_model", usual="moving"),
        Head("joined", "sensor_contacts"),
        Head("joined P", "pairing_probability", 2),
    ),
    "presence": (
        Head("sensor", "sensor"),
        Head("kind", "kind"),
        Head("from s", "from_s", 1),
        Head("to s", "to_s", 1),
        Head("spacing Hz", "spacing_hz", 2, "spacing_std_hz"),
        Head("blade Hz", "blade_rate_hz", 2),
        Head("lines", "n_lines", 0, usual="0"),
        Head("rates Hz", "rates_hz", 1),
        Head("level dB", "level_db", 1),
        Head("bearing deg", "bearing_deg", 0, "bearing_std_deg"),
        Head("passage", "encounter"),
        _SegmentModel("motion model", "motion_model", usual="straight"),
    ),
    "motions": (
        Head("contact", "contact"),
        Head("mode", "mode"),
        Head("weight", "weight", 3),
        Head("range m", "range_m", 0, "range_std_m"),
        _Interval("range 95 % m", "range_{}_m", 0),
        Head("bearing deg", "bearing_deg", 2, "bearing_std_deg"),
        Head("speed m/s", "speed_mps", 2, "speed_std_mps"),
        Head("course deg", "course_deg", 1, "course_std_deg"),
        Head("motion model", "motion_model", usual="straight"),
        Head("observable", "observable"),
        Head("joined", "sensor_contacts"),
        Head("joined P", "pairing_probability", 2),
    ),
}
"""Columns of the summary by the name of the container."""


SPARE: dict[str, tuple[str, ...]] = {
    "encounters": (
        "contact",
        "range/speed s",
        "sensor",
        "bearing deg",
        "side",
        "passage",
        "status",
    ),
    "fixes": (
        "east m",
        "north m",
        "weight",
        "mode",
        "joined",
        "joined P",
        "speed m/s",
        "course deg",
    ),
    "motions": ("weight", "mode", "observable", "joined", "joined P", "course deg", "speed m/s"),
    "presence": ("sensor", "level dB", "rates Hz", "blade Hz", "motion model", "bearing deg"),
}
"""Columns that a narrow screen can do without, by the name of the container."""


@dataclass(frozen=True)
class Summary:
    """A table for people."""

    titles: tuple[str, ...]
    """Headings of the columns."""
    rows: tuple[tuple[str, ...], ...]
    """Cells, row by row."""
    spare: tuple[str, ...]
    """Headings of what a narrow screen can do without, the first one first."""


def numbered(rows: Sequence[Row]) -> list[Row]:
    """Return closest approaches with the numbers of their passages, those of a sensor.

    ``rows``: in the order of time, in which passages are numbered from 1.
    """
    counts: Counter[str] = Counter()
    found = []
    for row in rows:
        counts[row["sensor"]] += 1
        found.append({**row, "passage": counts[row["sensor"]]})
    return found


def _in_knots(row: Row) -> Row:
    keys = [key for key in ("speed_mps", "speed_std_mps") if row.get(key) is not None]
    return {**row, **{key: row[key] / KNOT_MPS for key in keys}}


def _number(
    name: str, rows: Sequence[Row], titles: dict[str, str], columns: dict[str, list[str]]
) -> None:
    """Let a number stand once: that of a passage where it is known, else its contact's."""
    if name == "encounters" and columns["contact"] == columns["passage"]:
        columns["contact"] = [NOT_KNOWN] * len(rows)
    elif name == "presence" and any("passage" in row for row in rows):
        columns["passage"] = [Head("", "passage").text(row) for row in rows]
    elif name == "presence":
        titles["passage"] = "contact"


def summary_of(name: str, rows: Sequence[Row], units: str = "m/s") -> Summary:
    """Return the summary of a container.

    ``name``: name of the container, a key of ``SUMMARIES``. ``rows``: its rows; segments
    whose passages have numbers have them as ``passage``. ``units``: of speeds, m/s or kn.
    """
    if name == "encounters":
        rows = numbered(rows)
    if units == "kn":
        rows = [_in_knots(row) for row in rows]
    columns = {head.title: [head.text(r) for r in rows] for head in SUMMARIES[name]}
    titles = {title: title.replace("m/s", units) for title in columns}
    _number(name, rows, titles, columns)
    if rows and all(row.get("time_utc") for row in rows) and "time s" in columns:
        head = next(head for head in SUMMARIES[name] if head.title == "time s")
        titles["time s"], columns["time s"] = _times(rows, head)
    if rows and all(row.get("from_utc") and row.get("to_utc") for row in rows):
        begins, ends = ([utc_text(row[key]) for row in rows] for key in ("from_utc", "to_utc"))
        days = {cell[:10] for cell in begins + ends}
        is_one = len(days) == 1  # a day common to all is in the title
        titles["from s"] = f"UTC {min(days)}" if is_one else "from UTC"
        titles["to s"] = "to UTC"
        columns["from s"] = [cell[11:] if is_one else cell for cell in begins]
        columns["to s"] = [cell[11:] if is_one else cell for cell in ends]
    usual = {head.title: {NOT_KNOWN, head.usual} for head in SUMMARIES[name]}
    known = {
        title: cells
        for title, cells in columns.items()
        if (not cells and usual[title] == {NOT_KNOWN, None}) or not set(cells) <= usual[title]
    }
    needed: tuple[str, ...] = ()
    if name == "fixes" and "latitude" not in known:  # nothing else says where it is
        needed = "east m", "north m"
        known = {t: cells for t, cells in known.items() if not t.startswith("±")}
    spare = [s for s in SPARE[name] if s in known and s not in needed]
    if len(set(known.get("mode", ()))) > 1:  # else one contact has the same row twice
        spare = [s for s in spare if s != "mode"]
    if len(set(known.get("sensor", ()))) > 1:
        spare.remove("sensor")
    return Summary(
        tuple(titles[title] for title in known),
        tuple(zip(*known.values(), strict=True)),
        tuple(spare),
    )


def passage_columns(rows: Sequence[Row], units: str = "m/s") -> dict[str, tuple[str, ...]]:
    """Return passages of many recordings as columns of cells, by heading.

    ``rows``: as `flow.passages.PassageRow` has them. ``units``: of speeds, m/s or kn. A
    column in which nothing is known is left out.
    """
    shown = [_in_knots(row) for row in rows] if units == "kn" else rows
    speed = Head(f"speed {units}", "speed_mps", 1 if units == "kn" else 2, "speed_std_mps")
    columns: dict[str, list[str]] = {"time UTC": [], "vessel": []}
    for row in rows:
        since = NOT_KNOWN if row["time_s"] is None else f"{row['time_s']:.1f} s"
        chance, name = row["vessel_probability"], row["vessel"] or NOT_KNOWN
        more = "" if chance is None else f" {100.0 * chance:.0f} %"
        columns["time UTC"].append(utc_text(row["time_utc"]) if row["time_utc"] else since)
        columns["vessel"].append(name + more)
    for head in (
        Head("sensor", "sensor"),
        Head("status", "status"),
        speed,
        Head("range m", "slant_range_m", 0, "slant_range_std_m"),
        Head("course deg", "course_deg", 0, "course_std_deg"),
        Head("level dB", "received_level_db", 1, "received_level_std_db"),
        Head("recording", "recording"),
        Head("contact", "contact"),
    ):
        columns[head.title] = [head.text(row) for row in shown]
    order = ["time UTC", "sensor", *columns]  # as both lists begin
    return {
        title: tuple(columns[title])
        for title in dict.fromkeys(order)
        if set(columns[title]) != {NOT_KNOWN}
    }


def utc_text(time_utc: str, digits: int = 0) -> str:
    """Return a time for people, rounded to so many decimals of a second.

    Examples
    --------
    >>> utc_text("2024-05-01T23:59:59.96Z", 1)
    '2024-05-02 00:00:00.0'
    """
    step = 10 ** (9 - digits)
    rounded = (parse_utc(time_utc) + step // 2) // step * step
    whole, _, fraction = format_utc(rounded)[:-1].replace("T", " ").partition(".")
    return f"{whole}.{fraction.ljust(digits, '0')[:digits]}" if digits else whole


def _times(rows: Sequence[Row], head: Head) -> tuple[str, list[str]]:
    """Return title and cells of a column of UTC; a day common to all is its title."""
    stds = [row.get(head.std) if head.std else None for row in rows]
    digits = [max(head.digits or 0, _digits(std or 0.0)) for std in stds]
    cells = [utc_text(r["time_utc"], n) for r, n in zip(rows, digits, strict=True)]
    days = {cell[:10] for cell in cells}
    title = f"UTC {min(days)}" if len(days) == 1 else "time UTC"
    shown = [cell[11:] for cell in cells] if len(days) == 1 else cells
    return title, [
        cell if std is None else f"{cell} ± {std:.{n}f}"
        for cell, std, n in zip(shown, stds, digits, strict=True)
    ]


def _digits(deviation: float) -> int:
    """Return the decimals that a deviation needs in order not to be shown as zero."""
    if not deviation > 0.0:
        return 0
    return min(6, int(np.ceil(-np.log10(2.0 * deviation))))
