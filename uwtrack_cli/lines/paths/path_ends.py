"""Paths of a window, and how they begin and end.

**Method.** The end of a path is the straight course of its last frames, its beginning
that of its first ones. When a machine changes its speed at once, its high lines end and
begin again elsewhere, and paths of its low ones run through with a kink: they tell the
ratio of the jump, too (`lines.stitching`).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.lines import COASTED, DETECTED
from uwtrack_cli.lines.line_points import LinePoints
from uwtrack_cli.lines.paths.courses import FEWEST_FRAMES, fit_course
from uwtrack_cli.lines.paths.trace_window import Measured, WindowData
from uwtrack_cli.lines.stitching import NO_ENDS, REACH, PieceEnds

_KINK_WINDOWS, _SIDE_WINDOWS = 5.0, 17.0
"""A path that runs through a jump is looked at from so many windows away to so many: on
its way from one course to the other it is on neither."""


@dataclass(frozen=True, eq=False)
class MeasuredPaths:
    """The paths of a window, measured and smoothed; each is a column."""

    data: WindowData
    """The frames of the window."""
    measured: Measured
    """What was measured along the paths."""
    states: FloatArray
    """Smoothed states, shape (frame, 5, 2, path)."""
    noise_density: FloatArray
    """Spectral densities of a machine's own accelerations, as `PieceEnds`, shape (2,)."""

    def piece(self, line: int, column: int, rows: slice) -> PieceEnds:
        """Return where a piece of a line's path begins, or ends, which is its first row.

        Rows are nearest first; nothing if too few of their frames were measured.
        """
        time_s = self.data.time_s[rows]
        course = fit_course(
            time_s, self.measured.position[0, rows, column],
            self.measured.variance[0, rows, column], float(time_s[0]),
        )  # fmt: skip
        n_ends = 0 if course is None else 1
        state = self.states[rows][:n_ends, :, :, column].copy()
        state[:, :, 0] = course or 0.0
        density = np.tile(self.noise_density, (n_ends, 1))
        return PieceEnds(np.full(n_ends, line), time_s[:n_ends], state, density)

    def points(self, line: int, column: int, rows: slice) -> LinePoints:
        """Points of one line in some frames; frames without sound have none."""
        data, measured = self.data, self.measured
        index = np.arange(rows.start, max(rows.stop, rows.start))
        index = index[data.is_valid[index]]
        is_measured = np.isfinite(measured.variance[0, index, column])
        return LinePoints(
            line=np.full(index.size, line, dtype=np.int64),
            frame=data.frame[index],
            time_s=data.time_s[index],
            state=self.states[index, :, :, column],
            measured=measured.raw[:, index, column].T,
            association=np.where(is_measured, DETECTED, COASTED),
        )

    def pieces(self, which: Iterable[tuple[int, int, slice]]) -> PieceEnds:
        """Return where several pieces begin or end, each given as for `piece`."""
        return PieceEnds.join([NO_ENDS, *(self.piece(*each) for each in which)])

    def kinks(self, lines: IntArray, at_s: float) -> tuple[PieceEnds, PieceEnds]:
        """Return the paths that run through a time with a kink, before and after it.

        Their frequencies are those of straight courses on either side, extrapolated to
        the time, s; ``lines`` is the line of each path, shape (path,).
        """
        data, measured = self.data, self.measured
        lag = (data.time_s - at_s) / data.window_s
        sides, has_kink = [], np.ones(lines.size, dtype=bool)
        for side in (-lag, lag):
            rows = np.flatnonzero((side > _KINK_WINDOWS) & (side < _SIDE_WINDOWS))
            weight = 1.0 / measured.variance[0, rows]
            value = np.where(weight > 0.0, measured.position[0, rows], 0.0)
            time = lag[rows, None]
            s0, s1, s2 = ((weight * time**k).sum(axis=0) for k in range(3))
            y0, y1 = ((weight * value * time**k).sum(axis=0) for k in range(2))
            state = np.zeros((lines.size, 5, 2))
            with np.errstate(divide="ignore", invalid="ignore"):
                state[:, 0, 0] = (s2 * y0 - s1 * y1) / (s0 * s2 - s1**2)
                state[:, 2, 0] = s2 / (s0 * s2 - s1**2)
            time_s, density = (
                np.full(lines.size, at_s),
                np.tile(self.noise_density, (lines.size, 1)),
            )
            sides.append(PieceEnds(lines, time_s, state, density))
            has_kink &= np.count_nonzero(weight, axis=0) >= FEWEST_FRAMES
        before, after = sides
        off = np.abs(after.frequency_hz - before.frequency_hz)
        has_kink &= off * data.window_s > REACH
        return before.take(has_kink), after.take(has_kink)
