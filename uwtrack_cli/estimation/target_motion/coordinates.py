"""Coordinates of the unknown motion, and the way from one set to another.

**Conventions.** The solver works in q = (ln R, bearing, vx, vy): the likelihood is
closest to a parabola there. People read p = (R, bearing, speed, course). The model
takes the state (x, y, vx, vy). *Polar* solver coordinates (ln R, bearing, speed,
course) serve the intervals of speed and course.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray


def to_state(q: FloatArray, *, polar: bool = False) -> FloatArray:
    """Turn solver coordinates into (x, y, vx, vy)."""
    distance = np.exp(q[..., 0])
    x, y = distance * np.sin(q[..., 1]), distance * np.cos(q[..., 1])
    vx, vy = q[..., 2], q[..., 3]
    if polar:
        vx, vy = vx * np.sin(vy), vx * np.cos(vy)
    return np.stack([x, y, vx, vy], -1)


def state_jacobian(q: FloatArray, *, polar: bool = False) -> FloatArray:
    """Differentiate the state by the solver coordinates (trial, state, q)."""
    distance = np.exp(q[:, 0])
    x, y = distance * np.sin(q[:, 1]), distance * np.cos(q[:, 1])
    jacobian = np.zeros((q.shape[0], 4, 4))
    jacobian[:, 0, 0], jacobian[:, 0, 1] = x, y
    jacobian[:, 1, 0], jacobian[:, 1, 1] = y, -x
    if polar:
        sine, cosine = np.sin(q[:, 3]), np.cos(q[:, 3])
        jacobian[:, 2, 2], jacobian[:, 2, 3] = sine, q[:, 2] * cosine
        jacobian[:, 3, 2], jacobian[:, 3, 3] = cosine, -q[:, 2] * sine
    else:
        jacobian[:, 2, 2] = jacobian[:, 3, 3] = 1.0
    return jacobian


def to_polar(q: FloatArray) -> FloatArray:
    """Turn (ln R, bearing, vx, vy) into (ln R, bearing, speed, course)."""
    speed = np.hypot(q[..., 2], q[..., 3])
    course = np.arctan2(q[..., 2], q[..., 3])
    return np.stack([q[..., 0], q[..., 1], speed, course], -1)


def from_motion(
    range_m: FloatArray, bearing_rad: FloatArray, speed_mps: FloatArray,
    course_rad: FloatArray,
) -> FloatArray:  # fmt: skip
    """Turn range, bearing, speed and course into solver coordinates.

    A negative range or speed is the same vessel on the opposite bearing or
    course; both are brought to the positive form.
    """
    bearing = np.where(range_m < 0, bearing_rad + np.pi, bearing_rad)
    distance = np.log(np.maximum(np.abs(range_m), 1e-6))
    vx, vy = speed_mps * np.sin(course_rad), speed_mps * np.cos(course_rad)
    return np.stack([distance, np.mod(bearing, 2.0 * np.pi), vx, vy], -1)


def to_motion(q: FloatArray) -> FloatArray:
    """Turn solver coordinates into (R, bearing, speed, course), SI, normalised."""
    p = to_polar(q)
    p[..., 0] = np.exp(p[..., 0])
    p[..., [1, 3]] = np.mod(p[..., [1, 3]], 2.0 * np.pi)
    return p


def motion_jacobian(q: FloatArray) -> FloatArray:
    """Differentiate (R, bearing, speed, course) by solver coordinates."""
    speed = np.maximum(np.hypot(q[:, 2], q[:, 3]), 1e-9)
    sine, cosine = q[:, 2] / speed, q[:, 3] / speed
    jacobian = np.zeros((q.shape[0], 4, 4))
    jacobian[:, 0, 0] = np.exp(q[:, 0])
    jacobian[:, 1, 1] = 1.0
    jacobian[:, 2, 2], jacobian[:, 2, 3] = sine, cosine
    jacobian[:, 3, 2], jacobian[:, 3, 3] = cosine / speed, -sine / speed
    return jacobian
