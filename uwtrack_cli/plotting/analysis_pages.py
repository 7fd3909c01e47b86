"""Pages of the analyses beside the chain: target motion, clutter, which contact moves.

**Method.** The map of a target's motion has own ship's track and every mode from the
first measurement to the last, with its 95 % regions where each leg begins; a dashed line is
an alteration, a faint track an unlikely mode, a dotted ray the bearing of a target whose
range is not observable. Residuals are those of the best mode under the model that it was
fitted with, in degrees and in hertz; upright lines part its legs. A target
in clutter has its track among the measurements, and how the threshold followed it. A
decision has the log odds of each pair, and the four terms they rest on, over scans.

**Conventions.** The map's origin is own ship at the first measurement, north up.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uwtrack_cli.acoustics.geometry import compass_unit, place_covariance
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.constants import SOURCE_DEPTH_M
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.bearing_time import MIRROR, BearingTime
from uwtrack_cli.data.decisions import FILTERS, Decision
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.targets import Target
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.files.tables.json_rows import Row, json_rows
from uwtrack_cli.files.tables.summaries import utc_text
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.motion.target_motion import inputs, own_ship
from uwtrack_cli.motion.target_motion.inputs import Measurements
from uwtrack_cli.motion.target_motion.model import Alteration, predict_values
from uwtrack_cli.motion.target_motion.own_ship import OwnPath
from uwtrack_cli.plotting import layout, style
from uwtrack_cli.plotting.layout import HeadLine, PagePart
from uwtrack_cli.plotting.maps import fit_limits, furnish
from uwtrack_cli.plotting.passage import reasons_once, speed_text, value_text
from uwtrack_cli.plotting.style import Clock
from uwtrack_cli.plotting.view import Scene, Units, View

MAP_IN = 5.4
"""Height of the map, inches."""

WIDEST = 1.0
"""Half of a band, as a share of the range, above which an estimate is not drawn."""

LEAST_SHARE = 0.005
"""Share of the range's variance from which a nuisance is named."""

UNIT_WORDS = {"mps": "m/s"}
"""Units in words where a name writes them otherwise."""

LIKELY = 0.3
"""How visible a mode of no weight is."""


MANY_POINTS = 200
"""Rows from which residuals are drawn as small dots, lest they hide each other."""

STATE = (
    ("range_m", "", 0, "m"), ("bearing_deg", "in ", 1, "deg"), ("speed_mps", "", 1, ""),
    ("course_deg", "course ", 0, "deg"),
)  # fmt: skip
"""What is said of a state: column, words before it, decimals, unit."""


class PlottedResiduals(NamedTuple):
    """What the best mode of a contact leaves of its measurements."""

    contact: int
    """The contact."""
    time_s: FloatArray
    """Times of the rows, s, shape (row,)."""
    bearing_deg: FloatArray
    """Measured less predicted bearings, degrees, shape (stream, row); nan if none."""
    frequency_hz: FloatArray
    """Measured less predicted frequencies, Hz, shape (line, row); nan if none."""


def target_motion_figure(scene: Scene, contact: int | None, view: View) -> Figure:
    """Return the page of a target's motion.

    ``scene``: motions, and what they were estimated from. ``contact``: the contact;
    None is all of them. ``view``: how wide the page is, and which time it shows.

    Raises
    ------
    DataError
        There are no motions to draw.
    """
    motions = scene.first(Motions)
    if motions is None or not motions.contact.size:
        raise DataError("no motion was estimated, so there is none to draw.")
    if contact is not None:
        motions = motions.take("motion", np.flatnonzero(motions.contact == contact))
        own = np.flatnonzero(motions.update_contact == contact)
        motions = motions.take("update", own)
    parts = _parts(scene, motions)
    first, last = float(motions.time_s.min()), float(motions.now_time_s.max())
    span_s = view.span_s((first, max(last, first + 1.0)), scene.clock)
    heads = _heads(motions, scene.clock, view.units)
    tracks = measured_from(scene)
    left = layout.alone(MAP_IN if view.is_wide else 0.95 * view.width_in,
                 lambda ax: draw_motion_map(motions, tracks, ax))  # fmt: skip
    if not parts:
        return layout.page_figure(heads, view, [left._replace(height=0.7 * view.width_in)])
    ticks = 5 if view.is_wide else view.ticks
    right = layout.timed(parts, view, scene.clock, span_s, ticks)
    return layout.page_figure(heads, view, [left, right], (1.0, 1.05) if view.is_wide else ())


def _heads(motions: Motions, clock: Clock, units: Units) -> list[HeadLine]:
    """Return the state now of the best mode of every contact, and what else is said."""
    found: list[HeadLine] = []
    for row in (row for row in json_rows(motions) if row["mode"] == 1):
        found += [HeadLine(_state(row, units)), HeadLine(_now(row, clock))]
        if others := int(np.sum(motions.contact == row["contact"])) - 1:
            text = f"{others} other motion{'' if others == 1 else 's'} fit about as well; "
            found.append(HeadLine(f"{text}this one has the weight {row['weight']:.2f}"))
        told = _legs_told(row, units)
        if (motions.contact == row["contact"]).all():  # else they stand on its own page
            told += _nuisances_told(row) + reasons_once([row])
        found += [HeadLine(text) for text in told]
    return found


def _state(row: Row, units: Units) -> str:
    parts = [f"contact {row['contact']}"]
    for key, before, digits, unit in STATE:
        if key == "speed_mps":
            parts.append(speed_text(row, units))
        elif row[key] is not None:
            parts.append(f"{before}{value_text(row, key, digits)} {unit}")
    return "   ".join(filter(None, parts))


def _legs_told(row: Row, units: Units) -> list[str]:
    """Return every leg behind an alteration in words."""
    legs = row["legs"] or []
    return [
        f"leg {leg['number']} of {len(legs)} from "
        f"{value_text(leg, 'alteration_time_s', 0)} s:   {speed_text(leg, units)}"
        + (
            f"   course {value_text(leg, 'course_deg', 1)} deg"
            if leg["course_deg"] is not None
            else ""
        )
        for leg in legs[1:]
    ]


def _nuisances_told(row: Row) -> list[str]:
    """Return what is not known exactly, with its share of the range's variance."""
    told = [
        f"{name.rpartition('_')[0].replace('_', ' ')} ± {one['std']:g} "
        f"{UNIT_WORDS.get(name.rpartition('_')[2], name.rpartition('_')[2])} "
        f"({100 * one['share']:.0f} %)"
        for name, one in (row["nuisances"] or {}).items()
        if one["std"] is not None and (one["share"] or 0.0) >= LEAST_SHARE
    ]
    offsets = [f"{name} {value:+.1f} deg" for name, value in (row["offsets_deg"] or {}).items()
               if value is not None]  # fmt: skip
    found = []
    if told:
        found.append(f"not known exactly (share of the range's variance): {', '.join(told)}")
    if offsets:
        found.append(f"offsets of the bearings: {', '.join(offsets)}")
    return found


def motion_states(motions: Motions, units: Units) -> list[str]:
    """Return the best mode of every contact in words, speeds in a unit."""
    return [_state(row, units) for row in json_rows(motions) if row["mode"] == 1]


def _now(row: Row, clock: Clock) -> str:
    begin = f"{utc_text(row['time_utc'])} UTC" if row["time_utc"] else ""
    text = f"state at the first measurement, {begin or format(row['time_s'], '.0f') + ' s'}"
    if row["now_range_m"] is None:
        return text
    end = clock.text(row["now_time_s"]) + " s" * (clock.start_utc_ns is None)
    bearing = value_text(row, "now_bearing_deg", 1)
    now = f"{value_text(row, 'now_range_m', 0)} m in {bearing} deg"
    return f"{text} \u00b7 at the last one, {end}: {now}"


def draw_motion_map(
    motions: Motions, tracks: Sequence[tuple[str, OwnPath]], ax: Axes, ratio: float = 1.0
) -> Axes:
    """Draw the tracks of what measured, and every mode's track and regions.

    ``tracks``: name and track of own ship, or of every sensor, the one first from which the
    ranges count; none is a platform that stands still. ``ratio``: width of the panel
    over its height.
    """
    known = motions.range_m[np.isfinite(motions.range_m)]
    ray_m = float(known.max()) if known.size else 1000.0
    grid = np.linspace(motions.time_s.min(), motions.now_time_s.max(), 200)
    origin = np.stack(tracks[0][1].at(grid[:1])) if tracks else np.zeros((2, 1))
    places = [(name, np.stack(path.at(grid if path.time_s.size > 1 else path.time_s)))
              for name, path in tracks]  # fmt: skip
    for name, place in places or [("own ship", origin)]:
        track = place - origin
        if np.ptp(track, axis=1).max() > 1.0:
            ax.plot(*track, color="black", lw=1.4)
            style.draw_arrow(ax, track[:, -6], track[:, -1], "black")
        ax.plot(*track[:, 0], "k^", ms=7)
        style.name_place(ax, track[:, 0], name, "black", (6, -12))
    for row in range(motions.contact.size):
        _draw_mode(motions, row, ray_m, ax)
    fit_limits(ax, ratio)
    return furnish(ax)


def _draw_mode(motions: Motions, row: int, ray_m: float, ax: Axes) -> None:
    color = style.contact_color(int(motions.contact[row]))
    distance_m, bearing_deg = motions.range_m[row], motions.bearing_deg[row]
    along = compass_unit(bearing_deg)
    if not np.isfinite(along).all():
        return
    if not (motions.observable[row] and np.isfinite(distance_m)):
        ax.plot(*np.stack([0 * along, ray_m * along], 1), ":", color=color)
        return
    alpha = LIKELY + (1 - LIKELY) * float(motions.weight[row])
    start = distance_m * along
    spread = place_covariance(distance_m, bearing_deg, motions.covariance[row, :2, :2])
    ax.plot(*start, "o", ms=4, color=color, alpha=alpha)
    style.draw_ellipse(ax, start, spread, color, 0.25 * alpha)
    name = f"{motions.contact[row]}"
    if (motions.contact == motions.contact[row]).sum() > 1:
        name += f", mode {motions.mode[row]} ({100 * motions.weight[row]:.0f} %)"
    style.name_place(ax, start, name, color, (9, 9))
    if np.isfinite(path := _path(motions, row)).all():
        _draw_legs(motions, row, path, ax, alpha)


def _draw_legs(motions: Motions, row: int, path: FloatArray, ax: Axes, alpha: float) -> None:
    """Draw the legs of a motion, the alterations between them, and their regions."""
    color = style.contact_color(int(motions.contact[row]))
    for begin, end in zip(path[:-1:2], path[1::2], strict=True):
        ax.plot(*np.stack([begin, end], 1), "-", lw=1.3, color=color, alpha=alpha)
    for end, begin in zip(path[1:-1:2], path[2::2], strict=True):
        ax.plot(*np.stack([end, begin], 1), "--", lw=1.0, color=color, alpha=alpha)
        ax.plot(*begin, "o", ms=3, color=color, alpha=alpha)
    seen = [
        (leg["range_m"], leg["bearing_deg"], leg["range_std_m"], leg["bearing_std_deg"])
        for leg in motions.ragged("legs", row)[1:]
    ]
    seen.append((
        motions.now_range_m[row], motions.now_bearing_deg[row],
        motions.now_range_std_m[row], motions.now_bearing_std_deg[row],
    ))  # fmt: skip
    for place, (distance_m, bearing_deg, *std) in zip([*path[2::2], path[-1]], seen, strict=True):
        spread = place_covariance(distance_m, bearing_deg, np.diag(std) ** 2)
        style.draw_ellipse(ax, place, spread, color, 0.25 * alpha)
    end = path[-1]
    style.draw_arrow(ax, end - 0.1 * (end - path[-2]), end, color, alpha)
    ax.plot(*end, "s", ms=4, color=color, alpha=alpha)


def motion_legs(motions: Motions, row: int) -> dict[str, FloatArray]:
    """Return what is told of the legs of a motion, each by its key, shape (legs,)."""
    legs = motions.ragged("legs", row)
    keys = legs[0] if legs else {}
    return {key: np.array([leg[key] for leg in legs], float) for key in keys}


def motion_state(motions: Motions, row: int) -> FloatArray:
    """Return state (x, y, vx, vy), m and m/s, and alterations of a motion, as fitted."""
    state = np.concatenate([
        motions.range_m[row] * compass_unit(motions.bearing_deg[row]),
        motions.speed_mps[row] * compass_unit(motions.course_deg[row]),
    ])  # fmt: skip
    legs = motion_legs(motions, row)
    if not legs:
        return state
    velocity = legs["speed_mps"] * compass_unit(legs["course_deg"]).T
    duration = np.maximum(legs["start_s"][1:] - legs["end_s"][:-1], 1e-3)
    middle = legs["alteration_time_s"][1:] - motions.time_s[row]
    changes = np.stack([*np.diff(velocity, axis=1), middle, np.log(duration)], 1)
    return np.concatenate([state, changes.ravel()])


def _path(motions: Motions, row: int) -> FloatArray:
    """Return where the legs of a motion begin and end, east and north, (2 legs, 2)."""
    state, legs = motion_state(motions, row), motion_legs(motions, row)
    first = float(motions.time_s[row])
    times = np.array([first, float(motions.now_time_s[row])])
    if legs:
        times = np.stack([legs["start_s"], legs["end_s"]], 1).ravel()
    since = times[np.newaxis] - first
    path = state[:2, np.newaxis] + state[2:4, np.newaxis] * since
    for one in Alteration.of(state[np.newaxis], since):
        path = path + np.concatenate([one.way.real, one.way.imag])
    return path.T


def _measured(scene: Scene) -> list[Measurements]:
    series, lines = scene.first(Series), scene.first(Lines)
    if series is not None:
        return inputs.measurements_from_series(series)
    return [] if lines is None else inputs.measurements_from_lines(lines)


def measured_from(scene: Scene) -> list[tuple[str, OwnPath]]:
    """Return name and track of own ship or of every sensor, the reference first."""
    measured = _measured(scene)
    try:
        paths, sensor = _paths(scene, measured[0])
    except (DataError, IndexError):
        return []
    if (platforms := measured[0].platforms) is None:
        return [("own ship", paths[0])] if paths[0].time_s.size > 1 else []
    tracks = list(zip(platforms.name, paths, strict=True))
    return [tracks.pop(int(sensor[0])), *tracks]


def _paths(scene: Scene, data: Measurements) -> tuple[list[OwnPath], IntArray]:
    """Return the track of every platform, of an array its own, and each row's platform."""
    if data.platforms is not None:
        return inputs.sensor_paths(data, data.platforms), data.platforms.sensor
    record, sensor = scene.first(BearingTime), scene.first(Sensor)
    track = scene.first(Navigation) or (None if sensor is None else sensor.navigation)
    if record is not None and np.isfinite(record.east_m).all():
        track = Navigation(
            time_s=record.frames.time_s, east_m=record.east_m, north_m=record.north_m,
            heading_deg=record.heading_deg,
        )  # fmt: skip
    return [inputs.own_path(track, data)], np.zeros(data.time_s.size, np.int64)


def motion_residuals(scene: Scene, motions: Motions, data: Measurements) -> PlottedResiduals | None:
    """Return what the best mode of a contact leaves of its measurements.

    ``scene``: where own ship was, and how deep the sensor lies.

    None where the range is not observable, or own ship's track is not known.
    """
    is_best = (motions.contact == data.contact) & (motions.mode == 1)
    rows = np.flatnonzero(is_best & motions.observable)
    if not rows.size:
        return None
    row = int(rows[0])
    state = motion_state(motions, row)
    try:
        paths, sensor = _paths(scene, data)
    except DataError:
        return None
    if not np.isfinite(state).all():
        return None
    steps = np.diff(np.unique(data.time_s))  # several sensors share instants
    interval_s = data.window_s or (float(np.median(steps)) if steps.size else 1.0)
    doppler: own_ship.Doppler = "interval" if motions.doppler == "interval" else "instantaneous"
    track = own_ship.make_sensors_track(paths, sensor, data.time_s, doppler, interval_s)
    hydrophone = scene.first(Sensor)
    depth = None if hydrophone is None else hydrophone.depth_m
    medium = Medium(
        motions.sound_speed_mps, 0.0 if depth is None else depth - SOURCE_DEPTH_M,
        is_delayed=motions.propagation == "delayed",
    )  # fmt: skip
    bearing, rate = (one[0] for one in predict_values(track, state[None], medium))
    left = wrap_deg(data.bearing_deg - np.degrees(bearing))
    record = scene.first(BearingTime)
    if record is not None and record.ambiguity == MIRROR:
        heading = np.degrees(paths[0].heading_at(data.time_s))
        mirrored = wrap_deg(2 * heading - data.bearing_deg - np.degrees(bearing))
        left = np.where(np.abs(mirrored) < np.abs(left), mirrored, left)
        # an array's heading has an offset
        left = left - np.nansum(left) / max(1, np.isfinite(left).sum())
    shift = 1.0 - rate / motions.sound_speed_mps
    at_rest = np.full((data.line_id.size, 1), np.nan)
    for k in np.flatnonzero(motions.rest_motion == row):
        at_rest[data.line_id == motions.rest_line_id[k]] = motions.rest_frequency_hz[k]
    off_hz = data.frequency_hz - at_rest * shift
    return PlottedResiduals(data.contact, data.time_s, left, off_hz)


def _parts(scene: Scene, motions: Motions) -> list[PagePart]:
    """Return residuals of bearing and frequency, and the range over time."""
    each = [motion_residuals(scene, motions, data) for data in _measured(scene)]
    left, parts = [found for found in each if found is not None], []
    for name, unit in (("bearing_deg", "deg"), ("frequency_hz", "Hz")):
        if any(np.isfinite(getattr(found, name)).any() for found in left):
            label = f"{name.partition('_')[0]} residual\n({unit})"
            parts.append(
                PagePart(1.5, partial(_draw_residuals, left, name, label, _alterations_s(motions)))
            )
    if _bounded(motions).any():
        parts.append(PagePart(1.7, partial(draw_ranges, motions)))
    return parts


def _alterations_s(motions: Motions) -> FloatArray:
    """Return the middles of all alterations of best modes, s."""
    legs = [motion_legs(motions, int(row)) for row in np.flatnonzero(motions.mode == 1)]
    told = [one["alteration_time_s"][1:] for one in legs if one]
    return np.concatenate([np.empty(0), *told])


def _draw_residuals(
    left: Sequence[PlottedResiduals], name: str, label: str, altered_s: FloatArray, ax: Axes
) -> None:
    style.calm(ax, label).axhline(0.0, color=style.MEASURED, lw=0.8)
    for time_s in altered_s:
        ax.axvline(time_s, color=style.MEASURED, lw=0.8, ls="--")
    for found in left:
        size = 3 if found.time_s.size > MANY_POINTS else 6
        ax.plot(found.time_s, getattr(found, name).T, ".", ms=size, alpha=0.6,
                mec="none", color=style.contact_color(found.contact))  # fmt: skip


def _bounded(motions: Motions) -> BoolArray:
    """Tell which estimates over time say something of the range."""
    half = style.BAND_DEVIATIONS * motions.update_range_std_m
    bounded: BoolArray = half < WIDEST * motions.update_range_m
    return bounded


def draw_ranges(motions: Motions, ax: Axes) -> Axes:
    """Draw the estimates of the range at the start over time, with their bands.

    Before the range is observable the band would fill the picture: it is left out.
    """
    style.calm(ax, "range at the start,\nas known then (m)")
    bounded = _bounded(motions)
    for name in np.unique(motions.update_contact):
        own = bounded & (motions.update_contact == name)
        half = style.BAND_DEVIATIONS * motions.update_range_std_m[own]
        time_s, middle = motions.update_time_s[own], motions.update_range_m[own]
        color = style.contact_color(int(name))
        style.draw_band(ax, time_s, middle, half, color, marker=".", lw=1.0)
    return ax


def target_figure(scene: Scene, view: View) -> Figure:
    """Return the tracks of targets among false measurements, and their threshold.

    Raises
    ------
    DataError
        There is no track, or it holds no scan.
    """
    target, scans = scene.first(Target), scene.first(Scans)
    if target is None or not target.scan.size:
        raise DataError("the track holds no scan, so there is nothing to draw.")
    blocks = [layout.alone(5.4, partial(draw_target, target, scans)),
              layout.alone(2.6, partial(draw_threshold, target))]  # fmt: skip
    return layout.page_figure([HeadLine("Track in clutter")], view, blocks)


def decision_figure(scene: Scene, view: View) -> Figure:
    """Return the odds between two contacts over the scans, and what they rest on.

    Raises
    ------
    DataError
        No contacts were compared.
    """
    decision = scene.first(Decision)
    if decision is None or not decision.scan_time_s.size:
        raise DataError("no contacts were compared, so there is nothing to draw.")
    blocks = [layout.alone(4.0, partial(draw, decision)) for draw in (draw_odds, draw_terms)]
    return layout.page_figure([HeadLine("Which one moves")], view, blocks)


def draw_target(target: Target, scans: Scans | None, ax: Axes) -> Axes:
    """Draw the track with its 95 % regions, and the measurements where given.

    Two or more components are drawn as a map of the first two, one over time.
    """
    is_map, lost = target.component.size > 1, target.lost
    # ranges, bearings and rates are measured of what is drawn in east and north
    if scans is not None and scans.component.tolist() == target.component.tolist():
        first = scans.measured[:, 0]
        across = (first, scans.measured[:, 1]) if is_map else (scans.time_s, first)
        ax.plot(*across, ".", ms=1.5, color=style.NO_CONTACT, zorder=1, label="measurements")
    for number, own in enumerate(target.targets, 1):
        color = style.contact_color(number)
        if not is_map:
            half = 1.96 * own.state_std[:, 0]
            style.draw_band(ax, own.time_s, own.state[:, 0], half, color)
            continue
        ax.plot(own.state[:, 0], own.state[:, 2], "-o", markersize=2, color=color)
        for mean, covariance in zip(own.state, own.state_covariance, strict=True):
            place = covariance[np.ix_([0, 2], [0, 2])]
            style.draw_ellipse(ax, mean[[0, 2]], place, color, alpha=0.1)
    place = target.state[:, [0, 2]] if is_map else None
    lost_at = (target.time_s, target.state[:, 0]) if place is None else tuple(place.T)
    ax.plot(*(one[lost] for one in lost_at), "kx", label="lost")
    ax.legend(fontsize=8)
    names = [f"{name} ({unit})" if unit else str(name) for name, unit in
             zip(target.component, target.component_unit, strict=True)]  # fmt: skip
    names = list(map(figure_text, names if is_map else ["time (s)", *names]))
    ax.set(xlabel=names[0], ylabel=names[1])
    if place is not None:  # clutter may fill a window many times the track's size
        variance = target.state_std[:, [0, 2]] ** 2
        reach = 4.0 * np.sqrt(np.nanmedian(variance, axis=0))
        low, high = place.min(axis=0) - reach, place.max(axis=0) + reach
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return style.calm(ax)


def draw_threshold(target: Target, ax: Axes) -> Axes:
    """Draw the threshold used at each scan, and the score for a lost target."""
    for number, own in enumerate(target.targets, 1):
        ax.step(own.time_s, own.threshold, where="mid", color=style.contact_color(number))
    ax.set(xlabel="time (s)", ylabel=f"threshold ({figure_text(target.threshold_rule)})")
    other = ax.twinx()
    for own in target.targets:
        other.fill_between(own.time_s, own.loss_cusum, step="mid", alpha=0.2, color="k")
    other.set(ylim=(0.0, None))
    other.set_ylabel("score of loss", fontsize=8)
    other.tick_params(labelsize=8)
    return style.calm(ax)


def draw_odds(decision: Decision, ax: Axes) -> Axes:
    """Draw the log odds of every pair over time, with thresholds and decisions."""
    for pair, verdict in enumerate(decision.verdict):
        rows, color = decision.scan_pair == pair, style.contact_color(pair + 1)
        first, second = decision.first_contact[pair], decision.second_contact[pair]
        name = figure_text(f"{first} or {second}: {verdict}")
        ax.plot(decision.scan_time_s[rows], decision.log_odds[rows], "o-", ms=3,
                color=color, label=name)  # fmt: skip
        ax.plot(decision.decision_time_s[pair], decision.final_log_odds[pair], "s",
                ms=9, fillstyle="none", color=color)  # fmt: skip
    for level in (decision.lower_threshold, decision.upper_threshold):
        ax.axhline(level, linestyle="--", linewidth=0.8, color="k")
    ax.set(xlabel="time (s)", ylabel="log odds (second moves)")
    ax.legend(loc="best", fontsize="small")
    return style.calm(ax)


def draw_terms(decision: Decision, ax: Axes) -> Axes:
    """Draw the four log likelihoods of the first pair over time."""
    rows = decision.scan_pair == 0
    for index, name in enumerate(FILTERS):
        dash = "-" if index < 2 else "--"
        fit = decision.consistency[0, index]
        ax.plot(
            decision.scan_time_s[rows], decision.log_likelihood[rows, index], dash,
            color=style.contact_color(index + 1), label=f"{name} (p = {fit:.2g})",
        )  # fmt: skip
    ax.set(xlabel="time (s)", ylabel="log likelihood")
    ax.legend(loc="best", fontsize="small")
    return style.calm(ax)
