"""The page of one passage: its lines as they were heard, the fit, what is left of it.

**Method.** Strips of the sound about each line with the fit (`passage_strips`), what the
fit leaves of the measurements, level, bearing, map and numbers. A panel is drawn if it
has something to say.

**Conventions.** Bands are two standard deviations on either side. Residuals are shares
of the Doppler shift v/c, so that a fit which leaves its lines is seen at once.
"""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.maps import draw_map, has_circle
from uwtrack_cli.plotting.page_layout import (
    Block,
    HeadLine,
    PagePart,
    fitting,
    page_figure,
    timed,
)
from uwtrack_cli.plotting.panels import bearing_part, fringe_part, level_part
from uwtrack_cli.plotting.passage_fit import ReportedPassage, shown_span
from uwtrack_cli.plotting.passage_strips import line_strips, measured_line
from uwtrack_cli.plotting.passage_words import MARKED_MISFIT, fact_lines, title_lines
from uwtrack_cli.plotting.style import (
    BAND_DEVIATIONS,
    MEASURED,
    WARNING,
    Span,
    calm,
    contact_color,
    draw_band,
    within,
)
from uwtrack_cli.plotting.view import Scene, View

BLOCKS = 0.25
"""Length over which residuals are averaged, in d/v."""

MAP_IN = 3.2
"""Height of the map on a narrow page, inches."""


def passage_figure(scene: Scene, row: int, view: View) -> Figure:
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
    fit = ReportedPassage(encounters, row)
    span_s = shown_span(scene, fit, view)
    parts = [
        *line_strips(scene, fit, view, span_s),
        *_residuals(scene, fit, span_s),
        *fringe_part(scene, span_s, [fit]),
        *level_part(scene, span_s, fit),
        *bearing_part(scene, span_s, fit),
    ]
    is_mapped = has_circle(encounters, row) and (view.is_wide or view.height_in is None)
    parts = [_with_arrival(part, fit) for part in fitting(parts, view)]
    heads = [
        HeadLine(*line) for line in title_lines(fit.printed, fit.number, view.units)
    ]
    left = timed(parts, view, scene.clock, span_s)
    if view.is_wide and (is_mapped or view.stands_alone):
        right = Block(3.6, partial(_fill_side, scene, fit, view, is_mapped=is_mapped))
        return page_figure(heads, view, [left, right], (2.25, 1.0))
    below = Block(MAP_IN, lambda side: draw_map(scene, fit, side.subplots()))
    return page_figure(heads, view, [left, below] if is_mapped else [left])


def _with_arrival(part: PagePart, fit: ReportedPassage) -> PagePart:
    """Return a panel with the arrival of the sound of the closest approach."""

    def draw(ax: Axes) -> None:
        part.draw(ax)
        low, high = ax.get_xlim()
        if low < fit.arrival_s < high:
            ax.axvline(fit.arrival_s, lw=0.7, ls=(0, (1, 3)), color="black", zorder=1)

    return part._replace(draw=draw)


def _residuals(scene: Scene, fit: ReportedPassage, span_s: Span) -> list[PagePart]:
    """Return what the lines leave of their curve."""
    if not fit.rest_rows.size or not fit.is_drawn or fit.mach <= 0:
        return []
    time_s, left, weight = _left(scene, fit, span_s)
    if time_s.size < 3:
        return []
    misfit = fit.printed["misfit"] or 0.0

    def draw(ax: Axes) -> None:
        calm(ax, "residual\n(% of v/c)")
        color = contact_color(fit.number)
        thin = slice(None, None, -(-time_s.size // 6000))
        ax.plot(time_s[thin], left[thin], ".", ms=2.6, alpha=0.35, color=color,
                mec="none", rasterized=True)  # fmt: skip
        middle, mean, std = _block_means(time_s, left, weight, BLOCKS * fit.width_s)
        ax.errorbar(middle, mean, BAND_DEVIATIONS * std, fmt="o", ms=2.8, lw=0.9,
                    color="black")  # fmt: skip
        grid = np.linspace(*span_s, 300)
        half = 100 * BAND_DEVIATIONS * fit.shift(grid)[1] / fit.mach
        draw_band(ax, grid, np.zeros(grid.size), half, color)
        reach = 3.0 * float(np.median(np.abs(left))) / 0.6745
        reach = max(reach, 1.3 * float(np.abs(mean).max(initial=0.0)), 2.0)
        ax.set_ylim(-reach, reach)
        if misfit >= MARKED_MISFIT:
            ax.set_facecolor("#fdecea")
            ax.text(
                0.99, 0.92, f"{100 * misfit:.0f} % unexplained", transform=ax.transAxes,
                ha="right", va="top", fontsize=8, fontweight="bold", color=WARNING,
            )  # fmt: skip

    return [PagePart(1.15, draw)]


def _left(
    scene: Scene, fit: ReportedPassage, span_s: Span
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, residuals in % of v/c, and weights of all lines of a passage."""
    found = []
    for k in fit.rest_rows:
        line = measured_line(scene, fit.contact, int(fit.encounters.rest_line_id[k]))
        rest = float(fit.encounters.rest_frequency_hz[k])
        shift = line.frequency_hz / rest - 1.0
        left = 100 * (shift - fit.shift(line.time_s)[0]) / fit.mach
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = np.nan_to_num((rest / line.std_hz) ** 2, nan=1.0, posinf=1.0)
        found.append(np.stack([line.time_s, left, weight]))
    time_s, left, weight = np.concatenate(found, axis=1)
    # what lies outside, or the fit says nothing of, is left out
    known = within(time_s, span_s) & np.isfinite(left)
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


def _fill_side(
    scene: Scene, fit: ReportedPassage, view: View, side: SubFigure, *, is_mapped: bool
) -> None:
    """Fill the side of the page: the map, and the numbers where the page stands alone."""
    shares = [1.25] * is_mapped + [1.0] * view.stands_alone
    panels = side.subplots(len(shares), 1, height_ratios=shares, squeeze=False)[:, 0]
    if is_mapped:
        draw_map(scene, fit, panels[0])
    if not view.stands_alone:
        return
    panels[-1].axis("off")
    names, values = zip(*fact_lines(fit.printed, view.units), strict=True)
    for left, texts, color in ((0.0, names, MEASURED), (0.36, values, "black")):
        panels[-1].text(
            left, 1.0, "\n".join(map(figure_text, texts)), va="top", fontsize=8,
            color=color, linespacing=1.5, transform=panels[-1].transAxes,
        )  # fmt: skip
