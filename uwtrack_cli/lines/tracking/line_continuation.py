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

`calibration/lines.py` tries other values of the constants.

**References.** Blackman & Popoli (1999), section 6.8 (track continuation); Bar-Shalom,
Li & Kirubarajan (2001), section 6.2 for the growth of the variance; Page, Biometrika 41,
100-115 (1954) for where a score begins to rise.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.constant_velocity import white_acceleration
from uwtrack_cli.estimation.kalman import KalmanState
from uwtrack_cli.lines.tracking.track_store import (
    UNKNOWN_BEARING_VARIANCE,
    TrackStore,
)

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
class EndedLine:
    """A line that fell silent."""

    number: int
    """Number of the line."""
    slot: int
    """Its slot if it is still waited for, else -1."""
    row: int
    """Last frame that belongs to it, counted from the start."""
    time_s: float
    """Time of that frame, s."""
    state: FloatArray
    """Entries of `KalmanState` of frequency and bearing then, shape (5, 2)."""
    noise_density: FloatArray
    """Spectral density of the accelerations then, shape (2,)."""


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
        self.ended: list[EndedLine] = []

    @property
    def may_jump(self) -> bool:
        """Whether lines may be found again on another frequency."""
        return self.may_turn and self.silence_s > 0.0

    def remember(self, time_s: float) -> None:
        """Take note of the lines that have ended since the last call."""
        kept = [e for e in self.ended if time_s - e.time_s < self.silence_s]
        fresh = [
            EndedLine(
                int(self.store.line[slot]), -1, row, *self.store.recall(slot, row)
            )
            for slot, row in self.store.take_ended()
        ]
        self.ended = kept + (fresh if self.silence_s else [])

    def _waited_for(self) -> list[EndedLine]:
        """Return the confirmed lines that have no peaks of their own any more."""
        store = self.store
        slots = store.confirmed
        slots = slots[store.rows - store.settled[slots] >= SILENT_FRAMES]
        return [
            EndedLine(int(store.line[slot]), slot, row, *store.recall(slot, row))
            for slot, row in zip(
                slots.tolist(), store.settled[slots].tolist(), strict=True
            )
        ]

    def numbers(self, slots: IntArray, time_s: float) -> IntArray:
        """Return for lines to be confirmed the numbers that they continue, 0 for none.

        Parameters
        ----------
        slots
            Lines that are about to be confirmed.
        time_s
            Time of the frame, s.
        """
        numbers = np.zeros(slots.size, dtype=np.int64)
        if not slots.size or not self.silence_s:
            return numbers
        silent = self.silent()
        if not silent:
            return numbers
        ratio = np.array([self._log_ratio(e, slots, time_s) for e in silent])
        continued = []
        while ratio.max() > LEAST_LOG_RATIO:
            old, new = np.unravel_index(int(ratio.argmax()), ratio.shape)
            numbers[new] = silent[old].number
            continued.append((int(slots[new]), silent[old]))
            ratio[old], ratio[:, new] = -np.inf, -np.inf
        self.go_on(continued)
        return numbers

    def silent(self) -> list[EndedLine]:
        """Return the lines that may go on: ended ones, and those that are waited for."""
        return self.ended + (self._waited_for() if self.may_turn else [])

    def go_on(self, continued: list[tuple[int, EndedLine]]) -> None:
        """Let lines, given by slot, go on with others that are not looked for any more."""
        if not continued:
            return
        for slot, old in continued:
            self.store.begin_after(slot, old.row)
        waiting = [old.slot for _, old in continued if old.slot >= 0]
        self.store.release(np.array(waiting, np.int64))
        self.store.take_ended()  # they go on
        taken = {old.number for _, old in continued}
        self.ended = [e for e in self.ended if e.number not in taken]

    def _log_ratio(self, old: EndedLine, slots: IntArray, time_s: float) -> FloatArray:
        """Logarithm of "the old line again" over "a stranger" for some new lines."""
        store = self.store
        gap_s = time_s - old.time_s
        n_strangers = len(self.ended) + store.confirmed.size
        density = n_strangers / self.band_hz
        log_ratio = log_ratio_of_return(
            KalmanState(*old.state), old.noise_density, gap_s, store.state_of(slots),
            self.resolution_hz, density,
        )  # fmt: skip
        if old.slot >= 0:
            log_ratio[:] = -np.inf  # on its course it would have found the peaks itself
        log_ratio[store.risen[slots] <= old.row] = -np.inf
        if self.may_turn:
            log_ratio = np.logaddexp(log_ratio, self._turned(old, slots, density))
        return np.asarray(log_ratio)

    def _turned(self, old: EndedLine, slots: IntArray, density: float) -> FloatArray:
        """Logarithm of "the old line with another rate" over "a stranger"."""
        begin = _Beginnings(self.store, slots, old.row + 1)
        gap_s = np.maximum(begin.time_s - old.time_s, 0.0)
        before = KalmanState(*old.state)
        now = self.store.state_of(slots)
        # it went on for an unknown part of the gap, and with the new rate for the rest
        between = (now.rate[0] - before.rate[0]) * gap_s
        doubt = 0.25 * (before.rate_variance[0] + now.rate_variance[0]) * gap_s**2
        spread = before.variance[0] + begin.variance_hz2 + between**2 / 12.0 + doubt
        spread = spread + (LEAST_STD * self.resolution_hz) ** 2
        middle = before.position[0] + 0.5 * (before.rate[0] + now.rate[0]) * gap_s
        off = begin.frequency_hz - middle
        log_ratio = -0.5 * (off**2 / spread + np.log(2.0 * np.pi * spread))
        log_ratio += np.log(RETURNING * TURNING / density)
        # it begins at once, where strangers begin at any time
        wait_s = TURN_WINDOWS / self.resolution_hz
        log_ratio += np.log(max(begin.time_s.max() / wait_s, 1.0)) - gap_s / wait_s
        is_known = before.variance[1] < UNKNOWN_BEARING_VARIANCE
        turn = wrap_deg(begin.bearing_deg - before.position[1])
        if is_known:
            around = before.variance[1] + begin.bearing_variance_deg2
            log_ratio -= 0.5 * turn**2 / around
        # who was beside the old line for longer is another one
        early_s = old.time_s - begin.risen_s
        log_ratio[early_s > wait_s] = -np.inf
        return np.asarray(log_ratio)


class _Beginnings:
    """When and where some lines began, from some frame on; arrays of shape (line,)."""

    def __init__(self, store: TrackStore, slots: IntArray, least_row: int) -> None:
        risen = np.minimum(store.risen[slots], store.rows - 1).tolist()
        rows = np.maximum(store.born[slots], least_row)
        rows = np.minimum(rows, store.rows - 1).tolist()
        first = [
            store.recall(slot, row)
            for slot, row in zip(slots.tolist(), rows, strict=True)
        ]
        self.risen_s = np.array([store.time_of(row) for row in risen])
        self.time_s = np.array([time_s for time_s, _, _ in first])
        states = np.array([state for _, state, _ in first])
        self.frequency_hz, self.bearing_deg = states[:, 0, 0], states[:, 0, 1]
        self.variance_hz2 = states[:, 2, 0]
        self.bearing_variance_deg2 = states[:, 2, 1]


def log_ratio_of_return(
    before: KalmanState,
    noise_density: FloatArray,
    gap_s: float,
    now: KalmanState,
    resolution_hz: float,
    strangers_per_hz: float,
) -> FloatArray:
    """Logarithm of "the same line after a silence" over "a stranger", nepers.

    Parameters
    ----------
    before
        State of frequency and bearing at the end of the line; entries of shape (2,).
    noise_density
        Spectral density of the accelerations, Hz^2/s^3 and degree^2/s^3, shape (2,).
    gap_s
        Time from there to the new states, s.
    now
        States of new lines; entries of shape (2, line).
    resolution_hz
        Resolution of a frame in Hz.
    strangers_per_hz
        Density along frequency in which strangers begin, 1/Hz.
    """
    noise = white_acceleration(gap_s)
    variance = (
        before.variance
        + gap_s * (2.0 * before.covariance + gap_s * before.rate_variance)
        + noise_density * noise.position
    )
    rate_variance = before.rate_variance + noise_density * noise.rate
    spread = variance[0] + now.variance[0] + (LEAST_STD * resolution_hz) ** 2
    off = now.position[0] - before.position[0] - gap_s * before.rate[0]
    slip = now.rate[0] - before.rate[0]
    slip_spread = rate_variance[0] + now.rate_variance[0]
    slip_spread = slip_spread + (LEAST_RATE_STD * resolution_hz**2) ** 2
    log_ratio = -0.5 * (off**2 / spread + slip**2 / slip_spread)
    turn = wrap_deg(now.position[1] - before.position[1] - gap_s * before.rate[1])
    turn_spread = variance[1] + now.variance[1]
    if before.variance[1] < UNKNOWN_BEARING_VARIANCE:
        log_ratio -= 0.5 * turn**2 / turn_spread
    log_ratio += np.log(RETURNING / strangers_per_hz)
    return np.asarray(log_ratio - 0.5 * np.log(2.0 * np.pi * spread))
