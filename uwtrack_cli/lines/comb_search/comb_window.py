"""Find the combs of a window: the likeliest first, each taken out when it is found.

**Method.** Of all fundamentals and drifts (`comb_grid`) the comb with the most evidence
is taken, if noise and strays do not explain it; so the fundamental, half of it and twice
are compared by what their silent teeth cost. Its path is the sum over all paths beside the
straight drift of what all sounding teeth say together (a hidden Markov model, forward and
backward). Then its teeth are taken out as wide as they leak, and the rest is searched
again. What combs out of tune score in the same window, which no machine has, tells by how
much its noise and its stray lines exceed white noise.

**Conventions.** Frequencies in Hz, evidence in nepers; arrays have the shape (frame,
tooth) or (frame, state).

**References.** Streit & Barrett, IEEE Trans. ASSP 38(4), 586-598 (1990), for lines as
hidden Markov models; Theiler et al., Physica D 58, 77-94 (1992), for surrogates.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.window import cell_correlation, parabola_offset
from uwtrack_cli.lines.comb_search.comb_grid import (
    FEWEST_TEETH,
    CombGrid,
    comb_scores,
    sounding_range,
)
from uwtrack_cli.lines.comb_search.tooth_table import (
    SOUNDING,
    cell_evidence,
    tooth_levels,
    tooth_table,
)
from uwtrack_cli.lines.sensitivity import amplitude_log_ratio

MOST_COMBS = 8
"""Combs that are sought in a window."""

OUT_OF_TUNE = (0.25, 0.45)
"""Shares of the spacing by which a tooth is moved in combs that no machine has."""

SURROGATES = 3
"""Ways to be out of tune that are tried in a window."""

BESIDE_CELLS = 6.0
"""Cells at the highest tooth by which a path may leave its straight drift."""

STATE_CELLS = 0.5
"""Cells at the highest tooth from one state of a path to the next."""

MOVE_PROBABILITY = 0.05
"""Probability of a move by one state from frame to frame, to either side."""

MASK_BINS = 2.5
"""Natural bins to either side of a tooth that it leaks into (Harris 1978)."""

END_GAIN = 2.0
"""Evidence, nepers, with which frames must speak against a comb to be left out."""

MOST_MULTIPLE = 5
"""Greatest multiple of the likeliest fundamental that is held against it."""

NEAR_SHARE = 2e-3
"""Share of the fundamental within which that multiple is sought."""

FINER = 2.5
"""Evidence, nepers, that the teeth between those of a multiple must add: of half, third and
other parts of a true fundamental one always finds a tooth of noise."""

LOUD_SIGMAS = 4.0
"""Deviations of the noise's mean power from which a tooth has a place of its own."""

TOOTH_CELLS = 0.2
"""Deviation, in cells, of the place of a tooth: machines do not turn evenly."""

STRAY_CELLS = 3.0
"""Cells in which a stray line is taken for a tooth, wherever in them it is."""

STRAY_TOOTH = 0.1
"""Share of the teeth of a comb that are strays."""

FITTED = 1.5
"""Evidence, nepers, that an unknown gains by being fitted to the places of teeth."""

LENGTHENINGS = 3
"""How often a comb that was found is followed on to higher teeth."""

KNOWN_CELLS = 0.75
"""Deviation in cells up to which it is known where a tooth is."""

DOUBT = 1.0
"""Evidence, nepers, that a tooth has at least to be counted as one."""


@dataclass(frozen=True)
class FoundComb:
    """A comb in a window."""

    fundamental_hz: FloatArray
    """Its fundamental in every frame, shape (frame,)."""
    fundamental_std_hz: FloatArray
    """Its standard deviation, shape (frame,)."""
    teeth: IntArray
    """Numbers of the teeth that sound, ascending, shape (tooth,)."""
    log_odds: FloatArray
    """Evidence of every tooth from the first on, nepers, shape (all teeth,)."""
    strength: FloatArray
    """Mean power over noise in the cell of each sounding tooth, shape (tooth,)."""
    evidence: float
    """Evidence of the comb, nepers."""
    first: int
    """First frame in which it sounds."""
    stop: int
    """Frame after the last one in which it sounds."""

    @property
    def middle_hz(self) -> float:
        """Mean fundamental, Hz."""
        return float(self.fundamental_hz.mean())

    @property
    def middle_std_hz(self) -> float:
        """Its standard deviation, Hz, but for what the path wanders."""
        return float(self.fundamental_std_hz.mean())


class _Place(NamedTuple):
    """Where a comb is among all that are asked for."""

    fundamental_hz: float
    """Its fundamental in the middle of the window, Hz."""
    drift: float
    """Its relative change over the window."""
    n_teeth: int
    """Highest tooth that is asked for."""
    evidence: float
    """Its evidence, nepers."""


def independent_share(hop_windows: float) -> float:
    """Return the share of overlapping frames that are as good as independent."""
    total, lag = 1.0, 1
    while lag * hop_windows < 1.0:
        total += 2.0 * cell_correlation(0.0, lag * hop_windows)
        lag += 1
    return 1.0 / total


class CombWindow:
    """One window of cells, searched for combs.

    Parameters
    ----------
    power_ratio
        Power over noise, nan in a gap, shape (frame, cell); a power of two of frames.
    grid
        The combs that are asked for.
    hop_windows
        Distance of two frames in lengths of a frame.
    bin_cells
        Cells per natural bin.
    """

    def __init__(
        self, power_ratio: FloatArray, grid: CombGrid, hop_windows: float, bin_cells: int
    ) -> None:
        self.ratio, self.grid, self.bin_cells = power_ratio, grid, bin_cells
        self.hop_windows = hop_windows
        self.independent = independent_share(hop_windows)
        self.n_frames = len(power_ratio)
        self.levels = tooth_levels(self.n_frames * self.independent)
        self.evidence = cell_evidence(power_ratio, self.levels, self.independent)
        self._tabulate()

    @property
    def n_known(self) -> int:
        """Frames in which there is sound."""
        return int(np.count_nonzero(np.isfinite(self.ratio).any(axis=1)))

    def _tabulate(self) -> None:
        self.table, self.stray = tooth_table(self.evidence, self.grid.most_cells, self.bin_cells)

    def surrogate(self, seed: int) -> float:
        """Return the mean of the best evidence of combs whose teeth are out of tune.

        Of every third fundamental, by several ways to be out of tune.
        """
        rng = np.random.default_rng([seed])
        most = max(band.n_teeth for band in self.grid.bands)
        best = np.full(SURROGATES, -np.inf)
        for k in range(SURROGATES):
            shift = rng.uniform(*OUT_OF_TUNE, most) * rng.choice([-1.0, 1.0], most)
            for band in self.grid.bands:
                some = replace(band, fundamental_hz=band.fundamental_hz[k::SURROGATES])
                if some.fundamental_hz.size:
                    scores = comb_scores(self.grid, some, self.table, shift)
                    best[k] = max(best[k], float(scores.max()))
        return float(best.mean())

    def take_expected(self, fundamental_hz: float, std_hz: float, least: float) -> FoundComb | None:
        """Find a comb that is expected in the middle of the window, within deviations.

        None where its evidence is less than ``least``, nepers.
        """
        return self._take(least, (fundamental_hz - std_hz, fundamental_hz + std_hz))

    def take_best(self, least: float) -> FoundComb | None:
        """Find the comb with the most evidence; None where that is less than ``least``."""
        return self._take(least, (0.0, np.inf))

    def _take(self, least: float, within_hz: tuple[float, float]) -> FoundComb | None:
        best = self._best(within_hz)
        if best is None or best.evidence < least:
            return None
        fundamental = best.fundamental_hz
        if within_hz[0] == 0.0:  # a multiple of it, unless what it adds is worth it
            for multiple in range(2, MOST_MULTIPLE + 1):
                around = NEAR_SHARE * fundamental
                middle = multiple * fundamental
                coarser = self._best((middle - around, middle + around))
                if coarser is not None and coarser.evidence > best.evidence - FINER:
                    best = coarser
        found = self._measured(best)
        self._mask(found)
        return found

    def _best(self, within_hz: tuple[float, float]) -> _Place | None:
        """Return the likeliest comb of fundamentals between two, Hz; None without any."""
        best: _Place | None = None
        for band in self.grid.bands:
            inside = (band.fundamental_hz >= within_hz[0]) & (band.fundamental_hz <= within_hz[1])
            if not inside.any():
                continue
            own = replace(band, fundamental_hz=band.fundamental_hz[inside])
            scores = comb_scores(self.grid, own, self.table, None)
            row, column = np.unravel_index(int(scores.argmax()), scores.shape)
            if best is None or scores[row, column] > best.evidence:
                best = _Place(
                    float(own.fundamental_hz[column]), float(own.drift[row]),
                    own.n_teeth, float(scores[row, column]),
                )  # fmt: skip
        return best

    def tooth_evidence(self, fundamental_hz: float, drift: float, n_teeth: int) -> FloatArray:
        """Return the evidence of each tooth of a comb, shape (tooth,)."""
        # a path that was refined may drift more than is asked for, and is not in the table
        most = max(float(band.drift[-1]) for band in self.grid.bands)
        drift = float(np.clip(drift, -most, most))
        frequency = fundamental_hz * np.arange(1.0, n_teeth + 1.0)
        place = self.grid.places(frequency, np.array([drift]), 1.0)[0]
        return np.asarray(self.table.reshape(-1).take(place), float)

    def _measured(self, place: _Place) -> FoundComb:
        """Measure a comb along its path, and follow its teeth up as far as it is known."""
        fundamental_hz, drift, n_teeth, _ = place
        evidence = self.tooth_evidence(fundamental_hz, drift, n_teeth)
        first, last, total = sounding_range(evidence)
        rise = (np.arange(self.n_frames) + 0.5) / self.n_frames - 0.5
        for lengthening in range(LENGTHENINGS + 1):
            number = np.arange(1, evidence.size + 1)
            sounds = (number >= first) & (evidence > np.where(number > last, DOUBT, 0.0))
            if not sounds.any():  # where it was refined to, noise was all there was
                sounds = (number >= first) & (number <= last)
            teeth = number[sounds]
            weight = 1.0 - (1.0 - SOUNDING) * np.exp(-np.minimum(evidence[sounds], 30.0))
            straight = fundamental_hz * (1.0 + drift * rise)
            path, std = self._path(straight, teeth, weight)
            slope, fundamental_hz = (float(v) for v in np.polyfit(rise, path, 1))
            drift = slope / fundamental_hz
            highest = self.grid.first_hz + self.grid.cell_hz * self.grid.n_cells
            known = KNOWN_CELLS * self.grid.cell_hz / float(std.mean())
            n_known = max(int(min(highest / fundamental_hz, known)), n_teeth)
            is_settled = lengthening > 0 and n_known <= evidence.size
            if is_settled or lengthening == LENGTHENINGS:
                break
            evidence = self.tooth_evidence(fundamental_hz, drift, n_known)
        ratio = self._along(path, teeth)
        strength = np.maximum(_frame_mean(ratio) - 1.0, 0.02)
        begin, stop = self._ends(ratio, strength, weight)
        total += self._agreement(path, teeth)
        return FoundComb(
            path, std, teeth, np.where(sounds, evidence, np.minimum(evidence, 0.0)),
            strength, total, begin, stop,
        )  # fmt: skip

    def _cells(self, frequency_hz: FloatArray) -> IntArray:
        cell = np.rint((frequency_hz - self.grid.first_hz) / self.grid.cell_hz)
        return np.asarray(np.clip(cell, 0, self.grid.n_cells - 1), np.int64)

    def _along(self, path_hz: FloatArray, teeth: IntArray) -> FloatArray:
        """Return the power over noise along teeth, shape (frame, tooth)."""
        cells = self._cells(path_hz[:, None] * teeth)
        return np.take_along_axis(self.ratio, cells, axis=1).astype(float)

    def _agreement(self, path_hz: FloatArray, teeth: IntArray) -> float:
        """Return what the places of loud teeth say for one comb against strays, nepers."""
        place = (path_hz[:, None] * teeth - self.grid.first_hz) / self.grid.cell_hz
        cell = np.clip(np.rint(place), 2, self.grid.n_cells - 3).astype(np.int64)
        mean = np.array(
            [_frame_mean(np.take_along_axis(self.ratio, cell + k, axis=1)) for k in range(-2, 3)]
        )
        snr = np.maximum(mean[1:4].max(axis=0) - 1.0, 1e-3)
        noise = 1.0 / np.sqrt(max(self.n_known * self.independent, 1.0))
        is_loud = snr > LOUD_SIGMAS * noise
        if not is_loud.any():
            return 0.0
        logs = np.log(np.maximum(mean[:, is_loud], 1e-6))
        peak = 1 + logs[1:4].argmax(axis=0)
        column = np.arange(peak.size)
        sides = [logs[peak + k, column] for k in (-1, 0, 1)]
        off = peak - 2 + parabola_offset(*sides)
        off -= (place - cell).mean(axis=0)[is_loud]
        std = np.hypot(TOOTH_CELLS, noise * (1.0 + 1.0 / snr[is_loud]))
        density = np.exp(-0.5 * (off / std) ** 2) / (np.sqrt(2.0 * np.pi) * std)
        ratio = STRAY_TOOTH + (1.0 - STRAY_TOOTH) * STRAY_CELLS * density
        unknowns = min(2, off.size)  # fundamental and drift were fitted to them
        return float(np.log(ratio).sum() - FITTED * unknowns)

    def _path(
        self, straight_hz: FloatArray, teeth: IntArray, weight: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and deviation of the fundamental in each frame, Hz."""
        step = STATE_CELLS * self.grid.cell_hz / (teeth[-1] * straight_hz.mean())
        n_beside = round(BESIDE_CELLS / STATE_CELLS)
        beside = np.arange(-n_beside, n_beside + 1)
        ratio = self._along(straight_hz, teeth)
        level = np.maximum(_frame_mean(ratio) - 1.0, self.levels[0])
        emission = np.zeros((self.n_frames, beside.size))
        for tooth, own, share in zip(teeth, level, weight, strict=True):
            frequency = tooth * straight_hz[:, None] * (1.0 + step * beside)
            here = self._between_cells(frequency)
            gain = share * amplitude_log_ratio(here, float(own))
            emission += self.independent * np.nan_to_num(gain, nan=0.0)
        offset, variance = _smoothed_states(emission)
        variance += 1.0 / 12.0
        scale = straight_hz * step
        return straight_hz + scale * offset, scale * np.sqrt(variance)

    def _between_cells(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the power over noise at any frequency, (frame, state).

        By a parabola through the logarithms of three cells: Hann's main lobe is nearly one.
        """
        place = (frequency_hz - self.grid.first_hz) / self.grid.cell_hz
        cell = np.clip(np.rint(place), 1, self.grid.n_cells - 2).astype(np.int64)
        off = np.clip(place - cell, -0.5, 0.5)
        left, middle, right = (
            np.log(np.maximum(np.take_along_axis(self.ratio, cell + k, axis=1), 1e-3))
            for k in (-1, 0, 1)
        )
        bend = 0.5 * (left + right) - middle
        return np.asarray(np.exp(middle + off * (0.5 * (right - left) + off * bend)))

    def _ends(self, ratio: FloatArray, strength: FloatArray, weight: FloatArray) -> tuple[int, int]:
        """Return the frames between which the comb sounds."""
        gain = amplitude_log_ratio(ratio, strength[None, :]) * weight * self.independent
        total = np.concatenate([[0.0], np.nansum(gain, axis=1).cumsum()])
        lowest = np.minimum.accumulate(total)
        stop = int(np.argmax(total[1:] - lowest[:-1])) + 1
        first = int(np.argmin(total[:stop]))
        if total[first] > -END_GAIN:
            first = 0
        if total[-1] - total[stop] > -END_GAIN:
            stop = self.n_frames
        return first, stop

    def _mask(self, comb: FoundComb) -> None:
        """Take the teeth of a comb out of the window, as wide as they leak."""
        for tooth, strength in zip(comb.teeth, comb.strength, strict=True):
            bins = max(MASK_BINS, 2.4 * (strength * 10.0**-3.1) ** (1.0 / 3.0))
            half = min(int(np.ceil(bins * self.bin_cells)), self.grid.n_cells // 4)
            cells = self._cells(tooth * comb.fundamental_hz)[:, None]
            cells = np.clip(cells + np.arange(-half, half + 1), 0, self.grid.n_cells - 1)
            rows = np.arange(self.n_frames)[:, None]
            self.evidence[:, rows, cells] = 0.0
        self._tabulate()


def is_comb(comb: FoundComb, least: float) -> bool:
    """Tell whether a comb has three teeth, and passes a threshold without its loudest.

    ``least`` in nepers.
    """
    loudest = float(comb.log_odds.max())
    n_sure = np.count_nonzero(comb.log_odds > DOUBT)
    return bool(n_sure >= FEWEST_TEETH and comb.evidence - loudest >= least)


def _frame_mean(ratio: FloatArray) -> FloatArray:
    """Return the mean over the frames that are known, shape (tooth,)."""
    known = np.isfinite(ratio)
    total = np.where(known, ratio, 0.0).sum(axis=0)
    return np.asarray(total / np.maximum(known.sum(axis=0), 1))


def _smoothed_states(emission: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the state of each frame, shape (frame,).

    Emissions are log-likelihood ratios, shape (frame, state); a state may move by one.
    """
    n_frames = len(emission)
    likelihood = np.exp(emission - emission.max(axis=1, keepdims=True)) + 1e-12
    forward = np.empty_like(likelihood)
    backward = np.ones_like(likelihood)
    forward[0] = likelihood[0] / likelihood[0].sum()
    for k in range(1, n_frames):
        forward[k] = _spread(forward[k - 1]) * likelihood[k]
        forward[k] /= forward[k].sum()
    for k in range(n_frames - 2, -1, -1):
        backward[k] = _spread(backward[k + 1] * likelihood[k + 1])
        backward[k] /= backward[k].sum()
    both = forward * backward
    both /= both.sum(axis=1, keepdims=True)
    state = np.arange(emission.shape[1]) - 0.5 * (emission.shape[1] - 1)
    mean = both @ state
    return mean, np.maximum(both @ state**2 - mean**2, 0.0)


def _spread(probability: FloatArray) -> FloatArray:
    """Carry the probabilities of states on by one frame."""
    out = (1.0 - 2.0 * MOVE_PROBABILITY) * probability
    out[1:] += MOVE_PROBABILITY * probability[:-1]
    out[:-1] += MOVE_PROBABILITY * probability[1:]
    return np.asarray(out)
