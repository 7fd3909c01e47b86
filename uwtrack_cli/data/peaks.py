"""Spectral peaks, and the harmonic families that they form."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import (
    BoolArray,
    Container,
    FloatArray,
    IntArray,
    column,
    scalar,
)
from uwtrack_cli.data.frames import Frames


@dataclass(frozen=True, eq=False, kw_only=True)
class Peaks(Container):
    """One row per spectral peak, in the order of frame and frequency.

    Peaks below the threshold are kept down to ``kept_probability`` because the
    tracker may use them; ``is_detection`` marks those above it.
    """

    NAME: ClassVar[str] = "peaks"
    STREAMS: ClassVar[bool] = True

    frames: Frames
    """Time base of the peaks, with the noise of each frame."""
    frame: IntArray = column(
        "1", "Index of the frame in the recording.", "peak", dtype=np.int64
    )
    frequency_hz: FloatArray = column("Hz", "Interpolated frequency.", "peak")
    frequency_std_hz: FloatArray = column(
        "Hz", "Standard deviation of the frequency.", "peak", dtype=np.float32
    )
    level_db: FloatArray = column(
        "dB", "Level of the line (re the reference).", "peak", dtype=np.float32
    )
    snr_db: FloatArray = column(
        "dB", "Power of the peak's cell over the noise in it.", "peak",
        dtype=np.float32,
    )  # fmt: skip
    bearing_deg: FloatArray = column(
        "degree", "Compass bearing from the sensor; nan without direction.", "peak",
        dtype=np.float32,
    )  # fmt: skip
    bearing_std_deg: FloatArray = column(
        "degree", "Standard deviation of the bearing.", "peak", dtype=np.float32
    )
    is_detection: BoolArray = column(
        "1", "Whether the peak exceeds the detection threshold.", "peak", dtype=np.bool_
    )
    cone_deg: FloatArray | None = column(
        "degree", "Angle from the head of a line array, 0 to 180; None: no array.",
        "peak", dtype=np.float32, optional=True,
    )  # fmt: skip
    cone_std_deg: FloatArray | None = column(
        "degree", "Standard deviation of that angle.", "peak",
        dtype=np.float32, optional=True,
    )  # fmt: skip
    elevation_deg: FloatArray | None = column(
        "degree", "Angle above the horizontal; None: no planar or volume array.",
        "peak", dtype=np.float32, optional=True,
    )  # fmt: skip
    elevation_std_deg: FloatArray | None = column(
        "degree", "Standard deviation of that angle.", "peak",
        dtype=np.float32, optional=True,
    )  # fmt: skip
    is_aliased: BoolArray | None = column(
        "1", "Whether a grating lobe of the array may stand for the direction.", "peak",
        dtype=np.bool_, optional=True,
    )  # fmt: skip
    false_alarm_probability: float = scalar("1", "Nominal exceedance rate per cell.")
    kept_probability: float = scalar("1", "Exceedance rate of the peaks kept.")
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")
    lowest_hz: float = scalar("Hz", "Lower edge of the band searched.")
    highest_hz: float = scalar("Hz", "Upper edge of the band searched.")


@dataclass(frozen=True, eq=False, kw_only=True)
class Families(Container):
    """Harmonic families: births found in single frames, or lasting ones of lines.

    From `classify_peaks`, ``peaks`` are carried and every peak names its best
    family (-1: none). From `track_lines`, there is one row per lasting family,
    ``frame`` is the frame of its first line and ``peaks`` is None.
    """

    NAME: ClassVar[str] = "families"
    STREAMS: ClassVar[bool] = True

    family: IntArray = column(
        "1", "Identifier of the family.", "family", dtype=np.int64
    )
    frame: IntArray = column(
        "1", "Frame in which the family was found.", "family", dtype=np.int64
    )
    spacing_hz: FloatArray = column("Hz", "Distance of neighbouring teeth.", "family")
    spacing_std_hz: FloatArray = column(
        "Hz", "Standard deviation of the spacing.", "family"
    )
    offset_hz: FloatArray = column(
        "Hz", "Frequency of the lowest tooth modulo the spacing.", "family"
    )
    is_harmonic: BoolArray = column(
        "1", "Whether the teeth are multiples of the spacing.", "family", dtype=np.bool_
    )
    n_members: IntArray = column("1", "Number of members.", "family", dtype=np.int64)
    log10_chance: FloatArray = column(
        "1", "Logarithm of the expected number of such families by chance.", "family"
    )
    peak_family: IntArray = column(
        "1", "Family of each carried peak; -1 for none.", "peak", dtype=np.int64
    )
    peaks: Peaks | None = None
    """Peaks that the families were found in; None for families of lines."""
