"""Lines that come together go on along their courses.

**Method.** Where two lines cross they cannot be told apart for a while, slow ones for a
minute or more, in which the likeliest paths bounce, end, begin anew and go astray in
the noise. So the points of lines that come together are held back until two lines have parted
again and run straight. Straight courses before and after tell who is who, if one
pairing is far likelier, whatever the drift of the two. Points between are given to the two lines
by their order in frequency, and those that are far from the course of their line are
put onto it, as coasted. A line that begins beside the two is one of them.

**Conventions.** Distances are in natural bins; frames are those of the recording.
What is not decided within `MOST_FRAMES` leaves as it came. The constants are chosen:
`tests.draws.line_sounds` shows what they do.

**References.** Bar-Shalom, Li & Kirubarajan (2001), sections 3.4 (least squares) and
6.2.2 (growth of the variance); de Boor (1978), chapter 4 (cubic between two courses).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import IntArray
from uwtrack_cli.data.lines import COASTED
from uwtrack_cli.estimation.assignment import assign
from uwtrack_cli.estimation.kalman import KalmanState, predict, update
from uwtrack_cli.lines.line_points import LinePoints
from uwtrack_cli.lines.paths.courses import COURSE_FRAMES, FEWEST_FRAMES, fit_course
from uwtrack_cli.lines.stitching import course_distance

TOGETHER_BINS = 3.0
"""Distance in bins within which two lines may have come together: the cells beside a path
that was found are taken out, and the next one goes around them."""

MIXED_BINS = 1.0
"""Distance in bins beyond the nearest one within which frames are left out."""

LEAST_GAIN = 6.0
"""Gain in nepers that a change of places must bring (chance: 1 in 400)."""

MOST_FRAMES = 300
"""Frames for which points are held back at most."""

PARTED_FRAMES = 24
"""Frames for which lines have parted before they are looked at."""

DRIFT_SHARES = (0.0, 1e-3, 0.03, 1.0)
"""Process noises of the two lines that are equally likely before, as shares of the
greatest that a machine's drift has: how steady these machines are is not known."""

LEAST_STD_BINS, LEAST_RATE_STD_BINS = 0.3, 0.02
"""Floors of the deviations of where two courses meet, in bins, and of the difference of
their rates, in bins per window: these lines have never been silent."""

MOST_FAINTER_DB = 5.0
"""Difference to the fainter of two lines beyond which a path went astray in noise: where
they are closer than a bin they have one ridge, and the other path has none."""


@dataclass
class _Meeting:
    """Two lines that have come together."""

    first_frame: int
    """First frame in which they were near each other."""
    begin_s: float
    """Its time, s."""
    entry: dict[int, KalmanState]
    """Course of each line then, by its number."""
    faintest_db: float
    """SNR of the fainter one before, dB."""
    members: set[int]
    """The numbers of these and of what began beside them."""
    last_near: int
    """Last frame in which two of them were near each other."""


class Meetings:
    """Holds back points of lines that have come together, and tells who is who.

    Parameters
    ----------
    bin_hz
        Natural bin in Hz.
    density_hz2ps3
        Process noise of a machine's own drift, Hz^2/s^3.
    """

    def __init__(self, bin_hz: float, density_hz2ps3: float) -> None:
        self.bin_hz = bin_hz
        self.density_hz2ps3 = density_hz2ps3
        self._names: dict[int, int] = {}
        self._past = self._held = LinePoints.join([])
        self._meetings: list[_Meeting] = []
        self._complete_to = 0

    def name(self, path: int) -> int:
        """Return the number under which the points of a path's line leave now."""
        return self._names.get(path, path)

    def push(self, points: LinePoints, complete_to: int) -> LinePoints:
        """Take final points; return those that are decided, by line, then by frame.

        Points have the numbers of the paths' lines; up to ``complete_to`` those of
        every line are there.
        """
        line = np.array([self.name(int(k)) for k in points.line], dtype=np.int64)
        named = replace(points, line=line)
        self._held = LinePoints.join([self._held, named])
        self._find()
        for meeting in list(self._meetings):
            self._follow(meeting)
            has_parted = meeting.last_near + PARTED_FRAMES < complete_to
            is_late = complete_to - meeting.first_frame > MOST_FRAMES
            if (has_parted and self._decide(meeting)) or is_late:
                self._meetings.remove(meeting)
        self._complete_to = complete_to
        return self._released()

    def finish(self) -> LinePoints:
        """Return what is still held, by line, then by frame."""
        for meeting in self._meetings:
            self._decide(meeting)
        self._meetings = []
        return self._released()

    def _released(self) -> LinePoints:
        held = self._held
        waits = np.zeros(held.line.size, dtype=bool)
        for meeting in self._meetings:
            is_member = np.isin(held.line, list(meeting.members))
            waits |= is_member & (held.frame >= meeting.first_frame)
        out = held.take(~waits).sorted()
        self._held = held.take(waits)
        past = LinePoints.join([self._past, out])
        oldest = self._complete_to - MOST_FRAMES
        self._past = past.take(past.frame >= oldest)
        return out

    def _find(self) -> None:
        """Find lines that have come together since the last points."""
        points = LinePoints.join([self._past, self._held])
        busy = {line for meeting in self._meetings for line in meeting.members}
        near = self._near(points.take(points.frame >= self._complete_to - FEWEST_FRAMES))
        _, first = np.unique(near[:2], axis=1, return_index=True)
        for one, two, frame in near[:, np.sort(first)].T.tolist():
            # those that were near before have not come together now
            if frame < self._complete_to or not busy.isdisjoint((one, two)):
                continue
            begin_s = float(points.time_s[points.frame == frame][0])
            before = points.take(points.frame < frame)
            entry, faintest_db = self._courses(before, {one, two}, begin_s, -1)
            if len(entry) == 2:
                busy |= set(entry)
                self._meetings.append(
                    _Meeting(frame, begin_s, entry, faintest_db, set(entry), frame)
                )

    def _near(self, points: LinePoints) -> IntArray:
        """List lines near each other and the frame, by frame, shape (3, pair)."""
        order = np.lexsort((points.frequency_hz, points.frame))
        line, frame, hz = (v[order] for v in (points.line, points.frame, points.frequency_hz))
        at = np.flatnonzero((np.diff(frame) == 0) & (np.diff(hz) < TOGETHER_BINS * self.bin_hz))
        return np.stack([*np.sort([line[at], line[at + 1]], axis=0), frame[at]])

    def _follow(self, meeting: _Meeting) -> None:
        """Note what has begun beside the lines, and when they were last near."""
        others = [m.members for m in self._meetings if m is not meeting]
        old = set(self._past.line.tolist()).union(*others)
        near = self._near(self._held.take(self._held.frame >= meeting.first_frame))
        for pair in map(set, near[:2].T.tolist()):
            if meeting.members & pair:
                meeting.members |= pair - old
        is_own = np.isin(near[:2], list(meeting.members)).all(axis=0)
        meeting.last_near = max(meeting.last_near, int(near[2, is_own].max(initial=0)))

    def _courses(
        self, points: LinePoints, lines: set[int], at_s: float, step: int
    ) -> tuple[dict[int, KalmanState], float]:
        """Fit courses to the points of lines, from the first (1) or the last (-1).

        Returns those that lines have, by number, and the SNR of their faintest, dB.
        """
        courses, snr_db = {}, [np.inf]
        for line in sorted(lines):
            own = points.take(points.line == line).sorted().take(slice(None, None, step))
            std = own.measured[:, 1]
            variance = np.where(np.isfinite(std), std**2, np.inf)
            course = fit_course(own.time_s, own.measured[:, 0], variance, at_s)
            if course is not None:
                courses[line] = course
                known_db = own.measured[np.isfinite(own.measured[:, 5]), 5]
                snr_db.append(float(np.median(known_db[:COURSE_FRAMES])))
        return courses, min(snr_db)

    def _decide(self, meeting: _Meeting) -> bool:
        """Tell which line is which after a meeting, if that can be told."""
        held = self._held
        is_after = held.frame > meeting.last_near
        after = held.take(is_after & np.isin(held.line, list(meeting.members)))
        if not after.line.size:
            return False
        end_s = float(after.time_s.min())
        exits, faintest_db = self._courses(after, set(after.line.tolist()), end_s, 1)
        if len(exits) != 2 or faintest_db < meeting.faintest_db - MOST_FAINTER_DB:
            return False
        pairing = self._pairing(meeting, exits, end_s)
        if pairing is None:
            return False
        between = held.frame >= meeting.first_frame
        between &= ~is_after & np.isin(held.line, list(meeting.members))
        rest = held.take(~between)
        now = _permutation(pairing)
        is_late = rest.frame > meeting.last_near
        line = np.array([now.get(int(k), int(k)) for k in rest.line], dtype=np.int64)
        rest = replace(rest, line=np.where(is_late, line, rest.line))
        courses = {old: (meeting.entry[old], exits[new]) for new, old in pairing.items()}
        placed = self._placed(held.take(between), courses, meeting.begin_s, end_s)
        self._held = LinePoints.join([rest, placed])
        paths = set(self._names) | set(now)
        self._names |= {p: now[self.name(p)] for p in paths if self.name(p) in now}
        return True

    def _pairing(
        self, meeting: _Meeting, exits: dict[int, KalmanState], end_s: float
    ) -> dict[int, int] | None:
        """Return which line was which by the numbers after; None if it is not clear."""
        half_s = 0.5 * (end_s - meeting.begin_s)
        old, new = (
            KalmanState(*np.array(list(courses.values())).T) for courses in (meeting.entry, exits)
        )
        drift = self.density_hz2ps3 * np.reshape(DRIFT_SHARES, (-1, 1, 1))
        square, determinant = course_distance(
            predict(KalmanState(*(entry[:, None] for entry in old)), half_s, drift),
            predict(new, -half_s, -drift),
            LEAST_STD_BINS * self.bin_hz,
            LEAST_RATE_STD_BINS * self.bin_hz**2,
        )
        gain = -0.5 * (square + np.log(determinant))
        same, changed = (
            np.logaddexp.reduce(gain[:, [0, 1], new_of].sum(axis=1)) for new_of in ([0, 1], [1, 0])
        )
        if abs(same - changed) <= LEAST_GAIN:
            return None
        return dict(zip(list(exits)[:: 1 if same > changed else -1], meeting.entry, strict=True))

    def _placed(
        self,
        points: LinePoints,
        courses: dict[int, tuple[KalmanState, KalmanState]],
        begin_s: float,
        end_s: float,
    ) -> LinePoints:
        """Give the points of a meeting to its lines, near to their courses.

        Every line has a course at either time. What is far from it is put onto it, as it
        would be without a measurement.
        """
        lines, (before, after) = list(courses), zip(*courses.values(), strict=True)
        old, new = (KalmanState(*np.array(each).T) for each in (before, after))
        time_s, density = points.time_s[:, None], np.array(self.density_hz2ps3)
        ahead = predict(old, time_s - begin_s, density)
        behind = predict(new, time_s - end_s, -density)
        expected = np.stack(update(ahead, behind.position - ahead.position, behind.variance))
        away = np.abs(points.frequency_hz[:, None] - expected[0])
        _, frame = np.unique(points.frame, return_inverse=True)
        place = 2 * frame[:, None] + np.arange(2)  # one of each line in each frame
        point = np.repeat(np.arange(frame.size), 2)
        point, rank = np.divmod(assign(place.ravel(), point, away.ravel()), 2)
        placed = points.take(point)
        is_far = away[point, rank] > MIXED_BINS * self.bin_hz
        state, measured = placed.state.copy(), placed.measured.copy()
        state[is_far, :, 0] = expected[:, point, rank].T[is_far]
        measured[is_far] = np.nan
        return replace(
            placed,
            line=np.array(lines)[rank],
            state=state,
            measured=measured,
            association=np.where(is_far, COASTED, placed.association),
        )


def _permutation(pairing: dict[int, int]) -> dict[int, int]:
    """Complete numbers by number, so that each is given once."""
    free = [new for new in pairing if new not in pairing.values()]
    lost = [old for old in pairing.values() if old not in pairing]
    return pairing | dict(zip(lost, free, strict=True))
