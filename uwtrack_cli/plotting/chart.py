"""The map: sensors, tracks through the closest approaches, and positions."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.style import contact_color, say_nothing_there

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_map(
    encounters: Encounters, sensors: list[Sensor], fixes: Fixes | None, ax: "Axes"
) -> "Axes":
    """Draw sensors, tracks through the closest approach, and positions.

    The grid is that of the fixes; without fixes, metres from the first sensor.
    """
    courses = np.flatnonzero(np.isfinite(encounters.course_deg))
    has_fixes = fixes is not None and fixes.time_s.size > 0
    if not has_fixes and not courses.size:
        say_nothing_there(ax, "no course is known")
        return ax
    places = _places(sensors, fixes)
    if fixes is not None:
        _draw_fixes(fixes, ax)
    for row in courses:
        _draw_track(encounters, int(row), places, ax)
    for name, place in places.items():
        ax.plot(*place, "k^", markersize=6)
        ax.annotate(figure_text(name), place, textcoords="offset points", xytext=(5, 5))
    ax.set(xlabel="east (m)", ylabel="north (m)")
    ax.set_aspect("equal", adjustable="datalim")
    ax.grid(alpha=0.3)
    return ax


def _places(
    sensors: list[Sensor], fixes: Fixes | None
) -> dict[str, tuple[float, float]]:
    """Positions of the sensors on the grid of the fixes, m."""
    known = [
        Origin(s.latitude, s.longitude)
        for s in sensors
        if s.latitude is not None and s.longitude is not None
    ]
    if not known or len(known) < len(sensors):
        return {s.id: (s.east_m or 0.0, s.north_m or 0.0) for s in sensors}
    origin = known[0]
    if fixes is not None and fixes.origin_latitude is not None:
        origin = Origin(fixes.origin_latitude, fixes.origin_longitude or 0.0)
    return {
        s.id: to_grid(where.latitude, where.longitude, origin)
        for s, where in zip(sensors, known, strict=True)
    }


def _draw_track(
    encounters: Encounters, row: int, places: dict[str, tuple[float, float]], ax: "Axes"
) -> None:
    range_m = encounters.horizontal_range_m[row]
    if not np.isfinite(range_m):
        range_m = encounters.slant_range_m[row]
    home = places.get(str(encounters.sensor[row]))
    if not np.isfinite(range_m) or home is None:
        return
    bearing = np.radians(encounters.bearing_deg[row])
    course = np.radians(encounters.course_deg[row])
    along = np.linspace(-3.0, 3.0, 50) * range_m
    east = home[0] + range_m * np.sin(bearing) + along * np.sin(course)
    north = home[1] + range_m * np.cos(bearing) + along * np.cos(course)
    color = contact_color(int(encounters.contact[row]))
    ax.plot(east, north, "-", linewidth=1.2, color=color)
    ax.annotate(
        "", (east[-1], north[-1]), (east[-4], north[-4]),
        arrowprops={"arrowstyle": "->", "color": color},
    )  # fmt: skip


def _draw_fixes(fixes: Fixes, ax: "Axes") -> None:
    from matplotlib.patches import Ellipse

    for k in range(fixes.time_s.size):
        color = contact_color(int(fixes.contact[k]))
        ax.plot(fixes.east_m[k], fixes.north_m[k], "o", markersize=4, color=color)
        covariance = fixes.covariance_m2[k]
        if np.isfinite(covariance).all():
            spread, axes = np.linalg.eigh(covariance)
            width, height = 2.0 * 2.448 * np.sqrt(np.maximum(spread, 0.0))
            angle = np.degrees(np.arctan2(axes[1, 0], axes[0, 0]))
            place = (fixes.east_m[k], fixes.north_m[k])
            ax.add_patch(
                Ellipse(place, width, height, angle=angle, fill=False, color=color)
            )
