"""Lines that fall silent and are heard again keep their number.

**Method.** A line that has ended is extrapolated: its last settled state moves
with its rate, and its variance grows. A line that is confirmed later, and whose score
began to rise after the other had ended, is its continuation when frequency, rate and bearing agree so well
that a stranger, who could be anywhere in the band, would be there far less likely. Each
ended line is continued once, by the likeliest of those that are confirmed together.
A line that turns at once, faster than its filter follows, falls silent and another one
begins where it was last heard: with a small prior probability the rate is free, and the
new line's first frequency after that is compared with the old one's last: a noise
peak may have begun it a little earlier.

**Conventions.** A new line is compared at its present state; likelihood ratios are in
nepers.

`studies/constants/lines.py` tries other values of the constants.

**References.** Blackman & Popoli (1999), section 6.8 (track continuation); Bar-Shalom,
Li & Kirubarajan (2001), section 6.2 for the growth of the variance; Page, Biometrika 41,
100-115 (1954) for where a score begins to rise.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.kalman import KalmanState, predict
from uwtrack_cli.lines.tracking.track_store import UNKNOWN_BEARING_VARIANCE, TrackStore

LEAST_LOG_RATIO = 1.6
"""Logarithm of how much likelier a continuation must be than a stranger (5 to 1)."""

RETURNING = 0.5
"""Prior probability that a line which fell silent comes back."""

TURNING = 0.5
"""Prior probability that a line which comes back has another rate."""

TURN_WINDOWS = 3.0
"""Mean time from the last peak before a turn to the first one after it, in windows."""

SILENT_FRAMES = 2
"""Frames without a peak of its own after which a line may have turned."""

LEAST_STD, LEAST_RATE_STD = 0.3, 0.2
"""Floors of the deviations of differences of frequencies, in resolutions, and of rates, in
resolutions per window: the first peaks of a new line may be noise's, and a machine does
not start again at exactly the speed that it had."""


@dataclass(frozen=True)
class SilentLines:
    """Lines that fell silent; arrays of shape (line,) but for two."""

    number: IntArray
    """Numbers of the lines."""
    slot: IntArray
    """Slot of each if it is still waited for, else -1."""
    row: IntArray
    """Last frame that belongs to it, counted from the start."""
    time_s: FloatArray
    """Time of that frame, s."""
    state: KalmanState
    """States of frequency and bearing then, entries of shape (2, line)."""
    noise_density: FloatArray
    """Spectral densities of the accelerations then, shape (2, line)."""

    @classmethod
    def recalled(
        cls, store: TrackStore, slots: IntArray, rows: IntArray, *, is_waited_for: bool
    ) -> "SilentLines":
        """Recall lines of a store as they were at some rows, shape (line,) each."""
        waited = slots if is_waited_for else np.full_like(slots, -1)
        return cls(store.line[slots], waited, rows, *store.recall(slots, rows))

    def take(self, keep: BoolArray | IntArray) -> "SilentLines":
        """Return some of the lines."""
        return SilentLines(
            self.number[keep], self.slot[keep], self.row[keep], self.time_s[keep],
            KalmanState(*(entry[:, keep] for entry in self.state)),
            self.noise_density[:, keep],
        )  # fmt: skip

    def joined(self, others: "SilentLines") -> "SilentLines":
        """Return these lines, then the others."""
        return SilentLines(
            np.append(self.number, others.number), np.append(self.slot, others.slot),
            np.append(self.row, others.row), np.append(self.time_s, others.time_s),
            KalmanState(*(
                np.concatenate(pair, axis=1)
                for pair in zip(self.state, others.state, strict=True)
            )),
            np.concatenate([self.noise_density, others.noise_density], axis=1),
        )  # fmt: skip


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
        nothing = np.zeros(0, dtype=np.int64)
        self.ended = SilentLines.recalled(store, nothing, nothing, is_waited_for=False)

    @property
    def may_jump(self) -> bool:
        """Whether lines may be found again on another frequency."""
        return self.may_turn and self.silence_s > 0.0

    def remember(self, time_s: float) -> None:
        """Take note of the lines that have ended since the last call."""
        slots, rows = self.store.take_ended()
        if not self.silence_s:
            return
        if slots.size:
            fresh = SilentLines.recalled(self.store, slots, rows, is_waited_for=False)
            self.ended = self.ended.joined(fresh)
        is_recent = time_s - self.ended.time_s < self.silence_s
        if not is_recent.all():
            self.ended = self.ended.take(is_recent)

    def _waited_for(self) -> SilentLines:
        """Return the confirmed lines that have no peaks of their own any more."""
        store = self.store
        slots = store.confirmed
        slots = slots[store.rows - store.settled[slots] >= SILENT_FRAMES]
        rows = store.settled[slots]
        return SilentLines.recalled(store, slots, rows, is_waited_for=True)

    def numbers(self, slots: IntArray, time_s: float) -> IntArray:
        """Return the numbers that lines to be confirmed continue, 0 for none."""
        numbers = np.zeros(slots.size, dtype=np.int64)
        if not slots.size or not self.silence_s:
            return numbers
        silent = self.silent()
        if not silent.number.size:
            return numbers
        ratio = self._log_ratio(silent, slots, time_s)
        old_lines, new_lines = [], []
        while ratio.max() > LEAST_LOG_RATIO:
            old, new = np.unravel_index(int(ratio.argmax()), ratio.shape)
            numbers[new] = silent.number[old]
            old_lines.append(int(old))
            new_lines.append(int(new))
            ratio[old], ratio[:, new] = -np.inf, -np.inf
        if new_lines:
            self.go_on(slots[new_lines], silent.take(np.array(old_lines)))
        return numbers

    def silent(self) -> SilentLines:
        """Return the lines that may go on: ended ones, and those that are waited for."""
        return self.ended.joined(self._waited_for()) if self.may_turn else self.ended

    def go_on(self, slots: IntArray, old: SilentLines) -> None:
        """Let lines go on each with a silent one that is not looked for any more."""
        self.store.begin_after(slots, old.row)
        self.store.release(old.slot[old.slot >= 0])
        self.store.take_ended()  # they go on
        self.ended = self.ended.take(~np.isin(self.ended.number, old.number))

    def _log_ratio(self, silent: SilentLines, slots: IntArray, time_s: float) -> FloatArray:
        """Logarithm of "the old line again" over "a stranger", shape (silent, new)."""
        store = self.store
        n_strangers = self.ended.number.size + store.confirmed.size
        density = n_strangers / self.band_hz
        old = silent.take(np.arange(silent.number.size)[:, None])
        log_ratio = log_ratio_of_return(
            old.state, old.noise_density, time_s - old.time_s, store.state_of(slots),
            self.resolution_hz, density,
        )  # fmt: skip
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
        begin_s, begin, _ = store.recall(slots, rows)
        gap_s = np.maximum(begin_s - old.time_s, 0.0)
        before, now = old.state, store.state_of(slots)
        # it went on for an unknown part of the gap, and with the new rate for the rest
        between = (now.rate[0] - before.rate[0]) * gap_s
        doubt = 0.25 * (before.rate_variance[0] + now.rate_variance[0]) * gap_s**2
        spread = before.variance[0] + begin.variance[0] + between**2 / 12.0 + doubt
        spread = spread + (LEAST_STD * self.resolution_hz) ** 2
        middle = before.position[0] + 0.5 * (before.rate[0] + now.rate[0]) * gap_s
        off = begin.position[0] - middle
        log_ratio = -0.5 * (off**2 / spread + np.log(2.0 * np.pi * spread))
        log_ratio += np.log(RETURNING * TURNING / density)
        # it begins at once, where strangers begin at any time
        wait_s = TURN_WINDOWS / self.resolution_hz
        latest_s = begin_s.max(axis=1, keepdims=True)
        log_ratio += np.log(np.maximum(latest_s / wait_s, 1.0)) - gap_s / wait_s
        turn = wrap_deg(begin.position[1] - before.position[1])
        around = before.variance[1] + begin.variance[1]
        is_known = before.variance[1] < UNKNOWN_BEARING_VARIANCE
        log_ratio -= np.where(is_known, 0.5 * turn**2 / around, 0.0)
        # who was beside the old line for longer is another one
        early_s = old.time_s - store.time_of(store.risen[slots])
        log_ratio[early_s > wait_s] = -np.inf
        return np.asarray(log_ratio)


def log_ratio_of_return(
    before: KalmanState,
    noise_density: FloatArray,
    gap_s: float | FloatArray,
    now: KalmanState,
    resolution_hz: float,
    strangers_per_hz: float,
) -> FloatArray:
    """Logarithm of "the same line after a silence" over "a stranger", nepers.

    Parameters
    ----------
    before
        States of frequency and bearing at the ends of the lines; entries of shape
        (2, ...), which broadcasts with that of the new ones.
    noise_density
        Spectral density of the accelerations, Hz^2/s^3 and degree^2/s^3, shape (2, ...).
    gap_s
        Time from there to the new states, s, shape (...).
    now
        States of new lines; entries of shape (2, line).
    resolution_hz
        Resolution of a frame in Hz.
    strangers_per_hz
        Density along frequency in which strangers begin, 1/Hz.
    """
    ahead = predict(before, gap_s, noise_density)
    spread = ahead.variance[0] + now.variance[0] + (LEAST_STD * resolution_hz) ** 2
    off = now.position[0] - ahead.position[0]
    slip = now.rate[0] - ahead.rate[0]
    slip_spread = ahead.rate_variance[0] + now.rate_variance[0]
    slip_spread = slip_spread + (LEAST_RATE_STD * resolution_hz**2) ** 2
    log_ratio = -0.5 * (off**2 / spread + slip**2 / slip_spread)
    turn = wrap_deg(now.position[1] - ahead.position[1])
    is_known = before.variance[1] < UNKNOWN_BEARING_VARIANCE
    turn_spread = ahead.variance[1] + now.variance[1]
    log_ratio -= np.where(is_known, 0.5 * turn**2 / turn_spread, 0.0)
    log_ratio += np.log(RETURNING / strangers_per_hz)
    return np.asarray(log_ratio - 0.5 * np.log(2.0 * np.pi * spread))
