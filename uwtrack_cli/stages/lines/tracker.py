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
from uwtrack_cli.estimation.lines.comb_test import CombRule
from uwtrack_cli.estimation.lines.harmonics import find_combs
from uwtrack_cli.estimation.lines.line_bank import (
    ASSOCIATION,
    LAG_FRAMES,
    N_ROWS,
    STATE_ROWS,
    LineBank,
    Points,
)
from uwtrack_cli.stages.lines.association import Associator, Policies
from uwtrack_cli.stages.lines.contacts import ContactSamples, group_lines
from uwtrack_cli.stages.lines.frame_peaks import Choice, FramePeaks
from uwtrack_cli.stages.lines.lasting_families import FamilyRegister
from uwtrack_cli.stages.lines.logics import HitCounter, Logic
from uwtrack_cli.stages.lines.merging import UNKNOWN_BEARING_VARIANCE, merge_lines
from uwtrack_cli.stages.lines.output import LineTable
from uwtrack_cli.stages.lines.scores import ScoreKeeper

_GREATEST_STD = 1.5
"""Deviation of a prediction, in resolutions, beyond which a line has no identity."""


_USUAL_HITS = 6.0
"""Hits that the usual precision of a peak is worth at the birth of a line."""

_MOST_HITS = 32.0
"""Hits over which the precision of a line's peaks is averaged."""

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
        self.is_after_gap = False
        self.usual_precision = 0.0

    def step(self, frame: int, time_s: float, effort: float, peaks: FramePeaks) -> None:
        """Advance all lines by one frame."""
        bank = self.bank
        step_s = 0.0 if self.last_time_s is None else time_s - self.last_time_s
        self.last_time_s = time_s
        bank.advance(step_s)
        if effort > 0.0:
            if self.is_after_gap or step_s > 1.5 * self.hop_s:
                # after a long gap a line could be anywhere: it has no identity left
                slots = bank.active()
                bank.release(slots[self._is_vague(slots)])
            if peaks.has_bearings and bank.n_quantities == 1:
                bank.heed_bearings()
            self._observe(peaks, frame)
        self.is_after_gap = effort <= 0.0
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
        bank.table[ASSOCIATION] = COASTED
        height = self.logic.heights(peaks)
        is_used = np.zeros(peaks.frequency.size, dtype=bool)
        is_likely = is_used
        if slots.size:
            chosen = self._associate(slots, peaks, height)
            self._update(slots[chosen.line], chosen.peak, peaks)
            is_used[chosen.peak] = True
            likely = self.logic.is_likely(bank, slots[chosen.line])
            is_likely = np.zeros_like(is_used)
            is_likely[chosen.peak[likely]] = True
            self._decide(slots, chosen)
            merge_lines(bank, self.policies.gates, self.resolution_hz)
        is_claimed = self.associator.is_claimed(peaks) | is_likely
        self.logic.watch(peaks, is_claimed)
        self.frames_seen += 1
        if self.frames_seen % self.policies.feedback.every_frames == 0:
            self._classify(frame)
        if peaks.frequency.size:
            self._start(peaks, ~(is_used | is_claimed), height)

    def _associate(
        self, slots: IntArray, peaks: FramePeaks, height: FloatArray
    ) -> Choice:
        return self.associator.associate(slots, peaks, height)

    def _update(self, slots: IntArray, peak: IntArray, peaks: FramePeaks) -> None:
        bank, n = self.bank, self.bank.n_quantities
        table = bank.table
        states = table[:STATE_ROWS].reshape(5, 2, -1)[:, :n]
        before = kalman.State(*states[:, :, slots])
        innovation = np.empty((n, slots.size))
        noise = np.empty((n, slots.size))
        innovation[0] = peaks.frequency[peak]
        noise[0] = 1.0 / bank.precision[slots]
        if n == 2:
            innovation[1] = peaks.bearing[peak]
            noise[1] = peaks.bearing_variance[peak]
        innovation -= before.position
        if n == 2:
            turn = kalman.wrap_deg(innovation[1])
            innovation[1] = np.where(np.isnan(turn), 0.0, turn)
        states[:, :, slots] = kalman.update(before, innovation, noise)
        table[STATE_ROWS:ASSOCIATION, slots] = peaks.raw[:, peak]
        table[ASSOCIATION, slots] = np.where(
            peaks.is_detection[peak], DETECTED, SUB_THRESHOLD
        )
        self._learn(slots, 1.0 / peaks.variance[peak])

    def _learn(self, slots: IntArray, precision: FloatArray) -> None:
        """Average the precision of a line's peaks, for it is the line's.

        The height of a weak line's single peak is its noise's: a high one is no more
        exact than a low one.
        """
        bank = self.bank
        hits, known = bank.hits[slots] + 1.0, bank.precision[slots]
        weight = 1.0 / np.minimum(_USUAL_HITS + hits, _MOST_HITS)
        bank.hits[slots] = hits
        bank.precision[slots] = known + weight * (precision - known)

    def _decide(self, slots: IntArray, chosen: Choice) -> None:
        bank = self.bank
        bank.age[slots] += 1
        patience = np.ones(slots.size)
        n_sure = bank.confirmed.size
        recognised = self.associator.is_recognised(slots[:n_sure])
        patience[:n_sure][recognised] = self.policies.feedback.gamma
        is_sure, is_lost = self.logic.judge(bank, slots, chosen, patience)
        is_lost |= self._is_vague(slots)
        fresh = slots[n_sure:][is_sure[n_sure:] & ~is_lost[n_sure:]]
        bank.confirm(fresh)
        bank.release(slots[is_lost])

    def _is_vague(self, slots: IntArray) -> BoolArray:
        """Tell which lines are known too poorly to be told from others."""
        widest = self.policies.gates.frequency_hz or _GREATEST_STD * self.resolution_hz
        return np.asarray(self.bank.state.variance[0, slots] > widest**2)

    def _classify(self, frame: int) -> None:
        """Mark the confirmed lines that belong to harmonic families."""
        bank, feedback = self.bank, self.policies.feedback
        bank.hold = np.maximum(bank.hold - feedback.every_frames, 0)
        slots = bank.confirmed
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
            variance[1] < 0.5 * UNKNOWN_BEARING_VARIANCE,
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

    def _start(self, peaks: FramePeaks, is_free: BoolArray, height: FloatArray) -> None:
        is_seed = is_free & (peaks.is_detection | self.logic.uses_all_peaks)
        if self.policies.feedback.births == "families":
            is_seed &= peaks.is_in_family
        seeds = np.flatnonzero(is_seed)
        if not seeds.size:
            return
        bank, motion = self.bank, self.policies.motion
        slots = bank.free_slots(seeds.size)
        window_s = 1.0 / self.resolution_hz
        precision = 1.0 / peaks.variance[seeds]
        usual = self.usual_precision or float(precision.mean())
        self.usual_precision = usual + (float(precision.mean()) - usual) / _MOST_HITS
        precision = (_USUAL_HITS * usual + precision) / (_USUAL_HITS + 1.0)
        columns = np.zeros((N_ROWS, seeds.size))
        columns[0], columns[4] = peaks.frequency[seeds], 1.0 / precision
        columns[5] = UNKNOWN_BEARING_VARIANCE
        if peaks.has_bearings:
            known = np.isfinite(peaks.bearing[seeds])
            columns[1, known] = peaks.bearing[seeds[known]]
            columns[5, known] = peaks.bearing_variance[seeds[known]]
        columns[8] = motion.rate_std_hzps(window_s, self.hop_s) ** 2
        columns[9] = motion.bearing_rate_degps**2
        columns[STATE_ROWS:ASSOCIATION] = peaks.raw[:, seeds]
        columns[ASSOCIATION] = np.where(
            peaks.is_detection[seeds], DETECTED, SUB_THRESHOLD
        )
        bank.table[:, slots] = columns
        bank.noise_density[0, slots] = motion.frequency_density(columns[0], window_s)
        bank.noise_density[1, slots] = motion.bearing_deg2ps3
        bank.start(slots, self.logic.first_score(height[seeds]), precision)
