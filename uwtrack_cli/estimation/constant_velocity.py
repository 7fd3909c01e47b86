"""Nearly constant velocity: how a position and its rate go on, and how uncertain.

**Method.** The acceleration is white noise, or it is constant between two times and
drawn anew at each; both give the covariance of position and rate in closed form. Every
filter takes its transition and its process noise from here.

**Conventions.** One component of motion: position first, its rate second. Several
components are Kronecker products with the identity.

**References.** Bar-Shalom, Li & Kirubarajan, "Estimation with Applications to Tracking
and Navigation" (2001), sections 6.2.2 (continuous), 6.3.2 (piecewise constant) and 11.7.1
(turns).
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray


class WhiteNoise(NamedTuple):
    """Covariance of position and rate per unit density of the acceleration."""

    position: float | FloatArray
    """T^3 / 3, s^3."""
    covariance: float | FloatArray
    """T^2 / 2, s^2."""
    rate: float | FloatArray
    """T, s."""

    @property
    def matrix(self) -> FloatArray:
        """The covariance of one step, shape (2, 2)."""
        both = self.covariance
        return np.array([[self.position, both], [both, self.rate]])


def white_acceleration(step_s: float | FloatArray) -> WhiteNoise:
    """Return the process noise of white acceleration of unit density over a step, s.

    Examples
    --------
    >>> white_acceleration(2.0).covariance
    2.0
    """
    return WhiteNoise(step_s**3 / 3.0, step_s**2 / 2.0, step_s)


def transition(step_s: float) -> FloatArray:
    """Return F = [[1, T], [0, 1]] of a time step in s."""
    return np.array([[1.0, step_s], [0.0, 1.0]])


def carried_on(
    state: FloatArray, covariance: FloatArray, lag_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a state (x, y and their rates) and its covariance after lags, s."""
    forward = np.tile(np.eye(4), (lag_s.size, 1, 1))
    forward[:, 0, 2] = forward[:, 1, 3] = lag_s
    return forward @ state, forward @ covariance @ np.swapaxes(forward, 1, 2)


def constant_velocity(
    interval_s: float, acceleration_variance: float, dimension: int
) -> tuple[FloatArray, FloatArray]:
    """Return F and Q of components alike whose acceleration is constant over the step.

    The variance of the acceleration is in unit^2/s^4; the state is in the order z_1,
    v_1, z_2, v_2 ...

    Examples
    --------
    >>> constant_velocity(1.0, 10.0, 1)[1].tolist()
    [[2.5, 5.0], [5.0, 10.0]]
    """
    to_position, to_rate = 0.5 * interval_s**2, interval_s
    forward, noise = np.eye(2 * dimension), np.zeros((2 * dimension, 2 * dimension))
    position = np.arange(0, 2 * dimension, 2)
    rate = position + 1
    forward[position, rate] = interval_s
    noise[position, position] = acceleration_variance * (to_position * to_position)
    noise[rate, rate] = acceleration_variance * (to_rate * to_rate)
    both = acceleration_variance * (to_position * to_rate)
    noise[position, rate] = noise[rate, position] = both
    return forward, noise


def coordinated_turn(interval_s: float, turn_rate_radps: float) -> FloatArray:
    """Return F of two components of a plane whose velocity turns from first to second.

    The rate is not 0; the state is in the order z_1, v_1, z_2, v_2.

    Examples
    --------
    >>> (coordinated_turn(1.0, np.pi / 2) @ [0.0, 3.0, 0.0, 0.0]).round(3).tolist()
    [1.91, 0.0, 1.91, 3.0]
    """
    angle = turn_rate_radps * interval_s
    sine, cosine = np.sin(angle), np.cos(angle)
    along, aside = sine / turn_rate_radps, (1.0 - cosine) / turn_rate_radps
    return np.array([
        [1.0, along, 0.0, -aside], [0.0, cosine, 0.0, -sine],
        [0.0, aside, 1.0, along], [0.0, sine, 0.0, cosine],
    ])  # fmt: skip
