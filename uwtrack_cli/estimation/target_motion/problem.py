"""The inverse problem: what was measured, from where, and with which model.

**Conventions.** East is x, north is y, angles are radians clockwise from north,
everything else SI. Times and positions are relative to own ship at the first
measurement. The last axis of every array is the measurement row; a leading axis of
the data counts independent records of one geometry (Monte Carlo runs), normally
one. A weight is the inverse of a standard deviation and zero where nothing was
measured.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray

Loss = Literal["squares", "huber", "student", "tukey"]
Doppler = Literal["instantaneous", "interval"]


@dataclass(frozen=True, eq=False)
class Track:
    """Own ship at the instants that the model needs (nodes), rows refer to them.

    With ``before`` the Doppler of a row is the mean over the interval that ends
    there; without it the Doppler is that of the instant, with own velocity.
    """

    time_s: FloatArray
    east_m: FloatArray
    north_m: FloatArray
    now: IntArray
    before: IntArray | None
    interval_s: FloatArray
    velocity_mps: FloatArray

    def rows(self, index: IntArray | slice) -> "Track":
        """Keep some rows, and only the nodes that they need."""
        now = self.now[index]
        before = None if self.before is None else self.before[index]
        wanted = now if before is None else np.concatenate([before, now])
        nodes = np.unique(wanted)
        return Track(
            time_s=self.time_s[nodes],
            east_m=self.east_m[nodes],
            north_m=self.north_m[nodes],
            now=np.searchsorted(nodes, now),
            before=None if before is None else np.searchsorted(nodes, before),
            interval_s=self.interval_s[index],
            velocity_mps=self.velocity_mps[:, index],
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """Measurements of one contact with their weights, and the physics assumed.

    ``bearing_rad`` has axes (record, stream, row) and ``frequency_hz`` axes
    (record, line, row); with ``array_heading_rad`` a bearing tells only the angle
    to that heading, not the side. ``frequency_share`` is the factor by which the
    squared weights of frequencies were lowered below their inverse variances;
    ``height_m`` is the depth between sensor and source.
    """

    track: Track
    bearing_rad: FloatArray
    bearing_weight: FloatArray
    frequency_hz: FloatArray
    frequency_weight: FloatArray
    sound_speed_mps: float
    delayed: bool = False
    array_heading_rad: FloatArray | None = None
    loss: Loss = "squares"
    frequency_share: float = 1.0
    height_m: float = 0.0

    @property
    def n_rows(self) -> int:
        """Number of measurement rows."""
        return int(self.track.now.size)

    @property
    def n_lines(self) -> int:
        """Number of frequency lines."""
        return int(self.frequency_weight.shape[0])

    @property
    def n_values(self) -> int:
        """Number of measured values."""
        return int(
            np.count_nonzero(self.bearing_weight)
            + np.count_nonzero(self.frequency_weight)
        )

    @property
    def row_time_s(self) -> FloatArray:
        """Time of every row from the first measurement, s."""
        return self.track.time_s[self.track.now]

    def rows(self, index: IntArray | slice) -> "Problem":
        """Keep some rows of the measurements."""
        heading = self.array_heading_rad
        return replace(
            self,
            track=self.track.rows(index),
            bearing_rad=self.bearing_rad[:, :, index],
            bearing_weight=self.bearing_weight[:, index],
            frequency_hz=self.frequency_hz[:, :, index],
            frequency_weight=self.frequency_weight[:, index],
            array_heading_rad=None if heading is None else heading[index],
        )

    def record(self, index: int) -> "Problem":
        """Keep one record."""
        chosen = slice(index, index + 1)
        return replace(
            self,
            bearing_rad=self.bearing_rad[chosen],
            frequency_hz=self.frequency_hz[chosen],
        )


def wrap_rad(angle_rad: FloatArray) -> FloatArray:
    """Wrap angles into [-pi, pi].

    Examples
    --------
    >>> float(np.degrees(wrap_rad(np.radians(350.0) - np.radians(10.0))).round(9))
    -20.0
    """
    turn = 2.0 * np.pi
    return np.asarray(angle_rad - turn * np.rint(angle_rad / turn))
