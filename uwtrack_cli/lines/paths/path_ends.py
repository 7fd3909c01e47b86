"""How paths begin and end, and which of them jumped together.

**Method.** The end of a path is the straight course of its last frames, its beginning
that of its first ones. When a machine changes its speed at once, its high lines end and
begin again elsewhere, and paths of its low ones run through with a kink: the ratio of a
jump is common to all of them (`lines.common_jumps`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import COASTED, DETECTED
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.kalman import KalmanState
from uwtrack_cli.lines.common_jumps import (
    AFTER_WINDOWS,
    BEARING_SIGMAS,
    BEFORE_WINDOWS,
    REACH,
    JumpCandidates,
    told_jump,
)
from uwtrack_cli.lines.line_points import FamilyJump, LinePoints
from uwtrack_cli.lines.paths.courses import FEWEST_FRAMES, fit_course
from uwtrack_cli.lines.paths.trace_window import Measured, WindowData
from uwtrack_cli.lines.tracking.track_store import UNKNOWN_BEARING_VARIANCE

_KINK_WINDOWS, _SIDE_WINDOWS = 5.0, 17.0
"""A path that runs through a jump is looked at from so many windows away to so many: on
its way from one course to the other it is on neither."""

_LATE_WINDOWS = 16.0
"""Time from a known jump within which paths of its lines may end and begin, in windows."""


@dataclass(frozen=True)
class PathEnd:
    """An end or a beginning of a line: where it is, and how it moves."""

    line: int
    """Number of the line."""
    time_s: float
    """Time of its last or its first frame, s."""
    state: KalmanState
    """Its straight course and its bearing then, entries of shape (2,)."""


@dataclass(frozen=True, eq=False)
class MeasuredPaths:
    """The paths of a window, measured and smoothed; each is a column."""

    data: WindowData
    """The frames of the window."""
    measured: Measured
    """What was measured along the paths."""
    states: FloatArray
    """Smoothed states, shape (frame, 5, 2, path)."""

    def state_at(self, column: int, rows: slice, at_s: float) -> KalmanState | None:
        """Return straight course and bearing of a path at the first of some rows.

        Rows are nearest first. Entries of shape (2,); None if too few frames were
        measured.
        """
        course = fit_course(
            self.data.time_s[rows], self.measured.position[0, rows, column],
            self.measured.variance[0, rows, column], at_s,
        )  # fmt: skip
        if course is None:
            return None
        state = self.states[rows][0, :, :, column].copy()
        state[:2, 0] = course.value
        state[2:, 0] = course.covariance[[0, 0, 1], [0, 1, 1]]
        return KalmanState(*state)

    def end_of(self, line: int, column: int, stop: int) -> PathEnd | None:
        """Return how a path ends, None if it is too short to tell."""
        at_s = float(self.data.time_s[stop - 1])
        state = self.state_at(column, slice(stop - 1, None, -1), at_s)
        return None if state is None else PathEnd(line, at_s, state)

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


def find_jumped(
    ends: Sequence[PathEnd],
    begins: Sequence[PathEnd],
    known: list[FamilyJump],
    paths: MeasuredPaths,
    lines: IntArray,
) -> tuple[FamilyJump, list[tuple[int, int]]] | None:
    """Find lines that have ended and begun again where a jump has put them.

    Beginnings are by time; a jump that is found is added to those known. Returns it
    with pairs of the indices of an end and of the beginning that goes on with its line;
    None if chance explains every ratio. ``lines`` is the line of each path, shape
    (path,).
    """
    if not (ends and begins):
        return None
    end_hz, end_s = np.array([(e.state.position[0], e.time_s) for e in ends]).T
    begin_hz, begin_s = np.array([(e.state.position[0], e.time_s) for e in begins]).T
    is_there = _is_there(ends, begins)
    window_s = paths.data.window_s
    wait = (begin_s - end_s[:, None]) / window_s
    own = JumpCandidates(end_hz, end_s, begin_hz, is_there, 1.0 / window_s)
    for jump in known:
        near = [
            np.abs(time_s - jump.time_s) < _LATE_WINDOWS * window_s for time_s in (end_s, begin_s)
        ]
        pairs = own.paired(end_hz * jump.ratio, is_there & np.outer(*near))
        if pairs:
            jump.lines.update(ends[i].line for i, _ in pairs)
            return jump, pairs
    is_prompt = is_there & (wait > -BEFORE_WINDOWS) & (wait < AFTER_WINDOWS)
    for at_s in begin_s[is_prompt.any(axis=0)].tolist():
        is_now = np.abs(begin_s - at_s) < AFTER_WINDOWS * window_s
        kinked, before_hz, after_hz = _kinks(paths, at_s)
        may_be = np.pad(is_prompt & is_now, ((0, kinked.size),) * 2)
        through = np.arange(-kinked.size, 0)
        may_be[through, through] = True  # what runs through is known to be one
        candidates = JumpCandidates(
            np.append(end_hz, before_hz),
            np.append(end_s, np.full(kinked.size, at_s)),
            np.append(begin_hz, after_hz),
            may_be,
            own.resolution_hz,
        )
        found = candidates.common()
        pairs = [(i, j) for i, j in found if i < end_s.size]
        if not pairs:
            continue
        ran = [(i, j) for i, j in found if i >= end_s.size]
        variance = [_variance(ends[i]) + _variance(begins[j]) for i, j in pairs]
        # a path that runs through counts as the least certain of the others
        variance += [max(variance)] * len(ran)
        ratio = candidates.log_ratio[tuple(np.array(pairs + ran).T)]
        time_s = float(np.median([0.5 * (end_s[i] + begin_s[j]) for i, j in pairs]))
        jump = told_jump(time_s, ratio, np.array(variance))
        jump.lines.update(ends[i].line for i, _ in pairs)
        jump.lines.update(int(lines[kinked[i - end_s.size]]) for i, _ in ran)
        known.append(jump)
        return jump, pairs
    return None


def _variance(end: PathEnd) -> float:
    """Variance of the logarithm of the frequency of an end."""
    return float(end.state.variance[0] / end.state.position[0] ** 2)


def _is_there(ends: Sequence[PathEnd], begins: Sequence[PathEnd]) -> BoolArray:
    """Tell which pairs the bearings allow, shape (end, beginning).

    A line does not go on with itself: a short one ends soon after it has begun.
    """
    was, was_variance = np.array([(e.state.position[1], e.state.variance[1]) for e in ends]).T
    now, now_variance = np.array([(e.state.position[1], e.state.variance[1]) for e in begins]).T
    variance = was_variance[:, None] + now_variance
    turn = wrap_deg(now - was[:, None])
    is_unknown = variance >= UNKNOWN_BEARING_VARIANCE
    is_other = np.array([[e.line != b.line for b in begins] for e in ends])
    return np.asarray(is_other & (is_unknown | (turn**2 < BEARING_SIGMAS**2 * variance)))


def _kinks(paths: MeasuredPaths, at_s: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the paths that run through a time with a kink, and both frequencies.

    Frequencies are those of straight courses on either side, extrapolated to the time.
    """
    data, measured = paths.data, paths.measured
    lag = (data.time_s - at_s) / data.window_s
    both, known = [], []
    for side in (-lag, lag):
        rows = np.flatnonzero((side > _KINK_WINDOWS) & (side < _SIDE_WINDOWS))
        weight = 1.0 / measured.variance[0, rows]
        value = np.where(weight > 0.0, measured.position[0, rows], 0.0)
        time = lag[rows, None]
        s0, s1, s2 = ((weight * time**k).sum(axis=0) for k in range(3))
        y0, y1 = ((weight * value * time**k).sum(axis=0) for k in range(2))
        with np.errstate(divide="ignore", invalid="ignore"):
            both.append((s2 * y0 - s1 * y1) / (s0 * s2 - s1**2))
        known.append(np.count_nonzero(weight, axis=0) >= FEWEST_FRAMES)
    before, after = both
    has_kink = known[0] & known[1]
    has_kink &= np.abs(after - before) * data.window_s > REACH
    return np.flatnonzero(has_kink), before[has_kink], after[has_kink]
