"""Where things are: straight legs and circular turns, exact at any time.

**Method.** A trajectory is a list of segments with constant speed and turn rate. Along a
segment the displacement after t seconds is the chord v t sin(x)/x, x = w t/2, in the
direction of the course plus x, which holds for arcs and (w = 0) straight legs alike.

**Conventions.** East, north in metres; courses in compass radians, clockwise from
north. The first segment extends to all earlier times and the last to all later.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.scenario import Scenario, SensorPlan
from uwtrack_cli.simulate.track_plans import ClosestApproach, TrackPlan, Turn
from uwtrack_cli.simulate.vessels import Vessel

Array = NDArray[np.float64]


class Segment(NamedTuple):
    """A straight leg or an arc, from its beginning on."""

    start_s: float
    """Time of the beginning, s."""
    east_m: float
    """East at the beginning, m."""
    north_m: float
    """North at the beginning, m."""
    course_rad: float
    """Course at the beginning, compass radians."""
    speed_mps: float
    """Speed, m/s."""
    turn_rate_radps: float
    """Rate of turn to starboard, rad/s; 0 is straight."""


class Kinematics(NamedTuple):
    """Where something is and how it moves, at the times asked for."""

    east_m: Array
    """East, m."""
    north_m: Array
    """North, m."""
    east_mps: Array
    """Rate of the east, m/s."""
    north_mps: Array
    """Rate of the north, m/s."""


@dataclass(frozen=True)
class Trajectory:
    """A horizontal trajectory through segments."""

    segments: tuple[Segment, ...]
    """Segments in order of time, one or more."""

    def at(self, time_s: Array) -> Kinematics:
        """Return positions and velocities at the given times."""
        table = np.array(self.segments)
        starts = table[1:, 0]
        row = table[np.searchsorted(starts, time_s, side="right")]
        start, east, north, course, speed, rate = np.moveaxis(row, -1, 0)
        elapsed = time_s - start
        half = 0.5 * rate * elapsed
        chord = speed * elapsed * np.sinc(half / np.pi)
        here = course + 2.0 * half
        return Kinematics(
            east + chord * np.sin(course + half),
            north + chord * np.cos(course + half),
            speed * np.sin(here),
            speed * np.cos(here),
        )

    def course_rad(self, time_s: Array) -> Array:
        """Return the course, rad, at the given times (also at rest)."""
        table = np.array(self.segments)
        row = table[np.searchsorted(table[1:, 0], time_s, side="right")]
        return np.asarray(row[..., 3] + row[..., 5] * (time_s - row[..., 0]))

    @property
    def top_speed_mps(self) -> float:
        """Largest speed, m/s."""
        return max(segment.speed_mps for segment in self.segments)


def fixed(east_m: float, north_m: float) -> Trajectory:
    """Return the trajectory of something that stays where it is."""
    return Trajectory((Segment(0.0, east_m, north_m, 0.0, 0.0, 0.0),))


def sensor_trajectory(plan: SensorPlan) -> Trajectory:
    """Return the trajectory of a sensor; of an array that of its middle."""
    if plan.kind == "array":
        return array_place(plan, (0.0, 0.0, 0.0))
    if plan.track is None:
        return fixed(plan.east_m, plan.north_m)
    return track_trajectory(plan.track)


def array_place(plan: SensorPlan, place_m: tuple[float, float, float]) -> Trajectory:
    """Return the horizontal trajectory of a place on an array.

    A towed array lies on the way of its ship: each place comes where the ship was, as
    much later as it is behind. A fixed one points where its compass says.

    ``place_m``: the place from the array's middle: starboard, ahead and up, m.

    Raises
    ------
    OptionError
        The ship stops or changes its speed, so that the array could not follow.
    """
    starboard_m, along_m, _ = place_m
    if plan.track is None:
        known = plan.heading_deg + plan.compass_offset_deg
        heading = np.radians(known - plan.compass_error_deg)
        return fixed(
            plan.east_m + float(along_m * np.sin(heading) + starboard_m * np.cos(heading)),
            plan.north_m + float(along_m * np.cos(heading) - starboard_m * np.sin(heading)),
        )
    segments = track_trajectory(plan.track).segments
    speeds = {segment.speed_mps for segment in segments}
    if len(speeds) > 1 or min(speeds) <= 0.0:
        raise OptionError(
            f"an array is towed at one speed above 0, got "
            f"{', '.join(f'{speed:g}' for speed in sorted(speeds))} m/s."
        )
    later_s = (plan.tow_offset_m - along_m) / speeds.pop()
    return Trajectory(tuple(part._replace(start_s=part.start_s + later_s) for part in segments))


def vessel_trajectory(vessel: Vessel, scenario: Scenario) -> Trajectory:
    """Return the trajectory of a vessel."""
    if vessel.closest_approach is None:
        assert vessel.track is not None  # noqa: S101 - checked by Vessel
        return track_trajectory(vessel.track)
    passage = vessel.closest_approach
    plan = reference_sensor(passage, scenario)
    first = _passage_leg(passage, plan, vessel.source_depth_m)
    return Trajectory(_with_turns(first, vessel.turns))


def reference_sensor(passage: ClosestApproach | None, scenario: Scenario) -> SensorPlan:
    """Return the sensor that a passage names, or else the first one."""
    if passage is None or passage.sensor is None:
        return scenario.sensors[0]
    names = [plan.id for plan in scenario.sensors]
    if passage.sensor not in names:
        raise OptionError(
            f"closest_approach.sensor must be one of {names}, got {passage.sensor!r}."
        )
    return scenario.sensors[names.index(passage.sensor)]


def track_trajectory(track: TrackPlan) -> Trajectory:
    """Return the trajectory along a track."""
    if track.course_deg is None:
        return _waypoint_trajectory(track)
    course = float(np.radians(track.course_deg))
    first = Segment(track.start_s, track.east_m, track.north_m, course, track.speed, 0.0)
    return Trajectory(_with_turns(first, track.turns))


def _passage_leg(passage: ClosestApproach, plan: SensorPlan, source_depth_m: float) -> Segment:
    east, north, _, _ = sensor_trajectory(plan).at(np.array(passage.time_s))
    course = float(np.radians(passage.course_deg))
    to_port = 1.0 if passage.side == "starboard" else -1.0  # where the vessel is
    abeam = course - to_port * np.pi / 2
    distance = passage.horizontal_range_m
    if distance is None:
        height = plan.depth_m - source_depth_m
        square = (passage.slant_range_m or 0.0) ** 2 - height**2
        if square < 0.0:
            raise OptionError(
                f"slant_range_m {passage.slant_range_m:g} is less than the depth "
                f"difference of {abs(height):g} m between source and sensor."
            )
        distance = float(np.sqrt(square))
    return Segment(
        passage.time_s,
        float(east + distance * np.sin(abeam)),
        float(north + distance * np.cos(abeam)),
        course,
        passage.speed,
        0.0,
    )


def _with_turns(first: Segment, turns: tuple[Turn, ...]) -> tuple[Segment, ...]:
    segments = [first]
    for turn in turns:
        begin = _step(segments[-1], turn.at_s)
        if turn.at_s < segments[-1].start_s:
            raise OptionError(f"the turn at {turn.at_s:g} s begins before the last one has ended.")
        change = (np.radians(turn.course_deg) - begin.course_rad + np.pi) % (2 * np.pi) - np.pi
        rate = float(np.copysign(np.radians(turn.rate_deg_per_s), change))
        speed = begin.speed_mps if turn.speed_mps is None else turn.speed_mps
        arc = begin._replace(speed_mps=speed, turn_rate_radps=rate)
        straight = _step(arc, turn.at_s + float(change) / rate)
        segments += [arc, straight._replace(turn_rate_radps=0.0)]
    return tuple(segments)


def _step(segment: Segment, time_s: float) -> Segment:
    """Return the segment that continues another from a later time on."""
    trajectory = Trajectory((segment,))
    moment = np.array(time_s)
    east, north, _, _ = trajectory.at(moment)
    course = float(trajectory.course_rad(moment))
    return segment._replace(
        start_s=time_s, east_m=float(east), north_m=float(north), course_rad=course
    )


def _waypoint_trajectory(track: TrackPlan) -> Trajectory:
    """Join waypoints by legs; each corner is rounded by an arc that touches both."""
    points = np.array(track.waypoints_m)
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    courses = np.arctan2(steps[:, 0], steps[:, 1])
    changes = (np.diff(courses) + np.pi) % (2 * np.pi) - np.pi
    cuts = np.concatenate([[0.0], track.turn_radius_m * np.tan(abs(changes) / 2), [0]])
    if np.any(cuts[:-1] + cuts[1:] > lengths) or track.speed <= 0.0:
        raise OptionError(
            f"waypoints_m are too close for turn_radius_m {track.turn_radius_m:g}, "
            f"or the speed is zero; legs are {lengths.round(1).tolist()} m long."
        )
    position, time_s = points[0], track.start_s
    segments: list[Segment] = []
    for i, (cut, next_cut) in enumerate(pairwise(cuts)):
        course = float(courses[i])
        leg = Segment(time_s, float(position[0]), float(position[1]), course, track.speed, 0.0)
        time_s += float(lengths[i] - cut - next_cut) / track.speed
        segments.append(leg)
        if i < changes.size and track.turn_radius_m > 0.0 and changes[i] != 0.0:
            rate = float(np.copysign(track.speed / track.turn_radius_m, changes[i]))
            segments.append(_step(leg, time_s)._replace(turn_rate_radps=rate))
            time_s += float(changes[i]) / rate
        end = _step(segments[-1], time_s)
        position = np.array([end.east_m, end.north_m])
    return Trajectory(tuple(segments))
