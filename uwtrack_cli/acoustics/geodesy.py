"""Between latitude and longitude and a local grid of metres; magnetic declination.

**Method.** The grid is azimuthal equidistant about its origin on the WGS 84 ellipsoid:
distance and azimuth of the geodesic from the origin are those on the grid. The
declination is that of the World Magnetic Model of its year (pygeomag).

**Conventions.** Degrees, north and east positive; east is x and north is y.

**References.** Karney (2013), Journal of Geodesy 87, 43 (geographiclib). NOAA NCEI and
British Geological Survey, The US/UK World Magnetic Model (five-yearly).
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray


class Origin(NamedTuple):
    """Origin of a local grid."""

    latitude: float
    """Degrees, north positive."""
    longitude: float
    """Degrees, east positive."""


def to_grid(latitude: float, longitude: float, origin: Origin) -> tuple[float, float]:
    """Return east and north in metres of a position in degrees.

    Examples
    --------
    >>> east, north = to_grid(35.01, 129.0, Origin(35.0, 129.0))
    >>> round(east, 6) + 0.0, round(north, 1)
    (0.0, 1109.4)
    """
    from geographiclib.geodesic import Geodesic

    line = Geodesic.WGS84.Inverse(origin.latitude, origin.longitude, latitude, longitude)
    azimuth = np.deg2rad(line["azi1"])
    return float(line["s12"] * np.sin(azimuth)), float(line["s12"] * np.cos(azimuth))


def places_on_grid(
    latitude: FloatArray, longitude: FloatArray, origin: Origin
) -> tuple[FloatArray, FloatArray]:
    """Return east and north in metres of positions in degrees.

    Equal places are worked out once: geodesics are slow.

    Examples
    --------
    >>> east, north = places_on_grid(
    ...     np.array([35.01, 35.01]), np.array([129.0, 129.0]), Origin(35.0, 129.0))
    >>> north.round(1).tolist()
    [1109.4, 1109.4]
    """
    both = np.stack([latitude, longitude], axis=-1)
    pairs, row = np.unique(both, axis=0, return_inverse=True)
    grid = np.array([to_grid(a, b, origin) for a, b in pairs.tolist()]).reshape(-1, 2)
    east, north = grid[row.ravel()].T
    return east, north


def to_latitude_longitude(
    east_m: FloatArray, north_m: FloatArray, origin: Origin
) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes of grid positions in metres.

    Examples
    --------
    >>> lat, lon = to_latitude_longitude(
    ...     np.zeros(1), np.array([1109.4]), Origin(35.0, 129.0))
    >>> round(float(lat[0]), 4), float(lon[0])
    (35.01, 129.0)
    """
    from geographiclib.geodesic import Geodesic

    azimuth = np.rad2deg(np.arctan2(east_m, north_m))
    distance = np.hypot(east_m, north_m)
    points = [
        Geodesic.WGS84.Direct(origin.latitude, origin.longitude, float(a), float(s))
        for a, s in zip(azimuth, distance, strict=True)
    ]
    return (
        np.array([point["lat2"] for point in points], float),
        np.array([point["lon2"] for point in points], float),
    )


def magnetic_declination_deg(latitude: float, longitude: float, year: float) -> float:
    """Return the declination at sea level, east positive.

    ``year``: with its fraction.

    Raises
    ------
    ValueError
        There is no model for the year.
    ImportError
        pygeomag is not installed.

    Examples
    --------
    >>> round(magnetic_declination_deg(35.0, 128.5, 2025.5), 1)
    -8.3
    """
    from pygeomag import GeoMag

    model = GeoMag(base_year=year)
    return float(model.calculate(latitude, longitude, 0.0, year).d)
