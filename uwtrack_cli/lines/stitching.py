"""Pieces of lines are stitched to whole lines: the same line again, or a stranger.

**Method.** A piece of a line is known at its end by its frequency, rate and bearing,
another one at its beginning. The end is extrapolated over the time between: its variance
grows with the drift of a machine. Beginning and end are one line when frequency,
rate and bearing agree so well that a stranger, who could be anywhere in the band, would
be there far less likely; most strangers are steady. Every end is continued once, and
every beginning continues one: the likeliest pairs first.

When a machine changes its speed at once, all its lines fall silent and as many begin
elsewhere, by one common ratio. It is sought among the ends and the beginnings of that
time, and is taken when strangers, who could begin anywhere between the lowest and the
highest of the beginnings, would hardly pair as often (a number of false alarms). Pieces
of the machine that are found later follow the ratio that is known.

**Conventions.** Likelihood ratios are in nepers; ends are rows and beginnings columns.

`studies/constants/lines.py` tries other values of the constants.

**References.** Blackman & Popoli (1999), section 6.8 (track continuation); Castanon &
Finn (2011), IEEE Aerospace Conference (tracklet stitching); Bar-Shalom, Li & Kirubarajan
(2001), section 6.2 for the growth of the variance; Desolneux, Moisan & Morel (2008) for
the number of false alarms.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.kalman import KalmanState, predict
from uwtrack_cli.lines.line_points import FamilyJump
from uwtrack_cli.lines.tracking.track_store import UNKNOWN_BEARING_VARIANCE

LEAST_LOG_RATIO = 1.6
"""Logarithm of how much likelier a continuation must be than a stranger (5 to 1)."""

RETURNING = 0.5
"""Prior probability that a line which fell silent comes back."""

TURNING = 0.5
"""Prior probability that a line which comes back has another rate."""

TURN_WINDOWS = 3.0
"""Mean time from the last peak before a turn to the first one after it, in windows."""

LEAST_STD, LEAST_RATE_STD = 0.3, 0.2
"""Floors of the deviations of differences of frequencies, in resolutions, and of rates, in
resolutions per window: the first peaks of a new line may be noise's, and a machine does
not start again at exactly the speed that it had."""

GREATEST_JUMP = 0.08
"""Greatest relative change of the rate: beyond it the orders of the lines are unknown."""

BEFORE_WINDOWS, AFTER_WINDOWS = 12.0, 6.0
"""Windows by which a line may begin before the last peak of the one that it continues
(noise peaks began it), and after it (it was found late)."""

LATE_WINDOWS = 40.0
"""Time from a known jump within which its lines may end and begin, in windows."""

REACH = 0.5
"""Distance from its place within which a line belongs to a jump, in resolutions."""

GREATEST_CHANCE = 1e-3
"""Expected number of jumps as good by chance, in one look, beyond which there is none."""

BEARING_SIGMAS = 4.0
"""Difference of bearings beyond which a line is another vessel's, in deviations."""

FEWEST_LINES = 3
"""Lines below which a common ratio says nothing."""

_SEEDS = 256
"""Ratios that are looked at together."""


@dataclass(frozen=True)
class PieceEnds(Rows):
    """Where pieces of lines end, or where they begin."""

    line: IntArray
    """Number of the line of each, shape (piece,)."""
    time_s: FloatArray
    """Time of the last frame, or of the first one, s, shape (piece,)."""
    state: FloatArray
    """Entries of `KalmanState` of frequency (Hz) and bearing (degree) then, shape (piece,
    5, 2)."""
    noise_density: FloatArray
    """Spectral densities of the accelerations then, Hz^2/s^3 and degree^2/s^3, shape
    (piece, 2)."""

    @property
    def kalman(self) -> KalmanState:
        """States, entries of shape (2, piece)."""
        return KalmanState(*np.moveaxis(self.state, (-2, -1), (0, 1)))

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequency in Hz, shape (piece,)."""
        return self.state[..., 0, 0]

    @property
    def relative_variance(self) -> FloatArray:
        """Variance of the logarithm of the frequency, shape (piece,)."""
        return np.asarray(self.state[..., 2, 0] / self.frequency_hz**2)


NO_ENDS = PieceEnds(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 5, 2)), np.zeros((0, 2)))
"""No pieces."""


def bearing_distance(before: KalmanState, now: KalmanState) -> FloatArray:
    """Squared difference of bearings over its variance; 0 where one is unknown."""
    variance = before.variance[1] + now.variance[1]
    turn = wrap_deg(now.position[1] - before.position[1])
    return np.where(variance < UNKNOWN_BEARING_VARIANCE, turn**2 / variance, 0.0)


def course_distance(
    one: KalmanState, two: KalmanState, least_std_hz: float, least_rate_std_hzps: float
) -> tuple[FloatArray, FloatArray]:
    """Return how far two courses at one time are apart, and how well that is known.

    Entries of states are those of frequency alone, of any shapes that broadcast; deviations
    are floors. Returns the squared distance over its variance, and the determinant of
    the covariance of the difference of frequencies and rates, Hz^4/s^2.
    """
    variance = one.variance + two.variance + least_std_hz**2
    rate_variance = one.rate_variance + two.rate_variance + least_rate_std_hzps**2
    covariance = one.covariance + two.covariance
    determinant = variance * rate_variance - covariance**2
    off, slip = two.position - one.position, two.rate - one.rate
    square = rate_variance * off**2 - 2.0 * covariance * off * slip + variance * slip**2
    return square / determinant, determinant


def log_ratio_of_return(
    ends: PieceEnds, begins: PieceEnds, resolution_hz: float, strangers_per_hz: float | FloatArray
) -> FloatArray:
    """Logarithm of "the same line after a silence" over "a stranger", shape (end, begin).

    Strangers begin with a density along frequency, 1/Hz: a single one, or one for each
    beginning. The resolution is that of a frame, Hz.
    """
    old, now = ends.take(np.arange(ends.line.size)[:, None]), begins.kalman
    gap_s = np.maximum(begins.time_s - old.time_s, 0.0)
    ahead = predict(old.kalman, gap_s, np.moveaxis(old.noise_density, -1, 0))
    expected, found = (KalmanState(*(entry[0] for entry in state)) for state in (ahead, now))
    least_rate_std_hzps = LEAST_RATE_STD * resolution_hz**2
    square, determinant = course_distance(
        expected, found, LEAST_STD * resolution_hz, least_rate_std_hzps
    )
    # most lines are steady: the rate of a stranger is known as well as it can be
    square = square + np.log(2.0 * np.pi * determinant / least_rate_std_hzps**2)
    log_prior = np.log(RETURNING / strangers_per_hz)
    return np.asarray(log_prior - 0.5 * (square + bearing_distance(ahead, now)))


def log_ratio_of_turn(
    ends: PieceEnds,
    begins: PieceEnds,
    now: KalmanState,
    resolution_hz: float,
    strangers_per_hz: float,
) -> FloatArray:
    """Logarithm of "the same line with another rate" over "a stranger", shape (end, begin).

    Shapes of ends and beginnings broadcast; ``now`` are states that know the new rates,
    entries of shape (2, begin).
    """
    before, begin = ends.kalman, begins.kalman
    gap_s = np.maximum(begins.time_s - ends.time_s, 0.0)
    # it went on for an unknown part of the gap, and with the new rate for the rest
    between = (now.rate[0] - before.rate[0]) * gap_s
    doubt = 0.25 * (before.rate_variance[0] + now.rate_variance[0]) * gap_s**2
    spread = before.variance[0] + begin.variance[0] + between**2 / 12.0 + doubt
    spread = spread + (LEAST_STD * resolution_hz) ** 2
    off = begin.position[0] - before.position[0] - 0.5 * (before.rate[0] + now.rate[0]) * gap_s
    square = off**2 / spread + np.log(2.0 * np.pi * spread) + bearing_distance(before, begin)
    log_ratio = np.log(RETURNING * TURNING / strangers_per_hz) - 0.5 * square
    # it begins at once, where strangers begin at any time
    wait_s = TURN_WINDOWS / resolution_hz
    latest_s = begins.time_s.max(axis=1, keepdims=True)
    return np.asarray(log_ratio + np.log(np.maximum(latest_s / wait_s, 1.0)) - gap_s / wait_s)


def stitched(gain: FloatArray, least: float) -> list[tuple[int, int]]:
    """Return pairs (end, beginning), the best first, of which each gains more than a least.

    Examples
    --------
    >>> stitched(np.array([[2.0, 5.0], [0.0, 4.0]]), 1.0)
    [(0, 1)]
    """
    gain = gain.copy()
    pairs = []
    while gain.size and gain.max() > least:
        old, new = np.unravel_index(int(gain.argmax()), gain.shape)
        pairs.append((int(old), int(new)))
        gain[old], gain[:, new] = -np.inf, -np.inf
    return pairs


Through = Callable[[float], tuple[PieceEnds, PieceEnds]]
"""Returns the lines that run through a time, s, with a kink: before and after it."""


class FamilyJumps:
    """Finds lines that have ended and begun again where a jump has put them.

    Parameters
    ----------
    resolution_hz
        Resolution of a frame, Hz.
    """

    def __init__(self, resolution_hz: float) -> None:
        self.resolution_hz = resolution_hz
        self.told: list[FamilyJump] = []

    def rename(self, line: int, number: int) -> None:
        """Enter a line under the number of one that it continues."""
        for jump in self.told:
            if line in jump.lines:
                jump.lines.remove(line)
                jump.lines.add(number)

    def find(
        self, ends: PieceEnds, begins: PieceEnds, through: Through | None = None
    ) -> tuple[float, list[tuple[int, int]]] | None:
        """Return the time of a jump, s, and its pairs (end, beginning).

        None if chance explains all ratios.

        One that was not known before is added to those that are told.
        """
        if not (ends.line.size and begins.line.size):
            return None
        old = ends.take(np.arange(ends.line.size)[:, None])
        wait = (begins.time_s - old.time_s) * self.resolution_hz
        may_be = bearing_distance(old.kalman, begins.kalman) < BEARING_SIGMAS**2
        may_be &= old.line != begins.line  # a short one ends soon after it has begun
        for jump in self.told:
            is_end, is_begin = (
                np.abs(pieces.time_s - jump.time_s) * self.resolution_hz < LATE_WINDOWS
                for pieces in (ends, begins)
            )
            place = ends.frequency_hz * jump.ratio
            pairs = self._paired(place, begins, may_be & np.outer(is_end, is_begin))
            if pairs:
                jump.lines.update(int(ends.line[i]) for i, _ in pairs)
                return jump.time_s, pairs
        may_be &= (wait > -BEFORE_WINDOWS) & (wait < AFTER_WINDOWS)
        if through is None:
            return self._new(ends, begins, may_be, ends.line.size)
        for at_s in begins.time_s[may_be.any(axis=0)].tolist():
            before, after = through(at_s)
            is_now = np.abs(begins.time_s - at_s) * self.resolution_hz < AFTER_WINDOWS
            is_one = np.pad(may_be & is_now, ((0, before.line.size),) * 2)
            same = np.arange(-before.line.size, 0)
            is_one[same, same] = True  # what runs through is known to be one
            whole = PieceEnds.join([ends, before]), PieceEnds.join([begins, after])
            if found := self._new(*whole, is_one, ends.line.size):
                return found
        return None

    def _new(
        self, ends: PieceEnds, begins: PieceEnds, may_be: BoolArray, n_ends: int
    ) -> tuple[float, list[tuple[int, int]]] | None:
        """Tell a jump, with its pairs of the first ends: the others run through."""
        pairs = self.common(ends, begins, may_be)
        ended = [pair for pair in pairs if pair[0] < n_ends]
        if not ended:
            return None
        old, new = np.array(pairs).T
        at_s = 0.5 * (ends.time_s[old] + begins.time_s[new])
        jump = told_jump(
            float(np.median(at_s[old < n_ends])),
            np.log(begins.frequency_hz[new] / ends.frequency_hz[old]),
            ends.relative_variance[old] + begins.relative_variance[new],
            set(ends.line[old].tolist()),
        )
        self.told.append(jump)
        return jump.time_s, ended

    def common(
        self, ends: PieceEnds, begins: PieceEnds, may_be: BoolArray
    ) -> list[tuple[int, int]]:
        """Return pairs (end, beginning) of the ratio of most lines; none by chance.

        ``may_be`` says of each pair whether times and bearings allow that it is one line,
        shape (end, beginning).
        """
        from scipy.special import bdtrc

        ratio = begins.frequency_hz / ends.frequency_hz[:, None]
        # what wanders about zero has no ratio
        log_ratio = np.log(np.where(ratio > 0.0, ratio, np.nan))
        may_be = may_be & (np.abs(log_ratio) < GREATEST_JUMP)
        reach_hz = REACH * self.resolution_hz
        frequency = np.sort(begins.frequency_hz)
        span = frequency[-1] - frequency[0] + self.resolution_hz
        share = min(1.0, 2.0 * reach_hz * frequency.size / span)
        wait = np.abs(ends.time_s[:, None] - ends.time_s) * self.resolution_hz
        is_mate = (wait < AFTER_WINDOWS) & may_be.any(axis=1)
        n_others = np.count_nonzero(is_mate, axis=1) - 1
        best: list[tuple[int, int]] = []
        least = GREATEST_CHANCE
        seeds = np.argwhere(may_be)
        for part in np.split(seeds, range(_SEEDS, len(seeds), _SEEDS)):
            old = part[:, 0]
            place = ends.frequency_hz * np.exp(log_ratio[old, part[:, 1]])[:, None]
            begin = frequency.searchsorted(place - reach_hz, "right")
            has_new = frequency.searchsorted(place + reach_hz) > begin
            # no more of them pair, and few are far more than chance
            most = np.count_nonzero(has_new & is_mate[old], axis=1)
            least_chance = len(seeds) * bdtrc(most - 2.0, n_others[old], share)
            hopeful = (most >= FEWEST_LINES) & (least_chance < least)
            for seed in np.flatnonzero(hopeful).tolist():
                mates = may_be & is_mate[old[seed], :, None]
                pairs = self._paired(place[seed], begins, mates)
                tail = bdtrc(len(pairs) - 2.0, n_others[old[seed]], share)
                if len(pairs) >= FEWEST_LINES and len(seeds) * tail < least:
                    best, least = pairs, len(seeds) * float(tail)
        return best

    def _paired(
        self, place_hz: FloatArray, begins: PieceEnds, may_be: BoolArray
    ) -> list[tuple[int, int]]:
        """Pair ends, moved to their places, with the nearest beginnings in reach."""
        away = np.abs(begins.frequency_hz - place_hz[:, None])
        return stitched(np.where(may_be, -away, -np.inf), -REACH * self.resolution_hz)


def told_jump(
    time_s: float, log_ratio: FloatArray, variance: FloatArray, lines: set[int]
) -> FamilyJump:
    """Return the common ratio of some lines, as it is told of a jump at a time, s.

    ``log_ratio`` holds the logarithm of the ratio of each line and ``variance`` its
    variance, shape (line,).
    """
    weight = 1.0 / variance
    mean = float((weight * log_ratio).sum() / weight.sum())
    excess = float((weight * (log_ratio - mean) ** 2).sum()) / (log_ratio.size - 1)
    std = np.sqrt(max(excess, 1.0) / weight.sum())
    return FamilyJump(time_s, float(np.exp(mean)), float(np.exp(mean) * std), lines)
