"""Measurements made elsewhere: bearings, frequencies and levels over time."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import Container, FloatArray, IntArray, column, scalar


@dataclass(frozen=True, eq=False, kw_only=True)
class Series(Container):
    """One row per time and contact; nan is "not measured". Read from CSV tables.

    The columns of ``frequency_hz`` are the lines: frequency_hz, frequency_hz_2 ...
    """

    NAME: ClassVar[str] = "series"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("series_line",)

    contact: IntArray = column("1", "Contact, from 1.", "row", dtype=np.int64)
    time_s: FloatArray = column("s", "Time of the row.", "row")
    bearing_deg: FloatArray = column("degree", "Compass bearing.", "row")
    bearing_std_deg: FloatArray = column("degree", "Its standard deviation.", "row")
    frequency_hz: FloatArray = column("Hz", "Frequency.", "row", "series_line")
    frequency_std_hz: FloatArray = column(
        "Hz", "Its standard deviation.", "row", "series_line"
    )
    level_db: FloatArray = column("dB", "Level.", "row")
    level_std_db: FloatArray = column("dB", "Its standard deviation.", "row")
    start_utc_ns: int | None = scalar("ns", "UTC epoch of time zero.", None)
