"""Levels over time and frequency, of the sound itself or of what a product carries.

**Method.** Frames follow from the length of the sound: about 800 columns, whose frames
overlap where it is short and are averaged where it is long. Below the frequency at which
such a window holds ten periods, every octave of a logarithmic axis has a window of its
own. A cell of the picture is the mean power density of the frames and frequencies that
it covers, so that density times bandwidth stays the mean square of the sound; of a
lofargram it is the mean of the strongest frequencies, so that a thin line survives.

A lofargram is drawn over the noise floor of its band. The floor of a frequency is the
median, over its neighbourhood in frequency, of the levels that are exceeded most of the
time; noise so lies at zero everywhere and lines, which fill few of the neighbours, stand
out for as long as they last. Nothing is divided by the level of a line itself: a steady
line stays.

**Conventions.** Columns with lost samples in all of their frames are grey.

**References.** Welch 1967 for the density.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from uwtrack_cli.data.base import Container, FloatArray
from uwtrack_cli.data.recording import PartReader, Recording
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.decimation import usual_decimation
from uwtrack_cli.plotting.style import LEVELS_MAP, Span, draw_cells
from uwtrack_cli.plotting.view import View
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

COLUMNS, ROWS = 800, 420
"""Cells of a picture along time and frequency, unless it is a strip."""

COLUMNS_PER_WINDOW = 8
"""Columns that a window spans, unless the band asks for another: a hundredth of the
sound."""

LONGEST_WINDOW_S = 60.0
"""Longest window, s."""

LONGEST_SHARE = 0.125
"""Longest window of an octave, as a share of the sound."""

LOG_RATIO = 20.0
"""The frequency axis is logarithmic where the band spans more than such a ratio."""

LOWEST_HZ, LOWEST_SHARE = 10.0, 0.01
"""A logarithmic axis to the Nyquist frequency begins here, or at such a share of that
frequency where this is lower."""

CELLS = 10.0
"""A logarithmic axis needs no cells narrower than a frequency over this."""

LEAST_PERIODS = 32
"""Periods of the highest frequency that a window holds at least."""

LEAST_SAMPLES = 16
"""Samples that a window holds at least."""

MARGIN_CELLS = 8
"""Cells that are read on either side of a band, so that its ends are not empty."""

LEAST_RATE_HZ = 100.0
"""Sample rate below which sound is not reduced."""

MOST_SAMPLES = 1 << 25
"""Samples above which a lofargram comes from the product's overview."""

QUIET_SHARE = 0.3
"""Share of the time that is below the floor of a frequency."""

NEIGHBOURS, NEIGHBOUR_SHARE = 12, 0.08
"""Columns on either side that the floor is taken of: at least so many, and such a share
of the column's number."""

FEWEST_NEIGHBOURS = 4
"""Columns on either side at the ends of the band."""

LOBE_CELLS, LOBES = 4.0, 1.5
"""Width of a line by a Hann window, in cells of 1 / window, and how many of these lie on
either side at least."""

LEAST_SPAN_DB, MOST_SPAN_DB = 14.0, 30.0
"""Levels above the darkest colour that the colours of a lofargram cover."""

CALM = 0.5
"""The darkest colour lies so far above the floor, in deviations of the noise below it:
noise alone then hardly shows."""

BRIGHTEST_SHARE = 0.998
"""Share of the picture below the brightest colour."""

FRAME_CELLS = 2.5
"""Sound behind the last cell, in cells, that has room for no further frame where frames
overlap by three quarters."""


@dataclass(frozen=True)
class FrequencyAxis:
    """What is shown of the frequencies."""

    low_hz: float
    """Lowest frequency, Hz."""
    high_hz: float
    """Highest frequency, Hz."""
    is_log: bool
    """Whether the axis is logarithmic."""
    rows: int = ROWS
    """Rows of equal height that a picture has."""

    def edges_hz(self) -> FloatArray:
        """Return the edges of the rows, Hz."""
        space = np.geomspace if self.is_log else np.linspace
        return np.asarray(space(self.low_hz, self.high_hz, self.rows + 1))

    def share(self, frequency_hz: FloatArray) -> FloatArray:
        """Return where frequencies lie, as shares of the height."""
        values = (frequency_hz, np.array(self.low_hz), np.array(self.high_hz))
        at, low, high = map(np.log, values) if self.is_log else values
        return np.asarray((at - low) / (high - low))

    def set_axis(self, ax: Axes, name: str = "frequency") -> None:
        """Give a panel this axis, with its name and the labels of its own kind."""
        ax.set_ylabel(f"{name} (Hz)", fontsize=9)
        ax.tick_params(labelsize=8)
        if self.is_log:
            ax.set_yscale("log")
            ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            ax.yaxis.set_minor_formatter(NullFormatter())
        ax.set_ylim(self.low_hz, self.high_hz)


class Picture(NamedTuple):
    """Levels over time and frequency."""

    edges_s: FloatArray
    """Edges of the columns, s from the first sample, shape (column + 1,)."""
    axis: FrequencyAxis
    """Frequencies of the rows."""
    level_db: FloatArray
    """Levels, dB, shape (column, row); nan where there is no sound."""

    def draw(
        self,
        ax: Axes,
        limits_db: tuple[float, float] | None = None,
        label: str = "dB over the noise floor",
        colormap: str = LEVELS_MAP,
    ) -> None:
        """Draw it with a bar of its colours.

        ``limits_db``: levels of the darkest and brightest colour; None are those of a
        lofargram. ``label``: what the levels are, empty without a bar. ``colormap``: name
        of the colours.
        """
        cells = self.edges_s, self.axis.edges_hz(), self.level_db
        self.axis.set_axis(ax)
        draw_cells(ax, *cells, limits_db or shades(self.level_db), label, colormap)


class Framing(NamedTuple):
    """How the sound of some rows is cut into frames."""

    rows: slice
    """Rows of the picture."""
    window_s: float
    """Length of the analysis window, s."""
    overlap: float
    """Share of a window that the next one covers again."""
    per_column: int
    """Frames that a column averages."""
    decimation: int
    """Factor by which the sample rate is reduced first."""


def choose_axis(
    known_hz: tuple[float, float], view: View, name: str = "the lofargram"
) -> FrequencyAxis:
    """Choose the frequency axis of a picture.

    ``known_hz``: band that is known, Hz. ``name``: what knows it.

    Raises
    ------
    DataError
        Nothing is known of the band that is asked for.
    """
    low, high = known_hz
    if view.band_hz is not None:
        low, high = max(low, view.band_hz[0]), min(high, view.band_hz[1])
        if not low < high:
            raise DataError(
                f"{name} holds {known_hz[0]:g} to {known_hz[1]:g} Hz, nothing of "
                f"{view.band_hz[0]:g} to {view.band_hz[1]:g} Hz (--band-hz)."
            )
    if not low < high:
        low, high = low - 0.5, low + 0.5
    is_wide = view.band_hz is None or 0.0 < LOG_RATIO * low < high
    is_log = is_wide if view.is_log is None else view.is_log
    if is_log and view.band_hz is None:
        low = max(low, min(LOWEST_HZ, LOWEST_SHARE * high))
    if is_log and low <= 0.0:
        low = min(LOWEST_HZ, LOWEST_SHARE * high)
    return FrequencyAxis(low, high, is_log and 0.0 < low < high)


def plan_frames(
    recording: Recording, axis: FrequencyAxis, window_s: float | None = None
) -> tuple[FrequencyAxis, list[Framing]]:
    """Return how a recording is cut, the main part last, and the axis it can fill.

    ``axis``: what is asked for; where the sound is too short for its lowest octave, it
    begins higher. ``window_s``: length of every window, s; None: as the length of the
    sound and the band ask for.

    Raises
    ------
    OptionError
        The window does not fit the recording.
    DataError
        The recording is too short for a picture.
    """
    duration_s, low, high = recording.duration_s, axis.low_hz, axis.high_hz
    enough_s = CELLS / low if axis.is_log else 2.0 * axis.rows / (high - low)
    usual_s = min(COLUMNS_PER_WINDOW * duration_s / COLUMNS, enough_s)
    usual_s = max(usual_s, LEAST_PERIODS / high)
    usual_s = window_s or min(usual_s, duration_s, LONGEST_WINDOW_S)
    what = "what is drawn" if window_s is None else f"--window-s {window_s:g}"
    if usual_s > duration_s:
        raise OptionError(f"{what} is longer than what is drawn, {duration_s:g} s.")
    if (count := round(usual_s * recording.sample_rate_hz)) < LEAST_SAMPLES:
        msg = (
            f"{what} holds {count} samples at {recording.sample_rate_hz:g} Hz; a spectrum "
            f"needs {LEAST_SAMPLES} or more."
        )
        raise DataError(msg) if window_s is None else OptionError(msg)
    parts, first = list[Framing](), 0
    if axis.is_log and window_s is None:
        longest_s = max(usual_s, LONGEST_SHARE * duration_s)
        axis = replace(axis, low_hz=min(max(low, 2.0 / longest_s), 0.5 * high))
        edges = axis.edges_hz()
        while (own_s := min(CELLS / edges[first], longest_s)) > 1.5 * usual_s:
            last = int(np.searchsorted(edges, 2.0 * edges[first]))
            if last >= axis.rows:
                break
            parts.append(_frames(recording, axis, own_s, slice(first, last)))
            first = last  # every octave has its own window
    return axis, [*parts, _frames(recording, axis, usual_s, slice(first, axis.rows))]


def _frames(recording: Recording, axis: FrequencyAxis, window_s: float, rows: slice) -> Framing:
    rate_hz = recording.sample_rate_hz
    column_s = recording.duration_s / (COLUMNS * axis.rows / ROWS)
    count = max(1, math.ceil(column_s / (0.5 * window_s)))
    overlap = min(1.0 - column_s / (count * window_s), 0.999)
    top_hz = axis.edges_hz()[rows.stop] + MARGIN_CELLS / window_s
    decimation = usual_decimation(rate_hz, top_hz, LEAST_RATE_HZ)
    if window_s * rate_hz < 2 * LEAST_SAMPLES * decimation:
        decimation = 1
    return Framing(rows, window_s, overlap, count, decimation)


def _of_fast_length(recording: Recording, part: Framing) -> Framing:
    """Return frames a little longer, whose transform takes less time."""
    from scipy.fft import next_fast_len

    rate_hz = recording.sample_rate_hz / part.decimation
    fast = next_fast_len(round(part.window_s * rate_hz), real=True)
    longest = recording.n_samples // part.decimation
    return part._replace(window_s=min(fast, longest) / rate_hz)


def part_of(recording: Recording, span_s: Span) -> Recording:
    """Return a span of a recording whose sound is at hand, s from its first sample."""
    assert recording.reader is not None  # noqa: S101 - it was opened for this
    first, last = (min(max(round(time * recording.sample_rate_hz), 0), recording.n_samples)
                   for time in span_s)  # fmt: skip
    reader = PartReader(recording.reader, first, last - first)
    return replace(recording, reader=reader, n_samples=last - first)


def sound_picture(
    recording: Recording,
    axis: FrequencyAxis,
    parts: Sequence[Framing],
    *,
    is_strongest: bool = False,
    progress: Callable[[float], None] = lambda _: None,
) -> Picture:
    """Return power densities of a recording, read once for each of its windows, in dB.

    ``axis``, ``parts``: as `plan_frames` gives them. ``is_strongest``: whether a cell is
    the strongest frequency that it covers, not their mean.
    """
    found = [_columns(recording, p, axis, progress, is_strongest=is_strongest) for p in parts]
    time_s = found[-1][0]
    density = np.full((time_s.size, axis.rows), np.nan)
    for part, (own_s, own) in zip(parts, found, strict=True):
        near = np.searchsorted(0.5 * (own_s[1:] + own_s[:-1]), time_s)
        density[:, part.rows] = own[near]
    edges = cell_edges(time_s)
    edges[[0, -1]] = 0.0, recording.duration_s  # the end frames reach to the ends
    return Picture(edges, axis, 10.0 * np.log10(np.maximum(density, 1e-300)))


def _columns(
    recording: Recording, part: Framing, axis: FrequencyAxis,
    progress: Callable[[float], None], *, is_strongest: bool,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return times of columns, and densities of shape (column, row) of some rows."""
    edges_hz = axis.edges_hz()[part.rows.start : part.rows.stop + 1]
    margin_hz = MARGIN_CELLS / part.window_s
    if recording.sensor.kind == "difar":  # directions are not drawn
        omni = replace(recording.sensor, kind="omni")
        recording = replace(recording, sensor=omni)
    blocks = compute_spectrogram(
        recording, window_s=part.window_s, overlap=part.overlap,
        band_hz=(max(0.0, edges_hz[0] - margin_hz), edges_hz[-1] + margin_hz),
        decimation=part.decimation,
    )  # fmt: skip
    pool = _strongest_rows if is_strongest else _mean_rows
    total = np.zeros((2 * COLUMNS, edges_hz.size - 1))  # hops are not exact columns
    time_s, n_frames, n_whole = np.zeros((3, len(total)))
    for block in blocks:
        frames = block.frames
        column = (frames.first_frame + np.arange(frames.time_s.size)) // part.per_column
        is_whole = frames.valid_fraction == 1.0
        begins = np.flatnonzero(np.diff(column, prepend=-1))
        pooled = pool(block.power_density, block.frequency_hz, edges_hz)
        pooled[~is_whole] = 0.0
        for sums, own in ((total, pooled), (time_s, frames.time_s),
                          (n_frames, np.ones(column.size)),
                          (n_whole, is_whole.astype(float))):  # fmt: skip
            sums[column[begins]] += np.add.reduceat(own, begins)
        progress(float(frames.time_s[-1]))
    drawn = n_frames > 0
    density = np.full_like(total, np.nan)
    np.divide(total, n_whole[:, None], out=density, where=n_whole[:, None] > 0)
    return time_s[drawn] / n_frames[drawn], density[drawn]


def _mean_rows(density: FloatArray, frequency_hz: FloatArray, edges_hz: FloatArray) -> FloatArray:
    """Return the mean density between edges, that of a cell being the same all over it."""
    cells = cell_edges(frequency_hz)
    power = np.zeros((len(density), cells.size))  # below each edge of a cell
    np.cumsum(density * np.diff(cells), axis=1, out=power[:, 1:])
    place = np.interp(edges_hz, cells, np.arange(cells.size))
    last = np.minimum(place.astype(int), cells.size - 2)
    share = place - last
    below = (1.0 - share) * power[:, last] + share * power[:, last + 1]
    return np.asarray(np.diff(below, axis=1) / np.diff(edges_hz))


def _strongest_rows(
    cells: FloatArray, frequency_hz: FloatArray, edges_hz: FloatArray
) -> FloatArray:
    """Return the strongest cell between edges; what lies between two where none does."""
    middle, last = 0.5 * (edges_hz[1:] + edges_hz[:-1]), frequency_hz.size - 1
    place = np.interp(middle, frequency_hz, np.arange(last + 1.0))
    below, share = place.astype(int), place % 1.0
    above = np.minimum(below + 1, last)
    rows = (1.0 - share) * cells[:, below] + share * cells[:, above]
    first, end = np.searchsorted(frequency_hz, [edges_hz[:-1], edges_hz[1:]])
    for row in np.flatnonzero(end - first > 1):
        rows[:, row] = cells[:, first[row] : end[row]].max(axis=1)
    return np.asarray(rows)


def overview_levels(overview: Overview) -> FloatArray:
    """Return the levels of an overview, dB; nan in gaps."""
    step_db = (overview.ceiling_db - overview.floor_db) / 255.0
    level: FloatArray = overview.floor_db + step_db * overview.shade.astype(float)
    level[~overview.shade.any(axis=1)] = np.nan
    return level


def over_floor(level_db: FloatArray, least: FloatArray | int = 0) -> FloatArray:
    """Return levels over the noise floor of their band, dB, shape (time, frequency).

    ``least``: columns on either side that the floor of a column is taken of, at least.
    """
    heard = level_db[np.isfinite(level_db).all(axis=1)] if level_db.size else level_db
    if not heard.size:
        return level_db
    quiet = np.quantile(heard, QUIET_SHARE, axis=0)
    if 2 * np.min(least) > quiet.size:  # a line alone fills the band
        return np.asarray(level_db - np.median(quiet))
    number = np.arange(quiet.size)
    reach = np.maximum(NEIGHBOURS, (NEIGHBOUR_SHARE * number).astype(int))
    reach = np.maximum(reach, least)
    # as many on both sides, so that a steep ambient spectrum does not tilt the floor
    both = np.minimum(number, quiet.size - 1 - number)
    reach = np.maximum(FEWEST_NEIGHBOURS, np.minimum(reach, both))
    near = (quiet[max(0, k - r) : k + r + 1] for k, r in zip(number, reach, strict=True))
    return np.asarray(level_db - np.array(list(map(np.median, near))))


def overview_picture(overview: Overview, axis: FrequencyAxis, span_s: Span) -> Picture:
    """Return a part of an overview, over its noise floor."""
    check_axes(overview, "time_s", "frequency_hz")
    time_s = overview.time_s
    first = int(np.searchsorted(time_s, span_s[0])) - 1  # and one beside it
    last = int(np.searchsorted(time_s, span_s[1])) + 1
    near = slice(max(0, min(first, time_s.size - 2)), max(last, 1))
    relative = over_floor(overview_levels(overview))[near]
    rows = _strongest_rows(relative, overview.frequency_hz, axis.edges_hz())
    return Picture(cell_edges(time_s[near], span_s), axis, rows)


def lofargram(
    recording: Recording, axis: FrequencyAxis, span_s: Span, window_s: float | None = None
) -> Picture | None:
    """Return a span of the sound over its noise floor; None where it is too short.

    ``window_s``: as in `plan_frames`; what lies half of it beside the span is read, too.
    """
    margin_s = 0.5 * (window_s or 0.0)
    part = part_of(recording, (span_s[0] - margin_s, span_s[1] + margin_s))
    try:
        axis, frames = plan_frames(part, axis, window_s)
        frames = [_of_fast_length(part, frame) for frame in frames]
        found = sound_picture(part, axis, frames, is_strongest=True)
    except (DataError, OptionError):  # it has gone since it was found, or is too short
        return None
    begin_s = max(span_s[0] - margin_s, 0.0)
    least = np.ceil(LOBES * LOBE_CELLS / np.diff(axis.edges_hz())
                    / np.repeat([f.window_s for f in frames],
                                [f.rows.stop - f.rows.start for f in frames])
                    ).astype(int)  # fmt: skip
    return Picture(found.edges_s + begin_s, axis, over_floor(found.level_db, least))


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
            raise DataError(
                f"{name} of the {container.NAME} holds values that are no numbers; the "
                f"file is not as it was made: make it again with 'uwtrack rerun'."
            )


def shades(relative_db: FloatArray) -> tuple[float, float]:
    """Return the levels of the darkest and the brightest colour, dB over the floor."""
    known = relative_db[np.isfinite(relative_db)]
    if not known.size:
        return 0.0, LEAST_SPAN_DB
    low, middle, top = np.quantile(known, (0.16, 0.5, BRIGHTEST_SHARE))
    dark = max(0.0, float(min(middle, 2.0) + CALM * (middle - low)))
    return dark, dark + float(np.clip(top - dark, LEAST_SPAN_DB, MOST_SPAN_DB))


def cell_edges(middle: FloatArray, span: Span | None = None, width: float = 1.0) -> FloatArray:
    """Return the edges of cells whose middles are known.

    ``middle``: middles of the cells, in order. ``span``: what is shown: the first cell
    reaches to its begin where that is less than the cell's width away, the last one to
    its end where no further frame had room. ``width``: of a cell that has no neighbour.
    """
    if middle.size == 1:
        return np.array([middle[0] - 0.5 * width, middle[0] + 0.5 * width])
    between = 0.5 * (middle[1:] + middle[:-1])
    first, last = 2 * middle[0] - between[0], 2 * middle[-1] - between[-1]
    if span is not None:
        width = float(np.median(np.diff(middle)))
        first = span[0] if 0 < first - span[0] < width else first
        last = span[1] if 0 < span[1] - last < FRAME_CELLS * width else last
    return np.concatenate([[first], between, [last]])
