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
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("band",)

    time_s: FloatArray = column("s", "Middle of a row, from the first sample.", "row")
    centre_hz: FloatArray = column(
        "Hz", "Centre of a band: 1000 Hz times a power of 10^(1/10).", "band"
    )
    level_db: FloatArray = column(
        "dB", "Mean square in the band (re the reference); nan where samples are missing.",
        "row", "band", dtype=np.float32,
    )  # fmt: skip
    average_s: float = scalar("s", "Time that a row is averaged over.")
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")
    sensor: str = scalar("", "Identifier of the sensor.")
    start_utc_ns: int | None = scalar(
        "ns", "First sample since 1970-01-01 UTC; None if unknown."
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class RadiatedLevels(HasReasons):
    """Radiated noise levels of passages in decidecade bands; a row per passage and band.

    They are levels at 1 m under spherical spreading, the surface image included, of a single
    passage past a single hydrophone: not ISO 17208.
    """

    NAME: ClassVar[str] = "radiated"

    contact: IntArray = column("1", "Contact of the passage.", "level", dtype=np.int64)
    sensor: TextArray = column("", "Identifier of the sensor.", "level", dtype="U")
    time_utc_ns: IntArray = column(
        "ns", "Closest approach since 1970-01-01 UTC; -1 if the start is unknown.",
        "level", dtype=np.int64,
    )  # fmt: skip
    centre_hz: FloatArray = column("Hz", "Centre of the band.", "level")
    radiated_noise_level_db: FloatArray = column(
        "dB", "Radiated noise level, re 1 uPa at 1 m.", "level"
    )
    radiated_noise_level_std_db: FloatArray = deviation("dB", "level")
    received_level_db: FloatArray = column(
        "dB", "Mean square in the band while the vessel was within 30 degrees.", "level"
    )
    background_level_db: FloatArray = column(
        "dB", "Mean square in the band without the vessel.", "level"
    )
    reason_level: IntArray = column(
        "1", "Row of the level that a reason belongs to.", "reason",
        dtype=np.int64, owner="level",
    )  # fmt: skip
    spreading_db: float = scalar("dB", "Loss per decade of range that was assumed.")
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")
