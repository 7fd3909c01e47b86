"""A page about one recording: everything in one HTML file, nothing from elsewhere.

**Conventions.** Pictures are inlined as data; the page has no script and refers to no
address. All text that comes from a file is escaped.
"""

import base64
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.atomic import atomic_target, check_target
from uwtrack_cli.files.hdf5.layout import CONTAINERS, sensor_of
from uwtrack_cli.files.hdf5.product import ContainerKey, HistoryStep, Product
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.files.tables.presence_words import stretch_words
from uwtrack_cli.files.tables.summaries import summary_of
from uwtrack_cli.files.text_escaping import html_text
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.plotting.page import DPI, page_figure

LARGE = frozenset({"spectrogram", "peaks", "families", "frames", "navigation"})
SHOWN = frozenset(CONTAINERS) - LARGE
"""Containers that a report shows."""

TITLES = {
    "presence": "What was heard",
    "encounters": "Closest approaches",
    "fixes": "Positions",
    "motions": "Motions",
}


def write_report(
    product: Product,
    target: Path,
    *,
    keys: Sequence[ContainerKey],
    overwrite: bool = False,
    inputs: Sequence[Path],
    revise: Callable[[Encounters], Encounters] | None = None,
) -> None:
    """Write the page of a product.

    Parameters
    ----------
    product
        The product, open for reading.
    target
        HTML file to write.
    keys
        Containers of one branch of the product; those that are large are left out.
    overwrite
        Whether an existing file may be replaced.
    inputs
        Files being read: none of them may be the target.
    revise
        What is done with the encounters before they are shown, such as giving names.

    Raises
    ------
    OutputError
        The target exists, is an input, or cannot be written.
    """
    order = list(CONTAINERS)
    chosen = [key for key in keys if key.name in SHOWN]
    containers = [
        product.read(CONTAINERS[key.name], key.sensor, key.step)
        for key in sorted(chosen, key=lambda k: (k.sensor or "", order.index(k.name)))
    ]
    if revise is not None:
        containers = [revise(c) if isinstance(c, Encounters) else c for c in containers]
    check_target(target, overwrite=overwrite, inputs=inputs)
    title = Path(product.name).name
    recordings = [c for c in containers if isinstance(c, Recording)]
    if recordings:
        title = ", ".join(recording.name for recording in recordings)
    page = Template(_template()).substitute(
        title=html_text(title),
        body="\n".join(_sections(product, containers, recordings)),
        footer=html_text(
            f"uwtrack {product.program_version}, {product.created_utc}, "
            f"SHA-256 {product.digest}"
        ),
    )
    with atomic_target(target, overwrite=overwrite, inputs=inputs) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _template() -> str:
    source = resources.files("uwtrack_cli.plotting") / "report.html"
    return source.read_text(encoding="utf-8")


def _sections(
    product: Product, containers: Sequence[Container], recordings: Sequence[Recording]
) -> Iterator[str]:
    for recording in recordings:
        yield _facts(recording)
    for container in containers:
        if container.NAME in TITLES:
            yield f"<h2>{TITLES[container.NAME]}</h2>"
            yield from _result(container)
    yield from _pictures(containers)
    yield "<h2>History</h2>"
    yield from map(_step, product.history)


def _facts(recording: Recording) -> str:
    """Return what is known of a recording, as a list of names and values."""
    sensor, start = recording.sensor, recording.start_utc_ns
    place = "unknown"
    if sensor.latitude is not None and sensor.longitude is not None:
        place = f"{sensor.latitude:.5f}\u00b0, {sensor.longitude:.5f}\u00b0"
    elif sensor.east_m is not None and sensor.north_m is not None:
        place = f"{sensor.east_m:g} m east, {sensor.north_m:g} m north"
    facts = {
        "Recording": recording.name,
        "Start": "unknown" if start is None else format_utc(start),
        "Length": f"{recording.duration_s:.1f} s",
        "Sample rate": f"{recording.sample_rate_hz:g} Hz",
        "Sensor": f"{sensor.id} ({sensor.kind})",
        "Position": place,
        "Sound speed": f"{sensor.sound_speed_mps:g} m/s",
        "Levels": "dB re 1 uPa" if sensor.full_scale_upa else "dB re full scale",
    }
    rows = (f"<div><dt>{k}</dt><dd>{html_text(v)}</dd></div>" for k, v in facts.items())
    return f"<dl>{''.join(rows)}</dl>"


def _result(container: Container) -> Iterator[str]:
    rows = json_rows(container)
    if not rows:
        yield "<p>None were found.</p>"
        return
    summary = summary_of(container.NAME, rows)
    yield _table(summary.titles, summary.rows)
    unit = f"dB re {getattr(container, 'reference', 'unknown')}"
    notes = [note for row in rows for note in _notes(row, unit)]
    if notes:
        yield (
            "<ul>" + "".join(f"<li>{html_text(note)}</li>" for note in notes) + "</ul>"
        )


def _notes(row: dict[str, Any], unit: str) -> Iterator[str]:
    """Yield what a table has no room for, one sentence each; the unit is a level's."""
    if "kind" in row:
        why = row["reasons"].get("encounter")
        text = stretch_words(row)
        yield f"{text[0].upper()}{text[1:]}" + (f": {why}." if why else ".")
        return
    who = f"Contact {row['contact']}"
    if row.get("sensor"):
        who += f" at {row['sensor']}"
    known = [row["time_utc"]] if row.get("time_utc") else []
    rest_hz = sorted(row.get("rest_frequencies_hz") or [])
    if rest_hz:
        known.append(f"lines at rest {', '.join(f'{f:.2f}' for f in rest_hz)} Hz")
    if row.get("received_level_db") is not None:
        known.append(f"received level {row['received_level_db']:.1f} {unit}")
    if known:
        yield f"{who}: {'; '.join(known)}."
    for other in row.get("ambiguities") or []:
        words = other.items() if isinstance(other, dict) else [("also", other)]
        yield f"{who}, ambiguous: " + ", ".join(f"{k} {_short(v)}" for k, v in words)
    for key, reason in (row.get("reasons") or {}).items():
        yield f"{who}: no {key}: {reason}."


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [_cells("th", heads), *(_cells("td", row) for row in rows)]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return f'<div class="wide"><table>\n{body}\n</table></div>'


def _cells(tag: str, texts: Sequence[str]) -> str:
    return "".join(f"<{tag}>{html_text(text)}</{tag}>" for text in texts)


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


def _pictures(containers: Sequence[Container]) -> Iterator[str]:
    """Yield a picture for each sensor with an overview, or why there is none."""
    drawn = [c.sensor for c in containers if isinstance(c, Overview)]
    sensors: list[str | None] = [*drawn] if drawn else [None]
    for sensor in sensors:
        yield f"<h2>Picture{'' if len(drawn) < 2 else f' of {html_text(str(sensor))}'}</h2>"
        own = [c for c in containers if sensor is None or _belongs(c, sensor)]
        try:
            yield f'<img alt="lofargram, fits and map" src="{_picture(own)}">'
        except DataError as error:
            yield f"<p>{html_text(str(error))}</p>"


def _belongs(container: Container, sensor: str) -> bool:
    """Tell whether a sensor's picture shows a container; a map shows all sensors."""
    return isinstance(container, Sensor) or sensor_of(container) in (None, sensor)


def _picture(containers: Sequence[Container]) -> str:
    """Return the page of pictures as a data address."""
    picture = io.BytesIO()
    page_figure(containers).savefig(picture, format="png", dpi=DPI)
    return f"data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}"
