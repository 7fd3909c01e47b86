"""The lofargram: levels over the noise floor of their band, time to the right.

**Method.** The floor of a frequency is the median, over its neighbourhood in
frequency, of the levels that are exceeded most of the time; noise so lies at zero
everywhere and lines, which fill few of the neighbours, stand out for as long as they
last. Nothing is divided by the level of a line itself: a steady line stays.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.base import Container, FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.spectra import MODULATION, Overview
from uwtrack_cli.errors import DataError
from uwtrack_cli.plotting.style import LEVELS_MAP, NO_SOUND
from uwtrack_cli.spectra.overview import pool_overview
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

QUIET_SHARE = 0.3
"""Share of the time that is below the floor of a frequency."""

NEIGHBOURS, NEIGHBOUR_SHARE = 12, 0.08
"""Columns on either side that the floor is taken of: at least so many, and such a share
of the column's number."""

FEWEST_NEIGHBOURS = 4
"""Columns on either side at the ends of the band."""

LEAST_SPAN_DB, MOST_SPAN_DB = 14.0, 30.0
"""Levels above the darkest colour that the colours cover."""

CALM = 0.5
"""The darkest colour lies so far above the floor, in deviations of the noise below it:
noise alone then hardly shows."""

BRIGHTEST_SHARE = 0.998
"""Share of the picture below the brightest colour."""

LOG_SHARE, LOG_BAND = 0.5, 0.2
"""The frequency axis is logarithmic if more than such a share of the lines lies in such
a lowest share of the band."""

FRAME_CELLS = 2.5
"""Sound behind the last cell, in cells, that has room for no further frame where frames
overlap by three quarters."""

LEAST_DECADES = 0.7
"""A logarithmic axis of fewer decades would tell nothing."""

ENOUGH_ROWS = 256
"""Rows of the product's picture in a stretch that need no finer ones."""

MOST_SAMPLES = 1 << 27
"""Samples above which a stretch is not read again."""

PICTURE_ROWS = 420
"""Pixels of the frequency axis."""


@dataclass(frozen=True)
class FrequencyAxis:
    """What is shown of the frequencies."""

    low_hz: float
    """Lowest frequency, Hz."""
    high_hz: float
    """Highest frequency, Hz."""
    is_log: bool
    """Whether the axis is logarithmic."""

    def edges_hz(self, count: int) -> FloatArray:
        """Return the edges of so many rows of equal height, Hz."""
        space = np.geomspace if self.is_log else np.linspace
        return np.asarray(space(self.low_hz, self.high_hz, count + 1))

    def share(self, frequency_hz: FloatArray) -> FloatArray:
        """Return where frequencies lie, as shares of the height."""
        values = (frequency_hz, np.array(self.low_hz), np.array(self.high_hz))
        at, low, high = map(np.log, values) if self.is_log else values
        return np.asarray((at - low) / (high - low))

    def set_axis(self, ax: "Axes", name: str = "frequency") -> None:
        """Give a panel this axis, with its name and the labels of its own kind."""
        from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

        ax.set_ylim(self.low_hz, self.high_hz)
        ax.set_ylabel(f"{name} (Hz)", fontsize=9)
        ax.tick_params(labelsize=8)
        if self.is_log:
            ax.set_yscale("log")
            ax.set_ylim(self.low_hz, self.high_hz)
            ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            ax.yaxis.set_minor_formatter(NullFormatter())


def choose_axis(
    overview: Overview,
    lines: Lines | None,
    band_hz: tuple[float, float] | None,
    *,
    is_log: bool | None,
) -> FrequencyAxis:
    """Choose the frequency axis of a lofargram.

    ``lines``: lines that were tracked in it; None without. ``band_hz``: band that is
    asked for, Hz; None is everything. ``is_log``: whether the axis shall be
    logarithmic; None: where most lines are low.

    Raises
    ------
    DataError
        The picture holds nothing of the band.
    """
    check_axes(overview, "time_s", "frequency_hz")
    frequency = overview.frequency_hz
    low, high = (
        (float(frequency[0]), float(frequency[-1])) if frequency.size else (0, 0)
    )
    if band_hz is not None:
        inside = (max(low, band_hz[0]), min(high, band_hz[1]))
        if not inside[0] < inside[1]:
            msg = (
                f"the lofargram holds {low:g} to {high:g} Hz, nothing of "
                f"{band_hz[0]:g} to {band_hz[1]:g} Hz."
            )
            raise DataError(msg)
        low, high = inside
    if not low < high:
        low, high = low - 0.5, low + 0.5
    bottom = low if low > 0 else float(frequency[frequency > 0].min(initial=high))
    if is_log is None:
        is_log = _most_are_low(lines, low, high) and bottom * 10**LEAST_DECADES < high
    return FrequencyAxis(bottom if is_log else low, high, is_log and bottom < high)


def check_axes(container: Container, *names: str) -> None:
    """Refuse axes of a picture that are not numbers, as only a forged file has them.

    ``names``: its columns that are axes.

    Raises
    ------
    DataError
        A column holds a value that is not finite.
    """
    for name in names:
        if not np.isfinite(getattr(container, name)).all():
            msg = (
                f"{name} of the {container.NAME} holds values that are no numbers; the "
                f"file is not as it was made: make it again with 'uwtrack rerun'."
            )
            raise DataError(msg)


def _most_are_low(lines: Lines | None, low_hz: float, high_hz: float) -> bool:
    if lines is None:
        return False
    owners = [lines.frequency_hz[lines.line == name] for name in lines.line_id]
    middle = np.array([np.median(own) for own in owners if own.size])
    inside = middle[(middle >= low_hz) & (middle <= high_hz)]
    limit = low_hz + LOG_BAND * (high_hz - low_hz)
    return bool(inside.size) and float(np.mean(inside < limit)) > LOG_SHARE


def over_floor(overview: Overview) -> FloatArray:
    """Return the levels over the noise floor of their band, dB; nan in gaps.

    ``overview``: the picture, of shape (row, column).
    """
    step_db = (overview.ceiling_db - overview.floor_db) / 255.0
    level: FloatArray = overview.floor_db + step_db * overview.shade.astype(float)
    level[~overview.shade.any(axis=1)] = np.nan
    heard = level[np.isfinite(level[:, 0])] if level.size else level
    if not heard.size:
        return level
    quiet = np.quantile(heard, QUIET_SHARE, axis=0)
    number = np.arange(quiet.size)
    reach = np.maximum(NEIGHBOURS, (NEIGHBOUR_SHARE * number).astype(int))
    # as many on both sides, so that a steep ambient spectrum does not tilt the floor
    both = np.minimum(number, quiet.size - 1 - number)
    reach = np.maximum(FEWEST_NEIGHBOURS, np.minimum(reach, both))
    floor = np.array([
        np.median(quiet[max(0, k - r) : k + r + 1])
        for k, r in zip(number, reach, strict=True)
    ])  # fmt: skip
    return np.asarray(level - floor)


def finer_overview(
    overview: Overview,
    recording: Recording | None,
    window_s: float,
    span_s: tuple[float, float],
) -> Overview:
    """Return the picture of a stretch from its sound, where the product's is too coarse.

    ``overview``: what the product carries. ``recording``: the recording; one whose
    sound is not at hand changes nothing, nor is the envelope taken anew. ``window_s``:
    length of a frame, s. ``span_s``: begin and end of the stretch, s from the first
    sample.
    """
    shown = (overview.time_s >= span_s[0]) & (overview.time_s <= span_s[1])
    if recording is None or recording.reader is None or shown.sum() >= ENOUGH_ROWS:
        return overview
    if overview.reference == MODULATION:
        return overview
    rate = recording.sample_rate_hz
    first = max(0, round(span_s[0] * rate))
    count = min(round(span_s[1] * rate), recording.n_samples) - first
    if not 2 * window_s * rate < count <= MOST_SAMPLES or overview.time_s.size < 2:
        return overview

    def reader(block: int) -> Iterator[Samples]:
        for begin in range(first, first + count, block):
            end = min(begin + block, first + count)
            yield recording.stretch(begin / rate, end / rate)

    part = replace(recording, reader=reader, n_samples=count)
    step_hz = float(np.diff(overview.frequency_hz).min())
    band_hz = (max(0.0, float(overview.frequency_hz[0]) - 0.5 * step_hz),
               float(overview.frequency_hz[-1]) + 0.5 * step_hz)  # fmt: skip
    try:
        *_, found = pool_overview(
            compute_spectrogram(part, window_s=window_s, band_hz=band_hz)
        )
    except DataError:  # the sound has gone since it was found
        return overview
    return replace(found, time_s=found.time_s + first / rate)


def draw_lofargram(
    overview: Overview,
    axis: FrequencyAxis,
    span_s: tuple[float, float],
    ax: "Axes",
) -> "QuadMesh":
    """Draw a part of the lofargram, as many rows and columns as there is room for.

    ``span_s``: its times, s.
    """
    check_axes(overview, "time_s", "frequency_hz")
    relative = over_floor(overview)
    near = _near(overview.time_s, span_s)
    part, time_s = relative[near], overview.time_s[near]
    edges = axis.edges_hz(PICTURE_ROWS)
    rows = _pooled_columns(part, overview.frequency_hz, edges)
    dark, bright = shades(rows)
    image = draw_levels(
        ax, (cell_edges(time_s, span_s), edges), rows, (dark, bright),
        "dB over the noise floor",
    )  # fmt: skip
    is_envelope = overview.reference == MODULATION
    axis.set_axis(ax, "modulation rate" if is_envelope else "frequency")
    return image


def draw_levels(
    ax: "Axes",
    edges: tuple[FloatArray, FloatArray],
    level_db: FloatArray,
    limits_db: tuple[float, float],
    label: str,
    colormap: str = LEVELS_MAP,
) -> "QuadMesh":
    """Draw levels over time and frequency, with a bar of their colours.

    ``edges``: edges of the cells, s and Hz. ``level_db``: levels, shape (time,
    frequency); nan in gaps. ``limits_db``: levels of the darkest and brightest colour.
    ``label``: what the levels are. ``colormap``: name of the colours.
    """
    image = ax.pcolormesh(
        *edges, np.ma.masked_invalid(level_db.T),
        cmap=colormap, vmin=limits_db[0], vmax=limits_db[1], rasterized=True,
    )  # fmt: skip
    ax.set_facecolor(NO_SOUND)
    bar = ax.figure.colorbar(image, ax=ax, pad=0.01, aspect=30)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return image


def shades(relative_db: FloatArray) -> tuple[float, float]:
    """Return the levels of the darkest and the brightest colour, dB over the floor."""
    known = relative_db[np.isfinite(relative_db)]
    if not known.size:
        return 0.0, LEAST_SPAN_DB
    low, middle, top = np.quantile(known, (0.16, 0.5, BRIGHTEST_SHARE))
    dark = max(0.0, float(min(middle, 2.0) + CALM * (middle - low)))
    return dark, dark + float(np.clip(top - dark, LEAST_SPAN_DB, MOST_SPAN_DB))


def cell_edges(
    middle: FloatArray, span: tuple[float, float] | None = None
) -> FloatArray:
    """Return the edges of cells whose middles are known.

    ``middle``: middles of the cells, in order. ``span``: what is shown: the first cell
    reaches to its begin where that is less than the cell's width away, the last one to
    its end where no further frame had room.
    """
    if middle.size == 1:
        return np.array([middle[0] - 0.5, middle[0] + 0.5])
    between = 0.5 * (middle[1:] + middle[:-1])
    first, last = 2 * middle[0] - between[0], 2 * middle[-1] - between[-1]
    if span is not None:
        width = float(np.median(np.diff(middle)))
        first = span[0] if 0 < first - span[0] < width else first
        last = span[1] if 0 < span[1] - last < FRAME_CELLS * width else last
    return np.concatenate([[first], between, [last]])


def _near(time_s: FloatArray, span_s: tuple[float, float]) -> slice:
    """Return the rows of a span and one beside it on either side."""
    first = int(np.searchsorted(time_s, span_s[0])) - 1
    last = int(np.searchsorted(time_s, span_s[1])) + 1
    return slice(max(0, min(first, time_s.size - 2)), max(last, 1))


def _pooled_columns(
    part: FloatArray, frequency_hz: FloatArray, edges_hz: FloatArray
) -> FloatArray:
    """Return the strongest cell between edges; the nearest one where there is none."""
    first = np.searchsorted(frequency_hz, edges_hz[:-1])
    last = np.searchsorted(frequency_hz, edges_hz[1:])
    middle = 0.5 * (edges_hz[1:] + edges_hz[:-1])
    nearest = np.searchsorted(cell_edges(frequency_hz)[1:-1], middle)
    rows = part[:, nearest].copy()
    for pixel in np.flatnonzero(last - first > 1):
        rows[:, pixel] = part[:, first[pixel] : last[pixel]].max(axis=1)
    return rows
