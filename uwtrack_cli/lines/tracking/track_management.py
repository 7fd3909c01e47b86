"""When lines are confirmed, deleted and merged.

**Method.** A logic weighs candidate pairs, judges lines after each frame and states what
it would find: the expected rate of lines in noise alone and the weakest steady line
that is found with probability one half. Counted hits: M of N in a sliding window, the
hits of each line kept as the bits of one integer.

Lines that are nearer than half a resolution, run alike and agree in bearing are doubles.
Of two, the tentative one ends; of two tentative ones the less likely, at once; of two
confirmed ones the later, if they stay together: two vessels' lines that cross are close
for a while, and go on as two.

**Conventions.** A hit's ``gain`` is the increment of its log-likelihood ratio, in
nepers. Rates are per kHz of band and hour. The youngest frame is the lowest bit. Lines
are given by their slots in the store.

**References.** Choi (2014).
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.lines.sensitivity import MINUTE_S, false_lines_by_count, weakest_by_count
from uwtrack_cli.lines.tracker_options import LONGEST_WINDOW, CountLogic, Gates
from uwtrack_cli.lines.tracking.frame_peaks import Choice, FramePeaks
from uwtrack_cli.lines.tracking.track_store import (
    CONFIRMED,
    TENTATIVE,
    UNKNOWN_BEARING_VARIANCE,
    TrackStore,
)

MERGE_EVERY = 2
"""Frames from one search for doubles to the next."""

NOISE_PEAKS_PER_CELL = 0.9
"""Noise peaks per resolution at threshold zero, extrapolated from high ones."""


class HitCounter:
    """M of N: confirmed by hits since birth, kept by hits in a sliding window."""

    uses_all_peaks = False
    """Whether peaks below the detection threshold serve every line."""
    is_exclusive = True
    """Whether two tentative lines may not have the same peak."""
    least_gain = -np.inf
    """Gain below which a tentative line rather misses than takes a peak."""

    def __init__(self, rule: CountLogic, frames: Frames, peaks: Peaks) -> None:
        self.rule = rule
        window = (rule.start_hits, rule.start_frames)
        rate = NOISE_PEAKS_PER_CELL * frames.window_s * peaks.false_alarm_probability
        self.false_lines_per_khz_hour = false_lines_by_count(
            1e3 * rate, 1.0 / frames.window_s, *window, frames.hop_s
        )
        threshold = -np.log(peaks.false_alarm_probability)
        self.weakest_line_snr_db = weakest_by_count(threshold, *window, MINUTE_S / frames.hop_s)

    def heights(self, peaks: FramePeaks) -> FloatArray:
        """Return zeros: all hits are equal."""
        return np.zeros(peaks.frequency_hz.size)

    def weigh(
        self,
        store: TrackStore,  # noqa: ARG002
        slots: IntArray,  # noqa: ARG002
        distance: FloatArray,
        variance: FloatArray,  # noqa: ARG002 - the score needs it
        line: IntArray,  # noqa: ARG002
        height: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Cost is the normalised distance; hits are equal."""
        return distance, height

    def judge(
        self, store: TrackStore, slots: IntArray, chosen: Choice, patience: FloatArray
    ) -> tuple[BoolArray, BoolArray]:
        """Count the hits of each line in its window."""
        rule = self.rule
        is_hit = np.zeros(slots.size, dtype=bool)
        is_hit[chosen.line] = True
        store.history[slots] = push_hits(store.history[slots], is_hit)
        history, age = store.history[slots], store.age[slots]
        is_tentative = store.stage[slots] == TENTATIVE
        window = np.ceil(patience * rule.keep_frames).astype(np.int64)
        window = np.where(is_tentative, rule.start_frames, window)
        hits = count_hits(history, np.minimum(window, LONGEST_WINDOW))
        store.settled[slots[is_hit]] = store.rows
        is_confirmed = is_tentative & (hits >= rule.start_hits)
        cannot = hits + (rule.start_frames - age) < rule.start_hits
        is_lost = np.where(is_tentative, cannot, hits < rule.keep_hits)
        return is_confirmed, is_lost

    def first_score(self, height: FloatArray) -> FloatArray:
        """Start from nothing."""
        return height

    def may_start(self, peaks: FramePeaks) -> BoolArray:
        """Tell peaks above the detection threshold."""
        return peaks.is_detection

    def is_likely(self, store: TrackStore, slots: IntArray) -> BoolArray:
        """Tell confirmed lines."""
        return np.asarray(store.stage[slots] == CONFIRMED)

    def watch(self, peaks: FramePeaks, is_claimed: BoolArray) -> None:
        """Do nothing: counts know no density."""


def push_hits(history: IntArray, is_hit: BoolArray) -> IntArray:
    """Shift every history by one frame and write the newest hit or miss."""
    return (history << 1) | is_hit


def count_hits(history: IntArray, window: IntArray | int) -> IntArray:
    """Count the hits of the last ``window`` frames of every history.

    Examples
    --------
    >>> count_hits(np.array([0b10110, 0b11111]), np.array([3, 5])).tolist()
    [2, 5]
    """
    one = np.uint64(1)
    mask = (one << np.asarray(window, dtype=np.uint64)) - one
    words = np.ascontiguousarray(history.astype(np.uint64) & mask)
    bits = np.unpackbits(words.view(np.uint8)).reshape(-1, 64)
    return np.asarray(bits.sum(axis=1))


def merge_lines(store: TrackStore, gates: Gates, resolution_hz: float) -> None:
    """End the lesser of two lines that are one; due every `MERGE_EVERY` frames."""
    near_hz = gates.merge_hz or 0.5 * resolution_hz
    slots, state = store.active(), store.state
    # two up in a frame together, one down in every frame
    np.maximum(store.doubled - MERGE_EVERY, 0, out=store.doubled)
    position = state.position[0, slots]
    order = position.argsort()
    position, slots = position[order], slots[order]
    near = (position[1:] - position[:-1] < near_hz).nonzero()[0]
    if not near.size:
        return
    # the one after the next, too: two that are one may have a third between them
    after = near[:-1][near[1:] == near[:-1] + 1]
    after = after[position[after + 2] - position[after] < near_hz]
    low = slots[np.concatenate([near, after])]
    high = slots[np.concatenate([near + 1, after + 2])]
    slip = np.abs(state.rate[0, high] - state.rate[0, low])
    doubt = np.sqrt(state.rate_variance[0, high] + state.rate_variance[0, low])
    is_one = slip < gates.merge_rate_sigmas * doubt
    if store.n_quantities == 2:
        turn = wrap_deg(state.position[1, high] - state.position[1, low])
        is_one &= (np.abs(turn) < gates.merge_deg) | (
            np.maximum(state.variance[1, high], state.variance[1, low])
            > 0.5 * UNKNOWN_BEARING_VARIANCE
        )
    if is_one.any():
        _end_doubles(store, gates, low[is_one], high[is_one])


def _end_doubles(store: TrackStore, gates: Gates, low: IntArray, high: IntArray) -> None:
    weaker = _weaker(store, low, high)
    # once, though it may be the lesser of two pairs
    is_weaker = np.zeros(store.stage.size, dtype=bool)
    is_weaker[weaker] = True
    weaker = is_weaker.nonzero()[0]
    store.doubled[weaker] += 2 * MERGE_EVERY
    is_confirmed = store.stage[weaker] == CONFIRMED
    lasting = store.doubled[weaker] >= gates.merge_frames
    store.release(weaker[~is_confirmed | lasting])


def _weaker(store: TrackStore, low: IntArray, high: IntArray) -> IntArray:
    """Of two lines the tentative, the less likely or the later one, in this order."""
    rank = store.stage[low] - store.stage[high]  # CONFIRMED is above TENTATIVE
    lead = store.score[low] - store.score[high]
    # between confirmed lines, whose scores have no bound, age decides
    lead[store.stage[low] + store.stage[high] == 2 * CONFIRMED] = 0.0
    age = store.serial[high] - store.serial[low]
    lead = np.where(rank != 0, rank, np.where(lead != 0.0, lead, age))
    return np.where(lead < 0, low, high)
