"""Lines over windows: found in each, continued from one to the next, let out in order.

**Method.** Windows overlap by one half. A path that runs beside the path of a line of
the window before is that line. Of each window the middle half is final, where a path is
best determined; the first window's beginning, the last one's end and the whole of a
line that appears or ends are added.

**Conventions.** Windows are counted in frames from the first, so blocks do not matter.

**References.** See `lines.paths.path_search`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import COASTED, DETECTED
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.estimation.noise_floor import noise_floor
from uwtrack_cli.lines.contacts import ContactSamples, group_lines
from uwtrack_cli.lines.families.comb_test import CombRule
from uwtrack_cli.lines.families.harmonics import find_combs
from uwtrack_cli.lines.families.lasting_families import FamilyRegister
from uwtrack_cli.lines.line_points import LinePoints, LineTable
from uwtrack_cli.lines.paths.path_search import (
    FoundPath,
    cell_scores,
    find_paths,
    is_same_line,
    whiten,
)
from uwtrack_cli.lines.paths.trace_threshold import TraceThreshold
from uwtrack_cli.lines.paths.trace_window import (
    Measured,
    WindowData,
    cut,
    join_windows,
    measure,
    smooth_window,
    to_window,
)
from uwtrack_cli.lines.tracker_options import Harmonics, ProcessNoise

_FAMILY_CHANCE = 1e-2
"""Expected number of families by chance in one window."""


@dataclass(frozen=True)
class TraceRule:
    """Options of the tracer, and what follows from them and the recording."""

    window_frames: int
    """Frames that are searched together."""
    threshold: TraceThreshold
    """Scores that paths must exceed."""
    shortest_frames: int
    """Frames for which a line must last."""
    band_hz: tuple[float, float]
    """Lowest and highest frequency searched."""
    motion: ProcessNoise
    """How fast frequencies and bearings may change."""
    harmonics: Harmonics
    """What a harmonic family looks like."""


@dataclass
class _Living:
    """A line of the last window that reaches into the next one."""

    line: int
    """Number of the line."""
    frame: IntArray
    """Frames of its path, shape (frame,)."""
    cells: IntArray
    """Cells of its path, shape (frame,)."""
    out_to: int
    """First frame whose point is not out yet."""
    pending: LinePoints
    """Points that leave with the next window, if the line is not continued."""


class PathTracer:
    """Takes blocks of spectrogram, finds the lines of each window, lets points out."""

    def __init__(self, rule: TraceRule, first: Spectrogram) -> None:
        self.rule = rule
        frequency = first.frequency_hz
        resolution = 1.0 / first.frames.window_s
        # the cells at zero are not exponential
        low = max(rule.band_hz[0], 2.0 * resolution)
        inside = np.flatnonzero((frequency >= low) & (frequency <= rule.band_hz[1]))
        self.chosen = slice(int(inside[0]), int(inside[-1]) + 1)
        self.resolution_hz = resolution
        self.has_bearing = first.intensity_east is not None
        self.hop_s = first.frames.hop_s
        self.held: list[WindowData] = []
        self.n_held = 0
        self.living: list[_Living] = []
        self.next_line = 1
        self.is_first = True
        self.samples = ContactSamples(max(1, round(1.0 / (resolution * self.hop_s))))
        self.families = FamilyRegister()

    def push(self, block: Spectrogram) -> list[LinePoints]:
        """Take a block; return the points that have become final."""
        power = block.power_density[:, self.chosen]
        padding = max(1, round(block.frames.fft_length / block.frames.window_samples))
        floor = noise_floor(power, block.frames.valid_fraction, zero_padding=padding)
        self.held.append(to_window(block, floor, self.chosen))
        self.n_held += block.frames.n_frames
        points = []
        while self.n_held >= self.rule.window_frames:
            data = join_windows(self.held)
            points.append(self._window(cut(data, slice(self.rule.window_frames)), None))
            rest = cut(data, slice(self.rule.window_frames // 2, None))
            self.held, self.n_held = [rest], rest.frame.size
        return points

    def finish(self) -> LinePoints:
        """Search what is left and return all points still held."""
        half = self.rule.window_frames // 2
        points = []
        if self.n_held > (0 if self.is_first else half):
            points.append(self._window(join_windows(self.held), self.n_held))
        else:
            points.extend(living.pending for living in self.living)
        self.living = []
        return self._noted(points)

    def _window(self, data: WindowData, last_stop: int | None) -> LinePoints:
        """Find the lines of a window; ``last_stop`` is given for the last one."""
        n_frames = data.frame.size
        threshold = self.rule.threshold
        scores = (
            threshold.scores(n_frames)
            if data.east is None
            else threshold.scores_with_bearing(data)
        )
        expected = [
            int(living.cells[np.searchsorted(living.frame, data.frame[0])])
            for living in self.living
            if living.frame[0] <= data.frame[0] <= living.frame[-1]
        ]
        ratio = whiten(data.power_ratio, data.cells_per_bin)
        paths = find_paths(
            cell_scores(ratio), ratio, scores, np.array(expected, dtype=np.int64),
            data.cells_per_bin,
        )  # fmt: skip
        paths = [p for p in paths if p.stop - p.first >= self.rule.shortest_frames]
        quarter = self.rule.window_frames // 4
        final = (quarter, n_frames if last_stop else n_frames - quarter)
        parts = self._continue(data, paths, final, is_last=last_stop is not None)
        self.is_first = False
        return LinePoints.join(parts) if last_stop else self._noted(parts)

    def _noted(self, parts: list[LinePoints]) -> LinePoints:
        points = LinePoints.join(parts).sorted()
        self.samples.add(points)
        return points

    def _continue(
        self,
        data: WindowData,
        paths: list[FoundPath],
        final: tuple[int, int],
        *,
        is_last: bool,
    ) -> list[LinePoints]:
        """Name the paths, let their final points out, and keep the rest pending."""
        if not paths:
            ended, self.living = self.living, []
            return [living.pending for living in ended]
        cells = np.stack([p.cells for p in paths], axis=1)
        first = np.array([p.first for p in paths])
        stop = np.array([p.stop for p in paths])
        rows = np.arange(data.frame.size)[:, None]
        is_line = (rows >= first) & (rows < stop) & data.is_valid[:, None]
        measured = measure(data, cells, is_line)
        states = self._smoothed(data, cells, measured)
        parts: list[LinePoints] = []
        living: list[_Living] = []
        lines = self._named(data, paths)
        old = {line.line: line for line in self.living}
        for k, path in enumerate(paths):
            start, end = path.first, min(path.stop, final[1])
            if lines[k] in old:
                out_to = old.pop(int(lines[k])).out_to
                start = max(start, int(np.searchsorted(data.frame, out_to)))
            own = int(lines[k])
            parts.append(_points(data, states, measured, own, k, slice(start, end)))
            if not is_last:
                rest = slice(max(final[1], path.first), path.stop)
                whole = slice(path.first, path.stop)
                living.append(_Living(
                    own, data.frame[whole], path.cells[whole],
                    int(data.frame[max(start, end) - 1]) + 1,
                    _points(data, states, measured, own, k, rest),
                ))  # fmt: skip
        parts += [line.pending for line in old.values()]
        self.living = living
        self._classify(data, cells, lines, is_line)
        return parts

    def _named(self, data: WindowData, paths: list[FoundPath]) -> IntArray:
        """Give each path the number of the line it continues, or a new one."""
        lines = np.zeros(len(paths), dtype=np.int64)
        used: set[int] = set()
        for k, path in enumerate(paths):
            heir = self._heir(data, path, used)
            if heir is None:
                lines[k] = self.next_line
                self.next_line += 1
            else:
                lines[k] = heir.line
                used.add(heir.line)
        return lines

    def _heir(
        self, data: WindowData, path: FoundPath, used: set[int]
    ) -> _Living | None:
        """Find the living line that a path continues."""
        frames = data.frame[path.first : path.stop]
        cells = path.cells[path.first : path.stop]
        for old in self.living:
            if old.line in used:
                continue
            _, ours, theirs = np.intersect1d(frames, old.frame, return_indices=True)
            is_common = np.ones(ours.size, dtype=bool)
            if is_same_line(
                cells[ours], old.cells[theirs], is_common, data.cells_per_bin
            ):
                return old
        return None

    def _smoothed(
        self, data: WindowData, cells: IntArray, measured: Measured
    ) -> FloatArray:
        """Smooth the paths' measurements; return states, (frame, 5, 2, line)."""
        motion = self.rule.motion
        middle = data.frequency_hz[cells].mean(axis=0)
        density = np.stack([
            motion.frequency_density(middle, data.window_s),
            np.full(middle.size, motion.bearing_deg2ps3),
        ])  # fmt: skip
        rate = motion.rate_std_hzps(data.window_s, self.hop_s)
        return smooth_window(measured, data.time_s, density, rate)

    def _classify(
        self, data: WindowData, cells: IntArray, lines: IntArray, is_line: BoolArray
    ) -> None:
        """Look for families among the lines at the middle of the window."""
        at = data.frame.size // 2
        there = np.flatnonzero(is_line[at])
        if there.size < 3:
            return
        frequency = data.frequency_hz[cells[at, there]]
        order = np.argsort(frequency, kind="stable")
        harmonics = self.rule.harmonics
        sigma = 0.29 * self.resolution_hz / data.cells_per_bin
        band = data.frequency_hz[-1] - data.frequency_hz[0]
        comb = CombRule(
            harmonics.spacing_hz, harmonics.teeth, sigma,
            harmonics.bearing_window_deg, float(band),
        )  # fmt: skip
        unknown = np.full(there.size, np.nan)
        combs, _ = find_combs(frequency[order], unknown, comb, _FAMILY_CHANCE)
        self.families.note(
            int(data.frame[at]), combs, lines[there[order]], frequency[order], sigma
        )

    def line_table(self) -> LineTable:
        """Return what is known of the lines, at the end."""
        lines = self.samples.line_seen()
        families, family = self.families.lasting(lines, 0.1)
        correlation = 4.0 / (self.resolution_hz * self.hop_s)
        contact, status = group_lines(self.samples.samples(lines, correlation), family)
        return LineTable(lines, contact, family, status, families)

    def scalars(self, reference: str) -> dict[str, Any]:
        """Return what the run could have found."""
        threshold = self.rule.threshold
        return {
            "reference": reference,
            "false_lines_per_khz_hour": threshold.false_lines_per_khz_hour,
            "weakest_line_snr_db": threshold.weakest_line_snr_db(
                has_bearing=self.has_bearing
            ),
        }


def _points(
    data: WindowData,
    states: FloatArray,
    measured: Measured,
    line: int,
    column: int,
    rows: slice,
) -> LinePoints:
    """Points of one line in some frames; frames without sound have none."""
    index = np.arange(rows.start, max(rows.stop, rows.start))
    index = index[data.is_valid[index]]
    is_measured = np.isfinite(measured.variance[0, index, column])
    return LinePoints(
        line=np.full(index.size, line, dtype=np.int64),
        frame=data.frame[index],
        time_s=data.time_s[index],
        state=states[index, :, :, column],
        measured=measured.raw[:, index, column].T,
        association=np.where(is_measured, DETECTED, COASTED),
    )
