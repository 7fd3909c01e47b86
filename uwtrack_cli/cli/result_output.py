"""Results for people and for programs: a short table or sentences, or JSON."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from uwtrack_cli.cli.console import put, say, show_table
from uwtrack_cli.data.base import Container, HasReasons
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.files.tables.summaries import SUMMARIES, numbered, summary_of

NOTHING = {
    "encounters": "no closest approach was found",
    "presence": "no vessel was found",
    "fixes": "no position follows; -v says why",
    "motions": "no motion follows",
}


STATED = frozenset({"target", "decision"})
"""Containers whose result is told in sentences, the ``statements`` of the container."""

SPOKEN = {"motions": ("report", "statement"), "fixes": ("statement",)}
"""Texts of a container that a reader of its summary must know."""


def is_shown(container: Container) -> bool:
    """Tell whether a container has a summary."""
    return container.NAME in SUMMARIES or container.NAME in STATED


def print_container(
    container: Container, form: str, axis: str | None, suggestions: Sequence[str] = ()
) -> None:
    """Print a container that was asked for on standard output.

    ``form``: how it is written; a table of results has the columns that fit a screen.
    ``axis``: the axis whose rows are written; None for those of the container itself.
    ``suggestions``: what to try next, which is told where no vessel was found.
    """
    from uwtrack_cli.files.tables.container_tables import write_table

    has_summary = form == "table" and axis is None and container.NAME in SUMMARIES
    has_words = isinstance(container, Presence)  # also where nothing was detected
    if has_summary and (has_words or container.sizes()[container.ROW]):
        print_result(container, as_json=False, is_data=True, suggestions=suggestions)
    else:
        put(write_table(container, form, axis=axis))


def print_result(
    container: Container,
    *,
    as_json: bool,
    is_data: bool = False,
    presence: Presence | None = None,
    suggestions: Sequence[str] = (),
) -> None:
    """Print a result as JSON on standard output, or as a summary for people.

    ``is_data``: whether the summary is what was asked for, and goes to standard output.
    ``presence``: what was detected, which is told beside closest approaches. ``suggestions``:
    what to try next, which is told where no vessel was found.
    """
    from uwtrack_cli.files.tables.container_tables import write_table

    if as_json:
        put(write_table(container, "json"))
        return
    if container.NAME in STATED:
        _print_statements(container, is_data=is_data)
    else:
        _print_summary(container, presence, is_data=is_data, suggestions=suggestions)


def _print_statements(container: Container, *, is_data: bool) -> None:
    """Print the verdict in sentences; what limits it goes to the console."""
    statements: tuple[str, ...] = getattr(container, "statements", ())
    if is_data:
        put(statements)
    else:
        for statement in statements:
            say(statement)
    if isinstance(container, HasReasons):
        for row in range(len(statements)):
            for reason in container.reasons(row).values():
                say(reason)


def _print_summary(
    container: Container, presence: Presence | None, *, is_data: bool, suggestions: Sequence[str]
) -> None:
    """Print the columns of the summary; what is missing goes to the console."""
    from uwtrack_cli.files.tables.json_rows import json_rows

    rows = json_rows(container)
    if container.NAME == "encounters":
        rows = numbered(rows)
    told = container if isinstance(container, Presence) else presence
    detected = [] if told is None else _detected(told, suggestions)
    if not rows:
        why = getattr(container, "statement", "")
        for text in detected or [why or NOTHING[container.NAME], *suggestions]:
            say(text)
        return
    summary = summary_of(container.NAME, rows)
    show_table(summary.titles, summary.rows, is_data=is_data, spare=summary.spare)
    # further modes are listed; what is said of a contact is said of its best one
    spoken = list(_spoken(container, rows))
    rows = [row for row in rows if container.NAME != "motions" or row["mode"] == 1]
    for text in spoken:
        say(text)
    own_words = 0 if is_data or not isinstance(container, Presence) else 1
    for text in _why(container, rows, spoken):
        say(text, own_words)
    for text in detected:
        say(text)


def _spoken(container: Container, rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield the texts of a container that a reader of its summary must know."""
    for name in SPOKEN.get(container.NAME, ()):
        if name not in container.columns():
            yield from filter(None, [getattr(container, name)])
            continue
        best = [n for n, row in enumerate(rows) if row["mode"] == 1]
        for number in best:
            whose = f"contact {rows[number]['contact']}: " if len(best) > 1 else ""
            yield f"{whose}{getattr(container, name)[number]}"


def _why(
    container: Container, rows: Sequence[dict[str, Any]], spoken: Sequence[str]
) -> Iterable[str]:
    """Return why segments are no passages, or why values are missing, if not said yet."""
    from uwtrack_cli.files.tables.presence_words import why_no_passage

    if isinstance(container, Presence):
        return why_no_passage(rows)
    return _reasons(container.NAME, rows, spoken)


def _detected(presence: Presence, suggestions: Sequence[str]) -> list[str]:
    """Say what was detected beside the closest approaches."""
    from uwtrack_cli.files.tables.json_rows import json_rows
    from uwtrack_cli.files.tables.presence_words import presence_sentences

    has_passed = bool((presence.encounter > 0).any())
    return presence_sentences(json_rows(presence), is_passed=has_passed, suggestions=suggestions)


def _reasons(name: str, rows: Sequence[dict[str, Any]], spoken: Sequence[str]) -> Iterator[str]:
    """Yield why values of a summary are missing, every reason that was not spoken, once."""
    shown = {head.key for head in SUMMARIES[name]}
    if all(row.get("vessel") is None for row in rows):
        shown.discard("vessel")
    whom = "passage" if name == "encounters" else "contact"
    keys: dict[str, dict[str, None]] = {}
    contacts: dict[str, dict[int, None]] = {}
    for row in rows:
        for key, reason in (row.get("reasons") or {}).items():
            if key in shown and not any(reason in text for text in spoken):
                keys.setdefault(reason, {})[key] = None
                contacts.setdefault(reason, {})[row.get(whom) or 0] = None
    everyone = {row.get(whom) or 0 for row in rows}
    for reason, missing in keys.items():
        whose = ""
        if set(contacts[reason]) != everyone:
            numbers = ", ".join(map(str, contacts[reason]))
            whose = f"{whom} {numbers}: "
        yield f"{whose}no {', '.join(missing)}: {reason}"


def say_sensitivity(made: Iterable[Container]) -> None:
    """Say for every sensor with lines what could have been found.

    A block without frames, which ends a stream, completes the one before it.
    """
    said: dict[str, dict[str, float]] = {}
    for lines in made:
        if isinstance(lines, Lines):
            row = said.setdefault(lines.frames.sensor, {"threshold": np.nan})
            row["found"] = lines.line_id.size
            row["rate"] = lines.false_lines_per_khz_hour
            row["weakest"] = lines.weakest_line_snr_db
            row["measured"] = lines.measured_false_lines_per_khz_hour
            known = lines.frames.threshold_db[np.isfinite(lines.frames.threshold_db)]
            if known.size:
                row["threshold"] = float(np.median(known))
    for sensor, row in said.items():
        text = (
            f"{sensor}: {row['found']:.0f} lines; noise alone gives {row['rate']:.3g} "
            "per kHz and hour at most; a steady line of "
            f"{row['weakest']:.1f} dB over the noise in its cell is found within a "
            "minute every other time"
        )
        if np.isfinite(row["measured"]):
            text += (
                f"; the recording's own noise gives {row['measured']:.2g} per kHz and "
                "hour, as measured"
            )
        if np.isfinite(row["threshold"]):
            text += f"; the detection threshold is {row['threshold']:.1f} dB"
        say(text, 1)
