"""Straight courses at the ends and beside the crossings of paths.

**Method.** The likeliest path knows no rate: where two lines cross it goes on along
either, and where a line falls silent it says nothing of where the line will be. So
straight lines are fitted to what was measured on either side of a place where two paths
come together, and their ends change places when the courses agree far better so. The
fit at the end of a path, extrapolated, tells whether a later one continues it.

**Conventions.** A course is taken over as many frames as it is straight for, at most
`COURSE_FRAMES`. Costs are in nepers.

**References.** Bar-Shalom, Li & Kirubarajan (2001), section 3.4 (least squares);
Holland & Welsch (1977), Commun. Stat. A6, 813-827 (Cauchy's weights, iterated).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.lines.paths.path_search import FoundPath

COURSE_FRAMES = 40
"""Most frames of a course."""

FEWEST_FRAMES = 8
"""Fewest frames of a course."""

TOGETHER_BINS = 3.0
"""Distance in bins within which two lines may have come together: the cells beside a path
that was found are taken out, and the next one goes around them."""

MIXED_BINS = 1.0
"""Distance in bins beyond the nearest one within which frames are left out."""

LEAST_GAIN = 6.0
"""Gain in nepers that a change of places must bring (chance: 1 in 400)."""

FAR = 3.0
"""Deviations beyond which a frame is far from a course."""

MOST_FAR = 0.2
"""Share of frames that may be far from a straight course: those after its end are noise's."""

_FITS = 6
"""Fits with weights from the residuals of the one before."""

LEAST_STD_BINS = 0.3
"""Floor of the deviation of where two courses meet, in bins."""

LEAST_RATE_STD_BINS = 0.02
"""Floor of the deviation of the difference of their rates, in bins per window."""


@dataclass(frozen=True)
class Course:
    """A straight course at one time."""

    value: FloatArray
    """Frequency in Hz and rate in Hz/s, shape (2,)."""
    covariance: FloatArray
    """Their covariance, shape (2, 2)."""


def fit_course(
    time_s: FloatArray, frequency_hz: FloatArray, variance: FloatArray, at_s: float
) -> Course | None:
    """Fit a straight course to the frames nearest to a time.

    Parameters
    ----------
    time_s
        Times of the frames, s, all on one side of ``at_s``, nearest first.
    frequency_hz
        Measured frequencies, Hz.
    variance
        Their variances, Hz^2; inf where nothing was measured.
    at_s
        Time for which the course is given, s.

    Returns
    -------
    Course or None
        None if too few frames were measured.
    """
    known = np.flatnonzero(np.isfinite(variance) & np.isfinite(frequency_hz))
    n_used = min(known.size, COURSE_FRAMES)
    if n_used < FEWEST_FRAMES:
        return None
    while True:
        use = known[:n_used]
        course, is_far = _robust_fit(
            time_s[use] - at_s, frequency_hz[use], 1.0 / variance[use]
        )
        shorter = max(n_used // 2, FEWEST_FRAMES)
        if is_far.mean() <= MOST_FAR or shorter == n_used:
            return course
        n_used = shorter


def _robust_fit(
    time_s: FloatArray, frequency_hz: FloatArray, weight: FloatArray
) -> tuple[Course, BoolArray]:
    """Fit a straight line by iterated weights, and tell which frames are far from it."""
    design = np.stack([np.ones(time_s.size), time_s], axis=1)
    share = np.ones(time_s.size)
    for _ in range(_FITS):
        used = share * weight
        covariance = np.linalg.inv(design.T @ (used[:, None] * design))
        value = covariance @ (design.T @ (used * frequency_hz))
        square = weight * (frequency_hz - design @ value) ** 2
        share = 1.0 / (1.0 + square / FAR**2)
    excess = float((share * square).sum()) / (time_s.size - 2)
    return Course(value, covariance * max(excess, 1.0)), square > FAR**2


def uncross(
    paths: list[FoundPath],
    time_s: FloatArray,
    frequency_hz: FloatArray,
    variance: FloatArray,
    bin_hz: float,
) -> list[FoundPath]:
    """Let paths that come together go on along the courses that they came on.

    Parameters
    ----------
    paths
        The paths of one window.
    time_s
        Times of its frames, s, shape (frame,).
    frequency_hz
        Frequencies measured along the paths, Hz, shape (frame, path).
    variance
        Their variances, Hz^2, inf outside the line, same shape.
    bin_hz
        Natural bin in Hz.

    Returns
    -------
    list of FoundPath
        The same paths, some with changed ends.
    """
    frequency_hz, variance = frequency_hz.copy(), variance.copy()
    paths = list(paths)
    rows = np.arange(time_s.size)
    for one in range(len(paths)):
        for two in range(one + 1, len(paths)):
            first = max(paths[one].first, paths[two].first)
            stop = min(paths[one].stop, paths[two].stop)
            away = np.abs(frequency_hz[:, one] - frequency_hz[:, two])
            near = (away < TOGETHER_BINS * bin_hz) & (rows >= first) & (rows < stop)
            for low, high in _meetings(away, near, MIXED_BINS * bin_hz):
                both = [one, two]
                gain = _gain(
                    time_s, frequency_hz[:, both], variance[:, both], low, high, bin_hz
                )
                if gain < LEAST_GAIN:
                    continue
                middle = (low + high) // 2
                for values in (frequency_hz, variance):
                    values[middle:, both] = values[middle:, both[::-1]]
                paths[one], paths[two] = _changed(paths[one], paths[two], middle)
    return paths


def _meetings(
    away_hz: FloatArray, near: BoolArray, mixed_hz: float
) -> list[tuple[int, int]]:
    """Return the stretches [low, high) about the places where two paths are nearest."""
    at = np.flatnonzero(near)
    if not at.size:
        return []
    cuts = np.flatnonzero(np.diff(at) > FEWEST_FRAMES) + 1
    meetings = []
    for part in np.split(at, cuts):
        mixed = part[away_hz[part] < away_hz[part].min() + mixed_hz]
        meetings.append((int(mixed[0]), int(mixed[-1]) + 1))
    return meetings


def _gain(
    time_s: FloatArray,
    frequency_hz: FloatArray,
    variance: FloatArray,
    low: int,
    high: int,
    bin_hz: float,
) -> float:
    """Return what is gained when two paths change places in a stretch, nepers."""
    at_s = 0.5 * float(time_s[low] + time_s[high - 1])
    before = slice(low - 1, None, -1) if low else slice(0, 0)
    sides = [
        [
            fit_course(time_s[side], frequency_hz[side, k], variance[side, k], at_s)
            for k in (0, 1)
        ]
        for side in (before, slice(high, None))
    ]
    (a, b), (c, d) = sides
    if a is None or b is None or c is None or d is None:
        return 0.0
    stay = disagreement(a, c, bin_hz) + disagreement(b, d, bin_hz)
    return stay - disagreement(a, d, bin_hz) - disagreement(b, c, bin_hz)


def disagreement(one: Course, two: Course, bin_hz: float) -> float:
    """Return how unlikely two courses are the same one, nepers but for a constant.

    Parameters
    ----------
    one, two
        Courses at the same time.
    bin_hz
        Natural bin in Hz.
    """
    floor = (LEAST_STD_BINS * bin_hz) ** 2, (LEAST_RATE_STD_BINS * bin_hz**2) ** 2
    off = one.value - two.value
    total = one.covariance + two.covariance + np.diag(floor)
    _, spread = np.linalg.slogdet(total)
    return 0.5 * float(off @ np.linalg.solve(total, off) + spread)


def _changed(
    one: FoundPath, two: FoundPath, middle: int
) -> tuple[FoundPath, FoundPath]:
    def joined(early: FoundPath, late: FoundPath) -> FoundPath:
        cells: IntArray = np.concatenate([early.cells[:middle], late.cells[middle:]])
        return replace(early, cells=cells, stop=late.stop)

    return joined(one, two), joined(two, one)
