"""Every tracked line as one row: mean frequency, life, strength, bearing.

**Conventions.** Means use the raw measurements, not the smoothed states. Errors of
overlapping frames are correlated; a mean of n frames is worth n hops over a window.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray, TextArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.estimation.angles import wrap_deg

LEAST_STD_WINDOWS = 0.02
"""Floor of a mean frequency's deviation, in resolutions."""


MEASURED = (
    "frequency_hz", "frequency_std_hz", "from_s", "to_s", "level_db", "bearing_deg",
    "bearing_std_deg",
)  # fmt: skip
"""Columns of a summary that are measured."""


@dataclass(frozen=True)
class LineSummary(Rows):
    """The lines of one tracker, shape (line,) each."""

    frequency_hz: FloatArray
    """Mean frequency, Hz."""
    frequency_std_hz: FloatArray
    """Standard deviation of that mean, Hz."""
    from_s: FloatArray
    """Time of the first point, s."""
    to_s: FloatArray
    """Time of the last point, s."""
    level_db: FloatArray
    """Median level, dB re the reference."""
    bearing_deg: FloatArray
    """Mean bearing, degrees; nan if unknown."""
    bearing_std_deg: FloatArray
    """Deviation of that mean, degrees."""
    contact: IntArray
    """Contact; 0 for none."""
    family: IntArray
    """Row of its family in the tracker's table; -1 for none."""
    status: TextArray
    """'moving', 'steady' or 'hum'."""
    line_id: IntArray
    """Identifier."""
    resolution_hz: FloatArray
    """Reciprocal of the length of most of its frames, Hz."""


def summarise(lines: Lines) -> LineSummary:
    """Return one row per line of a tracker that has a measurement."""
    overlap = lines.overlap_frames
    window_s = lines.point_window_s
    measured = np.isfinite(lines.measured_frequency_hz)
    keep: list[int] = []
    rows: list[tuple[float, ...]] = []
    resolutions: list[float] = []
    first = np.searchsorted(lines.line, lines.line_id, "left")
    last = np.searchsorted(lines.line, lines.line_id, "right")
    for k, (begin, end) in enumerate(zip(first, last, strict=True)):
        points = slice(int(begin), int(end))
        used = measured[points]
        if not used.any():
            continue
        resolution_hz = 1.0 / _usual(window_s[points])
        frequency = lines.measured_frequency_hz[points][used]
        std = np.asarray(lines.measured_frequency_std_hz[points][used], float)
        weight = 1.0 / np.maximum(std, 1e-6 * resolution_hz) ** 2
        mean = float((weight * frequency).sum() / weight.sum())
        scatter = float((weight * (frequency - mean) ** 2).sum() / weight.sum())
        n_free = max(1.0, used.sum() / overlap)
        own = max(scatter / n_free, overlap / float(weight.sum()))
        deviation = max(float(np.sqrt(own)), LEAST_STD_WINDOWS * resolution_hz)
        bearing = _mean_bearing(
            lines.measured_bearing_deg[points][used], lines.measured_bearing_std_deg[points][used]
        )
        rows.append((
            mean, deviation, float(lines.time_s[begin]), float(lines.time_s[end - 1]),
            float(np.median(lines.measured_level_db[points][used])), *bearing,
        ))  # fmt: skip
        keep.append(k)
        resolutions.append(resolution_hz)
    columns = dict(zip(MEASURED, np.array(rows, float).reshape(len(rows), 7).T, strict=True))
    number = {int(name): row for row, name in enumerate(lines.families.family)}
    family = [number.get(int(name), -1) for name in lines.line_family[keep]]
    return LineSummary(
        **columns,
        contact=lines.line_contact[keep],
        family=np.array(family, np.int64),
        status=lines.line_status[keep],
        line_id=lines.line_id[keep],
        resolution_hz=np.array(resolutions, float),
    )


def _usual(window_s: FloatArray) -> float:
    """Return the length of the frames that tell a line for most of its time, s."""
    lengths, count = np.unique(window_s, return_counts=True)
    return float(lengths[np.argmax(count * lengths)])


def _mean_bearing(bearing_deg: FloatArray, std_deg: FloatArray) -> tuple[float, float]:
    known = np.isfinite(bearing_deg) & np.isfinite(std_deg)
    if not known.any():
        return np.nan, np.nan
    weight = 1.0 / np.maximum(np.asarray(std_deg[known], float), 0.1) ** 2
    angle = np.radians(np.asarray(bearing_deg[known], float))
    east, north = (weight * np.sin(angle)).sum(), (weight * np.cos(angle)).sum()
    mean = float(np.degrees(np.arctan2(east, north)) % 360.0)
    off = wrap_deg(np.degrees(angle) - mean)
    spread = float(np.sqrt((weight * off**2).sum() / weight.sum()))
    return mean, max(spread / np.sqrt(known.sum()), float(1.0 / np.sqrt(weight.sum())))


def common_bearing(lines: LineSummary, rows: IntArray) -> tuple[float, float]:
    """Return the mean bearing of some lines and their spread, degrees; nan if unknown."""
    bearing = lines.bearing_deg[rows]
    std = lines.bearing_std_deg[rows]
    mean, own = _mean_bearing(bearing, std)
    known = bearing[np.isfinite(bearing)]
    if not known.size:
        return mean, own
    return mean, max(float(np.sqrt(np.mean(wrap_deg(known - mean) ** 2))), own)
