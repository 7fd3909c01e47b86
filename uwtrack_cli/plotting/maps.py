"""Maps: the track of a vessel past a sensor, and several sensors with their positions."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.acoustics.geometry import compass_unit, place_covariance
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.plotting import style
from uwtrack_cli.plotting.passage import ReportedPassage, passages_of
from uwtrack_cli.plotting.view import Scene

REACH = 2.5
"""Ranges on either side of the closest approach that are shown."""

NICE = (1.0, 2.0, 5.0)
"""First digits of the length of a scale bar."""

NO_DIRECTION = "direction not known"


def place_of(fit: ReportedPassage) -> tuple[FloatArray, FloatArray]:
    """Return the place at closest approach from the sensor, m, and its covariance."""
    where = fit.range_m, fit.value("bearing_deg")
    std = [fit.value("slant_range_std_m"), fit.value("bearing_std_deg")]
    return where[0] * compass_unit(where[1]), place_covariance(*where, np.diag(std) ** 2)


def draw_map(scene: Scene, fit: ReportedPassage, ax: Axes) -> Axes:
    """Draw the track of a vessel past a sensor, north up, with scale and region.

    Another solution of its side is drawn dotted; the track by AIS is grey. Without a
    direction the range is a circle with its band.
    """
    distance, color = max(fit.range_m, 1.0), style.contact_color(fit.number)
    std, reach = np.nan_to_num(fit.value("slant_range_std_m")), REACH * distance
    ax.plot(0.0, 0.0, "^", ms=7, color="black")
    style.name_place(ax, np.zeros(2), str(fit.encounters.sensor[fit.row]), "black", (6, -10))
    if fit.is_mapped:
        place, covariance = place_of(fit)
        ends = draw_track(ax, place, fit.value("course_deg"), reach, fit.number)
        style.draw_ellipse(ax, place, covariance, color)
        ax.plot(*place, "o", ms=3.5, color=color)
        if fit.encounters.ambiguities(fit.row):
            ax.plot(*(-ends).T, ":", color=color, lw=1.0)
        middle, half = 0.5 * place, 1.05 * reach
    else:
        draw_circle(ax, fit.range_m, std, fit.number)
        ax.set_title(NO_DIRECTION, fontsize=8, color=style.MEASURED)
        band = min(style.BAND_DEVIATIONS * std, fit.range_m)
        middle, half = np.zeros(2), 1.35 * max(fit.range_m + band, 1.0)
    _draw_tracks(scene, fit, ax, reach)
    ax.set(xlim=middle[0] + [-half, half], ylim=middle[1] + [-half, half])
    return furnish(ax)


def draw_track(
    ax: Axes, place: FloatArray, course_deg: float, reach_m: float, number: int
) -> FloatArray:
    """Draw a straight track through a place with its direction; return its ends, m."""
    color, heading = style.contact_color(number), compass_unit(course_deg)
    ends = np.stack([place - reach_m * heading, place + reach_m * heading])
    ax.plot(*ends.T, color=color, lw=1.2, linestyle=style.contact_dash(number))
    arrow = place + 0.4 * reach_m * heading, place + 0.62 * reach_m * heading
    style.draw_arrow(ax, *arrow, color)
    return ends


def draw_circle(ax: Axes, range_m: float, std_m: float, number: int) -> None:
    """Draw the range of a vessel whose direction is not known, with its band, m."""
    color, half = style.contact_color(number), style.BAND_DEVIATIONS * std_m
    around = compass_unit(np.arange(0, 361, 2)).T
    inner, outer = max(range_m - half, 0.0) * around, (range_m + half) * around
    ax.plot(*(range_m * around), color=color, lw=1.2, linestyle=style.contact_dash(number))
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
    style.calm(ax, "north (m)")
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
    ax.text(0.04 + 0.5 * share, 0.065, name, ha="center", fontsize=8, transform=ax.transAxes)
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
        ax.plot(east[near], north[near], ".-", ms=3, lw=0.8, color=style.MEASURED, alpha=0.8)
        row = int(np.argmin(np.where(near, np.hypot(east, north), np.inf)))
        place = np.array([east[row], north[row]])
        style.name_place(ax, place, f"AIS {track.vessel}", style.MEASURED, (4, 4))


def has_sensor_map(scenes: Sequence[Scene]) -> bool:
    """Tell whether there are positions, or tracks past several sensors, to draw."""
    fixes = scenes[0].first(Fixes)
    has_fixes = fixes is not None and fixes.time_s.size > 0
    if len(scenes) == 1:
        return has_fixes and scenes[0].encounters is None
    return has_fixes or any(fit.is_mapped for s in scenes for fit in passages_of(s))


def draw_sensor_map(scenes: Sequence[Scene], ax: Axes, ratio: float) -> Axes:
    """Draw sensors, tracks through the closest approaches, and positions.

    The grid is that of the positions; without positions, metres from the first sensor.

    ``ratio``: width of the panel over its height.
    """
    fixes = scenes[0].first(Fixes)
    every = {c.id: c for s in scenes for c in s.containers if isinstance(c, Sensor)}
    places = sensor_places(list(every.values()), fixes)
    for fit in (fit for scene in scenes for fit in passages_of(scene)):
        home, n = places.get(str(fit.encounters.sensor[fit.row])), fit.number
        if home is not None and fit.is_mapped:
            place = np.array(home) + place_of(fit)[0]
            draw_track(ax, place, fit.value("course_deg"), 2.0 * fit.range_m, n)
            style.name_place(ax, place, str(n), style.contact_color(n), (5, 5))
    if fixes is not None:
        _draw_fixes(scenes[0], fixes, ax)
    for name, home in places.items():
        ax.plot(*home, "k^", ms=7)
        style.name_place(ax, np.array(home), name, "black", (6, 5))
    fit_limits(ax, ratio)
    return furnish(ax)


def sensor_places(sensors: list[Sensor], fixes: Fixes | None) -> dict[str, tuple[float, float]]:
    """Return the positions of sensors on the grid of the fixes, m.

    ``sensors``: the sensors; without latitude and longitude their own grid is taken.
    ``fixes``: positions; None without.
    """
    known = {
        s.id: Origin(s.latitude, s.longitude) for s in sensors
        if s.latitude is not None and s.longitude is not None
    }  # fmt: skip
    if not known or len(known) < len(sensors):
        return {s.id: (s.east_m or 0.0, s.north_m or 0.0) for s in sensors}
    origin = next(iter(known.values()))
    if fixes is not None and fixes.origin_latitude is not None:
        origin = Origin(fixes.origin_latitude, fixes.origin_longitude or 0.0)
    return {name: to_grid(where.latitude, where.longitude, origin) for name, where in known.items()}


def _draw_fixes(scene: Scene, fixes: Fixes, ax: Axes) -> None:
    fixes_m = np.stack([fixes.east_m, fixes.north_m], axis=1)
    for k, contact in enumerate(fixes.contact.tolist()):
        color, place = style.contact_color(scene.number(contact)), fixes_m[k]
        if np.isfinite(place).all():
            shade = 0.3 + 0.7 * float(fixes.weight[k])
            ax.plot(*place, "o", ms=4, color=color, alpha=shade)
            style.draw_ellipse(ax, place, fixes.covariance_m2[k], color)
