"""Lines that fall silent and are heard again keep their number.

**Method.** A line that is confirmed, and whose score began to rise after another had
ended, may be its continuation (`lines.stitching`), from the other's last settled state.
Each ended line is continued once, by the likeliest of those that are confirmed together.
A line that turns at once, faster than its filter follows, falls silent and another one
begins where it was last heard: with a small prior probability the rate is free, and the
new line's first frequency after that is compared with the old one's last: a noise
peak may have begun it a little earlier. Lines of a machine that changes its speed fall
silent together, and go on elsewhere.

**Conventions.** A new line is compared at its present state, so that a machine whose
speed still drifts has one ratio at any time; likelihood ratios are in nepers. Points
leave with a lag of `track_store.LAG_FRAMES`, and until then a line may be given an older
number.

`studies/constants/lines.py` tries other values of the constants.

**References.** Blackman & Popoli (1999), section 6.8 (track continuation); Page,
Biometrika 41, 100-115 (1954) for where a score begins to rise.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.lines.stitching import (
    LEAST_LOG_RATIO,
    TURN_WINDOWS,
    FamilyJumps,
    PieceEnds,
    log_ratio_of_return,
    log_ratio_of_turn,
    stitched,
)
from uwtrack_cli.lines.tracking.track_store import TrackStore

SILENT_FRAMES = 2
"""Frames without a peak of its own after which a line may have turned or jumped."""


@dataclass(frozen=True)
class SilentLines(PieceEnds):
    """Lines that fell silent; ``line`` and the others are those of their ends."""

    slot: IntArray
    """Slot of each if it is still waited for, else -1, shape (piece,)."""
    row: IntArray
    """Last frame that belongs to it, counted from the start, shape (piece,)."""

    @classmethod
    def recalled(
        cls, store: TrackStore, slots: IntArray, rows: IntArray, *, is_waited_for: bool
    ) -> "SilentLines":
        """Recall lines of a store as they were at some rows, shape (line,) each."""
        waited = slots if is_waited_for else np.full_like(slots, -1)
        return cls(store.line[slots], *store.recall(slots, rows), waited, rows)


class LineContinuation:
    """Remembers the lines that have ended, and finds them again."""

    def __init__(
        self,
        store: TrackStore,
        resolution_hz: float,
        band_hz: float,
        silence_s: float,
        *,
        may_turn: bool,
    ) -> None:
        """Remember the lines of a store.

        Parameters
        ----------
        store
            The lines.
        resolution_hz
            Resolution of a frame in Hz.
        band_hz
            Width of the band in which strangers begin, Hz.
        silence_s
            Longest silence of a line, s; 0 continues none.
        may_turn
            Whether lines may change faster than their process noise says: not if it
            was given as fixed.
        """
        self.store = store
        self.may_turn = may_turn
        self.silence_s = silence_s
        self.resolution_hz = resolution_hz
        self.band_hz = band_hz
        self.jumps = FamilyJumps(resolution_hz)
        nothing = np.zeros(0, dtype=np.int64)
        self.ended = SilentLines.recalled(store, nothing, nothing, is_waited_for=False)
        self._fresh = nothing  # serials of lines that continue none so far

    def remember(self, time_s: float) -> None:
        """Take note of the lines that have ended since the last call."""
        slots, rows = self.store.take_ended()
        if not self.silence_s:
            return
        if slots.size:
            fresh = SilentLines.recalled(self.store, slots, rows, is_waited_for=False)
            self.ended = SilentLines.join([self.ended, fresh])
        is_recent = time_s - self.ended.time_s < self.silence_s
        if not is_recent.all():
            self.ended = self.ended.take(is_recent)

    def _silent(self) -> SilentLines:
        """Return the lines that may go on: ended ones, and those that are waited for.

        The latter are confirmed and have no peaks of their own any more.
        """
        if not self.may_turn:
            return self.ended
        store = self.store
        slots = store.confirmed
        slots = slots[store.rows - store.settled[slots] >= SILENT_FRAMES]
        waited_for = SilentLines.recalled(store, slots, store.settled[slots], is_waited_for=True)
        return SilentLines.join([self.ended, waited_for])

    def numbers(self, slots: IntArray, time_s: float) -> IntArray:
        """Return the numbers that lines to be confirmed continue, 0 for none."""
        numbers = np.zeros(slots.size, dtype=np.int64)
        if slots.size and self.silence_s:
            silent = self._silent()
            pairs = stitched(self._log_ratio(silent, slots, time_s), LEAST_LOG_RATIO)
            if pairs:
                old, new = np.array(pairs).T
                numbers[new] = silent.line[old]
                self._go_on(slots[new], silent.take(old))
        self._fresh = np.append(self._fresh, self.store.serial[slots[numbers == 0]])
        return numbers

    def _go_on(self, slots: IntArray, old: SilentLines) -> None:
        """Let lines go on each with a silent one that is not looked for any more."""
        self.store.begin_after(slots, old.row)
        self.store.release(old.slot[old.slot >= 0])
        self.store.take_ended()  # they go on
        self.ended = self.ended.take(~np.isin(self.ended.line, old.line))

    def jumped(self) -> dict[int, int]:
        """Give new lines the numbers of those that have jumped to where they are.

        Returns the older number of each by the one that it had.
        """
        store = self.store
        slots = store.confirmed
        # its first points are not out yet
        slots = slots[store.emitted[slots] <= store.born[slots]]
        slots = slots[np.isin(store.serial[slots], self._fresh)]
        self._fresh = store.serial[slots]
        if not (self.may_turn and self.silence_s and slots.size):
            return {}
        silent = self._silent()
        begin_s = store.time_of(np.maximum(store.born[slots], store.risen[slots]))
        found = self.jumps.find(silent, self._begun(slots, begin_s))
        if found is None:
            return {}
        old, new = np.array(found[1]).T
        slots, silent = slots[new], silent.take(old)
        renamed = dict(zip(store.line[slots].tolist(), silent.line.tolist(), strict=True))
        store.line[slots] = silent.line
        self._fresh = np.setdiff1d(self._fresh, store.serial[slots])
        self._go_on(slots, silent)
        return renamed

    def _begun(self, slots: IntArray, time_s: FloatArray) -> PieceEnds:
        """Return new lines as if they began at some times, s, as they are now."""
        store = self.store
        state = np.moveaxis(np.stack(store.state_of(slots)), -1, 0)
        return PieceEnds(store.line[slots], time_s, state, store.noise_density[:, slots].T)

    def _log_ratio(self, silent: SilentLines, slots: IntArray, time_s: float) -> FloatArray:
        """Logarithm of "the old line again" over "a stranger", shape (silent, new)."""
        store = self.store
        n_strangers = self.ended.line.size + store.confirmed.size
        density = n_strangers / self.band_hz
        if not silent.line.size:
            return np.zeros((0, slots.size))
        begun = self._begun(slots, np.full(slots.size, time_s))
        log_ratio = log_ratio_of_return(silent, begun, self.resolution_hz, density)
        old = silent.take(np.arange(silent.line.size)[:, None])
        # on its course one that is waited for would have found the peaks itself
        is_stranger = (old.slot >= 0) | (store.risen[slots] <= old.row)
        log_ratio[is_stranger] = -np.inf
        if self.may_turn:
            log_ratio = np.logaddexp(log_ratio, self._turned(old, slots, density))
        return np.asarray(log_ratio)

    def _turned(self, old: SilentLines, slots: IntArray, density: float) -> FloatArray:
        """Logarithm of "the old line with another rate" over "a stranger".

        The silent lines have a column for the new ones, and so has the result: (silent,
        new). Strangers begin with a density along frequency, 1/Hz.
        """
        store = self.store
        rows = np.maximum(store.born[slots], old.row + 1)
        begun = PieceEnds(old.line, *store.recall(slots, rows))
        log_ratio = log_ratio_of_turn(
            old, begun, store.state_of(slots), self.resolution_hz, density
        )
        # who was beside the old line for longer is another one
        early_s = old.time_s - store.time_of(store.risen[slots])
        log_ratio[early_s > TURN_WINDOWS / self.resolution_hz] = -np.inf
        return log_ratio
