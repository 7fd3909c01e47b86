"""The inverse problem: what was measured, from where, and with which model.

**Conventions.** East is x, north is y, angles are radians clockwise from north,
everything else SI. Times and positions are relative to own ship at the first
measurement. The last axis of every array is the measurement row; a leading axis of
the data counts independent records of one geometry (Monte Carlo runs), normally
one. A weight is the inverse of a standard deviation and zero where nothing was
measured. Throughout the room ``problem`` is one record unless said, ``q`` a motion in
solver coordinates, shape (4,), or one per row, and ``limits`` the bounds of the search.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.motion.target_motion.bounce import Bounce
from uwtrack_cli.motion.target_motion.own_ship import ObserverTrack

Loss = Literal["squares", "huber", "student", "tukey"]


@dataclass(frozen=True)
class Expectation:
    """What is expected of a quantity before the fit."""

    mean: float
    """Mean."""
    std: float
    """Standard deviation."""

    @classmethod
    def between(cls, low: float, high: float) -> "Expectation":
        """Return mean and deviation of what lies anywhere between two limits."""
        return cls(0.5 * (low + high), (high - low) / float(np.sqrt(12.0)))


@dataclass(frozen=True)
class MotionPrior:
    """What is expected of a motion before the fit; None: nothing."""

    log_range: Expectation | None = None
    """Of the logarithm of the range at the first measurement, m."""
    speed_mps: Expectation | None = None
    """Of the speed on every leg, m/s."""
    course_rad: Expectation | None = None
    """Of the course on the first leg, rad."""
    change_std_mps: float = 4.0
    """Deviation of each component of a change of velocity, m/s."""
    log_duration: Expectation = Expectation(float(np.log(60.0)), 1.0)
    """Of the logarithm of the duration of an alteration, s."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Measurements of one contact with their weights, and the physics assumed."""

    track: ObserverTrack
    """Own ship at the instants that the model needs."""
    bearing_rad: FloatArray
    """Bearings, rad, shape (records, streams, rows)."""
    bearing_weight: FloatArray
    """Inverse deviations, 1/rad, shape (streams, rows)."""
    frequency_hz: FloatArray
    """Frequencies, Hz, shape (records, lines, rows); with a bounce its delays, s, are the
    last of the lines."""
    frequency_weight: FloatArray
    """Inverse deviations, 1/Hz, shape (lines, rows)."""
    sound_speed_mps: float
    """Sound speed, m/s."""
    delayed: bool = False
    """Whether sound takes its time."""
    array_heading_rad: FloatArray | None = None
    """Heading of a line array that cannot resolve left from right, rad, shape (rows,);
    None for bearings that resolve the side."""
    cone_std_rad: FloatArray | None = None
    """Deviations of bearings as they were measured, rad, shape (streams, rows): how near to
    its axis an array still tells angles; None until there is a heading."""
    lobe_cosine: FloatArray | None = None
    """Distance of the cosines that a line array cannot tell apart, c / (f d), shape
    (streams, rows); None, or beyond 2: there is one."""
    loss: Loss = "squares"
    """Loss of a whitened residual."""
    frequency_share: float = 1.0
    """Factor by which squared weights of frequencies lie below their inverse
    variances."""
    height_m: float = 0.0
    """Depth between sensor and source, m."""
    sensor: IntArray | None = None
    """Sensor of every row, which is its stream of bearings, shape (rows,); None for
    one platform."""
    offset_std_rad: FloatArray | None = None
    """Prior deviation of the constant error of each stream of bearings, rad, shape
    (streams,); None where it is not an unknown of the fit."""
    prior: MotionPrior = MotionPrior()
    """What is expected of the motion before the fit."""
    bounce: Bounce | None = None
    """The reflected path whose delays are the last line; None: there are no delays.
    Their rest "frequency" is the factor of the depths."""

    def __post_init__(self) -> None:
        """Keep the deviations that cones have before anything is weighed."""
        if self.array_heading_rad is not None and self.cone_std_rad is None:
            with np.errstate(divide="ignore"):
                std = 1.0 / self.bearing_weight
            object.__setattr__(self, "cone_std_rad", np.where(np.isfinite(std), std, 1.0))

    @property
    def n_rows(self) -> int:
        """Number of measurement rows."""
        return int(self.track.now.size)

    @property
    def n_lines(self) -> int:
        """Number of frequency lines, delays counting as one."""
        return int(self.frequency_weight.shape[0])

    @property
    def n_tones(self) -> int:
        """Number of frequency lines alone."""
        return self.n_lines - (self.bounce is not None)

    @property
    def rest_precision(self) -> FloatArray:
        """Prior precision of what scales each line, shape (lines,); its mean is one."""
        precision = np.zeros(self.n_lines)
        if self.bounce is not None:
            precision[-1] = self.bounce.relative_std**-2.0
        return precision

    @property
    def line_share(self) -> FloatArray:
        """Share of each line by which its squared weights were lowered, (lines,)."""
        share = np.full(self.n_lines, self.frequency_share)
        share[self.n_tones :] = 1.0
        return share

    @property
    def offset_precision(self) -> FloatArray:
        """Prior precision of the offset of each stream, 1/rad^2; inf: none is sought."""
        std = self.offset_std_rad
        if std is None:
            return np.full(self.bearing_weight.shape[0], np.inf)
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / std**2)

    @property
    def n_values(self) -> int:
        """Number of measured values."""
        return int(np.count_nonzero(self.bearing_weight) + np.count_nonzero(self.frequency_weight))

    @property
    def row_time_s(self) -> FloatArray:
        """Time of every row from the first measurement, s."""
        return self.track.time_s[self.track.now]

    def rows(self, index: IntArray | slice) -> "Problem":
        """Keep some rows of the measurements."""
        heading, cone_std, lobes = self.array_heading_rad, self.cone_std_rad, self.lobe_cosine
        return replace(
            self,
            track=self.track.rows(index),
            bearing_rad=self.bearing_rad[:, :, index],
            bearing_weight=self.bearing_weight[:, index],
            frequency_hz=self.frequency_hz[:, :, index],
            frequency_weight=self.frequency_weight[:, index],
            array_heading_rad=None if heading is None else heading[index],
            cone_std_rad=None if cone_std is None else cone_std[:, index],
            lobe_cosine=None if lobes is None else lobes[:, index],
            sensor=None if self.sensor is None else self.sensor[index],
        )

    def of_streams(self, stream: IntArray) -> "Problem":
        """Return the problem with what cones need of one stream per row, as the only one."""
        cone_std, lobes = (
            None if each is None else each[stream, np.arange(stream.size)][np.newaxis]
            for each in (self.cone_std_rad, self.lobe_cosine)
        )
        return replace(self, cone_std_rad=cone_std, lobe_cosine=lobes)

    def record(self, index: int) -> "Problem":
        """Keep one record."""
        chosen = slice(index, index + 1)
        return replace(
            self, bearing_rad=self.bearing_rad[chosen], frequency_hz=self.frequency_hz[chosen]
        )


def without_rows(problem: Problem, left_out: BoolArray) -> Problem:
    """Return a problem in which the bearings of some rows count nothing."""
    return replace(problem, bearing_weight=problem.bearing_weight * ~left_out)
