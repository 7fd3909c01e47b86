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
from uwtrack_cli.files.tables.summaries import numbered, summary_of
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.flow.next_looks import next_looks
from uwtrack_cli.plotting.html_page import Block, page_html, picture_block
from uwtrack_cli.plotting.listen import Ear
from uwtrack_cli.plotting.page import Page, pages_of, scenes_of
from uwtrack_cli.plotting.passage_words import cautions, fact_lines, passage_title
from uwtrack_cli.plotting.style import contact_color, text_on
from uwtrack_cli.plotting.view import Units, View

WIDE_GAP, DOT = "   ", " \u00b7 "
"""What parts the title of a page, and of a card: HTML joins spaces."""

MOST_PICTURES = 60
"""Passages that have a picture; the others have their numbers."""

HEADINGS = {
    "recording": "Overview", "motion": "Target motion", "target": "Track in clutter",
    "decision": "Which one moves",
}  # fmt: skip


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
    def heard(self) -> list[Row]:
        """Every stretch in which something was heard."""
        return [row for found in self.all(Presence) for row in json_rows(found)]


def report_html(product: Product, report: Report) -> str:
    """Return the report of a product as HTML."""
    recordings = [(one.name, one) for one in report.all(Recording)]
    stages = {step.stage for step in product.history}
    looks = next_looks(stages, recordings, report.all(Encounters))
    blocks = [*_summary(report, looks), *_pictures(report), *_tables(report)]
    blocks.append(("history", list(map(_step, product.history))))
    footer = (
        f"uwtrack {product.program_version}, {product.created_utc}, "
        f"SHA-256 {product.digest}"
    )
    title = ", ".join(dict.fromkeys(name for name, _ in recordings))
    return page_html(title or Path(product.name).name, blocks, footer)


def _summary(report: Report, looks: Sequence[str]) -> Iterator[Block]:
    """Yield the result in a sentence, what to mind, and the facts."""
    passages, heard = report.passages, report.heard
    if report.all(Encounters):
        n = len(passages)
        count = f"{n} passage{'' if n == 1 else 's'}" if n else "no closest approach"
        words = []
        if report.all(Presence):
            words = presence_sentences(heard, is_passed=n > 0, next_looks=looks)
        sentences = [count, *words] if n else words or [count, *looks]
        yield "result", "; ".join(sentences)
    yield "warnings", warnings_of(report)
    for recording in report.all(Recording):
        yield "facts", _facts(recording, report)
    if passages:
        yield "heading", "Passages"
        yield table("encounters", passages, report.units)
        yield "list", reasons_once(passages)


def table(name: str, rows: Sequence[Row], units: Units = "m/s") -> Block:
    """Return the summary of a container as a table, its speeds in a unit."""
    summary = summary_of(name, rows, units)
    return "table", {"heads": summary.titles, "rows": summary.rows}


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


def reasons_once(rows: Sequence[Row]) -> list[str]:
    """Return why values are not known: each reason once, with the passages it is of.

    ``rows``: passages, as `numbered` gives them.
    """
    known: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        by_reason: dict[str, list[str]] = {}
        for key, reason in row["reasons"].items():
            if key not in {"vessel", "time_utc"}:
                by_reason.setdefault(reason, []).append(key)
        for reason, keys in by_reason.items():
            owners = known.setdefault((", ".join(sorted(keys)), reason), [])
            owners.append(str(row.get("passage", row["contact"])))
    return [
        f"No {keys}: {reason}."
        if len(owners) == len(rows)
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


def _pictures(report: Report) -> Iterator[Block]:
    """Yield the page of the recording, then the cards."""
    try:
        pages = pages_of(report.containers, report.tracks)
    except DataError as error:
        yield "text", str(error)
        return
    rows = {(row["sensor"], row["contact"]): row for row in report.passages}
    left = MOST_PICTURES
    for page in pages:
        row = rows.get((page.sensor, page.contact))
        if page.kind == "passage" and row is not None:
            yield _card(report, page, row, is_drawn=left > 0)
            left -= 1
        else:
            yield "heading", HEADINGS[page.kind]
            yield _picture(page, report.units)
    if left < 0:
        yield (
            "text",
            (
                f"{-left} passages have no picture here; uwtrack plot --passage draws them."
            ),
        )


def _card(report: Report, page: Page, row: Row, *, is_drawn: bool) -> Block:
    """Return the card of a passage: title, marks, page, sound, numbers."""
    marks = [(row["status"], row["status"] != "ok")]
    marks += [(text, True) for text in cautions(row)]
    kind, picture = _picture(page, report.units) if is_drawn else ("", None)
    sound = None
    if report.ear is not None and is_drawn:
        (scene,) = [s for s in scenes_of(report.containers) if s.sensor == page.sensor]
        sound = report.ear.heard(scene, row["passage"] - 1)
    return "card", {
        **badge_of(row["passage"]), "title": title_of(row, report.units), "marks": marks,
        "picture": picture if kind == "picture" else None, "sound": sound,
        "facts": _merged(fact_lines(row, report.units)),
    }  # fmt: skip


def title_of(row: Row, units: Units) -> str:
    """Return the title of a passage in a line of a page."""
    return passage_title(row, units).replace(WIDE_GAP, DOT)


def badge_of(number: int) -> dict[str, Any]:
    """Return the number of a passage, its colour, and that of text on it."""
    color = contact_color(number)
    return {"number": number, "color": color, "ink": text_on(color)}


def _merged(facts: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Join what continues over several lines of a picture."""
    found: list[tuple[str, str]] = []
    for name, value in facts:
        if name or not found:
            found.append((name, value))
        else:
            found[-1] = (found[-1][0], f"{found[-1][1]} {value}")
    return found


def _picture(page: Page, units: Units) -> Block:
    def draw(width_in: float) -> Any:
        return page.draw(View(width_in=width_in, stands_alone=False, units=units))

    try:
        return picture_block(draw)
    except DataError as error:
        return "text", str(error)


def _tables(report: Report) -> Iterator[Block]:
    """Yield what was heard, positions and motions as tables."""
    heard = report.heard
    if heard:
        numbers = {(r["sensor"], r["contact"]): r["passage"] for r in report.passages}
        for row in heard:
            row["passage"] = numbers.get((row["sensor"], row["encounter"]))
        yield "heading", "What was heard"
        yield table("presence", heard)
        notes = [_stretch(row) for row in heard if row["encounter"] is None]
        if notes:
            yield "words", {"title": "In words", "texts": notes}
    for kind, title in ((Fixes, "Positions"), (Motions, "Motions")):
        rows = [row for found in report.all(kind) for row in json_rows(found)]
        if rows:
            yield "heading", title
            yield table(kind.NAME, rows, report.units)
            if kind is Motions:
                yield "list", reasons_once(rows)


def _stretch(row: Row) -> str:
    text = stretch_words(row)
    why = row["reasons"].get("encounter")
    return f"{text[0].upper()}{text[1:]}" + (f": {why}." if why else ".")


def _step(step: HistoryStep) -> dict[str, str]:
    """Return a step of the history: its name and source, and its options."""
    read = ", ".join(source.name for source in step.sources)
    return {
        "name": step.stage, "source": f" of {read}" if read else "",
        "version": step.versions.get("uwtrack", "unknown"),
        "options": ", ".join(_options("", step.options)) or "no options",
    }  # fmt: skip


def _options(prefix: str, options: Mapping[str, Any]) -> Iterator[str]:
    """Yield the options as `--set` takes them; what was left open is left out."""
    for key, value in options.items():
        if isinstance(value, Mapping):
            yield from _options(f"{prefix}{key}.", value)
        elif value is not None:
            yield f"{prefix}{key} = {value}"
