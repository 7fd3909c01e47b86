"""Options of target motion analysis that belong together."""

from dataclasses import dataclass
from typing import Annotated, Literal

from uwtrack_cli.constants import SOURCE_DEPTH_M, SOURCE_DEPTH_STD_M
from uwtrack_cli.data.options import Above, AtLeast, AtMost, Below, Increasing, OptionGroup, Unit

Probability = Annotated[float, Above(0), Below(1)]
"""A probability that is neither impossible nor certain."""

Depth = Annotated[float, Unit("m"), AtLeast(0), AtMost(11_000)]
"""A depth below the surface, or its deviation, m."""

Spreading = Annotated[float, Unit("dB"), AtLeast(1), AtMost(60)]
"""Loss of level per decade of range, dB."""


@dataclass(frozen=True)
class MotionModel(OptionGroup):
    """How sound travels and what a frequency is a mean of.

    Parameters
    ----------
    doppler
        Whether a frequency is that of its instant or the mean over the interval
        that ends there.
    interval_s
        That interval, or the span over which own velocity is taken; by default
        the window of the spectra, or the median spacing of the rows of a table.
    propagation
        Whether sound takes its time or arrives at once; auto is delayed for lines
        made from sound and instant for tables.
    tow_length_m
        Distance from own ship back to the end of a towed array whose heading was taken
        from own ship: bearings weigh less until all of it has passed a turn. By default
        300 m where array_heading is course, and in tables of sensors whose arrays have
        their ship's heading; else 0.
    """

    doppler: Literal["instantaneous", "interval"] = "instantaneous"
    interval_s: Annotated[float | None, Unit("s"), AtLeast(1e-3), AtMost(1e6)] = None
    propagation: Literal["auto", "delayed", "instant"] = "auto"
    tow_length_m: Annotated[float | None, Unit("m"), AtLeast(0), AtMost(1e5)] = None


@dataclass(frozen=True)
class Nuisances(OptionGroup):
    """How well sound speed, compass and own ship are known; 0 is exactly.

    Parameters
    ----------
    sound_speed_std_mps
        Standard deviation of the sound speed; by default that of the sensor, else 0.5 %
        of a speed that is given and 1 % of the nominal one.
    compass_std_deg
        Standard deviation of the compass, one error for all bearings; by default that
        of the sensor, else 1 degree for own ship.
    position_std_m
        Standard deviation of each coordinate of own position; by default that of the
        sensor file, else 10 m for a platform with navigation.
    velocity_std_mps
        Standard deviation of each component of own velocity; by default that of the
        sensor file, else 0.1 m/s for a platform with navigation.
    correlation_time_s
        Correlation time of own position and velocity.
    """

    sound_speed_std_mps: Annotated[float | None, Unit("m/s"), AtLeast(0), AtMost(1e8)] = None
    compass_std_deg: Annotated[float | None, Unit("degree"), AtLeast(0), AtMost(180)] = None
    position_std_m: Annotated[float | None, Unit("m"), AtLeast(0), AtMost(1e6)] = None
    velocity_std_mps: Annotated[float | None, Unit("m/s"), AtLeast(0), AtMost(100)] = None
    correlation_time_s: Annotated[float, Unit("s"), AtLeast(1e-3), AtMost(1e6)] = 100.0


@dataclass(frozen=True)
class BounceGeometry(OptionGroup):
    """Depths by which delays of a reflected path (bounce_delay_s) tell the range.

    Parameters
    ----------
    path
        Whether the delays are those of the bottom or of the surface.
    water_depth_m
        Depth of the water, for delays of the bottom.
    water_depth_std_m
        Standard deviation of that depth, 0 for exactly known; by default that of a chart
        (order 2 of IHO S-44).
    sensor_depth_m
        Depth of the sensor; by default that of the sensor file.
    source_depth_m
        Depth of the target's source; by default that of a surface vessel's propeller.
    source_depth_std_m
        Standard deviation of that depth, 0 for exactly known.
    """

    path: Literal["bottom", "surface"] = "bottom"
    water_depth_m: Depth | None = None
    water_depth_std_m: Depth | None = None
    sensor_depth_m: Depth | None = None
    source_depth_m: Depth = SOURCE_DEPTH_M
    source_depth_std_m: Depth = SOURCE_DEPTH_STD_M


@dataclass(frozen=True)
class Search(OptionGroup):
    """Where the motion is sought and when another reading still counts.

    Parameters
    ----------
    range_limits_m
        Smallest and largest range at the start.
    speed_limit_mps
        Largest speed to the east and to the north.
    confidence
        Probability of the likelihood-ratio region that modes must lie in.
    """

    range_limits_m: Annotated[
        tuple[float, float], Unit("m"), AtLeast(1e-3), AtMost(1e8), Increasing()
    ] = (20.0, 200_000.0)
    speed_limit_mps: Annotated[float, Unit("m/s"), AtLeast(1e-3), Below(100)] = 18.0
    confidence: Probability = 0.95


@dataclass(frozen=True)
class Misfit(OptionGroup):
    """How deviations of the measurements are taken and outliers weighed.

    Parameters
    ----------
    loss
        Loss of a residual: squares is efficient for clean data; huber bounds the
        influence of outliers; student (four degrees of freedom) and tukey nearly remove
        them and cost 3 to 8 % of precision on clean data. auto is squares for stated
        deviations and student for others, and separates bearings of other sources if
        the misfit is large.
    line_weighting
        Whether every line counts by its deviation, or the lines together count as
        one, as in the paper; the mean loses 1 to 11 % of precision.
    bearing_std_deg
        Standard deviation of bearings that have none; by default from their scatter.
    frequency_std_hz
        Standard deviation of frequencies that have none; by default from their scatter.
    """

    loss: Literal["auto", "squares", "huber", "student", "tukey"] = "auto"
    line_weighting: Literal["sum", "mean"] = "sum"
    bearing_std_deg: Annotated[float | None, Unit("degree"), AtLeast(1e-9), AtMost(180)] = None
    frequency_std_hz: Annotated[float | None, Unit("Hz"), AtLeast(1e-12), AtMost(1e6)] = None
