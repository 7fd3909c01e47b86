"""A page about one recording: everything in one HTML file, nothing from elsewhere.

**Conventions.** Pictures are inlined as data; the page has no script and refers to no
address. All text that comes from a file is escaped.
"""

import base64
import tempfile
from collections.abc import Iterator, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.atomic import atomic_target
from uwtrack_cli.files.json_rows import json_rows
from uwtrack_cli.files.product import Product
from uwtrack_cli.files.registry import CONTAINERS
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.plotting.page import draw_page

LARGE = frozenset({"spectrogram", "peaks", "families", "frames", "navigation"})
TABLES: dict[str, tuple[str, ...]] = {
    "encounters": (
        "contact", "sensor", "status", "time_utc", "time_s", "speed_mps",
        "slant_range_m", "range_over_speed_s", "course_deg", "bearing_deg", "side",
        "rest_frequencies_hz", "received_level_db",
    ),
    "fixes": (
        "contact", "mode", "weight", "time_s", "east_m", "north_m", "latitude",
        "longitude", "speed_mps", "course_deg", "sensors",
    ),
    "motions": (
        "contact", "mode", "weight", "range_m", "bearing_deg", "speed_mps",
        "course_deg", "observable",
    ),
}  # fmt: skip
TITLES = {
    "encounters": "Closest approaches",
    "fixes": "Positions",
    "motions": "Motions",
}


def write_report(
    product: Product, target: Path, *, overwrite: bool = False, inputs: Sequence[Path]
) -> None:
    """Write the page of a product.

    Parameters
    ----------
    product
        The product, open for reading.
    target
        HTML file to write.
    overwrite
        Whether an existing file may be replaced.
    inputs
        Files being read: none of them may be the target.

    Raises
    ------
    OutputError
        The target exists, is an input, or cannot be written.
    """
    containers = [
        product.read(CONTAINERS[name], sensor)
        for sensor, names in product.containers().items()
        for name in names
        if name not in LARGE
    ]
    title = Path(product.name).name
    recordings = [c for c in containers if isinstance(c, Recording)]
    if recordings:
        title = ", ".join(recording.name for recording in recordings)
    page = Template(_template()).substitute(
        title=escape(title),
        body="\n".join(_sections(product, containers, recordings)),
        footer=escape(
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
        yield f"<p>{escape(_facts(recording))}</p>"
    for container in containers:
        if container.NAME in TABLES:
            yield f"<h2>{TITLES[container.NAME]}</h2>"
            yield from _result(container)
    try:
        yield f'<h2>Picture</h2>\n<img alt="lofargram, fits and map" src="{_picture(containers)}">'
    except DataError as error:
        yield f"<p>{escape(str(error))}</p>"
    yield "<h2>History</h2>"
    rows = [
        {
            "stage": step.stage,
            "read": ", ".join(source.name for source in step.sources),
            "options": ", ".join(f"{k} = {v}" for k, v in step.options.items()),
            "version": step.versions.get("uwtrack", ""),
        }
        for step in product.history
    ]
    yield _table(("stage", "read", "options", "version"), rows)


def _facts(recording: Recording) -> str:
    sensor = recording.sensor
    start = recording.start_utc_ns
    known = [
        f"{recording.name}: {recording.duration_s:.1f} s",
        f"{recording.sample_rate_hz:g} Hz",
        f"{recording.n_channels} channel{'s' if recording.n_channels > 1 else ''}",
        "start unknown" if start is None else f"from {format_utc(start)}",
        f"{sensor.kind} sensor {sensor.id}",
        f"sound speed {sensor.sound_speed_mps:g} m/s",
        "calibrated" if sensor.full_scale_upa else "not calibrated",
    ]
    if sensor.latitude is not None and sensor.longitude is not None:
        known.append(f"at {sensor.latitude:.5f}, {sensor.longitude:.5f}")
    return ", ".join(known) + "."


def _result(container: Container) -> Iterator[str]:
    rows = json_rows(container)
    if not rows:
        yield "<p>None were found.</p>"
        return
    yield _table(TABLES[container.NAME], [_with_deviations(row) for row in rows])
    for row in rows:
        for key, reason in (row.get("reasons") or {}).items():
            yield f"<p>Contact {row['contact']}: no {escape(key)}: {escape(str(reason))}</p>"


def _with_deviations(row: dict[str, Any]) -> dict[str, Any]:
    """Return the cells of a row as text, each with its deviation."""
    cells = {}
    for key, value in row.items():
        stem, _, unit = key.rpartition("_")
        cells[key] = _cell(value)
        deviation = row.get(f"{stem}_std_{unit}")
        if value is not None and isinstance(deviation, float):
            cells[key] += f" \u00b1 {_cell(deviation)}"
    return cells


def _cell(value: Any) -> str:
    if value is None:
        return "\u2013"
    if isinstance(value, list):
        return ", ".join(_cell(item) for item in value)
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _table(keys: Sequence[str], rows: Sequence[dict[str, Any]]) -> str:
    head = "".join(f"<th>{escape(key)}</th>" for key in keys)
    lines = [
        "<tr>"
        + "".join(f'<td class="text">{escape(str(row.get(k, "")))}</td>' for k in keys)
        + "</tr>"
        for row in rows
    ]
    body = "\n".join(lines)
    return f'<div class="wide"><table>\n<tr>{head}</tr>\n{body}\n</table></div>'


def _picture(containers: Sequence[Container]) -> str:
    """Return the page of pictures as a data address."""
    with tempfile.TemporaryDirectory(prefix="uwtrack-") as folder:
        path = Path(folder) / "page.png"
        draw_page(containers, path)
        data = base64.b64encode(path.read_bytes()).decode()
    return f"data:image/png;base64,{data}"
