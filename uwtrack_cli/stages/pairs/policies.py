"""What the user knows of a sonar's errors and of the contacts' ways."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ContactErrors:
    """Standard deviations, where the table of contacts has none.

    Parameters
    ----------
    range_std_m
        Standard deviation of the ranges in m, above 0.
    bearing_std_deg
        Standard deviation of the bearings in degrees, above 0.
    range_rate_std_mps
        Standard deviation of the range rates in m/s, above 0.
    """

    range_std_m: float | None = None
    bearing_std_deg: float | None = None
    range_rate_std_mps: float | None = None


@dataclass(frozen=True)
class ContactFilters:
    """What the filters assume of moving and drifting contacts.

    Parameters
    ----------
    acceleration_std_mps2
        Root intensity of a moving contact's acceleration in m/s^2 over 1 s, above 0.
    manoeuvre_std_mps2
        The same during a manoeuvre; when given, two filters interact. Decides faster for
        a steady contact and survives turns at aspects where the single filter fails, but
        a repeater's false range is explained more easily, too.
    manoeuvre_start_probability
        Probability per scan that a manoeuvre begins, in (0, 1).
    manoeuvre_stop_probability
        Probability per scan that it ends, in (0, 1).
    drift_std_mps
        Root intensity of a repeater's drift in m/s over 1 s, above 0.
    speed_std_mps
        Standard deviation of each velocity component of a new contact in m/s, above 0.
    inverse_range_std
        Relative standard deviation of a repeater's inverse range at first, above 0.
    """

    acceleration_std_mps2: float = 2.0
    manoeuvre_std_mps2: float | None = None
    manoeuvre_start_probability: float = 0.1
    manoeuvre_stop_probability: float = 0.3
    drift_std_mps: float = 1.0
    speed_std_mps: float = 20.0
    inverse_range_std: float = 0.5
