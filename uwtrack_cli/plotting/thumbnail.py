"""The small picture of a passage in the report of a folder, from its product alone.

**Method.** The part of the overview where its lines are, about the closest approach,
with the fit over it; a passage without a line has the whole band. The product is read
for each, its recording is not; with sound asked for, it is.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.figure import Figure

from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError, UwtrackError
from uwtrack_cli.flow.passages import PassageRow
from uwtrack_cli.plotting.html_page import anchor_of, passage_head, png_data
from uwtrack_cli.plotting.listen import Ear
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

Open = Callable[[Path], list[Container]]
"""Gives what a small picture is drawn of."""


@dataclass(frozen=True)
class Gallery:
    """Small pictures of passages, with links to the pages of their results."""

    folder: Path
    """Where the report lies; the page of a result beside it is linked to."""
    read: Open
    """Gives what a product holds."""
    units: Units = "kn"
    """Unit of every speed."""
    ear: Ear | None = None
    """How the passages' sound is given; None: it is not."""

    def __call__(self, passage: PassageRow, number: int) -> dict[str, Any] | None:
        """Return the picture of a passage, its title and link; None beyond the most."""
        if number > MOST_THUMBNAILS:
            return None
        path = Path(passage.file)
        try:
            scenes = scenes_of(self.read(path))
            scene = next(s for s in scenes if s.sensor in (None, passage.sensor))
            encounters = scene.encounters
            if encounters is None:
                return None
            row = int(np.flatnonzero(encounters.contact == passage.contact)[0])
        except (UwtrackError, StopIteration, IndexError):
            return None  # it has gone since the table was made
        fit = ReportedPassage(encounters, row)
        page, folder, link = (
            path.with_suffix(".html").resolve(),
            self.folder.resolve(),
            None,
        )
        if page.is_file() and page.is_relative_to(folder):
            others = [
                s for s in scenes if (e := s.encounters) is not None and e.n_encounters
            ]
            anchor = anchor_of(
                {**fit.printed, "passage": row + 1}, is_alone=len(others) < 2
            )
            link = f"{quote(page.relative_to(folder).as_posix())}#{anchor}"
        figure = thumbnail(scene, fit)
        return {
            **passage_head(fit.printed, number, self.units), "file": path.name,
            "link": link, "picture": figure and png_data(figure, THUMB_DPI),
            "sound": self.ear and self.ear.heard(scene, row),
        }  # fmt: skip


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
