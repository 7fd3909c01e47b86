"""Options of target motion analysis that belong together."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uwtrack_cli.errors import OptionError


@dataclass(frozen=True)
class MotionModel:
    """How sound travels and what a frequency is a mean of.

    Parameters
    ----------
    doppler
        Whether a frequency is that of its instant or the mean over the interval
        that ends there.
    interval_s
        That interval, or the span over which own velocity is taken, s; by default
        the window of the spectra, or the median spacing of the rows of a table.
    propagation
        Whether sound takes its time or arrives at once; auto is delayed for lines
        made from sound and instant for tables.
    """

    doppler: Literal["instantaneous", "interval"] = "instantaneous"
    interval_s: float | None = None
    propagation: Literal["auto", "delayed", "instant"] = "auto"

    def __post_init__(self) -> None:
        """Check the interval."""
        if self.interval_s is not None and not self.interval_s > 0:
            msg = f"interval_s must be positive, got {self.interval_s}."
            raise OptionError(msg)


@dataclass(frozen=True)
class Search:
    """Where the motion is sought and when another reading still counts.

    Parameters
    ----------
    range_limits_m
        Smallest and largest range at the start, m.
    speed_limit_mps
        Largest speed to the east and to the north, m/s.
    confidence
        Probability of the likelihood-ratio region that modes must lie in, 0 to 1.
    """

    range_limits_m: tuple[float, float] = (20.0, 200_000.0)
    speed_limit_mps: float = 18.0
    confidence: float = 0.95

    def __post_init__(self) -> None:
        """Check that there is something to search."""
        low, high = self.range_limits_m
        if not 0 < low < high < np.inf:
            msg = (
                f"range_limits_m must be two increasing positive ranges, got "
                f"{low:g} {high:g}."
            )
            raise OptionError(msg)
        if not 0 < self.speed_limit_mps < 100:
            msg = f"speed_limit_mps must lie in (0, 100), got {self.speed_limit_mps:g}."
            raise OptionError(msg)
        if not 0 < self.confidence < 1:
            msg = f"confidence must lie in (0, 1), got {self.confidence:g}."
            raise OptionError(msg)


@dataclass(frozen=True)
class Misfit:
    """How deviations of the measurements are taken and outliers weighed.

    Parameters
    ----------
    loss
        Loss of a residual: squares is efficient for clean data; huber bounds the
        pull of outliers; student (four degrees of freedom) and tukey nearly remove
        them and cost 3 to 8 % of precision on clean data.
    line_weighting
        Whether every line counts by its deviation, or the lines together count as
        one, as in the paper; the mean loses 1 to 11 % of precision.
    bearing_std_deg
        Deviation of bearings that state none, degrees; by default from their
        scatter.
    frequency_std_hz
        Deviation of frequencies that state none, Hz; by default from their scatter.
    """

    loss: Literal["squares", "huber", "student", "tukey"] = "squares"
    line_weighting: Literal["sum", "mean"] = "sum"
    bearing_std_deg: float | None = None
    frequency_std_hz: float | None = None

    def __post_init__(self) -> None:
        """Check the deviations."""
        for name in ("bearing_std_deg", "frequency_std_hz"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                msg = f"{name} must be positive, got {value:g}."
                raise OptionError(msg)
