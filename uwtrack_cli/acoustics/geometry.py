"""Angles on the compass, and sides of a vessel.

**Conventions.** Compass degrees, clockwise from north; a bearing points from the
sensor to the vessel; east is x and north is y. The sign ``turn`` of the bearing
trend is +1 clockwise (the sensor lies to starboard of the vessel) and -1
counter-clockwise (to port).

**References.** Choi et al. (2014), eq. 1 with the sign of the trend per sensor.
"""

from typing import Any

import numpy as np

from uwtrack_cli.data.base import FloatArray

RADIUS_95 = float(np.sqrt(-2.0 * np.log(0.05)))
"""Radius of the region that holds two Gaussian components with 95 % probability, in
deviations: the root of that quantile of chi-square with two degrees of freedom."""

CORNERS = 72
"""Corners of a region's outline."""

STARBOARD, PORT = "starboard", "port"
"""Side of the vessel on which the sensor lies, for a turn of +1 and -1."""


def compass_unit(bearing_deg: Any) -> FloatArray:
    """Return the unit vectors (east, north) of compass directions.

    Parameters
    ----------
    bearing_deg
        Compass directions in degrees.

    Examples
    --------
    >>> compass_unit(90.0).round(12).tolist()
    [1.0, 0.0]
    """
    angle = np.deg2rad(np.asarray(bearing_deg, float))
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1)


def place_covariance(range_m: float, bearing_deg: float, covariance: FloatArray) -> FloatArray:
    """Return the covariance of east and north of a place, m^2, to first order.

    ``covariance``: that of range (m) and bearing (degrees), shape (2, 2).
    """
    away = compass_unit(bearing_deg)
    across = np.radians(range_m) * away[::-1] * [1.0, -1.0]  # m for a degree
    turn = np.column_stack([away, across])
    return np.asarray(turn @ covariance @ turn.T)


def region_95(covariance: FloatArray) -> FloatArray:
    """Return the outline of the 95 % region about a place, counter-clockwise and closed.

    ``covariance``: that of both coordinates, shape (2, 2).

    Returned: array, shape (2, corners), in the unit of the coordinates.
    """
    spread, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:  # a mirrored circle would run clockwise
        axes = axes * np.array([1.0, -1.0])
    angle = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)
    radii = RADIUS_95 * np.sqrt(np.maximum(spread, 0.0))
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(axes @ (radii[:, None] * circle))


def course_deg(bearing_deg: Any, turn: Any) -> FloatArray:
    """Return the course of a vessel from its bearing at closest approach, degrees.

    Examples
    --------
    A vessel that passes north of the sensor with increasing bearing steers east.

    >>> float(course_deg(0.0, 1))
    90.0
    """
    course: FloatArray = (np.asarray(bearing_deg, float) + 90.0 * np.asarray(turn)) % 360.0
    return course


def side_of_vessel(turn: int) -> str:
    """Name the side of the vessel on which the sensor lies, by the bearing's turn."""
    return STARBOARD if turn > 0 else PORT
