"""Contacts of an active sonar: range, bearing and range rate over time."""

from dataclasses import dataclass
from typing import ClassVar

from uwtrack_cli.data.base import (
    Cells,
    Container,
    FloatArray,
    IntArray,
    column,
    deviation,
    scalar,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Contacts(Container):
    """One row per contact and scan; nan is "not measured". Ordered by time."""

    NAME: ClassVar[str] = "contacts"
    ROW: ClassVar[str] = "row"

    contact: IntArray = column("Contact, from 1.", cells=Cells(1, 2**53))
    time_s: FloatArray = column("Time of the scan.")
    range_m: FloatArray = column("Range from own ship.", cells=Cells(0.0, needed=True))
    range_std_m: FloatArray = deviation(cells=Cells(0.0))
    bearing_deg: FloatArray = column(
        "Compass bearing from own ship.", cells=Cells(-360.0, 360.0, needed=True)
    )
    bearing_std_deg: FloatArray = deviation(cells=Cells(0.0))
    range_rate_mps: FloatArray = column("Rate of the range.", cells=Cells(needed=True))
    range_rate_std_mps: FloatArray = deviation(cells=Cells(0.0))
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)
