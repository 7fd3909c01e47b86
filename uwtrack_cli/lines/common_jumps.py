"""Ratios by which the lines of a machine jump together when it changes its speed at once.

**Method.** Among lines that fell silent and lines that began at that time the ratio is
sought with which most of them pair; it is taken when strangers, who could begin anywhere
between the lowest and the highest of the new ones, would hardly pair as often (a number
of false alarms).

**References.** Desolneux, Moisan & Morel (2008) for the number of false alarms.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.lines.line_points import FamilyJump

GREATEST_JUMP = 0.08
"""Greatest relative change of the rate: beyond it the orders of the lines are unknown."""

BEFORE_WINDOWS, AFTER_WINDOWS = 12.0, 6.0
"""Windows by which a line may begin before the last peak of the one that it continues
(noise peaks began it), and after it (it was found late)."""

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
class JumpCandidates:
    """Lines that fell silent, and those that they may have become."""

    before_hz: FloatArray
    """Frequencies at the ends of the silent lines, Hz, shape (silent,)."""
    before_s: FloatArray
    """Times of these ends, s, shape (silent,)."""
    now_hz: FloatArray
    """Frequencies of the new lines, Hz, shape (new,)."""
    may_be: BoolArray
    """Whether times and bearings allow that they are one, shape (silent, new)."""
    resolution_hz: float
    """Resolution of a frame, Hz."""

    @property
    def log_ratio(self) -> FloatArray:
        """Logarithms of the ratios of all pairs, shape (silent, new)."""
        ratio = self.now_hz / self.before_hz[:, None]
        # what wanders about zero has no ratio
        return np.log(np.where(ratio > 0.0, ratio, np.nan))

    def common(self) -> list[tuple[int, int]]:
        """Return pairs (silent, new) of the ratio of most lines; none by chance."""
        from scipy.special import bdtrc

        log_ratio = self.log_ratio
        may_be = self.may_be & (np.abs(log_ratio) < GREATEST_JUMP)
        reach_hz = REACH * self.resolution_hz
        frequency = np.sort(self.now_hz)
        span = frequency[-1] - frequency[0] + self.resolution_hz
        share = min(1.0, 2.0 * reach_hz * frequency.size / span)
        wait = np.abs(self.before_s[:, None] - self.before_s) * self.resolution_hz
        is_mate = (wait < AFTER_WINDOWS) & may_be.any(axis=1)
        n_others = np.count_nonzero(is_mate, axis=1) - 1
        best: list[tuple[int, int]] = []
        least = GREATEST_CHANCE
        seeds = np.argwhere(may_be)
        for part in np.split(seeds, range(_SEEDS, len(seeds), _SEEDS)):
            old = part[:, 0]
            place = self.before_hz * np.exp(log_ratio[old, part[:, 1]])[:, None]
            begin = frequency.searchsorted(place - reach_hz, "right")
            has_new = frequency.searchsorted(place + reach_hz) > begin
            # no more of them pair, and few are far more than chance
            most = np.count_nonzero(has_new & is_mate[old], axis=1)
            least_chance = len(seeds) * bdtrc(most - 2.0, n_others[old], share)
            hopeful = (most >= FEWEST_LINES) & (least_chance < least)
            for seed in np.flatnonzero(hopeful).tolist():
                mates = may_be & is_mate[old[seed], :, None]
                pairs = self.paired(place[seed], mates)
                tail = bdtrc(len(pairs) - 2.0, n_others[old[seed]], share)
                if len(pairs) >= FEWEST_LINES and len(seeds) * tail < least:
                    best, least = pairs, len(seeds) * float(tail)
        return best

    def paired(self, place_hz: FloatArray, may_be: BoolArray) -> list[tuple[int, int]]:
        """Pair silent lines, moved to their places, with the nearest new ones in reach.

        Places in Hz have the shape (silent,), the pairs that are allowed (silent, new).
        """
        away = np.abs(self.now_hz - place_hz[:, None])
        away = np.where(may_be, away, np.inf)
        pairs = []
        while away.size and away.min() < REACH * self.resolution_hz:
            old, new = np.unravel_index(int(away.argmin()), away.shape)
            pairs.append((int(old), int(new)))
            away[old], away[:, new] = np.inf, np.inf
        return pairs


def told_jump(time_s: float, log_ratio: FloatArray, variance: FloatArray) -> FamilyJump:
    """Return the common ratio of some lines, as it is told of a jump at a time, s.

    ``log_ratio`` holds the logarithm of the ratio of each line and ``variance`` its
    variance, shape (line,).
    """
    weight = 1.0 / variance
    mean = float((weight * log_ratio).sum() / weight.sum())
    excess = float((weight * (log_ratio - mean) ** 2).sum()) / (log_ratio.size - 1)
    std = np.sqrt(max(excess, 1.0) / weight.sum())
    return FamilyJump(time_s, float(np.exp(mean)), float(np.exp(mean) * std), set())
