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
    time_s: FloatArray
    first: FloatArray
    """East in metres on the grid, or latitude in degrees."""
    second: FloatArray
    """North in metres on the grid, or longitude in degrees."""
    speed_mps: FloatArray
    course_deg: FloatArray


@dataclass(frozen=True, kw_only=True)
class TruePassage:
    """A closest approach to a sensor; ``values`` under the names of encounters."""

    vessel: str
    sensor: str
    inside: bool
    values: Mapping[str, float]
    std: Mapping[str, float] = field(default_factory=dict)
    side: str | None = None
    rest_frequencies_hz: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """Tracks of all vessels; passages where the file tells them itself."""

    name: str
    start_utc_ns: int | None
    is_geographic: bool
    tracks: tuple[VesselTrack, ...]
    passages: tuple[TruePassage, ...] | None = None
    position_std_m: float = 0.0
    origin: tuple[float, float] | None = None
    """Latitude and longitude of the grid's origin, where they are known."""
    sensor_places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """East and north of each sensor on the grid."""
