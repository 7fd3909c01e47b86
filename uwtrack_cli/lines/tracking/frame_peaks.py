"""The peaks of a block, frame by frame, and what the lines take of them.

**Conventions.** A bearing that was not measured has an infinite variance.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.peaks import Families, Peaks

LEAST_STD = 0.02
"""Floor of a measurement's deviation in resolutions: interpolation has a bias."""


@dataclass(frozen=True)
class FramePeaks:
    """The peaks of one frame, ascending in frequency."""

    frequency_hz: FloatArray
    """Frequencies, shape (peak,)."""
    frequency_variance_hz2: FloatArray
    """Variances of the frequencies, shape (peak,)."""
    bearing_deg: FloatArray
    """Bearings; nan where unknown; shape (peak,)."""
    bearing_variance_deg2: FloatArray
    """Variances of the bearings; inf where unknown; shape (peak,)."""
    measured: FloatArray
    """Frequency and its deviation (Hz), bearing and its deviation (degree), level (dB) and
    SNR (dB), as `LinePoints.measured`, shape (N_MEASURED, peak)."""
    is_detection: BoolArray
    """Whether a peak exceeds the detection threshold, shape (peak,)."""
    is_in_family: BoolArray
    """Whether a peak belongs to a harmonic family, shape (peak,)."""
    threshold_db: float
    """Detection threshold over the noise, dB."""
    has_bearings: bool
    """Whether any bearing is known."""

    @property
    def snr_db(self) -> FloatArray:
        """Power of the line over the noise in its cell, dB, shape (peak,)."""
        return np.asarray(self.measured[5])


@dataclass
class Choice:
    """What each line takes, and the evidence of all peaks in the tentative lines' gates."""

    line: IntArray
    """Position of the line among the active ones, shape (pair,)."""
    peak: IntArray
    """Position of its peak in the frame, shape (pair,)."""
    gain: FloatArray
    """Log-likelihood ratio "this line's peak" against "noise", nepers, shape (pair,)."""
    evidence: FloatArray
    """Sum of the likelihood ratios of a tentative line's peaks, shape (tentative,)."""

    def take(self, pairs: BoolArray) -> "Choice":
        """Return some of the pairs; the evidence stays whole."""
        return Choice(self.line[pairs], self.peak[pairs], self.gain[pairs], self.evidence)


def split_frames(block: Families | Peaks, peaks: Peaks) -> Iterator[FramePeaks]:
    """Yield the peaks of each frame of a block, those of empty frames, too."""
    frames = peaks.frames
    measured = np.stack([
        np.asarray(column, dtype=float) for column in (
            peaks.frequency_hz, peaks.frequency_std_hz, peaks.bearing_deg,
            peaks.bearing_std_deg, peaks.level_db, peaks.snr_db,
        )
    ])  # fmt: skip
    variance = np.maximum(measured[1], LEAST_STD / frames.window_s) ** 2
    bearing = measured[2]
    if peaks.cone_deg is not None and peaks.is_aliased is not None:
        # one of a line array's lobes, which another frame may name by another
        bearing = np.where(peaks.is_aliased, np.nan, bearing)
    is_unknown = np.isnan(bearing + measured[3])
    bearing_variance = np.where(is_unknown, np.inf, measured[3] ** 2)
    is_member = (
        block.peak_family >= 0
        if isinstance(block, Families)
        else np.ones(peaks.frame.size, dtype=bool)
    )
    known = np.append(0, np.cumsum(np.isfinite(bearing)))
    numbers = frames.first_frame + np.arange(frames.n_frames + 1)
    edges = np.searchsorted(peaks.frame, numbers).tolist()
    for k in range(frames.n_frames):
        at = slice(edges[k], edges[k + 1])
        yield FramePeaks(
            measured[0, at], variance[at], bearing[at], bearing_variance[at],
            measured[:, at], peaks.is_detection[at], is_member[at],
            float(frames.threshold_db[k]), bool(known[edges[k]] < known[edges[k + 1]]),
        )  # fmt: skip
