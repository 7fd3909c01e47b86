"""Tracks as a scenario states them: courses, waypoints, turns, closest approaches.

**Conventions.** Metres on one local grid, seconds from the first sample, compass
degrees. A speed may be given in m/s or in knots.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.options import AtLeast, AtMost, Key, OptionGroup, Unit
from uwtrack_cli.errors import OptionError

Coordinate = Annotated[float, Unit("m"), AtLeast(-1e8), AtMost(1e8)]
Range = Annotated[float, Unit("m"), AtLeast(0.0), AtMost(1e8)]
Moment = Annotated[float, Unit("s"), AtLeast(-4e6), AtMost(8e6)]
Course = Annotated[float, Unit("degree"), AtLeast(-360.0), AtMost(360.0)]
Speed = Annotated[float, Unit("m/s"), AtLeast(0.0), AtMost(1e4)]
Knots = Annotated[float, Unit("kn"), AtLeast(0.0), AtMost(2e4)]


@dataclass(frozen=True, kw_only=True)
class Turn(OptionGroup):
    """A change of course at a constant rate, the shorter way round."""

    at_s: Moment
    """Time at which the turn begins, s."""
    course_deg: Course
    """Course after the turn, compass degrees."""
    rate_deg_per_s: Annotated[float, Unit("degree/s"), AtLeast(1e-3), AtMost(90.0)] = 1.0
    """Rate of the turn, degrees per second."""
    speed_mps: Speed | None = None
    """Speed from the turn on, m/s; None keeps the speed."""


@dataclass(frozen=True, kw_only=True)
class TrackPlan(OptionGroup):
    """A course steered from a position, or a chain of waypoints at one speed."""

    east_m: Coordinate = 0.0
    """East at ``start_s``, m."""
    north_m: Coordinate = 0.0
    """North at ``start_s``, m."""
    start_s: Moment = 0.0
    """Time at which the position or the first waypoint holds, s."""
    course_deg: Course | None = None
    """Course steered, compass degrees; None with waypoints."""
    speed_mps: Speed | None = None
    """Speed, m/s; one of the two speeds is needed."""
    speed_kn: Knots | None = None
    """Speed, knots."""
    waypoints_m: tuple[tuple[Coordinate, Coordinate], ...] = ()
    """East and north of each waypoint, m; two or more in place of a course."""
    turn_radius_m: Range = 50.0
    """Radius of the arcs that round the waypoints, m."""
    turns: Annotated[tuple[Turn, ...], Key("turn")] = ()
    """Turns from the course, in order of time."""

    def __post_init__(self) -> None:
        """Refuse a track that leaves the course open or gives it twice."""
        super().__post_init__()
        exactly_one(self, "speed_mps", "speed_kn")
        if (self.course_deg is None) == (len(self.waypoints_m) < 2):
            raise OptionError("give either course_deg or at least two waypoints_m.")
        if self.waypoints_m and self.turns:
            raise OptionError("waypoints_m already turn; give either them or turn.")
        check_turns(self.turns, self.start_s)

    @property
    def speed(self) -> float:
        """Speed, m/s."""
        return _speed(self.speed_mps, self.speed_kn)


@dataclass(frozen=True, kw_only=True)
class ClosestApproach(OptionGroup):
    """A straight passage, stated by its closest approach to a sensor.

    For a moving sensor it is the approach to the place of the sensor at ``time_s``.
    """

    time_s: Moment
    """Time of the closest approach, s."""
    course_deg: Course
    """Course of the vessel, compass degrees."""
    side: Literal["port", "starboard"]
    """Side of the vessel on which the sensor lies."""
    sensor: str | None = None
    """Name of the sensor; None is the first one."""
    horizontal_range_m: Range | None = None
    """Horizontal range at the closest approach, m; one of the two is needed."""
    slant_range_m: Annotated[float, Unit("m"), AtLeast(1.0), AtMost(1e8)] | None = None
    """Slant range at the closest approach, m."""
    speed_mps: Annotated[float, Unit("m/s"), AtLeast(1e-3), AtMost(1e4)] | None = None
    """Speed, m/s; one of the two speeds is needed."""
    speed_kn: Annotated[float, Unit("kn"), AtLeast(1e-3), AtMost(2e4)] | None = None
    """Speed, knots."""

    def __post_init__(self) -> None:
        """Refuse a passage without range or speed, or with two of one."""
        super().__post_init__()
        exactly_one(self, "speed_mps", "speed_kn")
        exactly_one(self, "horizontal_range_m", "slant_range_m")

    @property
    def speed(self) -> float:
        """Speed, m/s."""
        return _speed(self.speed_mps, self.speed_kn)


def check_turns(turns: tuple[Turn, ...], start_s: float) -> None:
    """Refuse turns that are out of order or begin before the track does."""
    times = [start_s, *(turn.at_s for turn in turns)]
    if any(later < earlier for earlier, later in pairwise(times)):
        raise OptionError(f"turns must follow each other and {start_s:g} s, got at_s {times[1:]}.")


def exactly_one(owner: object, *names: str) -> None:
    """Refuse a table in which none or several of the named keys are given."""
    given = [name for name in names if getattr(owner, name) is not None]
    if len(given) != 1:
        raise OptionError(f"give exactly one of {' and '.join(names)}, got {given or 'none'}.")


def _speed(speed_mps: float | None, speed_kn: float | None) -> float:
    return speed_mps if speed_mps is not None else (speed_kn or 0.0) * KNOT_MPS
