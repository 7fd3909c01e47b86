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
from uwtrack_cli.estimation.kalman import State, advance, smooth_all

Points = dict[str, NDArray[Any]]
"""Points of lines: their rows of the table, line, frame and time."""

FREE, TENTATIVE, CONFIRMED, ENDED = 0, 1, 2, 3
"""Values of `LineBank.stage`."""

CHUNK_FRAMES = 256
"""Frames from one emission of points to the next."""

LAG_FRAMES = 256
"""Frames by which an emitted point lies behind the newest frame, at least."""

MORE_SLOTS = 64
"""Slots by which a table that is full grows, at least."""

STATE_ROWS = 10
MEASURED_ROWS = 7
N_ROWS = STATE_ROWS + MEASURED_ROWS
ASSOCIATION = 16
"""Row of the association; the rows before it are the raw measurement."""


_N_COUNTS, _N_GAUGES = 10, 5


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
        self.n_quantities = 1
        self.noise_density = np.zeros((2, capacity))
        self._counts = np.zeros((_N_COUNTS, capacity), dtype=np.int64)
        self._gauges = np.zeros((_N_GAUGES, capacity))
        self._name_rows()

    def _name_rows(self) -> None:
        """Give the rows of the tables names: views of them."""
        (
            self.stage, self.line, self.serial, self.history, self.age, self.born,
            self.emitted, self.settled, self.doubled, self.hold,
        ) = self._counts  # fmt: skip
        (
            self.score, self.best_score, self.hit_rate, self.precision, self.hits,
        ) = self._gauges  # fmt: skip
        t, n = self.table, self.n_quantities
        self.state = State(t[0:2], t[2:4], t[4:6], t[6:8], t[8:10])
        self._moving = State(*(pair[:n] for pair in self.state))
        self._sorted: tuple[IntArray, IntArray] | None = None

    def heed_bearings(self) -> None:
        """Let bearings move, too; until one is heard they are left alone."""
        self.n_quantities = 2
        self._name_rows()

    def advance(self, step_s: float) -> None:
        """Carry all lines over a time step, and forget their measurements."""
        noise = self.noise_density[: self.n_quantities]
        advance(self._moving, step_s, noise)
        self.table[STATE_ROWS:] = np.nan

    @property
    def confirmed(self) -> IntArray:
        """Slots of the confirmed lines."""
        return self._by_stage()[0]

    def active(self) -> IntArray:
        """Slots of the confirmed lines, then of the tentative ones."""
        return self._by_stage()[1]

    def _by_stage(self) -> tuple[IntArray, IntArray]:
        if self._sorted is None:
            sure = np.flatnonzero(self.stage == CONFIRMED)
            young = np.flatnonzero(self.stage == TENTATIVE)
            self._sorted = sure, np.concatenate([sure, young])
        return self._sorted

    def free_slots(self, count: int) -> IntArray:
        """Return ``count`` free slots; the table grows when there are too few."""
        free = np.flatnonzero(self.stage == FREE)
        while free.size < count:
            self._grow()
            free = np.flatnonzero(self.stage == FREE)
        return free[:count]

    def _grow(self) -> None:
        """Add a quarter of the slots: the ring is large, and rarely outgrown."""
        more = max(MORE_SLOTS, self.table.shape[-1] // 4)
        for name in ("table", "ring", "noise_density", "_counts", "_gauges"):
            values = getattr(self, name)
            grown = np.zeros(
                (*values.shape[:-1], values.shape[-1] + more), values.dtype
            )
            grown[..., : values.shape[-1]] = values
            setattr(self, name, grown)
        self._name_rows()

    def start(self, slots: IntArray, score: FloatArray, precision: FloatArray) -> None:
        """Make tentative lines of slots whose table columns have been filled."""
        count = slots.size
        serial = self.next_serial + np.arange(count)
        self.next_serial += count
        counts = np.zeros((_N_COUNTS, count), dtype=np.int64)
        counts[0], counts[2], counts[3:5], counts[5:8] = TENTATIVE, serial, 1, self.rows
        self._counts[:, slots] = counts
        self._gauges[:, slots] = np.stack(
            [score, score, np.ones(count), precision, np.ones(count)]
        )
        self._sorted = None

    def confirm(self, slots: IntArray) -> None:
        """Make confirmed lines of tentative ones; they get their numbers."""
        if slots.size:
            self.stage[slots] = CONFIRMED
            self.line[slots] = self.next_line + np.arange(slots.size)
            self.next_line += slots.size
            self._sorted = None

    def release(self, slots: IntArray) -> None:
        """Take lines out: tentative ones are forgotten, confirmed ones have ended."""
        if slots.size:
            is_confirmed = self.stage[slots] == CONFIRMED
            self.stage[slots] = np.where(is_confirmed, ENDED, FREE)
            self._sorted = None

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
        copies = self.ring[np.ix_(at, np.arange(N_ROWS), slots)]
        # an ended line is smoothed from its settled end, a living one from now
        end = np.where(self.stage[slots] == ENDED, self.settled[slots], self.rows - 1)
        n = self.n_quantities
        states = copies[:, :STATE_ROWS].reshape(rows.size, 5, 2, slots.size)[:, :, :n]
        is_inside = (rows[:, None] < end)[:, None, :]
        # rows before a line's birth hold another line's remains: never emitted
        with np.errstate(all="ignore"):
            density = self.noise_density[:n, slots]
            smooth_all(states, self.row_step[at], density, is_inside)
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
