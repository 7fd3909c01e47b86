"""Lines that jump together, when a machine changes its speed at once, keep their numbers.

**Method.** When a shaft changes its rate within a frame or two, all its lines fall silent
and as many begin elsewhere, by one common ratio (`lines.common_jumps`). Lines of the
machine that are found later follow the ratio of those that are known.

**Conventions.** A new line is compared at its present frequency, so that a machine whose
speed still drifts has one ratio at any time. Points leave with a lag of
`track_store.LAG_FRAMES`, and until then a line may be given an older number.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.lines.common_jumps import (
    AFTER_WINDOWS,
    BEARING_SIGMAS,
    BEFORE_WINDOWS,
    FEWEST_LINES,
    JumpCandidates,
    told_jump,
)
from uwtrack_cli.lines.line_points import FamilyJump
from uwtrack_cli.lines.tracking.line_continuation import SilentLines
from uwtrack_cli.lines.tracking.track_store import CONFIRMED, UNKNOWN_BEARING_VARIANCE, TrackStore

LONG_BEFORE_WINDOWS = 40.0
"""The former where the jump is known from other lines."""

PATIENCE_S = 60.0
"""Time after a jump in which lines may still be found that belong to it, s."""

SILENT_FRAMES = 6
"""Frames without a peak of its own after which a line may have jumped."""

STEADY_FRAMES = 40
"""Frames for which a line must have been followed before."""


@dataclass(frozen=True)
class Renamed:
    """A line that is the continuation of an older one."""

    slot: int
    """Slot of the line."""
    number: int
    """Number that it had been given."""
    old: int
    """Position of the silent line that it continues."""


@dataclass
class _Jump:
    """A jump that has been found: the lines that took part in it."""

    time_s: float
    """Time at which it was found, s."""
    slots: IntArray
    """Slots of the lines after it, shape (line,)."""
    serials: IntArray
    """Serials of these lines: a slot may be given to another one, shape (line,)."""
    before_hz: FloatArray
    """Their frequencies before it, Hz, shape (line,)."""
    told: FamilyJump
    """What is told of it."""


class FamilyJumps:
    """Watches the lines that begin for jumps of those that fell silent."""

    def __init__(self, store: TrackStore, resolution_hz: float) -> None:
        self.store = store
        self.resolution_hz = resolution_hz
        self._serials = np.zeros(0, dtype=np.int64)
        self._jumps: list[_Jump] = []
        self.told: list[FamilyJump] = []

    def watch(self, fresh: IntArray) -> None:
        """Take note of lines, given by their slots, that continue none so far."""
        if fresh.size:
            self._serials = np.append(self._serials, self.store.serial[fresh])

    @property
    def is_idle(self) -> bool:
        """Whether there is no line that could be given another number."""
        return self._serials.size == 0

    def find(self, silent: SilentLines, time_s: float) -> list[Renamed]:
        """Return the new lines that are old, silent ones after a jump."""
        store = self.store
        confirmed = store.confirmed
        # its first points are not out yet
        confirmed = confirmed[store.emitted[confirmed] <= store.born[confirmed]]
        slots = confirmed[np.isin(store.serial[confirmed], self._serials)]
        self._serials = store.serial[slots]
        self._jumps = [j for j in self._jumps if time_s - j.time_s < PATIENCE_S]
        # a line that only wavers is not silent, and what has just begun has no place
        lived = silent.row - store.born[silent.slot]
        is_due = (silent.slot < 0) | (lived >= STEADY_FRAMES)
        is_due &= store.rows - silent.row >= SILENT_FRAMES
        due = np.flatnonzero(is_due)
        if not slots.size or not due.size:
            return []
        before = silent.take(due)
        before_hz = before.state.position[0]
        begin_s = store.time_of(np.maximum(store.born[slots], store.risen[slots]))
        wait = (begin_s - before.time_s[:, None]) * self.resolution_hz
        may_be = (wait > -LONG_BEFORE_WINDOWS) & (wait < AFTER_WINDOWS)
        may_be &= self._is_there(before, slots)
        candidates = JumpCandidates(
            before_hz, before.time_s, store.frequency_hz[slots], may_be, self.resolution_hz
        )
        ratio = candidates.log_ratio
        pairs, known = self._followed(candidates)
        if not pairs and min(slots.size, due.size) >= FEWEST_LINES:
            is_prompt = may_be & (wait > -BEFORE_WINDOWS)
            pairs = replace(candidates, may_be=is_prompt).common()
        if not pairs:
            return []
        old, new = np.array(pairs).T
        chosen, numbers = slots[new], before.number[old]
        if known is None:
            times_s = 0.5 * (begin_s[new] + before.time_s[old])
            variance = before.state.variance[0, old] / before_hz[old] ** 2
            relative = store.frequency_hz[chosen]
            variance += store.frequency_variance_hz2[chosen] / relative**2
            known = told_jump(float(np.median(times_s)), ratio[old, new], variance)
            self.told.append(known)
        known.lines.update(numbers.tolist())
        self._jumps.append(_Jump(time_s, chosen, store.serial[chosen], before_hz[old], known))
        self._serials = np.setdiff1d(self._serials, store.serial[chosen])
        return [
            Renamed(int(slot), int(store.line[slot]), int(due[k]))
            for slot, k in zip(chosen, old, strict=True)
        ]

    def _is_there(self, before: SilentLines, slots: IntArray) -> BoolArray:
        """Tell for each pair whether the bearings allow one vessel, (silent, line)."""
        now = self.store.state_of(slots)
        turn = wrap_deg(now.position[1] - before.state.position[1][:, None])
        variance = now.variance[1] + before.state.variance[1][:, None]
        allows = np.abs(turn) < BEARING_SIGMAS * np.sqrt(variance)
        return np.asarray(allows | (variance >= UNKNOWN_BEARING_VARIANCE))

    def _followed(
        self, candidates: JumpCandidates
    ) -> tuple[list[tuple[int, int]], FamilyJump | None]:
        """Pair lines by the ratio that the lines of a known jump have now."""
        store = self.store
        for jump in self._jumps:
            lives = (store.stage[jump.slots] == CONFIRMED) & (
                store.serial[jump.slots] == jump.serials
            )
            if not lives.any():
                continue
            mates = store.frequency_hz[jump.slots[lives]] / jump.before_hz[lives]
            place = candidates.before_hz * float(np.median(mates))
            pairs = candidates.paired(place, candidates.may_be)
            if pairs:
                return pairs, jump.told
        return [], None
