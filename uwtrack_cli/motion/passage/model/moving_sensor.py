"""Closest approaches to a sensor that moves: from relative motion to motion over ground.

**Method.** To a sensor at constant velocity, a vessel at constant velocity passes on a
straight line: all of the fit holds for the relative motion (a moving receiver changes
the law by the square of its Mach number only, which the free rest frequencies take).
Speed, course and side over ground follow by adding the sensor's velocity, which is a
straight line through its navigation around the closest approach. Where the sensor
leaves that line, no passage is given.

**Conventions.** Time, ranges, range over speed, bearing and the covariances stay those
of the relative motion.
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import DataError

WIDTHS = 3.0
"""Range over speed before and after the closest approach for which it must be straight."""

LARGEST_SHARE, LARGEST_M = 0.05, 5.0
"""Departure from a straight line that is allowed: share of the range, or metres."""

VELOCITY_STD_MPS = 0.1
"""Deviation of each component of the sensor's velocity."""

AT_REST_MPS = 0.02
"""Velocity below which a sensor with navigation is taken for a fixed one."""


class SensorMotion(NamedTuple):
    """Straight motion of a sensor around a closest approach."""

    place_m: FloatArray
    """East and north at the closest approach, m, shape (2,)."""
    velocity_mps: FloatArray
    """Velocity east and north, m/s, shape (2,)."""
    departure_m: float
    """Largest distance of the navigation from that motion, m."""


class OverGround(NamedTuple):
    """Motion of a vessel over ground."""

    speed_mps: float
    """Speed, m/s."""
    speed_std_mps: float
    """Its standard deviation, m/s."""
    course_deg: float
    """Compass course, degrees."""
    course_std_deg: float
    """Its standard deviation, degrees."""
    is_starboard: bool
    """Whether the sensor lies to starboard of the vessel at closest approach."""


def sensor_motion(
    navigation: Navigation, start_utc_ns: int | None, time_s: float, width_s: float
) -> SensorMotion:
    """Return the straight motion of a sensor around a closest approach.

    Parameters
    ----------
    navigation
        Positions of the sensor.
    start_utc_ns
        UTC epoch of the first sample, ns; None counts both from the same zero.
    time_s
        Time of closest approach, s.
    width_s
        Range over speed, s.

    Raises
    ------
    DataError
        The navigation has no row around the closest approach.
    """
    known_s = navigation.time_s
    if navigation.start_utc_ns is not None and start_utc_ns is not None:
        known_s = known_s + (navigation.start_utc_ns - start_utc_ns) / NANOSECONDS
    if known_s.size == 0 or not known_s[0] <= time_s <= known_s[-1]:
        covered = f"{known_s[0]:.6g} to {known_s[-1]:.6g} s" if known_s.size else "none"
        raise DataError(
            f"the navigation of the sensor covers {covered}, but a closest approach is "
            f"at {time_s:.6g} s: do both count from the same start (give both UTC)?"
        )
    reach = WIDTHS * width_s
    low, high = max(known_s[0], time_s - reach), min(known_s[-1], time_s + reach)
    wanted = np.unique(np.append(np.linspace(low, high, 61), time_s))
    place = np.stack([
        np.interp(wanted, known_s, navigation.east_m),
        np.interp(wanted, known_s, navigation.north_m),
    ])  # fmt: skip
    lag = wanted - time_s
    design = np.stack([np.ones_like(lag), lag], axis=1)
    (centre, velocity), *_ = np.linalg.lstsq(design, place.T, rcond=None)
    left = place.T - design @ np.stack([centre, velocity])
    return SensorMotion(centre, velocity, float(np.hypot(*left.T).max()))


def over_ground(
    speed_mps: float,
    course_deg: float,
    bearing_deg: float,
    covariance: FloatArray,
    velocity_mps: FloatArray,
) -> OverGround:
    """Add a sensor's velocity to the relative motion of a vessel.

    Parameters
    ----------
    speed_mps
        Relative speed, m/s.
    course_deg
        Relative course, degrees.
    bearing_deg
        Bearing at closest approach, degrees.
    covariance
        Of relative speed (m/s) and course (degrees), shape (2, 2).
    velocity_mps
        Velocity of the sensor, east and north, m/s.

    Examples
    --------
    A vessel that is overtaken at 2 m/s by a sensor that makes 5 m/s north.

    >>> found = over_ground(
    ...     2.0, 180.0, 90.0, np.zeros((2, 2)), np.array([0.0, 5.0]))
    >>> round(found.speed_mps, 6), round(found.course_deg, 6), found.is_starboard
    (3.0, 0.0, False)
    """
    angle = np.radians(course_deg)
    along = np.array([np.sin(angle), np.cos(angle)])
    across = np.array([np.cos(angle), -np.sin(angle)])
    total = speed_mps * along + velocity_mps
    speed = float(np.hypot(*total))
    unit = total / max(speed, 1e-9)
    normal = np.array([unit[1], -unit[0]])
    change = np.stack([along, np.radians(1.0) * speed_mps * across], axis=1)
    moved = change @ covariance @ change.T + VELOCITY_STD_MPS**2 * np.eye(2)
    course = float(np.degrees(np.arctan2(*total)) % 360.0)
    towards = np.radians(bearing_deg + 180.0 - course)
    return OverGround(
        speed,
        float(np.sqrt(unit @ moved @ unit)),
        course,
        float(np.degrees(np.sqrt(normal @ moved @ normal) / max(speed, 1e-9))),
        bool(np.sin(towards) > 0),
    )
