"""The score that noise alone reaches at a stated rate, and what a bearing adds to it.

**Method.** The best path's score in noise has an exponential tail: the number of
windows of a thousand natural bins that exceed a score T is exp(-(T - a)/b). The two
numbers depend on the number of frames in the window, their overlap and the zero padding,
and were found by simulating noise through the whole stage (`studies.trace_noise`). What
is searched in a kHz and an hour is counted in natural bins, which are as many per kHz as
a frame has milliseconds: white noise in longer frames is the same noise with another
unit of time.

Along a path the active intensity of each cell is taken, less what the bearing of the
noise around it predicts for the cell's power: ambient noise has a bearing, too. Whether
the mean of these vectors is zero is asked by Hotelling's statistic; half of it is
exponential in noise of any directionality, with mean one. Times the slope of the path
score's tail it has that score's own tail, so that their sum has a gamma tail, which sets
the threshold.

**Conventions.** Scores in nepers, rates per kHz of band and hour. Arrays have the shape
(frame, cell), paths (path, frame).

**References.** Gumbel, "Statistics of Extremes" (1958), for the tail; Hotelling (1931);
D'Spain et al. (1991) for the intensity.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.errors import OptionError
from uwtrack_cli.lines.paths.trace_window import WindowData
from uwtrack_cli.lines.sensitivity import weakest_by_path

TAILS = {
    (0.5, 2): ((32, 60, 120, 240), (3.45, -3.44, -16.16, -51.63), (1.611, 2.362, 2.401, 4.211)),
    (0.5, 1): ((32, 60, 120, 240), (4.54, -0.08, -7.53, -29.81), (1.722, 2.437, 2.097, 3.384)),
    (0.75, 2): ((32, 60, 120, 240), (11.71, 9.69, 2.7, -14.11), (2.719, 3.345, 4.096, 4.893)),
    (0.75, 1): ((32, 60, 120, 240), (14.43, 16.48, 18.88, 17.28), (2.671, 3.153, 3.615, 5.991)),
}
"""By overlap and padding: frames in the window, a and b in nepers; rates are those of a
thousand natural bins. That of 120 frames at overlap 0.5 and padding 2, the usual ones, is
.84 nepers above the tail of the search alone: with that 93 lines are told in 61.4 kHz hours
of white noise in frames of .5 to 12 s where one per kHz and hour is stated, and 62 with
this one (`studies.constants.trace_rates 9000 6`)."""

SURROGATES = {
    (0.5, 2): (-6.69, -15.47, -34.78, -73.56),
    (0.5, 1): (-5.92, -13.07, -27.63, -56.5),
    (0.75, 2): (-7.42, -16.96, -37.76, -79.43),
    (0.75, 1): (-7.12, -15.31, -32.27, -64.25),
}
"""Mean best score in a block of white noise of the paths that no line can take
(`recording_noise`), nepers, for the same windows."""

_PATH_GAIN = 0.05
"""Gain per frame of a path that may choose its cells, from simulated lines."""

_CONTINUATION = 1e3
"""Factor on the rate where a line is expected: few places, not all of the band."""

_NEAR_BINS, _OWN_BINS = 24, 3
"""Natural bins to either side that tell the noise's bearing, and those left out."""

_FEWEST_FRAMES = 16
"""Frames below which a path's bearing is not tested."""


class PathScores(NamedTuple):
    """Scores that the paths of a window must exceed, in nepers."""

    new: float
    """For a line that begins."""
    continued: float
    """For a line that was there in the window before."""
    bearing: "PathBearing | None" = None
    """What to add to the scores of paths, if the sensor is directional."""


@dataclass(frozen=True)
class TraceThreshold:
    """Threshold of the path search for a wanted rate of false lines."""

    false_lines_per_khz_hour: float
    """Lines that noise alone may cause, per kHz of band and hour."""
    overlap: float
    """Share of a frame that the next one covers again."""
    padding: int
    """Cells per natural bin."""
    hop_s: float
    """Time from frame to frame, s."""
    window_frames: int
    """Frames that are searched together."""

    @property
    def window_s(self) -> float:
        """Length of a frame, s; it has so many natural bins per Hz."""
        return self.hop_s / (1.0 - self.overlap)

    def scores(self, n_frames: int) -> PathScores:
        """Return the scores that paths of a window must exceed by their power alone."""
        offset, slope = self._tail(n_frames)
        # of a thousand natural bins, in an hour of a kHz
        searched = self.window_s * 3600.0 / (0.5 * n_frames * self.hop_s)
        rate = self.false_lines_per_khz_hour / searched
        new = offset - slope * np.log(rate)
        return PathScores(new, new - slope * np.log(_CONTINUATION))

    def scores_with_bearing(self, data: WindowData) -> PathScores:
        """Return the scores when the evidence of one bearing is added to a path's.

        A path whose bearing is looked at has at least the score that one path in a
        thousand natural bins of noise has; the evidence is multiplied by the slope of the
        tail.

        Notes
        -----
        The sum of two exponential excesses of one slope b over a floor a exceeds T at
        the rate exp(-(T - a)/b) (1 + (T - a)/b).
        """
        n_frames = data.frame.size
        offset, slope = self._tail(n_frames)
        plain = self.scores(n_frames)
        new, continued = (
            offset + slope * _gamma_quantile(max((score - offset) / slope, 0.0))
            for score in (plain.new, plain.continued)
        )
        return PathScores(new, continued, PathBearing(data, slope, offset))

    def _tail(self, n_frames: int) -> tuple[float, float]:
        """Offset and slope of the tail of the best score in noise, in nepers."""
        lengths, offsets, slopes = TAILS[self.overlap, self.padding]
        offset = float(np.interp(n_frames, lengths, offsets))
        return offset, float(np.interp(n_frames, lengths, slopes))

    def surrogate_tail(self, n_frames: int) -> tuple[float, float]:
        """Mean of `surrogate_scores` in white noise, and the slope of the tail."""
        lengths = TAILS[self.overlap, self.padding][0]
        means = SURROGATES[self.overlap, self.padding]
        _, slope = self._tail(n_frames)
        return float(np.interp(n_frames, lengths, means)), slope

    def weakest_line_snr_db(self, *, has_bearing: bool) -> float:
        """Cell SNR of the weakest steady line found with probability one half.

        One bearing is beyond doubt long before a path is: what remains to be exceeded
        is the least score, by its slope.
        """
        n_frames = self.window_frames
        least = self.scores(n_frames).new
        if has_bearing:
            offset, slope = self._tail(n_frames)
            least = min(least, offset + slope)
        return weakest_by_path(least, n_frames, _PATH_GAIN)


def _gamma_quantile(exponent: float) -> float:
    """Solve exp(-x) (1 + x) = exp(-exponent) for x."""
    x = exponent
    for _ in range(60):
        x = exponent + float(np.log1p(x))
    return x


def tail_key(overlap: float, padding: int) -> tuple[float, int]:
    """Return the key of the table for a spectrogram, or refuse it."""
    key = (round(overlap, 3), padding)
    if key not in TAILS:
        known = ", ".join(f"overlap {o:g} with zero padding {p}" for o, p in TAILS)
        raise OptionError(
            f"trace knows the noise of {known}; the spectrogram has overlap "
            f"{overlap:g} with zero padding {padding}. Run 'uwtrack spectrogram' "
            "with one of these."
        )
    return key


@dataclass(frozen=True)
class PathBearing:
    """Adds the evidence of one bearing to the scores of paths."""

    data: WindowData
    """The window."""
    slope: float
    """Factor on half of Hotelling's statistic, nepers."""
    least_score: float
    """Score above which a path is looked at, nepers."""
    is_masked: BoolArray | None = None
    """Cells of lines already found, shape (frame, cell)."""

    def without(self, is_masked: BoolArray) -> "PathBearing":
        """Leave cells out that belong to lines already found."""
        return replace(self, is_masked=is_masked)

    def scores(self, paths: IntArray) -> FloatArray:
        """Return the slope times half of Hotelling's statistic for each path."""
        return np.array([self.slope * self._evidence(path) for path in paths])

    def _evidence(self, path: IntArray) -> float:
        data = self.data
        rows = np.arange(path.size)
        use = data.is_valid.copy()
        if self.is_masked is not None:
            use &= ~self.is_masked[rows, path]
        rows, path = rows[use], path[use]
        if rows.size < _FEWEST_FRAMES or data.east is None or data.north is None:
            return 0.0
        power = data.power[rows, path]
        off = np.arange(_OWN_BINS, _NEAR_BINS + 1) * data.cells_per_bin
        near = path[:, None] + np.concatenate([-off, off])
        near = np.clip(near, 0, data.power.shape[1] - 1)
        around = data.power[rows[:, None], near]
        vectors = np.empty((rows.size, 2))
        for k, part in enumerate((data.east, data.north)):
            usual = np.median(part[rows[:, None], near] / around, axis=1)
            vectors[:, k] = (part[rows, path] - usual * power) / data.floor[rows, path]
        total = vectors.sum(axis=0)
        try:
            turned = np.linalg.solve(vectors.T @ vectors, total)
        except np.linalg.LinAlgError:
            return 0.0
        return 0.5 * float(total @ turned)
