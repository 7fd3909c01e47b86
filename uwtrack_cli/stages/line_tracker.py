"""One frame of line tracking: predict, associate, update, decide, start lines.

**Method.** The normative order of a frame: all lines are predicted; confirmed lines
choose among the peaks in their gates, then tentative ones among the rest; filters
are updated; lines are confirmed, ended and merged; families are sought among the
confirmed lines; free peaks start new lines. A frame without effort is missing
time: states are carried across it and nothing is counted.

**Conventions.** Every decision depends on the frames alone, never on how they were
cut into blocks.

**References.** Choi (2014); Blackman & Popoli (1999), section 6.2.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import COASTED, DETECTED, SUB_THRESHOLD
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation import kalman
from uwtrack_cli.estimation.assignment import assign, candidate_pairs
from uwtrack_cli.estimation.harmonics import CombRule, find_combs
from uwtrack_cli.estimation.line_bank import (
    ASSOCIATION,
    CONFIRMED,
    LAG_FRAMES,
    STATE_ROWS,
    TENTATIVE,
    LineBank,
    Points,
)
from uwtrack_cli.stages.contacts import ContactSamples, group_lines
from uwtrack_cli.stages.frame_peaks import FramePeaks
from uwtrack_cli.stages.line_families import FamilyRegister
from uwtrack_cli.stages.line_logics import HitCounter, Logic, ScoreKeeper
from uwtrack_cli.stages.line_output import LineTable
from uwtrack_cli.stages.line_policies import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    Motion,
    ScoreLogic,
)

_UNKNOWN_BEARING_VARIANCE = 1e8
"""Variance in degree^2 of a bearing that was never measured."""

_GREATEST_STD = 1.5
"""Deviation of a prediction, in resolutions, beyond which a line has no identity."""


_MEMORY_WINDOWS = 4.0
"""Windows over which the errors of a smoothed line are taken as correlated."""

_LEAST_JITTER = 0.1
"""Floor of a line's deviation in the comb test, in resolutions (Choi 2014, A.4)."""


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
class _Pairs:
    """Candidate pairs of a frame: line (position in ``slots``), peak, fit."""

    line: IntArray
    peak: IntArray
    is_basic: BoolArray
    cost: FloatArray
    gain: FloatArray

    def take(self, keep: BoolArray | IntArray) -> "_Pairs":
        return _Pairs(
            self.line[keep], self.peak[keep], self.is_basic[keep],
            self.cost[keep], self.gain[keep],
        )  # fmt: skip


class LineTracker:
    """Carries the lines from frame to frame."""

    def __init__(self, policies: Policies, frames: Frames, peaks: Peaks) -> None:
        self.policies = policies
        self.bank = LineBank()
        self.resolution_hz = 1.0 / frames.window_s
        self.band_hz = peaks.highest_hz - peaks.lowest_hz
        self.logic: Logic = (
            ScoreKeeper(policies.score, frames, peaks)
            if policies.initiation == "score"
            else HitCounter(policies.count)
        )
        self.hop_s = frames.hop_s
        self.reference = peaks.reference
        self.families = FamilyRegister()
        self.samples = ContactSamples(max(1, round(frames.window_s / frames.hop_s)))
        self.frames_seen = 0
        self.window_frames = frames.window_s / frames.hop_s
        self.last_time_s: float | None = None

    def step(self, frame: int, time_s: float, effort: float, peaks: FramePeaks) -> None:
        """Advance all lines by one frame."""
        bank = self.bank
        step_s = 0.0 if self.last_time_s is None else time_s - self.last_time_s
        self.last_time_s = time_s
        state = kalman.predict(bank.state, step_s, bank.noise_density)
        bank.table[:STATE_ROWS] = np.concatenate(state)
        bank.table[STATE_ROWS:] = np.nan
        if effort > 0.0:
            self._observe(peaks, frame)
        bank.keep_frame(frame, time_s, step_s)

    def emit(self) -> Points:
        """Return the points that have become final."""
        return self._emit(LAG_FRAMES)

    def finish(self) -> Points:
        """End all lines and return the points still held."""
        self.bank.release(self.bank.active())
        return self._emit(0)

    def _emit(self, lag: int) -> Points:
        points = self.bank.emit(lag)
        self.samples.add(points)
        return points

    def line_table(self) -> LineTable:
        """Return what is known of the lines, at the end."""
        lines = self.samples.line_seen()
        families, family = self.families.lasting(lines, 0.1)
        samples = self.samples.samples(lines, _MEMORY_WINDOWS * self.window_frames)
        contact, status = group_lines(samples, family)
        return LineTable(lines, contact, family, status, families)

    def scalars(self) -> dict[str, Any]:
        """Return what the run could have found."""
        return {
            "reference": self.reference,
            "false_lines_per_khz_hour": self.logic.false_lines_per_khz_hour,
            "weakest_line_snr_db": self.logic.weakest_line_snr_db,
        }

    def _observe(self, peaks: FramePeaks, frame: int) -> None:
        bank = self.bank
        slots = bank.active()
        bank.table[ASSOCIATION, slots] = COASTED
        is_claimed = self._is_claimed(peaks)
        crowding = self.logic.crowding(peaks.frequency, ~is_claimed)
        is_free = np.ones(peaks.frequency.size, dtype=bool)
        if slots.size:
            chosen = self._associate(slots, peaks, crowding)
            self._update(slots[chosen.line], chosen.peak, peaks)
            is_free[chosen.peak] = False
            is_likely = self.logic.is_likely(bank, slots[chosen.line])
            is_claimed[chosen.peak[is_likely]] = True
            self._decide(slots, chosen)
            self._merge()
            is_claimed |= self._is_claimed(peaks)
        self.logic.watch(peaks.frequency[~is_claimed])
        self.frames_seen += 1
        if self.frames_seen % self.policies.feedback.every_frames == 0:
            self._classify(frame)
        self._start(peaks, is_free & ~is_claimed, crowding)

    def _associate(
        self, slots: IntArray, peaks: FramePeaks, crowding: FloatArray
    ) -> _Pairs:
        is_confirmed = self.bank.stage[slots] == CONFIRMED
        is_lax = is_confirmed & self._is_recognised(slots)
        pairs = self._pairs(slots, is_lax, peaks, crowding)
        pairs = self._allowed(pairs, is_lax, peaks)
        first = pairs.take(is_confirmed[pairs.line])
        first = first.take(_assigned(first))
        taken = np.zeros(peaks.frequency.size, dtype=bool)
        taken[first.peak] = True
        second = pairs.take(~is_confirmed[pairs.line] & ~taken[pairs.peak])
        second = second.take(_assigned(second))
        return _Pairs(*(
            np.concatenate([getattr(first, name), getattr(second, name)])
            for name in ("line", "peak", "is_basic", "cost", "gain")
        ))  # fmt: skip

    def _is_recognised(self, slots: IntArray) -> BoolArray:
        classifier = self.policies.feedback.classifier
        if classifier == "all":
            return np.ones(slots.size, dtype=bool)
        return self.bank.hold[slots] > 0

    def _pairs(
        self,
        slots: IntArray,
        is_lax: BoolArray,
        peaks: FramePeaks,
        crowding: FloatArray,
    ) -> _Pairs:
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
        return _Pairs(line, peak, basic, cost, gain).take(inside)

    def _allowed(self, pairs: _Pairs, is_lax: BoolArray, peaks: FramePeaks) -> _Pairs:
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

    def _update(self, slots: IntArray, peak: IntArray, peaks: FramePeaks) -> None:
        table, state = self.bank.table, self.bank.state
        before = kalman.State(*(values[:, slots] for values in state))
        turn = kalman.wrap_deg(peaks.bearing[peak] - before.position[1])
        innovation = np.stack([
            peaks.frequency[peak] - before.position[0],
            np.where(np.isnan(turn), 0.0, turn),
        ])  # fmt: skip
        noise = np.stack([peaks.variance[peak], peaks.bearing_variance[peak]])
        after = kalman.update(before, innovation, noise)
        table[:STATE_ROWS, slots] = np.concatenate(after)
        table[STATE_ROWS:ASSOCIATION, slots] = peaks.raw[:, peak]
        table[ASSOCIATION, slots] = np.where(
            peaks.is_detection[peak], DETECTED, SUB_THRESHOLD
        )

    def _decide(self, slots: IntArray, chosen: _Pairs) -> None:
        bank = self.bank
        hit, gain = np.zeros(slots.size, dtype=bool), np.zeros(slots.size)
        hit[chosen.line] = True
        gain[chosen.line] = chosen.gain
        bank.age[slots] += 1
        patience = np.where(
            self._is_recognised(slots) & (bank.stage[slots] == CONFIRMED),
            self.policies.feedback.gamma, 1.0,
        )  # fmt: skip
        is_sure, is_lost = self.logic.judge(bank, slots, hit, gain, patience)
        spread = np.sqrt(bank.state.variance[0, slots])
        widest = self.policies.gates.frequency_hz or _GREATEST_STD * self.resolution_hz
        is_lost |= spread > widest
        fresh = slots[is_sure & ~is_lost & (bank.stage[slots] == TENTATIVE)]
        bank.stage[fresh] = CONFIRMED
        bank.line[fresh] = bank.next_line + np.arange(fresh.size)
        bank.next_line += fresh.size
        bank.release(slots[is_lost])

    def _merge(self) -> None:
        """End the younger of two lines that have become one."""
        bank, gates = self.bank, self.policies.gates
        near_hz = gates.merge_hz or 0.5 * self.resolution_hz
        slots = bank.active()
        state = bank.state
        slots = slots[np.argsort(state.position[0, slots], kind="stable")]
        for gap in (1, 2):
            low, high = slots[:-gap], slots[gap:]
            is_near = state.position[0, high] - state.position[0, low] < near_hz
            if not is_near.any():
                continue
            low, high = low[is_near], high[is_near]
            turn = kalman.wrap_deg(state.position[1, high] - state.position[1, low])
            slip = np.abs(state.rate[0, high] - state.rate[0, low])
            doubt = np.sqrt(state.rate_variance[0, high] + state.rate_variance[0, low])
            is_one = (np.abs(turn) < gates.merge_deg) | (
                np.maximum(state.variance[1, high], state.variance[1, low])
                > 0.5 * _UNKNOWN_BEARING_VARIANCE
            )
            is_one &= slip < gates.merge_rate_sigmas * doubt
            low, high = low[is_one], high[is_one]
            bank.release(np.unique(_younger(bank, low, high)))

    def _classify(self, frame: int) -> None:
        """Mark the confirmed lines that belong to harmonic families."""
        bank, feedback = self.bank, self.policies.feedback
        bank.hold = np.maximum(bank.hold - feedback.every_frames, 0)
        slots = np.flatnonzero(bank.stage == CONFIRMED)
        # a line that coasts has no frequency to speak of
        slots = slots[bank.rows - bank.settled[slots] <= feedback.hold_frames]
        if slots.size < 3:
            return
        slots = slots[np.argsort(bank.table[0, slots], kind="stable")]
        frequency = bank.table[0, slots]
        variance = bank.state.variance[:, slots]
        sigma = float(np.sqrt(np.median(variance[0])))
        sigma = max(sigma, _LEAST_JITTER * self.resolution_hz)
        bearing = np.where(
            variance[1] < 0.5 * _UNKNOWN_BEARING_VARIANCE,
            bank.table[1, slots], np.nan,
        )  # fmt: skip
        harmonics = self.policies.harmonics
        rule = CombRule(
            harmonics.spacing_hz, harmonics.teeth, sigma,
            harmonics.bearing_window_deg, self.band_hz,
        )  # fmt: skip
        combs, score = find_combs(frequency, bearing, rule, feedback.chance)
        is_member = score < np.log10(feedback.chance)
        if feedback.classifier == "families":
            bank.hold[slots[is_member]] = feedback.hold_frames
        self.families.note(frame, combs, bank.line[slots], frequency, sigma)

    def _start(
        self, peaks: FramePeaks, is_free: BoolArray, crowding: FloatArray
    ) -> None:
        is_seed = is_free & (peaks.is_detection | self.logic.uses_all_peaks)
        if self.policies.feedback.births == "families":
            is_seed &= peaks.is_in_family
        seeds = np.flatnonzero(is_seed)
        if not seeds.size:
            return
        bank, motion = self.bank, self.policies.motion
        slots = bank.free_slots(seeds.size)
        has_bearing = np.isfinite(peaks.bearing[seeds])
        window_s = 1.0 / self.resolution_hz
        rate = motion.rate_std_hzps(window_s, self.hop_s)
        table = bank.table
        table[:, slots] = 0.0
        table[0, slots] = peaks.frequency[seeds]
        table[1, slots] = np.where(has_bearing, peaks.bearing[seeds], 0.0)
        table[4, slots] = peaks.variance[seeds]
        table[5, slots] = np.where(
            has_bearing, peaks.bearing_variance[seeds], _UNKNOWN_BEARING_VARIANCE
        )
        table[8, slots] = rate**2
        table[9, slots] = motion.bearing_rate_degps**2
        table[STATE_ROWS:ASSOCIATION, slots] = peaks.raw[:, seeds]
        table[ASSOCIATION, slots] = np.where(
            peaks.is_detection[seeds], DETECTED, SUB_THRESHOLD
        )
        bank.noise_density[0, slots] = motion.frequency_density(
            peaks.frequency[seeds], window_s
        )
        bank.noise_density[1, slots] = motion.bearing_deg2ps3
        bank.start(slots, self.logic.first_score(peaks.raw[5, seeds], crowding[seeds]))

    def _is_claimed(self, peaks: FramePeaks) -> BoolArray:
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


def _assigned(pairs: _Pairs) -> IntArray:
    """Positions of the pairs of the best one-to-one assignment."""
    line, peak = assign(pairs.line, pairs.peak, pairs.cost)
    width = pairs.peak.max(initial=0) + 1
    return np.flatnonzero(np.isin(pairs.line * width + pairs.peak, line * width + peak))


def _younger(bank: LineBank, low: IntArray, high: IntArray) -> IntArray:
    """Of two lines the tentative one, or of equals the one that started later."""
    rank_low = bank.serial[low] - bank.next_serial * (bank.stage[low] == CONFIRMED)
    rank_high = bank.serial[high] - bank.next_serial * (bank.stage[high] == CONFIRMED)
    return np.where(rank_low > rank_high, low, high)
