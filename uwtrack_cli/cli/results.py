"""Results for people and for programs: a short table, or JSON."""

from collections.abc import Callable, Sequence
from typing import Any

from uwtrack_cli.cli.screen import put, say, show_table
from uwtrack_cli.data.base import Container

Row = dict[str, Any]
Heads = tuple[tuple[str, Callable[[Row], str]], ...]


def _number(key: str, digits: int, std: str | None = None) -> Callable[[Row], str]:
    def text(row: Row) -> str:
        value = row.get(key)
        if value is None:
            return "-"
        shown = f"{value:.{digits}f}"
        deviation = row.get(std) if std else None
        return shown if deviation is None else f"{shown} ± {deviation:.{digits}f}"

    return text


def _text(key: str) -> Callable[[Row], str]:
    return lambda row: "-" if row.get(key) is None else str(row[key])


SUMMARIES: dict[str, Heads] = {
    "encounters": (
        ("contact", _text("contact")),
        ("sensor", _text("sensor")),
        ("status", _text("status")),
        ("time s", _number("time_s", 1, "time_std_s")),
        ("speed m/s", _number("speed_mps", 2, "speed_std_mps")),
        ("range m", _number("slant_range_m", 1, "slant_range_std_m")),
        ("range/speed s", _number("range_over_speed_s", 2, "range_over_speed_std_s")),
        ("course deg", _number("course_deg", 1, "course_std_deg")),
        ("bearing deg", _number("bearing_deg", 1, "bearing_std_deg")),
        ("side", _text("side")),
    ),
    "fixes": (
        ("contact", _text("contact")),
        ("mode", _text("mode")),
        ("weight", _number("weight", 3)),
        ("time s", _number("time_s", 1)),
        ("east m", _number("east_m", 1, "east_std_m")),
        ("north m", _number("north_m", 1, "north_std_m")),
        ("latitude", _number("latitude", 6)),
        ("longitude", _number("longitude", 6)),
        ("speed m/s", _number("speed_mps", 2)),
        ("course deg", _number("course_deg", 1)),
    ),
    "motions": (
        ("contact", _text("contact")),
        ("mode", _text("mode")),
        ("weight", _number("weight", 3)),
        ("range m", _number("range_m", 0, "range_std_m")),
        ("bearing deg", _number("bearing_deg", 2, "bearing_std_deg")),
        ("speed m/s", _number("speed_mps", 2, "speed_std_mps")),
        ("course deg", _number("course_deg", 1, "course_std_deg")),
        ("observable", _text("observable")),
    ),
}
"""Columns of the summary by the name of the container."""

NOTHING = {
    "encounters": "no vessel was found",
    "fixes": "no position follows",
    "motions": "no motion follows",
}


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
    rows: Sequence[Row] = json_rows(container)
    if not rows:
        say(NOTHING[container.NAME])
        return
    heads = SUMMARIES[container.NAME]
    shown = [[text(row) for _, text in heads] for row in rows]
    show_table("", [head for head, _ in heads], shown)
    for row in rows:
        for key, reason in (row.get("reasons") or {}).items():
            say(f"contact {row['contact']}: {key} is not known: {reason}")
