"""What a passage is fitted to: frequencies, bearings and levels on one time axis.

**Conventions.** Dense arrays with nan for what was not measured. A row of the
frequencies is a line, a row of the bearings a source of bearings (each line, and the
broadband); leading axes are independent data sets of a batch. Inside a fit,
frequencies are fractions of the line's mean, bearings are radians, and levels are
natural logarithms of power, so that all weights are inverse variances without a unit.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray

NEPER_DB = 10 / np.log(10)
"""Decibels in a natural-logarithm unit of power."""

MOST_SEARCHED = 6000
"""Instants among which a closest approach is sought; longer series are averaged."""

WINDOW_WIDTHS = 25.0
"""Of a long series, so many d/v on either side of the closest approach are kept."""


@dataclass(frozen=True)
class PassageData:
    """Raw measurements of one contact.

    Shapes: ``time_s`` (n,), frequencies (..., lines, n), bearings (..., sources, n),
    levels (..., 1, n). The correlations are those of neighbouring measurements.
    """

    time_s: FloatArray
    frequency_hz: FloatArray
    frequency_std_hz: FloatArray
    bearing_deg: FloatArray
    bearing_std_deg: FloatArray
    level_db: FloatArray
    level_std_db: FloatArray
    frequency_correlation: float = 0.0
    bearing_correlation: float = 0.0
    level_correlation: float = 0.0

    @property
    def step_s(self) -> float:
        """Typical distance of measurements, s."""
        return float(np.median(np.diff(self.time_s))) if self.time_s.size > 1 else 1.0

    @property
    def span_s(self) -> float:
        """Time covered, s."""
        return float(self.time_s[-1] - self.time_s[0]) if self.time_s.size else 0.0


def condense(
    data: PassageData, time_s: float, width_s: float, most: int = 1500
) -> PassageData:
    """Keep what matters to a passage of a long series, averaged if need be.

    Parameters
    ----------
    data
        Raw measurements of one contact.
    time_s
        Time of closest approach, seconds, about.
    width_s
        Range over speed, seconds, about.
    most
        Instants to keep at most, about.
    """
    if data.time_s.size <= most:
        return data
    near = np.flatnonzero(np.abs(data.time_s - time_s) <= WINDOW_WIDTHS * width_s)
    return _averaged(data, near if near.size >= 8 else slice(None), most)


def thin(data: PassageData) -> PassageData:
    """Average a very long series, so that a search through it stays affordable."""
    if data.time_s.size <= MOST_SEARCHED:
        return data
    return _averaged(data, slice(None), MOST_SEARCHED)


def _averaged(data: PassageData, kept: IntArray | slice, most: int) -> PassageData:
    """Average runs of neighbouring instants, so that about ``most`` are left."""
    time = data.time_s[kept]
    starts = np.arange(0, time.size, -(-time.size // most))

    def mean(
        value: FloatArray, std: FloatArray, period: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        value, std = value[..., kept], std[..., kept]
        good = np.isfinite(value) & (std > 0)
        weight = np.where(good, 1 / np.where(good, std, 1.0) ** 2, 0.0)
        size = np.add.reduceat(weight, starts, axis=-1)
        some = np.where(size > 0, size, np.nan)
        if period is None:
            total = np.add.reduceat(weight * np.where(good, value, 0), starts, axis=-1)
            return total / some, 1 / np.sqrt(some)
        turn = np.exp(2j * np.pi / period * np.where(good, value, 0))
        vector = np.add.reduceat(weight * turn, starts, axis=-1)
        angle = np.angle(vector) * period / (2 * np.pi) % period
        return np.where(size > 0, angle, np.nan), 1 / np.sqrt(some)

    count = np.diff(np.append(starts, time.size))
    return PassageData(
        np.add.reduceat(time, starts) / count,
        *mean(data.frequency_hz, data.frequency_std_hz),
        *mean(data.bearing_deg, data.bearing_std_deg, 360.0),
        *mean(data.level_db, data.level_std_db),
    )


@dataclass(frozen=True)
class Block:
    """Values of one kind in fit units and their inverse variances (0: missing)."""

    value: FloatArray
    weight: FloatArray

    @property
    def is_empty(self) -> bool:
        """Whether nothing of this kind was measured."""
        return not bool(self.weight.any())


@dataclass(frozen=True)
class Blocks:
    """The three kinds under one another, so that one operation serves all rows.

    ``value`` and ``weight`` are (batch, rows, n): lines, then sources of bearings, then
    levels, ``count`` of each; ``kinds`` (3, rows) is one where a row is of a kind.
    """

    time_s: FloatArray
    value: FloatArray
    weight: FloatArray
    correlation: FloatArray
    count: tuple[int, int, int]
    kinds: FloatArray
    mean_hz: FloatArray

    @property
    def parts(self) -> tuple[slice, slice, slice]:
        """The rows of the frequencies, the bearings and the levels."""
        first, second = self.count[0], self.count[0] + self.count[1]
        return slice(0, first), slice(first, second), slice(second, None)

    @property
    def shift(self) -> Block:
        """The frequencies, over the line's mean and less one."""
        return self._block(self.parts[0])

    @property
    def bearing(self) -> Block:
        """The bearings in radians."""
        return self._block(self.parts[1])

    @property
    def level(self) -> Block:
        """The levels in natural logarithms of power."""
        return self._block(self.parts[2])

    def _block(self, rows: slice) -> Block:
        return Block(self.value[:, rows], self.weight[:, rows])


def make_blocks(data: PassageData) -> Blocks:
    """Bring measurements into fit units.

    Parameters
    ----------
    data
        Raw measurements.
    """
    frequency = _batched(data.frequency_hz)
    good = np.isfinite(frequency)
    total = np.maximum(good.sum(axis=-1), 1)
    mean = np.where(good, frequency, 0.0).sum(axis=-1) / total
    mean = np.where(mean > 0, mean, 1.0)
    pairs = (
        (frequency / mean[..., None] - 1, data.frequency_std_hz, 1 / mean[..., None]),
        (np.deg2rad(_batched(data.bearing_deg)), data.bearing_std_deg, np.deg2rad(1.0)),
        (_batched(data.level_db) / NEPER_DB, data.level_std_db, 1 / NEPER_DB),
    )
    value = np.concatenate([pair[0] for pair in pairs], axis=1)
    std = np.concatenate(
        [np.broadcast_to(_batched(std) * unit, v.shape) for v, std, unit in pairs],
        axis=1,
    )
    known = np.isfinite(value) & (std > 0) & (std < np.inf)
    count = (pairs[0][0].shape[1], pairs[1][0].shape[1], pairs[2][0].shape[1])
    given = (
        data.frequency_correlation,
        data.bearing_correlation,
        data.level_correlation,
    )
    return Blocks(
        data.time_s,
        np.where(known, value, 0.0),
        np.where(known, 1 / np.where(known, std, 1.0) ** 2, 0.0),
        np.repeat(given, count),
        count,
        np.repeat(np.eye(3), count, axis=1),
        mean,
    )


def _batched(values: FloatArray) -> FloatArray:
    """Give the array one leading batch axis."""
    return values[None] if values.ndim == 2 else values
