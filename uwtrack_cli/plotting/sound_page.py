"""The spectrogram of a recording itself, with nothing sought in it.

**Method.** Frames follow from the length: about 800 columns, whose frames overlap where
the sound is short and are averaged where it is long. A cell of the picture is the mean
power density of the frames and frequencies that it covers, so that density times
bandwidth stays the mean square of the sound. Sound is read once, block by block.

**Conventions.** Density is absolute, in uPa^2/Hz, where the sensor file calibrates it,
else relative to full scale. Columns with lost samples in all of their frames are grey.

**References.** Welch 1967 for the density.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, convert
from uwtrack_cli.data.recording import PartReader, Recording
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.decimation import usual_decimation
from uwtrack_cli.plotting.lofargram import (
    PICTURE_ROWS,
    FrequencyAxis,
    cell_edges,
    draw_levels,
)
from uwtrack_cli.plotting.page_layout import (
    HeadLine,
    PagePart,
    draw_parts,
    span_title,
    titled_figure,
)
from uwtrack_cli.plotting.style import LEVELS_MAP, Clock
from uwtrack_cli.plotting.view import View
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 800
"""Columns of the picture."""

COLUMNS_PER_WINDOW = 8
"""Columns that a window spans, unless the band asks for another: a hundredth of the
sound."""

LONGEST_WINDOW_S = 60.0
"""Longest window, s."""

LOG_RATIO = 20.0
"""The frequency axis is logarithmic where the band spans more than such a ratio."""

LOWEST_HZ, LOWEST_SHARE = 10.0, 0.01
"""A logarithmic axis to the Nyquist frequency begins here, or at such a share of that
frequency where this is lower."""

LOWEST_CELLS = 10.0
"""A logarithmic axis needs no cells narrower than its lowest frequency over this."""

LEAST_PERIODS = 32
"""Periods of the highest frequency that a window holds at least."""

LEAST_SAMPLES = 16
"""Samples that a window holds at least."""

MARGIN_CELLS = 8
"""Cells that are read on either side of the band, so that its ends are not empty."""

QUIET_SHARE, BRIGHT_SHARE = 0.05, 0.998
"""Shares of the picture below the darkest and below the brightest colour."""

LEAST_RANGE_DB, MOST_RANGE_DB = 20.0, 80.0
"""Levels that the colours cover, unless asked for."""

PAGE_IN = 4.4
"""Height of the spectrogram, inches."""

MOST_DOTS = 5e7
"""Dots of a picture at most, which take four bytes each."""

WindowS = Annotated[float, Unit("s"), AtLeast(1e-6), AtMost(LONGEST_WINDOW_S)] | None
RangeDb = Annotated[float, Unit("dB"), AtLeast(1), AtMost(200)] | None
SizeIn = Annotated[tuple[float, float], Unit("in"), AtLeast(2), AtMost(60)] | None
Dpi = Annotated[float, AtLeast(20), AtMost(1200)] | None


@dataclass(frozen=True, kw_only=True)
class SoundStyle:
    """How the sound is taken apart and coloured."""

    window_s: WindowS = None
    """Length of the analysis window, s; None: as the length of the sound asks for."""
    db_range: RangeDb = None
    """Levels below the brightest colour, dB; None: as the picture asks for."""
    colormap: str = LEVELS_MAP
    """Name of the colours, one of matplotlib's."""


class Columns(NamedTuple):
    """Levels that are drawn."""

    time_s: FloatArray
    """Middle of each column, s from the first sample that was read."""
    density: FloatArray
    """Power density, shape (column, frequency); nan where there is no sound."""


class PicturePlan(NamedTuple):
    """How sound is cut into frames for a picture."""

    axis: FrequencyAxis
    """Frequencies that are drawn."""
    window_s: float
    """Length of the analysis window, s."""
    overlap: float
    """Share of a window that the next one covers again."""
    frames: int
    """Frames that a column averages."""
    decimation: int
    """Factor by which the sample rate is reduced first."""


def checked_style(window_s: float | None, db_range: float | None,
                  colormap: str | None) -> SoundStyle:  # fmt: skip
    """Return a style of options that are within their ranges.

    Raises
    ------
    OptionError
        One is out of range, or there are no colours of that name.
    """
    import matplotlib as mpl

    if colormap is not None and colormap not in mpl.colormaps:
        msg = (
            f"--colormap takes a name of matplotlib such as viridis, magma, cividis or "
            f"gray, got {colormap!r}."
        )
        raise OptionError(msg)
    return SoundStyle(
        window_s=convert("--window-s", WindowS, window_s),
        db_range=convert("--db-range", RangeDb, db_range),
        colormap=colormap or LEVELS_MAP,
    )


def sized(view: View, size: tuple[float, float] | None, dpi: float | None) -> View:
    """Return a view of a page of so many inches, and so many dots in each.

    Raises
    ------
    OptionError
        One is out of range, or both make a picture of too many dots.
    """
    dpi = convert("--dpi", Dpi, dpi)
    size = convert("--size", SizeIn, size)
    view = replace(view, dpi=dpi)
    if size is None:
        return view
    if dpi is not None and size[0] * size[1] * dpi**2 > MOST_DOTS:
        msg = (
            f"--size {size[0]:g} {size[1]:g} with --dpi {dpi:g} makes "
            f"{size[0] * size[1] * dpi**2 / 1e6:.0f} million dots; "
            f"{MOST_DOTS / 1e6:.0f} million are accepted."
        )
        raise OptionError(msg)
    return replace(view, width_in=size[0], height_in=size[1])


def sound_figure(
    recording: Recording,
    style: SoundStyle,
    view: View,
    progress: Callable[[float], None] = lambda _: None,
) -> "Figure":
    """Return the page of a recording's sound.

    ``progress``: called with the seconds that were read.

    Raises
    ------
    OptionError
        The window or the band does not fit the recording.
    DataError
        Nothing was recorded in the span, or the sound is too short.
    """
    clock = _clock(recording)
    span_s = view.span_s((0.0, recording.duration_s), clock)
    span_s = max(0.0, span_s[0]), min(recording.duration_s, span_s[1])
    part = _part(recording, span_s) if view.is_zoomed else recording
    plan = _plan(part, style, view)
    found = _columns(part, plan, progress)
    edges = cell_edges(found.time_s + span_s[0])
    edges[[0, -1]] = span_s  # the first and the last frame reach to the ends
    panel = partial(_draw, found, edges, plan.axis, style, _unit(recording))
    heads = [
        HeadLine(span_title(span_s, clock, [recording.name])),
        HeadLine(_facts(part, plan)),
    ]
    figure, body = titled_figure(heads, view, PAGE_IN)
    draw_parts([PagePart(PAGE_IN, panel)], body, clock, span_s, view.ticks)
    return figure


def _unit(recording: Recording) -> str:
    """Return what the levels are."""
    if recording.sensor.full_scale_upa is None:
        return "dB re full scale\u00b2/Hz, not calibrated"
    return "dB re 1 \u00b5Pa\u00b2/Hz"


def _clock(recording: Recording) -> Clock:
    """Return the clock of the recording, right by its sensor's offset."""
    if recording.start_utc_ns is None:
        return Clock()
    offset_ns = round(recording.sensor.clock_offset_s * NANOSECONDS)
    return Clock(recording.start_utc_ns + offset_ns)


def _part(recording: Recording, span_s: tuple[float, float]) -> Recording:
    assert recording.reader is not None  # noqa: S101 - it was opened for this
    first, last = (round(time * recording.sample_rate_hz) for time in span_s)
    reader = PartReader(recording.reader, first, last - first)
    return replace(recording, reader=reader, n_samples=last - first)


def _facts(recording: Recording, plan: PicturePlan) -> str:
    """Say in a line of what the picture is."""
    width_hz = 1.5 / plan.window_s  # equivalent noise bandwidth of a Hann window
    facts = [
        f"sensor {recording.sensor.id}",
        f"{recording.sample_rate_hz:g} samples/s",
        f"window {plan.window_s:.3g} s (bandwidth {width_hz:.3g} Hz)",
    ]
    if plan.frames > 1:
        facts.append(f"mean of {plan.frames} frames in a column")
    return " \u00b7 ".join(facts)


def _plan(recording: Recording, style: SoundStyle, view: View) -> PicturePlan:
    """Return how a recording is cut: as its length, and the band ask for."""
    rate_hz, duration_s = recording.sample_rate_hz, recording.duration_s
    low_hz, high_hz, is_log = _band(rate_hz, view)
    lowest_hz = low_hz or min(LOWEST_HZ, LOWEST_SHARE * high_hz)
    if style.window_s is None:
        enough_s = (
            LOWEST_CELLS / lowest_hz if is_log
            else 2.0 * PICTURE_ROWS / (high_hz - low_hz)
        )  # fmt: skip
        usual_s = min(COLUMNS_PER_WINDOW * duration_s / COLUMNS, enough_s)
        least_s = max(usual_s, LEAST_PERIODS / high_hz)
        window_s = min(least_s, duration_s, LONGEST_WINDOW_S)
    else:
        window_s = style.window_s
    _check_window(recording, window_s, is_asked=style.window_s is not None)
    if is_log and not low_hz:
        low_hz = min(max(lowest_hz, 2.0 / window_s), 0.5 * high_hz)
    column_s = duration_s / COLUMNS
    frames = max(1, math.ceil(column_s / (0.5 * window_s)))
    overlap = min(1.0 - column_s / (frames * window_s), 0.999)
    top_hz = high_hz + MARGIN_CELLS / window_s
    decimation = usual_decimation(rate_hz, top_hz)
    if window_s * rate_hz < 2 * LEAST_SAMPLES * decimation:
        decimation = 1
    axis = FrequencyAxis(low_hz, high_hz, is_log)
    return PicturePlan(axis, window_s, overlap, frames, decimation)


def _band(rate_hz: float, view: View) -> tuple[float, float, bool]:
    """Return lowest and highest frequency, Hz, and whether the axis is logarithmic."""
    nyquist_hz = 0.5 * rate_hz
    asked = view.band_hz or (0.0, nyquist_hz)
    low_hz, high_hz = asked[0], min(asked[1], nyquist_hz)
    if not low_hz < high_hz:
        msg = (
            f"the recording holds 0 to {nyquist_hz:g} Hz, nothing of {asked[0]:g} to "
            f"{asked[1]:g} Hz (--band-hz)."
        )
        raise DataError(msg)
    if view.is_log is not None:
        return low_hz, high_hz, view.is_log
    is_wide = view.band_hz is None or 0.0 < LOG_RATIO * low_hz < high_hz
    return low_hz, high_hz, is_wide


def _check_window(recording: Recording, window_s: float, *, is_asked: bool) -> None:
    rate_hz = recording.sample_rate_hz
    if is_asked and window_s > recording.duration_s:
        msg = (
            f"--window-s {window_s:g} is longer than what is drawn, "
            f"{recording.duration_s:g} s."
        )
        raise OptionError(msg)
    count = round(window_s * rate_hz)
    if count < LEAST_SAMPLES:
        what = f"--window-s {window_s:g}" if is_asked else "what is drawn"
        msg = (
            f"{what} holds {count} samples at {rate_hz:g} Hz; a spectrum needs "
            f"{LEAST_SAMPLES} or more."
        )
        raise OptionError(msg) if is_asked else DataError(msg)


def _columns(
    recording: Recording, plan: PicturePlan, progress: Callable[[float], None]
) -> Columns:
    """Return the columns of a picture, reading the sound once."""
    margin_hz = MARGIN_CELLS / plan.window_s
    band_hz = (max(0.0, plan.axis.low_hz - margin_hz), plan.axis.high_hz + margin_hz)
    blocks = compute_spectrogram(
        recording, window_s=plan.window_s, overlap=plan.overlap,
        band_hz=band_hz, decimation=plan.decimation,
    )  # fmt: skip
    edges_hz = plan.axis.edges_hz(PICTURE_ROWS)
    total = np.zeros((2 * COLUMNS, PICTURE_ROWS))  # hops of whole samples: not exactly
    time_s, n_frames, n_whole = np.zeros((3, len(total)))
    for block in blocks:
        frames = block.frames
        column = (frames.first_frame + np.arange(frames.time_s.size)) // plan.frames
        is_whole = frames.valid_fraction == 1.0
        begins = np.flatnonzero(np.diff(column, prepend=-1))
        pooled = _pooled_rows(block.power_density, block.frequency_hz, edges_hz)
        pooled[~is_whole] = 0.0
        own = column[begins]
        total[own] += np.add.reduceat(pooled, begins)
        time_s[own] += np.add.reduceat(frames.time_s, begins)
        n_frames[own] += np.add.reduceat(np.ones(column.size), begins)
        n_whole[own] += np.add.reduceat(is_whole.astype(float), begins)
        progress(float(frames.time_s[-1]))
    drawn = n_frames > 0
    density = np.full_like(total, np.nan)
    np.divide(total, n_whole[:, None], out=density, where=n_whole[:, None] > 0)
    return Columns(time_s[drawn] / n_frames[drawn], density[drawn])


def _pooled_rows(
    density: FloatArray, frequency_hz: FloatArray, edges_hz: FloatArray
) -> FloatArray:
    """Return the mean density between edges, that of a cell being the same all over it."""
    cells = cell_edges(frequency_hz)
    power = np.zeros((len(density), cells.size))  # below each edge of a cell
    np.cumsum(density * np.diff(cells), axis=1, out=power[:, 1:])
    place = np.interp(edges_hz, cells, np.arange(cells.size))
    last = np.minimum(place.astype(int), cells.size - 2)
    share = place - last
    below = (1.0 - share) * power[:, last] + share * power[:, last + 1]
    return np.asarray(np.diff(below, axis=1) / np.diff(edges_hz))


def _draw(
    found: Columns, edges_s: FloatArray, axis: FrequencyAxis, style: SoundStyle,
    label: str, ax: "Axes",
) -> None:  # fmt: skip
    """Draw the picture with the meaning of its colours."""
    level_db = 10.0 * np.log10(np.maximum(found.density, np.finfo(float).tiny))
    limits = _limits(level_db[found.density > 0.0], style.db_range)
    edges = (edges_s, axis.edges_hz(PICTURE_ROWS))
    draw_levels(ax, edges, level_db, limits, label, style.colormap)
    axis.set_axis(ax)


def _limits(known_db: FloatArray, range_db: float | None) -> tuple[float, float]:
    """Return the levels of the darkest and the brightest colour."""
    dark, bright = (
        np.quantile(known_db, [QUIET_SHARE, BRIGHT_SHARE]) if known_db.size else (0, 0)
    )
    if range_db is None:
        range_db = float(np.clip(bright - dark, LEAST_RANGE_DB, MOST_RANGE_DB))
    return float(bright) - range_db, float(bright)
