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

from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import COASTED, DETECTED, SUB_THRESHOLD
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation import kalman
from uwtrack_cli.estimation.comb_test import CombRule
from uwtrack_cli.estimation.harmonics import find_combs
from uwtrack_cli.estimation.line_bank import (
    ASSOCIATION,
    CONFIRMED,
    LAG_FRAMES,
    STATE_ROWS,
    TENTATIVE,
    LineBank,
    Points,
)
from uwtrack_cli.stages.lines.association import Associator, Pairs, Policies
from uwtrack_cli.stages.lines.contacts import ContactSamples, group_lines
from uwtrack_cli.stages.lines.frame_peaks import FramePeaks
from uwtrack_cli.stages.lines.lasting_families import FamilyRegister
from uwtrack_cli.stages.lines.logics import HitCounter, Logic
from uwtrack_cli.stages.lines.output import LineTable
from uwtrack_cli.stages.lines.scores import ScoreKeeper

_UNKNOWN_BEARING_VARIANCE = 1e8
"""Variance in degree^2 of a bearing that was never measured."""

_GREATEST_STD = 1.5
"""Deviation of a prediction, in resolutions, beyond which a line has no identity."""


_MEMORY_WINDOWS = 4.0
"""Windows over which the errors of a smoothed line are taken as correlated."""

_LEAST_JITTER = 0.1
"""Floor of a line's deviation in the comb test, in resolutions (Choi 2014, A.4)."""


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
            else HitCounter(policies.count, frames, peaks)
        )
        self.associator = Associator(
            self.bank, policies, self.logic, self.resolution_hz
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
        # after a long gap a line could be anywhere: it has no identity left
        slots = bank.active()
        bank.release(slots[self._is_vague(slots)])
        slots = bank.active()
        bank.table[ASSOCIATION, slots] = COASTED
        is_claimed = self.associator.is_claimed(peaks)
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
            is_claimed |= self.associator.is_claimed(peaks)
        self.logic.watch(peaks.frequency[~is_claimed])
        self.frames_seen += 1
        if self.frames_seen % self.policies.feedback.every_frames == 0:
            self._classify(frame)
        self._start(peaks, is_free & ~is_claimed, crowding)

    def _associate(
        self, slots: IntArray, peaks: FramePeaks, crowding: FloatArray
    ) -> Pairs:
        return self.associator.associate(slots, peaks, crowding)

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

    def _decide(self, slots: IntArray, chosen: Pairs) -> None:
        bank = self.bank
        hit, gain = np.zeros(slots.size, dtype=bool), np.zeros(slots.size)
        hit[chosen.line] = True
        gain[chosen.line] = chosen.gain
        bank.age[slots] += 1
        patience = np.where(
            self.associator.is_recognised(slots) & (bank.stage[slots] == CONFIRMED),
            self.policies.feedback.gamma, 1.0,
        )  # fmt: skip
        is_sure, is_lost = self.logic.judge(bank, slots, hit, gain, patience)
        is_lost |= self._is_vague(slots)
        fresh = slots[is_sure & ~is_lost & (bank.stage[slots] == TENTATIVE)]
        bank.stage[fresh] = CONFIRMED
        bank.line[fresh] = bank.next_line + np.arange(fresh.size)
        bank.next_line += fresh.size
        bank.release(slots[is_lost])

    def _is_vague(self, slots: IntArray) -> BoolArray:
        """Tell which lines are known too poorly to be told from others."""
        spread = np.sqrt(self.bank.state.variance[0, slots])
        widest = self.policies.gates.frequency_hz or _GREATEST_STD * self.resolution_hz
        return np.asarray(spread > widest)

    def _merge(self) -> None:
        """End the younger of two lines that have become one."""
        bank, gates = self.bank, self.policies.gates
        near_hz = gates.merge_hz or 0.5 * self.resolution_hz
        slots = bank.active()
        # two up in a frame together, one down in every frame
        bank.doubled[slots] = np.maximum(bank.doubled[slots] - 1, 0)
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
            self._end_doubles(low[is_one], high[is_one])

    def _end_doubles(self, low: IntArray, high: IntArray) -> None:
        """End doubles: tentative ones at once, confirmed ones if they stay together.

        Two vessels' lines that cross are close for a while, and go on as two.
        """
        bank = self.bank
        younger = np.unique(_younger(bank, low, high))
        bank.doubled[younger] += 2
        is_confirmed = bank.stage[younger] == CONFIRMED
        lasting = bank.doubled[younger] >= self.policies.gates.merge_frames
        bank.release(younger[~is_confirmed | lasting])

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


def _younger(bank: LineBank, low: IntArray, high: IntArray) -> IntArray:
    """Of two lines the tentative one, or of equals the one that started later."""
    rank_low = bank.serial[low] - bank.next_serial * (bank.stage[low] == CONFIRMED)
    rank_high = bank.serial[high] - bank.next_serial * (bank.stage[high] == CONFIRMED)
    return np.where(rank_low > rank_high, low, high)
