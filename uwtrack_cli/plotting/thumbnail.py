"""The small picture of a passage in the report of a folder, from its product alone.

**Method.** The part of the overview where its lines are, about the closest approach,
with the fit over it; a passage without a line has the whole band. The product is read
for each, its recording is not; with sound asked for, it is.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.figure import Figure

from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError, UwtrackError
from uwtrack_cli.flow.passages import PassageRow
from uwtrack_cli.plotting.html_page import anchor_of, passage_head, png_data
from uwtrack_cli.plotting.listen import sound_of
from uwtrack_cli.plotting.page import scenes_of
from uwtrack_cli.plotting.panels import picture_of
from uwtrack_cli.plotting.passage_fit import ReportedPassage, shown_span
from uwtrack_cli.plotting.picture import FrequencyAxis, shades
from uwtrack_cli.plotting.style import contact_color, draw_cells, halo
from uwtrack_cli.plotting.view import Scene, Units, View

SIZE_IN, THUMB_DPI = (7.0, 2.3), 90
"""Size of a picture, inches, and its dots in each."""

MOST_THUMBNAILS = 60
"""Passages that have a picture; the others are in the table."""

Glance = Callable[[PassageRow, int], dict[str, Any] | None]
"""Gives what a folder's report has of a passage with its number; None beyond the most."""


def glances(
    folder: Path,
    read: Callable[[Path], list[Container]],
    units: Units,
    speed_up: float | None = None,
) -> Glance:
    """Return what gives small pictures of passages, their titles, links and sound.

    ``folder``: where the report lies; the page of a result beside it is linked to.
    ``read``: gives what a product holds. ``speed_up``: as in `listen`.
    """

    def glance(passage: PassageRow, number: int) -> dict[str, Any] | None:
        if number > MOST_THUMBNAILS:
            return None
        path, link = Path(passage.file), None
        try:
            scenes = scenes_of(read(path))
            scene = next(s for s in scenes if s.sensor in (None, passage.sensor))
            encounters = scene.encounters
            if encounters is None:
                return None
            row = int(np.flatnonzero(encounters.contact == passage.contact)[0])
        except (UwtrackError, StopIteration, IndexError):
            return None  # it has gone since the table was made
        fit = ReportedPassage(encounters, row)
        page = path.with_suffix(".html").resolve()
        if page.is_file() and page.is_relative_to(folder.resolve()):
            n_owners = sum(
                bool(e and e.n_encounters) for e in (s.encounters for s in scenes)
            )
            own = {**fit.printed, "passage": row + 1}
            link = f"{quote(page.relative_to(folder.resolve()).as_posix())}#"
            link += anchor_of(own, is_alone=n_owners < 2)
        figure = thumbnail(scene, fit)
        return {
            **passage_head(fit.printed, number, units), "file": path.name, "link": link,
            "picture": figure and png_data(figure, THUMB_DPI),
            "sound": speed_up and sound_of(scene, row, speed_up),
        }  # fmt: skip

    return glance


def thumbnail(scene: Scene, fit: ReportedPassage) -> Figure | None:
    """Return the small picture of a passage; None where the product carries none."""
    overview, span_s = scene.overview, shown_span(scene, fit, View())
    if overview is None or overview.frequency_hz.size < 2:
        return None
    rest = fit.encounters.rest_frequency_hz[fit.rest_rows]
    low, high = float(overview.frequency_hz[0]), float(overview.frequency_hz[-1])
    if rest.size:
        margin = 0.3 * float(np.ptp(rest)) + 0.1 * float(rest.max())
        low = max(low, float(rest.min()) - margin)
        high = min(high, float(rest.max()) + margin)
    if not low < high:
        return None
    try:
        picture = picture_of(scene, FrequencyAxis(low, high, is_log=False), span_s)
    except DataError:
        return None
    if picture is None:
        return None
    figure = Figure(figsize=SIZE_IN)  # fixed margins: a layout costs more than it
    ax = figure.add_axes((0.09, 0.2, 0.9, 0.75))
    cells = picture.edges_s, picture.axis.edges_hz(), picture.level_db
    draw_cells(ax, *cells, shades(picture.level_db))
    if fit.is_drawn and fit.mach > 0:
        time_s = np.linspace(*span_s, 200)
        ax.plot(time_s, rest * (1.0 + fit.shift(time_s)[0])[:, np.newaxis], lw=0.7,
                color=contact_color(fit.number), path_effects=halo())  # fmt: skip
    ax.axvline(fit.marked_s, color="white", lw=0.8, linestyle=(0, (2, 2)))
    scene.clock.set_axis(ax, span_s, 6)
    ax.set_ylim(picture.axis.low_hz, picture.axis.high_hz)
    ax.set_ylabel("Hz", fontsize=8)
    ax.tick_params(labelsize=8)
    figure.set_label(f"passage {fit.number}")
    return figure
