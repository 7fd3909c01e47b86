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
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("frequency",)

    frames: Frames
    """Time base of the rows."""
    frequency_hz: FloatArray = column("Hz", "Centre of a bin.", "frequency")
    power_density: FloatArray = column(
        "reference^2/Hz", "One-sided power density.", "frame", "frequency",
        dtype=np.float32,
    )  # fmt: skip
    intensity_east: FloatArray | None = column(
        "reference^2/Hz", "Real part of omni times conjugate east channel.",
        "frame", "frequency", dtype=np.float32, optional=True,
    )  # fmt: skip
    intensity_north: FloatArray | None = column(
        "reference^2/Hz", "Real part of omni times conjugate north channel.",
        "frame", "frequency", dtype=np.float32, optional=True,
    )  # fmt: skip
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")

    @property
    def has_bearing(self) -> bool:
        """Whether the sensor hears directions."""
        return self.intensity_east is not None


@dataclass(frozen=True, eq=False, kw_only=True)
class Overview(Container):
    """A small max-pooled picture of the spectrogram, for plots and reports."""

    NAME: ClassVar[str] = "overview"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("pixel_frequency",)

    time_s: FloatArray = column("s", "Centre of a row.", "row")
    frequency_hz: FloatArray = column("Hz", "Centre of a column.", "pixel_frequency")
    shade: IntArray = column(
        "1", "Level in 256 steps from floor_db to ceiling_db.",
        "row", "pixel_frequency", dtype=np.uint8,
    )  # fmt: skip
    floor_db: float = scalar("dB", "Level of shade 0.")
    ceiling_db: float = scalar("dB", "Level of shade 255.")
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")
    sensor: str = scalar("", "Identifier of the sensor.")


@dataclass(frozen=True, eq=False, kw_only=True)
class Levels(Container):
    """Broadband level between the lines and broadband bearing, per frame."""

    NAME: ClassVar[str] = "levels"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("part",)

    frames: Frames
    """Time base of the rows."""
    level_db: FloatArray = column(
        "dB", "Level in the band, for people (re the reference).", "frame"
    )
    excess_db: FloatArray = column(
        "dB", "Level against the quiet-time density, for the fit.", "frame"
    )
    excess_std_db: FloatArray = column(
        "dB", "Standard deviation of the excess.", "frame"
    )
    tilt_db: FloatArray | None = column(
        "dB", "Excess of the upper half of the band over that of its lowest quarter.",
        "frame", optional=True,
    )  # fmt: skip
    bearing_deg: FloatArray = column(
        "degree", "Compass bearing from the sensor; nan without direction.", "frame"
    )
    bearing_std_deg: FloatArray = column(
        "degree", "Standard deviation of the bearing.", "frame"
    )
    part_excess_db: FloatArray | None = column(
        "dB", "Excess of equal parts of the band, lowest first.", "frame", "part",
        dtype=np.float32, optional=True,
    )  # fmt: skip
    band_low_hz: float = scalar("Hz", "Lower edge of the band.")
    band_high_hz: float = scalar("Hz", "Upper edge of the band.")
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")
