"""Lines that jump together, when a machine changes its speed at once, keep their numbers.

**Method.** When a shaft changes its rate within a frame or two, all its lines fall silent
and as many begin elsewhere, by one common ratio. Among the lines that fell silent and
those that began at that time the ratio is sought with which most of them pair; it is
taken when strangers, who could begin anywhere between the lowest and the highest of the
new ones, would hardly pair as often (a number of false alarms). Lines of the machine that
are found later follow the ratio of those that are known.

**Conventions.** A new line is compared at its present frequency, so that a machine whose
speed still drifts has one ratio at any time. Points leave with a lag of
`track_store.LAG_FRAMES`, and until then a line may be given an older number.

**References.** Desolneux, Moisan & Morel (2008) for the number of false alarms.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.lines.line_points import FamilyJump
from uwtrack_cli.lines.tracking.line_continuation import SilentLines
from uwtrack_cli.lines.tracking.track_store import (
    CONFIRMED,
    UNKNOWN_BEARING_VARIANCE,
    TrackStore,
)

GREATEST_JUMP = 0.08
"""Greatest relative change of the rate: beyond it the orders of the lines are unknown."""

BEFORE_WINDOWS, AFTER_WINDOWS = 12.0, 6.0
"""Windows by which a line may begin before the last peak of the one that it continues
(noise peaks began it), and after it (it was found late)."""

LONG_BEFORE_WINDOWS = 40.0
"""The former where the jump is known from other lines."""

REACH = 0.5
"""Distance from its place within which a line belongs to a jump, in resolutions."""

GREATEST_CHANCE = 1e-3
"""Expected number of jumps as good by chance, in one look, beyond which there is none."""

BEARING_SIGMAS = 4.0
"""Difference of bearings beyond which a line is another vessel's, in deviations."""

PATIENCE_S = 60.0
"""Time after a jump in which lines may still be found that belong to it, s."""

SILENT_FRAMES = 6
"""Frames without a peak of its own after which a line may have jumped."""

STEADY_FRAMES = 40
"""Frames for which a line must have been followed before."""

_SEEDS = 256
"""Ratios that are looked at together."""

_FEWEST = 3
"""Lines below which a common ratio says nothing."""


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
        """Return the new lines that are old ones after a jump.

        Parameters
        ----------
        silent
            The lines that fell silent, each with its last settled state.
        time_s
            Time of the frame, s.
        """
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
        ratio = store.frequency_hz[slots] / before_hz[:, None]
        # what wanders about zero has no ratio
        ratio = np.log(np.where(ratio > 0.0, ratio, np.nan))
        may_be &= np.abs(ratio) < GREATEST_JUMP
        pairs, known = self._followed(before_hz, slots, may_be)
        if not pairs and min(slots.size, due.size) >= _FEWEST:
            may_be &= wait > -BEFORE_WINDOWS
            pairs = self._common(before, slots, may_be, ratio)
        if not pairs:
            return []
        old, new = np.array(pairs).T
        chosen, numbers = slots[new], before.number[old]
        if known is None:
            times_s = 0.5 * (begin_s[new] + before.time_s[old])
            variance = before.state.variance[0, old] / before_hz[old] ** 2
            relative = store.frequency_hz[chosen]
            variance += store.frequency_variance_hz2[chosen] / relative**2
            known = _told(float(np.median(times_s)), ratio[old, new], variance)
            self.told.append(known)
        known.lines.update(numbers.tolist())
        self._jumps.append(
            _Jump(time_s, chosen, store.serial[chosen], before_hz[old], known)
        )
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
        self, before_hz: FloatArray, slots: IntArray, may_be: BoolArray
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
            pairs = self._paired(before_hz * float(np.median(mates)), slots, may_be)
            if pairs:
                return pairs, jump.told
        return [], None

    def _common(
        self,
        before: SilentLines,
        slots: IntArray,
        may_be: BoolArray,
        ratio: FloatArray,
    ) -> list[tuple[int, int]]:
        """Seek the ratio with which most lines pair; none if chance explains it."""
        from scipy.special import bdtrc

        reach_hz = REACH * self.resolution_hz
        frequency = np.sort(self.store.frequency_hz[slots])
        span = frequency[-1] - frequency[0] + self.resolution_hz
        share = min(1.0, 2.0 * reach_hz * slots.size / span)
        wait = np.abs(before.time_s[:, None] - before.time_s) * self.resolution_hz
        is_mate = (wait < AFTER_WINDOWS) & may_be.any(axis=1)
        n_others = np.count_nonzero(is_mate, axis=1) - 1
        best: list[tuple[int, int]] = []
        least = GREATEST_CHANCE
        seeds = np.argwhere(may_be)
        for part in np.split(seeds, range(_SEEDS, len(seeds), _SEEDS)):
            old = part[:, 0]
            place = before.state.position[0] * np.exp(ratio[old, part[:, 1]])[:, None]
            begin = frequency.searchsorted(place - reach_hz, "right")
            has_new = frequency.searchsorted(place + reach_hz) > begin
            # no more of them pair, and few are far more than chance
            most = np.count_nonzero(has_new & is_mate[old], axis=1)
            least_chance = len(seeds) * bdtrc(most - 2.0, n_others[old], share)
            hopeful = (most >= _FEWEST) & (least_chance < least)
            for seed in np.flatnonzero(hopeful).tolist():
                mates = may_be & is_mate[old[seed], :, None]
                pairs = self._paired(place[seed], slots, mates)
                tail = bdtrc(len(pairs) - 2.0, n_others[old[seed]], share)
                if len(pairs) >= _FEWEST and len(seeds) * tail < least:
                    best, least = pairs, len(seeds) * float(tail)
        return best

    def _paired(
        self, place_hz: FloatArray, slots: IntArray, may_be: BoolArray
    ) -> list[tuple[int, int]]:
        """Pair old lines, moved to their places, with the nearest new ones in reach."""
        away = np.abs(self.store.frequency_hz[slots] - place_hz[:, None])
        away = np.where(may_be, away, np.inf)
        pairs = []
        while away.min() < REACH * self.resolution_hz:
            old, new = np.unravel_index(int(away.argmin()), away.shape)
            pairs.append((int(old), int(new)))
            away[old], away[:, new] = np.inf, np.inf
        return pairs


def _told(time_s: float, log_ratio: FloatArray, variance: FloatArray) -> FamilyJump:
    """Return the common ratio of some lines by their weights."""
    weight = 1.0 / variance
    mean = float((weight * log_ratio).sum() / weight.sum())
    excess = float((weight * (log_ratio - mean) ** 2).sum()) / (log_ratio.size - 1)
    std = np.sqrt(max(excess, 1.0) / weight.sum())
    return FamilyJump(time_s, float(np.exp(mean)), float(np.exp(mean) * std), set())
