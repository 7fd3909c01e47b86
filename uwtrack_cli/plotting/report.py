"""A report about one product: a summary, the page of the recording, a card per passage.

**Method.** What a reader must not overlook stands first: how many passages, and what
is doubtful. Every passage has a card with its page; a reason why something is not known
is said once, for all passages that it holds of.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import Product
from uwtrack_cli.files.tables.json_rows import Row, json_rows
from uwtrack_cli.files.tables.presence_words import presence_sentences, segment_words
from uwtrack_cli.files.tables.summaries import numbered, summary_of
from uwtrack_cli.flow.suggestions import suggestions
from uwtrack_cli.plotting import html_page, passage
from uwtrack_cli.plotting.page import Page, pages_of
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

    @cached_property
    def passages(self) -> list[Row]:
        """Every passage, as `json_rows` gives it, with its number."""
        return numbered(self.rows(Encounters))

    def rows(self, kind: type[Container]) -> list[Row]:
        """Return the rows of all containers of a kind, as `json_rows` gives them."""
        return [row for found in self.all(kind) for row in json_rows(found)]

    def table(self, name: str, rows: Sequence[Row]) -> dict[str, Any] | None:
        """Return the summary of rows of a container as a table; None without any."""
        if not rows:
            return None
        summary = summary_of(name, rows, self.units)
        return {"heads": summary.titles, "rows": summary.rows}


def report_html(product: Product, report: Report) -> str:
    """Return the report of a product as HTML."""
    recordings, passages = report.all(Recording), report.passages
    title = ", ".join(dict.fromkeys(one.name for one in recordings))
    motions = report.rows(Motions)
    return html_page.page_html(
        "report.html", title=title or Path(product.name).name, **_detected(report),
        result=_result(product, report), warnings=warnings_of(report),
        recordings=recordings, product=product,
        files={f.sensor: f.name.size for f in report.all(RecordedFiles)},
        passages=report.table("encounters", passages), reasons=passage.reasons_once(passages),
        **_pictures(report), positions=report.table("fixes", report.rows(Fixes)),
        motions=report.table("motions", motions), motion_reasons=passage.reasons_once(motions),
    )  # fmt: skip


def _result(product: Product, report: Report) -> str:
    """Return what was found in a sentence; empty where nothing was sought."""
    encounters, words = report.all(Encounters), []
    if not encounters:
        return ""
    stages = {step.stage for step in product.history}
    recordings = [(one.name, one) for one in report.all(Recording)]
    looks, n = suggestions(stages, recordings, encounters), len(report.passages)
    if report.all(Presence):
        words = presence_sentences(report.rows(Presence), is_passed=n > 0, suggestions=looks)
    if n:
        return "; ".join([f"{n} passage{'' if n == 1 else 's'}", *words])
    return "; ".join(words or ["no closest approach", *looks])


def warnings_of(report: Report) -> list[str]:
    """Return what a reader must not overlook, a sentence each."""
    found = []
    for row in report.passages:
        whose = f"Passage {row['passage']}"
        found += [f"{whose}: {text}." for text in passage.cautions(row)]
        for other in row["ambiguities"]:
            shown = {k: f"{v:.3g}" if type(v) is float else v for k, v in other.items()}
            known = ", ".join(f"{key} {value}" for key, value in shown.items())
            found.append(f"{whose}, ambiguous: {known}.")
    for one in report.all(Recording):
        if one.start_utc_ns is None:
            found.append(
                f"{one.name}: the start is not known, so times count from the first "
                f"sample; run again with --start-utc or --time-pattern."
            )
        if one.sensor.full_scale_upa is None:
            found.append(f"{one.name}: not calibrated: levels are relative to full scale.")
    return found + [m.statement for m in report.all(Motions) if m.statement]


def _pictures(report: Report) -> dict[str, Any]:
    """Return the page of the recording, the cards of passages, and what is not drawn."""
    try:
        pages = pages_of(report.containers, report.tracks)
    except DataError as error:
        return {"pages": [], "not_drawn": str(error)}
    late = [page for page in pages if page.number is not None][MOST_PICTURES:]
    cards = [_card(page, report, is_drawn=page not in late) for page in pages]
    return {"pages": cards, "not_drawn": len(late)}


def _card(page: Page, report: Report, *, is_drawn: bool) -> dict[str, Any]:
    """Return a page as the report has it: that of a passage with title and numbers."""
    card: dict[str, Any] = {"kind": page.kind}
    if page.number is not None:
        scene = Scene(report.containers, page.sensor)
        fit = passage.passages_of(scene)[page.number - 1]
        row, is_alone = fit.printed, len({r["sensor"] for r in report.passages}) == 1
        marks = [] if is_alone else [(f"sensor {row['sensor']}", False)]
        marks += [(row["status"], row["status"] != "ok")]
        marks += [(text, True) for text in passage.cautions(row)]
        card |= html_page.passage_head(row, page.number, report.units)
        card["anchor"] = html_page.anchor_of(row, is_alone=is_alone)
        card |= {"marks": marks, "facts": passage.fact_lines(row, report.units)}
        if not is_drawn:
            return card
        card["sound"] = html_page.sound_of(scene, fit, report.speed_up)
    try:
        card["picture"] = html_page.picture_of_page(page.draw, report.units)
    except DataError as error:
        card["why"] = str(error)
    return card


def _detected(report: Report) -> dict[str, Any]:
    """Return what was detected as a table, and in words what was no passage."""
    rows, notes = report.rows(Presence), []
    numbers = {(r["sensor"], r["contact"]): r["passage"] for r in report.passages}
    for row in rows:
        row["passage"] = numbers.get((row["sensor"], row["encounter"]))
        if row["encounter"] is None:
            text, why = segment_words(row), row["reasons"].get("encounter")
            notes.append(f"{text[0].upper()}{text[1:]}{f': {why}' if why else ''}.")
    return {"detected": report.table("presence", rows), "notes": notes}
