"""The logic of the cumulative score: a line against noise, weighed hit by hit.

**Method.** Each hit adds the logarithm of the likelihood ratio of its amplitude and
place, line against noise; each miss takes the logarithm of its probability away. Wald's
inequality gives the score that noise reaches at a wanted rate. The density of noise
peaks is followed where they are, because noise is not white everywhere.

**Conventions.** Scores in nepers.

**References.** Wald, "Sequential Analysis" (1947); Blackman & Popoli (1999), section
6.2; Rice (1945) for the amplitude.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation import initiation
from uwtrack_cli.estimation.line_bank import CONFIRMED, LineBank
from uwtrack_cli.stages.lines.logics import NOISE_PEAKS_PER_CELL
from uwtrack_cli.stages.lines.policies import ScoreLogic
from uwtrack_cli.stages.lines.sensitivity import MINUTE_S, weakest_by_score

MOST_GAIN = 3.5
"""Cap on the amplitude's gain: one loud transient must not make a line."""

OWN_RATE = (0.3, 0.65)
"""Bounds of a confirmed line's own hit rate: what a miss then costs is limited."""

DISMISSED = -2.5
"""Score in nepers at which a tentative line is given up."""

SETTLED_WITHIN = 2.0
"""Fall of the score, in nepers, within which a hit still belongs to the line."""

ZONE_RESOLUTIONS = 32
"""Width of the zones in which the density of noise peaks is followed."""

ZONE_MEMORY_FRAMES = 128
"""Frames over which that density is averaged."""


ZONE_PRIOR_FRAMES = 24
"""Frames that the nominal density is worth at the start."""

MOMENT_MEMORY_FRAMES = 16
"""Frames over which the usual number of free peaks in a frame is averaged."""


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
        self.lowest_hz = peaks.lowest_hz
        self.zone_hz = ZONE_RESOLUTIONS / frames.window_s
        n_zones = int((peaks.highest_hz - peaks.lowest_hz) / self.zone_hz) + 1
        self.nominal_rate = (
            ZONE_RESOLUTIONS * NOISE_PEAKS_PER_CELL * peaks.kept_probability
        )
        self.usual = 0.0
        self.watched = 0
        self.zone_rate = np.full(n_zones, self.nominal_rate)
        self.false_lines_per_khz_hour = rule.false_lines_per_khz_hour
        self.miss = self.weight * np.log1p(-self.detection)
        self.weakest_line_snr_db = weakest_by_score(
            lambda y: self._amplitude_gain(10.0 * np.log10(np.maximum(y - 1.0, 0.1))),
            self.threshold, self.miss / self.weight, self.sure,
            self.weight * MINUTE_S / frames.hop_s,
        )  # fmt: skip

    def weigh(
        self,
        distance: FloatArray,
        variance: FloatArray,
        snr_db: FloatArray,
        crowding: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Log-likelihood ratio of "this line's peak" against "noise".

        Agreeing bearings give no credit: a vessel's broadband noise comes from one
        bearing, too.
        """
        gain = (
            self._amplitude_gain(snr_db)
            - 0.5 * distance
            - 0.5 * np.log(2.0 * np.pi * variance * self.cells_per_hz**2)
            - crowding
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
        is_confirmed = bank.stage[slots] == CONFIRMED
        bank.history[slots] = initiation.push_hits(bank.history[slots], is_hit)
        miss = np.where(is_confirmed, self._own_miss(bank, slots), self.miss)
        score = bank.score[slots] + np.where(is_hit, gain, miss)
        best = np.maximum(bank.best_score[slots], score)
        bank.score[slots], bank.best_score[slots] = score, best
        # where the evidence was greatest is where the line ended, if it did
        is_own = is_hit & (score >= best - SETTLED_WITHIN)
        bank.settled[slots[is_own]] = bank.rows
        is_sure = ~is_confirmed & (score >= self.sure)
        is_lost = best - score > self.rule.patience * patience
        # Wald's other bound: what is this unlikely is not worth waiting for
        is_lost |= ~is_confirmed & (score < DISMISSED)
        return is_sure, is_lost

    def _own_miss(self, bank: LineBank, slots: IntArray) -> FloatArray:
        """Loss per missed frame: a line that is always heard is missed sooner."""
        window = np.minimum(bank.age[slots], initiation.LONGEST_WINDOW)
        hits = initiation.count_hits(bank.history[slots], window)
        low, high = max(self.detection, OWN_RATE[0]), max(self.detection, OWN_RATE[1])
        rate = np.clip(hits / np.maximum(window, 1), low, high)
        return self.weight * np.log1p(-rate)

    def first_score(self, snr_db: FloatArray, crowding: FloatArray) -> FloatArray:
        """Amplitude alone, among the peaks that are kept."""
        gain = self._amplitude_gain(snr_db) - crowding
        first: FloatArray = gain - self.threshold - np.log(self.detection)
        return self.weight * first

    def crowding(self, frequency_hz: FloatArray, is_free: BoolArray) -> FloatArray:
        """Logarithm of the density of noise peaks over its nominal value.

        Noise is not white everywhere: its peaks are denser beside a band edge, in
        a whistle or in the frame of a click. Lasting density is known per zone of
        frequency, and momentary density from the number of peaks in the frame.
        """
        count = float(is_free.sum())
        usual = max(self.usual if self.usual > 0.0 else count, 1.0)
        excess = count - usual
        is_sudden = excess > 3.0 * np.sqrt(usual)
        sudden = 1.0 + excess / usual if is_sudden else 1.0
        zone = self.zone_rate[self._zones(frequency_hz)] / self.nominal_rate
        return np.log(np.maximum(zone, 1.0) * sudden)

    def is_likely(self, bank: LineBank, slots: IntArray) -> BoolArray:
        """Tell lines that are half way to their confirmation, or confirmed."""
        is_confirmed = np.asarray(bank.stage[slots] == CONFIRMED)
        return np.asarray(is_confirmed | (bank.score[slots] >= 0.5 * self.sure))

    def watch(self, frequency_hz: FloatArray) -> None:
        """Follow the density per zone with a memory of many frames."""
        counts = np.bincount(self._zones(frequency_hz), minlength=self.zone_rate.size)
        if self.usual == 0.0:
            self.usual = float(frequency_hz.size)
        self.usual += (frequency_hz.size - self.usual) / MOMENT_MEMORY_FRAMES
        self.watched += 1
        memory = min(ZONE_PRIOR_FRAMES + self.watched, ZONE_MEMORY_FRAMES)
        self.zone_rate += (counts - self.zone_rate) / memory

    def _zones(self, frequency_hz: FloatArray) -> IntArray:
        zone = (frequency_hz - self.lowest_hz) / self.zone_hz
        return np.clip(zone.astype(np.int64), 0, self.zone_rate.size - 1)

    def _amplitude_gain(self, snr_db: FloatArray) -> FloatArray:
        power_ratio = 1.0 + 10.0 ** (snr_db / 10.0)
        ratio = initiation.amplitude_log_ratio(power_ratio, self.design_snr)
        return np.minimum(ratio, MOST_GAIN)
