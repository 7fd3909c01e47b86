"""The map of several sensors: where they are, ways of vessels, and positions."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.plotting.passage_map import fit_limits, furnish, has_map, range_m
from uwtrack_cli.plotting.style import (
    contact_color,
    contact_dash,
    draw_arrow,
    draw_ellipse,
    name_place,
)
from uwtrack_cli.plotting.view import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REACH = 2.0
"""Ranges on either side of the closest approach that are drawn."""


def has_sensor_map(scenes: Sequence[Scene]) -> bool:
    """Tell whether there are positions, or ways past several sensors, to draw."""
    fixes = scenes[0].first(Fixes)
    if len(scenes) == 1:
        alone = not scenes[0].all(Encounters)
        return alone and fixes is not None and fixes.time_s.size > 0
    if fixes is not None and fixes.time_s.size:
        return True
    found = [scene.encounters for scene in scenes]
    return any(e is not None and any(has_map(e, r) for r in range(e.n_encounters))
               for e in found)  # fmt: skip


def draw_sensor_map(scenes: Sequence[Scene], ax: "Axes", ratio: float) -> "Axes":
    """Draw sensors, ways through the closest approaches, and positions.

    The grid is that of the positions; without positions, metres from the first sensor.

    ``ratio``: width of the panel over its height.
    """
    fixes = scenes[0].first(Fixes)
    every = {c.id: c for s in scenes for c in s.containers if isinstance(c, Sensor)}
    places = sensor_places(list(every.values()), fixes)
    for scene in scenes:
        encounters = scene.encounters
        for row in range(0 if encounters is None else encounters.n_encounters):
            if encounters is not None and has_map(encounters, row):
                _draw_way(encounters, row, places, ax)
    if fixes is not None:
        _draw_fixes(fixes, ax)
    for name, place in places.items():
        ax.plot(*place, "k^", ms=7)
        name_place(ax, np.array(place), name, "black", (6, 5))
    fit_limits(ax, ratio)
    furnish(ax)
    return ax


def sensor_places(
    sensors: list[Sensor], fixes: Fixes | None
) -> dict[str, tuple[float, float]]:
    """Return the positions of sensors on the grid of the fixes, m.

    ``sensors``: the sensors; without latitude and longitude their own grid is taken.
    ``fixes``: positions; None without.
    """
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


def _draw_way(
    encounters: Encounters, row: int, places: dict[str, tuple[float, float]], ax: "Axes"
) -> None:
    home = places.get(str(encounters.sensor[row]))
    if home is None:
        return
    distance = range_m(encounters, row)
    bearing = np.radians(encounters.bearing_deg[row])
    course = np.radians(encounters.course_deg[row])
    heading = np.array([np.sin(course), np.cos(course)])
    middle = np.array(home) + distance * np.array([np.sin(bearing), np.cos(bearing)])
    reach = REACH * distance
    ends = np.stack([middle - reach * heading, middle + reach * heading])
    contact = int(encounters.contact[row])
    color = contact_color(contact)
    ax.plot(*ends.T, color=color, lw=1.2, linestyle=contact_dash(contact))
    draw_arrow(
        ax, middle + 0.5 * reach * heading, middle + 0.7 * reach * heading, color
    )
    name_place(ax, middle, str(contact), color, (5, 5))


def _draw_fixes(fixes: Fixes, ax: "Axes") -> None:
    for k in range(fixes.time_s.size):
        color = contact_color(int(fixes.contact[k]))
        place = np.array([fixes.east_m[k], fixes.north_m[k]])
        if not np.isfinite(place).all():
            continue
        ax.plot(
            *place, "o", ms=4, color=color, alpha=0.3 + 0.7 * float(fixes.weight[k])
        )
        draw_ellipse(ax, place, fixes.covariance_m2[k], color)
