"""Scenarios: what is in the water, stated completely enough to be made again.

**Conventions.** Metres, seconds, Hz and compass degrees. Pressures are dB re 1 uPa,
densities dB re 1 uPa^2/Hz. East and north belong to one local grid. Time zero is the
first sample. What a sensor's owner knows (positions, offsets, deviations) stands
beside what he does not (the ``_error`` keys), which goes to the truth alone.
"""

from dataclasses import dataclass
from datetime import UTC, datetime

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.sources import Vessel
from uwtrack_cli.simulate.table import fact
from uwtrack_cli.simulate.ways import Track


@dataclass(frozen=True, kw_only=True)
class SensorPlan:
    """A sensor, what is known of it, and (the errors) what is not."""

    id: str = fact()
    kind: str = fact("omni", choices=("omni", "difar"))
    east_m: float = fact(0.0)
    north_m: float = fact(0.0)
    latitude: float | None = fact(None, low=-90.0, high=90.0)
    longitude: float | None = fact(None, low=-180.0, high=360.0)
    depth_m: float = fact(low=0.0, high=12e3)
    axes: str = fact("true", choices=("true", "housing"))
    heading_deg: float = fact(0.0, low=-360.0, high=360.0)
    track: Track | None = None
    full_scale_db: float | None = fact(None, low=0.0, high=300.0)
    sensitivity_db_re_v_per_upa: float | None = fact(None, low=-300.0, high=0.0)
    gain_db: float = fact(0.0, low=-120.0, high=120.0)
    adc_peak_v: float | None = fact(None, low=1e-6, high=1e3)
    position_std_m: float = fact(0.0, low=0.0)
    compass_offset_deg: float = fact(0.0, low=-360.0, high=360.0)
    compass_std_deg: float = fact(0.0, low=0.0, high=180.0)
    clock_offset_s: float = fact(0.0)
    clock_std_s: float = fact(0.0, low=0.0)
    position_error_m: tuple[float, float] = fact((0.0, 0.0))
    compass_error_deg: float = fact(0.0, low=-180.0, high=180.0)
    clock_error_s: float = fact(0.0)

    def __post_init__(self) -> None:
        """Refuse a sensor without a scale, or with half a position."""
        calibration = (self.sensitivity_db_re_v_per_upa, self.adc_peak_v)
        if calibration.count(None) == 1:
            msg = "a calibration needs sensitivity_db_re_v_per_upa and adc_peak_v."
            raise OptionError(msg)
        if (self.full_scale_db is None) == (None in calibration):
            msg = (
                "give either sensitivity_db_re_v_per_upa, gain_db and adc_peak_v (the "
                "user knows the calibration) or full_scale_db (he does not)."
            )
            raise OptionError(msg)
        if (self.latitude is None) != (self.longitude is None):
            msg = "latitude and longitude go together."
            raise OptionError(msg)
        if self.latitude is not None and self.position_error_m != (0.0, 0.0):
            msg = "position_error_m goes with east_m and north_m, not with latitude."
            raise OptionError(msg)
        if self.track is not None and (self.heading_deg or self.latitude is not None):
            msg = "a sensor with a track has neither heading_deg nor latitude."
            raise OptionError(msg)

    @property
    def full_scale_upa(self) -> float:
        """Sound pressure of a full-scale sample, uPa."""
        if self.sensitivity_db_re_v_per_upa is None or self.adc_peak_v is None:
            return float(10.0 ** ((self.full_scale_db or 0.0) / 20.0))
        total_db = self.sensitivity_db_re_v_per_upa + self.gain_db
        return float(self.adc_peak_v / 10.0 ** (total_db / 20.0))


@dataclass(frozen=True, kw_only=True)
class Hum:
    """Mains hum of the electronics: harmonics with fixed levels, no place."""

    mains_hz: float = fact(50.0, low=1.0, high=1000.0)
    levels_db: tuple[float, ...] = fact()
    fraction: float = fact(0.0, low=0.0, high=0.05)
    correlation_s: float = fact(30.0, low=1.0, high=1e5)


@dataclass(frozen=True, kw_only=True)
class Clicks:
    """Short clicks at random times, each with its own place."""

    rate_per_min: float = fact(low=0.0, high=6000.0)
    peak_db: float = fact(low=-100.0, high=300.0)


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Ambient noise, isotropic in three dimensions; flat below ``corner_hz``."""

    density_db: float = fact(low=-300.0, high=300.0)
    reference_hz: float = fact(1000.0, low=0.1)
    slope_db_per_decade: float = fact(0.0, low=-60.0, high=60.0)
    corner_hz: float = fact(20.0, low=0.1)
    hum: Hum | None = None
    clicks: Clicks | None = None


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A whole simulation: sensors, vessels, noise, and the seed of all chance."""

    seed: int = fact(low=0, high=2**63 - 1)
    duration_s: float = fact(low=1e-3, high=4e6)
    sample_rate_hz: float = fact(low=1.0, high=1e6)
    sound_speed_mps: float = fact(1500.0, low=100.0, high=1e4)
    start_utc: str | None = fact(None)
    sensors: tuple[SensorPlan, ...] = fact(key="sensor")
    vessels: tuple[Vessel, ...] = fact((), key="vessel")
    noise: Noise | None = None

    def __post_init__(self) -> None:
        """Refuse a scenario that nobody hears, or whose sensors share a name."""
        names = [sensor.id for sensor in self.sensors]
        if not names or len(set(names)) != len(names):
            msg = f"sensors need names of their own, at least one; got {names}."
            raise OptionError(msg)
        if self.start_utc is not None:
            _epoch_ns(self.start_utc)

    @property
    def n_samples(self) -> int:
        """Number of samples per channel."""
        return round(self.duration_s * self.sample_rate_hz)

    @property
    def start_utc_ns(self) -> int | None:
        """Time of the first sample since 1970-01-01 UTC, ns."""
        return None if self.start_utc is None else _epoch_ns(self.start_utc)


def _epoch_ns(text: str) -> int:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        msg = f"start_utc must be like 2024-05-01T12:00:00Z, got {text!r}."
        raise OptionError(msg) from error
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    seconds = since.days * 86400 + since.seconds
    return seconds * NANOSECONDS + since.microseconds * 1000
