"""Raw measurements of one contact, gathered from the containers on one time axis.

**Method.** Lines give a frequency and a bearing each, the broadband levels a level and
a bearing. The raw associated measurements are taken, never the smoothed states.

**Conventions.** Missing is nan. Overlapping frames are known to be correlated from
their window and hop.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.estimation.correlation import Kind, overlap_correlation
from uwtrack_cli.estimation.passages.blocks import PassageData


def contact_ids(lines: Lines) -> list[int]:
    """Return the contacts that have a line which is not electrical hum.

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
    frequency, frequency_std, bearing, bearing_std = _line_rows(lines, ids, time)
    level, level_std = np.full((2, 1, time.size), np.nan)
    if levels is not None:
        place = np.searchsorted(time, levels.frames.time_s)
        level[0, place] = levels.excess_db
        level_std[0, place] = levels.excess_std_db
        wide, wide_std = np.full((2, 1, time.size), np.nan)
        wide[0, place] = levels.bearing_deg
        wide_std[0, place] = levels.bearing_std_deg
        bearing = np.concatenate([bearing, wide])
        bearing_std = np.concatenate([bearing_std, wide_std])
    frames = lines.frames if lines is not None else None
    frames = levels.frames if frames is None and levels is not None else frames
    return PassageData(
        time, frequency, frequency_std, bearing, bearing_std, level, level_std,
        _neighbour("frequency", frames),
        _neighbour("bearing", frames),
        _neighbour("level", frames),
    )  # fmt: skip


def _around(levels: Levels, heard_s: FloatArray) -> Levels:
    """Keep the levels while lines were heard, and as long before and after."""
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


def _deviation(
    std: FloatArray, value: FloatArray, period: float | None = None
) -> FloatArray:
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
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    full = np.full((4, ids.size, time.size), np.nan)
    if lines is not None and ids.size:
        points = np.flatnonzero(np.isin(lines.line, ids))
        order = np.argsort(ids)
        row = order[np.searchsorted(ids, lines.line[points], sorter=order)]
        place = np.searchsorted(time, lines.time_s[points])
        for number, values in enumerate(
            (
                lines.measured_frequency_hz,
                lines.measured_frequency_std_hz,
                lines.measured_bearing_deg,
                lines.measured_bearing_std_deg,
            )
        ):
            full[number, row, place] = values[points]
    return full[0], full[1], full[2], full[3]


def _neighbour(kind: Kind, frames: Frames | None) -> float:
    """Correlation of neighbouring frames' errors; zero without overlap."""
    if frames is None or frames.hop_samples >= frames.window_samples:
        return 0.0
    overlap = 1 - frames.hop_samples / frames.window_samples
    values = overlap_correlation(kind, overlap)
    return float(values[0]) if values.size else 0.0
