"""The two logics of the line tracker: counted hits and cumulative score.

**Method.** Both weigh candidate pairs, judge lines after each frame and can tell what
they would find: the expected rate of lines in noise alone and the weakest steady
line that is found with probability one half.

**Conventions.** A hit's ``gain`` is the increment of its log-likelihood ratio, in
nepers. Rates are per kHz of band and hour.

**References.** Choi (2014) for M of N; Blackman & Popoli (1999), section 6.2, and
Wald (1947) for the score and its threshold.
"""

from typing import Protocol

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation import initiation
from uwtrack_cli.estimation.line_bank import CONFIRMED, TENTATIVE, LineBank
from uwtrack_cli.stages.line_policies import CountLogic, ScoreLogic

NOISE_PEAKS_PER_CELL = 1.0
"""Noise peaks per resolution at threshold zero, extrapolated from high ones."""


class Logic(Protocol):
    """What the tracker asks of a logic."""

    uses_all_peaks: bool
    false_lines_per_khz_hour: float
    weakest_line_snr_db: float

    def weigh(
        self,
        distance: FloatArray,
        variance: FloatArray,
        bearing_variance: FloatArray,
        snr_db: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Cost of each pair, and its gain of score."""
        ...

    def judge(
        self,
        bank: LineBank,
        slots: IntArray,
        is_hit: BoolArray,
        gain: FloatArray,
        patience: FloatArray,
    ) -> tuple[BoolArray, BoolArray]:
        """Tell which lines are sure and which are lost."""
        ...

    def first_score(self, snr_db: FloatArray) -> FloatArray:
        """Score of a line that consists of one peak."""
        ...


class HitCounter:
    """M of N: confirmed by hits since birth, kept by hits in a sliding window."""

    uses_all_peaks = False

    def __init__(self, rule: CountLogic) -> None:
        self.rule = rule
        self.false_lines_per_khz_hour = np.nan
        self.weakest_line_snr_db = np.nan

    def weigh(
        self,
        distance: FloatArray,
        variance: FloatArray,  # noqa: ARG002 - the score needs it
        bearing_variance: FloatArray,  # noqa: ARG002
        snr_db: FloatArray,  # noqa: ARG002
    ) -> tuple[FloatArray, FloatArray]:
        """Cost is the normalised distance; hits are equal."""
        return distance, np.zeros(distance.size)

    def judge(
        self,
        bank: LineBank,
        slots: IntArray,
        is_hit: BoolArray,
        gain: FloatArray,  # noqa: ARG002
        patience: FloatArray,
    ) -> tuple[BoolArray, BoolArray]:
        """Count the hits of each line in its window."""
        rule = self.rule
        bank.history[slots] = initiation.push_hits(bank.history[slots], is_hit)
        history, age = bank.history[slots], bank.age[slots]
        is_young = bank.stage[slots] == TENTATIVE
        window = np.ceil(patience * rule.keep_frames).astype(np.int64)
        window = np.where(is_young, rule.start_frames, window)
        hits = initiation.count_hits(
            history, np.minimum(window, initiation.LONGEST_WINDOW)
        )
        is_sure = is_young & (hits >= rule.start_hits)
        cannot = hits + (rule.start_frames - age) < rule.start_hits
        is_lost = np.where(is_young, cannot, hits < rule.keep_hits)
        return is_sure, is_lost

    def first_score(self, snr_db: FloatArray) -> FloatArray:
        """Start from nothing."""
        return np.zeros(snr_db.size)


class ScoreKeeper:
    """Cumulative log-likelihood ratio with Wald's threshold."""

    uses_all_peaks = True

    def __init__(self, rule: ScoreLogic, frames: Frames, peaks: Peaks) -> None:
        self.rule = rule
        self.design_snr = 10.0 ** (rule.design_snr_db / 10.0)
        self.threshold = -np.log(peaks.kept_probability)
        self.detection = initiation.detection_probability(
            self.threshold, self.design_snr
        )
        self.cells_per_hz = NOISE_PEAKS_PER_CELL * frames.window_s
        # frames closer than half a window repeat each other
        self.weight = min(1.0, frames.hop_s / (0.5 * frames.window_s))
        births_per_khz_hour = (
            1e3 * self.cells_per_hz * peaks.kept_probability * 3600.0 / frames.hop_s
        )
        self.sure = np.log(
            max(births_per_khz_hour / rule.false_lines_per_khz_hour, 1.0)
        )
        self.false_lines_per_khz_hour = rule.false_lines_per_khz_hour
        self.weakest_line_snr_db = np.nan
        self.miss = self.weight * np.log1p(-self.detection)

    def weigh(
        self,
        distance: FloatArray,
        variance: FloatArray,
        bearing_variance: FloatArray,
        snr_db: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Log-likelihood ratio of "this line's peak" against "noise"."""
        # a peak anywhere on the compass: density 1/360 per degree
        turn = np.minimum(bearing_variance, 360.0**2 / (2.0 * np.pi))
        spread = -0.5 * np.log(2.0 * np.pi * turn / 360.0**2)
        spread[~np.isfinite(bearing_variance)] = 0.0
        gain = (
            initiation.amplitude_log_ratio(10.0 ** (snr_db / 10.0), self.design_snr)
            - 0.5 * distance
            - 0.5 * np.log(2.0 * np.pi * variance * self.cells_per_hz**2)
            + spread
        )
        return -gain, self.weight * gain

    def judge(
        self,
        bank: LineBank,
        slots: IntArray,
        is_hit: BoolArray,
        gain: FloatArray,
        patience: FloatArray,
    ) -> tuple[BoolArray, BoolArray]:
        """Add the frame's evidence and compare with Wald's bounds."""
        score = bank.score[slots] + np.where(is_hit, gain, self.miss)
        best = np.maximum(bank.best_score[slots], score)
        bank.score[slots], bank.best_score[slots] = score, best
        is_confirmed = bank.stage[slots] == CONFIRMED
        is_sure = ~is_confirmed & (score >= self.sure)
        fall = np.where(is_confirmed, self.rule.patience * patience, 4.0)
        return is_sure, best - score > fall

    def first_score(self, snr_db: FloatArray) -> FloatArray:
        """Amplitude alone, among the peaks that are kept."""
        ratio = initiation.amplitude_log_ratio(10.0 ** (snr_db / 10.0), self.design_snr)
        return self.weight * (ratio - self.threshold - np.log(self.detection))
