"""Rows that measure one series, each with an offset of its own: what is known of them.

**Method.** A table of rows (lines) by columns (instants) holds the same series in every row,
up to an offset of the row. Where rows overlap, their differences tell their offsets, whatever
the series does. With weights P (rows, n), row sums D and column sums T the differences have the
information D - P T^-1 P' of the offsets, and the mean of the rows has the rest, P T^-1 P'. In
the eigenvectors of the first, scaled by D, both are a number and its complement: offsets that
the differences know far better than the mean does are taken out of it, and the others stay in
it as columns, with what the differences know of their sizes.

**Conventions.** Weights are inverse variances, zero where nothing was measured.

**References.** Searle (1971), Linear Models, section 7.1 (two-way layout without interaction,
unequal weights).
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray

WELL_KNOWN = 0.9
"""Share of the information of an offset that the differences hold from which it is taken as
known: to a third of the noise of the mean."""

UNKNOWN = 1e-9
"""The same share from which rounding is told from information."""


class Design(NamedTuple):
    """Columns of a linear model of a series, with what is known of their sizes."""

    columns: FloatArray
    """Columns, shape (n, p)."""
    known: FloatArray
    """Inverse deviation of each size about zero, 0 for a free one, shape (p,)."""

    @classmethod
    def free(cls, columns: FloatArray) -> "Design":
        """Return columns of which nothing is known, shape (n, p)."""
        return cls(columns, np.zeros(columns.shape[1]))

    @property
    def n_free(self) -> int:
        """How many columns nothing is known of."""
        return int(np.count_nonzero(self.known == 0))

    def beside(self, *shapes: FloatArray) -> "Design":
        """Return the design with more free columns, each of shape (n,)."""
        known = np.append(self.known, np.zeros(len(shapes)))
        return Design(np.column_stack([self.columns, *shapes]), known)

    def of(self, kept: FloatArray) -> "Design":
        """Return the design of some instants, a mask or indices of shape (n,)."""
        return Design(self.columns[kept], self.known)

    def rows(self, root: FloatArray) -> FloatArray:
        """Return the whitened columns, and under them a row of each known size.

        The rows stand for measurements of zero with a deviation of one.

        Parameters
        ----------
        root
            Roots of the weights, shape (n,).

        Returns
        -------
        FloatArray
            Shape (n + known sizes, p).
        """
        own = np.diag(self.known)[self.known > 0]
        return np.concatenate([self.columns * root[:, None], own])


def mean_of_rows(value: FloatArray, weight: FloatArray) -> tuple[FloatArray, Design]:
    """Return the mean of rows less their offsets, and what of the offsets is not known.

    Parameters
    ----------
    value
        Measurements, shape (rows, n).
    weight
        Their inverse variances, same shape; every column has one that is not zero.

    Returns
    -------
    tuple[FloatArray, Design]
        The weighted mean of the rows, shape (n,), and what their offsets may add to it: one
        free column for each part of the table that shares no instant with another, and
        those of offsets that overlaps tell in part.

    Examples
    --------
    >>> mean, left = mean_of_rows(np.array([[1.0, 2.0, 3.0], [5.0, 6.0, 7.0]]), np.ones((2, 3)))
    >>> (mean - mean.mean()).round(9).tolist(), left.known.tolist()
    ([-1.0, 0.0, 1.0], [0.0])
    """
    weight, value = (part[weight.any(axis=1)] for part in (weight, value))
    share = weight / weight.sum(axis=0)
    mean = (share * value).sum(axis=0)
    root = np.sqrt(weight.sum(axis=1))
    scaled = share / root[:, None]
    known, turn = np.linalg.eigh(np.eye(root.size) - (weight / root[:, None]) @ scaled.T)
    score = ((weight * (value - mean)).sum(axis=1) / root) @ turn
    is_known = known > UNKNOWN
    offset = turn[:, is_known] @ (score[is_known] / known[is_known]) / root
    left = known < WELL_KNOWN
    sizes = np.sqrt(np.where(is_known, known, 0.0)[left])
    return mean - offset @ share, Design(scaled.T @ turn[:, left], sizes)


def padded(rows: FloatArray, count: int) -> FloatArray:
    """Return rows, shape (..., n), with zeros up to a length of ``count``."""
    return np.pad(rows, [(0, 0)] * (rows.ndim - 1) + [(0, count - rows.shape[-1])])
