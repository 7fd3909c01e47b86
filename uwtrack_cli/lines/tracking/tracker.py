"""One frame of line tracking: predict, associate, update, decide, start lines.

**Method.** The normative order of a frame: all lines are predicted; confirmed lines
choose among the peaks in their gates, then tentative ones among the rest; filters
are updated; lines are confirmed, ended and merged; families are sought among the
confirmed lines; free peaks start new lines. A frame without valid samples is missing
time: states are carried across it and nothing is counted. `FollowedLines` feeds a tracker
frame by frame and passes on the points that have become final.

The innovations of a filter whose noises are right are white and have the
variance that it expects. A process noise that is too small leaves them correlated from
one frame to the next, one that is too large turns the correlation around; so its
logarithm follows the product of neighbouring innovations. What is left of a variance
that is too large, and not correlated, is the width of the line: a real machine's ridge
scatters by more than its height promises. Each peak counts by the probability that it
is the line's own.

The test of combs costs more than all else when there are many lines, and most
machines run steadily: as long as the same lines are where they were, to a small part of
the width of a tooth, what was found last still holds.

**Conventions.** Every decision depends on the frames alone, never on how they were
cut into blocks.

Innovations are in standard deviations. The process noise stays between a share
of the machine's own drift and that of a vessel nearby; a line begins with the drift of
its machine alone. `studies/constants/lines.py` tries other gains.

**References.** Choi (2014); Blackman & Popoli (1999), section 6.2; Mehra (1970), IEEE Trans. Automatic Control 15, 175-184 (correlation of
the innovations); Myers & Tapley (1976), IEEE Trans. Automatic Control 21, 520-523
(variance of the measurements).
"""

from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation import kalman
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.lines.contacts import ContactSamples, line_table
from uwtrack_cli.lines.families.comb_test import CombRule
from uwtrack_cli.lines.families.harmonics import Comb, find_combs
from uwtrack_cli.lines.families.lasting_families import FamilyRegister
from uwtrack_cli.lines.line_points import LinePoints, LineTable
from uwtrack_cli.lines.tracker_options import ProcessNoise, TrackerOptions
from uwtrack_cli.lines.tracking.association import Associator
from uwtrack_cli.lines.tracking.frame_peaks import Choice, FramePeaks, split_frames
from uwtrack_cli.lines.tracking.line_continuation import LineContinuation
from uwtrack_cli.lines.tracking.llr_score import LlrScore
from uwtrack_cli.lines.tracking.track_management import MERGE_EVERY, HitCounter, merge_lines
from uwtrack_cli.lines.tracking.track_store import LAG_FRAMES, UNKNOWN_BEARING_VARIANCE, TrackStore

_GREATEST_STD = 1.5
"""Deviation of a prediction, in resolutions, beyond which a line has no identity."""

_USUAL_HITS = 6.0
"""Hits that the usual precision of a peak is worth at the start of a line."""

_MOST_HITS = 32.0
"""Hits over which the precision of a line's peaks is averaged."""

LOUD_RATE, WEAK_RATE = 4.0, 0.5
"""Deviation of the rate of a line that begins with a peak above the threshold, and with
a weaker one, over the usual: a resolution per step, and an eighth. With the usual one
for both, no line of 2 bins a frame is followed, and half of the bursts 0.2 dB later."""

TURN_RISE, TURN_FALL, GREATEST_TURN_DEG2PS3 = 8.0, 0.8, 1e3
"""Factors by which the noise of a bearing grows with a peak beyond its gate and falls with
one inside, and its bound: a vessel that passes within two seconds turns by 30 degrees a
second. Chosen: the passage in `tests/lines/test_track_lines.py` is followed with 3 to 20
and 0.7 to 0.9, too."""

_JUMPS_EVERY = 8
"""Frames from one search for lines that have jumped to the next."""

_MERGED_STD = 0.5
"""Deviation of such a peak from either line, in resolutions."""

_MANY_LINES = 50
"""Lines beyond which families are sought less often, by the square of their number: the
pairs that are tested grow with it."""

_LEAST_JITTER = 0.1
"""Floor of a line's deviation in the comb test, in resolutions."""


class LineTracker:
    """Carries the lines from frame to frame."""

    def __init__(self, options: TrackerOptions, first: Families | Peaks) -> None:
        peaks = peaks_of(first)
        frames = peaks.frames
        self.options = options
        self.store = TrackStore()
        self.resolution_hz = 1.0 / frames.window_s
        self.band_hz = peaks.highest_hz - peaks.lowest_hz
        self.logic: LlrScore | HitCounter = (
            LlrScore(options.score, frames, peaks)
            if options.initiation == "score"
            else HitCounter(options.count, frames, peaks)
        )
        self.associator = Associator(self.store, options, self.logic, self.resolution_hz)
        self.continuation = LineContinuation(
            self.store, self.resolution_hz, self.band_hz, options.gates.silence_s,
            may_turn=options.motion.adaptation > 0.0,
        )  # fmt: skip
        self.hop_s = frames.hop_s
        self.reference = peaks.reference
        self.families = FamilyRegister()
        self.looks = LastLook()
        self.window_frames = frames.window_s / frames.hop_s
        self.samples = ContactSamples(grid_frames(self.window_frames))
        self.frames_seen = 0
        self.look_frames = self.frames_to_look = options.feedback.every_frames
        self.last_time_s: float | None = None
        self.last_heading_deg: float | None = None
        self.is_after_gap = False
        self.usual_precision = 0.0

    def turn(self, heading_deg: float) -> None:
        """Note where a line array points whose bearings are written for one side.

        When it turns, bearings on that side stay, and those of vessels on the other
        swing by twice the turn: lines keep their identity on either. (A turn is the
        whole one since bearings were given last: a bent array has none.)
        """
        if np.isnan(heading_deg):
            return
        if self.last_heading_deg is not None:
            turned = float(wrap_deg(heading_deg - self.last_heading_deg))
            self.store.loosen_bearings(2.0 * turned)
        self.last_heading_deg = heading_deg

    def step(self, frame: int, time_s: float, valid_fraction: float, peaks: FramePeaks) -> None:
        """Advance all lines by one frame."""
        store = self.store
        step_s = 0.0 if self.last_time_s is None else time_s - self.last_time_s
        self.last_time_s = time_s
        store.advance(step_s)
        if valid_fraction > 0.0:
            if self.is_after_gap or step_s > 1.5 * self.hop_s:
                # after a long gap a line could be anywhere: it has no identity left
                slots = store.active()
                store.release(slots[self._is_vague(slots)])
            if peaks.has_bearings and store.n_quantities == 1:
                store.track_bearings()
            self._observe(peaks, frame, time_s)
        self.is_after_gap = valid_fraction <= 0.0
        store.keep_frame(frame, time_s, step_s)

    def push(self, block: Families | Peaks) -> tuple[Frames, LinePoints]:
        """Take a block; return its frames and the points that have become final."""
        peaks = peaks_of(block)
        frames, parts = peaks.frames, []
        for index, frame_peaks in enumerate(split_frames(block, peaks)):
            if frames.array_heading_deg is not None:
                self.turn(float(frames.array_heading_deg[index]))
            self.step(
                frames.first_frame + index,
                float(frames.time_s[index]),
                float(frames.valid_fraction[index]),
                frame_peaks,
            )
            if self.store.is_chunk_full:
                parts.append(self.emit())
        return frames, LinePoints.join(parts)

    def emit(self) -> LinePoints:
        """Return the points that have become final."""
        return self._emit(LAG_FRAMES)

    def finish(self) -> LinePoints:
        """End all lines and return the points still held."""
        self.store.release(self.store.active())
        return self._emit(0)

    def _emit(self, lag: int) -> LinePoints:
        points = self.store.emit(lag)
        self.samples.add(points)
        return points

    def line_table(self) -> LineTable:
        """Return what is known of the lines, at the end."""
        return self._table(self.samples)

    def pending(self, start_s: float) -> LinePoints:
        """Return the points since a time, s, as `finish` would; change nothing."""
        return self.store.pending(start_s)

    def table_of(self, points: LinePoints) -> LineTable:
        """Return what is known of the lines of some points alone, by line and time."""
        samples = ContactSamples(grid_frames(self.window_frames))
        samples.add(points)
        return self._table(samples)

    def _table(self, held: ContactSamples) -> LineTable:
        return line_table(
            held, self.families, self.continuation.jumps.told,
            window_frames=self.window_frames, resolution_hz=self.resolution_hz,
        )  # fmt: skip

    def scalars(self) -> dict[str, Any]:
        """Return what the run could have found."""
        return {
            "reference": self.reference,
            "false_lines_per_khz_hour": self.logic.false_lines_per_khz_hour,
            "weakest_line_snr_db": self.logic.weakest_line_snr_db,
        }

    def _observe(self, peaks: FramePeaks, frame: int, time_s: float) -> None:
        store = self.store
        slots = store.active()
        store.coast()
        height = self.logic.heights(peaks)
        is_used = np.zeros(peaks.frequency_hz.size, dtype=bool)
        is_likely = is_used
        if slots.size:
            chosen = self._associate(slots, peaks, height)
            self._update(slots, chosen, peaks)
            is_used[chosen.peak] = True
            likely = self.logic.is_likely(store, slots[chosen.line])
            is_likely = np.zeros_like(is_used)
            is_likely[chosen.peak[likely]] = True
            self._decide(slots, chosen, time_s)
            if self.frames_seen % MERGE_EVERY == 0:
                merge_lines(store, self.options.gates, self.resolution_hz)
        is_claimed = self.associator.is_claimed(peaks) | is_likely
        self.logic.watch(peaks, is_claimed)
        self.frames_seen += 1
        self.frames_to_look -= 1
        if self.frames_to_look == 0:
            self._classify(frame)
            self.frames_to_look = self.look_frames
        if peaks.frequency_hz.size:
            self._start(peaks, ~(is_used | is_claimed), height)

    def _associate(self, slots: IntArray, peaks: FramePeaks, height: FloatArray) -> Choice:
        return self.associator.associate(slots, peaks, height)

    def _update(self, slots: IntArray, chosen: Choice, peaks: FramePeaks) -> None:
        """Correct the states of the lines that have chosen a peak."""
        store, n = self.store, self.store.n_quantities
        slots, peak = slots[chosen.line], chosen.peak
        before = store.moving_state(slots)
        innovation = np.empty((n, slots.size))
        noise = np.empty((n, slots.size))
        innovation[0] = peaks.frequency_hz[peak]
        noise[0] = store.frequency_noise_hz2(slots)
        # lines that cross keep their rates through it: a common peak belongs to neither
        is_merged = store.is_near_another(slots, self.associator.near_hz)
        noise[0, is_merged] += (_MERGED_STD * self.resolution_hz) ** 2
        if n == 2:
            innovation[1] = peaks.bearing_deg[peak]
            noise[1] = peaks.bearing_variance_deg2[peak]
        innovation -= before.position
        if n == 2:
            turn = wrap_deg(innovation[1])
            innovation[1] = np.where(np.isnan(turn), 0.0, turn)
            if self.associator.may_turn:
                total = before.variance[1] + noise[1]
                self._follow_turns(slots, innovation[1], total)
        store.correct(slots, kalman.update(before, innovation, noise))
        deviation = innovation[0] / np.sqrt(before.variance[0] + noise[0])
        probability = np.where(is_merged, 0.0, 1.0 / (1.0 + np.exp(-chosen.gain)))
        self._adapt(slots, deviation, probability)
        self._note_peaks(slots, peak, peaks)

    def _follow_turns(self, slots: IntArray, turn_deg: FloatArray, variance: FloatArray) -> None:
        """Let the noise of bearings follow peaks beyond their gates, and fall again."""
        usual, density = self.options.motion.bearing_deg2ps3, self.store.noise_density
        is_beyond = turn_deg**2 > self.options.gates.sigmas**2 * variance
        factor = np.where(is_beyond, TURN_RISE, TURN_FALL)
        raised = np.minimum(density[1, slots] * factor, GREATEST_TURN_DEG2PS3)
        density[1, slots] = np.maximum(raised, usual)

    def _adapt(self, slots: IntArray, innovation: FloatArray, probability: FloatArray) -> None:
        """Let the noises of some lines follow their innovations, in deviations."""
        motion = self.options.motion
        if motion.adaptation > 0.0:
            window_s = 1.0 / self.resolution_hz
            adapt_noise(self.store, slots, innovation, probability, motion, window_s)

    def _note_peaks(self, slots: IntArray, peak: IntArray, peaks: FramePeaks) -> None:
        """Keep the peaks of some lines, and average the precision along each line.

        The height of a weak line's single peak is its noise's: a high one is no more
        exact than a low one.
        """
        store = self.store
        store.note_peaks(slots, peaks.measured[:, peak], peaks.is_detection[peak])
        precision = 1.0 / peaks.frequency_variance_hz2[peak]
        hits, known = store.hits[slots] + 1.0, store.precision[slots]
        weight = 1.0 / np.minimum(_USUAL_HITS + hits, _MOST_HITS)
        store.hits[slots] = hits
        store.faintness[slots] = known / precision
        store.precision[slots] = known + weight * (precision - known)

    def _decide(self, slots: IntArray, chosen: Choice, time_s: float) -> None:
        """End lines, and confirm others."""
        store = self.store
        store.age[slots] += 1
        patience = np.ones(slots.size)
        n_confirmed = store.confirmed.size
        recognised = self.associator.is_recognised(slots[:n_confirmed])
        patience[:n_confirmed][recognised] = self.options.feedback.gamma
        is_confirmed, is_lost = self.logic.judge(store, slots, chosen, patience)
        is_lost |= self._is_vague(slots)
        is_fresh = is_confirmed[n_confirmed:] & ~is_lost[n_confirmed:]
        store.release(slots[is_lost])
        self.continuation.remember(time_s)
        fresh = slots[n_confirmed:][is_fresh]
        numbers = self.continuation.numbers(fresh, time_s)
        store.confirm(fresh, numbers)
        if fresh.size or self.frames_seen % _JUMPS_EVERY == 0:
            for number, older in self.continuation.jumped().items():
                self.families.rename(number, older)

    def _is_vague(self, slots: IntArray) -> BoolArray:
        """Tell which lines are known too poorly to be separated from others."""
        widest = self.options.gates.frequency_hz or _GREATEST_STD * self.resolution_hz
        return np.asarray(self.store.frequency_variance_hz2[slots] > widest**2)

    def _classify(self, frame: int) -> None:
        """Mark the confirmed lines that belong to harmonic families."""
        store, feedback = self.store, self.options.feedback
        store.hold[:] = np.maximum(store.hold - self.look_frames, 0)
        slots = store.confirmed
        crowd = max(1, slots.size // _MANY_LINES) ** 2
        self.look_frames = crowd * feedback.every_frames
        # a line that coasts has no frequency to speak of
        slots = slots[store.rows - store.settled[slots] <= feedback.hold_frames]
        if slots.size < 3:
            return
        slots = slots[np.argsort(store.frequency_hz[slots], kind="stable")]
        frequency = store.frequency_hz[slots]
        variance = np.sort(store.frequency_variance_hz2[slots])
        middle = variance[(slots.size - 1) // 2] + variance[slots.size // 2]
        sigma = float(np.sqrt(0.5 * middle))
        sigma = max(sigma, _LEAST_JITTER * self.resolution_hz)
        is_known = store.bearing_variance_deg2[slots] < 0.5 * UNKNOWN_BEARING_VARIANCE
        bearing = np.where(is_known, store.bearing_deg[slots], np.nan)
        harmonics = self.options.harmonics
        rule = CombRule(
            harmonics.spacing_hz, harmonics.teeth, sigma, harmonics.bearing_window_deg, self.band_hz
        )
        combs, score = self.looks.find_combs(
            store.line[slots], frequency, bearing, rule, feedback.chance
        )
        is_member = score < np.log10(feedback.chance)
        if feedback.classifier == "families":
            more_frames = self.look_frames - feedback.every_frames
            store.hold[slots[is_member]] = feedback.hold_frames + more_frames
        self.families.note(frame, combs, store.line[slots], frequency, sigma)

    def _start(self, peaks: FramePeaks, is_free: BoolArray, height: FloatArray) -> None:
        """Start lines from free peaks."""
        is_start = is_free & self.logic.may_start(peaks)
        if self.options.feedback.births == "families":
            is_start &= peaks.is_in_family
        at = np.flatnonzero(is_start)
        if not at.size:
            return
        motion = self.options.motion
        window_s = 1.0 / self.resolution_hz
        is_detection = peaks.is_detection[at]
        precision = 1.0 / peaks.frequency_variance_hz2[at]
        mean = float(precision.sum()) / at.size
        usual = self.usual_precision or mean
        self.usual_precision = usual + (mean - usual) / _MOST_HITS
        precision = (_USUAL_HITS * usual + precision) / (_USUAL_HITS + 1.0)
        state = kalman.KalmanState(*np.zeros((5, 2, at.size)))
        state.position[0] = peaks.frequency_hz[at]
        state.variance[0], state.variance[1] = 1.0 / precision, UNKNOWN_BEARING_VARIANCE
        if peaks.has_bearings:
            known = np.isfinite(peaks.bearing_deg[at])
            state.position[1, known] = peaks.bearing_deg[at[known]]
            state.variance[1, known] = peaks.bearing_variance_deg2[at[known]]
        state.rate_variance[0] = self._first_rate_std_hzps(is_detection) ** 2
        state.rate_variance[1] = motion.bearing_rate_degps**2
        density = np.empty((2, at.size))
        density[0] = (
            motion.own_density(window_s)
            if motion.adaptation > 0.0
            else motion.frequency_density(state.position[0], window_s)
        )
        density[1] = motion.bearing_deg2ps3
        self.store.start(
            state, density, peaks.measured[:, at], is_detection,
            self.logic.first_score(height[at]), precision,
        )  # fmt: skip

    def _first_rate_std_hzps(self, is_detection: BoolArray) -> FloatArray:
        """Return the deviations of the rates of new lines, Hz/s.

        A weak line that moves fast is not found among the peaks in a wide gate; a peak
        that noise hardly ever has can afford one.
        """
        std = self.options.motion.rate_std_hzps(1.0 / self.resolution_hz, self.hop_s)
        if self.options.motion.frequency_rate_hzps is not None:
            return np.full(is_detection.size, std)
        return np.where(is_detection, LOUD_RATE, WEAK_RATE) * std


def grid_frames(window_frames: float) -> int:
    """Return the step on which lines are compared: a window, in frames."""
    return max(1, round(window_frames))


def peaks_of(block: Families | Peaks) -> Peaks:
    """Return the peaks of a block, which families carry with them.

    Raises
    ------
    DataError
        The families do not carry their peaks.
    """
    if isinstance(block, Peaks):
        return block
    if block.peaks is None:
        raise DataError(
            "these families do not carry their peaks; give the file that "
            "'uwtrack classify' or 'uwtrack peaks' wrote."
        )
    return block.peaks


STEADY_SHARE = 1e-3
"""Least process noise of a line over the usual drift of a machine."""

RISE = 3.0
"""Gain of a correlation beyond one deviation: a line that bends must not be lost."""

GREATEST_WIDTH = 100.0
"""Greatest variance of a line's peaks over what their heights promise."""

WIDTH_SHARE = 0.25
"""Gain of the width over that of the process noise."""

FARTHEST = 4.0
"""Bound of squares and products of innovations: a stray peak must not decide."""

BOUNDED_MEAN = 0.94
"""Mean of the square of a unit Gaussian that is bounded there."""


def adapt_noise(
    store: TrackStore,
    slots: IntArray,
    innovation: FloatArray,
    probability: FloatArray,
    motion: ProcessNoise,
    window_s: float,
) -> None:
    """Let process noise and width of some lines follow their innovations.

    Parameters
    ----------
    store
        The lines.
    slots
        Lines that have a peak in this frame.
    innovation
        Their innovations of frequency in deviations, shape (line,).
    probability
        Probability that the peak is the line's own, shape (line,).
    motion
        Limits and pace of the process noise.
    window_s
        Length of the frames in s.
    """
    product = innovation * store.last_innovation[slots]
    product = np.minimum(np.maximum(product, -FARTHEST), FARTHEST)
    store.innovation[slots] = innovation
    pace = motion.adaptation * probability
    push = product + (RISE - 1.0) * np.maximum(product - 1.0, 0.0)
    own = motion.own_density(window_s)
    greatest = motion.frequency_density(store.frequency_hz[slots], window_s)
    density = store.noise_density[0, slots] * np.exp(pace * push)
    density = np.minimum(np.maximum(density, STEADY_SHARE * own), greatest)
    store.noise_density[0, slots] = density
    surplus = np.minimum(innovation**2, FARTHEST) - BOUNDED_MEAN
    surplus -= product  # a variance that is correlated is motion
    width = store.width[slots] * np.exp(WIDTH_SHARE * pace * surplus)
    store.width[slots] = np.minimum(np.maximum(width, 1.0), GREATEST_WIDTH)


MOVED = 0.2
"""Change of a frequency, in deviations, from which families are sought again: a tooth is
several deviations wide."""

SIGMA_CHANGE = 0.05
"""Relative change of the deviation from which they are sought again, too."""


class LastLook:
    """Remembers what was found when families were sought last."""

    def __init__(self) -> None:
        self.lines: IntArray | None = None
        self.frequency_hz: FloatArray = np.empty(0)
        self.sigma_hz = 0.0
        self.found: tuple[list[Comb], FloatArray] = ([], np.empty(0))

    def find_combs(
        self,
        lines: IntArray,
        frequency_hz: FloatArray,
        bearing_deg: FloatArray,
        rule: CombRule,
        greatest_chance: float,
    ) -> tuple[list[Comb], FloatArray]:
        """Find families as `harmonics.find_combs` does, or remember them.

        ``lines`` are the numbers of the lines that the frequencies and bearings are of;
        where any bearing is known, families are always sought.
        """
        if not (self._is_same(lines, frequency_hz, rule) and np.isnan(bearing_deg).all()):
            self.found = find_combs(frequency_hz, bearing_deg, rule, greatest_chance)
            self.lines, self.frequency_hz = lines, frequency_hz
            self.sigma_hz = rule.sigma_hz
        return self.found

    def _is_same(self, lines: IntArray, frequency_hz: FloatArray, rule: CombRule) -> bool:
        if self.lines is None or not np.array_equal(lines, self.lines):
            return False
        if abs(rule.sigma_hz - self.sigma_hz) > SIGMA_CHANGE * self.sigma_hz:
            return False
        moved = np.abs(frequency_hz - self.frequency_hz).max()
        return bool(moved < MOVED * self.sigma_hz)
