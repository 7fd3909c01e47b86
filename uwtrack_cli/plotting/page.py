"""One page per recording: lofargram, what was heard, bearings, level, map."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels, Overview
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.atomic import atomic_target, check_target
from uwtrack_cli.plotting import encounters as fits
from uwtrack_cli.plotting.chart import draw_map
from uwtrack_cli.plotting.lines import draw_line_bearings, draw_lines
from uwtrack_cli.plotting.presence import draw_presence, draw_rates
from uwtrack_cli.plotting.spectra import draw_bearings, draw_levels, draw_overview
from uwtrack_cli.plotting.style import say_nothing_there
from uwtrack_cli.plotting.table_pages import TABLE_PAGES, first

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".pdf", ".svg")
DPI = 110
"""Dots per inch of a page that is stored as dots."""


def draw_page(
    containers: Sequence[Container], output: Path, *, overwrite: bool = False
) -> None:
    """Draw what a product holds, on one page.

    Parameters
    ----------
    containers
        Small containers of one recording, in any order.
    output
        Picture to write: PNG, PDF or SVG.
    overwrite
        Whether an existing file may be replaced.

    Raises
    ------
    OptionError
        The file name asks for another kind of picture.
    DataError
        There is nothing to draw.
    """
    if output.suffix.lower() not in SUFFIXES:
        names = ", ".join(SUFFIXES)
        msg = f"a picture is written as {names}, got {output.name!r}."
        raise OptionError(msg)
    check_target(output, overwrite=overwrite)
    figure = page_figure(containers)
    with (
        atomic_target(output, overwrite=overwrite) as temporary,
        temporary.open("wb") as file,
    ):
        figure.savefig(file, format=output.suffix[1:].lower(), dpi=DPI)


def page_figure(containers: Sequence[Container]) -> "Figure":
    """Return what `draw_page` writes, as a figure.

    Raises
    ------
    DataError
        There is nothing to draw.
    """
    mpl.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    _draw(containers, figure)
    return figure


def _draw(containers: Sequence[Container], figure: "Figure") -> None:
    """Choose the page by the last thing that was made."""
    for kind, draw in TABLE_PAGES.items():
        if any(isinstance(c, kind) for c in containers):
            draw(containers, figure)
            return
    drawable = (Overview, Levels, Lines, Encounters, Fixes, Presence)
    if not any(isinstance(c, drawable) for c in containers):
        held = ", ".join(sorted({c.NAME for c in containers})) or "nothing"
        msg = f"there is nothing to draw; the files hold {held}."
        raise DataError(msg)
    rows: list[list[Any]] = [["doppler", "map"], ["bearing", "map"], ["level", "map"]]
    heights = [1.0, 1.0, 1.0]
    presence = first(containers, Presence)
    if presence is not None and presence.rate_hz.size:
        rows, heights = [["rates", "rates"], *rows], [0.7, *heights]
    if presence is not None and presence.n_stretches:
        rows, heights = [["presence", "presence"], *rows], [0.5, *heights]
    mosaic: list[Any] = [["spectra", "spectra"], *rows]
    panels = figure.subplot_mosaic(mosaic, height_ratios=[1.6, *heights])
    _fill(containers, panels)


def _fill(containers: Sequence[Container], panels: dict[str, "Axes"]) -> None:
    overview, levels = first(containers, Overview), first(containers, Levels)
    lines, encounters = first(containers, Lines), first(containers, Encounters)
    _draw_measurements(overview, levels, lines, panels)
    _draw_heard(first(containers, Presence), panels)
    if encounters is not None and encounters.time_s.size:
        own = encounters if overview is None else encounters.of_sensor(overview.sensor)
        time_s = _time_axis(overview, levels, lines, own)
        fits.draw_fits(own, time_s, panels["spectra"])
        fits.draw_shifts(own, lines, time_s, panels["doppler"])
        fits.draw_bearing_fits(own, time_s, panels["bearing"])
        for name in ("spectra", "doppler", "bearing", "level"):
            if panels[name].has_data():
                fits.mark_times(own, panels[name])
        sensors = [c for c in containers if isinstance(c, Sensor)]
        draw_map(encounters, sensors, first(containers, Fixes), panels["map"])
    span = _span(overview, levels, lines)
    for name, panel in panels.items():
        if not panel.has_data():
            if not panel.texts:
                say_nothing_there(panel, f"no {name}")
        elif name != "map" and span is not None:
            panel.set_xlim(*span)


def _draw_heard(presence: Presence | None, panels: dict[str, "Axes"]) -> None:
    """Draw the strips that the page has for what was heard."""
    if presence is None:
        return
    if "presence" in panels:
        draw_presence(presence, panels["presence"])
    if "rates" in panels:
        draw_rates(presence, panels["rates"])


def _draw_measurements(
    overview: Overview | None,
    levels: Levels | None,
    lines: Lines | None,
    panels: dict[str, "Axes"],
) -> None:
    if overview is not None:
        draw_overview(overview, panels["spectra"])
    if lines is not None:
        draw_lines(lines, panels["spectra"])
        if np.isfinite(lines.bearing_deg).any():
            draw_line_bearings(lines, panels["bearing"])
    if levels is not None:
        draw_levels(levels, panels["level"])
        if np.isfinite(levels.bearing_deg).any():
            draw_bearings(levels, panels["bearing"])


def _span(*known: Any) -> tuple[float, float] | None:
    times = [_times(c) for c in known if c is not None and _times(c).size]
    if not times:
        return None
    return min(float(t.min()) for t in times), max(float(t.max()) for t in times)


def _times(container: Any) -> Any:
    frames = getattr(container, "frames", None)
    return container.time_s if frames is None else frames.time_s


def _time_axis(*known: Any) -> Any:
    encounters = known[-1]
    span = _span(*known[:-1])
    if span is None:
        reach = 5.0 * np.nan_to_num(encounters.range_over_speed_s, nan=10.0)
        low = np.nanmin(encounters.time_s - reach, initial=0.0)
        span = float(low), float(np.nanmax(encounters.time_s + reach, initial=1.0))
    return np.linspace(*span, 800)
