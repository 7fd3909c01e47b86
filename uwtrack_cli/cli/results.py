"""Results for people and for programs: a short table, or JSON."""

from uwtrack_cli.cli.screen import put, say, show_table
from uwtrack_cli.data.base import Container
from uwtrack_cli.files.summaries import SUMMARIES

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
