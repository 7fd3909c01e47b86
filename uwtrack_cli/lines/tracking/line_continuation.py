"""Lines that fall silent and are heard again keep their number.

**Method.** A line that has ended is extrapolated: its last settled state moves
with its rate, and its variance grows. A line that is confirmed later, and began after
the other had ended, is its continuation when frequency, rate and bearing agree so well
that a stranger, who could be anywhere in the band, would be there far less likely. Each
ended line is continued once, by the likeliest of those that are confirmed together.

**Conventions.** A new line is compared at its present state; likelihood ratios are in
nepers.

**References.** Blackman & Popoli (1999), section 6.8 (track continuation); Bar-Shalom,
Li & Kirubarajan (2001), section 6.2 for the growth of the variance.
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

LEAST_STD, LEAST_RATE_STD = 0.3, 0.2
"""Floors of the deviations of differences of frequencies, in resolutions, and of rates, in
resolutions per window: the first peaks of a new line may be noise's, and a machine does
not start again at exactly the speed that it had."""


@dataclass(frozen=True)
class EndedLine:
    """A line that fell silent."""

    number: int
    """Number of the line."""
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
        self, store: TrackStore, resolution_hz: float, band_hz: float, silence_s: float
    ) -> None:
        self.store = store
        self.silence_s = silence_s
        self.resolution_hz = resolution_hz
        self.band_hz = band_hz
        self.ended: list[EndedLine] = []

    def remember(self, time_s: float) -> None:
        """Take note of the lines that have ended since the last call."""
        kept = [e for e in self.ended if time_s - e.time_s < self.silence_s]
        fresh = [
            EndedLine(int(self.store.line[slot]), row, *self.store.recall(slot, row))
            for slot, row in self.store.take_ended()
        ]
        self.ended = kept + (fresh if self.silence_s else [])

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
        if not self.ended or not slots.size:
            return numbers
        ratio = np.array([self._log_ratio(old, slots, time_s) for old in self.ended])
        while ratio.max() > LEAST_LOG_RATIO:
            old, new = np.unravel_index(int(ratio.argmax()), ratio.shape)
            numbers[new] = self.ended[old].number
            ratio[old], ratio[:, new] = -np.inf, -np.inf
        taken = set(numbers.tolist())
        self.ended = [e for e in self.ended if e.number not in taken]
        return numbers

    def _log_ratio(self, old: EndedLine, slots: IntArray, time_s: float) -> FloatArray:
        """Logarithm of "the old line again" over "a stranger" for some new lines."""
        store = self.store
        gap_s = time_s - old.time_s
        noise = white_acceleration(gap_s)
        before = KalmanState(*old.state)
        variance = (
            before.variance
            + gap_s * (2.0 * before.covariance + gap_s * before.rate_variance)
            + old.noise_density * noise.position
        )
        rate_variance = before.rate_variance + old.noise_density * noise.rate
        now = store.state_of(slots)
        spread = variance[0] + now.variance[0] + (LEAST_STD * self.resolution_hz) ** 2
        off = now.position[0] - before.position[0] - gap_s * before.rate[0]
        slip = now.rate[0] - before.rate[0]
        slip_spread = rate_variance[0] + now.rate_variance[0]
        slip_spread = slip_spread + (LEAST_RATE_STD * self.resolution_hz**2) ** 2
        log_ratio = -0.5 * (off**2 / spread + slip**2 / slip_spread)
        turn = wrap_deg(now.position[1] - before.position[1] - gap_s * before.rate[1])
        turn_spread = variance[1] + now.variance[1]
        if before.variance[1] < UNKNOWN_BEARING_VARIANCE:
            log_ratio -= 0.5 * turn**2 / turn_spread
        n_strangers = len(self.ended) + store.confirmed.size
        density = n_strangers / self.band_hz
        log_ratio += np.log(RETURNING / density) - 0.5 * np.log(2.0 * np.pi * spread)
        log_ratio[store.born[slots] <= old.row] = -np.inf
        return np.asarray(log_ratio)
