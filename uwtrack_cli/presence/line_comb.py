"""The comb that lines of one family lie on: its spacing, and whose teeth they are.

**Method.** Mean frequencies are fitted by least squares with a spacing, and with an
offset unless the family is harmonic. Frames of several lengths, and machines that do not
turn evenly, make lines miss their teeth by more than they state; the scatter that is left
counts as a variance that all lines share, so that one line of a small deviation does not
outweigh a dozen (Paule and Mandel). A family is harmonic where its offset is none within
what the fit leaves open. Where the lines between its teeth lie half-way, or on thirds, by
more than chance, that part of the spacing is the spacing.

**References.** Paule & Mandel, J. Res. Natl. Bur. Stand. 87, 377 (1982), for the
variance that is shared.
"""

from math import comb, gcd
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.presence.line_summary import LineSummary

TOOTH = 0.1
"""Least distance from a tooth, in resolutions, up to which a line is on it."""

TOOTH_SHARE = 0.2
"""The same at most, in spacings."""

TOOTH_SIGMAS = 3.0
"""The same in standard deviations of the line's frequency; also of an offset that is
none."""

LARGEST_REACH = 1.5
"""Multiple of a family's highest line up to which others may lie on its teeth."""

MOST_PARTS = 3
"""Parts of a spacing that are tried."""

BETWEEN_SHARE = 4.0 / 9.0
"""Share of what lies between the teeth that is near those of a third; of a half, less."""

PART_CHANCE = 1e-3
"""Probability by chance up to which lines between the teeth lie on those of a part."""

OPEN_OFFSET = 0.15
"""Deviation of an offset, in spacings, from which on it says nothing."""

HALVINGS = 20
"""Halvings in which the shared variance is found, to a millionth of the greatest."""

MOST_UNKNOWNS = 2
"""Unknowns of a fit, spacing and offset: more teeth must be there."""

ROUNDS = 3
"""Rounds of fitting, and of asking which lines lie on the teeth."""

MOST_BLADES = 8
"""Greatest multiple of a spacing that is asked whether it stands out."""

BLADE_SHARE = 0.9
"""Share of the power of all lines that the multiples of the blade rate have."""


class LineComb(NamedTuple):
    """A comb and the lines on its teeth."""

    spacing_hz: float
    """Distance of neighbouring teeth, Hz."""
    spacing_std_hz: float
    """Its standard deviation, Hz."""
    offset_hz: float
    """Frequency of tooth 0, Hz; 0 for a harmonic family."""
    rows: IntArray
    """Its lines, as rows of the summary."""
    tooth: IntArray
    """Tooth of each, shape (row,)."""


def fit_comb(
    lines: LineSummary,
    own: IntArray,
    free: BoolArray,
    spacing_hz: float,
    offset_hz: float = 0.0,
) -> LineComb:
    """Fit a comb to the lines of a family, and to the free ones on its teeth.

    ``own`` are at least three rows; ``free`` are lines of no other family, shape
    (line,). The spacing is as the family's tracker told it; tooth 0 of a harmonic
    family is at 0 Hz.
    """
    there = free & (lines.status != "hum")
    begin, end = lines.from_s[own].min(), lines.to_s[own].max()
    there &= (lines.from_s <= end) & (lines.to_s >= begin)
    # further up a line would lie on some tooth by chance
    there &= lines.frequency_hz <= LARGEST_REACH * lines.frequency_hz[own].max()
    spacing_hz /= _parts(lines.frequency_hz[own], spacing_hz, offset_hz)
    spacing, std, offset = spacing_hz, np.nan, offset_hz
    rows = own
    for _ in range(ROUNDS):
        tooth, miss_hz = _nearest(lines.frequency_hz, spacing, offset)
        on_tooth = np.abs(miss_hz) <= _reach(lines, spacing)
        rows = np.union1d(own, np.flatnonzero(on_tooth & there))
        near = np.abs(miss_hz[rows]) <= TOOTH_SHARE * spacing
        is_enough = np.unique(tooth[rows[near]]).size > MOST_UNKNOWNS
        fitted = rows[near] if is_enough else rows
        spacing, std, offset = _fitted(
            tooth[fitted], lines.frequency_hz[fitted], lines.frequency_std_hz[fitted],
            is_harmonic=offset == 0.0,
        )  # fmt: skip
    tooth, _ = _nearest(lines.frequency_hz[rows], spacing, offset)
    # a comb of every second tooth has twice the spacing
    first = int(tooth.min()) if offset else 0
    common = max(1, gcd(*(tooth - first).tolist()))
    offset += first * spacing
    tooth = (tooth - first) // common
    return LineComb(spacing * common, std * common, offset, rows, tooth)


def _nearest(
    frequency_hz: FloatArray, spacing_hz: float, offset_hz: float
) -> tuple[IntArray, FloatArray]:
    """Return the nearest tooth of each frequency, and by how much it is missed."""
    lowest = 0 if offset_hz else 1
    tooth = np.maximum(np.rint((frequency_hz - offset_hz) / spacing_hz), lowest)
    return tooth.astype(np.int64), frequency_hz - offset_hz - tooth * spacing_hz


def _reach(lines: LineSummary, spacing_hz: float) -> FloatArray:
    own_hz = TOOTH_SIGMAS * lines.frequency_std_hz
    least_hz = TOOTH * lines.resolution_hz
    return np.asarray(np.clip(own_hz, least_hz, TOOTH_SHARE * spacing_hz))


def _parts(frequency_hz: FloatArray, spacing_hz: float, offset_hz: float) -> int:
    """Return into how many parts the spacing is to be divided: 1 unless lines ask it.

    Of the lines between the teeth so many lie near the teeth of a part as lines at
    random would not (a binomial: the reach of all teeth covers a fixed share).
    """
    _, miss_hz = _nearest(frequency_hz, spacing_hz, offset_hz)
    between = frequency_hz[np.abs(miss_hz) > TOOTH_SHARE * spacing_hz]
    count = between.size
    for parts in range(2, MOST_PARTS + 1):
        part_hz = spacing_hz / parts
        _, miss_hz = _nearest(between, part_hz, offset_hz)
        hits = int((np.abs(miss_hz) <= TOOTH_SHARE * part_hz).sum())
        share = BETWEEN_SHARE
        chance = sum(
            comb(count, k) * share**k * (1.0 - share) ** (count - k)
            for k in range(hits, count + 1)
        )
        if chance <= PART_CHANCE:
            return parts
    return 1


def _fitted(
    tooth: IntArray, frequency_hz: FloatArray, std_hz: FloatArray, *, is_harmonic: bool
) -> tuple[float, float, float]:
    """Return spacing, its deviation, and offset; an offset that is none is 0."""
    design = tooth[:, None].astype(float)
    if not is_harmonic:
        design = np.hstack([design, np.ones_like(design)])
    values, covariance = _least_squares(design, frequency_hz, std_hz)
    spacing, std = float(values[0]), float(np.sqrt(covariance[0, 0]))
    if is_harmonic:
        return spacing, std, 0.0
    order = round(values[1] / spacing)
    lever = np.array([-order, 1.0])
    left_std = float(np.sqrt(lever @ covariance @ lever))
    left = abs(float(lever @ values))
    if left <= TOOTH_SIGMAS * left_std < OPEN_OFFSET * spacing:
        return _fitted(tooth + order, frequency_hz, std_hz, is_harmonic=True)
    return spacing, std, float(values[1])


def _least_squares(
    design: FloatArray, frequency_hz: FloatArray, std_hz: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return weighted least squares with a shared variance, and their covariance."""
    n_free = len(frequency_hz) - design.shape[1]

    def solve(shared: float) -> tuple[FloatArray, FloatArray, float]:
        weight = 1.0 / (std_hz**2 + shared)
        covariance = np.linalg.pinv(design.T @ (weight[:, None] * design))
        values = covariance @ (design.T @ (weight * frequency_hz))
        chi2 = float((weight * (frequency_hz - design @ values) ** 2).sum())
        return values, covariance, chi2

    values, covariance, chi2 = solve(0.0)
    if n_free < 1 or chi2 <= n_free:
        return values, covariance
    low, high = 0.0, float((std_hz**2).max()) * chi2 / n_free
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if solve(middle)[2] > n_free else (low, middle)
    values, covariance, _ = solve(high)
    return values, covariance


def standing_multiple(tooth: IntArray, level_db: FloatArray) -> int:
    """Return the greatest multiple of teeth with nearly all of the power; 0 for none.

    Examples
    --------
    >>> standing_multiple(np.array([4, 5, 8, 12]), np.array([30.0, 2.0, 25.0, 20.0]))
    4
    """
    power = 10 ** (level_db / 10)
    for multiple in range(MOST_BLADES, 1, -1):
        own = tooth % multiple == 0
        if own.sum() >= 3 and power[own].sum() >= BLADE_SHARE * power.sum():
            return multiple
    return 0
