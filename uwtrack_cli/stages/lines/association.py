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
from uwtrack_cli.estimation.line_bank import CONFIRMED, LineBank
from uwtrack_cli.stages.lines.frame_peaks import FramePeaks
from uwtrack_cli.stages.lines.logics import Logic
from uwtrack_cli.stages.lines.policies import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    Motion,
    ScoreLogic,
)


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
    """Candidate pairs of a frame: line (position in ``slots``), peak, fit."""

    line: IntArray
    peak: IntArray
    is_basic: BoolArray
    cost: FloatArray
    gain: FloatArray

    def take(self, keep: BoolArray | IntArray) -> "Pairs":
        """Keep some pairs."""
        return Pairs(
            self.line[keep], self.peak[keep], self.is_basic[keep],
            self.cost[keep], self.gain[keep],
        )  # fmt: skip

    def assigned(self) -> "Pairs":
        """Keep the pairs of the best one-to-one assignment."""
        return self.take(assign(self.line, self.peak, self.cost))


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
        self, slots: IntArray, peaks: FramePeaks, crowding: FloatArray
    ) -> Pairs:
        """Assign peaks to lines one to one: confirmed lines first, then the others."""
        is_confirmed = self.bank.stage[slots] == CONFIRMED
        is_lax = is_confirmed & self.is_recognised(slots)
        pairs = self.pairs(slots, is_lax, peaks, crowding)
        pairs = self._allowed(pairs, is_lax, peaks)
        first = pairs.take(is_confirmed[pairs.line])
        first = first.assigned()
        taken = np.zeros(peaks.frequency.size, dtype=bool)
        taken[first.peak] = True
        second = pairs.take(~is_confirmed[pairs.line] & ~taken[pairs.peak])
        second = second.assigned()
        return Pairs(*(
            np.concatenate([getattr(first, name), getattr(second, name)])
            for name in ("line", "peak", "is_basic", "cost", "gain")
        ))  # fmt: skip

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
        crowding: FloatArray,
    ) -> Pairs:
        """List the pairs inside their gates, with cost and gain of score."""
        gates, state = self.policies.gates, self.bank.state
        factor = np.where(is_lax, self.policies.feedback.beta, 1.0)
        centre, spread = state.position[:, slots], state.variance[:, slots]
        if gates.frequency_hz is None:
            widest = peaks.variance.max(initial=0.0)
            reach = gates.sigmas * np.sqrt(spread[0] + widest) * factor
        else:
            reach = gates.frequency_hz * factor
        line, peak = candidate_pairs(centre[0], reach, peaks.frequency)
        off = peaks.frequency[peak] - centre[0][line]
        turn = kalman.wrap_deg(peaks.bearing[peak] - centre[1][line])
        turn[np.isnan(turn)] = 0.0
        total = spread[0][line] + peaks.variance[peak]
        turn_total = spread[1][line] + peaks.bearing_variance[peak]
        width, turn_width = (
            gates.sigmas * np.sqrt(total) if gates.frequency_hz is None
            else gates.frequency_hz,
            gates.sigmas * np.sqrt(turn_total) if gates.bearing_deg is None
            else gates.bearing_deg,
        )  # fmt: skip
        wide = factor[line]
        inside = (np.abs(off) < width * wide) & (np.abs(turn) < turn_width * wide)
        basic = (np.abs(off) < width) & (np.abs(turn) < turn_width)
        distance = off**2 / total + turn**2 / turn_total
        cost, gain = self.logic.weigh(
            distance, total, peaks.raw[5, peak], crowding[peak]
        )
        return Pairs(line, peak, basic, cost, gain).take(inside)

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
        slots = np.flatnonzero(bank.stage == CONFIRMED)
        reach = np.full(slots.size, gates.frequency_hz or self.resolution_hz)
        line, peak = candidate_pairs(bank.table[0, slots], reach, peaks.frequency)
        if gates.bearing_deg is not None:
            turn = kalman.wrap_deg(peaks.bearing[peak] - bank.table[1, slots[line]])
            peak = peak[~(np.abs(turn) >= gates.bearing_deg)]
        is_claimed = np.zeros(peaks.frequency.size, dtype=bool)
        is_claimed[peak] = True
        return is_claimed
