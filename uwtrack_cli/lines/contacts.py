"""Group tracked lines into contacts and tell moving, steady and mains lines apart.

**Method.** While lines are tracked, their smoothed points are kept on a coarse grid
of frames; the grid is thinned whenever too many are held, so memory is bounded. At
the end of the recording the lines that were heard together are compared in pairs.
Groups grow from the strongest pair on, as long as the evidence summed over all pairs of
two groups is for the union. Lines of one harmonic family count as one source unless the
comparison contradicts.

**Conventions.** Contacts count from 1 in the order of their first line. Contact 0 is
"none": mains hum, and steady lines that share nothing with another line. Samples are
rows of points, by line, then by frame; there is no table of line and time, which a
day would fill with nothing. Evidence is in nepers; a pair that is not named has none.

**References.** Kass & Raftery, "Bayes factors", JASA 90, 773-795 (1995), for the
scale: 3 nepers is strong.
"""

from collections.abc import Sequence

import numpy as np

from uwtrack_cli.constants import MAINS_HZ, MAINS_REACH_HZ, MAINS_TOLERANCE
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray, TextArray
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.lines.families.lasting_families import FamilyRegister
from uwtrack_cli.lines.line_points import FamilyJump, LinePoints, LineTable
from uwtrack_cli.lines.pair_evidence import (
    BEARING_WANDER_DEG,
    LINE_WANDER,
    LineSamples,
    PairEvidence,
    pair_evidence,
)

_MOST_SAMPLES = 200_000
"""Points held before the grid is thinned by two."""

_MOST_WAITING = 4_096
"""Points that wait until they are put behind the others."""

_FAMILY_EVIDENCE = 8.0
"""Evidence of a common family, in nepers: its chance is below 1e-3."""

LEAST_EVIDENCE = 3.0
"""Evidence that joins two lines (Kass & Raftery 1995: strong)."""

UNRESOLVED_BINS = 1.75
"""Distance of two lines, in natural bins, within which they are told as unresolved: at 2
bins 19 of 20 of a line's points are its own, at 1.5 every tenth is the other's."""

CORRELATION_WINDOWS = 4.0
"""Windows over which the errors of a smoothed line are taken as correlated."""

FAMILY_CHANCE = 0.1
"""Expected number of families by chance in a recording below which they last."""

FEWEST_MULTIPLES, LOWEST_MULTIPLE = 2, 5
"""Multiples of the mains that tell hum, and the highest that the lowest of them may be: one
line of any sound lies as near to a multiple by chance as one in thirty does."""

_VETO = -6.0
"""Evidence against a pair that keeps their groups apart."""


class ContactSamples:
    """Coarse histories of all lines, in bounded memory."""

    def __init__(self, stride: int) -> None:
        self.stride = stride
        self._line = np.zeros(0, dtype=np.int32)
        self._frame = np.zeros(0, dtype=np.int32)
        self._values = np.zeros((0, 4))
        self._waiting: list[tuple[IntArray, IntArray, FloatArray]] = []
        self._n_waiting = 0
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
        line, frame = points.line[on_grid], points.frame[on_grid]
        self._waiting.append((line.astype(np.int32), frame.astype(np.int32), fresh))
        self._n_waiting += fresh.shape[0]
        if self._n_waiting > _MOST_WAITING:
            self._gather()

    def _gather(self) -> None:
        """Put what waits behind the rest, and thin the grid if it is too much."""
        line, frame, values = zip(*self._waiting, strict=True)
        self._waiting, self._n_waiting = [], 0
        self._line = np.concatenate([self._line, *line])
        self._frame = np.concatenate([self._frame, *frame])
        self._values = np.concatenate([self._values, *values])
        while self._line.size > _MOST_SAMPLES:
            self.stride *= 2
            keep = self._frame % self.stride == 0
            self._line, self._frame = self._line[keep], self._frame[keep]
            self._values = self._values[keep]

    def samples(self, lines: IntArray, correlation_frames: float) -> LineSamples:
        """Return the histories of some lines, given by ascending numbers."""
        if self._waiting:
            self._gather()
        on_grid = np.flatnonzero(self._frame % self.stride == 0)
        order = on_grid[np.lexsort((self._frame[on_grid], self._line[on_grid]))]
        line, values = self._line[order], self._values[order]
        first = np.append(np.searchsorted(line, lines), line.size)
        return LineSamples(
            first, self._frame[order],
            values[:, 0], values[:, 1], values[:, 2], values[:, 3],
            correlation_samples=max(1.0, correlation_frames / self.stride),
        )  # fmt: skip


def line_table(
    held: ContactSamples,
    register: FamilyRegister,
    jumps: Sequence[FamilyJump],
    *,
    window_frames: float,
    resolution_hz: float,
) -> LineTable:
    """Return what is known of whole lines by their histories, families and jumps.

    A window lasts so many steps from one frame to the next.
    """
    lines = held.line_seen()
    families, family = register.lasting(lines, FAMILY_CHANCE)
    samples = held.samples(lines, CORRELATION_WINDOWS * window_frames)
    contact, status = group_lines(samples, family)
    beside = unresolved_share(samples, UNRESOLVED_BINS * resolution_hz)
    known = set(lines.tolist())
    told = [jump for jump in jumps if not known.isdisjoint(jump.lines)]
    return LineTable(lines, contact, family, status, beside, families, told)


def unresolved_share(samples: LineSamples, reach_hz: float) -> FloatArray:
    """Return in what share of its samples each line has another one beside it.

    Peaks of two lines within ``reach_hz`` are not told apart. 0 to 1, shape (line,); 0
    for lines too short for the grid.
    """
    line = np.repeat(np.arange(samples.n_points.size), samples.n_points)
    order = np.lexsort((samples.frequency_hz, samples.frame))
    frequency, frame = samples.frequency_hz[order], samples.frame[order]
    is_beside = (np.diff(frequency) < reach_hz) & (np.diff(frame) == 0)
    has_mate = np.zeros(order.size, dtype=bool)
    has_mate[1:] |= is_beside
    has_mate[:-1] |= is_beside
    n_beside = np.bincount(line[order][has_mate], minlength=samples.n_points.size)
    return np.asarray(n_beside / np.maximum(samples.n_points, 1))


def group_lines(samples: LineSamples, family: IntArray) -> tuple[IntArray, TextArray]:
    """Return contact (0 for none) and 'moving', 'steady' or 'hum' of each line.

    ``family`` is the lasting family of each, -1 for none, shape (line,).
    """
    if family.size == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype="U6")
    is_sampled = samples.n_points > 0  # others are too short for the grid
    is_moving = (has_doppler(samples) | has_turn(samples)) & is_sampled
    is_hum = _hum(samples, family, ~is_moving & is_sampled)
    evidence = _with_families(pair_evidence(samples), family)
    heard = ~(is_hum[evidence.low] | is_hum[evidence.high])
    label = group(
        PairEvidence(evidence.low[heard], evidence.high[heard], evidence.nepers[heard]),
        family.size,
        LEAST_EVIDENCE,
    )
    size = np.bincount(label)[label]
    has_bearing = _sums(samples, np.isfinite(samples.bearing_deg)) > 0
    is_contact = ~is_hum & (is_moving | has_bearing | (size > 1))
    contact = np.zeros(label.size, dtype=np.int64)
    _, first, number = np.unique(label[is_contact], return_index=True, return_inverse=True)
    contact[is_contact] = np.argsort(np.argsort(first))[number] + 1
    # what one line of a contact shows, the weaker ones share
    shared = np.bincount(contact, is_moving, minlength=1)[contact] > 0
    is_moving |= (contact > 0) & shared
    status = np.where(is_hum, "hum", np.where(is_moving, "moving", "steady"))
    return contact, status


def _hum(samples: LineSamples, family: IntArray, is_steady: BoolArray) -> BoolArray:
    """Mains multiples; a family whose other lines are none is a machine."""
    is_hum = mains_lines(_means(samples, samples.frequency_hz), is_steady)
    for number in np.unique(family[family >= 0]):
        member = family == number
        if is_hum[member].mean() <= 0.5:
            is_hum &= ~member
    return is_hum


def _with_families(evidence: PairEvidence, family: IntArray) -> PairEvidence:
    """Add the evidence of a common family to every pair of its lines."""
    low, high = [evidence.low], [evidence.high]
    nepers = [evidence.nepers]
    for number in np.unique(family[family >= 0]):
        member = np.flatnonzero(family == number)
        one, two = np.triu_indices(member.size, 1)
        low.append(member[one])
        high.append(member[two])
        nepers.append(np.full(one.size, _FAMILY_EVIDENCE))
    pair = np.concatenate(low) * family.size + np.concatenate(high)
    found, place = np.unique(pair, return_inverse=True)
    total = _totals(np.concatenate(nepers), place, found.size)
    return PairEvidence(found // family.size, found % family.size, total)


def _sums(samples: LineSamples, values: FloatArray | BoolArray) -> FloatArray:
    """Sum over the points of each line."""
    return _totals(values, samples.row, samples.first.size - 1)


def _means(samples: LineSamples, values: FloatArray) -> FloatArray:
    """Mean over the points of each line; 0 for a line without any."""
    return _ratio(_sums(samples, values), samples.n_points)


def _spread(values: FloatArray, group: IntArray, count: IntArray) -> FloatArray:
    """Variance within each group; 0 for an empty one."""
    mean = _ratio(_totals(values, group, count.size), count)
    square = (values - mean[group]) ** 2
    return _ratio(_totals(square, group, count.size), count)


def _totals(values: FloatArray | BoolArray, group: IntArray, n_groups: int) -> FloatArray:
    """Sum within each of so many groups."""
    return np.bincount(group, values, minlength=n_groups).astype(float)


def _ratio(total: FloatArray, count: FloatArray | IntArray) -> FloatArray:
    return np.divide(total, count, out=np.zeros(total.shape), where=count > 0)


def group(evidence: PairEvidence, n_lines: int, least: float) -> IntArray:
    """Join lines into groups by the sum of the evidence between groups.

    A pair needs ``least`` evidence to start a union. Returns the number of the group of
    each line, from 0, in the order of their first line.
    """
    label = np.arange(n_lines)
    between: dict[int, dict[int, tuple[float, float]]] = {}
    pairs = (evidence.low.tolist(), evidence.high.tolist(), evidence.nepers.tolist())
    for a, b, nepers in zip(*pairs, strict=True):
        between.setdefault(a, {})[b] = between.setdefault(b, {})[a] = (nepers, nepers)
    members = {k: [k] for k in between}
    strong = np.flatnonzero(evidence.nepers >= least)
    order = strong[np.argsort(-evidence.nepers[strong], kind="stable")]
    for pair in order.tolist():
        one, two = int(label[pairs[0][pair]]), int(label[pairs[1][pair]])
        if one == two:
            continue
        total, smallest = between[one][two]
        if total >= least and smallest > _VETO:
            label[members[two]] = one
            members[one] += members.pop(two)
            _unite(between, one, two)
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


def _unite(between: dict[int, dict[int, tuple[float, float]]], one: int, two: int) -> None:
    """Add to a group's sums and smallest pairs of evidence those of another group."""
    own = between[one]
    del own[two]
    for other, (total, smallest) in between.pop(two).items():
        if other == one:
            continue
        before, least = own.get(other, (0.0, np.inf))
        own[other] = (before + total, min(least, smallest))
        between[other][one] = own[other]
        del between[other][two]


def has_doppler(samples: LineSamples) -> BoolArray:
    """Tell which lines change their frequency beyond their uncertainty."""
    noise = _means(samples, samples.frequency_variance)
    floor = (LINE_WANDER * _means(samples, samples.frequency_hz)) ** 2
    spread = _spread(samples.frequency_hz, samples.row, samples.n_points)
    return np.asarray(spread > 9.0 * (noise + floor))


def has_turn(samples: LineSamples) -> BoolArray:
    """Tell which lines change their bearing beyond their uncertainty."""
    known = np.flatnonzero(np.isfinite(samples.bearing_deg))
    row, n_lines = samples.row[known], samples.first.size - 1
    count = np.bincount(row, minlength=n_lines)
    radians = np.radians(samples.bearing_deg[known])
    east = _totals(np.sin(radians), row, n_lines)
    north = _totals(np.cos(radians), row, n_lines)
    middle = np.degrees(np.arctan2(east, north))
    off = wrap_deg(samples.bearing_deg[known] - middle[row])
    variance = _totals(samples.bearing_variance[known], row, n_lines)
    noise = _ratio(variance, count) + BEARING_WANDER_DEG**2
    return np.asarray(_spread(off, row, count) > 9.0 * noise)


def mains_lines(frequency_hz: FloatArray, is_steady: BoolArray) -> BoolArray:
    """Tell which steady lines are multiples of one mains frequency.

    Notes
    -----
    50 and 60 Hz are tried; the one with more multiples among the lines is taken.
    A grid holds its frequency within 0.1 %; half a hertz is the most allowed. One line
    may lie there by chance, and mains are heard by their first multiples: there must be
    `FEWEST_MULTIPLES`, one of them up to `LOWEST_MULTIPLE`.
    """
    best = np.zeros(frequency_hz.size, dtype=bool)
    for mains_hz in MAINS_HZ:
        order = np.maximum(np.rint(frequency_hz / mains_hz), 1.0)
        miss = np.abs(frequency_hz - order * mains_hz)
        reach = MAINS_TOLERANCE * frequency_hz + MAINS_REACH_HZ
        is_hum = is_steady & (miss <= np.minimum(reach, 0.5))
        multiples = np.unique(order[is_hum])
        is_mains = multiples.size >= FEWEST_MULTIPLES
        is_mains = is_mains and multiples[0] <= LOWEST_MULTIPLE
        if is_mains and is_hum.sum() > best.sum():
            best = is_hum
    return best
