"""Disturbances as a scenario states them: weather, animals, machines.

**Conventions.** Densities in dB re 1 uPa^2/Hz and levels in dB re 1 uPa hold at the
sensor. Times are seconds from the first sample. Everything random is drawn from the
seed of the scenario; what the ambient noise does is common to all sensors.
"""

from dataclasses import dataclass
from typing import Annotated

from uwtrack_cli.data.options import Above, AtLeast, AtMost, Increasing, OptionGroup, Unit
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.track_plans import Course, Moment
from uwtrack_cli.simulate.vessels import CorrelationTime, Frequency, JitterFraction, Level

Duration = Annotated[float, Unit("s"), AtLeast(0.01), AtMost(1e6)]
Rate = Annotated[float, Unit("1/min"), Above(0.0), AtMost(6000.0)]
Peak = Annotated[float, Unit("dB"), AtLeast(-100.0), AtMost(300.0)]


@dataclass(frozen=True, kw_only=True)
class LevelDrift(OptionGroup):
    """Slow random change of the ambient level: a Gauss-Markov process, limited."""

    range_db: Annotated[float, Unit("dB"), AtLeast(0.0), AtMost(40.0)] = 8.0
    """Greatest deviation to either side, dB; the course is this times tanh of a
    process of unit deviation."""
    correlation_s: CorrelationTime = 600.0
    """Correlation time, s."""


@dataclass(frozen=True, kw_only=True)
class Swell(OptionGroup):
    """Regular rise and fall of the ambient level."""

    amplitude_db: Annotated[float, Unit("dB"), AtLeast(0.0), AtMost(40.0)] = 6.0
    """Greatest deviation to either side, dB."""
    period_s: Annotated[float, Unit("s"), AtLeast(0.5), AtMost(1e4)] = 10.0
    """Period, s."""


@dataclass(frozen=True, kw_only=True)
class Rain(OptionGroup):
    """A squall: noise that is white above a corner and falls by 12 dB an octave below."""

    peak_s: Moment
    """Middle of the time of full strength, s."""
    density_db: Level
    """Density at full strength, above the corner, dB re 1 uPa^2/Hz."""
    rise_s: Duration = 60.0
    """Time in which it rises to full strength, s."""
    hold_s: Annotated[float, Unit("s"), AtLeast(0.0), AtMost(1e6)] = 60.0
    """Time at full strength, s."""
    fall_s: Duration = 120.0
    """Time in which it falls off, s."""
    corner_hz: Frequency = 500.0
    """Corner frequency, Hz."""


@dataclass(frozen=True, kw_only=True)
class Gusts(OptionGroup):
    """Wind and flow noise in gusts: flat below a corner, 12 dB an octave above."""

    density_db: Level
    """Density at the middle of a gust, below the corner, dB re 1 uPa^2/Hz."""
    rate_per_min: Rate = 4.0
    """Mean number of gusts per minute."""
    duration_s: Duration = 8.0
    """Length of a gust, s."""
    corner_hz: Frequency = 200.0
    """Corner frequency, Hz."""


@dataclass(frozen=True, kw_only=True)
class Shrimp(OptionGroup):
    """Snapping shrimp: very short bursts above a frequency, from all directions."""

    rate_per_min: Annotated[float, Unit("1/min"), Above(0.0), AtMost(60e3)] = 1200.0
    """Mean number of snaps per minute."""
    peak_db: Peak
    """Median peak pressure, dB re 1 uPa."""
    spread_db: Annotated[float, Unit("dB"), AtLeast(0.0), AtMost(30.0)] = 6.0
    """Standard deviation of the peak pressures, dB."""
    lowest_hz: Frequency = 2000.0
    """Lowest frequency of a snap, Hz; above half the sample rate there are none."""


@dataclass(frozen=True, kw_only=True)
class Knocks(OptionGroup):
    """Knocks of moorings and frames: damped oscillations at random times."""

    rate_per_min: Rate = 4.0
    """Mean number of knocks per minute."""
    peak_db: Peak
    """Median peak pressure, dB re 1 uPa."""
    spread_db: Annotated[float, Unit("dB"), AtLeast(0.0), AtMost(30.0)] = 3.0
    """Standard deviation of the peak pressures, dB."""
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(1.0), AtMost(1e5), Increasing()] = (
        50.0,
        400.0,
    )
    """Frequencies between which that of each knock is drawn, Hz."""
    decay_s: Annotated[float, Unit("s"), AtLeast(1e-3), AtMost(1.0)] = 0.1
    """Time in which the amplitude falls to 1/e, s."""


@dataclass(frozen=True, kw_only=True)
class Machine(OptionGroup):
    """A machine that stays where it is: harmonics that drift, step and switch."""

    fundamental_hz: Frequency
    """Frequency of the first harmonic, Hz."""
    levels_db: tuple[Level, ...]
    """Root-mean-square level of each harmonic at the sensor, dB re 1 uPa."""
    bearing_deg: Course | None = None
    """Bearing from every sensor, compass degrees; None is a hum of the housing, which
    has gains of its own in each channel."""
    fraction: JitterFraction = 0.0
    """Standard deviation of the relative frequency."""
    correlation_s: CorrelationTime = 120.0
    """Correlation time of its variation, s."""
    step_fraction: Annotated[float, Unit("1"), AtLeast(0.0), AtMost(0.5)] = 0.0
    """Greatest relative step of the speed; each is drawn between a fifth of it and the
    whole, to either side of the nominal speed."""
    step_every_s: Duration = 120.0
    """Mean time between two steps, s."""
    on_s: Duration | None = None
    """Mean time for which the machine runs, s; None is always."""
    off_s: Duration | None = None
    """Mean time for which it stands still, s."""

    def __post_init__(self) -> None:
        """Refuse a machine that switches one way only, or makes no sound."""
        super().__post_init__()
        if (self.on_s is None) != (self.off_s is None):
            raise OptionError("on_s and off_s go together.")
        if not self.levels_db:
            raise OptionError("levels_db must name the level of one harmonic or more.")
