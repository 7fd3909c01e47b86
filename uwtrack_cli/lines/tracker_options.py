"""The options of the line tracker, in groups.

**Conventions.** A value of None is derived from the recording: the resolution of a
frame is the reciprocal of its window's length, and a step is one hop.

**References.** Choi (2014) for the count logic, the feedback parameters alpha, beta
and gamma (equations 9-11) and the rectangular gates; Blackman & Popoli (1999),
section 6.2, for the score.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.options import Above, AtLeast, AtMost, Increasing, OptionGroup, Unit
from uwtrack_cli.errors import OptionError

LONGEST_WINDOW = 63
"""Most frames that a sliding window of hits may have."""

_USUAL_DRIFT = 1e-4
"""Drift of a line in resolutions^2 per window^3."""

_Hits = Annotated[int, AtLeast(1), AtMost(LONGEST_WINDOW)]
_Frames = Annotated[int, AtLeast(1), AtMost(1_000_000)]


@dataclass(frozen=True)
class CountLogic(OptionGroup):
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

    start_hits: _Hits = 3
    start_frames: _Hits = 5
    keep_hits: _Hits = 2
    keep_frames: _Hits = 5

    def __post_init__(self) -> None:
        """Refuse windows that are shorter than the hits wanted in them."""
        super().__post_init__()
        for name, hits, frames in (
            ("start", self.start_hits, self.start_frames),
            ("keep", self.keep_hits, self.keep_frames),
        ):
            if hits > frames:
                raise OptionError(
                    f"{name}_hits must be at most {name}_frames = {frames}, got {hits}."
                )


@dataclass(frozen=True)
class ScoreLogic(OptionGroup):
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

    false_lines_per_khz_hour: Annotated[float, Unit("1/(kHz h)"), AtLeast(1e-9), AtMost(1e9)] = 1.0
    design_snr_db: Annotated[float, Unit("dB"), AtLeast(-30), AtMost(60)] = 2.0
    patience: Annotated[float, Unit("neper"), AtLeast(0.01), AtMost(1e6)] = 10.0


@dataclass(frozen=True)
class Feedback(OptionGroup):
    """Wider limits for lines that the classifier has recognised.

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
    alpha: Annotated[float, AtLeast(1e-3), AtMost(1)] = 0.8
    beta: Annotated[float, AtLeast(1), AtMost(100)] = 1.5
    gamma: Annotated[float, AtLeast(1), AtMost(100)] = 2.7
    chance: Annotated[float, AtLeast(1e-300), AtMost(1)] = 1e-2
    hold_frames: _Frames = 10
    every_frames: _Frames = 5

    def __post_init__(self) -> None:
        """Refuse to forget a classification before the next one."""
        super().__post_init__()
        if self.every_frames > self.hold_frames:
            raise OptionError(
                f"every_frames must be at most hold_frames = {self.hold_frames}, got "
                f"{self.every_frames}."
            )


@dataclass(frozen=True)
class Gates(OptionGroup):
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
        Difference of rates below which two lines may be one, in standard deviations.
    merge_frames
        Frames that two confirmed lines must be one for the younger to end.
    silence_s
        Gap after which a line that is detected again has another number; 0: any gap.
    """

    sigmas: Annotated[float, AtLeast(0.1), AtMost(100)] = 4.0
    frequency_hz: Annotated[float, Unit("Hz"), AtLeast(1e-6), AtMost(1e6)] | None = None
    bearing_deg: Annotated[float, Unit("degree"), AtLeast(1e-3), AtMost(360)] | None = None
    merge_hz: Annotated[float, Unit("Hz"), AtLeast(1e-6), AtMost(1e6)] | None = None
    merge_deg: Annotated[float, Unit("degree"), AtLeast(0), AtMost(360)] = 20.0
    merge_rate_sigmas: Annotated[float, AtLeast(0), AtMost(1e6)] = 3.0
    merge_frames: _Frames = 60
    silence_s: Annotated[float, Unit("s"), AtLeast(0), AtMost(1e6)] = 120.0


@dataclass(frozen=True)
class ProcessNoise(OptionGroup):
    """How fast frequencies and bearings may change.

    Parameters
    ----------
    frequency_hz2ps3
        Spectral density of the machinery's own drift in Hz^2/s^3; None: 1e-4 for
        frames of one second, inversely with the fifth power of their length.
    doppler_ps3
        Greatest spectral density of the relative Doppler's acceleration, 1/s^3.
    bearing_deg2ps3
        Spectral density of the bearing's acceleration, degree^2/s^3.
    frequency_rate_hzps
        Standard deviation of a new line's rate in Hz/s; None: a resolution per step if
        it begins above the detection threshold, else an eighth.
    bearing_rate_degps
        Standard deviation of a new line's bearing rate in degree/s.
    adaptation
        Pace at which a line's process noise follows its innovations, per frame; 0 keeps
        every line at the greatest.
    """

    frequency_hz2ps3: Annotated[float, Unit("Hz^2/s^3"), AtLeast(0), AtMost(1e12)] | None = None
    doppler_ps3: Annotated[float, Unit("1/s^3"), AtLeast(0), AtMost(1e6)] = 2e-8
    bearing_deg2ps3: Annotated[float, Unit("degree^2/s^3"), AtLeast(0), AtMost(1e9)] = 1e-2
    frequency_rate_hzps: Annotated[float, Unit("Hz/s"), AtLeast(1e-9), AtMost(1e6)] | None = None
    bearing_rate_degps: Annotated[float, Unit("degree/s"), AtLeast(0), AtMost(1e4)] = 1.0

    adaptation: Annotated[float, AtLeast(0), AtMost(1)] = 0.2

    def own_density(self, window_s: float) -> float:
        """Return the process noise of a machine's own drift, Hz^2/s^3."""
        if self.frequency_hz2ps3 is None:
            return _USUAL_DRIFT / window_s**5
        return self.frequency_hz2ps3

    def frequency_density(self, frequency_hz: FloatArray, window_s: float) -> FloatArray:
        """Return the greatest process noise of lines at some frequencies, Hz^2/s^3."""
        return self.own_density(window_s) + self.doppler_ps3 * frequency_hz**2

    def rate_std_hzps(self, window_s: float, hop_s: float) -> float:
        """Return the usual deviation of a new line's rate, Hz/s."""
        return self.frequency_rate_hzps or 0.25 / (window_s * hop_s)


@dataclass(frozen=True)
class Harmonics(OptionGroup):
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

    spacing_hz: Annotated[
        tuple[float, float], Unit("Hz"), AtLeast(1e-3), AtMost(1e6), Increasing()
    ] = (2.0, 60.0)
    teeth: Annotated[int, AtLeast(3), AtMost(64)] = 18
    bearing_window_deg: Annotated[float, Unit("degree"), Above(0), AtMost(360)] = 10.0


@dataclass(frozen=True)
class TrackerOptions:
    """All options of the line tracker in one place."""

    initiation: Literal["score", "count"]
    """What starts and ends lines: the cumulative score, or counted hits."""
    score: ScoreLogic
    """Options of the score."""
    count: CountLogic
    """Options of the counted hits."""
    feedback: Feedback
    """Wider limits for recognised lines."""
    gates: Gates
    """Where a line looks for its next peak."""
    motion: ProcessNoise
    """How fast frequencies and bearings may change."""
    harmonics: Harmonics
    """What a harmonic family looks like."""
