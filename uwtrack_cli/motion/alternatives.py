"""Explanations of a candidate in which no vessel passes: one small function each.

**Method.** Each explanation is held against the passage by one log evidence: the logarithm
of the probability of what was measured if a vessel passes, less that if the explanation
holds, parameters integrated out or at a stated cost. A measurement that was not made says
nothing. Kinds of measurement hardly overlap: frequencies, bearings and levels as they were
tracked; levels of the lines; the sound itself in source time; sub-bands of a level without
lines. A model that is only roughly right is too sure of itself, the more so the longer it
was measured: gains of long series enter by their inverse hyperbolic sine, and `decision`
takes every ratio to a power of its own.

**Conventions.** Nepers, positive for the passage. ``measured`` is what the checks of a
candidate leave with it, by name (`passage/candidates.py`); nan is "not measured".

**References.** Kass and Raftery (1995), J. Am. Statist. Assoc. 90, 773 (Bayes factors);
MacKay (2003), Information Theory, ch. 28.
"""

from collections.abc import Callable, Mapping
from math import asinh, inf, isnan, log, nan
from typing import NamedTuple

from uwtrack_cli.motion.association import PASSAGES_PER_HOUR

Measured = Mapping[str, float]
"""What was measured of a candidate, by name."""

STATIONARY_LINES, OTHER_STATIONARY_LINES = 0.1, 0.6
"""Share of the lines that rather stand still, where a vessel passes and where none does."""

WATER_SPEEDS_MPS, AIR_SPEEDS_MPS = (0.5, 25.0), (5.0, 80.0)
"""Speeds between which vessels, and vehicles, usually are; chosen."""

WATER_RANGES_M, AIR_RANGES_M = (5.0, 2e4), (2.0, 600.0)
"""Ranges at the closest approach between which they usually are; chosen."""

OUTSIDE_NEPERS = 1.2
"""How fast other speeds and ranges get rarer: nepers for an e-fold, squared; chosen."""

ANY_COURSE = 1.0
"""What an engine in place whose speed may take any course says against a passage at most,
nepers; chosen, after a drawn aircraft was refused: 79 drawn candidates are told apart as well
with it (log score -0.514) as without (-0.513)."""

CHANCE_TURN = 1.0
"""Log evidence that bearings gain as often where nothing passes: scatter turns, too."""

ENOUGH_SUB_BANDS = 4.0
"""Sub-bands that rise at least where a vessel passes."""

VEHICLES_PER_HOUR = 300.0
"""Vehicles on a busy road; chosen."""

FEW_SUB_BANDS = 2.0
"""What a rise in fewer sub-bands says against a passage, nepers."""

LARGEST_WIDTH_STD = 1.0 / 3.0
"""Relative standard deviation of R/v at which a row is as often of no use."""


def value_of(measured: Measured, name: str) -> float:
    """Return what was measured under a name, nan if nothing was."""
    return float(measured.get(name, nan))


def compressed(gain: float) -> float:
    """Return the gain of a long series as it is weighed."""
    return asinh(0.5 * gain)


def stationary_bearing(measured: Measured) -> float:
    """Return what bearings gain over one that stays or drifts."""
    gain = value_of(measured, "bearing")
    return compressed(gain) - CHANCE_TURN if gain else nan


def stationary_levels(measured: Measured) -> float:
    """Return what levels of lines gain by rising and falling with the range.

    In air nothing: a vehicle is louder, too, where its engine changes its speed.
    """
    gain = value_of(measured, "line_level")
    return compressed(gain) if gain and not value_of(measured, "is_air") else nan


def stationary_lines(measured: Measured) -> float:
    """Return what lines that rather stand still say of the contact as one vessel.

    Lines of one machine wander together: however many they are, they are one witness.
    """
    share = value_of(measured, "stationary_share")
    here, else_ = STATIONARY_LINES, OTHER_STATIONARY_LINES
    return share * log(here / else_) + (1.0 - share) * log((1 - here) / (1 - else_))


def stationary_source(measured: Measured) -> float:
    """Return what lines gain in water over steady, changing or joined ones of what stays."""
    says = value_of(measured, "has_lines") and not value_of(measured, "is_air")
    return compressed(value_of(measured, "log_odds")) if says else nan


def outside(value: float, limits: tuple[float, float]) -> float:
    """Return how much rarer values beyond the usual ones are, nepers."""
    low, high = limits
    return -OUTSIDE_NEPERS * log(max(value / high, low / value, 1.0)) ** 2


def has_speed(measured: Measured) -> bool:
    """Return whether lines tell a speed of something in water or air."""
    if not (value_of(measured, "is_air") or value_of(measured, "is_water")):
        return False
    speed, std = value_of(measured, "speed_mps"), value_of(measured, "speed_std_mps")
    return bool(value_of(measured, "has_lines") and speed > 3.0 * std)


def too_fast(measured: Measured) -> float:
    """Return the prior of high speeds in water, where calls and sound in air have them."""
    if value_of(measured, "is_air") or not has_speed(measured):
        return nan
    return outside(value_of(measured, "speed_mps"), (0.0, WATER_SPEEDS_MPS[1]))


def unusual_speed(measured: Measured) -> float:
    """Return the prior of other speeds, over that of sweeps and wandering engines."""
    if not has_speed(measured):
        return nan
    in_water = WATER_SPEEDS_MPS[0], inf
    limits = AIR_SPEEDS_MPS if value_of(measured, "is_air") else in_water
    return outside(value_of(measured, "speed_mps"), limits)


def unusual_range(measured: Measured) -> float:
    """Return the prior of the range at the closest approach."""
    limits = AIR_RANGES_M if value_of(measured, "is_air") else WATER_RANGES_M
    range_m = value_of(measured, "range_m")
    return outside(range_m, limits) if has_speed(measured) else nan


def other_rise(measured: Measured) -> float:
    """Return what sub-bands gain over rain, squalls, doors and one gain for all.

    A vessel rises in most of them.
    """
    count = value_of(measured, "sub_bands")
    if isnan(count):
        return nan
    if count < ENOUGH_SUB_BANDS:
        return -FEW_SUB_BANDS
    return compressed(value_of(measured, "sub_bands_gain"))


def stationary_level(measured: Measured) -> float:
    """Return what the level of the sound gains by rising and falling with the range of lines.

    A level that does not show the vessel says nothing: another may be louder.
    """
    gain = value_of(measured, "level")
    says = gain > 0 and not value_of(measured, "is_air")
    return compressed(gain) if value_of(measured, "has_lines") and says else nan


def engine_level(measured: Measured) -> float:
    """Return what the level in air gains by the range over one that follows an engine.

    One that does not says nothing: exhausts are loudest where they point.
    """
    gain = value_of(measured, "level")
    says = value_of(measured, "has_lines") and value_of(measured, "is_air")
    return compressed(gain) if says and gain > 0.0 else nan


def engine(measured: Measured) -> float:
    """Return what frequencies in air gain over those of an engine in place.

    One that may take any course explains the wander of every long passage: it speaks
    against none by more than `ANY_COURSE`.
    """
    says = value_of(measured, "has_lines") and value_of(measured, "is_air")
    gain = compressed(value_of(measured, "log_odds"))
    return max(gain, -ANY_COURSE) if says else nan


def part_of_another(measured: Measured) -> float:
    """Return the prior of another vessel as near in time as a rise is to a larger one.

    Fringes and directions of one source part its rise; vessels come at a stated rate.
    """
    is_air = value_of(measured, "is_air")
    rate_per_s = (VEHICLES_PER_HOUR if is_air else PASSAGES_PER_HOUR) / 3600.0
    expected = 2.0 * rate_per_s * value_of(measured, "apart_s")
    return log(min(expected, 1.0)) if expected > 0.0 else nan


def mains(measured: Measured) -> float:
    """Return the log chance that lines of a vessel all lie at multiples of the mains."""
    return value_of(measured, "mains")


def undetermined(measured: Measured) -> float:
    """Return how well R/v is known."""
    return -((value_of(measured, "relative_width_std") / LARGEST_WIDTH_STD) ** 2)


class Alternative(NamedTuple):
    """An explanation in which no vessel passes as the row has it."""

    code: str
    """A key of `decision.REASONS`."""
    log_evidence: Callable[[Measured], float]
    """Log evidence of the passage over it, nepers; nan where nothing was measured."""
    exponent: float
    """Power to which the ratio is taken: what the kinds share, and how far they are
    right (studies/constants/passage_probability.py)."""
