"""Spectrogram, its small picture and the level of each frame."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import Container, FloatArray, IntArray, column, scalar
from uwtrack_cli.data.frames import Frames

FULL_SCALE = "full scale"
"""Level reference of a recording without calibration."""

MICROPASCAL = "1 uPa"
"""Level reference of a calibrated recording."""

MODULATION = "modulation"
"""Level reference of envelope spectra: the mean power of the noise that is modulated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Spectrogram(Container):
    """One-sided power density; for a vector sensor also the active intensity.

    Of an envelope (`demodulate`) the frequency is the modulation rate, the density is
    that of the relative modulation, and the reference is 'modulation'.
    """

    NAME: ClassVar[str] = "spectrogram"
    ROW: ClassVar[str] = "frame"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("frequency",)

    frames: Frames
    """Time base of the rows."""
    frequency_hz: FloatArray = column("Centre of a bin.", "frequency")
    power_density: FloatArray = column(
        "One-sided power density.", "frame", "frequency", unit="reference^2/Hz", dtype=np.float32
    )
    intensity_east: FloatArray | None = column(
        "Real part of omni times conjugate east channel.",
        "frame", "frequency", unit="reference^2/Hz", dtype=np.float32,
    )  # fmt: skip
    intensity_north: FloatArray | None = column(
        "Real part of omni times conjugate north channel.",
        "frame", "frequency", unit="reference^2/Hz", dtype=np.float32,
    )  # fmt: skip
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")

    @property
    def has_bearing(self) -> bool:
        """Whether the sensor hears directions."""
        return self.intensity_east is not None


@dataclass(frozen=True, eq=False, kw_only=True)
class Overview(Container):
    """A small max-pooled picture of the spectrogram, for plots and reports."""

    NAME: ClassVar[str] = "overview"
    ROW: ClassVar[str] = "row"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("pixel_frequency",)

    time_s: FloatArray = column("Centre of a row.")
    frequency_hz: FloatArray = column("Centre of a column.", "pixel_frequency")
    shade: IntArray = column(
        "Level in 256 steps from floor_db to ceiling_db.", "row", "pixel_frequency", dtype=np.uint8
    )
    floor_db: float = scalar("Level of shade 0.")
    ceiling_db: float = scalar("Level of shade 255.")
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
    sensor: str = scalar("Identifier of the sensor.")


@dataclass(frozen=True, eq=False, kw_only=True)
class Levels(Container):
    """Broadband level between the lines and broadband bearing, per frame."""

    NAME: ClassVar[str] = "levels"
    ROW: ClassVar[str] = "frame"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("part",)

    frames: Frames
    """Time base of the rows."""
    level_db: FloatArray = column("Level in the band, for people (re the reference).")
    excess_db: FloatArray = column("Level against the quiet-time density, for the fit.")
    excess_std_db: FloatArray = column("Standard deviation of the excess.")
    tilt_db: FloatArray | None = column(
        "Excess of the upper half of the band over that of its lowest quarter."
    )
    bearing_deg: FloatArray = column("Compass bearing from the sensor; nan without direction.")
    bearing_std_deg: FloatArray = column("Standard deviation of the bearing.")
    part_excess_db: FloatArray | None = column(
        "Excess of equal parts of the band, lowest first.", "frame", "part", dtype=np.float32
    )
    band_low_hz: float = scalar("Lower edge of the band.")
    band_high_hz: float = scalar("Upper edge of the band.")
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
