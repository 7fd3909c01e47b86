"""How things move: tracks with turns, and passages stated by a closest approach.

**Conventions.** Metres on one local grid, seconds from the first sample, compass
degrees. A speed may be given in m/s or in knots.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.table import exactly_one, fact


@dataclass(frozen=True, kw_only=True)
class Turn:
    """A change of course at a constant rate, the shorter way round."""

    at_s: float = fact()
    course_deg: float = fact(low=-360.0, high=360.0)
    rate_deg_per_s: float = fact(1.0, low=1e-3, high=90.0)
    speed_mps: float | None = fact(None, low=0.0)


@dataclass(frozen=True, kw_only=True)
class Track:
    """A course steered from a position, or a chain of waypoints at one speed."""

    east_m: float = fact(0.0)
    north_m: float = fact(0.0)
    start_s: float = fact(0.0)
    course_deg: float | None = fact(None, low=-360.0, high=360.0)
    speed_mps: float | None = fact(None, low=0.0)
    speed_kn: float | None = fact(None, low=0.0)
    waypoints_m: tuple[tuple[float, float], ...] = fact(())
    turn_radius_m: float = fact(50.0, low=0.0)
    turns: tuple[Turn, ...] = fact((), key="turn")

    def __post_init__(self) -> None:
        """Refuse a track that leaves the course open or gives it twice."""
        exactly_one(self, "speed_mps", "speed_kn")
        if (self.course_deg is None) == (len(self.waypoints_m) < 2):
            msg = "give either course_deg or at least two waypoints_m."
            raise OptionError(msg)
        if self.waypoints_m and self.turns:
            msg = "waypoints_m already turn; give either them or turn."
            raise OptionError(msg)
        check_turns(self.turns, self.start_s)

    @property
    def speed(self) -> float:
        """Speed, m/s."""
        return _speed(self.speed_mps, self.speed_kn)


@dataclass(frozen=True, kw_only=True)
class ClosestApproach:
    """A straight passage, stated by its closest approach to a sensor.

    For a moving sensor it is the approach to the place of the sensor at ``time_s``.
    """

    time_s: float = fact()
    course_deg: float = fact(low=-360.0, high=360.0)
    side: str = fact(choices=("port", "starboard"))
    sensor: str | None = fact(None)
    horizontal_range_m: float | None = fact(None, low=0.0)
    slant_range_m: float | None = fact(None, low=1.0)
    speed_mps: float | None = fact(None, low=1e-3)
    speed_kn: float | None = fact(None, low=1e-3)

    def __post_init__(self) -> None:
        """Refuse a passage without range or speed, or with two of one."""
        exactly_one(self, "speed_mps", "speed_kn")
        exactly_one(self, "horizontal_range_m", "slant_range_m")

    @property
    def speed(self) -> float:
        """Speed, m/s."""
        return _speed(self.speed_mps, self.speed_kn)


def check_turns(turns: tuple[Turn, ...], start_s: float) -> None:
    """Refuse turns that are out of order or begin before the way does."""
    times = [start_s, *(turn.at_s for turn in turns)]
    if np.any(np.diff(times) < 0.0):
        msg = f"turns must follow each other and {start_s:g} s, got at_s {times[1:]}."
        raise OptionError(msg)


def _speed(speed_mps: float | None, speed_kn: float | None) -> float:
    return speed_mps if speed_mps is not None else (speed_kn or 0.0) * KNOT_MPS
