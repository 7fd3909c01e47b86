"""Combs over windows: found in each, continued to the next, let out as lines.

**Method.** Windows overlap by one half. A comb of the last window is sought first, where
its path leads; then others. What its teeth have said so far decides which of them are
lines. Of each window the middle half is final, with the begin of a comb that is new and
the rest of one that is not continued. Every tooth is a line: one of its own strength is
measured where its peak is, one too weak for that lies on its multiple of the common path,
with the deviation that it would have alone: so all teeth together say of the fundamental
what was heard of it, and no more.

The greatest evidence of a window of noise grows with the logarithm of the
combs that are asked for, and its tail is exponential. What combs out of tune reach in the
recording beyond that, by its stray lines and the shape of its noise, is a mean over the
windows so far. Thresholds are raised by it.

**Conventions.** Windows are counted in frames from the first, so blocks do not matter.

Evidence in nepers; rates are of combs an hour, at any fundamental.

**References.** See `lines.comb_search.comb_window`; Gumbel, "Statistics of Extremes" (1958), for the tail.
"""

from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import DETECTED, SUB_THRESHOLD
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.estimation.window import frequency_std_hz
from uwtrack_cli.lines.comb_search.comb_grid import CombGrid, comb_grid
from uwtrack_cli.lines.comb_search.comb_window import MOST_COMBS, CombWindow, FoundComb, is_comb
from uwtrack_cli.lines.contacts import (
    CORRELATION_WINDOWS,
    UNRESOLVED_BINS,
    ContactSamples,
    group_lines,
    unresolved_share,
)
from uwtrack_cli.lines.families.lasting_families import no_families
from uwtrack_cli.lines.line_points import LinePoints, LineTable
from uwtrack_cli.lines.paths.path_search import whitened
from uwtrack_cli.lines.paths.trace_window import WindowData, Windows, measure, smooth_paths
from uwtrack_cli.lines.sensitivity import weakest_by_path
from uwtrack_cli.lines.tracker_options import ProcessNoise
from uwtrack_cli.lines.tracking.track_store import UNKNOWN_BEARING_VARIANCE

FEWEST_FRAMES, LEAST_FILLED = 8, 0.25
"""Frames with sound, and their share of a window, below which no comb is sought there: so
few do not tell teeth from what noise does for some seconds."""

PLACES_GAIN = 3.0
"""Evidence, nepers, that the places of few loud teeth may add to that of their cells."""

REACH_CELLS = 4.0
"""Cells at the highest tooth within which a comb is expected in the next window."""

OWN_PEAK_SNR = 1.6
"""Mean power ratio of a tooth from which its own peak is measured (2 dB), as in
`lines.paths.trace_window`."""

MOST_RATIO, MOST_PARTS = 8, 4
"""Greatest whole number in the ratio of two fundamentals of one machine, and greatest
denominator."""

SAME_SIGMAS, LEAST_SHARE, MOST_SHARE = 3.0, 1e-3, 2e-3
"""Deviations by which fundamentals may miss such a ratio, and limits of that as a share."""

MEMORY = 0.5
"""Share of what a tooth has said that counts in the next window: they overlap by half."""


@dataclass(frozen=True)
class CombSearch:
    """Options of the search, and what follows from them and the recording."""

    false_combs_per_hour: float
    """Combs that noise alone may cause in an hour."""
    window_frames: int
    """Frames that are searched together, a power of two."""
    fundamental_hz: tuple[float, float]
    """Least and greatest fundamental, Hz."""
    n_teeth: int
    """Highest tooth that is asked for."""
    most_drift_ps: float
    """Greatest relative change of a fundamental in a second."""
    band_hz: tuple[float, float]
    """Lowest and highest frequency searched, Hz."""
    motion: ProcessNoise
    """How fast bearings may change."""


@dataclass(eq=False)
class _Comb:
    """A comb that has been found."""

    family: int
    """Its number."""
    first_frame: int
    """Frame in which it was heard first."""
    least: float
    """Threshold of the window in which it was found first, nepers."""
    odds: dict[int, float] = field(default_factory=dict)
    """What each of its teeth has said, nepers."""
    voices: set[int] = field(default_factory=lambda: {1})
    """Multiples of its fundamental that were found as combs."""
    lines: dict[int, int] = field(default_factory=dict)
    """Number of the line of each tooth."""
    evidence: list[float] = field(default_factory=list)
    """Its evidence in each window, nepers."""
    sums: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Sums of weight, weight times fundamental, and frames."""
    ahead_hz: float = 0.0
    """Fundamental in the middle of the next window, Hz."""
    reach_hz: float = 0.0
    """How far from there it may be, Hz."""
    pending: LinePoints = field(default_factory=lambda: LinePoints.join([]))
    """Points that leave with the next window, if it is not continued."""

    def divide(self, parts: int) -> None:
        """Take a part of its fundamental for it: its teeth get other numbers."""
        self.odds = {tooth * parts: own for tooth, own in self.odds.items()}
        self.lines = {tooth * parts: line for tooth, line in self.lines.items()}
        self.voices = {voice * parts for voice in self.voices}
        self.sums *= [parts**2, parts, 1.0]
        self.ahead_hz /= parts
        self.reach_hz /= parts


@dataclass(frozen=True)
class _Heard:
    """A comb in a window, by one multiple of its fundamental."""

    comb: _Comb
    """The comb."""
    voice: int
    """Which multiple."""
    own: FoundComb
    """What was found."""


class CombTracker:
    """Takes blocks of spectrogram, finds the combs of each window, lets points out."""

    def __init__(self, rule: CombSearch, first: Spectrogram) -> None:
        self.rule = rule
        self.reference = first.reference
        frames = first.frames
        self.bin_hz = 1.0 / frames.window_s
        self.bin_cells = frames.cells_per_bin
        self.hop_s = frames.hop_s
        self.windows = Windows(first, rule.band_hz, rule.window_frames)
        window_s = rule.window_frames * self.hop_s
        self.grid: CombGrid = comb_grid(
            first.frequency_hz[self.windows.chosen], self.bin_hz, rule.fundamental_hz, rule.n_teeth,
            rule.most_drift_ps * window_s,
        )  # fmt: skip
        self.threshold = CombThreshold(
            rule.false_combs_per_hour, self.grid.n_hypotheses, 0.5 * window_s
        )
        self.living: list[_Comb] = []
        self.combs: list[_Comb] = []
        self.next_line = 1
        self.samples = ContactSamples(max(1, round(1.0 / (self.bin_hz * self.hop_s))))

    def push(self, block: Spectrogram) -> tuple[Frames, LinePoints]:
        """Take a block; return its frames and the points that have become final."""
        windows = self.windows.push(block)
        parts = [part for data in windows for part in self._window(data, is_last=False)]
        return block.frames, self._noted(parts)

    def finish(self) -> LinePoints:
        """Search what is left and return all points still held."""
        rest = self.windows.rest()
        points = [] if rest is None else self._window(rest, is_last=True)
        points += [comb.pending for comb in self.living]
        self.living = []
        return self._noted(points)

    def _noted(self, parts: list[LinePoints]) -> LinePoints:
        points = LinePoints.join(parts).sorted()
        self.samples.add(points)
        return points

    def _window(self, data: WindowData, *, is_last: bool) -> list[LinePoints]:
        """Find the combs of a window, and let their final points out."""
        n_frames = data.frame.size
        lacking = self.rule.window_frames - n_frames
        # a window at the end is as long as the others, with nothing in the rest
        padded = np.pad(whitened(data), ((0, lacking), (0, 0)), constant_values=np.nan)
        window = CombWindow(padded, self.grid, self.hop_s * self.bin_hz, self.bin_cells)
        heard, gone = self._heard(window, int(data.frame[0]))
        quarter = self.rule.window_frames // 4
        begin = 0 if self.windows.is_first else quarter
        stop = n_frames if is_last else n_frames - quarter
        parts = [comb.pending for comb in gone]
        self.living = []
        for comb in dict.fromkeys(one.comb for one in heard):
            own = [one for one in heard if one.comb is comb]
            points = self._points(data, own)
            is_new = len(comb.evidence) == 1
            first = min(one.own.first for one in own) if is_new else begin
            frame = points.frame - data.frame[0]
            parts.append(points.take((frame >= first) & (frame < stop)))
            comb.pending = points.take(frame >= stop)
            self.living.append(comb)
        return parts

    def _heard(self, window: CombWindow, seed: int) -> tuple[list[_Heard], list[_Comb]]:
        """Return the combs of a window, and those that have ended."""
        if window.n_known < max(FEWEST_FRAMES, LEAST_FILLED * window.n_frames):
            return [], self.living
        heard = self._expected(window)
        there = {one.comb.family for one in heard}
        gone = [comb for comb in self.living if comb.family not in there]
        surrogate = window.surrogate(seed)
        for _ in range(MOST_COMBS):
            least = self.threshold.new(self.threshold.excess(surrogate))
            own = window.take_best(least - PLACES_GAIN)
            if own is None:
                break
            surrogate = window.surrogate(seed)
            left = self.threshold.remainder(self.threshold.excess(surrogate))
            if own.evidence >= least and is_comb(own, left):
                heard = self._with_new(heard, own, seed, least)
        self.threshold.note(surrogate)
        for comb in dict.fromkeys(one.comb for one in heard):
            self._continue(comb, [one for one in heard if one.comb is comb])
        return heard, gone

    def _expected(self, window: CombWindow) -> list[_Heard]:
        """Return the combs of the last window that are in this one, too."""
        threshold = self.threshold
        least = threshold.continued(threshold.excess(threshold.white_surrogate))
        heard: list[_Heard] = []
        for comb in sorted(self.living, key=lambda one: -one.evidence[-1]):
            for voice in sorted(comb.voices):
                own = window.take_expected(voice * comb.ahead_hz, voice * comb.reach_hz, least)
                if own is not None:
                    heard.append(_Heard(comb, voice, own))
        return heard

    def _with_new(
        self, heard: list[_Heard], own: FoundComb, seed: int, least: float
    ) -> list[_Heard]:
        """Add a comb to those of a window: of a machine that is there, or a new one."""
        for other in heard:
            ratio = _machine_ratio(own, other.own)
            if ratio is None:
                continue
            multiple = ratio * other.voice
            comb, parts = other.comb, multiple.denominator
            if max(multiple.numerator, parts * max(comb.voices)) > MOST_RATIO:
                continue
            comb.divide(parts)
            voice = int(multiple * parts)
            comb.voices.add(voice)
            again = [
                replace(one, voice=one.voice * parts) if one.comb is comb else one for one in heard
            ]
            return [*again, _Heard(comb, voice, own)]
        comb = _Comb(len(self.combs) + 1, seed + own.first, least)
        self.combs.append(comb)
        return [*heard, _Heard(comb, 1, own)]

    def _continue(self, comb: _Comb, heard: list[_Heard]) -> None:
        """Enter what a window says of a comb."""
        comb.odds = {tooth: MEMORY * own for tooth, own in comb.odds.items()}
        for one in heard:
            for number, own in enumerate(one.own.log_odds.tolist(), start=1):
                tooth = number * one.voice
                comb.odds[tooth] = comb.odds.get(tooth, 0.0) + own
        comb.evidence.append(sum(one.own.evidence for one in heard))
        best = max(heard, key=lambda one: one.own.evidence)
        own, voice = best.own, best.voice
        inside = slice(own.first, own.stop)
        fundamental = own.fundamental_hz / voice
        weight = (voice / own.fundamental_std_hz[inside]) ** 2
        comb.sums += [weight.sum(), (weight * fundamental[inside]).sum(), own.stop - own.first]
        late = fundamental[fundamental.size // 2 :]
        rate = (late[-1] - late[0]) / max(late.size - 1, 1)
        comb.ahead_hz = float(late.mean() + 0.5 * rate * late.size)
        comb.reach_hz = REACH_CELLS * self.grid.cell_hz / (voice * float(own.teeth[-1]))

    def _points(self, data: WindowData, heard: list[_Heard]) -> LinePoints:
        """Return the points of all teeth of a comb in a window."""
        taken = set[int]()
        loudest_first = sorted(heard, key=lambda one: -one.own.evidence)
        return LinePoints.join([self._teeth_points(data, one, taken) for one in loudest_first])

    def _teeth_points(self, data: WindowData, one: _Heard, taken: set[int]) -> LinePoints:
        """Return the points of the teeth that no other voice of the comb has taken."""
        n_frames, own, comb = data.frame.size, one.own, one.comb
        path, std = own.fundamental_hz[:n_frames], own.fundamental_std_hz[:n_frames]
        low, high = data.frequency_hz[[0, -1]]
        every = np.arange(1, own.log_odds.size + 1)
        every = every[(every * path.min() > low) & (every * path.max() < high)]
        teeth = np.array(
            [
                k for k in every.tolist()
                if comb.odds[k * one.voice] > 0.0 and k * one.voice not in taken
            ],
            np.int64,
        )  # fmt: skip
        taken.update((teeth * one.voice).tolist())
        frequency = path[:, None] * teeth
        cells = np.rint((frequency - low) / self.grid.cell_hz).astype(np.int64)
        rows = np.arange(n_frames)[:, None]
        sounds = (rows >= own.first) & (rows < own.stop) & data.is_valid[:, None]
        is_line = np.broadcast_to(sounds, cells.shape)
        measured = measure(data, cells, is_line)
        raw, (line_std, strength) = measured.raw, self._line_std(data, cells, is_line)
        is_weak = strength <= OWN_PEAK_SNR
        raw[0] = np.where(is_weak, frequency, raw[0])
        raw[1] = np.where(is_weak, line_std, raw[1])
        state: FloatArray = np.zeros((n_frames, 5, 2, teeth.size))
        state[:, 2, 1] = UNKNOWN_BEARING_VARIANCE
        if data.east is not None:
            state = smooth_paths(
                data, measured, frequency.mean(axis=0), self.rule.motion, self.hop_s
            )
        rate = np.gradient(path, self.hop_s) if n_frames > 1 else np.zeros(1)
        state[:, 0, 0] = frequency
        state[:, 1, 0] = rate[:, None] * teeth
        state[:, 2, 0] = (std[:, None] * teeth) ** 2
        state[:, 3, 0] = 0.0
        state[:, 4, 0] = 2.0 * (std[:, None] * teeth / (8.0 * self.hop_s)) ** 2
        return self._rows(data, comb, teeth * one.voice, is_line, raw, state)

    def _line_std(self, data: WindowData, cells: IntArray, is_line: BoolArray) -> FloatArray:
        """Return deviation, Hz, and mean strength of each tooth, (2, tooth)."""
        ratio = np.take_along_axis(data.power_ratio, cells, axis=1).astype(float)
        known = is_line & np.isfinite(ratio)
        mean = np.where(known, ratio, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        strength = np.maximum(mean - 1.0, 0.02)
        return np.stack([frequency_std_hz(strength, data.window_s), strength])

    def _rows(
        self,
        data: WindowData,
        comb: _Comb,
        teeth: IntArray,
        is_line: BoolArray,
        raw: FloatArray,
        state: FloatArray,
    ) -> LinePoints:
        """Return the points of teeth as rows."""
        for tooth in teeth.tolist():
            if tooth not in comb.lines:
                comb.lines[tooth] = self.next_line
                self.next_line += 1
        number = np.array([comb.lines[tooth] for tooth in teeth.tolist()], np.int64)
        column, row = np.nonzero(is_line.T & np.isfinite(raw[0]).T)
        measured = raw[:, row, column].T
        detected = measured[:, 5] > 10.0 * np.log10(OWN_PEAK_SNR)
        return LinePoints(
            line=number[column],
            frame=data.frame[row],
            time_s=data.time_s[row],
            state=state[row, :, :, column],
            measured=measured,
            association=np.where(detected, DETECTED, SUB_THRESHOLD),
        )

    def pending(self, start_s: float) -> LinePoints:
        """Return the points that leave if the sound ends here, of windows searched."""
        return LinePoints.join([comb.pending for comb in self.living]).since(start_s)

    def line_table(self) -> LineTable:
        """Return what is known of the lines, at the end."""
        return self._table(self.samples)

    def table_of(self, points: LinePoints) -> LineTable:
        """Return what is known of the lines of some points."""
        samples = ContactSamples(self.samples.stride)
        samples.add(points)
        return self._table(samples)

    def _table(self, samples: ContactSamples) -> LineTable:
        lines = samples.line_seen()
        family_of = {line: comb.family for comb in self.combs for line in comb.lines.values()}
        family = np.array([family_of[int(line)] for line in lines], np.int64)
        window_frames = 1.0 / (self.bin_hz * self.hop_s)
        held = samples.samples(lines, CORRELATION_WINDOWS * window_frames)
        contact, status = group_lines(held, family)
        beside = unresolved_share(held, UNRESOLVED_BINS * self.bin_hz)
        return LineTable(lines, contact, family, status, beside, self._families(family))

    def _families(self, family: IntArray) -> Families:
        """Return the table of combs that have lines."""
        table = [comb for comb in self.combs if (family == comb.family).any()]
        if not table:
            return no_families()
        weight, total, frames = np.array([comb.sums for comb in table]).T
        correlated = frames / np.maximum(frames / self.rule.window_frames, 1.0)
        return Families(
            family=np.array([comb.family for comb in table]),
            frame=np.array([comb.first_frame for comb in table]),
            spacing_hz=total / weight,
            spacing_std_hz=np.sqrt(correlated / weight),
            offset_hz=np.zeros(len(table)),
            is_harmonic=np.ones(len(table), dtype=bool),
            n_members=np.array([np.count_nonzero(family == comb.family) for comb in table]),
            log10_chance=np.array([self._log10_chance(comb) for comb in table]),
            peak_family=np.zeros(0, dtype=np.int64),
        )

    def _log10_chance(self, comb: _Comb) -> float:
        """Return the logarithm of how many such combs are expected by chance."""
        hours = self.threshold.windows * self.threshold.step_s / 3600.0
        expected = np.log(self.rule.false_combs_per_hour * max(hours, 1e-3))
        # windows overlap by half: every second one is new
        evidence = comb.evidence
        total = max(sum(evidence[::2]), sum(evidence[1::2]), *evidence)
        return float((expected - (total - comb.least) / TAIL) / np.log(10.0))

    def scalars(self) -> dict[str, Any]:
        """Return what the run could have found."""
        width_khz = 1e-3 * self.grid.n_cells * self.grid.cell_hz
        per_line = self.rule.n_teeth / 2.0 / width_khz
        least = self.threshold.new(0.0)
        return {
            "reference": self.reference,
            "false_lines_per_khz_hour": self.rule.false_combs_per_hour * per_line,
            "measured_false_lines_per_khz_hour": (self.threshold.measured_per_hour() * per_line),
            "weakest_line_snr_db": weakest_by_path(least / 8.0, self.rule.window_frames, 0.0),
        }


def _machine_ratio(one: FoundComb, two: FoundComb) -> Fraction | None:
    """Return the ratio of two fundamentals if it is that of small whole numbers."""
    exact = one.middle_hz / two.middle_hz
    ratio = Fraction(exact).limit_denominator(MOST_PARTS)
    if not 0 < ratio.numerator <= MOST_RATIO:
        return None
    std = np.hypot(one.middle_std_hz / one.middle_hz, two.middle_std_hz / two.middle_hz)
    reach = np.clip(SAME_SIGMAS * std, LEAST_SHARE, MOST_SHARE)
    return ratio if abs(exact / float(ratio) - 1.0) <= reach else None


WHITE_OFFSET, WHITE_SLOPE = -6.8, 1.09
"""Mean of the greatest evidence in a window of white noise, and what it gains as the combs
that are asked for grow by e (`studies.constants.combs noise 4100 24`)."""

SURROGATE_LESS = 0.26
"""By how much less combs out of tune reach in white noise, of every third fundamental (same
script)."""

TAIL = 1.12
"""Nepers by which such maxima become rarer by e (same script)."""

EULER = 0.5772
"""Mean of Gumbel's distribution over its mode, in its scale."""

CONTINUATION = 30.0
"""Factor on the rate where a comb is expected: few places, not all fundamentals."""

REMAINDER = 1e3
"""Factor on the rate at which combs may come by chance without their loudest tooth."""


@dataclass
class CombThreshold:
    """Thresholds of the windows of a recording, as it has been heard so far."""

    false_combs_per_hour: float
    """Combs that noise alone may cause in an hour."""
    n_hypotheses: int
    """Combs that are asked for in a window."""
    step_s: float
    """Time from window to window, s."""
    total: float = 0.0
    """Sum over the windows of what combs out of tune reached beyond white noise."""
    windows: int = 0
    """Windows so far."""
    passed: float = 0.0
    """Sum over the windows of the factor by which raised thresholds cut the rate."""

    @property
    def white(self) -> float:
        """Mean of the greatest evidence in a window of white noise, nepers."""
        return WHITE_OFFSET + WHITE_SLOPE * float(np.log(max(self.n_hypotheses, 1)))

    @property
    def white_surrogate(self) -> float:
        """The same of the combs out of tune, nepers."""
        return self.white - SURROGATE_LESS

    def excess(self, surrogate: float) -> float:
        """Return by how much the recording's noise exceeds white noise, nepers.

        By the windows so far, and what combs out of tune reach in this one.
        """
        total = self.total + surrogate - self.white_surrogate
        return max(total / (self.windows + 1), 0.0)

    def new(self, excess: float) -> float:
        """Return the evidence that a comb needs to begin, nepers."""
        per_hour = 3600.0 / self.step_s
        mode = self.white - EULER * TAIL
        return mode + TAIL * float(np.log(per_hour / self.false_combs_per_hour)) + excess

    def continued(self, excess: float) -> float:
        """Return the evidence that a comb needs where one is expected, nepers."""
        return self.new(excess) - TAIL * float(np.log(CONTINUATION))

    def remainder(self, excess: float) -> float:
        """Return the evidence that a comb needs without its loudest tooth, nepers."""
        return self.new(excess) - TAIL * float(np.log(REMAINDER))

    def note(self, surrogate: float) -> None:
        """Enter a window by what combs out of tune reached in it."""
        self.passed += float(np.exp(-self.excess(surrogate) / TAIL))
        self.total += surrogate - self.white_surrogate
        self.windows += 1

    def measured_per_hour(self) -> float:
        """Return the rate of false combs as the recording tells it; nan without any."""
        if not self.windows:
            return float("nan")
        left = self.total / self.windows
        return float(self.false_combs_per_hour * np.exp(left / TAIL) * self.passed / self.windows)
