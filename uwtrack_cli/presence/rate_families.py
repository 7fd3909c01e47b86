"""Rates of one shaft: lines of the envelope that are multiples of one rate.

**Method.** Every line over a small whole number is a candidate for the rate of the
shaft. The lines that lie on its multiples are its family; it is accepted when fewer
than `GREATEST_CHANCE` such families are expected from lines at random (number of false
alarms). The rate is refined by least squares; a multiple that is clearly stronger than
the shaft rate is the blade rate.

**Conventions.** Nothing below `LOWEST_RATE_HZ` is a rate: swell modulates, too.

**References.** Desolneux, Moisan & Morel (2008) for the number of false alarms;
Nielsen, "Sonar Signal Processing" (1991), chapter 3, for shaft and blades.
"""

from math import comb
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray

LOWEST_RATE_HZ = 0.5
"""Lowest rate that is called one."""

MOST_PARTS = 12
"""Greatest number by which a line is divided to seek the shaft."""

GREATEST_CHANCE = 0.1
"""Expected number of families by chance below which lines are one family."""

TOLERANCE_SIGMAS = 3.0
"""Distance from a multiple up to which a line is a member."""

LEAST_TOLERANCE = 0.25
"""The same in resolutions, at least: a shaft does not turn evenly."""

BLADE_DB = 3.0
"""Level of the blade rate above the shaft rate, dB, at least."""


class RateFamily(NamedTuple):
    """Rates of one shaft."""

    rows: IntArray
    """Members, as rows of what was given."""
    shaft_hz: float
    """Lowest common rate, Hz."""
    shaft_std_hz: float
    """Its standard deviation, Hz."""
    blade_hz: float
    """Multiple that is clearly stronger than the first, Hz; nan if none is."""
    chance: float
    """Expected number of such families among lines at random."""


def rate_families(
    rate_hz: FloatArray,
    std_hz: FloatArray,
    level_db: FloatArray,
    resolution_hz: FloatArray,
) -> list[RateFamily]:
    """Group modulation rates by their shafts, most certain first.

    Of each line of the envelope: rate and deviation, Hz, level, dB, and the reciprocal
    of the length of its frames, Hz.

    Examples
    --------
    >>> rates = np.array([2.41, 7.3, 9.6, 19.2])
    >>> std_hz, level_db = np.full(4, 0.005), np.array([1.0, 2.0, 9.0, 4.0])
    >>> (one,) = rate_families(rates, std_hz, level_db, np.full(4, 0.125))
    >>> one.rows.tolist(), round(one.shaft_hz, 3), round(one.blade_hz, 2)
    ([0, 2, 3], 2.4, 9.6)
    """
    free = np.flatnonzero(rate_hz >= LOWEST_RATE_HZ)
    found: list[RateFamily] = []
    while free.size >= 2:
        best = _best(rate_hz, std_hz, level_db, resolution_hz, free)
        if best is None:
            break
        found.append(best)
        free = free[~np.isin(free, best.rows)]
    return found


def _best(
    rate_hz: FloatArray,
    std_hz: FloatArray,
    level_db: FloatArray,
    resolution_hz: FloatArray,
    free: IntArray,
) -> RateFamily | None:
    rate = rate_hz[free]
    tolerance = np.maximum(
        TOLERANCE_SIGMAS * std_hz[free], LEAST_TOLERANCE * resolution_hz[free]
    )
    best: tuple[float, float, IntArray] | None = None
    for whole in rate:
        for parts in range(1, MOST_PARTS + 1):
            shaft = float(whole) / parts
            if shaft < LOWEST_RATE_HZ:
                break
            order = np.rint(rate / shaft)
            is_member = (order >= 1) & (np.abs(rate - order * shaft) <= tolerance)
            share = np.minimum(1.0, 2.0 * tolerance / shaft)
            count = int(is_member.sum())
            if count < 2:
                continue
            shares = np.sort(share[is_member])[1:]  # one of them gave the shaft
            ways = _ways(rate.size, count)
            chance = float(rate.size * parts * ways * np.prod(shares))
            if best is None or chance < best[0]:
                best = (chance, shaft, np.flatnonzero(is_member))
    if best is None or best[0] > GREATEST_CHANCE:
        return None
    chance, shaft, members = best
    order = np.rint(rate[members] / shaft)
    weight = 1.0 / std_hz[free][members] ** 2
    refined = float((weight * order * rate[members]).sum() / (weight * order**2).sum())
    std = float(1.0 / np.sqrt((weight * order**2).sum()))
    level = level_db[free][members]
    strongest = int(np.argmax(level))
    first = level[order == 1].max(initial=-np.inf)
    is_blade = level[strongest] > first + BLADE_DB
    blade = order[strongest] * refined if is_blade else np.nan
    return RateFamily(free[members], refined, std, float(blade), chance)


def _ways(n: int, k: int) -> float:
    """Return in how many ways k - 1 further members can be chosen among n - 1."""
    return float(comb(n - 1, k - 1))
