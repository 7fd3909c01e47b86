"""Options of a sonar's errors and of the motion of contacts, bound for the filters."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.options import AtLeast, AtMost, Below, OptionGroup, Unit
from uwtrack_cli.errors import OptionError

Probability = Annotated[float, Unit("1"), AtLeast(1e-12), Below(1.0)]
Acceleration = Annotated[float, Unit("m/s^2"), AtLeast(1e-9), AtMost(1e6)]
Speed = Annotated[float, Unit("m/s"), AtLeast(1e-9), AtMost(1e4)]


@dataclass(frozen=True)
class ContactErrors(OptionGroup):
    """Standard deviations, where the table of contacts has none.

    Parameters
    ----------
    range_std_m
        Standard deviation of the ranges in m.
    bearing_std_deg
        Standard deviation of the bearings in degrees.
    range_rate_std_mps
        Standard deviation of the range rates in m/s.
    """

    range_std_m: Annotated[float | None, Unit("m"), AtLeast(1e-9), AtMost(1e6)] = None
    bearing_std_deg: Annotated[float | None, Unit("degree"), AtLeast(1e-9), AtMost(180.0)] = None
    range_rate_std_mps: Speed | None = None


@dataclass(frozen=True)
class ContactFilters(OptionGroup):
    """What the filters assume of moving and drifting contacts.

    Parameters
    ----------
    acceleration_std_mps2
        Root intensity of a moving contact's acceleration in m/s^2 over 1 s; a repeater's
        false range rate wanders as much.
    manoeuvre_std_mps2
        The same during a manoeuvre; when given, two filters interact.
    manoeuvre_start_probability
        Probability per scan that a manoeuvre begins.
    manoeuvre_stop_probability
        Probability per scan that it ends.
    drift_std_mps
        Root intensity of a repeater's drift in m/s over 1 s.
    speed_std_mps
        Standard deviation of each velocity component of a new contact in m/s, and of a
        repeater's false range rate.
    inverse_range_std
        Scale of the half-normal prior of a repeater's inverse range over that measured,
        above 1: it answers late and is no farther than it was measured. One much nearer
        than that asks for more.
    """

    acceleration_std_mps2: Acceleration = 2.0
    manoeuvre_std_mps2: Acceleration | None = None
    manoeuvre_start_probability: Probability = 0.1
    manoeuvre_stop_probability: Probability = 0.3
    drift_std_mps: Speed = 1.0
    speed_std_mps: Speed = 20.0
    inverse_range_std: Annotated[float, Unit("1"), AtLeast(1e-6), AtMost(1e3)] = 0.5

    def __post_init__(self) -> None:
        """Refuse a manoeuvre that is no stronger than the quiet motion."""
        super().__post_init__()
        quiet, manoeuvre = self.acceleration_std_mps2, self.manoeuvre_std_mps2
        if manoeuvre is not None and manoeuvre <= quiet:
            raise OptionError(
                "filters.manoeuvre_std_mps2 must be above acceleration_std_mps2 "
                f"({quiet}), got {manoeuvre}."
            )

    @property
    def intensities(self) -> FloatArray:
        """Intensity of the acceleration of each motion model, m^2/s^3, ``(model,)``."""
        quiet, manoeuvre = self.acceleration_std_mps2, self.manoeuvre_std_mps2
        return np.array([std**2 for std in (quiet, manoeuvre) if std is not None])

    @property
    def switching(self) -> FloatArray:
        """Probability per scan of changing from one model to another."""
        enter = self.manoeuvre_start_probability
        leave = self.manoeuvre_stop_probability
        chances = np.array([[1.0 - enter, enter], [leave, 1.0 - leave]])
        return np.ones((1, 1)) if self.manoeuvre_std_mps2 is None else chances
