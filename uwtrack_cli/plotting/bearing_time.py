"""Pictures of the bearing-time record of an array."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.plotting.spectra import check_axes
from uwtrack_cli.plotting.style import contact_color

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LARGEST_ROWS = 2000
"""Rows of the picture; of longer records the loudest of several frames is drawn."""


def draw_bearing_time(record: BearingTime, ax: "Axes") -> "Axes":
    """Draw the record: angle from the array's head over time, level as shade.

    The shade is the level over the background of all beams, whitened over the band, so
    that a few loud frequencies do not hide the rest.
    """
    check_axes(record.frames, "time_s")
    n = record.frames.n_frames
    step = -(-n // LARGEST_ROWS)
    rows = np.arange(0, n, step)
    excess_db = np.fmax.reduceat(record.excess_db, rows, axis=0)
    inside = np.abs(record.cos_angle) <= 1.0
    angle_deg = np.degrees(np.arccos(record.cos_angle[inside]))
    image = ax.pcolormesh(
        record.frames.time_s[rows], angle_deg, excess_db[:, inside].T,
        cmap="viridis", vmin=-1.0, vmax=6.0, shading="nearest", rasterized=True,
    )  # fmt: skip
    band = f"{record.band_low_hz:.0f}-{record.band_high_hz:.0f} Hz"
    ax.figure.colorbar(image, ax=ax, label=f"dB above the background\n{band}", pad=0.01)
    ax.set(xlabel="time (s)", ylabel="angle from ahead (deg)", yticks=range(0, 181, 30))
    ax.set_ylim(180.0, 0.0)
    return ax


def draw_line_angles(record: BearingTime, lines: Lines, ax: "Axes") -> "Axes":
    """Draw measured angles of contacts over the record, in the contacts' colours."""
    contacts = dict(
        zip(lines.line_id.tolist(), lines.line_contact.tolist(), strict=True)
    )
    heading = np.unwrap(record.heading_deg, period=360.0)
    at = np.interp(lines.time_s, record.frames.time_s, heading)
    side = 1.0 if record.side == "starboard" else -1.0
    angle_deg = (side * (lines.measured_bearing_deg - at)) % 360.0
    angle_deg = np.minimum(angle_deg, 360.0 - angle_deg)
    for line, contact in contacts.items():
        rows = (lines.line == line) & (contact > 0)
        ax.plot(
            lines.time_s[rows], angle_deg[rows], ".", markersize=1.5,
            color=contact_color(contact),
        )  # fmt: skip
    return ax


def draw_heading(record: BearingTime, ax: "Axes") -> "Axes":
    """Draw the compass heading of the array over time, broken where it passes north."""
    heading = np.mod(record.heading_deg, 360.0)
    jumps = np.abs(np.diff(heading, prepend=heading[:1])) > 180.0
    ax.plot(record.frames.time_s, np.where(jumps, np.nan, heading), color="#444444")
    ax.set(xlabel="time (s)", ylabel="heading of the array (deg)")
    ax.grid(alpha=0.3)
    return ax
