"""Results for people and for programs: a short table, or JSON."""

from dataclasses import dataclass
from typing import Any

from uwtrack_cli.cli.screen import put, say, show_table
from uwtrack_cli.data.base import Container

Row = dict[str, Any]


@dataclass(frozen=True)
class Head:
    """A column of a summary: title, key of the value, digits, key of its deviation."""

    title: str
    key: str
    digits: int | None = None
    std: str | None = None

    def text(self, row: Row) -> str:
        """Return the cell of a row; a dash stands for what is not known."""
        value = row.get(self.key)
        if value is None:
            return "-"
        if self.digits is None:
            return str(value)
        shown = f"{value:.{self.digits}f}"
        deviation = row.get(self.std) if self.std else None
        return shown if deviation is None else f"{shown} ± {deviation:.{self.digits}f}"


SUMMARIES: dict[str, tuple[Head, ...]] = {
    "encounters": (
        Head("contact", "contact"),
        Head("sensor", "sensor"),
        Head("status", "status"),
        Head("time s", "time_s", 1, "time_std_s"),
        Head("speed m/s", "speed_mps", 2, "speed_std_mps"),
        Head("range m", "slant_range_m", 1, "slant_range_std_m"),
        Head("range/speed s", "range_over_speed_s", 2, "range_over_speed_std_s"),
        Head("course deg", "course_deg", 1, "course_std_deg"),
        Head("bearing deg", "bearing_deg", 1, "bearing_std_deg"),
        Head("side", "side"),
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
        Head("speed m/s", "speed_mps", 2),
        Head("course deg", "course_deg", 1),
    ),
    "motions": (
        Head("contact", "contact"),
        Head("mode", "mode"),
        Head("weight", "weight", 3),
        Head("range m", "range_m", 0, "range_std_m"),
        Head("bearing deg", "bearing_deg", 2, "bearing_std_deg"),
        Head("speed m/s", "speed_mps", 2, "speed_std_mps"),
        Head("course deg", "course_deg", 1, "course_std_deg"),
        Head("observable", "observable"),
    ),
}
"""Columns of the summary by the name of the container."""

NOTHING = {
    "encounters": "no vessel was found",
    "fixes": "no position follows",
    "motions": "no motion follows",
}


SPOKEN = {"motions": ("report", "statement")}
"""Texts of a container that a reader of its summary must know."""


def is_shown(container: Container) -> bool:
    """Tell whether a container has a summary."""
    return container.NAME in SUMMARIES


def print_result(container: Container, *, as_json: bool) -> None:
    """Print a result as JSON on standard output, or as a summary for people."""
    from uwtrack_cli.files.json_rows import json_rows
    from uwtrack_cli.files.tables import write_table

    if as_json:
        put(write_table(container, "json"))
        return
    rows = json_rows(container)
    if not rows:
        say(NOTHING[container.NAME])
        return
    heads = SUMMARIES[container.NAME]
    shown = [[head.text(row) for head in heads] for row in rows]
    show_table([head.title for head in heads], shown)
    for name in SPOKEN.get(container.NAME, ()):
        texts = getattr(container, name)
        for text in [texts] if isinstance(texts, str) else texts.tolist():
            say(text)
    keys = {head.key for head in heads}
    for row in rows:
        for key, reason in (row.get("reasons") or {}).items():
            if key in keys:
                say(f"contact {row['contact']}: no {key}: {reason}")
