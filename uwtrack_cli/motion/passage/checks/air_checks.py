"""What speaks against a passage of lines in air: slow wander, and another rise of level.

**Method.** In water machinery keeps its speed to a few parts in ten thousand; the engine
of a vehicle wanders by up to one in a hundred while the foot is still, and lines that
fall by less than it does are no passage. And a vehicle that is near enough to be heard
by its engine is heard by its tyres or its exhaust, too: where the broadband rises in the
stretch from which lines tell a passage, both must tell one passage. The level may be
early or late by the direction of its source, and ground that reflects makes it rise for
longer; but a rise that is much shorter than d/v of the lines, or at another time within
it, is that of a vehicle whose lines were followed wrongly. What drawn vehicles have of
`LEAST_MACH`, `LARGEST_LAG` and `WIDTHS` is told by `studies/constants/vehicle_levels.py`.

**Conventions.** Times of arrival, s from the first sample.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.decision import ENGINE_WANDER, OTHER_LEVEL, reject
from uwtrack_cli.motion.passage.candidates import CandidatePassage

LEAST_MACH = 0.01
"""Speed over that of sound in air below which engines wander as much."""

DEVIATIONS = 2.0
"""Deviations by which lines and level may differ beyond the limits below."""

REACH = 3.0
"""d/v of the lines, on either side, from which their passage is told: what rises there
is the same vehicle if its lines are few."""

MANY_LINES = 4
"""Lines that show a vehicle of their own beside another one that is louder."""

LARGEST_LAG = 0.6
"""Share of the shorter d/v by which a level may be early or late: 3 dB between the
sound ahead and behind make a third, 6 dB a half."""

WIDTHS = (0.65, 3.5)
"""d/v of the level over that of the lines: 25 dB a decade, and hard ground."""


def check_in_air(
    item: CandidatePassage, level: CandidatePassage | None
) -> CandidatePassage:
    """Return a passage of lines, rejected where it is none of a vehicle.

    Parameters
    ----------
    item
        A significant fit with lines.
    level
        The passage that the broadband shows by itself, if it shows one.
    """
    fit = item.fit
    if item.rejections or not fit.medium.is_air or item.blocks.shift.is_empty:
        return item
    speed, deviation = float(fit.theta[0, 2]), np.sqrt(fit.covariance[0, 2, 2])
    least = LEAST_MACH * fit.medium.sound_speed_mps
    if speed > 0.0 and speed + DEVIATIONS * deviation < least:
        return item.rejected(reject(ENGINE_WANDER, speed_mps=speed, least_mps=least))
    if level is None or not _contradict(item, level):
        return item
    heard_s, width_s = _heard(level)
    return item.rejected(reject(OTHER_LEVEL, time_s=heard_s, width_s=width_s))


def _contradict(item: CandidatePassage, level: CandidatePassage) -> bool:
    """Return whether lines and level tell two passages in the same stretch."""
    heard, widths, spread = _places(item, level)
    apart = abs(heard[1] - heard[0])
    reach = REACH * widths[0] if item.line_ids.size < MANY_LINES else 0.0
    near = apart < max(widths.sum(), reach) + spread
    return bool(near and not agree_in_air(item, level))


def agree_in_air(item: CandidatePassage, level: CandidatePassage) -> bool:
    """Return whether lines and level can tell one vehicle.

    Parameters
    ----------
    item
        A passage with lines.
    level
        A passage by the level alone.
    """
    heard, widths, spread = _places(item, level)
    variances = [float(one.fit.covariance[0, 1, 1]) for one in (item, level)]
    ratio = np.log(widths[1] / widths[0])
    unsure = DEVIATIONS * np.sqrt((variances / widths**2).sum())
    low, high = np.log(WIDTHS)
    in_time = abs(heard[1] - heard[0]) <= LARGEST_LAG * widths.min() + spread
    return bool(in_time and low - unsure < ratio < high + unsure)


def _places(
    item: CandidatePassage, level: CandidatePassage
) -> tuple[FloatArray, FloatArray, float]:
    """Return when both were heard, their d/v, and how far times may be apart, s."""
    heard, widths = np.transpose([_heard(item), _heard(level)])
    variances = [float(one.fit.covariance[0, 0, 0]) for one in (item, level)]
    return heard, widths, float(DEVIATIONS * np.sqrt(sum(variances)))


def _heard(item: CandidatePassage) -> tuple[float, float]:
    """Return when the sound of the closest approach arrived, and d/v, s."""
    fit = item.fit
    width, speed = float(fit.range_over_speed_s[0]), float(fit.theta[0, 2])
    delay = width * max(speed, 0.0) / fit.medium.sound_speed_mps
    return float(fit.theta[0, 0]) + delay, width
