"""The states of all lines, their recent history, and its smoothing.

**Method.** Every line has a slot in one table, a row per quantity, so that one
operation advances all lines and one copy keeps a frame. The copies of the last
frames form a ring. Whenever a chunk of frames is full, the lines are smoothed from
the newest frame back (Rauch-Tung-Striebel, all lines at once) and the points
that lie at least one lag behind the newest frame are final: with a lag much longer
than the memory of the filter this is the fixed-interval smoother, in bounded
memory. Chunks are counted in frames since the start, so the blocks in which frames
arrive make no difference.

**Conventions.** Row 0 of a pair is frequency (Hz), row 1 bearing (degree,
unwrapped). A slot is free, tentative, confirmed or ended; an ended line keeps its
slot until its points are out.

**References.** Rauch, Tung & Striebel, AIAA J. 3(8), 1445-1450 (1965).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.kalman import State, smooth

Points = dict[str, NDArray[Any]]
"""Points of lines: their rows of the table, line, frame and time."""

FREE, TENTATIVE, CONFIRMED, ENDED = 0, 1, 2, 3
"""Values of `LineBank.stage`."""

CHUNK_FRAMES = 256
"""Frames from one emission of points to the next."""

LAG_FRAMES = 256
"""Frames by which an emitted point lies behind the newest frame, at least."""

STATE_ROWS = 10
MEASURED_ROWS = 7
N_ROWS = STATE_ROWS + MEASURED_ROWS
ASSOCIATION = 16
"""Row of the association; the rows before it are the raw measurement."""


class LineBank:
    """A table of lines, a slot each, with a ring of its recent copies."""

    def __init__(self, capacity: int = 64) -> None:
        self.size = CHUNK_FRAMES + LAG_FRAMES
        self.table = np.zeros((N_ROWS, capacity))
        self.ring = np.zeros((self.size, N_ROWS, capacity))
        self.row_frame = np.zeros(self.size, dtype=np.int64)
        self.row_time = np.zeros(self.size)
        self.row_step = np.zeros(self.size)
        self.rows = 0
        self.next_line = 1
        self.next_serial = 1
        self.stage = np.zeros(capacity, dtype=np.int64)
        self.line = np.zeros(capacity, dtype=np.int64)
        self.serial = np.zeros(capacity, dtype=np.int64)
        self.history = np.zeros(capacity, dtype=np.int64)
        self.age = np.zeros(capacity, dtype=np.int64)
        self.born = np.zeros(capacity, dtype=np.int64)
        self.emitted = np.zeros(capacity, dtype=np.int64)
        self.settled = np.zeros(capacity, dtype=np.int64)
        self.doubled = np.zeros(capacity, dtype=np.int64)
        self.hold = np.zeros(capacity, dtype=np.int64)
        self.score = np.zeros(capacity)
        self.best_score = np.zeros(capacity)
        self.noise_density = np.zeros((2, capacity))

    @property
    def state(self) -> State:
        """Views of the table: what the filters work on."""
        t = self.table
        return State(t[0:2], t[2:4], t[4:6], t[6:8], t[8:10])

    def active(self) -> IntArray:
        """Slots of the tentative and confirmed lines."""
        return np.flatnonzero((self.stage == TENTATIVE) | (self.stage == CONFIRMED))

    def free_slots(self, count: int) -> IntArray:
        """Return ``count`` free slots; the table grows when there are too few."""
        free = np.flatnonzero(self.stage == FREE)
        while free.size < count:
            self._grow()
            free = np.flatnonzero(self.stage == FREE)
        return free[:count]

    def _grow(self) -> None:
        for name, values in vars(self).items():
            if isinstance(values, np.ndarray) and not name.startswith("row_"):
                setattr(self, name, np.concatenate([values, np.zeros_like(values)], -1))

    def start(self, slots: IntArray, score: FloatArray) -> None:
        """Make tentative lines of slots whose table columns have been filled."""
        count = slots.size
        self.stage[slots] = TENTATIVE
        self.serial[slots] = self.next_serial + np.arange(count)
        self.next_serial += count
        self.history[slots] = 1
        self.age[slots] = 1
        self.hold[slots] = 0
        self.doubled[slots] = 0
        self.line[slots] = 0
        self.born[slots] = self.emitted[slots] = self.settled[slots] = self.rows
        self.score[slots] = self.best_score[slots] = score

    def release(self, slots: IntArray) -> None:
        """Take lines out: tentative ones are forgotten, confirmed ones have ended."""
        is_confirmed = self.stage[slots] == CONFIRMED
        self.stage[slots] = np.where(is_confirmed, ENDED, FREE)

    def keep_frame(self, frame: int, time_s: float, step_s: float) -> None:
        """Copy the table of this frame into the ring."""
        at = self.rows % self.size
        self.ring[at] = self.table
        self.row_frame[at], self.row_time[at] = frame, time_s
        self.row_step[at] = step_s
        self.rows += 1

    @property
    def is_chunk_full(self) -> bool:
        """Whether points are due."""
        return self.rows % CHUNK_FRAMES == 0

    def emit(self, lag: int) -> Points:
        """Smooth and return the points at least ``lag`` frames old, by line and time.

        Points after the frame up to which a line is settled are not its points
        yet; lines that ended are returned up to there and leave the table.
        """
        slots = np.flatnonzero((self.stage == CONFIRMED) | (self.stage == ENDED))
        slots = slots[np.argsort(self.line[slots])]
        start = max(0, self.rows - self.size)
        first = np.maximum(np.maximum(self.emitted, self.born)[slots], start)
        is_over = self.stage[slots] == ENDED
        stop = np.where(is_over, self.rows, self.rows - lag)
        stop = np.minimum(stop, self.settled[slots] + 1)
        due = stop > first
        points = self._smoothed_points(slots[due], first[due], stop[due])
        self.emitted[slots[due]] = stop[due]
        self.stage[slots[is_over]] = FREE
        return points

    def _smoothed_points(
        self, slots: IntArray, first: IntArray, stop: IntArray
    ) -> Points:
        low = int(first.min()) if slots.size else self.rows
        rows = np.arange(low, self.rows)
        at = rows % self.size
        copies = self.ring[at][:, :, slots]
        # an ended line is smoothed from its settled end, a living one from now
        end = np.where(self.stage[slots] == ENDED, self.settled[slots], self.rows - 1)
        _smooth_back(copies, rows, end, self.row_step[at], self.noise_density[:, slots])
        member, row = np.nonzero(
            (rows[None, :] >= first[:, None]) & (rows[None, :] < stop[:, None])
        )
        is_gap = np.isnan(copies[row, ASSOCIATION, member])
        member, row = member[~is_gap], row[~is_gap]
        return {
            "values": copies[row, :, member],
            "line": self.line[slots][member],
            "frame": self.row_frame[at][row],
            "time_s": self.row_time[at][row],
        }


def _smooth_back(
    copies: FloatArray,
    rows: IntArray,
    end: IntArray,
    steps: FloatArray,
    noise_density: FloatArray,
) -> None:
    """Overwrite filtered states by smoothed ones, newest frame first."""
    if copies.shape[2] == 0:
        return
    # rows before a line's birth hold another line's remains: never emitted
    with np.errstate(all="ignore"):
        for k in range(rows.size - 2, -1, -1):
            is_inside = rows[k] < end
            now = copies[k, :STATE_ROWS].reshape(5, 2, -1)
            later = copies[k + 1, :STATE_ROWS].reshape(5, 2, -1)
            better = smooth(State(*now), State(*later), steps[k + 1], noise_density)
            copies[k, :STATE_ROWS] = np.where(is_inside, np.stack(better), now).reshape(
                STATE_ROWS, -1
            )
