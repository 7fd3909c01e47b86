"""The score that noise alone reaches at a stated rate.

**Method.** The best path's score in noise has an exponential tail: the number of
windows per kHz of band that exceed a score T is exp(-(T - a)/b). The two numbers
depend on the length of the window, the overlap of its frames and the zero padding, and
were found by simulating noise through the whole stage (`flow.studies.trace_noise`).

**Conventions.** Scores in nepers, rates per kHz of band and hour.

**References.** Gumbel, "Statistics of Extremes" (1958), for the tail.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.errors import OptionError
from uwtrack_cli.stages.lines.sensitivity import weakest_by_path

TAILS = {
    (0.5, 2): (
        (32, 60, 120, 240),
        (3.45, -3.44, -17.0, -51.63),
        (1.611, 2.362, 2.401, 4.211),
    ),
    (0.5, 1): (
        (32, 60, 120, 240),
        (4.54, -0.08, -7.53, -29.81),
        (1.722, 2.437, 2.097, 3.384),
    ),
    (0.75, 2): (
        (32, 60, 120, 240),
        (11.71, 9.69, 2.7, -14.11),
        (2.719, 3.345, 4.096, 4.893),
    ),
    (0.75, 1): (
        (32, 60, 120, 240),
        (14.43, 16.48, 18.88, 17.28),
        (2.671, 3.153, 3.615, 5.991),
    ),
}
"""By overlap and padding: frames in the window, a and b in nepers."""

_PATH_GAIN = 0.05
"""Gain per frame of a path that may choose its cells, from simulated lines."""

_CONTINUATION = 1e3
"""Factor on the rate where a line is expected: few places, not all of the band."""


@dataclass(frozen=True)
class TraceThreshold:
    """Threshold of the path search for a wanted rate of false lines."""

    false_lines_per_khz_hour: float
    overlap: float
    padding: int
    hop_s: float
    window_frames: int

    def scores(self, n_frames: int) -> tuple[float, float]:
        """Scores for a new line and for one that continues, for a window."""
        lengths, offsets, slopes = TAILS[self.overlap, self.padding]
        offset = float(np.interp(n_frames, lengths, offsets))
        slope = float(np.interp(n_frames, lengths, slopes))
        windows_per_hour = 3600.0 / (0.5 * n_frames * self.hop_s)
        rate = self.false_lines_per_khz_hour / windows_per_hour
        strict = offset - slope * np.log(rate)
        return strict, strict - slope * np.log(_CONTINUATION)

    def scores_with_bearing(self, n_frames: int) -> tuple[float, float, float, float]:
        """Scores as above when the evidence of one bearing is added to a path's.

        Also the least score of a path whose bearing is looked at, where a kHz of noise
        has one, and the slope by which the evidence is multiplied.

        Notes
        -----
        The sum of two exponential excesses of one slope b over a floor a exceeds T at
        the rate exp(-(T - a)/b) (1 + (T - a)/b).
        """
        lengths, offsets, slopes = TAILS[self.overlap, self.padding]
        offset = float(np.interp(n_frames, lengths, offsets))
        slope = float(np.interp(n_frames, lengths, slopes))
        strict, lax = (
            offset + slope * _gamma_quantile(max((score - offset) / slope, 0.0))
            for score in self.scores(n_frames)
        )
        return strict, lax, offset, slope

    def weakest_line_snr_db(self, *, has_bearing: bool) -> float:
        """Cell SNR of the weakest steady line found with probability one half.

        One bearing is beyond doubt long before a path is: what remains to be exceeded
        is the least score, by its slope.
        """
        n_frames = self.window_frames
        strict, _ = self.scores(n_frames)
        if has_bearing:
            _, _, least, slope = self.scores_with_bearing(n_frames)
            strict = min(strict, least + slope)
        return weakest_by_path(strict, n_frames, _PATH_GAIN)


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
        msg = (
            f"trace knows the noise of {known}; the spectrogram has overlap "
            f"{overlap:g} with zero padding {padding}. Run 'uwtrack spectrogram' "
            "with one of these."
        )
        raise OptionError(msg)
    return key
