"""Where own ship is, and how fast, when something is measured from her.

**Method.** Straight lines between the rows of her navigation, and between the central
differences of these; where she turns, the rows leave her position and velocity open.

**Conventions.** Metres east and north of the navigation's origin. Her clock may be
another than that of the measurements where both tell the UTC of their time zero.
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import DataError


def times_of_navigation(
    navigation: Navigation, time_s: FloatArray, start_utc_ns: int | None, what: str
) -> FloatArray:
    """Return ascending times of measurements on the clock of own ship's navigation, s.

    Parameters
    ----------
    navigation
        Positions of own ship.
    time_s
        Times of the measurements, ``(time,)``, s.
    start_utc_ns
        UTC of their time zero, None where not known.
    what
        What they are, in the plural, for an error.

    Raises
    ------
    DataError
        The navigation has no rising times, tells another kind of time, or does not
        cover the times.
    """
    clock = navigation.time_s
    if clock.size < 2 or np.any(np.diff(clock) <= 0.0):
        raise DataError(
            f"own ship's navigation needs two rows or more with rising times, it has {clock.size}."
        )
    if (start_utc_ns is None) != (navigation.start_utc_ns is None):
        raise DataError(
            f"one of {what} and navigation has UTC times and the other seconds alone; "
            "give both in time_utc, or both in time_s of one clock."
        )
    now = time_s
    if start_utc_ns is not None and navigation.start_utc_ns is not None:
        now = time_s + (start_utc_ns - navigation.start_utc_ns) / NANOSECONDS
    if now[0] < clock[0] or now[-1] > clock[-1]:
        raise DataError(
            f"the {what} run from {now[0]:g} to {now[-1]:g} s, own ship's navigation "
            f"from {clock[0]:g} to {clock[-1]:g} s; it must cover them."
        )
    return now


class OwnMotion(NamedTuple):
    """Where own ship was at some times, how fast, and what her rows leave open."""

    position: FloatArray
    """East and north, m, ``(time, 2)``."""
    velocity: FloatArray
    """Their rates, m/s, ``(time, 2)``."""
    change: FloatArray
    """Changes of her mean velocity at the rows before and after, m/s, ``(time, 2, 2)``."""
    gap_s: FloatArray
    """Time between these rows, s, ``(time,)``."""


def own_motion(
    navigation: Navigation, time_s: FloatArray, start_utc_ns: int | None, what: str
) -> OwnMotion:
    """Return own ship's motion at ascending times; as for `times_of_navigation`."""
    now = times_of_navigation(navigation, time_s, start_utc_ns, what)
    clock = navigation.time_s
    place = np.stack([navigation.east_m, navigation.north_m], axis=1)
    rate = np.gradient(place, clock, axis=0)
    both = np.concatenate([place, rate], axis=1)
    found = np.stack([np.interp(now, clock, values) for values in both.T], axis=1)
    gap_s = np.diff(clock)
    mean = np.diff(place, axis=0) / gap_s[:, None]
    change = np.diff(np.pad(mean, ((1, 1), (0, 0)), mode="edge"), axis=0)
    row = np.clip(np.searchsorted(clock, now) - 1, 0, gap_s.size - 1)
    return OwnMotion(
        found[:, :2], found[:, 2:], np.stack([change[row], change[row + 1]], axis=1), gap_s[row]
    )
