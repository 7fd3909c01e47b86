"""Which peak belongs to which line: gates, wider gates by feedback, assignment.

**Method.** A line's gate is a few deviations of its innovation, or a fixed rectangle.
Confirmed lines choose before tentative ones. Recognised lines have wider gates and may
take a peak below the threshold when there is no other (Choi 2014, equations 9 and 10).

**Conventions.** Lines are given by their slots in the store, pairs by position.

**References.** Choi (2014).
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.assignment import assign, candidate_pairs
from uwtrack_cli.lines.tracker_options import TrackerOptions
from uwtrack_cli.lines.tracking.frame_peaks import Choice, FramePeaks
from uwtrack_cli.lines.tracking.llr_score import LlrScore
from uwtrack_cli.lines.tracking.track_management import HitCounter
from uwtrack_cli.lines.tracking.track_store import TrackStore

UNRESOLVED = 1.5
"""Distance of two lines, in resolutions, within which their peaks may be one."""

LOUD = 3.0
"""Height of a peak, in nepers, that noise hardly ever has."""


@dataclass
class Pairs:
    """Candidate pairs of a frame, ordered by line; arrays of shape (pair,)."""

    line: IntArray
    """Position of the line among the slots given."""
    peak: IntArray
    """Position of the peak in the frame."""
    cost: FloatArray
    """What the assignment makes small."""
    gain: FloatArray
    """Log-likelihood ratio "this line's peak" against "noise", nepers."""

    def take(self, keep: BoolArray | IntArray | slice) -> "Pairs":
        """Keep some pairs."""
        return Pairs(self.line[keep], self.peak[keep], self.cost[keep], self.gain[keep])

    def best(self, *, is_exclusive: bool = True) -> "Pairs":
        """Keep the best pair of each line, and of each peak if it is for one line."""
        if not self.line.size:
            return self
        is_first = np.empty(self.line.size, dtype=bool)
        is_first[0] = True
        np.not_equal(self.line[1:], self.line[:-1], out=is_first[1:])
        least = np.minimum.reduceat(self.cost, is_first.nonzero()[0])
        group = is_first.cumsum() - 1
        best = (self.cost == least[group]).nonzero()[0]
        if best.size > least.size:  # of equal ones the first
            best = best[np.unique(group[best], return_index=True)[1]]
        if is_exclusive and np.bincount(self.peak[best]).max() > 1:
            return self.take(assign(self.line, self.peak, self.cost))
        return self.take(best)


class Associator:
    """Assigns the peaks of a frame to the lines of a store."""

    def __init__(
        self,
        store: TrackStore,
        options: TrackerOptions,
        logic: LlrScore | HitCounter,
        resolution_hz: float,
    ) -> None:
        self.store = store
        self.options = options
        self.logic = logic
        self.resolution_hz = resolution_hz
        self.near_hz = UNRESOLVED * resolution_hz
        # a fixed gate is meant as it is, and so is a fixed process noise
        self.may_turn = options.gates.bearing_deg is None and options.motion.adaptation > 0.0

    def associate(self, slots: IntArray, peaks: FramePeaks, height: FloatArray) -> Choice:
        """Choose peaks: confirmed lines, which come first in ``slots``, then others."""
        n_confirmed = self.store.confirmed.size
        is_wide = np.zeros(slots.size, dtype=bool)
        is_wide[:n_confirmed] = self.is_recognised(slots[:n_confirmed])
        pairs = self.pairs(slots, is_wide, peaks, height)
        pairs = self._allowed(pairs, is_wide, peaks)
        middle = int(np.searchsorted(pairs.line, n_confirmed))
        chosen = pairs.take(slice(middle)).best()
        return self.choice(chosen, pairs.take(slice(middle, None)), slots, height)

    def choice(
        self, confirmed: Pairs, tentative: Pairs, slots: IntArray, height: FloatArray
    ) -> Choice:
        """Let the tentative lines choose among the peaks left by the confirmed ones."""
        n_confirmed = self.store.confirmed.size
        if confirmed.peak.size and tentative.peak.size:
            is_left = np.ones(height.size, dtype=bool)
            is_left[confirmed.peak] = False
            is_left = is_left[tentative.peak]
            if not is_left.all():
                tentative = tentative.take(is_left)
        evidence: FloatArray = np.bincount(
            tentative.line - n_confirmed, np.exp(tentative.gain), minlength=slots.size - n_confirmed
        ).astype(np.float64)
        tentative = tentative.best(is_exclusive=self.logic.is_exclusive)
        likely = tentative.gain > self.logic.least_gain
        # noise has no peak as loud: the line has moved, no other one has appeared
        likely |= height[tentative.peak] > LOUD
        if not likely.all():
            tentative = tentative.take(likely)
        return Choice(
            np.concatenate([confirmed.line, tentative.line]),
            np.concatenate([confirmed.peak, tentative.peak]),
            np.concatenate([confirmed.gain, tentative.gain]),
            evidence,
        )

    def is_recognised(self, slots: IntArray) -> BoolArray:
        """Tell which lines the classifier has recognised, or are treated as such."""
        classifier = self.options.feedback.classifier
        if classifier == "all":
            return np.ones(slots.size, dtype=bool)
        return self.store.hold[slots] > 0

    def pairs(
        self, slots: IntArray, is_wide: BoolArray, peaks: FramePeaks, height: FloatArray
    ) -> Pairs:
        """List the pairs inside their gates, with cost and gain of score."""
        gates, store = self.options.gates, self.store
        centre = store.frequency_hz[slots]
        total = store.frequency_variance_hz2[slots] + store.frequency_noise_hz2(slots)
        wide = np.where(is_wide, self.options.feedback.beta, 1.0)
        reach = wide * (gates.frequency_hz or gates.sigmas * np.sqrt(total))
        line, peak = candidate_pairs(centre, reach, peaks.frequency_hz)
        off = peaks.frequency_hz[peak] - centre[line]
        distance = off * off / total[line]
        if peaks.has_bearings:
            turn = wrap_deg(peaks.bearing_deg[peak] - store.bearing_deg[slots[line]])
            turn[np.isnan(turn)] = 0.0
            around = store.bearing_variance_deg2[slots[line]]
            around = around + peaks.bearing_variance_deg2[peak]
            width = gates.bearing_deg or gates.sigmas * np.sqrt(around)
            square = turn * turn / around
            inside = np.abs(turn) < width * wide[line]
            if self.may_turn:
                # noise has no peak as loud: the vessel turns faster than was thought
                turned = self._may_have_turned(slots)[line] & (height[peak] > LOUD)
                square[turned] = np.minimum(square[turned], gates.sigmas)
                inside |= turned
            distance = distance + square
            line, peak, distance = line[inside], peak[inside], distance[inside]
        cost, gain = self.logic.weigh(store, slots, distance, total, line, height[peak])
        return Pairs(line, peak, cost, gain)

    def _may_have_turned(self, slots: IntArray) -> BoolArray:
        """Tell which lines are confirmed, with no other near that a peak could be of."""
        confirmed = self.store.confirmed
        alone = np.ones(slots.size, dtype=bool)
        alone[confirmed.size :] = False
        alone[: confirmed.size] = ~self.store.is_near_another(confirmed, self.near_hz)
        return alone

    def _allowed(self, pairs: Pairs, is_wide: BoolArray, peaks: FramePeaks) -> Pairs:
        """Drop weak peaks, but for recognised lines with nothing else in reach."""
        if self.logic.uses_all_peaks or not pairs.line.size:
            return pairs
        is_detection = peaks.is_detection[pairs.peak]
        has_normal = np.bincount(pairs.line[is_detection], minlength=is_wide.size) > 0
        alpha_db = 20.0 * np.log10(self.options.feedback.alpha)
        cell_db = 10.0 * np.log10(1.0 + 10.0 ** (peaks.snr_db[pairs.peak] / 10.0))
        is_loud = cell_db > peaks.threshold_db + alpha_db
        is_spare = is_wide[pairs.line] & ~has_normal[pairs.line] & is_loud
        pairs.cost = pairs.cost + 500.0 * ~is_detection
        return pairs.take(is_detection | is_spare)

    def is_claimed(self, peaks: FramePeaks) -> BoolArray:
        """Tell which peaks are too near a confirmed line to be another line."""
        store, gates = self.store, self.options.gates
        slots, n_peaks = store.confirmed, peaks.frequency_hz.size
        if not slots.size or not n_peaks:
            return np.zeros(n_peaks, dtype=bool)
        reach = gates.frequency_hz or self.resolution_hz
        if gates.bearing_deg is None:
            fence = np.empty(slots.size + 2)
            fence[0], fence[-1] = -np.inf, np.inf
            fence[1:-1] = np.sort(store.frequency_hz[slots])
            at = np.searchsorted(fence, peaks.frequency_hz)
            away = np.minimum(peaks.frequency_hz - fence[at - 1], fence[at] - peaks.frequency_hz)
            return np.asarray(away < reach)
        line, peak = candidate_pairs(
            store.frequency_hz[slots], np.full(slots.size, reach), peaks.frequency_hz
        )
        turn = wrap_deg(peaks.bearing_deg[peak] - store.bearing_deg[slots[line]])
        is_claimed = np.zeros(n_peaks, dtype=bool)
        is_claimed[peak[~(np.abs(turn) >= gates.bearing_deg)]] = True
        return is_claimed
