"""From the channels of a vector sensor to intensities towards east and north.

**Method.** A recorded dipole holds its own signal times a gain, a share of the other
dipole and a share of the omni channel (`Sensor.dipole_response`). The active intensity
is linear in the dipole, so what the shares add to it is taken off the intensity itself;
then it is turned from the axes of the sensor to east and north.

**Conventions.** Compass degrees, clockwise. Where the axes turn with the housing, x
points to its starboard side and y ahead.

**References.** D'Spain et al. (1991), J. Acoust. Soc. Am. 89, 1134 (active intensity).
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.estimation.angles import interpolate_deg


def directional_channels(sensor: Sensor) -> tuple[int, ...]:
    """Return the columns of the omni channel and, of a vector sensor, both dipoles."""
    names = sensor.channel_names
    omni = names.index("omni") if "omni" in names else 0
    if not sensor.has_direction:
        return (omni,)
    axes = ("east", "north") if "east" in names else ("x", "y")
    return (omni, *(names.index(axis) for axis in axes))


def true_components(
    sensor: Sensor, frames: Frames, power: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return intensities to the east and to the north, shape (frame, frequency).

    Of the power of the omni channel and the real parts of omni times conjugate dipole,
    for both in the order of the channels' meaning (east or x, north or y), same shape.
    """
    first, second = _ideal(sensor.dipole_response, power, first, second)
    turns = "x" in sensor.channel_names
    turn = np.radians(turn_deg(sensor, turns, frames))[:, None]
    cos, sin = np.cos(turn).astype(np.float32), np.sin(turn).astype(np.float32)
    return first * cos + second * sin, second * cos - first * sin


def _ideal(
    response: FloatArray, power: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the intensities that ideal dipoles would have given."""
    if np.array_equal(response, np.eye(2, 3)):
        return first, second
    undo = np.linalg.inv(response[:, :2]).astype(np.float32)
    leak = response[:, 2].astype(np.float32)
    left = first - leak[0] * power, second - leak[1] * power
    return (
        undo[0, 0] * left[0] + undo[0, 1] * left[1],
        undo[1, 0] * left[0] + undo[1, 1] * left[1],
    )


def turn_deg(sensor: Sensor, turns: bool, frames: Frames) -> FloatArray:
    """Return the angle of frames from the sensor's own axes to east and north, degrees.

    The axes of some sensors turn with their housing.
    """
    offset = np.full(frames.n_frames, sensor.compass_offset_deg)
    if not turns:
        return offset
    navigation = sensor.navigation
    if navigation is None or np.isnan(navigation.heading_deg).all():
        return offset + sensor.heading_deg
    time_s = frames.time_s
    if navigation.start_utc_ns is not None and frames.start_utc_ns is not None:
        time_s = time_s + (frames.start_utc_ns - navigation.start_utc_ns) / 1e9
    heading = interpolate_deg(time_s, navigation.time_s, navigation.heading_deg)
    return offset + sensor.heading_deg + heading
