"""What really happened: tracks and passages that results are scored against.

**Conventions.** Times in seconds from ``Truth.start_utc_ns``. A track has its own grid
(east, north) or latitudes and longitudes; what is not known is nan. Deviations belong
to the truth itself: a simulation has none, AIS positions have some metres.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from uwtrack_cli.data.base import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class VesselTrack:
    """Where a vessel was over time, in order of time."""

    vessel: str
    """Name of the vessel."""
    time_s: FloatArray
    """Times, s from ``Truth.start_utc_ns``, shape (time,)."""
    first: FloatArray
    """East in metres on the grid, or latitude in degrees, shape (time,)."""
    second: FloatArray
    """North in metres on the grid, or longitude in degrees, shape (time,)."""
    speed_mps: FloatArray
    """Speed, m/s, shape (time,)."""
    course_deg: FloatArray
    """Compass course, degrees, shape (time,)."""


@dataclass(frozen=True, kw_only=True)
class TruePassage:
    """A closest approach to a sensor; ``values`` under the names of encounters."""

    vessel: str
    """Name of the vessel."""
    sensor: str
    """Identifier of the sensor."""
    inside: bool
    """Whether the closest approach lies within the recording."""
    values: Mapping[str, float]
    """True values, by column of encounters, in its unit."""
    std: Mapping[str, float] = field(default_factory=dict)
    """Deviations of the true values themselves, by column, in its unit."""
    side: str | None = None
    """Side of the vessel on which the sensor lies; None is unknown."""
    rest_frequencies_hz: tuple[float, ...] = ()
    """Frequencies of the vessel's lines at rest, Hz."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """Tracks of all vessels; passages where the file tells them itself."""

    name: str
    """Name of the file."""
    start_utc_ns: int | None
    """UTC epoch of time zero, ns; None is unknown."""
    is_geographic: bool
    """Whether the tracks have latitudes and longitudes."""
    tracks: tuple[VesselTrack, ...]
    """One track per vessel."""
    passages: tuple[TruePassage, ...] | None = None
    """Closest approaches that the file states; None: they follow from the tracks."""
    position_std_m: float = 0.0
    """Standard deviation of each coordinate of the tracks, m."""
    origin: tuple[float, float] | None = None
    """Latitude and longitude of the grid's origin, where they are known, degrees."""
    sensor_places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """East and north of each sensor on the grid, m, by its identifier."""
