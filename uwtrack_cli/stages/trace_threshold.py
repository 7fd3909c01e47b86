"""The score that noise alone reaches at a stated rate.

**Method.** The best path's score in noise has an exponential tail: the number of
windows per kHz of band that exceed a score T is exp(-(T - a)/b). The two numbers
depend on the length of the window, the overlap of its frames and the zero padding, and
were found by simulating noise through the whole stage (`study_trace_noise`).

**Conventions.** Scores in nepers, rates per kHz of band and hour.

**References.** Gumbel, "Statistics of Extremes" (1958), for the tail.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.errors import OptionError

TAILS = {
    (0.5, 2): ((32, 60, 120, 240), (-2.0, -5.5, -15.6, -30.0), (1.7, 1.9, 2.0, 2.1)),
    (0.5, 1): ((32, 60, 120, 240), (-2.0, -5.5, -15.6, -30.0), (1.7, 1.9, 2.0, 2.1)),
    (0.75, 2): ((32, 60, 120, 240), (-2.0, -5.5, -15.6, -30.0), (1.7, 1.9, 2.0, 2.1)),
    (0.75, 1): ((32, 60, 120, 240), (-2.0, -5.5, -15.6, -30.0), (1.7, 1.9, 2.0, 2.1)),
}
"""By overlap and padding: frames in the window, a and b in nepers."""

_CONTINUATION = 1e3
"""Factor on the rate where a line is expected: few places, not all of the band."""


@dataclass(frozen=True)
class TraceThreshold:
    """Threshold of the path search for a wanted rate of false lines."""

    false_lines_per_khz_hour: float
    overlap: float
    padding: int
    hop_s: float

    def scores(self, n_frames: int) -> tuple[float, float]:
        """Scores for a new line and for one that continues, for a window."""
        lengths, offsets, slopes = TAILS[self.overlap, self.padding]
        offset = float(np.interp(n_frames, lengths, offsets))
        slope = float(np.interp(n_frames, lengths, slopes))
        windows_per_hour = 3600.0 / (0.5 * n_frames * self.hop_s)
        rate = self.false_lines_per_khz_hour / windows_per_hour
        strict = offset - slope * np.log(rate)
        return strict, strict - slope * np.log(_CONTINUATION)

    @property
    def weakest_line_snr_db(self) -> float:
        """Cell SNR of the weakest steady line found with probability one half."""
        return float("nan")


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
