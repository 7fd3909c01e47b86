"""Delay of a bottom or surface bounce behind the direct path, and what it tells of range.

**Method.** The reflecting plane is level and the sound speed constant: the reflected path
is the straight one from the image of the source (Urick 1983, ch. 5; Hassab 1976). With the distances a and b of sensor and source from the plane and
the slant range R, its length is sqrt(R^2 + 4 a b), and it comes late by

    tau = k (sqrt(R^2 + 4 a b) - R) / c = k 4 a b / (c (sqrt(R^2 + 4 a b) + R)).

The depths are not known exactly. Far away the delay is in proportion to a b, so that one
factor k, of mean one, holds their errors: it is an unknown of the fit with a prior, and is
projected out as the rest frequencies are.

**Limits.** Nearer than a and b the delay depends less on the depths than k says. What the
source moves between the two emissions is left out, some parts in a thousand. Rays are
straight: in a strong gradient of the sound speed, or over a slope, the range is biased.

**References.** Urick (1983), Principles of Underwater Sound; Hassab (1976), Passive
tracking of a moving source by a single observer in shallow water, J. Sound Vib. 44, 127.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import OptionError
from uwtrack_cli.motion.options import BounceGeometry
from uwtrack_cli.motion.passage.fit.nuisances import SENSOR_DEPTH_STD_M

SMALLEST_RELATIVE_STD = 1e-6
"""Deviation of the factor of depths that are known exactly."""


@dataclass(frozen=True)
class Bounce:
    """The path that one level plane reflects."""

    sensor_m: float
    """Distance of the sensor from the plane, m."""
    source_m: float
    """Distance of the source from the plane, m."""
    height_m: float
    """Depth of the sensor below the source, m."""
    relative_std: float
    """Prior deviation of the factor of the delay."""
    words: str
    """The geometry that was told, in words."""

    @property
    def most_m(self) -> float:
        """Longest detour, of a source above or below the sensor, m."""
        return 2.0 * min(self.sensor_m, self.source_m)

    def delay_s(self, range_m: FloatArray, sound_speed_mps: float) -> tuple[FloatArray, FloatArray]:
        """Return delays, s, and their partials by the slant range, s/m, of any shape.

        Examples
        --------
        >>> one = Bounce(30.0, 20.0, 10.0, 0.1, "")
        >>> delay, slope = one.delay_s(np.array([10.0]), 1500.0)
        >>> round(float(delay[0]) * 1500.0, 6)
        40.0
        """
        product = 4.0 * self.sensor_m * self.source_m
        reflected = np.sqrt(range_m**2 + product)
        delay = product / (sound_speed_mps * (reflected + range_m))
        return delay, -delay / reflected


def _charted_std_m(depth_m: float) -> float:
    """Return the deviation of a depth of a chart, m (IHO S-44 (2020), order 2).

    That standard's vertical uncertainty is sqrt(1 m^2 + (0.023 depth)^2) at 95 %.
    """
    return float(np.hypot(1.0, 0.023 * depth_m)) / 1.96


def bounce_of(given: BounceGeometry, sensor: Sensor | None) -> Bounce:
    """Return the reflected path of what was told of the depths.

    Raises
    ------
    OptionError
        A depth is missing, or sensor or source lie beyond the plane.
    """
    depth_m, depth_std_m = given.sensor_depth_m, None
    if depth_m is None and sensor is not None and sensor.depth_m is not None:
        depth_m, depth_std_m = sensor.depth_m, sensor.depth_std_m
    if depth_std_m is None:
        depth_std_m = SENSOR_DEPTH_STD_M
    if depth_m is None:
        raise OptionError(
            "bounce_delay_s tells a range only with the depth of the sensor: give "
            "--bounce-sensor-depth-m, or depth_m in the sensor file."
        )
    source_m = given.source_depth_m
    stds = [depth_std_m, given.source_depth_std_m]
    words = f"sensor at {depth_m:g} m, source at {source_m:g} m"
    if given.source_depth_std_m:
        words += f" within {given.source_depth_std_m:g} m"
    if given.path == "surface":
        away = np.array([depth_m, source_m])
        water_std = 0.0
    else:
        if given.water_depth_m is None:
            raise OptionError(
                "bounce_delay_s of the bottom tells a range only with the depth of the "
                "water: give --bounce-water-depth-m, or --bounce-path surface for "
                "delays of the surface."
            )
        away = given.water_depth_m - np.array([depth_m, source_m])
        told = given.water_depth_std_m
        water_std = _charted_std_m(given.water_depth_m) if told is None else told
        words = f"water of {given.water_depth_m:g} m within {water_std:.2g} m, {words}"
    if away.min() <= 0.0:
        raise OptionError(
            f"no path is reflected by the {given.path}: {words}. Sensor and source must lie "
            f"between surface and bottom."
        )
    parts = [*(np.array(stds) / away), water_std * float((1.0 / away).sum())]
    return Bounce(
        sensor_m=float(away[0]),
        source_m=float(away[1]),
        height_m=depth_m - source_m,
        relative_std=max(float(np.linalg.norm(parts)), SMALLEST_RELATIVE_STD),
        words=f"{given.path} bounce, {words}",
    )
