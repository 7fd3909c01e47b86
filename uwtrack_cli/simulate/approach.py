"""The closest approach between a vessel and a sensor, found numerically.

**Method.** The distance is tabled over three times the recording (one before, one
after), and each dip is refined by bisection on the sign of the closing speed. A dip
outside the recording counts only if there is none within.

**Conventions.** Geometric time: when the vessel is nearest, not when that sound arrives.
The side is the side of the vessel on which the sensor lies.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.simulate.delay import Path
from uwtrack_cli.simulate.scenario import Scenario, SensorPlan
from uwtrack_cli.simulate.trajectories import Array, sensor_trajectory, vessel_trajectory
from uwtrack_cli.simulate.vessels import Vessel

GRID = 60001
"""Number of times at which the distance is tabled."""


@dataclass(frozen=True)
class Approach:
    """Geometry of a closest approach."""

    time_s: float
    """Time when the vessel is nearest, s."""
    arrival_time_s: float
    """Time when the sound made then arrives, s."""
    slant_range_m: float
    """Slant range, m."""
    horizontal_range_m: float
    """Horizontal range, m."""
    speed_mps: float
    """Speed of the vessel, m/s."""
    course_deg: float
    """Course of the vessel, compass degrees."""
    bearing_deg: float
    """Bearing from the sensor to the vessel, compass degrees."""
    side: str
    """Side of the vessel on which the sensor lies, 'port' or 'starboard'."""


def direct_path(scenario: Scenario, vessel: Vessel, plan: SensorPlan) -> Path:
    """Return the straight path of the sound from a vessel to a sensor."""
    return Path(
        vessel_trajectory(vessel, scenario),
        vessel.source_depth_m,
        sensor_trajectory(plan),
        plan.depth_m,
        scenario.sound_speed_mps,
    )


def closest_approaches(path: Path, duration_s: float) -> tuple[Approach, ...]:
    """Return every dip of the distance within the recording, or the least without."""
    time_s = np.linspace(-duration_s, 2.0 * duration_s, GRID)
    opening = _opening(path, time_s)
    dips = np.flatnonzero((opening[:-1] < 0.0) & (opening[1:] >= 0.0))
    moments = [_bisect(path, float(time_s[i]), float(time_s[i + 1])) for i in dips]
    inside = [t for t in moments if 0.0 <= t <= duration_s]
    if moments and not inside:
        inside = [min(moments, key=lambda t: float(horizontal(path, np.array(t))))]
    return tuple(_describe(path, t) for t in inside)


def nearest_range_m(path: Path, duration_s: float) -> float:
    """Return the slant range at closest approach, or the least one in the recording."""
    found = closest_approaches(path, duration_s)
    if found:
        return min(approach.slant_range_m for approach in found)
    time_s = np.linspace(0.0, duration_s, 1001)
    return float(np.hypot(horizontal(path, time_s), _height(path)).min())


def horizontal(path: Path, time_s: Array) -> Array:
    """Return the horizontal distance at the same instant, m."""
    here, there = path.receiver.at(time_s), path.source.at(time_s)
    return np.asarray(np.hypot(there[0] - here[0], there[1] - here[1]))


def _height(path: Path) -> float:
    return path.receiver_depth_m - path.source_depth_m


def _opening(path: Path, time_s: Array) -> Array:
    """Return half the rate of the squared distance (its sign is what counts)."""
    here, there = path.receiver.at(time_s), path.source.at(time_s)
    east, north, east_rate, north_rate = (b - a for a, b in zip(here, there, strict=True))
    return np.asarray(east * east_rate + north * north_rate)


def _bisect(path: Path, low: float, high: float) -> float:
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _opening(path, np.array(middle)) < 0.0:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))


def _describe(path: Path, time_s: float) -> Approach:
    moment = np.array(time_s)
    east, north, east_rate, north_rate = path.source.at(moment)
    here_east, here_north, _, _ = path.receiver.at(moment)
    to_east, to_north = east - here_east, north - here_north
    distance = float(np.hypot(to_east, to_north))
    slant = float(np.hypot(distance, _height(path)))
    right = -to_east * north_rate + to_north * east_rate  # sensor right of the course
    return Approach(
        time_s=time_s,
        arrival_time_s=_arrival(path, time_s, slant / path.sound_speed_mps),
        slant_range_m=slant,
        horizontal_range_m=distance,
        speed_mps=float(np.hypot(east_rate, north_rate)),
        course_deg=float(np.degrees(path.source.course_rad(moment)) % 360.0),
        bearing_deg=float(np.degrees(np.arctan2(to_east, to_north)) % 360.0),
        side="starboard" if right > 0.0 else "port",
    )


def _arrival(path: Path, time_s: float, travel_s: float) -> float:
    """Return when the sound made at a time arrives (the receiver may move)."""
    for _ in range(50):
        travel_s = float(path.solve(np.array(time_s + travel_s)).delay_s)
    return time_s + travel_s
