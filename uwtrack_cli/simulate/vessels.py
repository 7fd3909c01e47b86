"""What sounds: a vessel with its lines, its broadband sound, and its track.

**Conventions.** Levels in dB re 1 uPa (at 1 m for a source); C/N0 in dB-Hz and the
in-band ratio in dB hold at closest approach against the ambient noise.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.constants import SOURCE_DEPTH_M
from uwtrack_cli.data.options import Above, AtLeast, AtMost, Increasing, Key, OptionGroup, Unit
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.track_plans import (
    ClosestApproach,
    Moment,
    TrackPlan,
    Turn,
    check_turns,
    exactly_one,
)

Array = NDArray[np.float64]

RAMP_S = 5.0
"""Time in which a vessel's sound rises and falls at the ends of ``sounding_s``, s."""

Depth = Annotated[float, Unit("m"), AtLeast(0.0), AtMost(12e3)]
Frequency = Annotated[float, Unit("Hz"), AtLeast(0.1), AtMost(1e6)]
Level = Annotated[float, Unit("dB"), AtLeast(-300.0), AtMost(300.0)]
SourceLevel = Annotated[float, Unit("dB"), AtLeast(-100.0), AtMost(300.0)]
Slope = Annotated[float, Unit("dB/decade"), AtLeast(-60.0), AtMost(60.0)]
JitterFraction = Annotated[float, Unit("1"), AtLeast(0.0), AtMost(0.05)]
CorrelationTime = Annotated[float, Unit("s"), AtLeast(1.0), AtMost(1e5)]


@dataclass(frozen=True, kw_only=True)
class Line(OptionGroup):
    """A tone, or a fundamental with harmonics (each weaker by a fixed step)."""

    frequency_hz: Frequency | None = None
    """Rest frequency of a single tone, Hz; this or ``fundamental_hz`` is needed."""
    fundamental_hz: Frequency | None = None
    """Rest frequency of the first of the harmonics, Hz."""
    harmonics: Annotated[int, AtLeast(1), AtMost(1000)] = 1
    """Number of harmonics, the fundamental included."""
    step_db: Annotated[float, Unit("dB"), AtLeast(-60.0), AtMost(60.0)] = 0.0
    """Level of each harmonic over the one before, dB."""
    cn0_db_hz: Annotated[float, Unit("dB-Hz"), AtLeast(-60.0), AtMost(150.0)] | None = None
    """Power over the noise density at closest approach, dB-Hz; this or the level."""
    source_level_db: SourceLevel | None = None
    """Level at 1 m, dB re 1 uPa."""

    def __post_init__(self) -> None:
        """Refuse a line without frequency or level, or with two of one."""
        super().__post_init__()
        exactly_one(self, "frequency_hz", "fundamental_hz")
        exactly_one(self, "cn0_db_hz", "source_level_db")
        if self.frequency_hz is not None and self.harmonics > 1:
            raise OptionError("harmonics go with fundamental_hz, not with frequency_hz.")


@dataclass(frozen=True, kw_only=True)
class FrequencyJitter(OptionGroup):
    """Random variation of the shaft speed, shared by all lines of a vessel."""

    fraction: JitterFraction = 0.0
    """Standard deviation of the relative frequency."""
    correlation_s: CorrelationTime = 20.0
    """Correlation time of the variation, s."""


@dataclass(frozen=True, kw_only=True)
class GearChange(OptionGroup):
    """A change of the shaft speed, with revving on the way."""

    at_s: Moment
    """Time at which it begins, at the vessel, s."""
    factor: Annotated[float, Unit("1"), AtLeast(0.1), AtMost(10.0)]
    """Shaft speed from then on over that of the first gear."""
    duration_s: Annotated[float, Unit("s"), AtLeast(0.1), AtMost(1e3)] = 4.0
    """Time in which the speed changes, s."""
    revving: Annotated[float, Unit("1"), AtLeast(0.0), AtMost(1.0)] = 0.0
    """Share by which the speed exceeds the new one half-way."""


@dataclass(frozen=True, kw_only=True)
class Cavitation(OptionGroup):
    """Modulation of the broadband sound by the blades of the propeller."""

    blade_rate_hz: Annotated[float, Unit("Hz"), AtLeast(0.1), AtMost(1e3)]
    """Blade rate, Hz; it follows jitter and gear changes."""
    depth: Annotated[float, Unit("1"), Above(0.0), AtMost(1.0)] = 0.3
    """Relative amplitude of the envelope's first harmonic; the k-th has a k-th of it."""
    harmonics: Annotated[int, AtLeast(1), AtMost(20)] = 3
    """Number of harmonics of the envelope."""
    blades: Annotated[int, AtLeast(1), AtMost(20)] = 4
    """Blades of the propeller: the shaft turns at the blade rate over their number."""
    shaft_depth: Annotated[float, Unit("1"), AtLeast(0.0), AtMost(1.0)] = 0.0
    """Relative amplitude of the envelope at the shaft rate: blades that are not alike."""

    def __post_init__(self) -> None:
        """Refuse an envelope that would become negative."""
        super().__post_init__()
        total = self.depth * sum(1.0 / k for k in range(1, self.harmonics + 1))
        if total + self.shaft_depth > 1.0:
            raise OptionError(
                f"depth {self.depth:g} with {self.harmonics} harmonics and shaft_depth "
                f"{self.shaft_depth:g} makes the envelope negative; the sum of depth / k "
                "and shaft_depth must be at most 1."
            )


@dataclass(frozen=True, kw_only=True)
class SpectralFeature(OptionGroup):
    """A bump or a notch in a spectrum, Gaussian in frequency."""

    centre_hz: Frequency
    """Middle, Hz."""
    width_hz: Annotated[float, Unit("Hz"), AtLeast(0.1), AtMost(1e6)]
    """Width at half of the gain in dB, Hz. Below a five-hundredth of the sample rate it
    is smoothed."""
    gain_db: Annotated[float, Unit("dB"), AtLeast(-60.0), AtMost(60.0)]
    """Gain in the middle, dB; negative is a notch."""

    def gain(self, frequency_hz: Array) -> Array:
        """Return the gain in power at given frequencies."""
        distance = (frequency_hz - self.centre_hz) / self.width_hz
        level_db = self.gain_db * np.exp(-4.0 * np.log(2.0) * distance**2)
        return np.asarray(10.0 ** (level_db / 10.0))


@dataclass(frozen=True, kw_only=True)
class Broadband(OptionGroup):
    """Gaussian noise of the vessel in a band, from its ratio or its source level."""

    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0.0), AtMost(1e6), Increasing()]
    """Lowest and highest frequency, Hz."""
    snr_db: Annotated[float, Unit("dB"), AtLeast(-100.0), AtMost(100.0)] | None = None
    """Power over the ambient noise in the band at closest approach, dB; or the level."""
    source_level_db: SourceLevel | None = None
    """Level in the band at 1 m, dB re 1 uPa."""
    slope_db_per_decade: Slope = 0.0
    """Slope of the spectral density, dB per decade; -20 is 6 dB an octave."""
    features: Annotated[tuple[SpectralFeature, ...], Key("feature")] = ()
    """Bumps and notches; the level in the band includes them."""
    cavitation: Cavitation | None = None
    """Modulation by the propeller's blades; None is none."""

    def __post_init__(self) -> None:
        """Refuse a level that is given twice or not at all."""
        super().__post_init__()
        exactly_one(self, "snr_db", "source_level_db")


@dataclass(frozen=True, kw_only=True)
class Vessel(OptionGroup):
    """A moving sound source; ratios hold at its closest approach."""

    name: str = ""
    """Name of the vessel."""
    source_depth_m: Depth = SOURCE_DEPTH_M
    """Depth of the source below the surface, m."""
    surface_image: Annotated[float, Unit("1"), AtLeast(0.0), AtMost(1.0)] = 0.0
    """Amplitude of the surface reflection; 0 is none, 1 a perfectly soft surface."""
    spreading_db_per_decade: Annotated[float, Unit("dB/decade"), AtLeast(0.0), AtMost(60.0)] = 20.0
    """Transmission loss per decade of range, dB; 20 is spherical."""
    closest_approach: ClosestApproach | None = None
    """Straight passage; this or ``track`` is needed."""
    track: TrackPlan | None = None
    """Track on the local grid."""
    turns: Annotated[tuple[Turn, ...], Key("turn")] = ()
    """Turns of a straight passage after its closest approach."""
    lines: Annotated[tuple[Line, ...], Key("line")] = ()
    """Spectral lines."""
    frequency_jitter: FrequencyJitter = field(default=FrequencyJitter())
    """Variation of all line frequencies together."""
    gear_changes: Annotated[tuple[GearChange, ...], Key("gear_change")] = ()
    """Changes of the shaft speed, which all lines follow, in order of time."""
    broadband: Broadband | None = None
    """Broadband sound; None is none."""
    sounding_s: tuple[Moment, Moment] | None = None
    """Times between which the vessel sounds, at the source, s, with ramps of `RAMP_S`
    at both ends; None is always."""

    def __post_init__(self) -> None:
        """Refuse a vessel whose track is missing or given twice."""
        super().__post_init__()
        exactly_one(self, "closest_approach", "track")
        if self.closest_approach is None and self.turns:
            raise OptionError("turns of a vessel with a track belong into its track.")
        if self.closest_approach is not None:
            check_turns(self.turns, self.closest_approach.time_s)
        ends = [(change.at_s, change.at_s + change.duration_s) for change in self.gear_changes]
        if any(later[0] < earlier[1] for earlier, later in pairwise(ends)):
            raise OptionError(
                "gear changes must follow each other, each after the end of the last."
            )
        if self.sounding_s and self.sounding_s[1] - self.sounding_s[0] < 2.0 * RAMP_S:
            raise OptionError(
                f"sounding_s must last {2.0 * RAMP_S:g} s or more, got {list(self.sounding_s)}."
            )
