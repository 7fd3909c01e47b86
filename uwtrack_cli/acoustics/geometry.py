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


def course_deg(bearing_deg: Any, turn: Any) -> FloatArray:
    """Return the course of a vessel from its bearing at closest approach, degrees.

    Examples
    --------
    A vessel that passes north of the sensor with increasing bearing steers east.

    >>> float(course_deg(0.0, 1))
    90.0
    """
    course: FloatArray = (
        np.asarray(bearing_deg, float) + 90.0 * np.asarray(turn)
    ) % 360.0
    return course


def side_of_vessel(turn: int) -> str:
    """Name the side of the vessel on which the sensor lies, by the bearing's turn."""
    return STARBOARD if turn > 0 else PORT
