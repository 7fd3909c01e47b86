"""What the line tracker asks of a logic, and the logic of counted hits.

**Method.** A logic weighs candidate pairs, judges lines after each frame and tells what
it would find: the expected rate of lines in noise alone and the weakest steady line
that is found with probability one half. Counted hits: M of N in a sliding window.

**Conventions.** A hit's ``gain`` is the increment of its log-likelihood ratio, in
nepers. Rates are per kHz of band and hour.

**References.** Choi (2014).
"""

from typing import Protocol

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation.lines import initiation
from uwtrack_cli.estimation.lines.line_bank import CONFIRMED, TENTATIVE, LineBank
from uwtrack_cli.stages.lines.frame_peaks import Choice, FramePeaks
from uwtrack_cli.stages.lines.policies import CountLogic
from uwtrack_cli.stages.lines.sensitivity import (
    MINUTE_S,
    false_lines_by_count,
    weakest_by_count,
)

NOISE_PEAKS_PER_CELL = 0.9
"""Noise peaks per resolution at threshold zero, extrapolated from high ones."""


class Logic(Protocol):
    """What the tracker asks of a logic."""

    uses_all_peaks: bool
    """Whether peaks below the detection threshold serve every line."""
    is_exclusive: bool
    """Whether two tentative lines may not have the same peak."""
    least_gain: float
    """Gain below which a tentative line rather misses than takes a peak."""
    false_lines_per_khz_hour: float
    weakest_line_snr_db: float

    def heights(self, peaks: FramePeaks) -> FloatArray:
        """Tell what the height of each peak says for a line, in nepers."""
        ...

    def weigh(
        self,
        bank: LineBank,
        slots: IntArray,
        distance: FloatArray,
        variance: FloatArray,
        line: IntArray,
        height: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Cost of each pair and its log-likelihood ratio; the variance is by line."""
        ...

    def judge(
        self,
        bank: LineBank,
        slots: IntArray,
        chosen: Choice,
        patience: FloatArray,
    ) -> tuple[BoolArray, BoolArray]:
        """Tell which lines are sure and which are lost."""
        ...

    def first_score(self, height: FloatArray) -> FloatArray:
        """Score of a line that consists of one peak."""
        ...

    def is_likely(self, bank: LineBank, slots: IntArray) -> BoolArray:
        """Tell which lines are more likely lines than noise."""
        ...

    def watch(self, peaks: FramePeaks, is_claimed: BoolArray) -> None:
        """Take note of a frame's peaks that belong to no confirmed line."""
        ...


class HitCounter:
    """M of N: confirmed by hits since birth, kept by hits in a sliding window."""

    uses_all_peaks = False
    is_exclusive = True
    least_gain = -np.inf

    def __init__(self, rule: CountLogic, frames: Frames, peaks: Peaks) -> None:
        self.rule = rule
        window = (rule.start_hits, rule.start_frames)
        rate = NOISE_PEAKS_PER_CELL * frames.window_s * peaks.false_alarm_probability
        self.false_lines_per_khz_hour = false_lines_by_count(
            1e3 * rate, 1.0 / frames.window_s, *window, frames.hop_s
        )
        threshold = -np.log(peaks.false_alarm_probability)
        self.weakest_line_snr_db = weakest_by_count(
            threshold, *window, MINUTE_S / frames.hop_s
        )

    def heights(self, peaks: FramePeaks) -> FloatArray:
        """Return zeros: all hits are equal."""
        return np.zeros(peaks.frequency.size)

    def weigh(
        self,
        bank: LineBank,  # noqa: ARG002
        slots: IntArray,  # noqa: ARG002
        distance: FloatArray,
        variance: FloatArray,  # noqa: ARG002 - the score needs it
        line: IntArray,  # noqa: ARG002
        height: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Cost is the normalised distance; hits are equal."""
        return distance, height

    def judge(
        self,
        bank: LineBank,
        slots: IntArray,
        chosen: Choice,
        patience: FloatArray,
    ) -> tuple[BoolArray, BoolArray]:
        """Count the hits of each line in its window."""
        rule = self.rule
        is_hit = np.zeros(slots.size, dtype=bool)
        is_hit[chosen.line] = True
        bank.history[slots] = initiation.push_hits(bank.history[slots], is_hit)
        history, age = bank.history[slots], bank.age[slots]
        is_young = bank.stage[slots] == TENTATIVE
        window = np.ceil(patience * rule.keep_frames).astype(np.int64)
        window = np.where(is_young, rule.start_frames, window)
        hits = initiation.count_hits(
            history, np.minimum(window, initiation.LONGEST_WINDOW)
        )
        bank.settled[slots[is_hit]] = bank.rows
        is_sure = is_young & (hits >= rule.start_hits)
        cannot = hits + (rule.start_frames - age) < rule.start_hits
        is_lost = np.where(is_young, cannot, hits < rule.keep_hits)
        return is_sure, is_lost

    def first_score(self, height: FloatArray) -> FloatArray:
        """Start from nothing."""
        return height

    def is_likely(self, bank: LineBank, slots: IntArray) -> BoolArray:
        """Tell confirmed lines."""
        return np.asarray(bank.stage[slots] == CONFIRMED)

    def watch(self, peaks: FramePeaks, is_claimed: BoolArray) -> None:
        """Do nothing: counts know no density."""
