"""Frames: the time, the valid share and the noise of each spectral frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import Container, FloatArray, IntArray, column, scalar


@dataclass(frozen=True, eq=False, kw_only=True)
class Frames(Container):
    """The time base of a recording's products; rows elsewhere refer to it by index.

    The index of a frame counts from the first frame of the recording:
    ``first_frame`` is the index of this block's first row.
    """

    NAME: ClassVar[str] = "frames"
    ROW: ClassVar[str] = "frame"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("band",)

    start_sample: IntArray = column("First sample of the frame in the recording.")
    time_s: FloatArray = column(
        "Centre of the frame, counted from the first sample that was read (`--start-s`)."
    )
    valid_fraction: FloatArray = column(
        "Share of the frame's samples that are valid; 0 in a gap.", dtype=np.float32
    )
    band_low_hz: FloatArray = column("Lower edge of a noise band.", "band")
    band_high_hz: FloatArray = column("Upper edge of a noise band.", "band")
    noise_db: FloatArray = column(
        "Noise density per band; nan before peaks were sought.", "frame", "band", dtype=np.float32
    )
    threshold_db: FloatArray = column(
        "Detection threshold above the noise; nan before peaks were sought.", dtype=np.float32
    )
    array_heading_deg: FloatArray | None = column(
        "Heading of a line array that does not separate port from starboard; nan where "
        "its "
        "bearings are not given. None: bearings are of one side."
    )
    sensor: str = scalar("Identifier of the sensor.")
    sample_rate_hz: float = scalar("Sample rate of the recording.")
    window_samples: int = scalar("Length of the analysis window.")
    hop_samples: int = scalar("Samples from one frame to the next.")
    fft_length: int = scalar("Length of the transform.")
    first_frame: int = scalar("Index of the first row.", 0)
    start_utc_ns: int | None = scalar("Time of the first sample since 1970-01-01 UTC.", None)

    @classmethod
    def join(cls, blocks: Sequence[Self]) -> Self:
        """Join consecutive blocks; the index counts from the first one's."""
        first = next((block for block in blocks if block.n_frames), blocks[0])
        return replace(super().join(blocks), first_frame=first.first_frame)

    def take(self, axis: str, index: NDArray[Any] | slice) -> Self:
        """Keep the rows ``index``; the index of the first one is adjusted."""
        kept = super().take(axis, index)
        if axis != "frame" or kept.n_frames == 0:
            return kept
        first = int(np.arange(self.n_frames)[index][0])
        return replace(kept, first_frame=self.first_frame + first)

    @property
    def n_frames(self) -> int:
        """Number of rows."""
        return int(self.time_s.size)

    @property
    def hop_s(self) -> float:
        """Time from one frame to the next, s."""
        return self.hop_samples / self.sample_rate_hz

    @property
    def window_s(self) -> float:
        """Length of the analysis window, s."""
        return self.window_samples / self.sample_rate_hz

    @property
    def bin_hz(self) -> float:
        """Distance of two spectral bins, Hz."""
        return self.sample_rate_hz / self.fft_length

    @property
    def cells_per_bin(self) -> int:
        """Spectral cells per natural bin: the zero padding."""
        return max(1, round(self.fft_length / self.window_samples))
