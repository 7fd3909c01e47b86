"""The map of a passage: sensor, way of the vessel, region of its place, AIS."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.plotting.passage_fit import ReportedPassage
from uwtrack_cli.plotting.style import (
    MEASURED,
    calm,
    contact_color,
    draw_arrow,
    draw_ellipse,
    name_place,
)
from uwtrack_cli.plotting.view import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REACH = 2.5
"""Ranges on either side of the closest approach that are shown."""

NICE = (1.0, 2.0, 5.0)
"""First digits of the length of a scale bar."""


def has_map(encounters: Encounters, row: int) -> bool:
    """Tell whether enough is known of a passage for a map."""
    known = [
        encounters.bearing_deg[row],
        encounters.course_deg[row],
        range_m(encounters, row),
    ]
    return bool(np.isfinite(known).all())


def range_m(encounters: Encounters, row: int) -> float:
    """Return the horizontal range at closest approach, else the slant range, m."""
    known = float(encounters.horizontal_range_m[row])
    return known if np.isfinite(known) else float(encounters.slant_range_m[row])


def place_of(encounters: Encounters, row: int) -> tuple[FloatArray, FloatArray]:
    """Return the place at closest approach from the sensor, m, and its covariance."""
    distance = range_m(encounters, row)
    bearing = np.radians(encounters.bearing_deg[row])
    along = np.array([np.sin(bearing), np.cos(bearing)])
    across = np.array([along[1], -along[0]])
    across_std = distance * np.radians(encounters.bearing_std_deg[row])
    range_std = float(encounters.slant_range_std_m[row])
    covariance = range_std**2 * np.outer(along, along)
    covariance = covariance + across_std**2 * np.outer(across, across)
    return distance * along, covariance


def draw_map(scene: Scene, fit: ReportedPassage, ax: "Axes") -> "Axes":
    """Draw the way of a vessel past a sensor, north up, with scale and region.

    Another solution of its side is drawn dotted; the way by AIS is grey.
    """
    found, row = fit.encounters, fit.row
    place, covariance = place_of(found, row)
    color = contact_color(fit.contact)
    distance = float(np.hypot(*place))
    course = np.radians(found.course_deg[row])
    heading = np.array([np.sin(course), np.cos(course)])
    reach = REACH * max(distance, 1.0)
    ends = np.stack([place - reach * heading, place + reach * heading])
    ax.plot(*ends.T, color=color, lw=1.2)
    draw_arrow(ax, place + 0.4 * reach * heading, place + 0.62 * reach * heading, color)
    draw_ellipse(ax, place, covariance, color)
    ax.plot(*place, "o", ms=3.5, color=color)
    ax.plot(0.0, 0.0, "^", ms=7, color="black")
    name_place(ax, np.zeros(2), str(found.sensor[row]), "black", (6, -10))
    if found.ambiguities(row):
        ax.plot(*(-ends).T, ":", color=color, lw=1.0)
    _draw_tracks(scene, fit, ax, reach)
    middle = 0.5 * place
    half = 1.05 * reach
    ax.set(xlim=(middle[0] - half, middle[0] + half))
    ax.set(ylim=(middle[1] - half, middle[1] + half))
    furnish(ax)
    return ax


def fit_limits(ax: "Axes", ratio: float) -> None:
    """Show all that a map holds, in a panel of a given ratio of width to height."""
    box = ax.dataLim
    middle = (0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1))
    half_y = max(0.6 * box.height, 0.6 * box.width / ratio, 1.0)
    ax.set_xlim(middle[0] - ratio * half_y, middle[0] + ratio * half_y)
    ax.set_ylim(middle[1] - half_y, middle[1] + half_y)


def furnish(ax: "Axes") -> None:
    """Give a map whose limits are set equal scales, a north arrow and a scale bar."""
    calm(ax)
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("east (m)", fontsize=8)
    ax.set_ylabel("north (m)", fontsize=8)
    ax.tick_params(labelsize=7)
    ax.annotate(
        "N", (0.95, 0.98), (0.95, 0.86), xycoords="axes fraction", fontsize=8,
        ha="center", va="center", arrowprops={"arrowstyle": "-|>", "color": "black"},
    )  # fmt: skip
    low, high = ax.get_xlim()
    length = scale_length(0.25 * (high - low))
    share = length / (high - low)
    ax.plot(
        [0.04, 0.04 + share], [0.05, 0.05], color="black", lw=2.0,
        solid_capstyle="butt", transform=ax.transAxes, clip_on=False,
    )  # fmt: skip
    name = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    ax.text(0.04 + 0.5 * share, 0.065, name, ha="center", fontsize=8,
            transform=ax.transAxes)  # fmt: skip


def scale_length(most_m: float) -> float:
    """Return the longest length of a round number of metres up to a limit.

    Examples
    --------
    >>> scale_length(730.0), scale_length(19.0)
    (500.0, 10.0)
    """
    power = 10.0 ** np.floor(np.log10(max(most_m, 1e-3)))
    return float(max(n * power for n in NICE if n * power <= most_m * (1 + 1e-9)))


def _draw_tracks(
    scene: Scene, fit: ReportedPassage, ax: "Axes", reach_m: float
) -> None:
    """Draw where AIS says that vessels were about the time of the passage."""
    for track in scene.tracks:
        east, north = track.first, track.second
        near = np.hypot(east, north) < 3.0 * reach_m
        near &= np.abs(track.time_s - fit.time_s) < 6.0 * fit.width_s
        if not near.any():
            continue
        ax.plot(east[near], north[near], ".-", ms=3, lw=0.8, color=MEASURED, alpha=0.8)
        row = int(np.argmin(np.where(near, np.hypot(east, north), np.inf)))
        place = np.array([east[row], north[row]])
        name_place(ax, place, f"AIS {track.vessel}", MEASURED, (4, 4))
