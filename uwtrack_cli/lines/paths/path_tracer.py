"""Lines over windows: found in each, continued from one to the next, let out in order.

**Method.** Windows overlap by one half. A path that runs beside the path of a line of
the window before is that line; one that begins where a line that fell silent would be by
now, or where a machine's change of speed has put it, is that line, too
(`lines.stitching`). Of each window
the middle half is final, where a path is best determined; the first window's beginning,
the last one's end and the whole of a line that appears or ends are added.

**Conventions.** Windows are counted in frames from the first, so blocks do not matter.

**References.** See `lines.paths.path_search`.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.lines.contacts import ContactSamples, line_table
from uwtrack_cli.lines.families.comb_test import CombRule
from uwtrack_cli.lines.families.harmonics import find_combs
from uwtrack_cli.lines.families.lasting_families import FamilyRegister
from uwtrack_cli.lines.line_points import LinePoints, LineTable
from uwtrack_cli.lines.paths.meetings import Meetings
from uwtrack_cli.lines.paths.path_ends import MeasuredPaths
from uwtrack_cli.lines.paths.path_search import (
    FoundPath,
    PathSearch,
    cell_scores,
    find_paths,
    whitened,
)
from uwtrack_cli.lines.paths.recording_noise import RecordingNoise, surrogate_scores
from uwtrack_cli.lines.paths.trace_threshold import PathScores, TraceThreshold
from uwtrack_cli.lines.paths.trace_window import (
    Measured,
    WindowData,
    Windows,
    measure,
    smooth_paths,
)
from uwtrack_cli.lines.stitching import (
    LEAST_LOG_RATIO,
    NO_ENDS,
    FamilyJumps,
    PieceEnds,
    log_ratio_of_return,
    stitched,
)
from uwtrack_cli.lines.tracker_options import Gates, Harmonics, ProcessNoise

_FEWEST_FRAMES = 32
"""Frames with sound in a window below which its noise is not measured."""

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
    end: PieceEnds
    """How it ends; nothing if it is too short to tell."""


class PathTracer:
    """Takes blocks of spectrogram, finds the lines of each window, lets points out."""

    def __init__(self, rule: TraceRule, first: Spectrogram) -> None:
        self.rule = rule
        self.windows = Windows(first, rule.band_hz, rule.window_frames)
        self.resolution_hz = resolution = 1.0 / first.frames.window_s
        self.weakest_line_snr_db = rule.threshold.weakest_line_snr_db(
            has_bearing=first.intensity_east is not None
        )
        self.hop_s = first.frames.hop_s
        self.silence_s = Gates().silence_s
        self.living: list[_Living] = []
        self.ended = NO_ENDS
        self.jumps = FamilyJumps(resolution)
        self.next_line = 1
        self.next_frame = 0
        self.noise = RecordingNoise(
            self.windows.chosen.stop - self.windows.chosen.start, first.frames.cells_per_bin
        )
        self.meetings = Meetings(resolution, rule.motion.own_density(first.frames.window_s))
        self.samples = ContactSamples(max(1, round(1.0 / (resolution * self.hop_s))))
        self.families = FamilyRegister()

    def push(self, block: Spectrogram) -> list[LinePoints]:
        """Take a block; return the points that have become final."""
        return [self._window(data, is_last=False) for data in self.windows.push(block)]

    def finish(self) -> LinePoints:
        """Search what is left and return all points still held."""
        rest = self.windows.rest()
        if rest is None:
            points = [living.pending for living in self.living]
        else:
            points = [self._window(rest, is_last=True)]
        self.living = []
        points = [self.meetings.push(LinePoints.join(points), self.next_frame)]
        return self._noted([*points, self.meetings.finish()])

    def _window(self, data: WindowData, *, is_last: bool) -> LinePoints:
        """Find the lines of a window."""
        n_frames = data.frame.size
        threshold = self.rule.threshold
        scores = (
            threshold.scores(n_frames) if data.east is None else threshold.scores_with_bearing(data)
        )
        expected = [
            int(living.cells[np.searchsorted(living.frame, data.frame[0])])
            for living in self.living
            if living.frame[0] <= data.frame[0] <= living.frame[-1]
        ]
        ratio = whitened(data)
        places = np.array(expected, dtype=np.int64)
        search = find_paths(cell_scores(ratio), ratio, scores, places, data.cells_per_bin)
        excess = self._excess(data, search)
        paths = [
            path
            for path in search.paths
            if path.stop - path.first >= self.rule.shortest_frames
            and _is_beyond(path, excess, scores, places, data.cells_per_bin)
        ]
        quarter = self.rule.window_frames // 4
        final = (quarter, n_frames if is_last else n_frames - quarter)
        parts = self._continue(data, paths, final, is_last=is_last)
        self.next_frame = int(data.frame[final[1] - 1]) + 1
        points = LinePoints.join(parts)
        if is_last:
            return points
        return self._noted([self.meetings.push(points, self.next_frame)])

    def _excess(self, data: WindowData, search: PathSearch) -> FloatArray:
        """Return by how much the noise of the recording exceeds white noise, nepers."""
        n_frames = data.frame.size
        if np.count_nonzero(data.is_valid) < _FEWEST_FRAMES:
            return np.zeros(search.total.size)
        scores = surrogate_scores(search, data.cells_per_bin, int(data.frame[0]))
        return self.noise.note(scores, *self.rule.threshold.surrogate_tail(n_frames))

    def _noted(self, parts: list[LinePoints]) -> LinePoints:
        points = LinePoints.join(parts).sorted()
        self.samples.add(points)
        return points

    def _continue(
        self, data: WindowData, paths: list[FoundPath], final: tuple[int, int], *, is_last: bool
    ) -> list[LinePoints]:
        """Name the paths, let their final points out, and keep the rest pending."""
        if not paths:
            ended, self.living = self.living, []
            self._remember(ended, data)
            return [living.pending for living in ended]
        measured = _along_paths(data, paths)
        cells = np.stack([p.cells for p in paths], axis=1)
        motion = self.rule.motion
        states = smooth_paths(
            data, measured, data.frequency_hz[cells].mean(axis=0), motion, self.hop_s
        )
        density = np.array([motion.own_density(data.window_s), motion.bearing_deg2ps3])
        along = MeasuredPaths(data, measured, states, density)
        is_line = np.isfinite(measured.variance[0])
        parts: list[LinePoints] = []
        living: list[_Living] = []
        paths, lines = self._heirs(data, paths)
        gone = [line for line in self.living if line.line not in lines]
        parts += [line.pending for line in gone]
        self._remember(gone, data)
        out_to = {line.line: line.out_to for line in self.living}
        paths = self._named(along, paths, lines)
        for k, path in enumerate(paths):
            start, end = path.first, min(path.stop, final[1])
            if lines[k] in out_to:  # only once
                already = int(np.searchsorted(data.frame, out_to[int(lines[k])]))
                start = max(start, already)
            own = int(lines[k])
            parts.append(along.points(own, k, slice(start, end)))
            if not is_last:
                rest = slice(max(final[1], path.first), path.stop)
                whole = slice(path.first, path.stop)
                living.append(_Living(
                    own, data.frame[whole], path.cells[whole],
                    int(data.frame[max(start, end) - 1]) + 1,
                    along.points(own, k, rest),
                    along.piece(own, k, slice(path.stop - 1, None, -1)),
                ))  # fmt: skip
        self.living = _joined(living)
        self._classify(data, cells, lines, is_line)
        return parts

    def _remember(self, lines: list[_Living], data: WindowData) -> None:
        """Keep how lines ended, as long as they may be heard again."""
        ended = PieceEnds.join([self.ended, *(line.end for line in lines)])
        self.ended = ended.take(data.time_s[0] - ended.time_s < self.silence_s)

    def _heirs(self, data: WindowData, paths: list[FoundPath]) -> tuple[list[FoundPath], IntArray]:
        """Give the paths that run beside those of living lines their numbers.

        A line that was silent, or has jumped, can have several paths in a window.
        Returns the paths, those of one line one after the other, and the number of
        each, 0 for none, shape (path,).
        """
        paths, lines = list(paths), np.zeros(len(paths), dtype=np.int64)
        for k in sorted(range(len(paths)), key=lambda k: paths[k].first):
            for old in self.living:
                before = [paths[i].stop for i in np.flatnonzero(lines == old.line)]
                begin = max([paths[k].first, *before])
                is_mostly_later = 2 * begin < paths[k].first + paths[k].stop
                if is_mostly_later and is_heir(data, paths[k], old.frame, old.cells):
                    paths[k] = replace(paths[k], first=begin)
                    lines[k] = old.line
                    break
        return paths, lines

    def _named(
        self, along: MeasuredPaths, paths: list[FoundPath], lines: IntArray
    ) -> list[FoundPath]:
        """Give each path the number of the line it continues, or a new one.

        ``lines`` are those of paths beside living ones, else 0, shape (path,); the
        others are filled in. Returns the paths, those of lines that jumped cut where
        they did.
        """
        paths, time = list(paths), along.data.time_s
        order = sorted(range(len(paths)), key=lambda k: paths[k].first)
        newest = self.next_line
        first = self._first_paths(lines, order)
        begins = along.pieces((line, k, slice(paths[k].first, None)) for line, k in first.items())
        ends = along.pieces(
            (int(lines[k]), k, slice(paths[k].stop - 1, None, -1))
            for k in order
            if paths[k].stop < time.size
        )
        silent = PieceEnds.join([self.ended, ends])
        at_s, pairs = -np.inf, self._returned(along.data, silent, begins, begins.line >= newest)
        while True:
            for old, new in pairs:
                # pairs before may have made a line of both
                line, number = int(begins.line[new]), int(silent.line[old])
                last_s = float(silent.time_s[old])  # its points are out if it has no path here
                if number in lines:
                    last_s = min(last_s, max(at_s, float(begins.time_s[new])))
                stop = int(np.searchsorted(time, last_s, "right"))
                if line != number and _is_cut(paths, first[line], lines == number, stop):
                    lines[lines == line] = number
                    silent.line[silent.line == line] = number
                    self.families.rename(line, number)
                    self.jumps.rename(line, number)
            silent = silent.take(~np.isin(np.arange(silent.line.size), [old for old, _ in pairs]))
            begins = begins.take(~np.isin(np.arange(begins.line.size), [new for _, new in pairs]))
            found = self.jumps.find(silent, begins, partial(along.kinks, lines))
            if found is None:
                break
            at_s, pairs = found
        self.ended = self.ended.take(~np.isin(self.ended.line, lines))
        return paths

    def _first_paths(self, lines: IntArray, order: list[int]) -> dict[int, int]:
        """Give new lines numbers; return the first path of each that has no point outside."""
        inside = {old.line for old in self.living if old.out_to <= old.frame[0]}
        first: dict[int, int] = {}
        for k in order:
            if lines[k] == 0:
                lines[k] = self.next_line
                inside.add(self.next_line)
                self.next_line += 1
            if lines[k] in inside:
                first.setdefault(int(lines[k]), k)
        return first

    def _returned(
        self, data: WindowData, ends: PieceEnds, begins: PieceEnds, is_new: BoolArray
    ) -> list[tuple[int, int]]:
        """Return pairs of an end and of the new beginning that continues it."""
        gap_s = begins.time_s - ends.time_s[:, None]
        is_silent = (gap_s > 0.0) & (gap_s < self.silence_s) & is_new
        band = float(data.frequency_hz[-1] - data.frequency_hz[0])
        n_others = np.maximum(np.count_nonzero(is_silent, axis=0) + len(self.living), 1)
        ratio = log_ratio_of_return(ends, begins, self.resolution_hz, n_others / band)
        return stitched(np.where(is_silent, ratio, -np.inf), LEAST_LOG_RATIO)

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
            harmonics.spacing_hz, harmonics.teeth, sigma, harmonics.bearing_window_deg, float(band)
        )
        unknown = np.full(there.size, np.nan)
        combs, _ = find_combs(frequency[order], unknown, comb, _FAMILY_CHANCE)
        numbers = np.array([self.meetings.name(int(k)) for k in lines[there[order]]])
        self.families.note(int(data.frame[at]), combs, numbers, frequency[order], sigma)

    def line_table(self) -> LineTable:
        """Return what is known of the lines, at the end."""
        return line_table(
            self.samples, self.families, self.jumps.told,
            window_frames=1.0 / (self.resolution_hz * self.hop_s),
            resolution_hz=self.resolution_hz,
        )  # fmt: skip

    def scalars(self, reference: str) -> dict[str, Any]:
        """Return what the run could have found."""
        threshold = self.rule.threshold
        return {
            "reference": reference,
            "false_lines_per_khz_hour": threshold.false_lines_per_khz_hour,
            "measured_false_lines_per_khz_hour": (
                threshold.false_lines_per_khz_hour * self.noise.relative_rate()
            ),
            "weakest_line_snr_db": self.weakest_line_snr_db,
        }


def _is_beyond(
    path: FoundPath, excess: FloatArray, least: PathScores, expected: IntArray, cells_per_bin: int
) -> bool:
    """Tell whether a path exceeds its threshold by more than the recording's noise."""
    score = path.score - float(excess[path.cells].mean())
    is_expected = (np.abs(expected - path.cells[0]) <= 2 * cells_per_bin).any()
    return bool(score > least.new or (is_expected and score > least.continued))


def is_heir(data: WindowData, path: FoundPath, frame: IntArray, cells: IntArray) -> bool:
    """Tell whether a path runs within a bin of that of a living line, in four frames or more."""
    own = slice(path.first, path.stop)
    _, ours, theirs = np.intersect1d(data.frame[own], frame, return_indices=True)
    away = np.abs(path.cells[own][ours] - cells[theirs])
    return away.size >= 4 and bool(np.median(away) <= data.cells_per_bin)


def _is_cut(paths: list[FoundPath], later: int, is_part: BoolArray, stop: int) -> bool:
    """Cut a line's paths at a frame, from which another one goes on, if that can be."""
    parts = np.flatnonzero(is_part).tolist()
    if stop >= paths[later].stop or any(stop <= paths[i].first for i in parts):
        return False
    for i in parts:
        paths[i] = replace(paths[i], stop=min(paths[i].stop, stop))
    paths[later] = replace(paths[later], first=max(paths[later].first, stop))
    return True


def _along_paths(data: WindowData, paths: list[FoundPath]) -> Measured:
    """Measure along paths, in the frames in which they hold a line."""
    first, stop = np.array([p.first for p in paths]), np.array([p.stop for p in paths])
    rows = np.arange(data.frame.size)[:, None]
    is_line = (rows >= first) & (rows < stop) & data.is_valid[:, None]
    return measure(data, np.stack([p.cells for p in paths], axis=1), is_line)


def _joined(living: list[_Living]) -> list[_Living]:
    """Make one of the parts of each line that fell silent within the window."""
    whole: dict[int, _Living] = {}
    for part in sorted(living, key=lambda part: int(part.frame[0])):
        early = whole.get(part.line)
        if early is None:
            whole[part.line] = part
        else:
            whole[part.line] = replace(
                part,
                frame=np.concatenate([early.frame, part.frame]),
                cells=np.concatenate([early.cells, part.cells]),
                out_to=early.out_to if early.pending.line.size else part.out_to,
                pending=LinePoints.join([early.pending, part.pending]),
            )
    return list(whole.values())
