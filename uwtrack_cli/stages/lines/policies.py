"""The alternatives that the line tracker can be set to, as small policies.

**Conventions.** A value of None is derived from the recording: the resolution of a
frame is the reciprocal of its window's length, and a step is one hop.

**References.** Choi (2014) for the count logic, the feedback parameters alpha, beta
and gamma (equations 9-11) and the rectangular gates; Blackman & Popoli (1999),
section 6.2, for the score.
"""

from dataclasses import dataclass
from typing import Literal

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.errors import OptionError
from uwtrack_cli.estimation.lines.initiation import LONGEST_WINDOW

_USUAL_DRIFT = 1e-4
"""Drift of a line in resolutions^2 per window^3."""


@dataclass(frozen=True)
class CountLogic:
    """Start and end a line by counting hits in a sliding window (M of N).

    Parameters
    ----------
    start_hits
        Hits that confirm a line, counted from its first.
    start_frames
        Frames within which those hits must come.
    keep_hits
        Hits that a confirmed line needs in its window to go on.
    keep_frames
        Length of that window in frames.
    """

    start_hits: int = 3
    start_frames: int = 5
    keep_hits: int = 2
    keep_frames: int = 5

    def __post_init__(self) -> None:
        """Refuse windows that cannot be met."""
        _check_window("start", self.start_hits, self.start_frames)
        _check_window("keep", self.keep_hits, self.keep_frames)


@dataclass(frozen=True)
class ScoreLogic:
    """Start and end a line by its cumulative log-likelihood ratio.

    Parameters
    ----------
    false_lines_per_khz_hour
        Lines that noise alone may start, per kHz of band and hour.
    design_snr_db
        Power over noise, in its cell, of the weakest line looked for, in dB.
    patience
        Fall of the score below its greatest value that ends a line, in nepers.
    """

    false_lines_per_khz_hour: float = 1.0
    design_snr_db: float = 3.0
    patience: float = 10.0

    def __post_init__(self) -> None:
        """Refuse rates and patience that are not positive."""
        _check_positive("false_lines_per_khz_hour", self.false_lines_per_khz_hour)
        _check_positive("patience", self.patience)


@dataclass(frozen=True)
class Feedback:
    """Lax parameters for lines that the classifier has recognised.

    Parameters
    ----------
    classifier
        Who gets them: lines in a harmonic family, all confirmed lines, or none.
    births
        Whether every free peak may start a line or only members of families.
    alpha
        Share of the amplitude threshold that suffices when the gate is empty.
    beta
        Factor on the half widths of the gate, at least 1.
    gamma
        Factor on the length of the window (or the patience) that ends a line.
    chance
        Expected number of families by chance below which lines are a family.
    hold_frames
        Frames for which a line stays recognised after it last was.
    every_frames
        Frames from one classification to the next.
    """

    classifier: Literal["families", "all", "none"] = "families"
    births: Literal["all", "families"] = "all"
    alpha: float = 0.8
    beta: float = 1.5
    gamma: float = 2.7
    chance: float = 1e-2
    hold_frames: int = 10
    every_frames: int = 5

    def __post_init__(self) -> None:
        """Refuse factors outside their meaning (Choi 2014, eqs. 9-11)."""
        if not 0.0 < self.alpha <= 1.0:
            msg = f"alpha must be in (0, 1], got {self.alpha}."
            raise OptionError(msg)
        if self.beta < 1.0 or self.gamma < 1.0:
            msg = (
                f"beta and gamma must be at least 1, got {self.beta} and {self.gamma}."
            )
            raise OptionError(msg)
        _check_positive("chance", self.chance)
        if self.every_frames < 1 or self.hold_frames < self.every_frames:
            msg = (
                "every_frames must be at least 1 and at most hold_frames, got "
                f"{self.every_frames} and {self.hold_frames}."
            )
            raise OptionError(msg)


@dataclass(frozen=True)
class Gates:
    """Where a line looks for its next peak, and when two lines are one.

    Parameters
    ----------
    sigmas
        Half width of a gate in standard deviations of the innovation.
    frequency_hz
        Fixed half width in Hz; None for the adaptive gate.
    bearing_deg
        Fixed half width in degrees; None for the adaptive gate.
    merge_hz
        Distance below which two lines are one, in Hz; None for half a resolution.
    merge_deg
        Difference of bearings below which two lines may be one, in degrees.
    merge_rate_sigmas
        Difference of rates below which two lines may be one, in deviations.
    merge_frames
        Frames that two confirmed lines must be one for the younger to end.
    """

    sigmas: float = 4.0
    frequency_hz: float | None = None
    bearing_deg: float | None = None
    merge_hz: float | None = None
    merge_deg: float = 20.0
    merge_rate_sigmas: float = 3.0
    merge_frames: int = 60

    def __post_init__(self) -> None:
        """Refuse gates without an inside."""
        for name in ("sigmas", "frequency_hz", "bearing_deg"):
            value = getattr(self, name)
            if value is not None:
                _check_positive(name, value)
        if self.merge_frames < 1:
            msg = f"merge_frames must be at least 1, got {self.merge_frames}."
            raise OptionError(msg)


@dataclass(frozen=True)
class Motion:
    """How fast frequencies and bearings may change.

    Parameters
    ----------
    frequency_hz2ps3
        Spectral density of the machinery's own drift in Hz^2/s^3; None: 1e-4 for
        frames of one second, inversely with the fifth power of their length.
    doppler_ps3
        Spectral density of the relative Doppler's acceleration, 1/s^3.
    bearing_deg2ps3
        Spectral density of the bearing's acceleration, degree^2/s^3.
    frequency_rate_hzps
        Standard deviation of a new line's rate in Hz/s; None for a quarter of a
        resolution per step.
    bearing_rate_degps
        Standard deviation of a new line's bearing rate in degree/s.
    """

    frequency_hz2ps3: float | None = None
    doppler_ps3: float = 2e-8
    bearing_deg2ps3: float = 1e-2
    frequency_rate_hzps: float | None = None
    bearing_rate_degps: float = 1.0

    def __post_init__(self) -> None:
        """Refuse densities that are negative."""
        for name in ("frequency_hz2ps3", "doppler_ps3", "bearing_deg2ps3"):
            value = getattr(self, name)
            if value is not None and value < 0.0:
                msg = f"{name} must not be negative, got {value}."
                raise OptionError(msg)

    def frequency_density(
        self, frequency_hz: FloatArray, window_s: float
    ) -> FloatArray:
        """Return the process noise of lines at some frequencies, Hz^2/s^3."""
        own = self.frequency_hz2ps3
        if own is None:
            own = _USUAL_DRIFT / window_s**5
        return own + self.doppler_ps3 * frequency_hz**2

    def rate_std_hzps(self, window_s: float, hop_s: float) -> float:
        """Return the deviation of a new line's rate, Hz/s."""
        return self.frequency_rate_hzps or 0.25 / (window_s * hop_s)


@dataclass(frozen=True)
class Harmonics:
    """What a harmonic family looks like.

    Parameters
    ----------
    spacing_hz
        Least and greatest distance of neighbouring teeth in Hz.
    teeth
        Most teeth from one end of a family's core to the other, 3 to 64.
    bearing_window_deg
        Greatest difference of bearings inside a family, in degrees.
    """

    spacing_hz: tuple[float, float] = (2.0, 60.0)
    teeth: int = 18
    bearing_window_deg: float = 10.0

    def __post_init__(self) -> None:
        """Refuse empty ranges."""
        if not 0.0 < self.spacing_hz[0] < self.spacing_hz[1]:
            msg = f"spacing_hz must be 0 < least < greatest, got {self.spacing_hz}."
            raise OptionError(msg)
        if not 3 <= self.teeth <= 64:
            msg = f"teeth must be in 3 to 64, got {self.teeth}."
            raise OptionError(msg)
        _check_positive("bearing_window_deg", self.bearing_window_deg)


def _check_positive(name: str, value: float) -> None:
    if not value > 0.0:
        msg = f"{name} must be positive, got {value}."
        raise OptionError(msg)


def _check_window(name: str, hits: int, frames: int) -> None:
    if not 1 <= hits <= frames <= LONGEST_WINDOW:
        msg = (
            f"{name}_hits of {name}_frames must be 1 <= hits <= frames <= "
            f"{LONGEST_WINDOW}, got {hits} of {frames}."
        )
        raise OptionError(msg)
