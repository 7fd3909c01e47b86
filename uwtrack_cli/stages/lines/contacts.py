"""Group tracked lines into contacts and tell moving, steady and mains lines apart.

**Method.** While lines are tracked, their smoothed points are kept on a coarse grid
of frames; the grid is thinned whenever too many are held, so memory is bounded. At
the end of the recording the lines are compared in pairs (`line_grouping`). Lines of
one harmonic family count as one source unless the comparison contradicts.

**Conventions.** Contacts count from 1 in the order of their first line. Contact 0 is
"none": mains hum, and steady lines that share nothing with another line.

**References.** See `line_grouping`.
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, IntArray, TextArray
from uwtrack_cli.estimation.lines.line_bank import Points
from uwtrack_cli.estimation.lines.line_grouping import (
    LineSamples,
    group,
    has_doppler,
    has_turn,
    mains_lines,
    pair_evidence,
)

_MOST_SAMPLES = 200_000
"""Points held before the grid is thinned by two."""

_MOST_CELLS = 2_000_000
"""Lines times common times that are compared at once."""

_FAMILY_EVIDENCE = 8.0
"""Evidence of a common family, in nepers: its chance is below 1e-3."""

_LEAST_EVIDENCE = 3.0
"""Evidence that joins two lines (Kass & Raftery 1995: strong)."""

_BEARING_KNOWN_BELOW_DEG2 = 1e6


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

    def add(self, points: Points) -> None:
        """Keep the points on the grid."""
        self._seen.update(np.unique(points["line"]).tolist())
        on_grid = points["frame"] % self.stride == 0
        v = points["values"][on_grid]
        is_known = v[:, 5] < _BEARING_KNOWN_BELOW_DEG2
        bearing = np.where(is_known, v[:, 1], np.nan)
        fresh = np.stack([v[:, 0], v[:, 4], bearing, v[:, 5]], axis=1)
        self.line = np.append(self.line, points["line"][on_grid].astype(np.int64))
        self.frame = np.append(self.frame, points["frame"][on_grid].astype(np.int64))
        self.values = np.concatenate([self.values, fresh])
        while self.line.size > _MOST_SAMPLES:
            self.stride *= 2
            keep = self.frame % self.stride == 0
            self.line, self.frame = self.line[keep], self.frame[keep]
            self.values = self.values[keep]

    def samples(self, lines: IntArray, memory_frames: float) -> LineSamples:
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
            memory=max(1.0, memory_frames / stride),
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
    label = group(evidence, _LEAST_EVIDENCE)
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
