"""Tracked frequency lines: smoothed states beside the raw measurements."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from uwtrack_cli.data.base import Container, FloatArray, IntArray, TextArray, column, scalar
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Families

DETECTED, SUB_THRESHOLD, COASTED = 2, 1, 0
"""Values of `Lines.association`."""

SAME_WINDOW = 0.01
"""Relative difference of lengths of frames that are one: they are whole samples."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Lines(Container):
    """One row per point of a line, and one row per line.

    The points are ordered by line and time. ``measured_*`` are the raw associated
    measurements (nan where the line coasted): fits use these, never the smoothed
    states, whose errors are correlated. In a stream, blocks carry the points that
    are final; the table of lines comes with the last block.

    Points of several lengths of frames (the rungs of a ladder) have theirs in
    ``window_s``. The frames are those of the shortest rung then, ``frame`` is the one
    nearest to the point, and all rungs overlap by the same share.
    """

    NAME: ClassVar[str] = "lines"
    ROW: ClassVar[str] = "point"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("state", "state_too")

    frames: Frames
    """Time base of the points, with the noise of each frame."""
    families: Families
    """Harmonic families of the lines."""
    line: IntArray = column("Line of the point.", dtype=np.int32)
    frame: IntArray = column("Frame of the point.", dtype=np.int32)
    time_s: FloatArray = column("Centre of the frame, counted from the first sample.")
    frequency_hz: FloatArray = column("Smoothed frequency.")
    frequency_rate_hzps: FloatArray = column("Its rate of change.", dtype=np.float32)
    frequency_covariance: FloatArray = column(
        "Covariance of frequency and rate (Hz, Hz/s).",
        "point", "state", "state_too", unit="Hz^2", dtype=np.float32,
    )  # fmt: skip
    bearing_deg: FloatArray = column(
        "Smoothed compass bearing; nan without direction.", dtype=np.float32
    )
    bearing_rate_degps: FloatArray = column("Its rate of change.", dtype=np.float32)
    bearing_covariance: FloatArray = column(
        "Covariance of bearing and rate (degree, degree/s).",
        "point", "state", "state_too", unit="degree^2", dtype=np.float32,
    )  # fmt: skip
    association: IntArray = column("2 detected, 1 below the threshold, 0 coasted.", dtype=np.int8)
    measured_frequency_hz: FloatArray = column("Raw frequency.")
    measured_frequency_std_hz: FloatArray = column(
        "Standard deviation of the raw frequency.", dtype=np.float32
    )
    measured_bearing_deg: FloatArray = column("Raw bearing.", dtype=np.float32)
    measured_bearing_std_deg: FloatArray = column(
        "Standard deviation of the raw bearing.", dtype=np.float32
    )
    measured_level_db: FloatArray = column("Raw level of the line.", dtype=np.float32)
    measured_snr_db: FloatArray = column(
        "Power of the line's cell over the noise in it.", dtype=np.float32
    )
    window_s: FloatArray | None = column(
        "Length of the point's own frame, where rungs of a ladder are joined; None: "
        "that of the frames."
    )
    line_id: IntArray = column("Identifier of the line.", "line")
    line_contact: IntArray = column("Contact that the line belongs to, from 1; 0 for none.", "line")
    line_family: IntArray = column("Harmonic family of the line; -1 for none.", "line")
    line_status: TextArray = column(
        "'moving', 'steady' or 'hum' (mains, no Doppler, no bearing change).", "line"
    )
    line_unresolved_share: FloatArray | None = column(
        "Share of its time in which another line is nearer than 1.75 natural bins, and "
        "the two are not resolved.", "line",
    )  # fmt: skip
    jump_time_s: FloatArray | None = column(
        "When a machine changed its speed at once, and its lines with it.", "jump"
    )
    jump_ratio: FloatArray | None = column("Its rate afterwards over the rate before.", "jump")
    jump_ratio_std: FloatArray | None = column("Standard deviation of the ratio.", "jump")
    jump_line_count: IntArray | None = column("Lines that jumped together.", "jump")
    jump_contact: IntArray | None = column("Contact of these lines; 0 for none.", "jump")
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
    false_lines_per_khz_hour: float = scalar(
        "Expected rate of lines in noise alone.", unit="1/(kHz h)"
    )
    weakest_line_snr_db: float = scalar(
        "Cell SNR of the weakest steady line found with probability 0.5."
    )
    measured_false_lines_per_khz_hour: float = scalar(
        "The same rate as measured on the recording's own noise; nan if it was not.",
        float('nan'), unit="1/(kHz h)",
    )  # fmt: skip

    @classmethod
    def join(cls, blocks: Sequence[Self]) -> Self:
        """Join consecutive blocks of a stream; points by line, then by time.

        Column by column, so that there is never a second copy of all points.
        """
        rest = super().join([block.take("point", slice(0)) for block in blocks])
        line, frame = (
            np.concatenate([getattr(block, name) for block in blocks]) for name in ("line", "frame")
        )
        order = point_order(line, frame)
        points: dict[str, Any] = {
            name: np.concatenate([getattr(block, name) for block in blocks])[order]
            for name, spec in cls.columns().items()
            if spec.axes[0] == "point" and all(getattr(block, name) is not None for block in blocks)
        }
        return replace(rest, **points)

    @property
    def point_window_s(self) -> FloatArray:
        """Length of each point's frame, s, shape (point,)."""
        if self.window_s is not None:
            return self.window_s
        return np.full(self.line.size, self.frames.window_s)

    @property
    def overlap_frames(self) -> float:
        """Length of a frame in steps from one to the next, one at least."""
        return max(1.0, self.frames.window_s / max(self.frames.hop_s, 1e-9))

    def of_window(self, window_s: float) -> Self:
        """Return the points of frames of one length; all if they are not told apart.

        ``window_s``: length of the frames, s.
        """
        if self.window_s is None:
            return self
        own = np.abs(self.window_s / window_s - 1.0) < SAME_WINDOW
        kept = self.take("point", np.flatnonzero(own))
        return kept.take("line", np.flatnonzero(np.isin(kept.line_id, kept.line)))


def point_order(line: IntArray, frame: IntArray) -> IntArray:
    """Return the order of points by line, then by frame.

    ``line``, ``frame``: line and frame of each point, shape (point,).
    """
    return np.lexsort((frame, line))
