"""A report about one product: a summary, the page of the recording, a card per passage.

**Method.** What a reader must not overlook stands first: how many passages, and what
is doubtful. Every passage has a card with its page; a reason why something is not known
is said once, for all passages that it holds of.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.truth import VesselTrack
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
from uwtrack_cli.plotting.listen import Ear
from uwtrack_cli.plotting.page import Page, pages_of, scenes_of
from uwtrack_cli.plotting.passage_words import cautions, fact_lines, reasons_once
from uwtrack_cli.plotting.view import Units

MOST_PICTURES = 60
"""Passages that have a picture; the others have their numbers."""


@dataclass(frozen=True)
class Report:
    """What a report is made of."""

    containers: Sequence[Container]
    """Everything that it may show."""
    tracks: Sequence[VesselTrack] = ()
    """Ways of vessels by AIS, where there is one sensor."""
    units: Units = "kn"
    """Unit of every speed."""
    ear: Ear | None = None
    """How the passages' sound is given; None: it is not."""

    def all(self, kind: type[Container]) -> list[Any]:
        """Return the containers of a kind."""
        return [c for c in self.containers if isinstance(c, kind)]

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
        found += [f"{whose}, ambiguous: {text}." for text in _ambiguities(row)]
    for recording in report.all(Recording):
        found += _unknown(recording)
    found += [m.statement for m in report.all(Motions) if m.statement]
    return found


def _ambiguities(row: Row) -> list[str]:
    return [
        ", ".join(
            f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}"
            for key, value in other.items()
        )
        for other in row["ambiguities"]
    ]


def _unknown(recording: Recording) -> Iterator[str]:
    """Yield what is not known of a recording, and what follows."""
    if recording.start_utc_ns is None:
        yield (
            f"{recording.name}: the start is not known, so times count from the first "
            f"sample; run again with --start-utc or --time-pattern."
        )
    if recording.sensor.full_scale_upa is None:
        yield f"{recording.name}: not calibrated, so levels are relative to full scale."


def _pictures(report: Report) -> dict[str, Any]:
    """Return the page of the recording, the cards of passages, and what is not drawn."""
    try:
        pages = pages_of(report.containers, report.tracks)
    except DataError as error:
        return {"pages": [], "not_drawn": str(error)}
    rows = {(row["sensor"], row["contact"]): row for row in report.passages}
    shown, cards = [], 0
    for page in pages:
        row = rows.get((page.sensor, page.contact)) if page.kind == "passage" else None
        cards += row is not None
        card: dict[str, Any] = {"kind": page.kind}
        if row is None or cards <= MOST_PICTURES:
            try:
                card["picture"] = picture_of_page(page.draw, report.units)
            except DataError as error:
                card["why"] = str(error)
        shown.append(card if row is None else card | _card(report, page, row, cards))
    return {"pages": shown, "not_drawn": max(0, cards - MOST_PICTURES)}


def _card(report: Report, page: Page, row: Row, count: int) -> dict[str, Any]:
    """Return what the card of a passage has beside its page: title, marks, numbers."""
    is_alone = len({one["sensor"] for one in report.passages}) == 1
    marks = [] if is_alone else [(f"sensor {row['sensor']}", False)]
    marks += [(row["status"], row["status"] != "ok")]
    marks += [(text, True) for text in cautions(row)]
    card = passage_head(row, row["passage"], report.units)
    card["anchor"] = anchor_of(row, is_alone=is_alone)
    card |= {"marks": marks, "facts": fact_lines(row, report.units)}
    if report.ear is not None and count <= MOST_PICTURES:
        (scene,) = [s for s in scenes_of(report.containers) if s.sensor == page.sensor]
        card["sound"] = report.ear.heard(scene, row["passage"] - 1)
    return card


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
