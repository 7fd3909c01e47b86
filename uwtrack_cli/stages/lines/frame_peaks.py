"""The peaks of a block, frame by frame, as the tracker wants them, and what it takes.

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
    """The peaks of one frame, ascending in frequency, as plain arrays."""

    frequency: FloatArray
    variance: FloatArray
    bearing: FloatArray
    bearing_variance: FloatArray
    raw: FloatArray
    """Rows: frequency, its deviation, bearing, its deviation, level, SNR."""
    is_detection: BoolArray
    is_in_family: BoolArray
    threshold_db: float
    has_bearings: bool


def split_frames(block: Families | Peaks, peaks: Peaks) -> Iterator[FramePeaks]:
    """Yield the peaks of each frame of a block, those of empty frames, too."""
    frames = peaks.frames
    raw = np.stack([
        np.asarray(column, dtype=float) for column in (
            peaks.frequency_hz, peaks.frequency_std_hz, peaks.bearing_deg,
            peaks.bearing_std_deg, peaks.level_db, peaks.snr_db,
        )
    ])  # fmt: skip
    variance = np.maximum(raw[1], LEAST_STD / frames.window_s) ** 2
    turn_variance = np.where(np.isnan(raw[2] + raw[3]), np.inf, raw[3] ** 2)
    is_member = (
        block.peak_family >= 0
        if isinstance(block, Families)
        else np.ones(peaks.frame.size, dtype=bool)
    )
    known = np.append(0, np.cumsum(np.isfinite(raw[2])))
    numbers = frames.first_frame + np.arange(frames.n_frames + 1)
    edges = np.searchsorted(peaks.frame, numbers).tolist()
    for k in range(frames.n_frames):
        at = slice(edges[k], edges[k + 1])
        yield FramePeaks(
            raw[0, at], variance[at], raw[2, at], turn_variance[at], raw[:, at],
            peaks.is_detection[at], is_member[at], float(frames.threshold_db[k]),
            bool(known[edges[k]] < known[edges[k + 1]]),
        )  # fmt: skip


@dataclass
class Choice:
    """What each line takes, and the evidence of all peaks in the young lines' gates."""

    line: IntArray
    peak: IntArray
    gain: FloatArray
    evidence: FloatArray
    """Sum of the likelihood ratios of a tentative line's peaks, shape (tentative,)."""
