"""Scenarios: what is in the water, stated completely enough to be made again.

**Conventions.** Metres, seconds, Hz and compass degrees. Pressures are dB re 1 uPa,
densities dB re 1 uPa^2/Hz. East and north belong to one local grid. Time zero is the
first sample. What a sensor's owner knows (positions, offsets, deviations) stands
beside what he does not (the ``_error`` keys), which goes to the truth alone.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated, Literal

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.options import AtLeast, AtMost, Key, OptionGroup, Unit, from_table
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.disturbances import (
    Gusts,
    Knocks,
    LevelDrift,
    Machine,
    Rain,
    Shrimp,
    Swell,
)
from uwtrack_cli.simulate.multiplex import Multiplex
from uwtrack_cli.simulate.track_plans import Coordinate, Course, Range, TrackPlan
from uwtrack_cli.simulate.vessels import (
    CorrelationTime,
    Depth,
    Frequency,
    JitterFraction,
    Level,
    Slope,
    SpectralFeature,
    Vessel,
)

GainError = Annotated[float, AtLeast(-0.9), AtMost(0.9)]
ClockOffset = Annotated[float, Unit("s"), AtLeast(-1e6), AtMost(1e6)]


@dataclass(frozen=True, kw_only=True)
class Recorder(OptionGroup):
    """Edges of a recorder's band: Butterworth filters over all that is recorded."""

    high_pass_hz: Frequency | None = None
    """Lower edge (-3 dB), Hz; None is open."""
    low_pass_hz: Frequency | None = None
    """Upper edge (-3 dB), Hz; None is open."""
    order: Annotated[int, AtLeast(1), AtMost(8)] = 4
    """Order of each filter."""


@dataclass(frozen=True, kw_only=True)
class SensorPlan(OptionGroup):
    """A sensor, what is known of it, and (the errors) what is not."""

    id: str
    """Name of the sensor and of its recording."""
    kind: Literal["omni", "difar", "array"] = "omni"
    """One hydrophone, one with two horizontal dipoles, or many hydrophones."""
    element_along_m: tuple[Coordinate, ...] = ()
    """Place of each hydrophone of an array, from its middle, positive to its head, m."""
    element_positions_m: tuple[tuple[Coordinate, Coordinate, Coordinate], ...] = ()
    """Places of the hydrophones of a fixed array of any shape: starboard, ahead, up, m."""
    tow_offset_m: Range = 0.0
    """Way from the place on the track back to the array's middle, m."""
    heading_source: Literal["track", "way", "compass"] = "track"
    """What the owner of a towed array knows: the ship's track, or the array's compass."""
    element_noise_db: Level | None = None
    """Density of each hydrophone's own noise, dB re 1 uPa^2/Hz; None is none."""
    east_m: Coordinate = 0.0
    """East on the local grid, m."""
    north_m: Coordinate = 0.0
    """North on the local grid, m."""
    latitude: Annotated[float, Unit("degree"), AtLeast(-90.0), AtMost(90.0)] | None = None
    """Latitude, degrees; goes with ``longitude``."""
    longitude: Annotated[float, Unit("degree"), AtLeast(-180.0), AtMost(360.0)] | None = None
    """Longitude, degrees."""
    depth_m: Depth
    """Depth below the surface, m."""
    axes: Literal["true", "housing"] = "true"
    """Axes of the dipoles: east and north, or starboard and bow of the housing."""
    heading_deg: Course = 0.0
    """Compass heading of the housing, degrees."""
    track: TrackPlan | None = None
    """Track of a moving sensor; None is fixed."""
    full_scale_db: Annotated[float, Unit("dB"), AtLeast(0.0), AtMost(300.0)] | None = None
    """Sound pressure of a full-scale sample, dB re 1 uPa."""
    is_calibrated: bool = True
    """Whether the owner knows it: else the sensor file does not state it."""
    sensitivity_db_re_v_per_upa: (
        Annotated[float, Unit("dB re V/uPa"), AtLeast(-300.0), AtMost(0.0)] | None
    ) = None
    """Sensitivity of the hydrophone, dB re 1 V/uPa."""
    gain_db: Annotated[float, Unit("dB"), AtLeast(-120.0), AtMost(120.0)] = 0.0
    """Gain of the amplifier, dB."""
    adc_peak_v: Annotated[float, Unit("V"), AtLeast(1e-6), AtMost(1e3)] | None = None
    """Voltage of a full-scale sample, V."""
    recorder: Recorder | None = None
    """Band of the recorder; None has no edges."""
    multiplex: Multiplex | None = None
    """Radio of a sonobuoy: its recording is one channel of audio; None has no radio."""
    position_std_m: Range = 0.0
    """Standard deviation of the stated position, m."""
    compass_offset_deg: Course = 0.0
    """Correction to add to compass readings, degrees."""
    compass_std_deg: Annotated[float, Unit("degree"), AtLeast(0.0), AtMost(180.0)] = 0.0
    """Standard deviation of that correction, degrees."""
    clock_offset_s: ClockOffset = 0.0
    """Correction to add to the recording's times, s."""
    clock_std_s: Annotated[float, Unit("s"), AtLeast(0.0), AtMost(1e6)] = 0.0
    """Standard deviation of that correction, s."""
    position_error_m: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    """Stated minus true position, east and north, m."""
    compass_error_deg: Annotated[float, Unit("degree"), AtLeast(-180.0), AtMost(180.0)] = 0.0
    """Error that the compass correction leaves, degrees."""
    dipole_gain_errors: tuple[GainError, GainError] = (0.0, 0.0)
    """Relative error of the gain of each dipole, against the omni channel."""
    dipole_crosstalk: GainError = 0.0
    """Share of the other dipole that each dipole picks up."""
    omni_crosstalk: tuple[GainError, GainError] = (0.0, 0.0)
    """Share of the omni channel that each dipole picks up."""
    clock_error_s: ClockOffset = 0.0
    """Error that the clock correction leaves, s."""

    def __post_init__(self) -> None:
        """Refuse a sensor without a scale, or with half a position."""
        super().__post_init__()
        calibration = (self.sensitivity_db_re_v_per_upa, self.adc_peak_v)
        if calibration.count(None) == 1:
            raise OptionError("a calibration needs sensitivity_db_re_v_per_upa and adc_peak_v.")
        if not self.is_calibrated and self.full_scale_db is None:
            raise OptionError("is_calibrated = false needs full_scale_db: the scale of the sound.")
        if (self.full_scale_db is None) == (None in calibration):
            raise OptionError(
                "give either sensitivity_db_re_v_per_upa, gain_db and adc_peak_v, or full_scale_db."
            )
        if (self.latitude is None) != (self.longitude is None):
            raise OptionError("latitude and longitude go together.")
        if self.latitude is not None and self.position_error_m != (0.0, 0.0):
            raise OptionError("position_error_m goes with east_m and north_m, not with latitude.")
        self._check_array()
        self._check_dipoles()
        if self.track is not None and (self.heading_deg or self.latitude is not None):
            raise OptionError("a sensor with a track has neither heading_deg nor latitude.")

    def _check_dipoles(self) -> None:
        mixing = (*self.dipole_gain_errors, *self.omni_crosstalk, self.dipole_crosstalk)
        if self.kind != "difar" and any(mixing):
            raise OptionError('errors of gain and crosstalk of dipoles go with kind = "difar".')
        if self.multiplex and (self.kind != "difar" or self.axes != "true"):
            raise OptionError('multiplex goes with kind = "difar" and axes = "true".')

    def _check_array(self) -> None:
        shapes = [self.element_along_m, self.element_positions_m]
        if (self.kind == "array") != any(len(places) > 1 for places in shapes):
            raise OptionError(
                'element_along_m or element_positions_m goes with kind = "array", two '
                "places or more."
            )
        if self.element_positions_m and (self.track or self.element_along_m):
            raise OptionError("element_positions_m goes without track and element_along_m.")
        if self.kind != "array" and (self.tow_offset_m or self.element_noise_db):
            raise OptionError('tow_offset_m and element_noise_db go with kind = "array".')

    @property
    def element_places(self) -> tuple[tuple[float, float, float], ...]:
        """Places of the hydrophones of an array: starboard, ahead and up, m."""
        return self.element_positions_m or tuple(
            (0.0, along_m, 0.0) for along_m in self.element_along_m
        )

    @property
    def full_scale_upa(self) -> float:
        """Sound pressure of a full-scale sample, uPa."""
        if self.sensitivity_db_re_v_per_upa is None or self.adc_peak_v is None:
            return float(10.0 ** ((self.full_scale_db or 0.0) / 20.0))
        total_db = self.sensitivity_db_re_v_per_upa + self.gain_db
        return float(self.adc_peak_v / 10.0 ** (total_db / 20.0))


@dataclass(frozen=True, kw_only=True)
class Hum(OptionGroup):
    """Mains hum of the electronics: harmonics with fixed levels, from no direction."""

    mains_hz: Annotated[float, Unit("Hz"), AtLeast(1.0), AtMost(1000.0)] = 50.0
    """Frequency of the mains, Hz."""
    levels_db: tuple[Level, ...]
    """Root-mean-square level of each harmonic, dB re 1 uPa, the mains first."""
    fraction: JitterFraction = 0.0
    """Standard deviation of the relative frequency."""
    correlation_s: CorrelationTime = 30.0
    """Correlation time of its variation, s."""


@dataclass(frozen=True, kw_only=True)
class Clicks(OptionGroup):
    """Short clicks at random times, each from a direction of its own."""

    rate_per_min: Annotated[float, Unit("1/min"), AtLeast(0.0), AtMost(6000.0)]
    """Mean number of clicks per minute."""
    peak_db: Annotated[float, Unit("dB"), AtLeast(-100.0), AtMost(300.0)]
    """Peak pressure of a click, dB re 1 uPa."""


@dataclass(frozen=True, kw_only=True)
class Noise(OptionGroup):
    """Ambient noise, isotropic in three dimensions; flat below ``corner_hz``."""

    density_db: Level
    """Spectral density at ``reference_hz``, dB re 1 uPa^2/Hz."""
    reference_hz: Frequency = 1000.0
    """Frequency at which the density is given, Hz."""
    slope_db_per_decade: Slope = 0.0
    """Slope of the density, dB per decade."""
    corner_hz: Frequency = 20.0
    """Frequency below which the density is constant, Hz."""
    hum: Hum | None = None
    """Mains hum; None is none."""
    clicks: Clicks | None = None
    """Clicks; None is none."""
    features: Annotated[tuple[SpectralFeature, ...], Key("feature")] = ()
    """Bumps and notches of the ambient density."""
    drift: LevelDrift | None = None
    """Slow change of the ambient level; None is none."""
    swell: Swell | None = None
    """Regular change of the ambient level; None is none."""
    rain: tuple[Rain, ...] = ()
    """Rain squalls."""
    gusts: Gusts | None = None
    """Gusts of wind; None is none."""
    shrimp: Shrimp | None = None
    """Snapping shrimp; None is none."""
    knocks: Knocks | None = None
    """Knocks; None is none."""
    machines: Annotated[tuple[Machine, ...], Key("machine")] = ()
    """Machines at rest: pumps, generators, ventilators."""


@dataclass(frozen=True, kw_only=True)
class SeaBed(OptionGroup):
    """A flat bottom, whose images of every vessel sound beside the surface's."""

    depth_m: Depth
    """Depth of the water, m."""
    loss_db: Annotated[float, Unit("dB"), AtLeast(0.0), AtMost(60.0)] = 6.0
    """Loss of each reflection, dB."""
    orders: Annotated[int, AtLeast(1), AtMost(10)] = 3
    """Reflections that the bottom makes of one sound at most."""


@dataclass(frozen=True, kw_only=True)
class Scenario(OptionGroup):
    """A whole simulation: sensors, vessels, noise, and the seed of all chance."""

    seed: Annotated[int, AtLeast(0)]
    """Seed of every random number."""
    duration_s: Annotated[float, Unit("s"), AtLeast(1e-3), AtMost(4e6)]
    """Length of the recordings, s."""
    sample_rate_hz: Annotated[float, Unit("Hz"), AtLeast(1.0), AtMost(1e6)]
    """Sample rate, Hz."""
    sound_speed_mps: Annotated[float, Unit("m/s"), AtLeast(100.0), AtMost(1e4)] = 1500.0
    """Speed of sound, m/s."""
    start_utc: str | None = None
    """UTC time of the first sample in ISO 8601; None is not known."""
    sensors: Annotated[tuple[SensorPlan, ...], Key("sensor")]
    """Sensors, one or more; each makes a recording."""
    vessels: Annotated[tuple[Vessel, ...], Key("vessel")] = ()
    """Vessels; none is noise alone."""
    noise: Noise | None = None
    """Ambient noise; None is silence."""
    sea_bed: SeaBed | None = None
    """Bottom of the sea; None is none, or so deep that it does not matter."""

    def __post_init__(self) -> None:
        """Refuse a scenario without a sensor, or whose sensors share a name."""
        super().__post_init__()
        names = [sensor.id for sensor in self.sensors]
        if not names or len(set(names)) != len(names):
            raise OptionError(f"sensors need names of their own, at least one; got {names}.")
        if self.start_utc is not None:
            _epoch_ns(self.start_utc)
        deepest_m = max(
            [one.depth_m for one in self.sensors] + [one.source_depth_m for one in self.vessels]
        )
        if self.sea_bed is not None and self.sea_bed.depth_m < deepest_m:
            raise OptionError(
                f"sea_bed.depth_m is {self.sea_bed.depth_m:g} m, but a sensor or a vessel "
                f"is {deepest_m:g} m deep: nothing can be below the bottom."
            )

    @property
    def n_samples(self) -> int:
        """Number of samples per channel."""
        return round(self.duration_s * self.sample_rate_hz)

    @property
    def start_utc_ns(self) -> int | None:
        """Time of the first sample since 1970-01-01 UTC, ns."""
        return None if self.start_utc is None else _epoch_ns(self.start_utc)


def make_scenario(table: object) -> Scenario:
    """Make a scenario of a table, as TOML or JSON gives it.

    Parameters
    ----------
    table
        The keys of `Scenario`, with a list of tables under ``sensor`` and ``vessel``.

    Raises
    ------
    OptionError
        A key is unknown or missing, or a value is not accepted.
    """
    return from_table(Scenario, table, "scenario")


def _epoch_ns(text: str) -> int:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise OptionError(f"start_utc must be like 2024-05-01T12:00:00Z, got {text!r}.") from error
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    seconds = since.days * 86400 + since.seconds
    return seconds * NANOSECONDS + since.microseconds * 1000
