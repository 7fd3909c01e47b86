"""The states of all tracked lines, their recent history, and its smoothing.

**Method.** Every line has a slot in one table, a row per quantity, so that one
operation advances all lines and one copy keeps a frame. The copies of the last
frames form a ring. Whenever a chunk of frames is full, the lines are smoothed from
the newest frame back (Rauch-Tung-Striebel, all lines at once) and the points
that lie at least one lag behind the newest frame are final: with a lag much longer
than the correlation time of the filter this is the fixed-interval smoother, in bounded
memory. Chunks are counted in frames since the start, so the blocks in which frames
arrive make no difference.

**Conventions.** The first row of a pair is frequency (Hz), the second bearing (degree,
unwrapped). A slot is free, tentative, confirmed or ended; an ended line keeps its
slot until its points are out. The rows of the table are known to this module alone.

**References.** Rauch, Tung & Striebel, AIAA J. 3(8), 1445-1450 (1965).
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import COASTED, DETECTED, SUB_THRESHOLD
from uwtrack_cli.estimation.kalman import KalmanState, advance, smooth_all
from uwtrack_cli.lines.line_points import N_MEASURED, LinePoints

FREE, TENTATIVE, CONFIRMED, ENDED = 0, 1, 2, 3
"""Values of `TrackStore.stage`."""

CHUNK_FRAMES = 256
"""Frames from one emission of points to the next."""

LAG_FRAMES = 256
"""Frames by which an emitted point lies behind the newest frame, at least."""

UNKNOWN_BEARING_VARIANCE = 1e8
"""Variance in degree^2 of a bearing that was never measured."""

_STATE_ROWS, _DENSITY_ROWS = 10, 2
_MEASURED = _STATE_ROWS + _DENSITY_ROWS
_ASSOCIATION = _MEASURED + N_MEASURED
_N_ROWS = _ASSOCIATION + 1
_N_COUNTS, _N_GAUGES = 11, 10


class TrackStore:
    """A table of lines, a slot each, with a ring of its recent copies.

    Attributes
    ----------
    state
        Predicted or filtered states of frequency and bearing; each entry has the
        shape (2, slot).
    frequency_hz, bearing_deg
        Frequency in Hz and unwrapped bearing in degree, shape (slot,).
    frequency_variance_hz2, bearing_variance_deg2
        Their variances, shape (slot,).
    measured_frequency_hz
        Frequency of the peak taken in this frame, Hz; nan without one; shape (slot,).
    association
        How the line was measured in this frame, as `Lines.association`; nan in a gap;
        shape (slot,).
    noise_density
        Spectral density of the accelerations from this frame to the next, Hz^2/s^3 and
        degree^2/s^3, shape (2, slot).
    n_quantities
        1 as long as no bearing has been measured, then 2.
    rows
        Frames kept since the start.
    next_line, next_serial
        Number of the next line to be confirmed, and of the next one to be started.
    stage
        Free, tentative, confirmed or ended, shape (slot,).
    line, serial
        Number of a confirmed line, and of any line in the order of the starts.
    history
        Hits of the last frames, owned by the logic that starts and ends lines.
    age
        Frames since the start of the line, itself counted.
    born, emitted, settled
        Row of the first frame, of the first frame whose point is not out, and of the
        last frame that belongs to the line.
    risen
        Row from which the score has risen: before it the line was as likely noise.
    doubled
        Twice the frames for which the line has been beside another, less the others.
    hold
        Frames for which the line stays recognised as a member of a family.
    score, best_score
        Log-likelihood ratio of the line in nepers, and its greatest value.
    hit_rate
        Share of frames with a peak, averaged.
    precision
        Reciprocal variance of the line's measured frequency, averaged, 1/Hz^2.
    hits
        Peaks that the line has taken.
    faintness
        Usual precision of the line's peaks over that of its last one.
    width
        Variance of the line's peaks about its course over what their heights promise.
    least_score
        Least score of the line, in nepers.
    innovation, last_innovation
        Innovation of frequency of this frame and of the one before, in deviations; 0
        without a peak.
    """

    def __init__(self, capacity: int = 1000) -> None:
        self.rows = 0
        # slots that have ever been taken: of the others no memory is touched
        self._used = 0
        self.next_line = 1
        self.next_serial = 1
        self.n_quantities = 1
        self._size = CHUNK_FRAMES + LAG_FRAMES
        self._table = np.zeros((_N_ROWS, capacity))
        self._ring = np.zeros((self._size, _N_ROWS, capacity))
        self._row_frame = np.zeros(self._size, dtype=np.int64)
        self._row_time = np.zeros(self._size)
        self._row_step = np.zeros(self._size)
        self._ended: list[IntArray] = []
        self._counts = np.zeros((_N_COUNTS, capacity), dtype=np.int64)
        self._gauges = np.zeros((_N_GAUGES, capacity))
        self._name_rows()

    def _name_rows(self) -> None:
        """Give the rows of the tables names: views of them."""
        (
            self.stage, self.line, self.serial, self.history, self.age, self.born,
            self.emitted, self.settled, self.risen, self.doubled, self.hold,
        ) = self._counts  # fmt: skip
        (
            self.score, self.best_score, self.hit_rate, self.precision, self.hits,
            self.width, self.innovation, self.last_innovation, self.faintness,
            self.least_score,
        ) = self._gauges  # fmt: skip
        t, n = self._table, self.n_quantities
        self.state = KalmanState(t[0:2], t[2:4], t[4:6], t[6:8], t[8:10])
        self.frequency_hz, self.bearing_deg = t[0], t[1]
        self.frequency_variance_hz2, self.bearing_variance_deg2 = t[4], t[5]
        self.noise_density = t[_STATE_ROWS:_MEASURED]
        self.measured_frequency_hz, self.association = t[_MEASURED], t[_ASSOCIATION]
        self._moving_rows = t[:_STATE_ROWS].reshape(5, 2, -1)[:, :n]
        self._confirmed: IntArray | None = None
        self._active: IntArray | None = None

    def track_bearings(self) -> None:
        """Let bearings move, too; until one is measured they are left alone."""
        self.n_quantities = 2
        self._name_rows()

    def advance(self, step_s: float) -> None:
        """Carry all lines over a time step, and forget their measurements."""
        used = self._used
        noise = self.noise_density[: self.n_quantities, :used]
        advance(KalmanState(*self._moving_rows[:, :, :used]), step_s, noise)
        self._table[_MEASURED:, :used] = np.nan
        self.last_innovation[:used] = self.innovation[:used]
        self.innovation[:used] = 0.0

    def loosen_bearings(self, turn_deg: float) -> None:
        """Let all bearings be off by a turn that some of them follow and some do not."""
        self.bearing_variance_deg2[:] += turn_deg**2

    def coast(self, slots: IntArray | slice = slice(None)) -> None:
        """Mark lines as not measured in this frame."""
        self.association[slots] = COASTED

    def moving_state(self, slots: IntArray) -> KalmanState:
        """Return the states of some lines, entries of shape (quantity, line)."""
        return KalmanState(*self._moving_rows[:, :, slots])

    def frequency_noise_hz2(self, slots: IntArray) -> FloatArray:
        """Return the variance of a peak of some lines about their courses, Hz^2."""
        variance: FloatArray = self.width[slots] / self.precision[slots]
        return variance

    def correct(self, slots: IntArray, state: KalmanState) -> None:
        """Replace the states of some lines by corrected ones."""
        self._moving_rows[:, :, slots] = state

    def note_peaks(self, slots: IntArray, measured: FloatArray, is_detection: BoolArray) -> None:
        """Note the peaks that lines take: `FramePeaks.measured`, and if detections."""
        self._table[_MEASURED:_ASSOCIATION, slots] = measured
        self.association[slots] = np.where(is_detection, DETECTED, SUB_THRESHOLD)

    @property
    def confirmed(self) -> IntArray:
        """Slots of the confirmed lines."""
        if self._confirmed is None:
            self._confirmed = (self.stage[: self._used] == CONFIRMED).nonzero()[0]
        return self._confirmed

    def active(self) -> IntArray:
        """Slots of the confirmed lines, then of the tentative ones."""
        if self._active is None:
            tentative = (self.stage[: self._used] == TENTATIVE).nonzero()[0]
            self._active = np.concatenate([self.confirmed, tentative])
        return self._active

    def _free_slots(self, count: int) -> IntArray:
        """Return ``count`` free slots; the table grows when there are too few."""
        # as many beyond those in use are free for certain
        while self._used + count > self.stage.size:
            self._grow()
        is_free = self.stage[: self._used + count] == FREE
        free: IntArray = is_free.nonzero()[0][:count]
        self._used = max(self._used, int(free[-1]) + 1 if count else 0)
        return free

    def _grow(self) -> None:
        """Double the slots, so that there are few copies of the ring."""
        more = self._table.shape[-1]
        for name in ("_table", "_ring", "_counts", "_gauges"):
            values = getattr(self, name)
            grown = np.zeros((*values.shape[:-1], values.shape[-1] + more), values.dtype)
            grown[..., : values.shape[-1]] = values
            setattr(self, name, grown)
        self._name_rows()

    def start(
        self,
        state: KalmanState,
        noise_density: FloatArray,
        measured: FloatArray,
        is_detection: BoolArray,
        score: FloatArray,
        precision: FloatArray,
    ) -> None:
        """Start tentative lines, a peak each.

        Entries of states and densities have the shape (2, line), the rows of
        `FramePeaks.measured` (N_MEASURED, line). Scores are in nepers, the precision is the
        reciprocal variance of a measured frequency, 1/Hz^2.
        """
        count = score.size
        slots = self._free_slots(count)
        rows = np.empty((_N_ROWS, count))
        np.concatenate([*state, noise_density, measured], out=rows[:_ASSOCIATION])
        rows[_ASSOCIATION] = np.where(is_detection, DETECTED, SUB_THRESHOLD)
        self._table[:, slots] = rows
        counts = np.zeros((_N_COUNTS, count), dtype=np.int64)
        counts[0], counts[3:5], counts[5:9] = TENTATIVE, 1, self.rows
        counts[2] = np.arange(self.next_serial, self.next_serial + count)
        self.next_serial += count
        self._counts[:, slots] = counts
        gauges = np.ones((_N_GAUGES, count))
        gauges[:2], gauges[3], gauges[6:9], gauges[9] = score, precision, 0.0, score
        self._gauges[:, slots] = gauges
        self._active = None

    def confirm(self, slots: IntArray, numbers: IntArray) -> None:
        """Confirm tentative lines by the numbers that they continue, 0 for none."""
        if slots.size:
            self.stage[slots] = CONFIRMED
            is_new = numbers == 0
            fresh = self.next_line - 1 + np.cumsum(is_new)
            self.line[slots] = np.where(is_new, fresh, numbers)
            self.next_line += int(is_new.sum())
            self._confirmed = self._active = None

    def begin_after(self, slots: IntArray, rows: IntArray) -> None:
        """Let lines begin after some rows at the earliest: others were they before."""
        self.born[slots] = np.maximum(self.born[slots], rows + 1)

    def release(self, slots: IntArray) -> None:
        """Take lines out: tentative ones are forgotten, confirmed ones have ended."""
        if slots.size:
            is_confirmed = self.stage[slots] == CONFIRMED
            self.stage[slots] = np.where(is_confirmed, ENDED, FREE)
            self._active = None
            if is_confirmed.any():
                ended = slots[is_confirmed]
                self._ended.append(np.stack([ended, self.settled[ended]]))
                self._confirmed = None

    def take_ended(self) -> IntArray:
        """Return slots and last settled rows of lines that ended since called last."""
        ended, self._ended = self._ended, []
        return np.concatenate([np.zeros((2, 0), dtype=np.int64), *ended], axis=1)

    def time_of(self, rows: IntArray) -> FloatArray:
        """Return the times in s of kept rows, counted from the start."""
        return self._row_time[self._kept(rows)]

    def recall(self, slots: IntArray, rows: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return times, states and noise densities that lines had at kept rows.

        Rows are frames counted from the start, of a shape that broadcasts with that of
        the lines. Times in s have theirs, entries of states the shape (..., 5, 2) and
        densities (..., 2).
        """
        at = self._kept(rows)
        kept = self._ring[at, :_MEASURED, slots]
        state = kept[..., :_STATE_ROWS].reshape(*kept.shape[:-1], 5, 2)
        return self._row_time[at], state, kept[..., _STATE_ROWS:]

    def _kept(self, rows: IntArray) -> IntArray:
        """Return the places in the ring of rows, or of the nearest that are kept."""
        return np.clip(rows, self.rows - self._size, self.rows - 1) % self._size

    def is_near_another(self, slots: IntArray, near_hz: float) -> BoolArray:
        """Tell which lines are confirmed, and so near, Hz, to another such line."""
        confirmed = self.confirmed
        is_near = np.zeros(self.stage.size, dtype=bool)
        if confirmed.size > 1:
            frequency = self.frequency_hz[confirmed]
            order = frequency.argsort()
            ordered = frequency[order]
            near = ordered[1:] - ordered[:-1] < near_hz
            if near.any():
                is_near[confirmed[order[1:]]] = near
                is_near[confirmed[order[:-1]]] |= near
        return np.asarray(is_near[slots])

    def state_of(self, slots: IntArray) -> KalmanState:
        """Return the present states of some lines, entries of shape (2, line)."""
        return KalmanState(*(entry[:, slots] for entry in self.state))

    def keep_frame(self, frame: int, time_s: float, step_s: float) -> None:
        """Copy the table of this frame into the ring."""
        at = self.rows % self._size
        self._ring[at, :, : self._used] = self._table[:, : self._used]
        self._row_frame[at], self._row_time[at] = frame, time_s
        self._row_step[at] = step_s
        self.rows += 1

    @property
    def is_chunk_full(self) -> bool:
        """Whether points are due."""
        return self.rows % CHUNK_FRAMES == 0

    def emit(self, lag: int) -> LinePoints:
        """Smooth and return the points at least ``lag`` frames old, by line and time.

        Points after the frame up to which a line is settled are not its points
        yet; lines that ended are returned up to there and leave the table.
        """
        slots = np.flatnonzero((self.stage == CONFIRMED) | (self.stage == ENDED))
        slots = slots[np.argsort(self.line[slots])]
        start = max(0, self.rows - self._size)
        first = np.maximum(np.maximum(self.emitted, self.born)[slots], start)
        is_over = self.stage[slots] == ENDED
        stop = np.where(is_over, self.rows, self.rows - lag)
        stop = np.minimum(stop, self.settled[slots] + 1)
        due = stop > first
        # an ended line is smoothed from its settled end, a living one from now
        end = np.where(is_over, self.settled[slots], self.rows - 1)
        points = self._smoothed_points(slots[due], first[due], stop[due], end[due])
        self.emitted[slots[due]] = stop[due]
        self.stage[slots[is_over]] = FREE
        return points

    def pending(self, start_s: float) -> LinePoints:
        """Smooth and return the points that are not out, as if all lines ended.

        From a time on, s.
        """
        slots = np.flatnonzero((self.stage == CONFIRMED) | (self.stage == ENDED))
        slots = slots[np.argsort(self.line[slots])]
        rows = np.arange(max(0, self.rows - self._size), self.rows)
        n_early = int((self._row_time[rows % self._size] < start_s).sum())
        start = self.rows - rows.size + n_early
        first = np.maximum(np.maximum(self.emitted, self.born)[slots], start)
        end = self.settled[slots]
        due = end + 1 > first
        return self._smoothed_points(slots[due], first[due], end[due] + 1, end[due])

    def _smoothed_points(
        self, slots: IntArray, first: IntArray, stop: IntArray, end: IntArray
    ) -> LinePoints:
        """Return the points of some lines, smoothed from the last row of each back."""
        low = int(first.min()) if slots.size else self.rows
        rows = np.arange(low, self.rows)
        at = rows % self._size
        copies = self._ring[np.ix_(at, np.arange(_N_ROWS), slots)]
        n = self.n_quantities
        states = copies[:, :_STATE_ROWS].reshape(rows.size, 5, 2, slots.size)
        is_inside = (rows[:, None] < end)[:, None, :]
        # rows before a line's birth hold another line's remains: never emitted
        with np.errstate(all="ignore"):
            density = copies[:-1, _STATE_ROWS:_MEASURED][:, :n]
            smooth_all(states[:, :, :n], self._row_step[at], density, is_inside)
        member, row = np.nonzero(
            (rows[None, :] >= first[:, None]) & (rows[None, :] < stop[:, None])
        )
        is_gap = np.isnan(copies[row, _ASSOCIATION, member])
        member, row = member[~is_gap], row[~is_gap]
        return LinePoints(
            line=self.line[slots][member],
            frame=self._row_frame[at][row],
            time_s=self._row_time[at][row],
            state=states[row, :, :, member],
            measured=copies[row, _MEASURED:_ASSOCIATION, member],
            association=copies[row, _ASSOCIATION, member].astype(np.int64),
        )
