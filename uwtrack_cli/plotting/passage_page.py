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

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.series import Series
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting import layout, panels, passage, style
from uwtrack_cli.plotting.layout import HeadLine, PagePart
from uwtrack_cli.plotting.maps import draw_map
from uwtrack_cli.plotting.passage import ReportedPassage
from uwtrack_cli.plotting.picture import FrequencyAxis
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


def passage_figure(scene: Scene, row: int, view: View) -> Figure:
    """Return the page of a passage.

    ``scene``: the recording, with its closest approaches.

    Raises
    ------
    DataError
        The sound is asked for outside of the recording.
    """
    fit = passage.passages_of(scene)[row]
    scene = scene.shown(view, fit.span_s(scene, view))
    parts = [
        *_line_strips(scene, fit),
        *_residuals(scene, fit),
        *panels.fringe_part(scene, [fit]),
        *panels.level_part(scene, fit),
        *panels.bearing_part(scene, fit),
    ]
    has_map = bool(np.isfinite(fit.range_m)) and (view.is_wide or view.height_in is None)
    marked = [part._replace(draw=partial(_draw_marked, part, fit))
              for part in layout.fitting(parts, view)]  # fmt: skip
    heads, left = (_heads(fit, view), layout.timed(marked, view, scene.clock, scene.span_s))
    if view.is_wide and (has_map or view.stands_alone):
        side = partial(_fill_side, scene, fit, has_map=has_map)
        widths = (2.25 if has_map else 3.0, 1.0)
        return layout.page_figure(heads, view, [left, PagePart(3.6, side)], widths)
    below = layout.alone(MAP_IN, partial(draw_map, scene, fit))
    return layout.page_figure(heads, view, [left, below] if has_map else [left])


def _heads(fit: ReportedPassage, view: View) -> list[HeadLine]:
    """Return the lines above the page, the last of them warnings."""
    row = fit.printed
    second = [f"passage {fit.number}", f"sensor {row['sensor']}"]
    if row["course_deg"] is not None:
        second.append(f"course {passage.value_text(row, 'course_deg', 0)}\u00b0")
    if row["side"]:
        second.append(f"sensor to {row['side']}")
    n = len(row["rest_frequencies_hz"])
    second += [f"{n or 'no'} line{'' if n == 1 else 's'}", row["status"]]
    texts = [passage.passage_title(row, view.units), " \u00b7 ".join(second)]
    return [*map(HeadLine, texts), *map(layout.warning, passage.cautions(row))]


def _draw_marked(part: PagePart, fit: ReportedPassage, ax: Axes) -> None:
    """Draw a panel with the arrival of the sound of the closest approach."""
    part.draw(ax)
    low, high = ax.get_xlim()
    if low < (at := fit.value("arrival_time_s")) < high:
        ax.axvline(at, lw=0.7, ls=(0, (1, 3)), color="black", zorder=1)


def _line_strips(scene: Scene, fit: ReportedPassage) -> list[PagePart]:
    """Return the strips of the best lines, the highest one on top."""
    rows = _best_lines(fit, scene.view)
    if not rows.size or not fit.has_doppler:
        return panels.lofargram_parts(scene)
    names = [""] * rows.size
    names[(rows.size - 1) // 2] = "Doppler\nshift (Hz)"
    return [PagePart(STRIP_IN, partial(_draw_strip, scene, fit, row, name))
            for row, name in zip(rows.tolist(), names, strict=True)]  # fmt: skip


def _best_lines(fit: ReportedPassage, view: View) -> IntArray:
    """Return the rows of the rest frequencies that have strips, the highest first."""
    frequency, own = fit.encounters.rest_frequency_hz, fit.rest_rows
    if view.band_hz is not None:
        own = own[style.within(frequency[own], view.band_hz)]
    relative = fit.encounters.rest_frequency_std_hz[own] / frequency[own]
    count = MOST_STRIPS
    if view.height_in is not None:
        count = min(count, max(1, round(STRIPS_SHARE * view.height_in)))
    best = own[np.argsort(relative, kind="stable")][:count]
    return np.asarray(best[np.argsort(-frequency[best], kind="stable")])


def _draw_strip(scene: Scene, fit: ReportedPassage, rest_row: int, name: str, ax: Axes) -> None:
    """Draw a line: its sound, else the overview or what was measured; and its fit."""
    rest = float(fit.encounters.rest_frequency_hz[rest_row])
    sweep = rest * fit.mach / fit.width_s  # Hz/s, at closest approach
    frame_s = float(min(1 / np.sqrt(sweep), LONGEST_FRAME_S, np.ptp(scene.span_s) / 8))
    half, found, overview = SHIFTS * fit.mach * rest, None, scene.overview
    is_resolved = panels.drawn_sound(scene) is not None
    if is_resolved:
        half = min(max(half, FEWEST_CELLS / 2 / frame_s), 0.9 * rest)
    elif overview is not None and overview.frequency_hz.size > 1:
        inside = np.abs(overview.frequency_hz - rest) <= half
        is_resolved = int(inside.sum()) >= FEWEST_CELLS
    if is_resolved:
        axis = FrequencyAxis(rest - half, rest + half, is_log=False, rows=STRIP_ROWS)
        found = panels.picture_of(scene, axis, frame_s)
    if found is None:
        line = int(fit.encounters.rest_line_id[rest_row])
        time_s, frequency_hz, _, snr_db = _measured_line(scene, fit.contact, line)
        style.calm(ax).scatter(
            time_s, frequency_hz - rest, s=5, linewidths=0, vmin=0.0, vmax=25.0,
            c=np.nan_to_num(snr_db, nan=USUAL_SNR_DB), cmap=f"{style.LEVELS_MAP}_r",
        )  # fmt: skip
    else:
        axis = FrequencyAxis(-half, half, is_log=False, rows=STRIP_ROWS)
        found._replace(axis=axis).draw(ax, label="")
    _draw_curve(fit, rest, rest_row, ax, is_picture=found is not None)
    ax.set_ylim(-half, half)
    ax.yaxis.set_major_locator(MaxNLocator(nbins=3, symmetric=True))
    ax.yaxis.set_major_formatter(lambda value, _: f"{value:+g}" if value else "0")
    ax.tick_params(labelsize=7)
    ax.text(
        0.008, 0.9, f"{rest:.2f} Hz", transform=ax.transAxes, va="top", fontsize=7,
        bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
    )  # fmt: skip
    ax.set_ylabel(name, fontsize=8)


def _measured_line(scene: Scene, contact: int, line: int) -> FloatArray:
    """Return what was measured of a line: tracked in sound, or given in a table.

    ``scene``: the recording or table. ``contact``: contact of the line. ``line``:
    identifier of the line; of a table, the number of its column. Rows are times, s,
    frequencies and their deviations, Hz, and signal-to-noise ratios, dB; nan is unknown.
    """
    lines, series = scene.first(Lines), scene.first(Series)
    if lines is not None:
        own = lines.line == line
        columns = (lines.time_s, lines.measured_frequency_hz,
                   lines.measured_frequency_std_hz, lines.measured_snr_db)  # fmt: skip
    elif series is not None and 1 <= line <= series.frequency_hz.shape[1]:
        own, frequency = series.contact == contact, series.frequency_hz[:, line - 1]
        columns = (series.time_s, frequency, series.frequency_std_hz[:, line - 1],
                   np.full(frequency.size, np.nan))  # fmt: skip
    else:
        return np.zeros((4, 0))
    own = own & np.isfinite(columns[1])
    return np.array([column[own] for column in columns], float)


def _draw_curve(
    fit: ReportedPassage, rest_hz: float, rest_row: int, ax: Axes, *, is_picture: bool
) -> None:
    """Draw the fit thin, with its band, so that the sound stays visible beneath."""
    time_s = np.linspace(*ax.get_xlim(), 400)
    shift, std = fit.shift(time_s)
    rest_std = np.nan_to_num(fit.encounters.rest_frequency_std_hz[rest_row])
    half = style.BAND_DEVIATIONS * np.hypot(rest_hz * std, rest_std)
    color, edge = style.contact_color(fit.number), style.halo() if is_picture else None
    style.draw_band(ax, time_s, rest_hz * shift, half, color, path_effects=edge)


def _residuals(scene: Scene, fit: ReportedPassage) -> list[PagePart]:
    """Return what the lines leave of their curve."""
    if not fit.rest_rows.size or not fit.has_doppler:
        return []
    time_s, left, weight = _left(scene, fit)
    if time_s.size < 3:
        return []
    misfit = fit.printed["misfit"] or 0.0

    def draw(ax: Axes) -> None:
        style.calm(ax, "residual\n(% of v/c)")
        color = style.contact_color(fit.number)
        thin = slice(None, None, -(-time_s.size // 6000))
        ax.plot(time_s[thin], left[thin], ".", ms=2.6, alpha=0.35, color=color,
                mec="none", rasterized=True)  # fmt: skip
        middle, mean, std = _block_means(time_s, left, weight, BLOCKS * fit.width_s)
        ax.errorbar(middle, mean, style.BAND_DEVIATIONS * std, fmt="o", ms=2.8, lw=0.9,
                    color="black")  # fmt: skip
        grid = np.linspace(*scene.span_s, 300)
        half = 100 * style.BAND_DEVIATIONS * fit.shift(grid)[1] / fit.mach
        style.draw_band(ax, grid, np.zeros(grid.size), half, color)
        reach = 3.0 * float(np.median(np.abs(left))) / 0.6745
        reach = max(reach, 1.3 * float(np.abs(mean).max(initial=0.0)), 2.0)
        ax.set_ylim(-reach, reach)
        if misfit >= passage.MARKED_MISFIT:
            ax.set_facecolor("#fdecea")
            ax.text(
                0.99, 0.92, f"{100 * misfit:.0f} % unexplained", transform=ax.transAxes,
                ha="right", va="top", fontsize=8, fontweight="bold", color=style.WARNING,
            )  # fmt: skip

    return [PagePart(1.15, draw)]


def _left(scene: Scene, fit: ReportedPassage) -> FloatArray:
    """Return times, residuals in % of v/c, and weights of all lines of a passage."""
    found = [np.zeros((3, 0))]
    for k in fit.rest_rows:
        line, rest = (float(getattr(fit.encounters, name)[k])
                      for name in ("rest_line_id", "rest_frequency_hz"))  # fmt: skip
        time_s, frequency, std, _ = _measured_line(scene, fit.contact, int(line))
        left = 100 * (frequency / rest - 1.0 - fit.shift(time_s)[0]) / fit.mach
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = np.nan_to_num((rest / std) ** 2, nan=1.0, posinf=1.0)
        found.append(np.stack([time_s, left, weight]))
    every = np.concatenate(found, axis=1)
    # what lies outside, or the fit says nothing of, is left out
    return every[:, style.within(every[0], scene.span_s) & np.isfinite(every[1])]


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


def _fill_side(scene: Scene, fit: ReportedPassage, side: SubFigure, *, has_map: bool) -> None:
    """Fill the side of the page: the map, and the numbers where the page stands alone."""
    shares = [1.25] * has_map + [1.0] * scene.view.stands_alone
    grid = side.subplots(len(shares), 1, height_ratios=shares, squeeze=False)[:, 0]
    if has_map:
        draw_map(scene, fit, grid[0])
    if not scene.view.stands_alone:
        return
    grid[-1].axis("off")
    shown = [
        (name if number == 0 else "", text)
        for name, value in passage.fact_lines(fit.printed, scene.view.units)
        for number, text in enumerate(wrap(value, FACT_CHARACTERS))
    ]
    for left, texts, color in zip((0.0, 0.36), zip(*shown, strict=True),
                                  (style.MEASURED, "black"), strict=True):  # fmt: skip
        grid[-1].text(
            left, 1.0, "\n".join(map(figure_text, texts)), va="top", fontsize=8,
            color=color, linespacing=1.5, transform=grid[-1].transAxes,
        )  # fmt: skip
