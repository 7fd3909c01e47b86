"""Levels in decidecade bands: of the sound along time, and of passages."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import (
    Container,
    FloatArray,
    HasReasons,
    IntArray,
    TextArray,
    column,
    deviation,
    scalar,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Decidecades(Container):
    """Sound pressure levels in decidecade bands, averaged over a second or so a row."""

    NAME: ClassVar[str] = "decidecades"
    ROW: ClassVar[str] = "row"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("band",)

    time_s: FloatArray = column("Middle of a row, from the first sample.")
    centre_hz: FloatArray = column("Centre of a band: 1000 Hz times a power of 10^(1/10).", "band")
    level_db: FloatArray = column(
        "Mean square in the band (re the reference); nan where samples are missing.",
        "row", "band", dtype=np.float32,
    )  # fmt: skip
    average_s: float = scalar("Time that a row is averaged over.")
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
    sensor: str = scalar("Identifier of the sensor.")
    start_utc_ns: int | None = scalar("First sample since 1970-01-01 UTC; None if unknown.")


@dataclass(frozen=True, eq=False, kw_only=True)
class RadiatedLevels(HasReasons):
    """Radiated noise levels of passages in decidecade bands; a row per passage and band.

    They are levels at 1 m under spherical spreading, the surface image included, of a single
    passage past a single hydrophone: not ISO 17208.
    """

    NAME: ClassVar[str] = "radiated"
    ROW: ClassVar[str] = "level"

    contact: IntArray = column("Contact of the passage.")
    sensor: TextArray = column("Identifier of the sensor.")
    time_utc_ns: IntArray = column(
        "Closest approach since 1970-01-01 UTC; -1 if the start is unknown."
    )
    centre_hz: FloatArray = column("Centre of the band.")
    radiated_noise_level_db: FloatArray = column("Radiated noise level, re 1 uPa at 1 m.")
    radiated_noise_level_std_db: FloatArray = deviation()
    received_level_db: FloatArray = column(
        "Mean square in the band while the vessel was within 30 degrees."
    )
    background_level_db: FloatArray = column("Mean square in the band without the vessel.")
    reason_level: IntArray = column(
        "Row of the level that a reason belongs to.", "reason", owner="level"
    )
    spreading_db: float = scalar("Loss per decade of range that was assumed.")
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
