"""A report about one product: a summary, the page of the recording, a card per passage.

**Method.** What a reader must not overlook stands first: how many passages, and what
is doubtful. Every passage has a card with its page; a reason why something is not known
is said once, for all passages that it holds of.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import Product
from uwtrack_cli.files.tables.json_rows import Row, json_rows
from uwtrack_cli.files.tables.presence_words import presence_sentences, stretch_words
from uwtrack_cli.files.tables.summaries import numbered, summary_of
from uwtrack_cli.flow.next_looks import next_looks
from uwtrack_cli.plotting.html_page import (
    anchor_of,
    page_html,
    passage_head,
    picture_of_page,
)
from uwtrack_cli.plotting.listen import sound_of
from uwtrack_cli.plotting.page import pages_of
from uwtrack_cli.plotting.passage_words import cautions, fact_lines, reasons_once
from uwtrack_cli.plotting.view import Scene, Units

MOST_PICTURES = 60
"""Passages that have a picture; the others have their numbers."""


@dataclass(frozen=True)
class Report(Scene):
    """What a report is made of."""

    units: Units = "kn"
    """Unit of every speed."""
    speed_up: float | None = None
    """How many times faster the passages' sound is played; None: it is not given."""

    @property
    def passages(self) -> list[Row]:
        """Every passage, as `json_rows` gives it, with its number."""
        return [row for e in self.all(Encounters) for row in numbered(json_rows(e))]

    @property
    def detected(self) -> list[Row]:
        """Every stretch in which something was detected."""
        return [row for found in self.all(Presence) for row in json_rows(found)]


def report_html(product: Product, report: Report) -> str:
    """Return the report of a product as HTML."""
    recordings, passages = report.all(Recording), report.passages
    title = ", ".join(dict.fromkeys(one.name for one in recordings))
    positions, motions = (
        [row for found in report.all(kind) for row in json_rows(found)]
        for kind in (Fixes, Motions)
    )
    return page_html(
        "report.html", title=title or Path(product.name).name, **_detected(report),
        result=_result(product, report), warnings=warnings_of(report),
        recordings=recordings, product=product,
        files={f.sensor: f.name.size for f in report.all(RecordedFiles)},
        passages=_table("encounters", passages, report), reasons=reasons_once(passages),
        **_pictures(report), positions=_table("fixes", positions, report),
        motions=_table("motions", motions, report), motion_reasons=reasons_once(motions),
    )  # fmt: skip


def _result(product: Product, report: Report) -> str:
    """Return what was found in a sentence; empty where nothing was sought."""
    encounters, words = report.all(Encounters), []
    if not encounters:
        return ""
    stages = {step.stage for step in product.history}
    recordings = [(one.name, one) for one in report.all(Recording)]
    looks, n = next_looks(stages, recordings, encounters), len(report.passages)
    if report.all(Presence):
        words = presence_sentences(report.detected, is_passed=n > 0, next_looks=looks)
    if n:
        return "; ".join([f"{n} passage{'' if n == 1 else 's'}", *words])
    return "; ".join(words or ["no closest approach", *looks])


def _table(
    name: str, rows: Sequence[Row], report: Report
) -> dict[str, Sequence[Any]] | None:
    """Return the summary of a container as a table; None where it is empty."""
    if not rows:
        return None
    summary = summary_of(name, rows, report.units)
    return {"heads": summary.titles, "rows": summary.rows}


def warnings_of(report: Report) -> list[str]:
    """Return what a reader must not overlook, a sentence each."""
    found = []
    for row in report.passages:
        whose = f"Passage {row['passage']}"
        found += [f"{whose}: {text}." for text in cautions(row)]
        for other in row["ambiguities"]:
            known = (
                f"{k} {f'{v:.3g}' if type(v) is float else v}" for k, v in other.items()
            )
            found.append(f"{whose}, ambiguous: {', '.join(known)}.")
    for one in report.all(Recording):
        if one.start_utc_ns is None:
            found.append(
                f"{one.name}: the start is not known, so times count from the first "
                f"sample; run again with --start-utc or --time-pattern."
            )
        if one.sensor.full_scale_upa is None:
            found.append(
                f"{one.name}: not calibrated: levels are relative to full scale."
            )
    return found + [m.statement for m in report.all(Motions) if m.statement]


def _pictures(report: Report) -> dict[str, Any]:
    """Return the page of the recording, the cards of passages, and what is not drawn."""
    try:
        pages = pages_of(report.containers, report.tracks)
    except DataError as error:
        return {"pages": [], "not_drawn": str(error)}
    rows = {(row["sensor"], row["contact"]): row for row in report.passages}
    is_alone = len({sensor for sensor, _ in rows}) == 1
    shown, cards = [], 0
    for page in pages:
        row = rows.get((page.sensor, page.contact)) if page.kind == "passage" else None
        cards += row is not None
        card: dict[str, Any] = {"kind": page.kind}
        if row is not None:
            marks = [] if is_alone else [(f"sensor {row['sensor']}", False)]
            marks += [(row["status"], row["status"] != "ok")]
            marks += [(text, True) for text in cautions(row)]
            card |= passage_head(row, row["passage"], report.units)
            card["anchor"] = anchor_of(row, is_alone=is_alone)
            card |= {"marks": marks, "facts": fact_lines(row, report.units)}
        if row is None or cards <= MOST_PICTURES:
            try:
                card["picture"] = picture_of_page(page.draw, report.units)
            except DataError as error:
                card["why"] = str(error)
            if row is not None and report.speed_up is not None:
                own = Scene(report.containers, page.sensor)
                card["sound"] = sound_of(own, row["passage"] - 1, report.speed_up)
        shown.append(card)
    return {"pages": shown, "not_drawn": max(0, cards - MOST_PICTURES)}


def _detected(report: Report) -> dict[str, Any]:
    """Return what was detected as a table, and in words what was no passage."""
    rows, notes = report.detected, []
    numbers = {(r["sensor"], r["contact"]): r["passage"] for r in report.passages}
    for row in rows:
        row["passage"] = numbers.get((row["sensor"], row["encounter"]))
        if row["encounter"] is None:
            text, why = stretch_words(row), row["reasons"].get("encounter")
            notes.append(f"{text[0].upper()}{text[1:]}{f': {why}' if why else ''}.")
    return {"detected": _table("presence", rows, report), "notes": notes}
