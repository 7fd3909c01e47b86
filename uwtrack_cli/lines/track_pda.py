"""Peaks to tracked frequency lines, with probabilistic association.

**Method.** The line tracker starts and confirms lines as `track` does, so that noise
starts as many. Once confirmed, a line weighs all the peaks in its gate instead of taking
one, above a detection threshold that is chosen for every line and frame for the least
expected variance given the predicted one, and is corrected by their mean.

**Conventions.** As in `uwtrack_cli.lines.track`. The threshold can only be lowered to the
weakest peaks that `peaks` has kept. Frequency and bearing stay two filters: the
covariance that the mixture puts between them is not kept.

**References.** Choi, Kim and Hong (2001) as corrected; Gelfand, Fortmann and Bar-Shalom
(1996); Choi (2014) for the tracker itself.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import AtLeast, AtMost, Below, Unit, checked
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.errors import OptionError
from uwtrack_cli.estimation import kalman
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.detection_threshold import prior_rule
from uwtrack_cli.estimation.information_reduction import gate_probability
from uwtrack_cli.estimation.operating_curve import OperatingCurve, model_curve
from uwtrack_cli.lines.followed_lines import FollowedLines
from uwtrack_cli.lines.tracker_options import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    ProcessNoise,
    ScoreLogic,
    TrackerOptions,
)
from uwtrack_cli.lines.tracking.association import Pairs
from uwtrack_cli.lines.tracking.frame_peaks import Choice, FramePeaks
from uwtrack_cli.lines.tracking.track_management import NOISE_PEAKS_PER_CELL
from uwtrack_cli.lines.tracking.track_store import CONFIRMED
from uwtrack_cli.lines.tracking.tracker import LineTracker, peaks_of

_SCORE, _GATES, _MOTION, _HARMONICS = ScoreLogic(), Gates(), ProcessNoise(), Harmonics()

_TURN_DEG = 360.0
_ALL_BEARINGS_STD_DEG = 60.0
"""Deviation of a predicted bearing beyond which bearings tell peaks apart no more."""


@checked
def track_lines_pda(
    blocks: Iterator[Families | Peaks],
    *,
    snr_db: Annotated[float, Unit("dB"), AtLeast(-30), AtMost(60)] = 3.0,
    lowest_false_alarm: Annotated[float, AtLeast(1e-12), Below(1)] = 1e-6,
    score: ScoreLogic = _SCORE,
    gates: Gates = _GATES,
    motion: ProcessNoise = _MOTION,
    harmonics: Harmonics = _HARMONICS,
) -> Iterator[Lines]:
    """Track frequency lines by probabilistic data association.

    An alternative to `track` for lines in clutter. A line takes the weighted mean of
    all peaks that may belong to it, and its standard deviation includes the uncertainty
    of the association.

    Parameters
    ----------
    blocks
        Peaks, or families that carry their peaks, block by block.
    snr_db
        Power over noise, in its cell, of the lines to be held, in dB.
    lowest_false_alarm
        Least false alarm probability per cell that the threshold may be raised to; below
        that of the peaks kept.
    score
        Options of the score that starts and ends lines.
    gates
        Where a line looks for its next peaks, and when two lines are one.
    motion
        How fast frequencies and bearings may change.
    harmonics
        What a harmonic family looks like.

    Yields
    ------
    Lines
        One block per input block with the points that are final, then the rest with
        the table of lines.

    Raises
    ------
    DataError
        The families do not carry their peaks.
    OptionError
        An option is out of range.

    Notes
    -----
    Lines start as in `track`, so that noise starts as many. A point is an association
    where one peak has at least half of the probability.
    """
    options = TrackerOptions(
        "score", score, CountLogic(), Feedback(classifier="none"), gates, motion, harmonics
    )

    def make_tracker(first: Families | Peaks) -> PdaLineTracker:
        _check(lowest_false_alarm, peaks_of(first))
        return PdaLineTracker(options, first, snr_db=snr_db, lowest_false_alarm=lowest_false_alarm)

    return FollowedLines(blocks, make_tracker)


def _check(lowest_false_alarm: float, peaks: Peaks) -> None:
    if lowest_false_alarm >= peaks.kept_probability:
        raise OptionError(
            "lowest_false_alarm must be below the probability of the peaks kept "
            f"({peaks.kept_probability:g}), got {lowest_false_alarm}."
        )


@dataclass(frozen=True)
class Mixture:
    """The peaks in reach of the confirmed lines; arrays of shape (pair,)."""

    slot: IntArray
    """Slot of the line."""
    peak: IntArray
    """Position of the peak in the frame."""
    weight: FloatArray
    """Probability that the peak is the line's."""


class PdaLineTracker(LineTracker):
    """A line tracker whose confirmed lines weigh all peaks in their gates."""

    def __init__(
        self,
        options: TrackerOptions,
        first: Families | Peaks,
        *,
        snr_db: float,
        lowest_false_alarm: float,
    ) -> None:
        super().__init__(options, first)
        peaks = peaks_of(first)
        self.cells_per_hz = NOISE_PEAKS_PER_CELL * peaks.frames.window_s
        self.curve: OperatingCurve = model_curve("steady", 10.0 ** (snr_db / 10.0))
        limits = (lowest_false_alarm, peaks.kept_probability)
        sigmas = options.gates.sigmas
        self.rules = tuple(prior_rule(self.curve, limits, dimension=m, gate=sigmas) for m in (1, 2))
        self.inside = tuple(gate_probability(sigmas, m) for m in (1, 2))
        self.mixture = Mixture(*(np.empty(0, dtype=np.int64),) * 2, np.empty(0))

    def _associate(self, slots: IntArray, peaks: FramePeaks, height: FloatArray) -> Choice:
        n_confirmed = self.store.confirmed.size
        pairs = self.associator.pairs(slots, np.zeros(slots.size, bool), peaks, height)
        middle = int(np.searchsorted(pairs.line, n_confirmed))
        near = pairs.take(slice(middle))
        weight, gain, allowed = self._weigh(slots, near, peaks)
        self.mixture = Mixture(slots[near.line[allowed]], near.peak[allowed], weight[allowed])
        # The likeliest peak stands for the line in the raw measurements.
        first = np.flatnonzero(weight > 0.5)
        chosen = near.take(first)
        chosen.gain = gain[first]
        return self.associator.choice(chosen, pairs.take(slice(middle, None)), slots, height)

    def _weigh(
        self, slots: IntArray, pairs: Pairs, peaks: FramePeaks
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return probability and gain of each pair, and which of them take part."""
        state, count = self.store.state, slots.size
        spread = state.variance[:, slots]
        has_turn = np.sqrt(spread[1]) < _ALL_BEARINGS_STD_DEG
        false_alarm, detection = self._operate(slots, spread, has_turn, peaks)
        off = peaks.frequency_hz[pairs.peak] - state.position[0, slots[pairs.line]]
        noise = self.store.frequency_noise_hz2(slots)
        total = spread[0, pairs.line] + noise[pairs.line]
        log_density = -0.5 * (off**2 / total + np.log(2.0 * math.pi * total))
        turn = wrap_deg(peaks.bearing_deg[pairs.peak] - state.position[1, slots[pairs.line]])
        turn_total = spread[1, pairs.line] + peaks.bearing_variance_deg2[pairs.peak]
        has_both = has_turn[pairs.line] & np.isfinite(turn) & np.isfinite(turn_total)
        turn_total = np.where(has_both, turn_total, 1.0)
        turned = np.where(has_both, turn, 0.0) ** 2 / turn_total
        bearing = -0.5 * (turned + np.log(2.0 * math.pi * turn_total))
        log_density += np.where(has_both, bearing + math.log(_TURN_DEG), 0.0)
        ratio = np.exp(log_density) / self.cells_per_hz
        cell = 1.0 + 10.0 ** (peaks.snr_db[pairs.peak] / 10.0)
        allowed = np.sqrt(2.0 * cell) >= self.curve.threshold(false_alarm)[pairs.line]
        strength = np.where(allowed, ratio * (detection / false_alarm)[pairs.line], 0.0)
        inside = np.where(has_turn, self.inside[1], self.inside[0])
        missed = 1.0 - detection * inside
        evidence = missed + np.bincount(pairs.line, strength, minlength=count)
        gain = np.log(np.maximum(evidence, np.finfo(float).tiny))
        return strength / evidence[pairs.line], gain[pairs.line], allowed

    def _operate(
        self, slots: IntArray, spread: FloatArray, has_turn: BoolArray, peaks: FramePeaks
    ) -> tuple[FloatArray, FloatArray]:
        """Choose the operating point of every line from its predicted variance."""
        noise = self.store.frequency_noise_hz2(slots)
        known = peaks.bearing_variance_deg2[np.isfinite(peaks.bearing_variance_deg2)]
        turn_noise = np.median(known) if known.size else np.inf
        sigmas = self.options.gates.sigmas
        width = np.sqrt(spread[0] + noise) * self.cells_per_hz
        line_cells = 2.0 * sigmas * width
        share = np.sqrt(np.minimum(spread[1] + turn_noise, _TURN_DEG**2)) / _TURN_DEG
        plane_cells = math.pi * sigmas**2 * width * share
        false_alarm = np.where(has_turn, self.rules[1](plane_cells), self.rules[0](line_cells))
        return false_alarm, self.curve.detection(false_alarm)

    def _update(self, slots: IntArray, chosen: Choice, peaks: FramePeaks) -> None:
        store = self.store
        is_confirmed = store.stage[slots[chosen.line]] == CONFIRMED
        super()._update(slots, chosen.take(~is_confirmed), peaks)
        own, peak = slots[chosen.line[is_confirmed]], chosen.peak[is_confirmed]
        off = peaks.frequency_hz[peak] - store.frequency_hz[own]
        total = store.frequency_variance_hz2[own] + store.frequency_noise_hz2(own)
        self._correct(self.mixture, peaks)
        likely = 1.0 / (1.0 + np.exp(-chosen.gain[is_confirmed]))
        self._adapt(own, off / np.sqrt(total), likely)
        self._note_peaks(own, peak, peaks)

    def _correct(self, mixture: Mixture, peaks: FramePeaks) -> None:
        """Correct the confirmed lines by the mean over their peaks."""
        state = self.store.state
        slot, peak, weight = mixture.slot, mixture.peak, mixture.weight
        turn = wrap_deg(peaks.bearing_deg[peak] - state.position[1, slot])
        residual = np.stack([
            peaks.frequency_hz[peak] - state.position[0, slot],
            np.where(np.isnan(turn), 0.0, turn),
        ])  # fmt: skip
        noise = np.stack([self.store.frequency_noise_hz2(slot), peaks.bearing_variance_deg2[peak]])
        total = state.variance[:, slot] + noise
        gain = state.variance[:, slot] / total
        rate_gain = state.covariance[:, slot] / total
        move, rate_move = gain * residual, rate_gain * residual

        def add(values: FloatArray) -> FloatArray:
            size = state.position.shape[1]
            return np.stack([np.bincount(slot, weight * row, minlength=size) for row in values])

        shift, rate_shift = add(move), add(rate_move)
        loss, rate_loss = add(gain), add(rate_gain)
        after = kalman.KalmanState(
            state.position + shift,
            state.rate + rate_shift,
            state.variance * (1.0 - loss) + add(move**2) - shift**2,
            state.covariance * (1.0 - loss) + add(move * rate_move) - shift * rate_shift,
            state.rate_variance - rate_loss * state.covariance + add(rate_move**2) - rate_shift**2,
        )
        used = np.unique(slot)
        n = self.store.n_quantities
        self.store.correct(used, kalman.KalmanState(*(entry[:n, used] for entry in after)))
        self.store.coast(used)
