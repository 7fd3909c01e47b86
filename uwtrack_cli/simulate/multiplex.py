"""The radio of a sonobuoy as a scenario states it: multiplex, noise, fades, clock.

**Conventions.** Times are seconds from the first sample. Amplitudes are shares of full
scale of the audio.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from uwtrack_cli.data.options import Above, AtLeast, AtMost, Key, OptionGroup, Unit
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.disturbances import Duration
from uwtrack_cli.simulate.track_plans import Moment
from uwtrack_cli.simulate.vessels import Frequency

Ratio = Annotated[float, Unit("dB"), AtLeast(-60.0), AtMost(120.0)]
DipoleName = Literal["east", "north", "-east", "-north"]


@dataclass(frozen=True, kw_only=True)
class Fade(OptionGroup):
    """A time in which the radio is received worse."""

    start_s: Moment
    """Its begin, s."""
    duration_s: Duration
    """Its length, s."""
    radio_snr_db: Ratio = -40.0
    """SNR of the pilots in it, dB; the receiver keeps the power of its audio."""


@dataclass(frozen=True, kw_only=True)
class Multiplex(OptionGroup):
    """How a sonobuoy sends omni and dipoles in one channel of audio.

    Clock error and wow are those of whoever records the audio: they stretch all of it.
    """

    sample_rate_hz: Annotated[float, Unit("Hz"), AtLeast(36_000), AtMost(1e6)] = 48_000
    """Sample rate of the recorded audio, whole Hz."""
    band_hz: tuple[Frequency, Frequency] = (5.0, 2400.0)
    """Edges (-3 dB) of the sound that is sent, Hz: Butterworth filters of fourth order."""
    pilot_amplitude: Annotated[float, Above(0.0), AtMost(0.5)] = 0.1
    """Amplitude of each pilot."""
    dipoles: tuple[DipoleName, DipoleName] = ("-east", "north")
    """Dipole in phase with the 15 kHz pilot, and the one a quarter of a period ahead."""
    radio_snr_db: Ratio | None = None
    """Power of both pilots over that of the radio's noise below 20 kHz, whose density
    rises as the square of the frequency, dB; None has no noise."""
    fades: Annotated[tuple[Fade, ...], Key("fade")] = ()
    """Times in which the radio is received worse."""
    clock_error_ppm: Annotated[float, AtLeast(-1e4), AtMost(1e4)] = 0.0
    """By how much the pilots are too high in the recorded audio, 1e-6."""
    wow: Annotated[float, AtLeast(0.0), AtMost(0.02)] = 0.0
    """Largest relative deviation of the speed of the recorder."""
    wow_hz: Frequency = 1.0
    """Frequency of its change, Hz."""
    phase_jitter_rad: Annotated[float, Unit("rad"), AtLeast(0.0), AtMost(10.0)] = 0.0
    """Standard deviation of the phase of the 7.5 kHz pilot; twice as much at 15 kHz."""
    jitter_correlation_s: Annotated[float, Unit("s"), AtLeast(0.01), AtMost(1e4)] = 0.1
    """Correlation time of that deviation, s."""

    def __post_init__(self) -> None:
        """Refuse what no buoy sends.

        Raises
        ------
        OptionError
            The rate is not whole, or the dipoles are not two different ones.
        """
        super().__post_init__()
        if self.sample_rate_hz != int(self.sample_rate_hz):
            raise OptionError(f"sample_rate_hz must be whole, got {self.sample_rate_hz}.")
        if {name.removeprefix("-") for name in self.dipoles} != {"east", "north"}:
            raise OptionError(f"dipoles names east and north once each, got {list(self.dipoles)}.")
