"""Line tracking with probabilistic association of the confirmed lines.

**Method.** Tentative lines are assigned and confirmed as the line tracker does it, so that
noise starts as many lines. A confirmed line weighs all peaks in its gate above a threshold
of its own, which is chosen before each frame for the least expected variance given the
predicted one, and is corrected by their mean.

**Conventions.** As in `uwtrack_cli.stages.lines.tracker`. Frequency and bearing stay two
filters: the covariance that the mixture puts between them is not kept.

**References.** Gelfand, Fortmann and Bar-Shalom (1996); Choi, Kim and Hong (2001).
"""

import math
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import COASTED, DETECTED, SUB_THRESHOLD
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation import kalman
from uwtrack_cli.estimation.clutter.detection_threshold import prior_rule
from uwtrack_cli.estimation.clutter.information_reduction import gate_probability
from uwtrack_cli.estimation.clutter.operating_curve import OperatingCurve, model_curve
from uwtrack_cli.estimation.lines.line_bank import ASSOCIATION, CONFIRMED, STATE_ROWS
from uwtrack_cli.stages.lines.association import Pairs, Policies
from uwtrack_cli.stages.lines.frame_peaks import Choice, FramePeaks
from uwtrack_cli.stages.lines.logics import NOISE_PEAKS_PER_CELL
from uwtrack_cli.stages.lines.tracker import LineTracker

_TURN_DEG = 360.0
_ALL_BEARINGS_STD_DEG = 60.0
"""Deviation of a predicted bearing beyond which bearings tell peaks apart no more."""


@dataclass(frozen=True)
class Mixture:
    """The peaks in reach of the confirmed lines, with their probabilities."""

    slot: IntArray
    peak: IntArray
    weight: FloatArray


class PdaLineTracker(LineTracker):
    """A line tracker whose confirmed lines weigh all peaks in their gates."""

    def __init__(
        self,
        policies: Policies,
        frames: Frames,
        peaks: Peaks,
        *,
        snr_db: float,
        lowest_false_alarm: float,
    ) -> None:
        super().__init__(policies, frames, peaks)
        self.cells_per_hz = NOISE_PEAKS_PER_CELL * frames.window_s
        self.curve: OperatingCurve = model_curve("steady", 10.0 ** (snr_db / 10.0))
        limits = (lowest_false_alarm, peaks.kept_probability)
        sigmas = policies.gates.sigmas
        self.rules = tuple(
            prior_rule(self.curve, limits, dimension=m, gate=sigmas) for m in (1, 2)
        )
        self.inside = tuple(gate_probability(sigmas, m) for m in (1, 2))
        self.mixture = Mixture(*(np.empty(0, dtype=np.int64),) * 2, np.empty(0))

    def _associate(
        self, slots: IntArray, peaks: FramePeaks, height: FloatArray
    ) -> Choice:
        n_sure = self.bank.confirmed.size
        pairs = self.associator.pairs(slots, np.zeros(slots.size, bool), peaks, height)
        middle = int(np.searchsorted(pairs.line, n_sure))
        sure = pairs.take(slice(middle))
        weight, gain, allowed = self._weigh(slots, sure, peaks)
        self.mixture = Mixture(
            slots[sure.line[allowed]], sure.peak[allowed], weight[allowed]
        )
        # The likeliest peak stands for the line in the raw measurements.
        first = np.flatnonzero(weight > 0.5)
        chosen = sure.take(first)
        chosen.gain = gain[first]
        return self.associator.choice(
            chosen, pairs.take(slice(middle, None)), slots, height
        )

    def _weigh(
        self, slots: IntArray, pairs: Pairs, peaks: FramePeaks
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return probability and gain of each pair, and which of them take part."""
        state, count = self.bank.state, slots.size
        spread = state.variance[:, slots]
        has_turn = np.sqrt(spread[1]) < _ALL_BEARINGS_STD_DEG
        false_alarm, detection = self._operate(slots, spread, has_turn, peaks)
        off = peaks.frequency[pairs.peak] - state.position[0, slots[pairs.line]]
        noise = 1.0 / self.bank.precision[slots]
        total = spread[0, pairs.line] + noise[pairs.line]
        log_density = -0.5 * (off**2 / total + np.log(2.0 * math.pi * total))
        turn = kalman.wrap_deg(
            peaks.bearing[pairs.peak] - state.position[1, slots[pairs.line]]
        )
        turn_total = spread[1, pairs.line] + peaks.bearing_variance[pairs.peak]
        told = has_turn[pairs.line] & np.isfinite(turn) & np.isfinite(turn_total)
        turn_total = np.where(told, turn_total, 1.0)
        turned = np.where(told, turn, 0.0) ** 2 / turn_total
        bearing = -0.5 * (turned + np.log(2.0 * math.pi * turn_total))
        log_density += np.where(told, bearing + math.log(_TURN_DEG), 0.0)
        ratio = np.exp(log_density)[:] / self.cells_per_hz
        cell = 1.0 + 10.0 ** (peaks.raw[5, pairs.peak] / 10.0)
        allowed = np.sqrt(2.0 * cell) >= self.curve.threshold(false_alarm)[pairs.line]
        strength = np.where(allowed, ratio * (detection / false_alarm)[pairs.line], 0.0)
        inside = np.where(has_turn, self.inside[1], self.inside[0])
        missed = 1.0 - detection * inside
        evidence = missed + np.bincount(pairs.line, strength, minlength=count)
        gain = np.log(np.maximum(evidence, np.finfo(float).tiny))
        return strength / evidence[pairs.line], gain[pairs.line], allowed

    def _operate(
        self,
        slots: IntArray,
        spread: FloatArray,
        has_turn: BoolArray,
        peaks: FramePeaks,
    ) -> tuple[FloatArray, FloatArray]:
        """Choose the operating point of every line from its predicted variance."""
        noise = 1.0 / self.bank.precision[slots]
        known = peaks.bearing_variance[np.isfinite(peaks.bearing_variance)]
        turn_noise = np.median(known) if known.size else np.inf
        sigmas = self.policies.gates.sigmas
        width = np.sqrt(spread[0] + noise) * self.cells_per_hz
        line_cells = 2.0 * sigmas * width
        share = np.sqrt(np.minimum(spread[1] + turn_noise, _TURN_DEG**2)) / _TURN_DEG
        plane_cells = math.pi * sigmas**2 * width * share
        false_alarm = np.where(
            has_turn, self.rules[1](plane_cells), self.rules[0](line_cells)
        )
        return false_alarm, self.curve.detection(false_alarm)

    def _update(self, slots: IntArray, peak: IntArray, peaks: FramePeaks) -> None:
        is_confirmed = self.bank.stage[slots] == CONFIRMED
        super()._update(slots[~is_confirmed], peak[~is_confirmed], peaks)
        table = self.bank.table
        self._correct(self.mixture, peaks)
        sure, own = slots[is_confirmed], peak[is_confirmed]
        self._learn(sure, 1.0 / peaks.variance[own])
        table[STATE_ROWS:ASSOCIATION, sure] = peaks.raw[:, own]
        table[ASSOCIATION, sure] = np.where(
            peaks.is_detection[own], DETECTED, SUB_THRESHOLD
        )

    def _correct(self, mixture: Mixture, peaks: FramePeaks) -> None:
        """Correct the confirmed lines by the mean over their peaks."""
        table, state = self.bank.table, self.bank.state
        slot, peak, weight = mixture.slot, mixture.peak, mixture.weight
        turn = kalman.wrap_deg(peaks.bearing[peak] - state.position[1, slot])
        residual = np.stack([
            peaks.frequency[peak] - state.position[0, slot],
            np.where(np.isnan(turn), 0.0, turn),
        ])  # fmt: skip
        noise = np.stack([
            1.0 / self.bank.precision[slot], peaks.bearing_variance[peak]
        ])  # fmt: skip
        total = state.variance[:, slot] + noise
        gain = state.variance[:, slot] / total
        rate_gain = state.covariance[:, slot] / total
        move, rate_move = gain * residual, rate_gain * residual

        def add(values: FloatArray) -> FloatArray:
            size = table.shape[1]
            return np.stack([
                np.bincount(slot, weight * row, minlength=size) for row in values
            ])  # fmt: skip

        shift, rate_shift = add(move), add(rate_move)
        learnt, rate_learnt = add(gain), add(rate_gain)
        after = kalman.State(
            state.position + shift,
            state.rate + rate_shift,
            state.variance * (1.0 - learnt) + add(move**2) - shift**2,
            state.covariance * (1.0 - learnt) + add(move * rate_move)
            - shift * rate_shift,
            state.rate_variance - rate_learnt * state.covariance
            + add(rate_move**2) - rate_shift**2,
        )  # fmt: skip
        used = np.unique(slot)
        table[:STATE_ROWS, used] = np.concatenate(after)[:, used]
        table[ASSOCIATION, used] = COASTED
