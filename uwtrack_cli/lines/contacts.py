"""Group tracked lines into contacts and tell moving, steady and mains lines apart.

**Method.** While lines are tracked, their smoothed points are kept on a coarse grid
of frames; the grid is thinned whenever too many are held, so memory is bounded. At
the end of the recording the lines are compared in pairs. The lines of one vessel shift
by the same factor, so the difference of the logarithms of their frequencies is
constant within its uncertainty, while that of unrelated lines varies as much as the
lines do. The log-likelihood ratio of the two statements is the evidence; lines that do
not vary give none. Bearings add the evidence of agreeing against being anywhere on the
compass. Groups grow from the strongest pair on, as long as the evidence summed over all
pairs of two groups is for the union. Lines of one harmonic family count as one source
unless the comparison contradicts.

**Conventions.** Contacts count from 1 in the order of their first line. Contact 0 is
"none": mains hum, and steady lines that share nothing with another line. Samples lie on
common times: arrays of shape (line, time), nan where a line has no point. Evidence is
in nepers.

**References.** Kass & Raftery, "Bayes factors", JASA 90, 773-795 (1995), for the
scale: 3 nepers is strong.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray, TextArray
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.lines.line_points import LinePoints

_MOST_SAMPLES = 200_000
"""Points held before the grid is thinned by two."""

_MOST_CELLS = 2_000_000
"""Lines times common times that are compared at once."""

_FAMILY_EVIDENCE = 8.0
"""Evidence of a common family, in nepers: its chance is below 1e-3."""

LEAST_EVIDENCE = 3.0
"""Evidence that joins two lines (Kass & Raftery 1995: strong)."""

_LEAST_COMMON = 4
"""Common times below which two lines are not compared."""

_LEAST_SHARE = 0.5
"""Share of the shorter line that two lines must be heard together for their Doppler to
join them: what they have in common at their ends alone is that neither bends."""

_LINE_WANDER = 2e-5
"""Relative jitter of one machine's lines against each other."""

_SHAPE_SHARE = 0.2
"""Difference of the Doppler curves of one vessel, relative to their spread."""

_BEARING_WANDER_DEG = 3.0
"""Spread of the bearings of one vessel's lines, from multipath."""

_VETO = -6.0
"""Evidence against a pair that keeps their groups apart."""


@dataclass(frozen=True)
class LineSamples:
    """Smoothed lines on common times, shape (line, time)."""

    frequency_hz: FloatArray
    """Smoothed frequency in Hz."""
    frequency_variance: FloatArray
    """Its variance in Hz^2."""
    bearing_deg: FloatArray
    """Smoothed bearing in degree, unwrapped; nan if unknown."""
    bearing_variance: FloatArray
    """Its variance in degree^2."""
    correlation_samples: float
    """Samples over which the errors of a line are correlated, at least 1."""


class ContactSamples:
    """Coarse histories of all lines, in bounded memory."""

    def __init__(self, stride: int) -> None:
        self.stride = stride
        self.line = np.zeros(0, dtype=np.int64)
        self.frame = np.zeros(0, dtype=np.int64)
        self.values = np.zeros((0, 4))
        self._seen: set[int] = set()

    def line_seen(self) -> IntArray:
        """Return the numbers of all lines that have points, ascending."""
        return np.array(sorted(self._seen), dtype=np.int64)

    def add(self, points: LinePoints) -> None:
        """Keep the points on the grid."""
        self._seen.update(np.unique(points.line).tolist())
        on_grid = points.frame % self.stride == 0
        fresh = np.stack([
            points.frequency_hz, points.frequency_variance_hz2,
            points.bearing_deg, points.bearing_variance_deg2,
        ], axis=1)[on_grid]  # fmt: skip
        self.line = np.append(self.line, points.line[on_grid].astype(np.int64))
        self.frame = np.append(self.frame, points.frame[on_grid].astype(np.int64))
        self.values = np.concatenate([self.values, fresh])
        while self.line.size > _MOST_SAMPLES:
            self.stride *= 2
            keep = self.frame % self.stride == 0
            self.line, self.frame = self.line[keep], self.frame[keep]
            self.values = self.values[keep]

    def samples(self, lines: IntArray, correlation_frames: float) -> LineSamples:
        """Return the histories as tables of line and time."""
        stride, keep = self.stride, np.ones(self.frame.size, dtype=bool)
        times = np.unique(self.frame)
        while times.size * lines.size > _MOST_CELLS:
            stride *= 2
            keep = self.frame % stride == 0
            times = np.unique(self.frame[keep])
        column = np.searchsorted(times, self.frame[keep])
        row = np.searchsorted(lines, self.line[keep])
        table = np.full((4, lines.size, max(times.size, 1)), np.nan)
        table[:, row, column] = self.values[keep].T
        return LineSamples(
            table[0], table[1], table[2], table[3],
            correlation_samples=max(1.0, correlation_frames / stride),
        )  # fmt: skip


def group_lines(samples: LineSamples, family: IntArray) -> tuple[IntArray, TextArray]:
    """Give each line its contact and its status.

    Parameters
    ----------
    samples
        Histories of the lines.
    family
        Lasting family of each line, -1 for none.

    Returns
    -------
    tuple of arrays
        Contact (0 for none) and 'moving', 'steady' or 'hum' per line.
    """
    if family.size == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype="U6")
    is_sampled = np.asarray(np.isfinite(samples.frequency_hz).any(axis=1))
    safe = _with_samples(samples, is_sampled)
    is_moving = (has_doppler(safe) | has_turn(safe)) & is_sampled
    is_hum = _hum(safe, family, ~is_moving & is_sampled)
    evidence = pair_evidence(safe)
    same = (family[:, None] == family[None, :]) & (family >= 0)[:, None]
    evidence += np.where(same, _FAMILY_EVIDENCE, 0.0)
    evidence[is_hum, :] = evidence[:, is_hum] = -np.inf
    label = group(evidence, LEAST_EVIDENCE)
    size = np.bincount(label)[label]
    has_bearing = np.isfinite(safe.bearing_deg).any(axis=1)
    is_contact = ~is_hum & (is_moving | has_bearing | (size > 1))
    contact = np.zeros(label.size, dtype=np.int64)
    _, first, number = np.unique(
        label[is_contact], return_index=True, return_inverse=True
    )
    contact[is_contact] = np.argsort(np.argsort(first))[number] + 1
    # what one line of a contact shows, the weaker ones share
    shared = np.bincount(contact, is_moving, minlength=1)[contact] > 0
    is_moving |= (contact > 0) & shared
    status = np.where(is_hum, "hum", np.where(is_moving, "moving", "steady"))
    return contact, status


def _with_samples(samples: LineSamples, is_sampled: BoolArray) -> LineSamples:
    """Give lines too short for the grid a dummy that compares with nothing."""
    tables = [samples.frequency_hz.copy(), samples.frequency_variance.copy()]
    tables[0][~is_sampled, 0] = 1.0
    tables[1][~is_sampled, 0] = 1.0
    return replace(samples, frequency_hz=tables[0], frequency_variance=tables[1])


def _hum(samples: LineSamples, family: IntArray, is_steady: BoolArray) -> BoolArray:
    """Mains multiples; a family whose other lines are none is a machine."""
    is_hum = mains_lines(np.nanmean(samples.frequency_hz, axis=1), is_steady)
    for number in np.unique(family[family >= 0]):
        member = family == number
        if is_hum[member].mean() <= 0.5:
            is_hum &= ~member
    return is_hum


def pair_evidence(samples: LineSamples) -> FloatArray:
    """Return the evidence that two lines have one source, for every pair."""
    n_lines = samples.frequency_hz.shape[0]
    log_f = np.log(samples.frequency_hz)
    variance = samples.frequency_variance / samples.frequency_hz**2 + _LINE_WANDER**2
    evidence = np.zeros((n_lines, n_lines))
    is_known = np.isfinite(log_f)
    n_known = is_known.sum(axis=1)
    for k in range(n_lines - 1):
        at = np.flatnonzero(np.isfinite(log_f[k]))
        rest = slice(k + 1, None)
        row = _doppler_evidence(
            log_f[k, at], variance[k, at], log_f[rest, at], variance[rest, at]
        )
        # the end of one passage and the beginning of the next bend alike: hardly
        together = is_known[rest, at].sum(axis=1)
        shorter = np.minimum(n_known[k], n_known[rest])
        row = np.where(together >= _LEAST_SHARE * shorter, row, np.minimum(row, 0.0))
        row += _bearing_evidence(
            samples.bearing_deg[k, at] - samples.bearing_deg[rest, at],
            samples.bearing_variance[k, at] + samples.bearing_variance[rest, at],
        )
        evidence[k, rest] = evidence[rest, k] = row / samples.correlation_samples
    return evidence


def _doppler_evidence(
    one: FloatArray, one_variance: FloatArray, rest: FloatArray, variance: FloatArray
) -> FloatArray:
    is_common = np.isfinite(rest)
    count = is_common.sum(axis=1)
    own = _spread(np.where(is_common, one, np.nan)) + _spread(
        np.where(np.isfinite(one), rest, np.nan)
    )
    # smoothed lines lag, and horns waver: shapes agree within a share of their size
    total = one_variance + variance + (_SHAPE_SHARE**2 * own)[:, None]
    off = one - rest
    weight = np.where(is_common, 1.0 / total, 0.0)
    mean = _ratio((weight * np.where(is_common, off, 0.0)).sum(1), weight.sum(1))
    square = (off - mean[:, None]) ** 2
    apart = total + own[:, None]
    terms = 0.5 * (np.log(apart / total) - square / total + square / apart)
    terms = np.where(is_common, terms, 0.0)
    return np.where(count >= _LEAST_COMMON, terms.sum(axis=1), 0.0)


def _bearing_evidence(turn_deg: FloatArray, variance: FloatArray) -> FloatArray:
    total = variance + _BEARING_WANDER_DEG**2
    terms = np.log(360.0 / np.sqrt(2.0 * np.pi * total))
    terms = terms - 0.5 * wrap_deg(turn_deg) ** 2 / total
    is_common = np.isfinite(terms)
    enough = is_common.sum(axis=1) >= _LEAST_COMMON
    return np.where(enough, np.where(is_common, terms, 0.0).sum(axis=1), 0.0)


def _spread(values: FloatArray) -> FloatArray:
    """Variance along time without the missing values."""
    is_known = np.isfinite(values)
    count = is_known.sum(axis=1)
    mean = _ratio(np.where(is_known, values, 0.0).sum(axis=1), count)
    square = np.where(is_known, (values - mean[:, None]) ** 2, 0.0)
    return _ratio(square.sum(axis=1), count)


def _ratio(total: FloatArray, count: FloatArray | IntArray) -> FloatArray:
    return np.divide(total, count, out=np.zeros(total.shape), where=count > 0)


def group(evidence: FloatArray, least: float) -> IntArray:
    """Join lines into groups by the sum of the evidence between groups.

    Parameters
    ----------
    evidence
        Symmetric table of evidence.
    least
        Evidence that a pair needs to start a union.

    Returns
    -------
    IntArray
        Number of the group of each line, from 0, in the order of their first line.
    """
    label = np.arange(evidence.shape[0])
    low, high = np.nonzero(np.triu(evidence >= least, 1))
    order = np.argsort(-evidence[low, high], kind="stable")
    for a, b in zip(low[order], high[order], strict=True):
        if label[a] == label[b]:
            continue
        one, two = label == label[a], label == label[b]
        between = evidence[np.ix_(one, two)]
        if between.sum() >= least and between.min() > _VETO:
            label[two] = label[a]
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


def has_doppler(samples: LineSamples) -> BoolArray:
    """Tell which lines change their frequency beyond their uncertainty."""
    noise = np.nanmean(samples.frequency_variance, axis=1)
    floor = (_LINE_WANDER * np.nanmean(samples.frequency_hz, axis=1)) ** 2
    return np.asarray(_spread(samples.frequency_hz) > 9.0 * (noise + floor))


def has_turn(samples: LineSamples) -> BoolArray:
    """Tell which lines change their bearing beyond their uncertainty."""
    radians = np.radians(samples.bearing_deg)
    is_known = np.isfinite(radians)
    turned = np.where(is_known, radians, 0.0)
    middle = np.degrees(
        np.arctan2(
            (np.sin(turned) * is_known).sum(axis=1),
            (np.cos(turned) * is_known).sum(axis=1),
        )
    )
    off = wrap_deg(samples.bearing_deg - middle[:, None])
    variance = np.where(is_known, samples.bearing_variance, 0.0).sum(axis=1)
    noise = _ratio(variance, is_known.sum(axis=1)) + _BEARING_WANDER_DEG**2
    return _spread(off) > 9.0 * noise


def mains_lines(frequency_hz: FloatArray, is_steady: BoolArray) -> BoolArray:
    """Tell which steady lines are multiples of one mains frequency.

    Notes
    -----
    50 and 60 Hz are tried; the one with more multiples among the lines is taken.
    A grid holds its frequency within 0.1 %; half a hertz is the most allowed.
    """
    best = np.zeros(frequency_hz.size, dtype=bool)
    for mains_hz in (50.0, 60.0):
        order = np.maximum(np.rint(frequency_hz / mains_hz), 1.0)
        miss = np.abs(frequency_hz - order * mains_hz)
        is_hum = is_steady & (miss <= np.minimum(1e-3 * frequency_hz + 0.05, 0.5))
        if is_hum.sum() > best.sum():
            best = is_hum
    return best
