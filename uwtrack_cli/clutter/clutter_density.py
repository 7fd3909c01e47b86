"""The density of false measurements about a target, over the one that was told.

**Method.** In each scan the volume about the target within which the nearest few false
measurements lie is taken: times the density it is a sum of unit exponentials. Over all
scans the density is the number of these measurements over the sum of the volumes. So few
are taken that most of a scan is outside, and scans at whose edge the target is are left
out.

**References.** Song and Musicki (2011), IEEE Trans. Signal Processing 59, 1401 (sparsity
of clutter of an order); Cressie (1993), Statistics for Spatial Data, section 8.2.
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.information_reduction import unit_ball_volume

MOST_NEIGHBOURS = 5
"""Greatest number of the nearest false measurements."""

NEIGHBOUR_SHARE = 0.125
"""Share of a scan's false measurements that they may be: a circle of an eighth of a
square about its middle has 0.4 of the square's width."""


class FoundClutter(NamedTuple):
    """Neighbours of a target, and how many the told density has in their volume."""

    n_found: float
    """Number of false measurements."""
    n_expected: float
    """Density told times the volume that they fill."""

    @property
    def ratio(self) -> float | None:
        """Density over the one told; None where the scans hold too few to tell."""
        return self.n_found / self.n_expected if self.n_expected > 0.0 else None

    @property
    def ratio_std(self) -> float | None:
        """Standard deviation of the ratio, of a gamma distribution."""
        ratio = self.ratio
        return None if ratio is None else ratio / float(np.sqrt(self.n_found))


def neighbours_of(
    away: FloatArray, scan: IntArray, scale: FloatArray, density: FloatArray
) -> FoundClutter:
    """Count the nearest false measurements of each scan about a target.

    The edges of a scan are those of the box of its measurements.

    Parameters
    ----------
    away
        False measurements minus the target, ``(k, m)``, in the units of the components.
    scan
        Scan of each of them, ``(k,)``, a place in ``density``.
    scale
        Unit of length in each component, ``(m,)``.
    density
        Density told about the target in each scan, ``(scan,)``.

    Returns
    -------
    FoundClutter
        None of them where scans hold fewer than eight on average.

    Examples
    --------
    >>> about = np.array([[1.0], [-2], [-4], [6], [-7], [8], [9], [-9]])
    >>> found = neighbours_of(about, np.zeros(8, int), np.ones(1), np.array([0.25]))
    >>> round(found.ratio, 6)
    2.0
    """
    count = np.bincount(scan, minlength=density.size)
    order = min(int(NEIGHBOUR_SHARE * count.mean()), MOST_NEIGHBOURS)
    if not order:
        return FoundClutter(0.0, 0.0)
    scaled = away / scale
    dimension = scaled.shape[1]
    unit = unit_ball_volume(dimension)
    distance2 = (scaled**2).sum(axis=1)
    # the measurements of a scan follow each other, nearest first
    sorting = np.lexsort((distance2, scan))
    first = np.cumsum(count) - count
    some = np.flatnonzero(count >= max(order, 2))
    # a target nearer to an edge than the neighbours usually reach has fewer of them
    low = np.minimum.reduceat(scaled[sorting], first[count > 0])
    high = np.maximum.reduceat(scaled[sorting], first[count > 0])
    at = np.searchsorted(np.flatnonzero(count > 0), some)
    share = order / count[some]
    reach = (share * np.prod(high[at] - low[at], axis=1) / unit) ** (1.0 / dimension)
    inside = np.minimum(-low[at], high[at]).min(axis=1) >= reach
    some = some[inside]
    volume = unit * distance2[sorting[first[some] + order - 1]] ** (0.5 * dimension)
    expected = density[some] * volume * float(np.prod(scale))
    return FoundClutter(float(order * some.size), float(expected.sum()))
