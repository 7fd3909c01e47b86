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
from math import asinh, isfinite, log, log1p, nan
from typing import NamedTuple

Measured = Mapping[str, float]
"""What was measured of a candidate, by name."""

MISFIT, OTHER_MISFIT = 0.1, 0.5
"""Scale of the misfit of lines of a passage, and of what is none, as shares of v/c."""

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

SPEED_NEPERS = 4.0
"""How fast other speeds get rarer: nepers for an e-fold, squared."""

ENOUGH_SUB_BANDS = 4.0
"""Sub-bands that rise as often where a vessel passes as where something else rises."""

ENOUGH_FLANK = 0.7
"""R/v before or after the closest approach from which a drift no longer looks like it."""

LARGEST_WIDTH_STD = 1.0 / 3.0
"""Relative standard deviation of R/v at which a row is as often of no use."""

ENOUGH_TURN_DEG = 30.0
"""Turn of the line of sight below which a drift looks like a passage."""


def _of(measured: Measured, name: str) -> float:
    return float(measured.get(name, nan))


def _compressed(gain: float) -> float:
    return asinh(0.5 * gain)


def _two_scales(value: float, narrow: float, wide: float) -> float:
    """Return the log ratio of two half-normal densities."""
    return 0.5 * (value / wide) ** 2 - 0.5 * (value / narrow) ** 2 + log(wide / narrow)


def noise(measured: Measured) -> float:
    """Return what the passage gains over noise of any colour, a drift and a break."""
    names = ("gain", "gain_over_line", "gain_over_break")
    return _compressed(min(_of(measured, name) for name in names))


def stationary_source(measured: Measured) -> float:
    """Return what is gained over a source that stays: steady, changing or joined lines."""
    return _compressed(_of(measured, "log_odds"))


def stationary_bearing(measured: Measured) -> float:
    """Return what bearings without lines gain over one that stays or drifts."""
    if _of(measured, "has_lines"):
        return nan  # they are in the odds of the lines
    return _compressed(_of(measured, "bearing"))


def stationary_levels(measured: Measured) -> float:
    """Return what levels of lines that rise and fall with the range say."""
    slope, std = _of(measured, "level_slope"), _of(measured, "level_slope_std")
    if not isfinite(std):
        return nan
    passing, resting = std**2 + SLOPE_STD**2, std**2 + STATIONARY_SLOPE_STD**2
    return 0.5 * (
        slope**2 / resting - (slope - 1.0) ** 2 / passing + log(resting / passing)
    )


def stationary_lines(measured: Measured) -> float:
    """Return what lines that rather stand still say of the contact as one vessel."""
    share = _of(measured, "stationary_share")
    here, else_ = STATIONARY_LINES, OTHER_STATIONARY_LINES
    return share * log(here / else_) + (1.0 - share) * log((1 - here) / (1 - else_))


def misfit(measured: Measured) -> float:
    """Return what lines that keep to their curve, or leave it, say."""
    return _two_scales(_of(measured, "misfit"), MISFIT, OTHER_MISFIT)


def halves(measured: Measured) -> float:
    """Return what the speeds of both halves say."""
    return _two_scales(_of(measured, "halves_apart"), HALVES, OTHER_HALVES)


def other_time(measured: Measured) -> float:
    """Return by how much tones are sharper in source time than in any other."""
    return _of(measured, "rest_frame")


def no_tones(measured: Measured) -> float:
    """Return what tones, or noise that was tracked, say in the sound itself."""
    return log1p(max(_of(measured, "tones"), 0.0) / 10.0) - log(2.0)


def unusual_speed(measured: Measured) -> float:
    """Return the prior of the speed, over that of calls, sweeps and wandering engines."""
    speed = _of(measured, "speed_mps")
    if not _of(measured, "has_lines") or not speed > 3.0 * _of(
        measured, "speed_std_mps"
    ):
        return nan
    low, high = AIR_SPEEDS_MPS if _of(measured, "is_air") else WATER_SPEEDS_MPS
    return -SPEED_NEPERS * log(max(speed / high, low / speed, 1.0)) ** 2


def mains(measured: Measured) -> float:
    """Return the log of the chance that all lines lie at multiples of mains."""
    return _of(measured, "mains")


def other_rise(measured: Measured) -> float:
    """Return what sub-bands gain over rain, squalls, doors and one gain for all."""
    if _of(measured, "sub_bands") < ENOUGH_SUB_BANDS:
        return nan
    return _compressed(_of(measured, "sub_bands_gain"))


def few_sub_bands(measured: Measured) -> float:
    """Return what the number of sub-bands that rise says."""
    return _of(measured, "sub_bands") - ENOUGH_SUB_BANDS


def sub_bands_disagree(measured: Measured) -> float:
    """Return what times and widths of the sub-bands say of one rise."""
    chance = _of(measured, "sub_bands_agree")
    return log(max(chance, 1e-5) / 0.05) if isfinite(chance) else nan


def short_flank(measured: Measured) -> float:
    """Return what was recorded on the shorter side says of a drift."""
    flank = min(_of(measured, "before"), _of(measured, "after"))
    return log(min(max(flank, 0.05) / ENOUGH_FLANK, 1.0))


def undetermined(measured: Measured) -> float:
    """Return how well R/v is known."""
    return -((_of(measured, "relative_width_std") / LARGEST_WIDTH_STD) ** 2)


def small_turn(measured: Measured) -> float:
    """Return what the turn of the line of sight says of a drift."""
    return log(min(max(_of(measured, "turn_deg"), 1.0) / ENOUGH_TURN_DEG, 1.0))


def short_frames(measured: Measured) -> float:
    """Return what R/v in frames says of a change between two of them."""
    return log(min(max(_of(measured, "widths_in_frames"), 0.05), 1.0))


class Alternative(NamedTuple):
    """An explanation in which no vessel passes as the row has it."""

    code: str
    """A key of `decision.REASONS`."""
    log_evidence: Callable[[Measured], float]
    """Log evidence of the passage over it, nepers; nan where nothing was measured."""
    exponent: float
    """Power to which the ratio is taken: what the kinds share, and how far they are
    right (studies/constants/passage_probability.py)."""
