"""Angles: wrapping, compass bearings and interpolation."""

from typing import Any

import numpy as np

from uwtrack_cli.data.base import FloatArray


def wrap_deg(angle_deg: Any) -> FloatArray:
    """Wrap angles to [-180, 180) degrees.

    Examples
    --------
    >>> wrap_deg(np.array([190.0, -190.0, 720.0])).tolist()
    [-170.0, 170.0, 0.0]
    """
    wrapped: FloatArray = (np.asarray(angle_deg, float) + 180.0) % 360.0 - 180.0
    return wrapped


def wrap_rad(angle_rad: FloatArray) -> FloatArray:
    """Wrap angles to [-pi, pi] radians.

    Examples
    --------
    >>> wrap_rad(np.radians([350.0, -190.0])).round(4).tolist()
    [-0.1745, 2.9671]
    """
    turn = 2.0 * np.pi
    return np.asarray(angle_rad - turn * np.rint(angle_rad / turn))


def compass_deg(east: FloatArray, north: FloatArray) -> FloatArray:
    """Return the compass bearing of a direction, degrees from 0 up to 360.

    Examples
    --------
    >>> compass_deg(np.array([1.0, 0.0]), np.array([0.0, -1.0])).tolist()
    [90.0, 180.0]
    """
    return np.degrees(np.arctan2(east, north)) % 360.0


def interpolate_deg(time_s: FloatArray, known_s: FloatArray, angle_deg: FloatArray) -> FloatArray:
    """Interpolate angles over time the short way round.

    Examples
    --------
    >>> interpolate_deg(np.array([0.5]), np.array([0.0, 1.0]), np.array([350.0, 20.0]))
    array([5.])
    """
    known = np.isfinite(angle_deg)
    unwrapped = np.unwrap(angle_deg[known], period=360.0)
    return np.interp(time_s, known_s[known], unwrapped) % 360.0
