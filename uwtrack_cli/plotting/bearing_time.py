"""Pictures of the bearing-time record of an array."""

import numpy as np
from matplotlib.axes import Axes

from uwtrack_cli.arrays.line_array import LineArray
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.plotting import style
from uwtrack_cli.plotting.panels import contact_bearings
from uwtrack_cli.plotting.picture import cell_edges, check_axes
from uwtrack_cli.plotting.style import Span
from uwtrack_cli.plotting.view import Scene

LARGEST_ROWS = 2000
"""Rows of the picture; of longer records the loudest of several frames is drawn."""


PATTERN_POINTS = 721
"""Angles of a beam's pattern."""

BRIGHTEST_SHARE, LEAST_SPAN_DB, MOST_SPAN_DB = 0.998, 3.0, 12.0
"""Share of the record below the brightest colour, and what the colours cover, dB, from
its median on: beams of few hydrophones all hear much of the same."""

MOST_MARKS = 120
"""Angles of a line that are drawn."""


def draw_bearing_time(record: BearingTime, ax: Axes, span_s: Span | None = None) -> Axes:
    """Draw the record: angle from the array's head over time, level as shade.

    Of an array that is no line the angle goes all around, clockwise: from true north
    where its heading is known.

    The shade is the level over the background of all beams, whitened over the band, so
    that a few loud frequencies do not hide the rest.

    ``span_s``: begin and end of what is drawn, s; None is everything.
    """
    check_axes(record.frames, "time_s")
    time_s = record.frames.time_s
    chosen = np.flatnonzero(style.within(time_s, span_s or (-np.inf, np.inf)))
    if not chosen.size:
        return ax
    step = -(-chosen.size // LARGEST_ROWS)
    rows = np.arange(0, chosen.size, step)
    excess_db = np.fmax.reduceat(record.excess_db[chosen], rows, axis=0)
    angle_deg, inside = _angles(record)
    beams = np.broadcast_to(inside, (rows.size, inside.size))
    if is_true(record):  # the beams turn with the array
        turned = np.round(record.heading_deg[chosen][rows] / 360.0 * (inside.size - 1))
        beams = (beams - turned.astype(int)[:, None]) % (inside.size - 1)
    known = excess_db[:, inside][np.isfinite(excess_db[:, inside])]
    dark, bright = np.quantile(known, (0.5, BRIGHTEST_SHARE)) if known.size else (0, 0)
    bright = dark + np.clip(bright - dark, LEAST_SPAN_DB, MOST_SPAN_DB)
    style.draw_cells(
        ax, cell_edges(time_s[chosen][rows]), cell_edges(angle_deg),
        np.take_along_axis(excess_db, beams, axis=1), (float(dark), float(bright)),
        f"dB over the background, {record.band_low_hz:.0f}-{record.band_high_hz:.0f} Hz",
    )  # fmt: skip
    ax.tick_params(labelsize=8)
    widest = 360 if record.cos_angle is None else 180
    ax.set(yticks=range(0, widest + 1, widest // 6), ylim=(widest, 0.0))
    ax.set_ylabel(angle_name(record), fontsize=9)
    return ax


def is_true(record: BearingTime) -> bool:
    """Tell whether angles are given from true north: of an array that is no line."""
    return record.azimuth_deg is not None and bool(np.isfinite(record.heading_deg).all())


def angle_name(record: BearingTime) -> str:
    """Return what the angles of a record are."""
    return "bearing (deg)" if is_true(record) else "angle from ahead (deg)"


def _angles(record: BearingTime) -> tuple[FloatArray, IntArray]:
    """Return the angles of the beams that are drawn, and which they are.

    Around the compass the first is drawn again at 360 degrees.
    """
    if record.cos_angle is None:
        assert record.azimuth_deg is not None  # noqa: S101 - one of the two
        around = np.append(np.arange(record.azimuth_deg.size), 0)
        return np.append(record.azimuth_deg, 360.0), around
    inside = np.flatnonzero(np.abs(record.cos_angle) <= 1.0)
    return np.degrees(np.arccos(record.cos_angle[inside])), inside


def draw_contact_angles(record: BearingTime, scene: Scene, ax: Axes) -> Axes:
    """Draw measured angles of contacts over the record, in the contacts' colours.

    Those that are followed without lines lie below those of lines.
    """
    measured = contact_bearings(scene, has_tables=record.cos_angle is not None)
    for _, number, time_s, bearing_deg, _ in measured:
        angle_deg = _angle_from_ahead(record, time_s, bearing_deg)
        rows = np.flatnonzero(np.isfinite(angle_deg))
        kept = rows[:: max(1, -(-rows.size // MOST_MARKS))]
        ax.plot(time_s[kept], angle_deg[kept], "o", ms=2.6, mew=0.4,
                color=style.contact_color(number), mec="white")  # fmt: skip
    return ax


def _angle_from_ahead(
    record: BearingTime, time_s: FloatArray, bearing_deg: FloatArray
) -> FloatArray:
    if is_true(record):
        return np.mod(bearing_deg, 360.0)
    heading = np.unwrap(record.heading_deg, period=360.0)
    at = np.interp(time_s, record.frames.time_s, heading)
    side = 1.0 if record.side == "starboard" else -1.0
    angle_deg: FloatArray = (bearing_deg - at) % 360.0
    if record.cos_angle is not None:
        angle_deg = (side * angle_deg) % 360.0
        angle_deg = np.minimum(angle_deg, 360.0 - angle_deg)
    return angle_deg


def draw_frequency_azimuth(record: BearingTime, peaks: Peaks, ax: Axes, span_s: Span) -> Axes:
    """Draw at which frequencies and angles peaks were found within a span of time.

    Vertical rows of one frequency are lines; rows of one angle are a vessel.

    ``peaks``: what was found in its beams. ``span_s``: begin and end, s.
    """
    time_s = record.frames.time_s[peaks.frame - record.frames.first_frame]
    at = np.flatnonzero(peaks.is_detection & style.within(time_s, span_s))
    if peaks.cone_deg is not None:
        angle_deg = peaks.cone_deg[at]
    else:
        angle_deg = _angle_from_ahead(record, time_s[at], peaks.bearing_deg[at])
    order = np.argsort(peaks.snr_db[at])
    dots = ax.scatter(
        peaks.frequency_hz[at][order], angle_deg[order], c=peaks.snr_db[at][order],
        s=7.0, cmap=style.LEVELS_MAP, vmin=5.0, vmax=30.0, linewidths=0.0, rasterized=True,
    )  # fmt: skip
    style.color_bar(dots, style.calm(ax), "dB over the noise of the beam")
    widest = 180 if record.cos_angle is not None else 360
    ax.set(xlim=(record.band_low_hz, record.band_high_hz), ylim=(widest, 0.0))
    ax.set(yticks=range(0, widest + 1, 30))
    ax.set_xlabel("frequency (Hz)", fontsize=9)
    ax.set_ylabel(angle_name(record), fontsize=9)
    return ax


def draw_beam_pattern(record: BearingTime, array: LineArray, ax: Axes) -> Axes:
    """Draw what a beam at the side of a line array hears from other angles.

    ``record``: record of the array, which knows its shading. ``ax``: where to draw; its
    angles are those of the panel beside.
    """
    weights = array.weights(record.shading or "uniform", record.sidelobe_db or 30.0)  # type: ignore[arg-type]
    angle_deg = np.linspace(0.0, 180.0, PATTERN_POINTS)
    cosines = np.cos(np.radians(angle_deg))
    frequencies = np.array([0.25, 0.5, 1.0]) * record.band_high_hz
    for frequency_hz, dash in zip(frequencies, (":", "--", "-"), strict=True):
        steering = array.steering(np.array([frequency_hz]), cosines, weights)[0]
        power = np.abs(steering.sum(axis=1)) ** 2
        ax.plot(10.0 * np.log10(np.maximum(power, 1e-9)), angle_deg, dash,
                color=style.MEASURED, lw=0.9, label=f"{frequency_hz:.0f} Hz")  # fmt: skip
    style.calm(ax)
    ax.set(xlim=(-45.0, 2.0), ylim=(180.0, 0.0), yticks=range(0, 181, 30))
    ax.set_xlabel("beam at 90 deg (dB)", fontsize=9)
    ax.legend(fontsize=7, loc="lower left", framealpha=0.9, edgecolor="none")
    return ax


def draw_heading(record: BearingTime, ax: Axes) -> Axes:
    """Draw the compass heading of the array over time, broken where it passes north."""
    heading = style.broken_bearing(record.heading_deg)
    ax.plot(record.frames.time_s, heading, color=style.MEASURED)
    return style.calm(ax, "array heading\n(deg)")
