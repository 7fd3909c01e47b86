"""The cumulative log-likelihood ratio of a line against noise.

**Method.** The peaks near a tentative line's predicted place are compared under two
statements: noise alone, and noise with the line, which is seen with some probability
and then has the amplitude of a steady line and the predicted place. The logarithm of the
ratio is added up, and Wald's inequality gives the score that noise reaches at a wanted
rate. The density of noise peaks is followed where they are, because noise is not white
everywhere. A confirmed line goes on until its score has fallen too far (Page's test).

Noise is not white everywhere: its peaks are denser beside a band edge, in a
whistle or in the frame of a click. The lasting density is averaged per resolution over
many frames and summed over the neighbourhood of each, itself left out, so that a line
that is not yet known does not stand against itself. The momentary density follows from
the number of peaks in the frame.

**Conventions.** Scores in nepers. `studies/constants/lines.py` tries other values of the constants.

The excess of noise peaks is the logarithm of the density over the nominal one, 0 or more.

**References.** Wald, "Sequential Analysis" (1947); Page (1954); Blackman & Popoli
(1999), section 6.2; Musicki, Evans & Stankovic (1994) for the ratio over all peaks in a
gate; Rice (1945) for the amplitude.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation.track_score import DISMISSED
from uwtrack_cli.estimation.window import cell_correlation
from uwtrack_cli.lines.sensitivity import (
    MINUTE_S,
    amplitude_log_ratio,
    detection_probability,
    weakest_by_score,
)
from uwtrack_cli.lines.tracker_options import ScoreLogic
from uwtrack_cli.lines.tracking.frame_peaks import Choice, FramePeaks
from uwtrack_cli.lines.tracking.track_management import NOISE_PEAKS_PER_CELL
from uwtrack_cli.lines.tracking.track_store import TrackStore

MOST_GAIN = 3.5
"""Cap on the amplitude's gain: one loud transient must not make a line."""

MOST_OWN_RATE = 0.65
"""Bound of a confirmed line's own detection rate: what a miss costs is limited."""

GATE_CELLS = 3.0
"""Resolutions in a settled line's gate, where noise peaks count as hits, too."""

RATE_FRAMES = 63
"""Frames over which a line's own hit rate is averaged."""

START_RATE = 0.02
"""Noise peaks per resolution that may start a line. Weaker ones serve lines that have
begun: a line of a minute has one as high in its first seconds, and most work is with
lines that noise has begun. With this and `DISMISSED` the tracker carries 400 lines in 2 kHz
of noise with peaks kept at 0.1, 970 with -4 and 0.09, and half of the bursts are followed
at a level 0.1 dB higher."""

SETTLED_WITHIN = 2.0
"""Fall of the score, in nepers, within which a hit still belongs to the line."""

FAINT = 3.0
"""Power of a line's usual peak over that of one beyond which it is not the line's own:
a steady line's own falls so far in 6 % of the frames at 8 dB in its cell (Rice), and
of the peaks that a line seems to have after a sharp turn most are fainter."""

HEIGHT_EXCESS = 1.225
"""Mean excess of a noise peak's interpolated power over any threshold, in noise powers:
1 in a single cell (exponential), more at the maximum of several (3e6 peaks of noise)."""

PEAKS_PER_CELL = 0.48
"""Noise peaks per resolution at threshold zero, with that excess (same peaks). A line's
peaks beyond those of noise are as many per peak of Rice's law: they displace some."""

WALD_SHARE = 0.4
"""Share of Wald's bound that noise uses, rounded up: scores pass the threshold by a step,
peaks near tentative lines start none, and gates end; but what is given up soon starts
again."""

ECHO = 3.0
"""Rise of a noise peak's chance beside the last one, in nepers per threshold and
correlation of their cells: overlapping frames share noise (measured on 1e6 peaks)."""

_SNR_STEP_DB = 0.02
_SNR_GRID_DB = np.arange(-12.0, 60.0, _SNR_STEP_DB)


class LlrScore:
    """Cumulative log-likelihood ratio with Wald's threshold."""

    uses_all_peaks = True
    is_exclusive = False

    def __init__(self, rule: ScoreLogic, frames: Frames, peaks: Peaks) -> None:
        self.rule = rule
        self.design_snr = 10.0 ** (rule.design_snr_db / 10.0)
        threshold = -np.log(peaks.kept_probability) / HEIGHT_EXCESS
        seen = detection_probability(threshold, self.design_snr)
        self.detection = PEAKS_PER_CELL * seen
        self.first_offset = -threshold - np.log(seen)
        least_power = HEIGHT_EXCESS * np.log(PEAKS_PER_CELL / START_RATE)
        self.start_snr_db = 10.0 * np.log10(least_power - 1.0)
        self.window_s = frames.window_s
        # frames closer than half a window repeat each other
        self.weight = min(1.0, frames.hop_s / (0.5 * frames.window_s))
        births_per_khz_hour = (
            1e3 * NOISE_PEAKS_PER_CELL * frames.window_s * peaks.kept_probability
            * 3600.0 / frames.hop_s
        )  # fmt: skip
        self.confirming = np.log(
            max(WALD_SHARE * births_per_khz_hour / rule.false_lines_per_khz_hour, 1.0)
        )
        self.chance_hits = -np.expm1(-GATE_CELLS * NOISE_PEAKS_PER_CELL * peaks.kept_probability)
        self.most_own = max(self.detection, MOST_OWN_RATE)
        # what frames that are closer repeat, the weight takes off
        shared = cell_correlation(0.0, max(frames.hop_s / frames.window_s, 0.5))
        self.echo = ECHO * shared * threshold * HEIGHT_EXCESS
        self.least_gain = float(np.log1p(-self.detection))
        self.gains = self._amplitude_gain(_SNR_GRID_DB)
        self.clutter = ClutterDensity(frames, peaks)
        self.false_lines_per_khz_hour = rule.false_lines_per_khz_hour
        self.weakest_line_snr_db = weakest_by_score(
            self._amplitude_gain, threshold * HEIGHT_EXCESS, self.detection,
            self.confirming / self.weight, MINUTE_S / frames.hop_s,
        )  # fmt: skip

    def heights(self, peaks: FramePeaks) -> FloatArray:
        """Amplitude's log-likelihood ratio, less the excess of the clutter density."""
        # the grid is even and fine: a look at the nearest value is enough
        place = peaks.snr_db * (1.0 / _SNR_STEP_DB)
        place += 0.5 - _SNR_GRID_DB[0] / _SNR_STEP_DB
        cell = np.minimum(np.maximum(place, 0.0), _SNR_GRID_DB.size - 1).astype(np.intp)
        height: FloatArray = self.gains[cell]
        height -= self.clutter.excess(peaks.frequency_hz)
        return height

    def weigh(
        self,
        store: TrackStore,
        slots: IntArray,
        distance: FloatArray,
        variance: FloatArray,
        line: IntArray,
        height: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Log-likelihood ratio of "this line's peak" against "noise".

        Agreeing bearings give no credit: a vessel's broadband noise comes from one
        bearing, too.
        """
        place = -0.5 * np.log(2.0 * np.pi * self.window_s**2 * variance)
        place -= self.echo * store.history[slots]
        gain = height + place[line] - 0.5 * distance
        return -gain, gain

    def judge(
        self, store: TrackStore, slots: IntArray, chosen: Choice, patience: FloatArray
    ) -> tuple[BoolArray, BoolArray]:
        """Add the frame's evidence and compare with Wald's bounds."""
        n_confirmed = store.confirmed.size
        is_hit = np.zeros(slots.size, dtype=bool)
        is_hit[chosen.line] = True
        rate = store.hit_rate[slots]
        ratio = np.zeros(slots.size)
        ratio[n_confirmed:] = chosen.evidence
        ratio[n_confirmed:] += 1.0 - self.detection
        if n_confirmed:
            n_chosen = int(chosen.line.searchsorted(n_confirmed))
            ratio[chosen.line[:n_chosen]] = np.exp(chosen.gain[:n_chosen])
            # a line that nearly always has a peak is missed sooner
            own = (rate[:n_confirmed] - self.chance_hits) / (1.0 - self.chance_hits)
            seen = np.minimum(np.maximum(own, self.detection), self.most_own)
            ratio[:n_confirmed] *= seen / self.detection
            ratio[:n_confirmed] += 1.0 - seen
        change = np.log(ratio)
        store.history[slots] = is_hit
        n_averaged = np.minimum(store.age[slots], RATE_FRAMES)
        store.hit_rate[slots] = rate + (is_hit - rate) / n_averaged
        score = store.score[slots] + self.weight * change
        best = np.maximum(store.best_score[slots], score)
        store.score[slots], store.best_score[slots] = score, best
        # noise may have begun a line that was found later (Page 1954)
        is_least = score < store.least_score[slots]
        low = slots[is_least]
        store.least_score[low], store.risen[low] = score[is_least], store.rows + 1
        # where the evidence was greatest is where the line ended, if it did
        is_own = is_hit & (score >= best - SETTLED_WITHIN)
        # and a loud line is not heard by peaks that are noise's
        is_own &= store.faintness[slots] < FAINT
        store.settled[slots[is_own]] = store.rows
        is_confirmed = score >= self.confirming
        is_lost = best - score > self.rule.patience * patience
        # Wald's other bound: what is this unlikely is not worth waiting for
        is_lost[n_confirmed:] |= score[n_confirmed:] < DISMISSED
        return is_confirmed, is_lost

    def first_score(self, height: FloatArray) -> FloatArray:
        """Amplitude alone, among the peaks that are kept."""
        score: FloatArray = self.weight * (height + self.first_offset)
        return score

    def may_start(self, peaks: FramePeaks) -> BoolArray:
        """Tell peaks that noise does not have in every corner."""
        return np.asarray(peaks.snr_db > self.start_snr_db)

    def is_likely(self, store: TrackStore, slots: IntArray) -> BoolArray:
        """Tell lines that are half way to their confirmation, or confirmed."""
        return np.asarray(store.score[slots] >= 0.5 * self.confirming)

    def watch(self, peaks: FramePeaks, is_claimed: BoolArray) -> None:
        """Follow the density of the peaks that no line claims."""
        self.clutter.watch(peaks.frequency_hz[~is_claimed], peaks.frequency_hz.size)

    def _amplitude_gain(self, snr_db: FloatArray) -> FloatArray:
        power_ratio = (1.0 + 10.0 ** (snr_db / 10.0)) / HEIGHT_EXCESS
        ratio = amplitude_log_ratio(power_ratio, self.design_snr)
        return np.minimum(ratio, MOST_GAIN)


NEAR_CELLS = 16
"""Resolutions to either side that make a neighbourhood."""

OWN_CELLS = 2
"""Resolutions to either side that may be a line's own."""

AVERAGED_FRAMES = 128
"""Frames over which the lasting density is averaged."""

PRIOR_FRAMES = 24
"""Frames that the nominal density is worth at the start."""

MOMENT_FRAMES = 16
"""Frames over which the usual number of free peaks in a frame is averaged."""

RENEWAL_FRAMES = 8
"""Frames from one renewal of the lasting density to the next."""


class ClutterDensity:
    """Follows the density of the peaks that belong to no line."""

    def __init__(self, frames: Frames, peaks: Peaks) -> None:
        self.lowest_hz = peaks.lowest_hz
        self.per_hz = frames.window_s
        n_cells = int((peaks.highest_hz - peaks.lowest_hz) * frames.window_s) + 1
        self.nominal = NOISE_PEAKS_PER_CELL * peaks.kept_probability
        self.density = np.full(n_cells, self.nominal)
        self.lasting = np.zeros(n_cells)
        self.fresh: list[FloatArray] = []
        self.watched = 0
        self.usual = 0.0
        self.n_claimed = 0

    def excess(self, frequency_hz: FloatArray) -> FloatArray:
        """Return how much denser noise peaks are than nominal at some frequencies."""
        count = float(frequency_hz.size - self.n_claimed)
        usual = max(self.usual if self.usual > 0.0 else count, 1.0)
        surplus = count - usual
        sudden = float(np.log1p(surplus / usual)) if surplus > 3.0 * usual**0.5 else 0.0
        return self.lasting[self._cells(frequency_hz)] + sudden

    def watch(self, frequency_hz: FloatArray, n_peaks: int) -> None:
        """Take note of a frame's free peaks, out of all its peaks."""
        count = frequency_hz.size
        self.n_claimed = n_peaks - count
        if self.usual == 0.0:
            self.usual = float(count)
        self.usual += (count - self.usual) / MOMENT_FRAMES
        self.fresh.append(frequency_hz)
        if len(self.fresh) == RENEWAL_FRAMES:
            self._renew()

    def _renew(self) -> None:
        cells = self._cells(np.concatenate(self.fresh))
        self.fresh.clear()
        self.watched += RENEWAL_FRAMES
        n_averaged = min(PRIOR_FRAMES + self.watched, AVERAGED_FRAMES)
        counts = np.bincount(cells, minlength=self.density.size)
        self.density += (counts - RENEWAL_FRAMES * self.density) / n_averaged
        total = np.append(0.0, np.cumsum(self.density))
        wide, n_wide = _window_sum(total, NEAR_CELLS)
        own, n_own = _window_sum(total, OWN_CELLS)
        n_around = np.maximum(n_wide - n_own, 1)
        around = (wide - own) / n_around
        # less what chance adds to the density of so few peaks
        around -= np.sqrt(np.maximum(around, self.nominal) / (n_around * n_averaged))
        self.lasting = np.log(np.maximum(around / self.nominal, 1.0))

    def _cells(self, frequency_hz: FloatArray) -> IntArray:
        cell = ((frequency_hz - self.lowest_hz) * self.per_hz).astype(np.int64)
        return np.minimum(np.maximum(cell, 0), self.density.size - 1)


def _window_sum(total: FloatArray, half: int) -> tuple[FloatArray, IntArray]:
    """Sum and number of the cells within ``half`` of each, from the running sum."""
    cell = np.arange(total.size - 1)
    low = np.maximum(cell - half, 0)
    high = np.minimum(cell + half + 1, cell.size)
    return total[high] - total[low], high - low
