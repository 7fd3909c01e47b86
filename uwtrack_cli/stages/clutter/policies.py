"""What the user knows of detector, motion and start of a target in clutter."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Detector:
    """How the measurements were detected.

    Parameters
    ----------
    model
        Behaviour of the target's amplitude: "fluctuating" (Rayleigh, detection
        probability P_F^(1/(1+SNR))), "gaussian" (mean A, unit deviation; the paper's
        figure 1) or "steady" (Rician); a measured curve replaces it.
    snr_db
        Signal-to-noise ratio A^2/2 of the target in dB; needed unless the detection
        probability or a measured curve is given.
    false_alarm_probability
        False alarm probability per cell and scan of the fixed threshold, in (0, 1).
    detection_probability
        Detection probability at the fixed threshold, in (0, 1]; follows from the model
        when not given.
    cell_volume
        Volume of a resolution cell in the units of the components; needed unless the
        threshold is fixed and the clutter is counted.
    false_alarm_range
        Least and greatest false alarm probability that an adaptive threshold may
        choose; the greatest must be the one at which the scans were recorded.
    """

    model: Literal["fluctuating", "gaussian", "steady"] = "fluctuating"
    snr_db: float | None = None
    false_alarm_probability: float = 0.01
    detection_probability: float | None = None
    cell_volume: float | None = None
    false_alarm_range: tuple[float, float] = (1e-4, 0.3)


@dataclass(frozen=True)
class TargetMotion:
    """How the target moves: nearly constant velocity, perhaps with manoeuvres.

    Parameters
    ----------
    acceleration_std
        Standard deviation of the acceleration in units of the components per s^2,
        constant between two scans; above 0, needed.
    manoeuvre_std
        The same during manoeuvres; when given, a quiet and a manoeuvring filter
        interact.
    manoeuvre_start_probability
        Probability per scan that a quiet target begins to manoeuvre, in (0, 1).
    manoeuvre_stop_probability
        Probability per scan that a manoeuvre ends, in (0, 1).
    """

    acceleration_std: float | None = None
    manoeuvre_std: float | None = None
    manoeuvre_start_probability: float = 0.02
    manoeuvre_stop_probability: float = 0.2


@dataclass(frozen=True)
class TargetStart:
    """Where the track begins.

    Parameters
    ----------
    position
        Components at the start in their units, one number each; the strongest
        measurement of the first scan that has one, when not given.
    velocity
        Their rates in units per s; zero when not given.
    position_std
        Standard deviation of each component of a given position in its units, above 0;
        needed with a position.
    velocity_std
        Standard deviation of each rate in units per s, above 0; needed.
    time_s
        Time of the given position in s; the first scan's when not given.
    """

    position: list[float] | None = None
    velocity: list[float] | None = None
    position_std: float | None = None
    velocity_std: float | None = None
    time_s: float | None = None
