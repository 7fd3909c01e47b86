"""Pictures of tracked lines: frequencies and bearings over time."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.plotting.style import contact_color

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_lines(lines: Lines, ax: "Axes") -> "Axes":
    """Draw the smoothed frequency of every line in the colour of its contact."""
    for name, contact, status in zip(
        lines.line_id, lines.line_contact, lines.line_status, strict=True
    ):
        rows = lines.line == name
        ax.plot(
            lines.time_s[rows], lines.frequency_hz[rows],
            linewidth=0.9, color=contact_color(int(contact)),
            linestyle=":" if status == "hum" else "-",
        )  # fmt: skip
    ax.set(xlabel="time (s)", ylabel="frequency (Hz)")
    return ax


def draw_line_bearings(lines: Lines, ax: "Axes") -> "Axes":
    """Draw the smoothed bearing of every line, broken where it passes north."""
    for name, contact in zip(lines.line_id, lines.line_contact, strict=True):
        rows = lines.line == name
        bearing = _broken(lines.bearing_deg[rows])
        color = contact_color(int(contact))
        ax.plot(lines.time_s[rows], bearing, linewidth=0.9, color=color)
    return ax


def _broken(bearing_deg: FloatArray) -> FloatArray:
    bearing = np.mod(bearing_deg, 360.0)
    jumps = np.abs(np.diff(bearing, prepend=bearing[:1])) > 180.0
    return np.where(jumps, np.nan, bearing)
