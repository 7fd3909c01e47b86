"""Explanations of a candidate in which no vessel passes: one small function each.

**Method.** Each explanation is held against the passage by one log evidence: the logarithm
of the probability of what was measured if a vessel passes, less that if the explanation
holds, parameters integrated out or at a stated cost. A measurement that was not made says
nothing. Kinds of measurement hardly overlap: frequencies, bearings and levels as they were
tracked; levels of the lines; the sound itself in source time; sub-bands of a level without
lines. A model that is only roughly right is too sure of itself, the more so the longer it
was measured: gains of long series enter by their inverse hyperbolic sine, and `decision`
takes every ratio to a power below one.

**Conventions.** Nepers, positive for the passage. ``measured`` is what the checks of a
candidate leave with it, by name (`passage/passage_evidence.py`); nan is "not measured".

**References.** Kass and Raftery (1995), J. Am. Statist. Assoc. 90, 773 (Bayes factors);
MacKay (2003), Information Theory, ch. 28.
"""

from collections.abc import Callable, Mapping
from math import asinh, isfinite, log, nan, sqrt
from typing import NamedTuple

Measured = Mapping[str, float]
"""What was measured of a candidate, by name."""

HALVES, OTHER_HALVES = 1.5, 6.0
"""Scale by which the speeds of both halves differ, in standard deviations: of a passage,
and of what is none."""

SLOPE_STD, STATIONARY_SLOPE_STD = 0.4, 0.25
"""Standard deviation of the slope of line levels about one, where a vessel passes, and about
zero, where the source keeps its range: dB for each dB of spreading."""

STATIONARY_LINES, OTHER_STATIONARY_LINES = 0.1, 0.6
"""Share of the lines that rather stand still, where a vessel passes and where none does."""

WATER_SPEEDS_MPS, AIR_SPEEDS_MPS = (0.5, 25.0), (5.0, 80.0)
"""Speeds between which vessels, and vehicles, usually are."""

SPEED_NEPERS = 1.2
"""How fast other speeds get rarer: nepers for an e-fold, squared."""

CHANCE_TURN = 1.0
"""Log evidence that bearings gain as often where nothing passes: scatter turns, too."""

ENOUGH_SUB_BANDS = 4.0
"""Sub-bands that rise as often where a vessel passes as where something else rises."""

LARGEST_WIDTH_STD = 1.0 / 3.0
"""Relative standard deviation of R/v at which a row is as often of no use."""


ENOUGH_TURN_DEG = 30.0
"""Turn of the line of sight below which a drift looks like a passage."""


def value_of(measured: Measured, name: str) -> float:
    """Return what was measured under a name, nan if nothing was."""
    return float(measured.get(name, nan))


def compressed(gain: float) -> float:
    """Return the gain of a long series as it is weighed."""
    return asinh(0.5 * gain)


def two_scales(value: float, narrow: float, wide: float) -> float:
    """Return the log ratio of two half-normal densities."""
    return 0.5 * (value / wide) ** 2 - 0.5 * (value / narrow) ** 2 + log(wide / narrow)


def stationary_bearing(measured: Measured) -> float:
    """Return what bearings gain over one that stays or drifts."""
    gain = value_of(measured, "bearing")
    return compressed(gain) - CHANCE_TURN if gain else nan


def stationary_levels(measured: Measured) -> float:
    """Return what levels of lines that rise and fall with the range say.

    In air nothing: a vehicle is louder, too, where its engine changes its speed.
    """
    slope, std = (
        value_of(measured, "level_slope"),
        value_of(measured, "level_slope_std"),
    )
    if not isfinite(std) or value_of(measured, "is_air"):
        return nan
    passing, resting = std**2 + SLOPE_STD**2, std**2 + STATIONARY_SLOPE_STD**2
    return 0.5 * (
        slope**2 / resting - (slope - 1.0) ** 2 / passing + log(resting / passing)
    )


def stationary_lines(measured: Measured) -> float:
    """Return what lines that rather stand still say of the contact as one vessel.

    Lines of one machine wander together: their evidence grows as the root of their number.
    """
    share, count = value_of(measured, "stationary_share"), value_of(measured, "n_lines")
    here, else_ = STATIONARY_LINES, OTHER_STATIONARY_LINES
    one = share * log(here / else_) + (1.0 - share) * log((1 - here) / (1 - else_))
    return sqrt(count) * one


def halves(measured: Measured) -> float:
    """Return what the speeds of both halves say."""
    return two_scales(value_of(measured, "halves_apart"), HALVES, OTHER_HALVES)


def unusual_speed(measured: Measured) -> float:
    """Return the prior of the speed, over that of calls, sweeps and wandering engines."""
    speed = value_of(measured, "speed_mps")
    if not value_of(measured, "has_lines") or not speed > 3.0 * value_of(
        measured, "speed_std_mps"
    ):
        return nan
    low, high = AIR_SPEEDS_MPS if value_of(measured, "is_air") else WATER_SPEEDS_MPS
    return -SPEED_NEPERS * log(max(speed / high, low / speed, 1.0)) ** 2


def other_rise(measured: Measured) -> float:
    """Return what sub-bands gain over rain, squalls, doors and one gain for all."""
    if value_of(measured, "sub_bands") < ENOUGH_SUB_BANDS:
        return nan
    return compressed(value_of(measured, "sub_bands_gain"))


def undetermined(measured: Measured) -> float:
    """Return how well R/v is known."""
    return -((value_of(measured, "relative_width_std") / LARGEST_WIDTH_STD) ** 2)


def short_frames(measured: Measured) -> float:
    """Return what R/v in frames says of a change between two of them."""
    return log(min(max(value_of(measured, "widths_in_frames"), 0.05), 1.0))


def other_time(measured: Measured) -> float:
    """Return by how much tones are sharper in source time than in any other."""
    return value_of(measured, "rest_frame")


def small_turn(measured: Measured) -> float:
    """Return what the turn of the line of sight says of a drift."""
    return log(min(max(value_of(measured, "turn_deg"), 1.0) / ENOUGH_TURN_DEG, 1.0))


class Alternative(NamedTuple):
    """An explanation in which no vessel passes as the row has it."""

    code: str
    """A key of `decision.REASONS`."""
    log_evidence: Callable[[Measured], float]
    """Log evidence of the passage over it, nepers; nan where nothing was measured."""
    exponent: float
    """Power to which the ratio is taken: what the kinds share, and how far they are
    right (studies/constants/passage_probability.py)."""
