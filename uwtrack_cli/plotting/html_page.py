"""A page in HTML from its template: text, tables, pictures and sound, in one file.

**Method.** The sound of a passage is the part about the closest approach, cut to its
band in the frequency domain, with soft edges, and brought to the lowest sample rate that
holds it. Played faster, its pitch rises by the same factor. Its loudest moment is as loud
as can be.

**Conventions.** What a page says stands in its template: `report.html` of a product,
`deployment.html` of a folder, both from `page.html`. A picture is inlined as data, in a
rendering for wide screens and paper and one for telephones, with a text for who cannot
see it; a page has no script and refers to no address but pages beside it. All text is
escaped where it stands.
"""

import base64
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

import numpy as np
from jinja2 import Environment, PackageLoader
from matplotlib.figure import Figure

from uwtrack_cli import __version__
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.recording_file import flac_bytes
from uwtrack_cli.files.tables.json_rows import Row
from uwtrack_cli.files.text_escaping import plain_text
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.plotting.layout import alternative_text
from uwtrack_cli.plotting.page import png_of
from uwtrack_cli.plotting.passage import ReportedPassage, passage_title
from uwtrack_cli.plotting.style import NARROW_IN, WIDE_IN, contact_color, text_on
from uwtrack_cli.plotting.view import DPI, Scene, Units, View

LONGEST_S = 60.0
"""Longest sound that is given, s."""

REACH, EDGE = 1.5, 0.1
"""Its band reaches from the lowest line over, to the highest times the first; its edges
are soft over such a share."""

USUAL_HZ = (50.0, 4000.0)
"""Band of a passage without a line."""

LEAST_RATE_HZ, PEAK = 8000.0, 0.9
"""Lowest sample rate that is written, which every browser plays, and greatest value."""


def page_html(template: str, **said: Any) -> str:
    """Return a whole page of what its template names; any text is accepted."""
    pages = Environment(
        loader=PackageLoader("uwtrack_cli.plotting", "."), autoescape=True,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
        finalize=lambda value: plain_text(value) if type(value) is str else value,
    )  # fmt: skip
    pages.filters["utc"] = format_utc
    return pages.get_template(template).render(version=__version__, **said)


def picture_of_page(
    draw: Callable[[View], Figure], units: Units = "kn", text: str = ""
) -> dict[str, str]:
    """Return a picture, drawn for each of two widths.

    ``text``: what it shows, unless the picture itself says so.
    """
    found: dict[str, str] = {}
    for name, width_in in (("narrow", NARROW_IN), ("wide", WIDE_IN)):
        figure = draw(View(width_in=width_in, units=units, stands_alone=False))
        found |= {name: png_data(figure), "text": text or alternative_text(figure)}
        for image in [image for ax in figure.axes for image in ax.images]:
            image.remove()  # they are large, and a figure is collected late
    return found


def png_data(figure: Figure, dpi: float = DPI) -> str:
    """Return a picture as the address of itself."""
    return data_address("image/png", png_of(figure, dpi))


def data_address(kind: str, content: bytes) -> str:
    """Return an address that holds its own content."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def anchor_of(row: Row, *, is_alone: bool) -> str:
    """Return the name of the place of a passage on a page.

    ``is_alone``: whether one sensor heard all passages: the others number their own.
    """
    return f"passage-{row['passage']}{'' if is_alone else '-' + quote(row['sensor'])}"


def passage_head(row: Row, number: int, units: Units) -> dict[str, Any]:
    """Return number, colour and title of a passage; HTML joins spaces, so dots part it.

    ``row``: the passage, as `json_rows` gives it.
    """
    color, title = contact_color(number), passage_title(row, units)
    title = title.replace("   ", " \u00b7 ")
    return {"number": number, "color": color, "ink": text_on(color), "title": title}


def sound_of(scene: Scene, fit: ReportedPassage, speed_up: float | None) -> dict[str, Any] | None:
    """Return the sound of a passage as a page has it; None where it is not at hand.

    ``speed_up``: how many times faster it is played; None: it is not asked for.
    """
    recording = scene.sound
    if recording is None or speed_up is None:
        return None
    span_s = fit.span_s(scene, View())
    middle = float(np.clip(fit.marked_s, *span_s))
    begin, end = np.clip([middle - LONGEST_S / 2, middle + LONGEST_S / 2], *span_s)
    low, high = USUAL_HZ
    lines = fit.encounters.rest_frequency_hz[fit.rest_rows]
    if lines.size:
        low, high = float(lines.min()) / REACH, float(lines.max()) * REACH
    high = min(high, 0.5 * recording.sample_rate_hz)
    try:
        samples = recording.segment(float(begin), float(end))[:, 0]
    except DataError:  # the sound has gone since it was found
        return None
    sound, rate_hz = in_band(samples, recording.sample_rate_hz, (low, high))
    content = flac_bytes(sound, round(rate_hz * speed_up))
    faster = f", {speed_up:g} times faster" if speed_up != 1.0 else ""
    text = f"{end - begin:.0f} s of sound, {low:.0f} to {high:.0f} Hz{faster}"
    return {"address": data_address("audio/flac", content), "text": text}


def in_band(
    samples: FloatArray, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[FloatArray, float]:
    """Return sound cut to a band, as loud as can be, and its new sample rate, Hz."""
    sound = np.nan_to_num(np.asarray(samples, float))
    frequency = np.fft.rfftfreq(sound.size, 1.0 / rate_hz)
    low, high = band_hz
    rise = np.clip((frequency - low) / (EDGE * low) + 1.0, 0.0, 1.0)
    fall = np.clip((high - frequency) / (EDGE * high) + 1.0, 0.0, 1.0)
    wanted = max(2.0 * high * (1.0 + EDGE), LEAST_RATE_HZ)
    count = min(sound.size, round(sound.size * wanted / rate_hz))
    spectrum = (np.fft.rfft(sound) * rise * fall)[: count // 2 + 1]
    short = np.fft.irfft(spectrum, count)
    peak = float(np.abs(short).max(initial=0.0))
    return (PEAK / peak * short if peak > 0 else short), rate_hz * count / sound.size
