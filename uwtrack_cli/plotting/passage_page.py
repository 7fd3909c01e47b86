"""The page of one passage: its lines as they were heard, the fit, what is left of it.

**Method.** Strips of the sound about each line with the fit, what the fit leaves of the
measurements, level, bearing, map and numbers. A panel is drawn if it has something to
say. A strip is a few Doppler shifts high, about the rest frequency of a line. Where the
sound is at hand, it is resolved as finely as the line's own sweep allows (frames of
1 / sqrt(sweep rate)); else the picture that the product carries is taken where it
resolves the shift, and the measured frequencies where it does not.

**Conventions.** Bands are two standard deviations on either side. Residuals are shares
of the Doppler shift v/c, so that a fit which leaves its lines is seen at once.
"""

from functools import partial
from textwrap import wrap
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.maps import draw_map, has_circle
from uwtrack_cli.plotting.page_layout import (
    HeadLine,
    PagePart,
    fitting,
    page_figure,
    timed,
)
from uwtrack_cli.plotting.panels import (
    bearing_part,
    fringe_part,
    has_sound,
    level_part,
    lofargram_parts,
    picture_of,
)
from uwtrack_cli.plotting.passage_fit import ReportedPassage, shown_span
from uwtrack_cli.plotting.passage_words import MARKED_MISFIT, fact_lines, title_lines
from uwtrack_cli.plotting.picture import FrequencyAxis, shades
from uwtrack_cli.plotting.style import (
    BAND_DEVIATIONS,
    LEVELS_MAP,
    MEASURED,
    WARNING,
    Span,
    calm,
    contact_color,
    draw_band,
    draw_cells,
    halo,
    within,
)
from uwtrack_cli.plotting.view import Scene, View

BLOCKS = 0.25
"""Length over which residuals are averaged, in d/v."""

FACT_CHARACTERS = 28
"""Characters of a line of the numbers beside the panels."""

MAP_IN = 3.2
"""Height of the map on a narrow page, inches."""

STRIP_IN, STRIP_ROWS = 0.82, 180
"""Height of a strip, inches, and its rows."""

SHIFTS = 3.0
"""Height of a strip on either side of the rest frequency, in Doppler shifts."""

MOST_STRIPS, STRIPS_SHARE = 6, 0.4
"""Lines that have a strip of their own, the best measured ones; and in an inch of a page
whose height is given."""

FEWEST_CELLS = 6
"""Cells in a strip, without padding, below which it shows nothing of the line."""

LONGEST_FRAME_S = 30.0
"""Longest frame of a strip, s."""

USUAL_SNR_DB = 15.0
"""How strong a measurement is drawn whose strength is not known."""


class MeasuredLine(NamedTuple):
    """What was measured of a line."""

    time_s: FloatArray
    """Times, s, shape (n,)."""
    frequency_hz: FloatArray
    """Frequencies, Hz, shape (n,)."""
    std_hz: FloatArray
    """Their deviations, Hz; nan if unknown."""
    snr_db: FloatArray
    """Signal-to-noise ratios, dB; nan if unknown."""


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
        *_line_strips(scene, fit, view, span_s),
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
        right = PagePart(
            3.6, partial(_fill_side, scene, fit, view, is_mapped=is_mapped)
        )
        return page_figure(
            heads, view, [left, right], (2.25 if is_mapped else 3.0, 1.0)
        )
    below = PagePart(MAP_IN, lambda side: draw_map(scene, fit, side.subplots()))
    return page_figure(heads, view, [left, below] if is_mapped else [left])


def _with_arrival(part: PagePart, fit: ReportedPassage) -> PagePart:
    """Return a panel with the arrival of the sound of the closest approach."""

    def draw(ax: Axes) -> None:
        part.draw(ax)
        low, high = ax.get_xlim()
        if low < fit.arrival_s < high:
            ax.axvline(fit.arrival_s, lw=0.7, ls=(0, (1, 3)), color="black", zorder=1)

    return part._replace(draw=draw)


def _line_strips(
    scene: Scene, fit: ReportedPassage, view: View, span_s: Span
) -> list[PagePart]:
    """Return the strips of the best lines, the highest one on top."""
    rows = _best_lines(fit, view)
    if not rows.size or not fit.is_drawn or fit.mach <= 0:
        return lofargram_parts(scene, view, span_s)
    named = (rows.size - 1) // 2
    return [
        PagePart(
            STRIP_IN, partial(_draw_strip, scene, fit, int(row), span_s, k == named)
        )
        for k, row in enumerate(rows)
    ]


def _best_lines(fit: ReportedPassage, view: View) -> IntArray:
    """Return the rows of the rest frequencies that have strips, the highest first."""
    frequency, own = fit.encounters.rest_frequency_hz, fit.rest_rows
    if view.band_hz is not None:
        own = own[within(frequency[own], view.band_hz)]
    relative = fit.encounters.rest_frequency_std_hz[own] / frequency[own]
    count = MOST_STRIPS
    if view.height_in is not None:
        count = min(count, max(1, round(STRIPS_SHARE * view.height_in)))
    best = own[np.argsort(relative, kind="stable")][:count]
    return np.asarray(best[np.argsort(-frequency[best], kind="stable")])


def _draw_strip(
    scene: Scene, fit: ReportedPassage, rest_row: int, span_s: Span, is_named: bool,
    ax: Axes,
) -> None:  # fmt: skip
    """Draw a line: its sound, else the overview or what was measured; and its fit."""
    rest = float(fit.encounters.rest_frequency_hz[rest_row])
    sweep = rest * fit.mach / fit.width_s  # Hz/s, at closest approach
    frame_s = float(min(1 / np.sqrt(sweep), LONGEST_FRAME_S, np.ptp(span_s) / 8))
    half, picture = SHIFTS * fit.mach * rest, None
    if has_sound(scene, span_s):
        half = min(max(half, FEWEST_CELLS / 2 / frame_s), 0.9 * rest)
    if has_sound(scene, span_s) or _resolves(scene.overview, rest, half):
        axis = FrequencyAxis(rest - half, rest + half, is_log=False, rows=STRIP_ROWS)
        picture = picture_of(scene, axis, span_s, frame_s)
    if picture is None:
        line = int(fit.encounters.rest_line_id[rest_row])
        measured = _measured_line(scene, fit.contact, line)
        calm(ax).scatter(
            measured.time_s, measured.frequency_hz - rest, s=5, linewidths=0, vmin=0.0,
            c=np.nan_to_num(measured.snr_db, nan=USUAL_SNR_DB), cmap=f"{LEVELS_MAP}_r",
            vmax=25.0,
        )  # fmt: skip
    else:
        offset_hz = picture.axis.edges_hz() - rest
        level_db = picture.level_db
        draw_cells(ax, picture.edges_s, offset_hz, level_db, shades(level_db))
    _draw_curve(fit, rest, rest_row, ax, is_picture=picture is not None)
    ax.set_ylim(-half, half)
    ax.yaxis.set_major_locator(MaxNLocator(nbins=3, symmetric=True))
    ax.yaxis.set_major_formatter(lambda value, _: f"{value:+g}" if value else "0")
    ax.tick_params(labelsize=7)
    ax.text(
        0.008, 0.9, f"{rest:.2f} Hz", transform=ax.transAxes, va="top", fontsize=7,
        bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
    )  # fmt: skip
    if is_named:
        ax.set_ylabel("off the rest\nfrequency (Hz)", fontsize=8)


def _resolves(overview: Overview | None, rest_hz: float, half_hz: float) -> bool:
    """Tell whether an overview has enough cells about a frequency."""
    if overview is None or overview.frequency_hz.size < 2:
        return False
    inside = np.abs(overview.frequency_hz - rest_hz) <= half_hz
    return int(inside.sum()) >= FEWEST_CELLS


def _measured_line(scene: Scene, contact: int, line: int) -> MeasuredLine:
    """Return what was measured of a line: tracked in sound, or given in a table.

    ``scene``: the recording or table. ``contact``: contact of the line. ``line``:
    identifier of the line; of a table, the number of its column.
    """
    lines, series = scene.first(Lines), scene.first(Series)
    if lines is not None:
        rows = (lines.line == line) & np.isfinite(lines.measured_frequency_hz)
        columns = (lines.time_s, lines.measured_frequency_hz,
                   lines.measured_frequency_std_hz, lines.measured_snr_db)  # fmt: skip
        return MeasuredLine(*(np.asarray(column[rows], float) for column in columns))
    if series is None or not 1 <= line <= series.frequency_hz.shape[1]:
        return MeasuredLine(*np.zeros((4, 0)))
    frequency = series.frequency_hz[:, line - 1]
    rows = (series.contact == contact) & np.isfinite(frequency)
    unknown = np.full(int(rows.sum()), np.nan)
    std = series.frequency_std_hz[rows, line - 1]
    return MeasuredLine(series.time_s[rows], frequency[rows], std, unknown)


def _draw_curve(
    fit: ReportedPassage, rest_hz: float, rest_row: int, ax: Axes, *, is_picture: bool
) -> None:
    """Draw the fit thin, with its band, so that the sound stays visible beneath."""
    time_s = np.linspace(*ax.get_xlim(), 400)
    shift, std = fit.shift(time_s)
    rest_std = np.nan_to_num(fit.encounters.rest_frequency_std_hz[rest_row])
    half = BAND_DEVIATIONS * np.hypot(rest_hz * std, rest_std)
    color, edge = contact_color(fit.number), halo() if is_picture else None
    draw_band(ax, time_s, rest_hz * shift, half, color, path_effects=edge)


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
        line = _measured_line(scene, fit.contact, int(fit.encounters.rest_line_id[k]))
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
    shown = [
        (name if number == 0 else "", text)
        for name, value in fact_lines(fit.printed, view.units)
        for number, text in enumerate(wrap(value, FACT_CHARACTERS))
    ]
    names, values = zip(*shown, strict=True)
    for left, texts, color in ((0.0, names, MEASURED), (0.36, values, "black")):
        panels[-1].text(
            left, 1.0, "\n".join(map(figure_text, texts)), va="top", fontsize=8,
            color=color, linespacing=1.5, transform=panels[-1].transAxes,
        )  # fmt: skip
