"""Levels over weeks: the median of each hour in decidecade bands, and of the whole band.

**Method.** Each product gives the median of its rows in an hour; an hour of several
recordings has the median of these, each counted as often as it has rows. Levels of
different references are never mixed: they are different sensors here.

**References.** Ainslie et al. (2021), "A terminology standard for underwater acoustics",
on decidecades; Merchant et al. (2015), Methods Ecol. Evol. 6, 257, on medians over time.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.decidecades import Decidecades
from uwtrack_cli.flow.sound_hours import HOUR_NS

QUANTILES = (0.1, 0.5, 0.9)
"""Shares of the time that the level of the whole band is below what is given."""


@dataclass(frozen=True, eq=False)
class HourLevel:
    """Levels of a sensor in an hour."""

    sensor: str
    """Identifier of the sensor."""
    reference: str
    """Level reference."""
    hour: int
    """Hours since 1970-01-01 UTC."""
    centre_hz: FloatArray
    """Centres of the bands, Hz, shape (band,)."""
    median_db: FloatArray
    """Median level in each band, shape (band,)."""
    whole_db: FloatArray
    """Level of all bands together that is exceeded in 90, 50 and 10 % of the time."""
    rows: int
    """Rows of sound that it was taken of."""


def hour_levels(levels: Decidecades) -> Iterator[HourLevel]:
    """Yield the hours of a recording whose start is known."""
    if levels.start_utc_ns is None or not levels.time_s.size:
        return
    at_ns = levels.start_utc_ns + np.round(levels.time_s * NANOSECONDS).astype(np.int64)
    hours = at_ns // HOUR_NS
    whole = 10.0 * np.log10(np.sum(10.0 ** (levels.level_db / 10.0), axis=1))
    for hour in np.unique(hours[np.isfinite(whole)]):
        own = (hours == hour) & np.isfinite(whole)
        yield HourLevel(
            levels.sensor, levels.reference, int(hour), levels.centre_hz,
            np.median(levels.level_db[own], axis=0), np.quantile(whole[own], QUANTILES),
            int(own.sum()),
        )  # fmt: skip


def by_hour(found: Iterable[HourLevel]) -> list[HourLevel]:
    """Join the levels of recordings that share an hour, sensor and bands, in order."""
    groups: dict[tuple[str, str, int, int], list[HourLevel]] = {}
    for one in found:
        key = (one.sensor, one.reference, one.hour, one.centre_hz.size)
        groups.setdefault(key, []).append(one)
    return [_joined(groups[key]) for key in sorted(groups)]


def _joined(parts: list[HourLevel]) -> HourLevel:
    weight = np.array([part.rows for part in parts])
    bands, whole = (
        _weighted_median(np.stack([getattr(part, name) for part in parts]), weight)
        for name in ("median_db", "whole_db")
    )
    return replace(parts[0], median_db=bands, whole_db=whole, rows=int(weight.sum()))


def _weighted_median(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the median over the rows, each of which counts as often as its weight."""
    order = np.argsort(values, axis=0)
    below = np.cumsum(weight[order], axis=0)
    place = np.argmax(below >= 0.5 * weight.sum(), axis=0)
    row = np.take_along_axis(order, place[np.newaxis], axis=0)
    return np.asarray(np.take_along_axis(values, row, axis=0)[0])
