"""Bearings of a magnetic compass, from true north."""

from dataclasses import replace
from datetime import UTC, datetime
from warnings import warn

from uwtrack_cli.acoustics.geodesy import magnetic_declination_deg
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, UwtrackNote, UwtrackWarning


def from_true_north(sensor: Sensor, start_utc_ns: int | None) -> Sensor:
    """Return a sensor whose compass offset holds the declination, where that is asked.

    ``start_utc_ns``: start of its recording, ns since 1970-01-01 UTC.

    Raises
    ------
    DataError
        Place or time is not known, or there is no model for them.
    """
    if sensor.north == "compass":
        msg = (
            f"bearings of sensor {sensor.id!r} are from the north of its compass: give "
            f'declination_deg in its sensor file, in degrees or as "place".'
        )
        warn(msg, UwtrackWarning, stacklevel=4)
    if sensor.north != "place":
        return sensor
    latitude, longitude = sensor.latitude, sensor.longitude
    if sensor.navigation is not None:
        latitude = sensor.navigation.origin_latitude
        longitude = sensor.navigation.origin_longitude
    if latitude is None or longitude is None or start_utc_ns is None:
        lacks = "start of its recording" if latitude is not None else "latitude"
        msg = (
            f'declination_deg = "place" of sensor {sensor.id!r} needs latitude, longitude '
            f"and the start of the recording (--start-utc); there is no {lacks}."
        )
        raise DataError(msg)
    begin = datetime.fromtimestamp(start_utc_ns / NANOSECONDS, UTC)
    new_year = [datetime(begin.year + k, 1, 1, tzinfo=UTC) for k in (0, 1)]
    share = (begin - new_year[0]) / (new_year[1] - new_year[0])
    year = begin.year + share
    try:
        declination_deg = magnetic_declination_deg(latitude, longitude, year)
    except ImportError as error:
        msg = (
            f'declination_deg = "place" needs pygeomag ({error}); pip install '
            f"'uwtrack[declination]', or give the declination in degrees."
        )
        raise DataError(msg) from error
    except ValueError as error:
        msg = f"{error}; give declination_deg in degrees."
        raise DataError(msg) from error
    msg = (
        f"sensor {sensor.id!r} is given a declination of {declination_deg:.2f} degrees, "
        f"of the World Magnetic Model."
    )
    warn(msg, UwtrackNote, stacklevel=4)
    offset_deg = sensor.compass_offset_deg + declination_deg
    return replace(sensor, compass_offset_deg=offset_deg, north=None)
