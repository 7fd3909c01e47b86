"""Where the target of a table of sensors was at given times: fixes with ellipses.

**Method.** The motion that the bearings of all sensors determine is carried to each time,
with its covariance. Few bearings, or bearings of one moment, tell a place and no velocity:
the velocity then has the deviation of vessels in general, so that the ellipse grows from
the time of the bearings on.

**Conventions.** East and north on the grid of the sensors; latitude and longitude where
they have them.
"""

from collections.abc import Sequence

import numpy as np

from uwtrack_cli.acoustics.geodesy import to_latitude_longitude
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.series import Series
from uwtrack_cli.motion.target.contact import ContactAnswer
from uwtrack_cli.motion.target.inputs import Platforms
from uwtrack_cli.motion.target.model import state_jacobian, to_state
from uwtrack_cli.motion.target.modes import ModeAnswer

VESSEL_VELOCITY_STD_MPS = 10.0
"""Deviation of each component of a vessel's velocity of which nothing is known."""


def first_place(platforms: Platforms) -> FloatArray:
    """Return east and north of the sensor at the first row, from which states count."""
    return np.array([platforms.east_m[0], platforms.north_m[0]])


def grid_state(mode: ModeAnswer, platforms: Platforms) -> tuple[FloatArray, FloatArray]:
    """Return the state (east, north, their rates) at the first row, and covariance."""
    jacobian = state_jacobian(mode.q[np.newaxis])[0]
    covariance = jacobian @ mode.solver_covariance[:4, :4] @ jacobian.T
    state = to_state(mode.q)
    state[:2] += first_place(platforms)
    return state, covariance


def fixes_of_answers(
    answers: Sequence[tuple[ContactAnswer, FloatArray]], series: Series
) -> Fixes:
    """Return the places of all contacts and modes at their times.

    Parameters
    ----------
    answers
        Answer of each contact, with the times wanted in seconds.
    series
        The table that they came from.
    """
    parts = [
        _at_times(answer, number, mode, times)
        for answer, times in answers
        for number, mode in enumerate(answer.modes, 1)
    ]

    def gather(name: str) -> FloatArray:
        return np.concatenate([np.empty(0), *(part[name] for part in parts)])

    time, east, north = gather("time_s"), gather("east_m"), gather("north_m")
    latitude = longitude = np.full(time.shape, np.nan)
    origins = [answer.data.platforms for answer, _ in answers]
    origin = next((one.origin for one in origins if one is not None), None)
    if origin is not None:
        latitude, longitude = to_latitude_longitude(east, north, origin)
    start = series.start_utc_ns
    names = [
        np.repeat(",".join(answer.data.platforms.name), times.size * len(answer.modes))
        for answer, times in answers
        if answer.data.platforms is not None
    ]
    return Fixes(
        contact=gather("contact").astype(np.int64),
        mode=gather("mode").astype(np.int64),
        weight=gather("weight"),
        time_s=time,
        time_utc_ns=(
            np.full(time.shape, -1, np.int64)
            if start is None
            else start + np.rint(time * NANOSECONDS).astype(np.int64)
        ),
        east_m=east,
        north_m=north,
        latitude=latitude,
        longitude=longitude,
        covariance_m2=np.concatenate(
            [np.empty((0, 2, 2)), *(part["covariance_m2"] for part in parts)]
        ),
        speed_mps=gather("speed_mps"),
        speed_std_mps=gather("speed_std_mps"),
        course_deg=gather("course_deg"),
        course_std_deg=gather("course_std_deg"),
        sensors=np.concatenate([np.empty(0, "U1"), *names]),
        origin=series.origin,
        origin_latitude=series.origin_latitude,
        origin_longitude=series.origin_longitude,
    )


def _at_times(
    answer: ContactAnswer, number: int, mode: ModeAnswer, times: FloatArray
) -> dict[str, FloatArray]:
    """Carry a mode to the times: the covariance grows with the lag."""
    platforms = answer.data.platforms
    if platforms is None:
        msg = "fixes are of sensors whose places are known"
        raise TypeError(msg)
    state, covariance = grid_state(mode, platforms)
    if not mode.observability.observable[2:4].all():  # a place, and no velocity
        covariance[2:, :] = covariance[:, 2:] = 0.0
        covariance[[2, 3], [2, 3]] = 1e3 * VESSEL_VELOCITY_STD_MPS**2
    covariance = _with_vessel_prior(covariance)
    lag = times - answer.data.time_s[0]
    transition = np.tile(np.eye(4), (times.size, 1, 1))
    transition[:, 0, 2] = transition[:, 1, 3] = lag
    places = transition @ state
    spread = transition @ covariance @ np.swapaxes(transition, 1, 2)
    speed = max(float(np.hypot(*state[2:])), 1e-9)
    along = state[2:] / speed
    across = np.array([along[1], -along[0]])
    own = covariance[2:, 2:]
    count = np.ones(times.size)
    return {
        "contact": answer.data.contact * count,
        "mode": number * count,
        "weight": mode.weight * count,
        "time_s": times,
        "east_m": places[:, 0],
        "north_m": places[:, 1],
        "covariance_m2": spread[:, :2, :2],
        "speed_mps": speed * count,
        "speed_std_mps": np.sqrt(along @ own @ along) * count,
        "course_deg": np.degrees(np.arctan2(*state[2:])) % 360.0 * count,
        "course_std_deg": (
            np.degrees(min(np.sqrt(across @ own @ across) / speed, np.pi)) * count
        ),
    }


def _with_vessel_prior(covariance: FloatArray) -> FloatArray:
    """Bound the velocity's deviation by that of vessels in general."""
    precision = np.zeros((4, 4))
    precision[[2, 3], [2, 3]] = VESSEL_VELOCITY_STD_MPS**-2
    # C (I + P C)^-1: the covariance itself may be singular, its inverse is not needed
    joint = covariance @ np.linalg.inv(np.eye(4) + precision @ covariance)
    return np.asarray(0.5 * (joint + joint.T))
