"""A report about one product: a summary, the page of the recording, a card per passage.

**Method.** What a reader must not overlook stands first: how many passages, and what
is doubtful. Every passage has a card with its page; a reason why something is not known
is said once, for all passages that it holds of.
"""

from collections.abc import Iterator, Mapping, Sequence
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
from uwtrack_cli.files.hdf5.product import HistoryStep, Product
from uwtrack_cli.files.tables.json_rows import Row, json_rows
from uwtrack_cli.files.tables.presence_words import presence_sentences, stretch_words
from uwtrack_cli.files.tables.summaries import summary_of
from uwtrack_cli.files.text_escaping import html_text
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.flow.next_looks import next_looks
from uwtrack_cli.plotting.html_page import (
    facts_html,
    folded_html,
    list_html,
    page_html,
    picture_html,
    table_html,
)
from uwtrack_cli.plotting.page import Page, pages_of
from uwtrack_cli.plotting.passage_page import MARKED_MISFIT, fact_lines, passage_title
from uwtrack_cli.plotting.style import NARROW_IN, WIDE_IN, contact_color, text_on
from uwtrack_cli.plotting.view import View

WIDE_GAP, DOT = "   ", " \u00b7 "
"""What parts the title of a page, and of a card: HTML joins spaces."""

MOST_PICTURES = 60
"""Passages that have a picture; the others have their numbers."""


@dataclass(frozen=True)
class Report:
    """What a report is made of."""

    containers: Sequence[Container]
    """Everything that it may show."""
    tracks: Sequence[VesselTrack] = ()
    """Ways of vessels by AIS, where there is one sensor."""

    def all(self, kind: type[Container]) -> list[Any]:
        """Return the containers of a kind."""
        return [c for c in self.containers if isinstance(c, kind)]

    @property
    def passages(self) -> list[Row]:
        """Every passage, as `json_rows` gives it."""
        return [row for found in self.all(Encounters) for row in json_rows(found)]

    @property
    def heard(self) -> list[Row]:
        """Every stretch in which something was heard."""
        return [row for found in self.all(Presence) for row in json_rows(found)]

    @property
    def title(self) -> str:
        """Names of the recordings."""
        names = [recording.name for recording in self.all(Recording)]
        return ", ".join(dict.fromkeys(names))


def report_html(product: Product, report: Report) -> str:
    """Return the report of a product as HTML."""
    recordings = [(one.name, one) for one in report.all(Recording)]
    stages = {step.stage for step in product.history}
    looks = next_looks(stages, recordings, report.all(Encounters))
    body = [*_summary(report, looks), *_pictures(report), *_tables(report)]
    steps = "\n".join(map(_step, product.history))
    body.append(folded_html(f"History: {len(product.history)} steps", steps))
    footer = (
        f"uwtrack {product.program_version}, {product.created_utc}, "
        f"SHA-256 {product.digest}"
    )
    return page_html(report.title or Path(product.name).name, body, footer)


def _summary(report: Report, looks: Sequence[str]) -> Iterator[str]:
    """Yield the result in a sentence, what to mind, and the facts."""
    passages, heard = report.passages, report.heard
    if report.all(Encounters):
        n = len(passages)
        count = f"{n} passage{'' if n == 1 else 's'}" if n else "no closest approach"
        has_presence = bool(report.all(Presence))
        words = (
            presence_sentences(heard, is_passed=n > 0, next_looks=looks)
            if has_presence
            else []
        )
        sentences = [count, *words] if n else words or [count, *looks]
        yield f'<p class="result">{html_text("; ".join(sentences))}</p>'
    yield list_html(warnings_of(report), "warnings")
    for recording in report.all(Recording):
        yield facts_html(_facts(recording, report))
    if passages:
        yield "<h2>Passages</h2>"
        summary = summary_of("encounters", passages)
        yield table_html(summary.titles, summary.rows)
        yield list_html(reasons_once(passages))


def warnings_of(report: Report) -> list[str]:
    """Return what a reader must not overlook, a sentence each."""
    found = []
    for row in report.passages:
        if (row["misfit"] or 0.0) >= MARKED_MISFIT:
            found.append(
                f"Passage {row['contact']}: misfit: its lines leave the fit by "
                f"{100 * row['misfit']:.0f} % of the Doppler shift beyond their noise."
            )
        if row["extrapolated"]:
            found.append(
                f"Passage {row['contact']}: extrapolated: the closest approach was not "
                f"recorded."
            )
        found += [f"Passage {row['contact']}, ambiguous: {text}."
                  for text in _ambiguities(row)]  # fmt: skip
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


def reasons_once(rows: Sequence[Row]) -> list[str]:
    """Return why values are not known: each reason once, with the passages it is of.

    ``rows``: passages, as `json_rows` gives them.
    """
    known: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        by_reason: dict[str, list[str]] = {}
        for key, reason in row["reasons"].items():
            if key not in {"vessel", "time_utc"}:
                by_reason.setdefault(reason, []).append(key)
        for reason, keys in by_reason.items():
            owners = known.setdefault((", ".join(sorted(keys)), reason), [])
            owners.append(str(row["contact"]))
    everyone = [str(row["contact"]) for row in rows]
    return [
        f"No {keys}: {reason}."
        if owners == everyone
        else f"No {keys}: {reason} (passage{'s' if len(owners) > 1 else ''} "
        f"{', '.join(owners)})."
        for (keys, reason), owners in known.items()
    ]


def _facts(recording: Recording, report: Report) -> list[tuple[str, str]]:
    """Return what is known of a recording."""
    sensor, start = recording.sensor, recording.start_utc_ns
    place = "unknown"
    if sensor.latitude is not None and sensor.longitude is not None:
        place = f"{sensor.latitude:.5f}\u00b0, {sensor.longitude:.5f}\u00b0"
    elif sensor.east_m is not None and sensor.north_m is not None:
        place = f"{sensor.east_m:g} m east, {sensor.north_m:g} m north"
    joined = [f for f in report.all(RecordedFiles) if f.sensor == sensor.id]
    files = f", {joined[0].name.size} files" if joined else ""
    return [
        ("Recording", f"{recording.name}{files}"),
        ("Start", "unknown" if start is None else format_utc(start)),
        ("Length", f"{recording.duration_s:.1f} s"),
        ("Sample rate", f"{recording.sample_rate_hz:g} Hz"),
        ("Sensor", f"{sensor.id} ({sensor.kind})"),
        ("Position", place),
        ("Sound speed", f"{sensor.sound_speed_mps:g} m/s"),
        ("Levels", "dB re 1 uPa" if sensor.full_scale_upa else "dB re full scale"),
    ]


def _pictures(report: Report) -> Iterator[str]:
    """Yield the page of the recording, then the cards."""
    try:
        pages = pages_of(report.containers, report.tracks)
    except DataError as error:
        yield f"<p>{html_text(str(error))}</p>"
        return
    rows = {(row["sensor"], row["contact"]): row for row in report.passages}
    left = MOST_PICTURES
    for page in pages:
        row = rows.get((page.sensor, page.contact))
        if page.kind == "passage" and row is not None:
            yield from _card(page, row, is_drawn=left > 0)
            left -= 1
        else:
            yield f"<h2>{HEADINGS[page.kind]}</h2>"
            yield _picture(page)
    if left < 0:
        yield (
            f"<p>{-left} passages have no picture here; uwtrack plot --contact draws "
            f"them.</p>"
        )


HEADINGS = {
    "recording": "Overview", "motion": "Target motion", "target": "Track in clutter",
    "decision": "Which one moves",
}  # fmt: skip


def _card(page: Page, row: Row, *, is_drawn: bool) -> Iterator[str]:
    """Yield the card of a passage: title, marks, numbers, page."""
    color = contact_color(int(page.contact or 0))
    yield f'<section class="card" style="border-color: {color}">'
    yield (
        f'<h2><b style="background: {color}; color: {text_on(color)}">{page.contact}</b> '
        f"{html_text(passage_title(row).replace(WIDE_GAP, DOT))}</h2>"
    )
    marks = [row["status"], *(["extrapolated"] if row["extrapolated"] else [])]
    if (row["misfit"] or 0.0) >= MARKED_MISFIT:
        marks.append(f"misfit {100 * row['misfit']:.0f} %")
    calm = {"ok"}
    yield "<p>" + " ".join(
        f'<span class="{"mark" if mark in calm else "mark warns"}">{html_text(mark)}</span>'
        for mark in dict.fromkeys(marks)
    ) + "</p>"  # fmt: skip
    if is_drawn:
        yield _picture(page)
    yield facts_html(_merged(fact_lines(row)))
    yield "</section>"


def _merged(facts: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Join what continues over several lines of a picture."""
    found: list[tuple[str, str]] = []
    for name, value in facts:
        if name or not found:
            found.append((name, value))
        else:
            found[-1] = (found[-1][0], f"{found[-1][1]} {value}")
    return found


def _picture(page: Page) -> str:
    try:
        wide, narrow = (
            page.draw(View(width_in=width_in, stands_alone=False))
            for width_in in (WIDE_IN, NARROW_IN)
        )
    except DataError as error:
        return f"<p>{html_text(str(error))}</p>"
    what = f"page of the {page.kind}"
    if page.contact is not None:
        what += f" of contact {page.contact}"
    return picture_html(wide, narrow, what)


def _tables(report: Report) -> Iterator[str]:
    """Yield what was heard, positions and motions as tables."""
    heard = report.heard
    if heard:
        yield "<h2>What was heard</h2>"
        summary = summary_of("presence", heard)
        yield table_html(summary.titles, summary.rows)
        notes = [_stretch(row) for row in heard if row["encounter"] is None]
        if notes:
            yield folded_html("In words", list_html(notes))
    for kind, title in ((Fixes, "Positions"), (Motions, "Motions")):
        rows = [row for found in report.all(kind) for row in json_rows(found)]
        if rows:
            yield f"<h2>{title}</h2>"
            summary = summary_of(kind.NAME, rows)
            yield table_html(summary.titles, summary.rows)
            if kind is Motions:
                yield list_html(reasons_once(rows))


def _stretch(row: Row) -> str:
    text = stretch_words(row)
    why = row["reasons"].get("encounter")
    return f"{text[0].upper()}{text[1:]}" + (f": {why}." if why else ".")


def _step(step: HistoryStep) -> str:
    """Return a step of the history: its name and source, and its options."""
    read = ", ".join(source.name for source in step.sources)
    title = f"<b>{html_text(step.stage)}</b>" + (
        f" of {html_text(read)}" if read else ""
    )
    options = ", ".join(_options("", step.options)) or "no options"
    version = step.versions.get("uwtrack", "unknown")
    return (
        f'<p class="step">{title} <small>uwtrack {html_text(version)}</small><br>'
        f"<code>{html_text(options)}</code></p>"
    )


def _options(prefix: str, options: Mapping[str, Any]) -> Iterator[str]:
    """Yield the options as `--set` takes them; what was left open is left out."""
    for key, value in options.items():
        if isinstance(value, Mapping):
            yield from _options(f"{prefix}{key}.", value)
        elif value is not None:
            yield f"{prefix}{key} = {value}"
