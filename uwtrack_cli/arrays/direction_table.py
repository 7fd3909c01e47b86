"""What was found of directions, as a table with bearings, elevations and ranges.

**Method.** A source near the surface that is heard from an elevation e by an array at
depth z lies at the horizontal range (z - z_s) / tan e; depth of the source, of the
array and the elevation add to its deviation. Rays are taken as straight.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, to_latitude_longitude
from uwtrack_cli.arrays.broadband_directions import DirectionLobes, FoundDirections
from uwtrack_cli.arrays.direction_grid import SpatialArray
from uwtrack_cli.constants import SOURCE_DEPTH_M, SOURCE_DEPTH_STD_M
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.directions import LINE, Directions
from uwtrack_cli.data.sensor import Sensor

SURE_DEVIATIONS = 8.0
"""Deviations by which an elevation must exceed zero to tell a range: of those nearer to
zero the too high ones would be chosen."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TableFacts:
    """Time base and circumstances of the directions of a block."""

    time_s: FloatArray
    """Times of the frames, s."""
    heading_deg: FloatArray
    """The array's heading at these times, degrees."""
    first_frame: int
    """Index of the first frame in the recording."""
    start_utc_ns: int | None
    """UTC epoch of time zero, ns."""
    probability: float
    """Share of frames of noise with a direction."""
    band_hz: tuple[float, float]
    """Band, Hz."""
    method: str
    """'beams' or 'delays'."""
    reference: str
    """Reference of the levels."""


def ambiguity_of(array: SpatialArray) -> str:
    """Return what the shape of an array leaves open, as in `Directions`."""
    if array.is_line:
        return LINE
    if not array.is_planar:
        return "none"
    return "elevation" if array.is_level else "plane"


def direction_table(
    found: FoundDirections,
    array: SpatialArray,
    sensor: Sensor,
    facts: TableFacts,
    level_db: FloatArray,
) -> Directions:
    """Return the directions of a block, one row per frame that has one."""
    heading = facts.heading_deg[found.frame]
    stated = array.bearings(found.toward, found.covariance, heading)
    length = np.linalg.norm(found.toward, axis=1)
    along = found.toward / np.maximum(length, 1e-9)[:, None]
    radial = np.einsum("ni,nij,nj->n", along, found.covariance, along)
    speed_share = (sensor.sound_speed_std_mps or 0.0) / array.sound_speed_mps
    radial = radial + (length * speed_share) ** 2
    if not array.is_planar:  # its length is not free
        radial = np.full(length.size, np.nan)
    range_m, range_std_m = surface_range(stated.elevation_deg, stated.elevation_std_deg, sensor)
    lobes, lobe_bearing_deg, lobe_elevation_deg = _lobes(found, array, facts.heading_deg)
    return Directions(
        frame=found.frame + facts.first_frame,
        source=found.source + 1,
        time_s=facts.time_s[found.frame],
        bearing_deg=stated.bearing_deg,
        bearing_std_deg=stated.bearing_std_deg,
        elevation_deg=stated.elevation_deg,
        elevation_std_deg=stated.elevation_std_deg,
        slowness_ratio=length,
        slowness_ratio_std=np.sqrt(np.maximum(radial, 0.0)),
        snr_db=10.0 * np.log10(np.maximum(found.snr, 1e-3)),
        level_db=level_db,
        range_m=range_m,
        range_std_m=range_std_m,
        **surface_place(
            np.stack([stated.bearing_deg, stated.bearing_std_deg]),
            np.stack([range_m, range_std_m]),
            sensor,
        ),
        lobe_frame=lobes.frame + facts.first_frame,
        lobe_source=lobes.source + 1,
        lobe_bearing_deg=lobe_bearing_deg,
        lobe_elevation_deg=lobe_elevation_deg,
        lobe_weight=lobes.weight,
        false_alarm_probability=facts.probability,
        band_low_hz=facts.band_hz[0],
        band_high_hz=facts.band_hz[1],
        method=facts.method,
        ambiguity=ambiguity_of(array),
        reference=facts.reference,
        sensor=sensor.id,
        start_utc_ns=facts.start_utc_ns,
    )


def surface_range(
    elevation_deg: FloatArray, elevation_std_deg: FloatArray, sensor: Sensor
) -> tuple[FloatArray, FloatArray]:
    """Return horizontal ranges of sources near the surface, and their deviations, m.

    Without the depth of the array nothing is known.
    """
    unknown = np.full(elevation_deg.shape, np.nan)
    if sensor.depth_m is None:
        return unknown, unknown
    above = sensor.depth_m - SOURCE_DEPTH_M
    above_std = np.hypot(sensor.depth_std_m or 0.0, SOURCE_DEPTH_STD_M)
    rise, rise_std = np.radians(elevation_deg), np.radians(elevation_std_deg)
    is_sure = (above > 0.0) & (rise > SURE_DEVIATIONS * rise_std)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = above / np.tan(rise)
        by_angle = above * rise_std / np.sin(rise) ** 2
        std = np.hypot(by_angle, above_std / np.tan(rise))
    return np.where(is_sure, far, np.nan), np.where(is_sure, std, np.nan)


def surface_place(
    bearing_deg: FloatArray, range_m: FloatArray, sensor: Sensor
) -> dict[str, FloatArray]:
    """Return where sources near the surface are, by one array at rest.

    Bearings, degrees, and ranges, m, with their deviations, shape (2, n) each; compass
    and place of the array add to these. Columns of `Directions`; nan for an array that
    moves.
    """
    (bearing, bearing_std), (far, far_std) = np.radians(bearing_deg), range_m
    if sensor.navigation is not None:
        far = np.full(far.shape, np.nan)
    along = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    across = np.stack([np.cos(bearing), -np.sin(bearing)], axis=-1)
    turn = np.hypot(bearing_std, np.radians(sensor.compass_std_deg or 0.0))
    spread = far_std**2 * np.einsum("ni,nj->ijn", along, along)
    spread = spread + (far * turn) ** 2 * np.einsum("ni,nj->ijn", across, across)
    spread = spread + sensor.position_std_m**2 * np.eye(2)[:, :, None]
    off = far[:, None] * along
    latitude = longitude = np.full(far.shape, np.nan)
    own = (sensor.east_m or 0.0, sensor.north_m or 0.0)
    if sensor.latitude is not None and sensor.longitude is not None:
        origin, known = Origin(sensor.latitude, sensor.longitude), np.isfinite(far)
        latitude, longitude = latitude.copy(), longitude.copy()
        latitude[known], longitude[known] = to_latitude_longitude(
            off[known, 0], off[known, 1], origin
        )
    return {
        "east_m": own[0] + off[:, 0],
        "north_m": own[1] + off[:, 1],
        "covariance_m2": np.where(np.isfinite(far), spread, np.nan).transpose(2, 0, 1),
        "latitude": latitude,
        "longitude": longitude,
    }


def _lobes(
    found: FoundDirections, array: SpatialArray, heading_deg: FloatArray
) -> tuple[DirectionLobes, FloatArray, FloatArray]:
    """Return the other directions, their bearings and elevations.

    Of a plane, or a line, every direction has an image on the other side, as likely as
    itself.
    """
    lobes, is_below = found.lobes, np.zeros(found.lobes.frame.size, np.bool_)
    if array.is_planar:
        n_sources = int(found.source.max(initial=0)) + 1
        own = np.ones((heading_deg.size, n_sources))
        np.subtract.at(own, (lobes.frame, lobes.source), lobes.weight)
        own = own[found.frame, found.source]
        images = DirectionLobes(found.frame, found.source, found.toward, own)
        is_below = np.repeat([False, True], [is_below.size, is_below.size + own.size])
        lobes = DirectionLobes.join([lobes, lobes, images])
        lobes = replace(lobes, weight=0.5 * lobes.weight)
    order = np.lexsort([lobes.source, lobes.frame])
    lobes, is_below = lobes.take(order), is_below[order]
    none = np.broadcast_to(1e-12 * np.eye(3), (order.size, 3, 3))
    above, below = (
        array.bearings(lobes.toward, none, heading_deg[lobes.frame], below=side)
        for side in (False, True)
    )
    return (
        lobes,
        np.where(is_below, below.bearing_deg, above.bearing_deg),
        np.where(is_below, below.elevation_deg, above.elevation_deg),
    )
