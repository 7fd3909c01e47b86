"""The page of one passage: its lines as they were heard, the fit, what is left of it.

**Method.** Strips of the sound about each line with the fit (`passage_strips`), what the
fit leaves of the measurements, level, bearing, map and numbers. A panel is drawn if it
has something to say.

**Conventions.** Bands are two standard deviations on either side. Residuals are shares
of the Doppler shift v/c, so that a fit which leaves its lines is seen at once.
"""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.maps import draw_map, has_circle
from uwtrack_cli.plotting.page_layout import (
    HeadLine,
    PagePart,
    draw_parts,
    fitting,
    side_by_side,
    stacked,
    titled_figure,
)
from uwtrack_cli.plotting.panels import bearing_part, fringe_part, level_part
from uwtrack_cli.plotting.passage_fit import PassagePage, ReportedPassage
from uwtrack_cli.plotting.passage_strips import line_strips, measured_line
from uwtrack_cli.plotting.passage_words import MARKED_MISFIT, fact_lines, title_lines
from uwtrack_cli.plotting.style import (
    BAND_DEVIATIONS,
    MEASURED,
    WARNING,
    calm,
    contact_color,
)
from uwtrack_cli.plotting.view import Scene, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

BLOCKS = 0.25
"""Length over which residuals are averaged, in d/v."""

MAP_IN = 3.2
"""Height of the map on a narrow page, inches."""


def passage_figure(scene: Scene, row: int, view: View) -> "Figure":
    """Return the page of a passage.

    ``scene``: the recording, with its closest approaches.

    Raises
    ------
    DataError
        The sound is asked for outside of the recording.
    """
    encounters = scene.encounters
    if encounters is None:
        msg = "a passage page needs encounters."
        raise ValueError(msg)
    page = PassagePage(scene, ReportedPassage(encounters, row), view)
    span_s = page.span_s()
    parts = [
        *line_strips(page, span_s),
        *_residuals(page, span_s),
        *fringe_part(scene, span_s, [page.fit]),
        *level_part(scene, span_s, page.fit),
        *bearing_part(scene, span_s, page.fit),
    ]
    is_mapped = has_circle(encounters, row) and (view.is_wide or view.height_in is None)
    parts, right = fitting(parts, view), None
    heads = [HeadLine(text, warns)
             for text, warns in title_lines(page.row, page.fit.number, view.units)]  # fmt: skip
    height = sum(part.height for part in parts) + 0.5
    if view.is_wide and (is_mapped or view.stands_alone):
        figure, body = titled_figure(heads, view, max(height, 3.6))
        left, right = side_by_side(body, 2.25, 1.0)
    elif is_mapped:
        figure, body = titled_figure(heads, view, height + MAP_IN)
        left, right = stacked(body, height, MAP_IN)
    else:
        figure, left = titled_figure(heads, view, height)
    for panel in draw_parts(parts, left, scene.clock, span_s, view.ticks):
        low, high = panel.get_xlim()
        if low < page.fit.arrival_s < high:
            panel.axvline(page.fit.arrival_s, linewidth=0.7, linestyle=(0, (1, 3)),
                          color="black", zorder=1)  # fmt: skip
    if right is not None:
        _fill_side(page, right, is_mapped=is_mapped)
    return figure


def _residuals(page: PassagePage, span_s: tuple[float, float]) -> list[PagePart]:
    """Return what the lines leave of their curve."""
    fit = page.fit
    if not fit.rest_rows.size or not fit.is_drawn or fit.mach <= 0:
        return []
    time_s, left, weight = _left(page, span_s)
    if time_s.size < 3:
        return []
    misfit = page.row["misfit"] or 0.0

    def draw(ax: "Axes") -> None:
        calm(ax)
        color = contact_color(fit.number)
        thin = slice(None, None, -(-time_s.size // 6000))
        ax.plot(time_s[thin], left[thin], ".", ms=2.6, alpha=0.35, color=color,
                mec="none", rasterized=True)  # fmt: skip
        middle, mean, std = _block_means(time_s, left, weight, BLOCKS * fit.width_s)
        ax.errorbar(middle, mean, BAND_DEVIATIONS * std, fmt="o", ms=2.8, lw=0.9,
                    color="black")  # fmt: skip
        grid = np.linspace(*span_s, 300)
        band = 100 * BAND_DEVIATIONS * fit.shift(grid)[1] / fit.mach
        ax.fill_between(grid, -band, band, color=color, alpha=0.25, lw=0)
        ax.axhline(0.0, color=color, lw=0.8)
        reach = 3.0 * float(np.median(np.abs(left))) / 0.6745
        reach = max(reach, 1.3 * float(np.abs(mean).max(initial=0.0)), 2.0)
        ax.set_ylim(-reach, reach)
        ax.set_ylabel("residual\n(% of v/c)", fontsize=8)
        if misfit >= MARKED_MISFIT:
            ax.set_facecolor("#fdecea")
            ax.text(
                0.99, 0.92, f"{100 * misfit:.0f} % unexplained", transform=ax.transAxes,
                ha="right", va="top", fontsize=8, fontweight="bold", color=WARNING,
            )  # fmt: skip

    return [PagePart(1.15, draw)]


def _left(
    page: PassagePage, span_s: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, residuals in % of v/c, and weights of all lines of a passage."""
    fit, found = page.fit, []
    for k in fit.rest_rows:
        line = measured_line(
            page.scene, fit.contact, int(fit.encounters.rest_line_id[k])
        )
        rest = float(fit.encounters.rest_frequency_hz[k])
        shift = line.frequency_hz / rest - 1.0
        left = 100 * (shift - fit.shift(line.time_s)[0]) / fit.mach
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = np.nan_to_num((rest / line.std_hz) ** 2, nan=1.0, posinf=1.0)
        found.append(np.stack([line.time_s, left, weight]))
    time_s, left, weight = np.concatenate(found, axis=1)
    # what lies outside, or the fit says nothing of, is left out
    known = (time_s >= span_s[0]) & (time_s <= span_s[1]) & np.isfinite(left)
    return time_s[known], left[known], weight[known]


def _block_means(
    time_s: FloatArray, values: FloatArray, weight: FloatArray, length_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return middles, weighted means and their deviations over blocks of time."""
    number = np.floor((time_s - time_s.min()) / max(length_s, 1e-9)).astype(int)
    _, block = np.unique(number, return_inverse=True)
    total = np.bincount(block, weight)
    mean = np.bincount(block, weight * values) / total
    middle = np.bincount(block, weight * time_s) / total
    scatter = np.bincount(block, (weight * (values - mean[block])) ** 2)
    return middle, mean, np.sqrt(scatter) / total


def _fill_side(page: PassagePage, side: "SubFigure", *, is_mapped: bool) -> None:
    """Fill the side of the page: the map, and the numbers where there is room."""
    if not (page.view.is_wide and page.view.stands_alone):
        draw_map(page.scene, page.fit, side.subplots())
        return
    if is_mapped:
        upper, lower = side.subplots(2, 1, height_ratios=[1.25, 1.0])
        draw_map(page.scene, page.fit, upper)
    else:
        lower = side.subplots()
    lower.axis("off")
    names, values = zip(*fact_lines(page.row, page.view.units), strict=True)
    for left, texts, color in ((0.0, names, MEASURED), (0.36, values, "black")):
        lower.text(
            left, 1.0, "\n".join(map(figure_text, texts)), va="top", fontsize=8,
            color=color, linespacing=1.5, transform=lower.transAxes,
        )  # fmt: skip
