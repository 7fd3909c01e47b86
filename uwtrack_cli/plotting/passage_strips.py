"""Strips of a passage's page: the sound about each line, and the fit over it.

**Method.** A strip is a few Doppler shifts high, about the rest frequency of a line.
Where the sound is at hand, it is resolved as finely as the line's own sweep allows
(frames of 1 / sqrt(sweep rate)); else the picture that the product carries is taken
where it resolves the shift, and the measured frequencies where it does not.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import DataError
from uwtrack_cli.plotting.page_layout import PagePart, Panel
from uwtrack_cli.plotting.panels import lofargram_parts
from uwtrack_cli.plotting.passage_fit import PassagePage, ReportedPassage
from uwtrack_cli.plotting.picture import cell_edges, over_floor, overview_levels, shades
from uwtrack_cli.plotting.style import (
    BAND_DEVIATIONS,
    LEVELS_MAP,
    NO_SOUND,
    calm,
    contact_color,
    halo,
)
from uwtrack_cli.plotting.view import Scene
from uwtrack_cli.spectra.zoom_transform import Window, Zoom, zoom

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHIFTS = 3.0
"""Height of a strip on either side of the rest frequency, in Doppler shifts."""


MOST_STRIPS, STRIPS_SHARE = 6, 0.4
"""Lines that have a strip of their own, the best measured ones; and in an inch of a page
whose height is given."""


FEWEST_CELLS = 6.0
"""Cells of the overview in a strip below which it shows nothing of the line."""


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


def line_strips(page: PassagePage, span_s: tuple[float, float]) -> list[PagePart]:
    """Return the strips of the best lines, the highest one on top."""
    fit = page.fit
    rows = _best_lines(page)
    if not rows or not fit.is_drawn or fit.mach <= 0:
        return lofargram_parts(page.scene, page.view, span_s)
    rest = [float(fit.encounters.rest_frequency_hz[k]) for k in rows]
    zooms = _zooms(page, span_s, rest)
    parts = []
    for number, k in enumerate(rows):
        zoomed = zooms[number] if zooms else None
        parts.append(PagePart(0.82, _strip(page, k, zoomed, len(rows))))
    return parts


def _best_lines(page: PassagePage) -> list[int]:
    """Return the rows of the rest frequencies that have strips, the highest first."""
    found = page.fit.encounters
    frequency, own = found.rest_frequency_hz, page.fit.rest_rows
    band = page.view.band_hz
    if band is not None:
        own = own[(frequency[own] >= band[0]) & (frequency[own] <= band[1])]
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = found.rest_frequency_std_hz[own] / found.rest_frequency_hz[own]
    height_in = page.view.height_in
    count = (
        MOST_STRIPS if height_in is None else max(1, round(STRIPS_SHARE * height_in))
    )
    best = own[np.argsort(relative, kind="stable")][: min(count, MOST_STRIPS)]
    order = np.argsort(-found.rest_frequency_hz[best], kind="stable")
    return [int(k) for k in best[order]]


def _half_hz(fit: ReportedPassage, rest_hz: float) -> float:
    return SHIFTS * fit.mach * rest_hz


def _zooms(
    page: PassagePage, span_s: tuple[float, float], rest_hz: Sequence[float]
) -> list[Zoom]:
    """Return fine spectrograms about the lines, if the sound is at hand."""
    recording = page.scene.first(Recording)
    if recording is None or recording.reader is None:
        return []
    fit = page.fit
    windows = []
    for rest in rest_hz:
        sweep = rest * fit.mach / fit.width_s  # Hz/s, at closest approach
        frame_s = min(1 / np.sqrt(sweep), LONGEST_FRAME_S, np.ptp(span_s) / 8)
        half = max(_half_hz(fit, rest), 3.0 / frame_s)
        windows.append(Window(rest, min(half, 0.9 * rest), float(frame_s)))
    margin = 0.5 * max(window.frame_s for window in windows)
    reach_s = (span_s[0] - margin, span_s[1] + margin)

    def make() -> list[Zoom]:
        try:
            return zoom(recording, reach_s, windows)
        except DataError:  # the sound has gone since it was found
            return []

    return page.scene.once(("strips", reach_s, tuple(windows)), make)


def _strip(page: PassagePage, rest_row: int, zoomed: Zoom | None, count: int) -> Panel:
    def draw(ax: "Axes") -> None:
        from matplotlib.ticker import MaxNLocator

        fit = page.fit
        rest = float(fit.encounters.rest_frequency_hz[rest_row])
        half = _half_hz(fit, rest)
        is_picture = True
        if zoomed is not None and zoomed.time_s.size > 1:
            half = max(half, float(zoomed.offset_hz[-1]))
            dark, bright = shades(zoomed.level_db)
            ax.pcolormesh(
                cell_edges(zoomed.time_s, ax.get_xlim()), cell_edges(zoomed.offset_hz),
                zoomed.level_db.T, cmap=LEVELS_MAP, vmin=dark, vmax=bright,
                rasterized=True,
            )  # fmt: skip
            ax.set_facecolor(NO_SOUND)
        else:
            is_picture = _draw_part(page.scene.overview, rest, half, ax)
        if not is_picture:
            line = int(fit.encounters.rest_line_id[rest_row])
            _draw_points(measured_line(page.scene, fit.contact, line), rest, ax)
        _draw_curve(fit, rest, rest_row, ax, is_picture=is_picture)
        ax.set_ylim(-half, half)
        ax.yaxis.set_major_locator(MaxNLocator(nbins=3, symmetric=True))
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:+g}" if value else "0")
        ax.tick_params(labelsize=7)
        ax.text(
            0.008, 0.9, f"{rest:.2f} Hz", transform=ax.transAxes, va="top", fontsize=7,
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
        )  # fmt: skip
        spec = ax.get_subplotspec()
        first = 0 if spec is None else spec.rowspan.start
        if first == (count - 1) // 2:
            ax.set_ylabel("off the rest\nfrequency (Hz)", fontsize=8)

    return draw


def _draw_part(
    overview: Overview | None, rest_hz: float, half_hz: float, ax: "Axes"
) -> bool:
    """Draw the overview about a frequency; False where it resolves nothing."""
    if overview is None or overview.frequency_hz.size < 2:
        return False
    width = float(np.diff(overview.frequency_hz).min())
    if not width > 0 or 2 * half_hz / width < FEWEST_CELLS:
        return False
    near = np.abs(overview.frequency_hz - rest_hz) <= half_hz + width
    if near.sum() < FEWEST_CELLS:
        return False
    relative = over_floor(overview_levels(overview))[:, near]
    dark, bright = shades(relative)
    ax.pcolormesh(
        cell_edges(overview.time_s, ax.get_xlim()),
        cell_edges(overview.frequency_hz[near]) - rest_hz,
        np.ma.masked_invalid(relative.T), cmap=LEVELS_MAP, vmin=dark, vmax=bright,
        rasterized=True,
    )  # fmt: skip
    ax.set_facecolor(NO_SOUND)
    return True


def measured_line(scene: Scene, contact: int, line: int) -> MeasuredLine:
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


def _draw_points(measured: MeasuredLine, rest_hz: float, ax: "Axes") -> None:
    """Draw the measured frequencies, the stronger the darker."""
    calm(ax)
    snr = np.nan_to_num(measured.snr_db, nan=USUAL_SNR_DB)
    ax.scatter(
        measured.time_s, measured.frequency_hz - rest_hz, s=5, c=snr,
        cmap=f"{LEVELS_MAP}_r", vmin=0.0, vmax=25.0, linewidths=0,
    )  # fmt: skip


def _draw_curve(
    fit: ReportedPassage, rest_hz: float, rest_row: int, ax: "Axes", *, is_picture: bool
) -> None:
    """Draw the fit thin, with its band, so that the sound stays visible beneath."""
    time_s = np.linspace(*ax.get_xlim(), 400)
    shift, std = fit.shift(time_s)
    rest_std = np.nan_to_num(fit.encounters.rest_frequency_std_hz[rest_row])
    half = BAND_DEVIATIONS * np.hypot(rest_hz * std, rest_std)
    color = contact_color(fit.number)
    ax.plot(
        time_s, rest_hz * shift, color=color, lw=0.9,
        path_effects=halo() if is_picture else None,
    )  # fmt: skip
    ax.fill_between(
        time_s, rest_hz * shift - half, rest_hz * shift + half, lw=0, alpha=0.3,
        color="white" if is_picture else color,
    )  # fmt: skip
