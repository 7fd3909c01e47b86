"""Maps: the way of a vessel past a sensor, and several sensors with their positions."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.acoustics.geometry import compass_unit, place_covariance
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.plotting.passage_fit import ReportedPassage
from uwtrack_cli.plotting.style import (
    BAND_DEVIATIONS,
    MEASURED,
    calm,
    contact_color,
    contact_dash,
    draw_arrow,
    draw_ellipse,
    name_place,
)
from uwtrack_cli.plotting.view import Scene

REACH = 2.5
"""Ranges on either side of the closest approach that are shown."""

NICE = (1.0, 2.0, 5.0)
"""First digits of the length of a scale bar."""

NO_DIRECTION = "direction not known"


def has_map(encounters: Encounters, row: int) -> bool:
    """Tell whether the way of a passage is known."""
    known = [encounters.bearing_deg[row], encounters.course_deg[row]]
    return has_circle(encounters, row) and bool(np.isfinite(known).all())


def has_circle(encounters: Encounters, row: int) -> bool:
    """Tell whether at least the range of a passage is known."""
    return bool(np.isfinite(range_m(encounters, row)))


def range_m(encounters: Encounters, row: int) -> float:
    """Return the horizontal range at closest approach, else the slant range, m."""
    known = float(encounters.horizontal_range_m[row])
    return known if np.isfinite(known) else float(encounters.slant_range_m[row])


def place_of(encounters: Encounters, row: int) -> tuple[FloatArray, FloatArray]:
    """Return the place at closest approach from the sensor, m, and its covariance."""
    where = range_m(encounters, row), float(encounters.bearing_deg[row])
    std = [encounters.slant_range_std_m[row], encounters.bearing_std_deg[row]]
    covariance = place_covariance(*where, np.diag(std) ** 2)
    return where[0] * compass_unit(where[1]), covariance


def draw_map(scene: Scene, fit: ReportedPassage, ax: Axes) -> Axes:
    """Draw the way of a vessel past a sensor, north up, with scale and region.

    Another solution of its side is drawn dotted; the way by AIS is grey. Without a
    direction the range is a circle with its band.
    """
    found, row, color = fit.encounters, fit.row, contact_color(fit.number)
    distance, course = range_m(found, row), float(found.course_deg[row])
    reach = REACH * max(distance, 1.0)
    middle: FloatArray = np.zeros(2)
    std = np.nan_to_num(float(found.slant_range_std_m[row]))
    half = 1.35 * max(distance + min(BAND_DEVIATIONS * std, distance), 1.0)
    ax.plot(0.0, 0.0, "^", ms=7, color="black")
    name_place(ax, np.zeros(2), str(found.sensor[row]), "black", (6, -10))
    if has_map(found, row):
        place, covariance = place_of(found, row)
        ends = draw_way(ax, place, course, reach, fit.number)
        draw_ellipse(ax, place, covariance, color)
        ax.plot(*place, "o", ms=3.5, color=color)
        if found.ambiguities(row):
            ax.plot(*(-ends).T, ":", color=color, lw=1.0)
        middle, half = 0.5 * place, 1.05 * reach
    else:
        draw_circle(ax, distance, std, fit.number)
        ax.set_title(NO_DIRECTION, fontsize=8, color=MEASURED)
    _draw_tracks(scene, fit, ax, reach)
    ax.set(xlim=(middle[0] - half, middle[0] + half))
    ax.set(ylim=(middle[1] - half, middle[1] + half))
    return furnish(ax)


def draw_way(
    ax: Axes, place: FloatArray, course_deg: float, reach_m: float, number: int
) -> FloatArray:
    """Draw a straight way through a place with its direction; return its ends, m."""
    color, heading = contact_color(number), compass_unit(course_deg)
    ends = np.stack([place - reach_m * heading, place + reach_m * heading])
    ax.plot(*ends.T, color=color, lw=1.2, linestyle=contact_dash(number))
    arrow = place + 0.4 * reach_m * heading, place + 0.62 * reach_m * heading
    draw_arrow(ax, *arrow, color)
    return ends


def draw_circle(ax: Axes, range_m: float, std_m: float, number: int) -> None:
    """Draw the range of a vessel whose direction is not known, with its band, m."""
    color, half = contact_color(number), BAND_DEVIATIONS * std_m
    around = compass_unit(np.arange(0, 361, 2)).T
    inner, outer = max(range_m - half, 0.0) * around, (range_m + half) * around
    ax.plot(*(range_m * around), color=color, lw=1.2, linestyle=contact_dash(number))
    ring = np.concatenate([outer, inner[:, ::-1]], axis=1)
    ax.fill(*ring, color=color, alpha=0.2, lw=0)


def fit_limits(ax: Axes, ratio: float) -> None:
    """Show all that a map holds, in a panel of a given ratio of width to height."""
    box = ax.dataLim
    middle = (0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1))
    half_y = max(0.6 * box.height, 0.6 * box.width / ratio, 1.0)
    ax.set_xlim(middle[0] - ratio * half_y, middle[0] + ratio * half_y)
    ax.set_ylim(middle[1] - half_y, middle[1] + half_y)


def furnish(ax: Axes) -> Axes:
    """Give a map whose limits are set equal scales, a north arrow and a scale bar."""
    calm(ax, "north (m)")
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("east (m)", fontsize=8)
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
    return ax


def scale_length(most_m: float) -> float:
    """Return the longest length of a round number of metres up to a limit.

    Examples
    --------
    >>> scale_length(730.0), scale_length(19.0)
    (500.0, 10.0)
    """
    power = 10.0 ** np.floor(np.log10(max(most_m, 1e-3)))
    return float(max(n * power for n in NICE if n * power <= most_m * (1 + 1e-9)))


def _draw_tracks(scene: Scene, fit: ReportedPassage, ax: Axes, reach_m: float) -> None:
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


def has_sensor_map(scenes: Sequence[Scene]) -> bool:
    """Tell whether there are positions, or ways past several sensors, to draw."""
    fixes = scenes[0].first(Fixes)
    has_fixes = fixes is not None and fixes.time_s.size > 0
    if len(scenes) == 1:
        return has_fixes and not scenes[0].all(Encounters)
    found = [scene.encounters for scene in scenes]
    return has_fixes or any(
        e is not None and any(has_map(e, r) for r in range(e.n_encounters))
        for e in found
    )


def draw_sensor_map(scenes: Sequence[Scene], ax: Axes, ratio: float) -> Axes:
    """Draw sensors, ways through the closest approaches, and positions.

    The grid is that of the positions; without positions, metres from the first sensor.

    ``ratio``: width of the panel over its height.
    """
    fixes = scenes[0].first(Fixes)
    every = {c.id: c for s in scenes for c in s.containers if isinstance(c, Sensor)}
    places = sensor_places(list(every.values()), fixes)
    for found in (scene.encounters for scene in scenes):
        for row in range(0 if found is None else found.n_encounters):
            home = None if found is None else places.get(str(found.sensor[row]))
            if found is None or home is None or not has_map(found, row):
                continue
            place = np.array(home) + place_of(found, row)[0]
            reach = 2.0 * range_m(found, row)
            draw_way(ax, place, float(found.course_deg[row]), reach, row + 1)
            name_place(ax, place, str(row + 1), contact_color(row + 1), (5, 5))
    if fixes is not None:
        _draw_fixes(scenes[0], fixes, ax)
    for name, home in places.items():
        ax.plot(*home, "k^", ms=7)
        name_place(ax, np.array(home), name, "black", (6, 5))
    fit_limits(ax, ratio)
    return furnish(ax)


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


def _draw_fixes(scene: Scene, fixes: Fixes, ax: Axes) -> None:
    for k in range(fixes.time_s.size):
        contact = int(fixes.contact[k])
        color = contact_color(scene.number(contact))
        place = np.array([fixes.east_m[k], fixes.north_m[k]])
        if np.isfinite(place).all():
            shade = 0.3 + 0.7 * float(fixes.weight[k])
            ax.plot(*place, "o", ms=4, color=color, alpha=shade)
            draw_ellipse(ax, place, fixes.covariance_m2[k], color)
