"""Spectral peaks, and the harmonic families that they form."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import BoolArray, Container, FloatArray, IntArray, column, scalar
from uwtrack_cli.data.frames import Frames


@dataclass(frozen=True, eq=False, kw_only=True)
class Peaks(Container):
    """One row per spectral peak, in the order of frame and frequency.

    Peaks below the threshold are kept down to ``kept_probability`` because the
    tracker may use them; ``is_detection`` marks those above it.
    """

    NAME: ClassVar[str] = "peaks"
    ROW: ClassVar[str] = "peak"
    STREAMS: ClassVar[bool] = True

    frames: Frames
    """Time base of the peaks, with the noise of each frame."""
    frame: IntArray = column("Index of the frame in the recording.")
    frequency_hz: FloatArray = column("Interpolated frequency.")
    frequency_std_hz: FloatArray = column("Standard deviation of the frequency.", dtype=np.float32)
    level_db: FloatArray = column("Level of the line (re the reference).", dtype=np.float32)
    snr_db: FloatArray = column("Power of the peak's cell over the noise in it.", dtype=np.float32)
    bearing_deg: FloatArray = column(
        "Compass bearing from the sensor; nan without direction.", dtype=np.float32
    )
    bearing_std_deg: FloatArray = column("Standard deviation of the bearing.", dtype=np.float32)
    is_detection: BoolArray = column("Whether the peak exceeds the detection threshold.")
    cone_deg: FloatArray | None = column(
        "Angle from the head of a line array, 0 to 180; None: no array.", dtype=np.float32
    )
    cone_std_deg: FloatArray | None = column("Standard deviation of that angle.", dtype=np.float32)
    elevation_deg: FloatArray | None = column(
        "Angle above the horizontal; None: no planar or volume array.", dtype=np.float32
    )
    elevation_std_deg: FloatArray | None = column(
        "Standard deviation of that angle.", dtype=np.float32
    )
    is_aliased: BoolArray | None = column(
        "Whether a grating lobe of the array may stand for the direction."
    )
    false_alarm_probability: float = scalar("Nominal exceedance rate per cell.")
    kept_probability: float = scalar("Exceedance rate of the peaks kept.")
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
    lowest_hz: float = scalar("Lower edge of the band searched.")
    highest_hz: float = scalar("Upper edge of the band searched.")


@dataclass(frozen=True, eq=False, kw_only=True)
class Families(Container):
    """Harmonic families: births found in single frames, or lasting ones of lines.

    From `classify_peaks`, ``peaks`` are carried and every peak names its best
    family (-1: none). From `track_lines`, there is one row per lasting family,
    ``frame`` is the frame of its first line and ``peaks`` is None.
    """

    NAME: ClassVar[str] = "families"
    ROW: ClassVar[str] = "family"
    STREAMS: ClassVar[bool] = True

    family: IntArray = column("Identifier of the family.")
    frame: IntArray = column("Frame in which the family was found.")
    spacing_hz: FloatArray = column("Distance of neighbouring teeth.")
    spacing_std_hz: FloatArray = column("Standard deviation of the spacing.")
    offset_hz: FloatArray = column("Frequency of the lowest tooth modulo the spacing.")
    is_harmonic: BoolArray = column("Whether the teeth are multiples of the spacing.")
    n_members: IntArray = column("Number of members.")
    log10_chance: FloatArray = column(
        "Logarithm of the expected number of such families by chance."
    )
    peak_family: IntArray = column("Family of each carried peak; -1 for none.", "peak")
    peaks: Peaks | None = None
    """Peaks that the families were found in; None for families of lines."""
