"""Pictures of target motion: the tracks of the modes, and estimates over time."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.plotting.style import contact_color, say_nothing_there

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_motions(motions: Motions, ax: "Axes") -> "Axes":
    """Draw every mode's track, seen from own ship at the first measurement.

    A faint track is an unlikely mode; a dotted ray is the bearing of a contact whose
    range is not observable.
    """
    ax.plot(0.0, 0.0, "k^", markersize=6)
    known = motions.range_m[np.isfinite(motions.range_m)]
    ray_m = float(known.max()) if known.size else 1000.0
    for row, name in enumerate(motions.contact):
        color = contact_color(int(name))
        bearing = np.radians(motions.bearing_deg[row])
        if motions.observable[row] and np.isfinite(bearing):
            _draw_track(motions, row, ax, color)
        elif np.isfinite(bearing):
            ax.plot(
                [0.0, ray_m * np.sin(bearing)], [0.0, ray_m * np.cos(bearing)], ":",
                color=color,
            )  # fmt: skip
    if len(ax.lines) == 1:
        say_nothing_there(ax, "no motion is observable")
    ax.set(xlabel="east (m)", ylabel="north (m)")
    ax.set_aspect("equal", adjustable="datalim")
    ax.grid(alpha=0.3)
    return ax


def _draw_track(motions: Motions, row: int, ax: "Axes", color: str) -> None:
    bearing = np.radians(motions.bearing_deg[row])
    start = motions.range_m[row] * np.array([np.sin(bearing), np.cos(bearing)])
    alpha = 0.3 + 0.7 * float(motions.weight[row])
    ax.plot(*start, "o", markersize=4, color=color, alpha=alpha)
    _draw_ellipse(motions, row, start, ax, color)
    course = np.radians(motions.course_deg[row])
    duration_s = motions.now_time_s[row] - motions.time_s[row]
    way = motions.speed_mps[row] * duration_s * np.array([
        np.sin(course), np.cos(course)
    ])  # fmt: skip
    if np.isfinite(way).all():
        end = start + way
        ax.plot(
            *np.stack([start, end], 1), "-", linewidth=1.2, color=color, alpha=alpha
        )
        ax.annotate(
            "", end, start + 0.95 * way,
            arrowprops={"arrowstyle": "->", "color": color, "alpha": alpha},
        )  # fmt: skip


def _draw_ellipse(
    motions: Motions, row: int, start: FloatArray, ax: "Axes", color: str
) -> None:
    """Draw the 95 % ellipse of the position at the first measurement."""
    from matplotlib.patches import Ellipse

    polar = motions.covariance[row, :2, :2]
    if not np.isfinite(polar).all():
        return
    scale = np.diag([1.0, np.radians(motions.range_m[row])])
    spread, axes = np.linalg.eigh(scale @ polar @ scale)
    width, height = 2.0 * 2.448 * np.sqrt(np.maximum(spread, 0.0))
    # the axes are along and across the bearing; the angle counts from east
    tilt = np.degrees(np.arctan2(-axes[1, 0], axes[0, 0]))
    angle = 90.0 - motions.bearing_deg[row] + tilt
    ax.add_patch(Ellipse(tuple(start), width, height, angle=angle, fill=False,
                         color=color))  # fmt: skip


QUANTITIES = {
    "range": ("m", "range at the start (m)"),
    "speed": ("mps", "speed (m/s)"),
    "course": ("deg", "course (deg)"),
    "bearing": ("deg", "bearing at the start (deg)"),
}
"""What can be drawn over time: unit and label."""

WIDEST_DEG = 90.0
"""Half the band of an angle above which it says nothing."""


def draw_updates(motions: Motions, ax: "Axes", quantity: str = "range") -> "Axes":
    """Draw estimates over time with a band of two deviations.

    Parameters
    ----------
    motions
        Motions with estimates over time.
    ax
        Where to draw.
    quantity
        range, speed, course or bearing.
    """
    unit, label = QUANTITIES[quantity]
    values = getattr(motions, f"update_{quantity}_{unit}")
    spread = 2.0 * getattr(motions, f"update_{quantity}_std_{unit}")
    for name in np.unique(motions.update_contact):
        own = motions.update_contact == name
        # before the range is observable the band would fill the picture
        widest = WIDEST_DEG if unit == "deg" else 2.0 * np.abs(values)
        bounded = own & np.isfinite(spread) & (spread < widest)
        middle = values[bounded]
        if unit == "deg":
            middle = np.unwrap(middle, period=360.0)
        color = contact_color(int(name))
        time_s, half = motions.update_time_s[bounded], spread[bounded]
        ax.plot(time_s, middle, ".-", color=color)
        ax.fill_between(time_s, middle - half, middle + half, alpha=0.2, color=color)
    if not any(np.size(line.get_xdata()) for line in ax.lines):
        say_nothing_there(ax, f"the {quantity} is not observable")
    ax.set(xlabel="time (s)", ylabel=label)
    return ax
