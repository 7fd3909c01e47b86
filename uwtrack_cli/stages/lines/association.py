"""Which peak belongs to which line: gates, feedback's laxness, assignment.

**Method.** A line's gate is a few deviations of its innovation, or a fixed rectangle.
Confirmed lines choose before tentative ones. Recognised lines have wider gates and may
take a peak below the threshold when there is no other (Choi 2014, equations 9 and 10).

**Conventions.** Lines are given by their slots in the bank, pairs by position.

**References.** Choi (2014).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation import kalman
from uwtrack_cli.estimation.assignment import assign, candidate_pairs
from uwtrack_cli.estimation.lines.line_bank import LineBank
from uwtrack_cli.stages.lines.frame_peaks import Choice, FramePeaks
from uwtrack_cli.stages.lines.logics import Logic
from uwtrack_cli.stages.lines.policies import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    Motion,
    ScoreLogic,
)

LOUD = 3.0
"""Height of a peak, in nepers, that noise hardly ever has."""


@dataclass(frozen=True)
class Policies:
    """All settings of the tracker in one place."""

    initiation: Literal["score", "count"]
    score: ScoreLogic
    count: CountLogic
    feedback: Feedback
    gates: Gates
    motion: Motion
    harmonics: Harmonics


@dataclass
class Pairs:
    """Candidate pairs of a frame, by line (position in ``slots``): peak and fit."""

    line: IntArray
    peak: IntArray
    cost: FloatArray
    gain: FloatArray

    def take(self, keep: BoolArray | IntArray | slice) -> "Pairs":
        """Keep some pairs."""
        return Pairs(self.line[keep], self.peak[keep], self.cost[keep], self.gain[keep])

    def best(self, *, is_exclusive: bool = True) -> "Pairs":
        """Keep the best pair of each line, and of each peak if it is for one line."""
        if not self.line.size:
            return self
        order = np.lexsort((self.cost, self.line))
        line = self.line[order]
        is_first = np.empty(line.size, dtype=bool)
        is_first[0] = True
        np.not_equal(line[1:], line[:-1], out=is_first[1:])
        best = order[is_first]
        if is_exclusive and np.bincount(self.peak[best]).max() > 1:
            return self.take(assign(self.line, self.peak, self.cost))
        return self.take(best)


class Associator:
    """Assigns the peaks of a frame to the lines of a bank."""

    def __init__(
        self, bank: LineBank, policies: Policies, logic: Logic, resolution_hz: float
    ) -> None:
        self.bank = bank
        self.policies = policies
        self.logic = logic
        self.resolution_hz = resolution_hz

    def associate(
        self, slots: IntArray, peaks: FramePeaks, height: FloatArray
    ) -> Choice:
        """Choose peaks: confirmed lines, which come first in ``slots``, then others."""
        n_sure = self.bank.confirmed.size
        is_lax = self.is_recognised(slots)
        is_lax[n_sure:] = False
        pairs = self._allowed(self.pairs(slots, is_lax, peaks, height), is_lax, peaks)
        middle = int(np.searchsorted(pairs.line, n_sure))
        sure = pairs.take(slice(middle)).best()
        return self.choice(sure, pairs.take(slice(middle, None)), slots, height)

    def choice(
        self, sure: Pairs, young: Pairs, slots: IntArray, height: FloatArray
    ) -> Choice:
        """Let the tentative lines choose among the peaks left by the confirmed ones."""
        n_sure = self.bank.confirmed.size
        if sure.peak.size and young.peak.size:
            is_left = np.ones(height.size, dtype=bool)
            is_left[sure.peak] = False
            young = young.take(is_left[young.peak])
        evidence: FloatArray = np.bincount(
            young.line - n_sure, np.exp(young.gain), minlength=slots.size - n_sure
        ).astype(np.float64)
        young = young.best(is_exclusive=self.logic.is_exclusive)
        likely = young.gain > self.logic.least_gain
        # noise has no peak as loud: a line that has run away, not another one
        likely |= height[young.peak] > LOUD
        if not likely.all():
            young = young.take(likely)
        return Choice(
            np.concatenate([sure.line, young.line]),
            np.concatenate([sure.peak, young.peak]),
            np.concatenate([sure.gain, young.gain]),
            evidence,
        )

    def is_recognised(self, slots: IntArray) -> BoolArray:
        """Tell which lines the classifier has recognised, or are treated as such."""
        classifier = self.policies.feedback.classifier
        if classifier == "all":
            return np.ones(slots.size, dtype=bool)
        return self.bank.hold[slots] > 0

    def pairs(
        self,
        slots: IntArray,
        is_lax: BoolArray,
        peaks: FramePeaks,
        height: FloatArray,
    ) -> Pairs:
        """List the pairs inside their gates, with cost and gain of score."""
        gates, bank = self.policies.gates, self.bank
        centre = bank.state.position[0, slots]
        total = bank.state.variance[0, slots] + 1.0 / bank.precision[slots]
        wide = np.where(is_lax, self.policies.feedback.beta, 1.0)
        reach = wide * (gates.frequency_hz or gates.sigmas * np.sqrt(total))
        line, peak = candidate_pairs(centre, reach, peaks.frequency)
        off = peaks.frequency[peak] - centre[line]
        distance = off * off / total[line]
        if peaks.has_bearings:
            turn = bank.state.position[1, slots[line]]
            turn = kalman.wrap_deg(peaks.bearing[peak] - turn)
            turn[np.isnan(turn)] = 0.0
            around = bank.state.variance[1, slots[line]] + peaks.bearing_variance[peak]
            width = gates.bearing_deg or gates.sigmas * np.sqrt(around)
            inside = np.abs(turn) < width * wide[line]
            distance = distance + turn * turn / around
            line, peak, distance = line[inside], peak[inside], distance[inside]
        cost, gain = self.logic.weigh(bank, slots, distance, total, line, height[peak])
        return Pairs(line, peak, cost, gain)

    def _allowed(self, pairs: Pairs, is_lax: BoolArray, peaks: FramePeaks) -> Pairs:
        """Drop sub-threshold peaks, but for lax lines with nothing else in reach."""
        if self.logic.uses_all_peaks or not pairs.line.size:
            return pairs
        is_detection = peaks.is_detection[pairs.peak]
        has_normal = np.bincount(pairs.line[is_detection], minlength=is_lax.size) > 0
        alpha_db = 20.0 * np.log10(self.policies.feedback.alpha)
        cell_db = 10.0 * np.log10(1.0 + 10.0 ** (peaks.raw[5, pairs.peak] / 10.0))
        is_loud = cell_db > peaks.threshold_db + alpha_db
        is_spare = is_lax[pairs.line] & ~has_normal[pairs.line] & is_loud
        pairs.cost = pairs.cost + 500.0 * ~is_detection
        return pairs.take(is_detection | is_spare)

    def is_claimed(self, peaks: FramePeaks) -> BoolArray:
        """Peaks so near a confirmed line that they cannot be another line."""
        bank, gates = self.bank, self.policies.gates
        slots, n_peaks = bank.confirmed, peaks.frequency.size
        if not slots.size or not n_peaks:
            return np.zeros(n_peaks, dtype=bool)
        reach = gates.frequency_hz or self.resolution_hz
        if gates.bearing_deg is None:
            fence = np.empty(slots.size + 2)
            fence[0], fence[-1] = -np.inf, np.inf
            fence[1:-1] = np.sort(bank.table[0, slots])
            at = np.searchsorted(fence, peaks.frequency)
            away = np.minimum(
                peaks.frequency - fence[at - 1], fence[at] - peaks.frequency
            )
            return np.asarray(away < reach)
        centre = bank.table[0, slots]
        line, peak = candidate_pairs(
            centre, np.full(slots.size, reach), peaks.frequency
        )
        turn = kalman.wrap_deg(peaks.bearing[peak] - bank.table[1, slots[line]])
        is_claimed = np.zeros(n_peaks, dtype=bool)
        is_claimed[peak[~(np.abs(turn) >= gates.bearing_deg)]] = True
        return is_claimed
