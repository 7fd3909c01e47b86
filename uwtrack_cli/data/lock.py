"""How well the pilots of a sonobuoy's audio were received, second by second."""

from dataclasses import dataclass
from typing import ClassVar

from uwtrack_cli.data.base import Container, FloatArray, column, scalar


@dataclass(frozen=True, eq=False, kw_only=True)
class Lock(Container):
    """Lock of a demultiplexer on the pilots of a buoy."""

    NAME: ClassVar[str] = "lock"
    ROW: ClassVar[str] = "second"

    time_s: FloatArray = column("Begin of the second, counted from the first sample.")
    locked_share: FloatArray = column(
        "Share of the second that is locked; the rest is a gap.", unit="1"
    )
    pilot_snr_db: FloatArray = column(
        "Power of the 7.5 kHz pilot over that of the noise in its band."
    )
    phase_pilot_db: FloatArray = column(
        "Level of the 15 kHz pilot over that of the 7.5 kHz pilot; nan without lock."
    )
    clock_error_ppm: FloatArray = column(
        "Frequency of the pilot over 7.5 kHz less 1; nan without lock.", unit="1e-6"
    )
    sensor: str = scalar("Identifier of the sensor.")
