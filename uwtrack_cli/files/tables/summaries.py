"""Results in the words and digits of a short table, for screens and reports."""

from dataclasses import dataclass
from typing import Any

import numpy as np

Row = dict[str, Any]


@dataclass(frozen=True)
class Head:
    """A column of a summary: title, key of the value, digits, key of its deviation."""

    title: str
    """Heading of the column."""
    key: str
    """Key of the value in a row."""
    digits: int | None = None
    """Decimals; None for text."""
    std: str | None = None
    """Key of the standard deviation; None without one."""

    def text(self, row: Row) -> str:
        """Return the cell of a row; a dash stands for what is not known."""
        value = row.get(self.key)
        if value is None:
            return "-"
        if self.digits is None:
            return str(value)
        deviation = row.get(self.std) if self.std else None
        if deviation is None:
            return f"{value:.{self.digits}f}"
        digits = max(self.digits, _digits(deviation))
        return f"{value:.{digits}f} ± {deviation:.{digits}f}"


SUMMARIES: dict[str, tuple[Head, ...]] = {
    "encounters": (
        Head("contact", "contact"),
        Head("sensor", "sensor"),
        Head("status", "status"),
        Head("time s", "time_s", 1, "time_std_s"),
        Head("speed m/s", "speed_mps", 2, "speed_std_mps"),
        Head("range m", "slant_range_m", 1, "slant_range_std_m"),
        Head("range/speed s", "range_over_speed_s", 2, "range_over_speed_std_s"),
        Head("course deg", "course_deg", 1, "course_std_deg"),
        Head("bearing deg", "bearing_deg", 1, "bearing_std_deg"),
        Head("side", "side"),
    ),
    "fixes": (
        Head("contact", "contact"),
        Head("mode", "mode"),
        Head("weight", "weight", 3),
        Head("time s", "time_s", 1),
        Head("east m", "east_m", 1, "east_std_m"),
        Head("north m", "north_m", 1, "north_std_m"),
        Head("latitude", "latitude", 6),
        Head("longitude", "longitude", 6),
        Head("speed m/s", "speed_mps", 2),
        Head("course deg", "course_deg", 1),
    ),
    "motions": (
        Head("contact", "contact"),
        Head("mode", "mode"),
        Head("weight", "weight", 3),
        Head("range m", "range_m", 0, "range_std_m"),
        Head("bearing deg", "bearing_deg", 2, "bearing_std_deg"),
        Head("speed m/s", "speed_mps", 2, "speed_std_mps"),
        Head("course deg", "course_deg", 1, "course_std_deg"),
        Head("observable", "observable"),
    ),
}
"""Columns of the summary by the name of the container."""


def _digits(deviation: float) -> int:
    """Return the decimals that a deviation needs in order not to be shown as zero."""
    if not deviation > 0.0:
        return 0
    return min(6, int(np.ceil(-np.log10(2.0 * deviation))))
