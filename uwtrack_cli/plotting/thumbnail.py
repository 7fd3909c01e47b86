"""The small picture of a passage in the report of a folder, from its product alone.

**Method.** The part of the overview where its lines are, about the closest approach,
with the fit over it; a passage without a line has the whole band. The product is read
for each, its recording is not; with sound asked for, it is.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError, UwtrackError
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.flow.passages import PassageRow
from uwtrack_cli.plotting.html_page import png_data
from uwtrack_cli.plotting.listen import Ear
from uwtrack_cli.plotting.page import scenes_of
from uwtrack_cli.plotting.panels import picture_of
from uwtrack_cli.plotting.passage_fit import PassagePage, ReportedPassage
from uwtrack_cli.plotting.picture import FrequencyAxis, Picture, shades
from uwtrack_cli.plotting.report import badge_of, title_of
from uwtrack_cli.plotting.style import LEVELS_MAP, NO_SOUND, contact_color, halo
from uwtrack_cli.plotting.view import Scene, Units, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE_IN, THUMB_DPI = (7.0, 2.3), 90
"""Size of a picture, inches, and its dots in each."""

MOST_THUMBNAILS = 60
"""Passages that have a picture; the others are in the table."""

Open = Callable[[Path], list[Container]]
"""Gives what a small picture is drawn of."""


class Gallery:
    """Small pictures of passages, with links to the pages of their results.

    ``folder``: where the report lies; the page of a result beside it is linked to.
    """

    def __init__(
        self, folder: Path, read: Open, units: Units = "kn", ear: Ear | None = None
    ) -> None:
        self.folder, self.read, self.units, self.ear = folder, read, units, ear

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
        page = path.with_suffix(".html")
        link = None
        if page.is_file() and page.resolve().is_relative_to(self.folder.resolve()):
            place = page.resolve().relative_to(self.folder.resolve()).as_posix()
            link = f"{place}#passage-{row + 1}"
        title = title_of(json_rows(encounters)[row], self.units)
        figure = thumbnail(scene, row)
        return {
            **badge_of(number), "title": title, "file": path.name, "link": link,
            "text": f"Passage {number}: {title}",
            "picture": None if figure is None else png_data(figure, THUMB_DPI),
            "sound": None if self.ear is None else self.ear.heard(scene, row),
        }  # fmt: skip


def thumbnail(scene: Scene, row: int) -> "Figure | None":
    """Return the small picture of a passage; None where the product carries none."""
    encounters, overview = scene.encounters, scene.overview
    if encounters is None or overview is None or overview.frequency_hz.size < 2:
        return None
    fit = ReportedPassage(encounters, row)
    span_s = PassagePage(scene, fit, View()).span_s()
    rest = encounters.rest_frequency_hz[fit.rest_rows]
    low, high = float(overview.frequency_hz[0]), float(overview.frequency_hz[-1])
    if rest.size:
        margin = 0.3 * float(np.ptp(rest)) + 0.1 * float(rest.max())
        low = max(low, float(rest.min()) - margin)
        high = min(high, float(rest.max()) + margin)
    if not low < high:
        return None
    axis = FrequencyAxis(low, high, is_log=False)
    try:
        picture = picture_of(scene, axis, span_s)
    except DataError:
        return None
    return (
        None if picture is None else _drawn(picture, fit, rest.tolist(), scene, span_s)
    )


def _drawn(
    picture: Picture, fit: ReportedPassage, rest_hz: list[float], scene: Scene,
    span_s: tuple[float, float],
) -> "Figure":  # fmt: skip
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE_IN)  # fixed margins: a layout costs more than it
    ax = figure.add_axes((0.09, 0.2, 0.9, 0.75))
    dark, bright = shades(picture.level_db)
    ax.pcolormesh(
        picture.edges_s, picture.axis.edges_hz(), np.ma.masked_invalid(picture.level_db.T),
        cmap=LEVELS_MAP, vmin=dark, vmax=bright,
    )  # fmt: skip
    ax.set_facecolor(NO_SOUND)
    if fit.is_drawn and fit.mach > 0:
        time_s = np.linspace(*span_s, 200)
        for rest in rest_hz:
            ax.plot(time_s, rest * (1.0 + fit.shift(time_s)[0]), lw=0.7,
                    color=contact_color(fit.number), path_effects=halo())  # fmt: skip
    if np.isfinite(fit.marked_s):
        ax.axvline(fit.marked_s, color="white", lw=0.8, linestyle=(0, (2, 2)))
    scene.clock.set_axis(ax, span_s, 6)
    ax.set_ylim(picture.axis.low_hz, picture.axis.high_hz)
    ax.set_ylabel("Hz", fontsize=8)
    ax.tick_params(labelsize=8)
    figure.set_label(f"passage {fit.number}")
    return figure
