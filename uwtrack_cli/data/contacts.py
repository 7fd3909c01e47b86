"""Contacts of an active sonar: range, bearing and range rate over time."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import (
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

    contact: IntArray = column("1", "Contact, from 1.", "row", dtype=np.int64)
    time_s: FloatArray = column("s", "Time of the scan.", "row")
    range_m: FloatArray = column("m", "Range from own ship.", "row")
    range_std_m: FloatArray = deviation("m", "row")
    bearing_deg: FloatArray = column("degree", "Compass bearing from own ship.", "row")
    bearing_std_deg: FloatArray = deviation("degree", "row")
    range_rate_mps: FloatArray = column("m/s", "Rate of the range.", "row")
    range_rate_std_mps: FloatArray = deviation("m/s", "row")
    start_utc_ns: int | None = scalar("ns", "UTC epoch of time zero.", None)
