"""Raw measurements of one contact, gathered from the containers on one time axis.

**Method.** Lines give a frequency and a bearing each, the broadband levels a level and
a bearing. The raw associated measurements are taken, never the smoothed states.

**Conventions.** Missing is nan. Overlapping frames are known to be correlated from
their window and hop.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.motion.correlation import Kind, overlap_correlation

MOST_SEARCHED = 6000
"""Instants among which a closest approach is sought; longer series are averaged."""

NEPER_DB = 10 / np.log(10)
"""Decibels in a natural-logarithm unit of power."""

WEAKEST_LEVEL_DB = 5.0
"""Signal over noise in its cell from which a line's level is used, dB."""

WINDOW_WIDTHS = 25.0
"""Of a long series, so many d/v on either side of the closest approach are kept."""


@dataclass(frozen=True)
class PassageData:
    """Raw measurements of one contact."""

    time_s: FloatArray
    """Times of reception, s, shape (n,)."""
    frequency_hz: FloatArray
    """Frequencies, Hz, shape (..., lines, n); nan is missing."""
    frequency_std_hz: FloatArray
    """Their standard deviations, Hz."""
    bearing_deg: FloatArray
    """Bearings, degrees, shape (..., sources, n); nan is missing."""
    bearing_std_deg: FloatArray
    """Their standard deviations, degrees."""
    level_db: FloatArray
    """Levels, dB, shape (..., 1, n); nan is missing."""
    level_std_db: FloatArray
    """Their standard deviations, dB."""
    frequency_correlation: float = 0.0
    """Correlation of neighbouring frequencies' errors."""
    bearing_correlation: float = 0.0
    """Correlation of neighbouring bearings' errors."""
    level_correlation: float = 0.0
    """Correlation of neighbouring levels' errors."""
    line_level_db: FloatArray | None = None
    """Levels of the lines without the noise in them, dB, shape (..., lines, n); nan is
    missing or weak; None: none were measured."""
    frame_s: FloatArray | None = None
    """Lengths of the frames of the frequencies, s, shape (..., lines, n); nan is missing;
    None: they are those of an instant."""

    @property
    def step_s(self) -> float:
        """Typical distance of measurements, s."""
        return float(np.median(np.diff(self.time_s))) if self.time_s.size > 1 else 1.0

    @property
    def span_s(self) -> float:
        """Time covered, s."""
        return float(self.time_s[-1] - self.time_s[0]) if self.time_s.size else 0.0


def condense(data: PassageData, time_s: float, width_s: float, most: int = 1500) -> PassageData:
    """Keep what matters to a passage of a long series, averaged if need be.

    Parameters
    ----------
    data
        Raw measurements of one contact.
    time_s
        Time of closest approach, seconds, about.
    width_s
        Range over speed, seconds, about.
    most
        Instants to keep at most, about.
    """
    if data.time_s.size <= most:
        return data
    near = np.flatnonzero(np.abs(data.time_s - time_s) <= WINDOW_WIDTHS * width_s)
    return _averaged(data, near if near.size >= 8 else slice(None), most)


def thin(data: PassageData) -> PassageData:
    """Average a very long series, so that a search through it stays affordable."""
    if data.time_s.size <= MOST_SEARCHED:
        return data
    return _averaged(data, slice(None), MOST_SEARCHED)


def _averaged(data: PassageData, kept: IntArray | slice, most: int) -> PassageData:
    """Average runs of neighbouring instants, so that about ``most`` are left."""
    time = data.time_s[kept]
    starts = np.arange(0, time.size, -(-time.size // most))

    def mean(
        value: FloatArray, std: FloatArray, period: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        # line by line: what a day is averaged with need not be held of all of them
        shape = (*value.shape[:-1], starts.size)
        found = np.empty((2, int(np.prod(shape[:-1])), starts.size))
        one, other = (v.reshape(-1, v.shape[-1]) for v in (value, std))
        for k in range(found.shape[1]):
            found[:, k] = row(one[k], other[k], period)
        return found[0].reshape(shape), found[1].reshape(shape)

    def row(
        value: FloatArray, std: FloatArray, period: float | None
    ) -> tuple[FloatArray, FloatArray]:
        value, std = value[kept], std[kept]
        good = np.isfinite(value) & (std > 0)
        weight = np.where(good, 1 / np.where(good, std, 1.0) ** 2, 0.0)
        size = np.add.reduceat(weight, starts)
        some = np.where(size > 0, size, np.nan)
        if period is None:
            total = np.add.reduceat(weight * np.where(good, value, 0), starts)
            return total / some, 1 / np.sqrt(some)
        turn = np.exp(2j * np.pi / period * np.where(good, value, 0))
        vector = np.add.reduceat(weight * turn, starts)
        angle = np.angle(vector) * period / (2 * np.pi) % period
        return np.where(size > 0, angle, np.nan), 1 / np.sqrt(some)

    def plain_mean(value: FloatArray | None) -> FloatArray | None:
        return None if value is None else mean(value, np.broadcast_to(1.0, value.shape))[0]

    count = np.diff(np.append(starts, time.size))
    return PassageData(
        np.add.reduceat(time, starts) / count,
        *mean(data.frequency_hz, data.frequency_std_hz),
        *mean(data.bearing_deg, data.bearing_std_deg, 360.0),
        *mean(data.level_db, data.level_std_db),
        line_level_db=plain_mean(data.line_level_db),
        frame_s=plain_mean(data.frame_s),
    )


def contact_ids(lines: Lines) -> list[int]:
    """Return the contacts that have a line that is not mains hum.

    Parameters
    ----------
    lines
        Tracked lines.
    """
    usable = (lines.line_contact > 0) & (lines.line_status != "hum")
    return [int(contact) for contact in np.unique(lines.line_contact[usable])]


def lines_of(lines: Lines, contacts: tuple[int, ...]) -> IntArray:
    """Return the identifiers of the lines of some contacts, hum left out.

    Parameters
    ----------
    lines
        Tracked lines.
    contacts
        Contacts whose lines are wanted.
    """
    wanted = np.isin(lines.line_contact, contacts) & (lines.line_status != "hum")
    return np.asarray(lines.line_id[wanted])


def contact_data(
    lines: Lines | None, levels: Levels | None, contacts: tuple[int, ...]
) -> PassageData:
    """Gather the measurements of a contact (or of several that are one vessel).

    Parameters
    ----------
    lines
        Tracked lines, or None.
    levels
        Broadband levels and bearings that belong to the contact, or None.
    contacts
        Contacts whose lines are taken.
    """
    ids = lines_of(lines, contacts) if lines is not None else np.empty(0, np.int64)
    if lines is not None and levels is not None and ids.size:
        levels = _around(levels, lines.time_s[np.isin(lines.line, ids)])
    time = _time_axis(lines, levels, ids)
    frequency, frequency_std, bearing, bearing_std, heard, frame_s = _line_rows(lines, ids, time)
    level, level_std = np.full((2, 1, time.size), np.nan)
    if levels is not None:
        place = np.searchsorted(time, levels.frames.time_s)
        level[0, place] = levels.excess_db
        level_std[0, place] = levels.excess_std_db
        wide, wide_std = np.full((2, 1, time.size), np.nan)
        wide[0, place] = levels.bearing_deg
        wide_std[0, place] = levels.bearing_std_deg
        bearing = _with_row(bearing, wide)
        bearing_std = _with_row(bearing_std, wide_std)
    frames = lines.frames if lines is not None else None
    frames = levels.frames if frames is None and levels is not None else frames
    return PassageData(
        time, frequency, frequency_std, bearing, bearing_std, level, level_std,
        _neighbour("frequency", frames),
        _neighbour("bearing", frames),
        _neighbour("level", frames),
        heard, frame_s,
    )  # fmt: skip


def with_frequency(
    data: PassageData,
    time_s: FloatArray,
    frequency_hz: FloatArray,
    frequency_std_hz: FloatArray,
    correlation: float,
) -> PassageData:
    """Return the measurements of a source with one line that was measured at other times.

    Parameters
    ----------
    data
        Measurements without a line.
    time_s, frequency_hz, frequency_std_hz
        Instants, s, with the frequency there, Hz, and its deviation; shape (n,). Other
        measurements are kept for as long, and for as long again before and after.
    correlation
        Of neighbouring frequencies' errors.
    """
    length_s = float(np.ptp(time_s))
    near = np.abs(data.time_s - 0.5 * (time_s[0] + time_s[-1])) <= 1.5 * length_s
    time = np.unique(np.concatenate([data.time_s[near], time_s]))
    there, here = (np.searchsorted(time, data.time_s[near]), np.searchsorted(time, time_s))

    def placed(value: FloatArray) -> FloatArray:
        full = np.full((*value.shape[:-1], time.size), np.nan)
        full[..., there] = value[..., near]
        return full

    frequency, std = np.full((2, 1, time.size), np.nan)
    frequency[0, here], std[0, here] = frequency_hz, frequency_std_hz
    return PassageData(
        time, frequency, std, placed(data.bearing_deg), placed(data.bearing_std_deg),
        placed(data.level_db), placed(data.level_std_db), correlation,
        data.bearing_correlation, data.level_correlation,
    )  # fmt: skip


def _around(levels: Levels, heard_s: FloatArray) -> Levels:
    """Keep the levels while lines were measured, and as long before and after."""
    first, last = float(heard_s.min()), float(heard_s.max())
    length = last - first
    time = levels.frames.time_s
    near = np.flatnonzero((time >= first - length) & (time <= last + length))
    return levels.take("frame", slice(int(near[0]), int(near[-1]) + 1))


def series_data(series: Series, contact: int) -> PassageData:
    """Gather the measurements of one contact of a table.

    Deviations that the table does not give are one unit: the fit finds its scale
    from the data.

    Parameters
    ----------
    series
        Measurements made elsewhere.
    contact
        Contact whose rows are taken.
    """
    rows = np.flatnonzero(series.contact == contact)
    rows = rows[np.argsort(series.time_s[rows], kind="stable")]
    time, inverse = np.unique(series.time_s[rows], return_inverse=True)

    def spread(values: FloatArray) -> FloatArray:
        full = np.full((values.shape[1], time.size), np.nan)
        full[:, inverse] = values[rows].T
        return full

    frequency = spread(series.frequency_hz)
    bearing = spread(series.bearing_deg[:, None])
    level = spread(series.level_db[:, None])
    return PassageData(
        time,
        frequency,
        _deviation(spread(series.frequency_std_hz), frequency),
        bearing,
        _deviation(spread(series.bearing_std_deg[:, None]), bearing, 360.0),
        level,
        _deviation(spread(series.level_std_db[:, None]), level),
    )


def _deviation(std: FloatArray, value: FloatArray, period: float | None = None) -> FloatArray:
    """Take the scatter of neighbours where the table gives no deviation."""
    if np.isfinite(std).any() or not np.isfinite(value).any():
        return std
    filled = std.copy()
    for row, values in enumerate(value):
        steps = np.diff(values[np.isfinite(values)])
        if period is not None:
            steps = steps - period * np.rint(steps / period)
        largest = float(np.nanmax(np.abs(values), initial=0.0))
        typical = float(np.median(np.abs(steps))) / 0.954 if steps.size else 1.0
        filled[row] = max(typical, 1e-12 * largest, 1e-300)
    return filled


def _time_axis(lines: Lines | None, levels: Levels | None, ids: IntArray) -> FloatArray:
    times = [np.empty(0)]
    if lines is not None:
        times.append(np.asarray(lines.time_s[np.isin(lines.line, ids)], float))
    if levels is not None:
        times.append(np.asarray(levels.frames.time_s, float))
    return np.unique(np.concatenate(times))


def _line_rows(
    lines: Lines | None, ids: IntArray, time: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray | None, FloatArray | None]:
    shape = ids.size, time.size
    if lines is None or not ids.size:
        none = _unknown(shape)
        return none, none, none, none, None, None
    points = np.flatnonzero(np.isin(lines.line, ids))
    order = np.argsort(ids)
    row = order[np.searchsorted(ids, lines.line[points], sorter=order)]
    place = np.searchsorted(time, lines.time_s[points])

    def rows(column: FloatArray) -> FloatArray:
        values = column[points]
        if not np.isfinite(values).any():
            return _unknown(shape)
        full = np.full(shape, np.nan)
        full[row, place] = values
        return full

    return (
        rows(lines.measured_frequency_hz), rows(lines.measured_frequency_std_hz),
        rows(lines.measured_bearing_deg), rows(lines.measured_bearing_std_deg),
        _line_levels(lines, points, (row, place), shape), rows(lines.point_window_s),
    )  # fmt: skip


def _line_levels(
    lines: Lines, points: IntArray, at: tuple[IntArray, IntArray], shape: tuple[int, int]
) -> FloatArray | None:
    """Return the levels of some points, freed of the noise in their cells."""
    level = heard_level_db(lines, points)
    known = np.isfinite(level)
    if not known.any():
        return None
    full = np.full(shape, np.nan, np.float32)
    full[at[0][known], at[1][known]] = level[known]
    return full


def heard_level_db(lines: Lines, points: IntArray) -> FloatArray:
    """Return the levels of some points without the noise in their cells, dB.

    Parameters
    ----------
    lines
        Tracked lines.
    points
        Their points.

    Returns
    -------
    FloatArray
        Shape (point,); nan is missing or weak.
    """
    snr_db, level = lines.measured_snr_db[points], lines.measured_level_db[points]
    known = np.isfinite(level) & (snr_db > WEAKEST_LEVEL_DB)
    heard = np.full(points.size, np.nan)
    noise = NEPER_DB * np.log1p(np.exp(-snr_db[known] / NEPER_DB))
    heard[known] = level[known] - noise
    return heard


def _unknown(shape: tuple[int, int]) -> FloatArray:
    """Return rows of nothing, which take no memory: a day of an omni sensor's bearings."""
    return np.broadcast_to(np.nan, shape)


def _with_row(rows: FloatArray, last: FloatArray) -> FloatArray:
    """Return rows with one more at the end."""
    if np.isfinite(last).any() or np.isfinite(rows).any():
        return np.concatenate([rows, last])
    return _unknown((rows.shape[0] + 1, rows.shape[1]))


def _neighbour(kind: Kind, frames: Frames | None) -> float:
    """Correlation of neighbouring frames' errors; zero without overlap."""
    if frames is None or frames.hop_samples >= frames.window_samples:
        return 0.0
    overlap = 1 - frames.hop_samples / frames.window_samples
    values = overlap_correlation(kind, overlap)
    return float(values[0]) if values.size else 0.0


@dataclass(frozen=True)
class Block:
    """Values of one kind in fit units and their inverse variances (0: missing)."""

    value: FloatArray
    """Values in the units of the fit, shape (batch, rows, n)."""
    weight: FloatArray
    """Inverse variances, same shape; 0 is missing."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing of this kind was measured."""
        return not bool(self.weight.any())


@dataclass(frozen=True)
class Blocks:
    """The three kinds under one another, so that one operation serves all rows."""

    time_s: FloatArray
    """Times of reception, s, shape (n,)."""
    value: FloatArray
    """Lines, then sources of bearings, then levels, shape (batch, rows, n)."""
    weight: FloatArray
    """Inverse variances, same shape; 0 is missing."""
    correlation: FloatArray
    """Correlation of neighbouring errors of every row, shape (rows,)."""
    count: tuple[int, int, int]
    """Number of rows of frequencies, bearings and levels."""
    kinds: FloatArray
    """One where a row is of a kind, shape (3, rows)."""
    mean_hz: FloatArray
    """Mean frequency of every line, Hz, shape (batch, lines)."""
    line_level: FloatArray | None = None
    """Levels of the lines, ln of power, shape (batch, lines, n); nan is missing."""
    blur_s2: FloatArray | None = None
    """Variance of the times over which a frequency is a mean, s^2, shape (batch, lines, n);
    0 is missing; None: frequencies are those of an instant."""
    image_patterns: FloatArray | None = None
    """What the image in the surface may do to the mean of all lines, each of one standard
    deviation, shape (patterns, n); None: it is not asked."""

    @property
    def parts(self) -> tuple[slice, slice, slice]:
        """The rows of the frequencies, the bearings and the levels."""
        first, second = self.count[0], self.count[0] + self.count[1]
        return slice(0, first), slice(first, second), slice(second, None)

    @property
    def shift(self) -> Block:
        """The frequencies, over the line's mean and less one."""
        return self._block(self.parts[0])

    @property
    def bearing(self) -> Block:
        """The bearings in radians."""
        return self._block(self.parts[1])

    @property
    def level(self) -> Block:
        """The levels in natural logarithms of power."""
        return self._block(self.parts[2])

    def _block(self, rows: slice) -> Block:
        return Block(self.value[:, rows], self.weight[:, rows])


FRAME_VARIANCE = 0.02622
"""Variance of the times that the frequency of a frame is a mean of, over the square of its
length: a third of the fourth over the second moment of Hann's window, since the peak of a
spectrum is the phase's slope by least squares with the window as its weight."""

ANY_BEARING_RAD = 1.79
"""Deviation from which a bearing may be any: that of one in noise alone is 1.81, and none
is stated with more than 1.8. Neighbours that share their noise are alike, though, and
would be taken for a path that turns."""


def make_blocks(data: PassageData) -> Blocks:
    """Bring measurements into fit units.

    Parameters
    ----------
    data
        Raw measurements.
    """
    frequency = _batched(data.frequency_hz)
    good = np.isfinite(frequency)
    total = np.maximum(good.sum(axis=-1), 1)
    mean = np.where(good, frequency, 0.0).sum(axis=-1) / total
    mean = np.where(mean > 0, mean, 1.0)
    pairs = (
        (frequency / mean[..., None] - 1, data.frequency_std_hz, 1 / mean[..., None]),
        (np.deg2rad(_batched(data.bearing_deg)), data.bearing_std_deg, np.deg2rad(1.0)),
        (_batched(data.level_db) / NEPER_DB, data.level_std_db, 1 / NEPER_DB),
    )
    value = np.concatenate([pair[0] for pair in pairs], axis=1)
    std = np.concatenate(
        [np.broadcast_to(_batched(std) * unit, v.shape) for v, std, unit in pairs], axis=1
    )
    known = np.isfinite(value) & (std > 0) & (std < np.inf)
    count = (pairs[0][0].shape[1], pairs[1][0].shape[1], pairs[2][0].shape[1])
    bearings = slice(count[0], count[0] + count[1])
    known[:, bearings] &= std[:, bearings] < ANY_BEARING_RAD
    heard = data.line_level_db
    given = (data.frequency_correlation, data.bearing_correlation, data.level_correlation)
    return Blocks(
        data.time_s,
        np.where(known, value, 0.0),
        np.where(known, 1 / np.where(known, std, 1.0) ** 2, 0.0),
        np.repeat(given, count),
        count,
        np.repeat(np.eye(3), count, axis=1),
        mean,
        None if heard is None else _batched(heard) / NEPER_DB,
        None
        if data.frame_s is None
        else FRAME_VARIANCE * np.nan_to_num(_batched(data.frame_s)) ** 2,
    )


def _batched(values: FloatArray) -> FloatArray:
    """Give the array one leading batch axis."""
    return values[None] if values.ndim == 2 else values
