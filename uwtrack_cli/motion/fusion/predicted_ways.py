"""Where a vessel is at any time by its motion, and how certain: straight, or manoeuvring.

**Method.** A state at one time is carried to others along a straight line, along the
other leg of a manoeuvre, or along an even turn (`steady_turn`). The covariance follows
the way; what is not certain of the manoeuvre widens it, by differences in a turn.

**Conventions.** States are east, north (m) and their rates (m/s), shape (n, 4), of n times
in s, with covariances of shape (n, 4, 4).
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.fusion.sensor_table import EvenTurn, OtherLeg
from uwtrack_cli.motion.fusion.track_to_track import Mode
from uwtrack_cli.motion.passage.model.steady_turn import SteadyTurn, turned_way

TURN_STEPS = (1e-4, 1e-2, 1e-2)
"""Steps of the differences by the angle (rad), the duration and the middle (s)."""


def turned_way_of(
    mode: Mode, bend: EvenTurn, times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return states and covariances of a mode that turns evenly."""
    (at,), (spread,) = mode.at(np.array([bend.closest_s]))
    course = np.radians(bend.course_deg)
    # in a mode of the opposite side the vessel goes the opposite way
    turn = bend.turn * np.sign(at[2:] @ [np.sin(course), np.cos(course)])
    away = -turn * np.array([[0.0, 1.0], [-1.0, 0.0]])
    # the turn itself, then a small step of its angle, its duration and its middle
    steps = np.concatenate([np.zeros((1, 3)), np.diag(TURN_STEPS)])
    turns = SteadyTurn(*(bend.values + steps).T)
    way, heading = turned_way(times, bend.closest_s, turns)
    moved = np.zeros((4, times.size, 4, 4))
    moved[:, :, range(4), range(4)] = [1.0, 1.0, 0.0, 0.0]
    both = np.stack([way, heading])[..., None, None]
    for rows, part in zip((slice(0, 2), slice(2, 4)), both, strict=True):
        moved[:, :, rows, 2:] = part.real * np.eye(2) + part.imag * away
    states = moved @ at
    slope = (states[1:] - states[0]) / np.array(TURN_STEPS)[:, None, None]
    covariance = moved[0] @ spread @ np.swapaxes(moved[0], 1, 2)
    covariance += np.einsum("ptx,pq,qty->txy", slope, bend.covariance, slope)
    return states[0], covariance


def other_leg_way(
    mode: Mode, leg: OtherLeg, times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return states and covariances of a mode on the other side of its manoeuvre."""
    (at,), (spread,) = mode.at(np.array([leg.time_s]))
    along = mode.state[2:] / np.hypot(*mode.state[2:])
    course = np.radians(leg.course_deg)
    # in a mode of the opposite side the vessel goes the opposite way
    turn = leg.turn * np.sign(along @ [np.sin(course), np.cos(course)])
    away = -turn * np.array([along[1], -along[0]])
    velocity = leg.along_away_mps[0] * along + leg.along_away_mps[1] * away
    unit = velocity / max(float(np.hypot(*velocity)), 1e-9)
    axes = np.stack([unit, [unit[1], -unit[0]]], axis=1) * leg.std_mps
    own = axes @ axes.T
    turned = np.outer(velocity - mode.state[2:], velocity - mode.state[2:])
    lag = (times - leg.time_s)[:, None]
    state = np.concatenate(
        [at[:2] + lag * velocity, np.tile(velocity, (times.size, 1))], axis=1
    )
    covariance = np.zeros((times.size, 4, 4))
    place = spread[:2, :2] + leg.time_std_s**2 * turned
    covariance[:, :2, :2] = place + lag[..., None] ** 2 * own
    covariance[:, :2, 2:] = covariance[:, 2:, :2] = lag[..., None] * own
    covariance[:, 2:, 2:] = own
    return state, covariance
