"""Measurements made elsewhere: bearings, frequencies and levels over time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import (
    Container,
    FloatArray,
    IntArray,
    TextArray,
    column,
    deviation,
    scalar,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Series(Container):
    """One row per time and contact; nan is "not measured". Read from CSV tables.

    The columns of ``frequency_hz`` are the lines: frequency_hz, frequency_hz_2 ... A
    table of several sensors says of every row which one heard it and where that was;
    what is known of each sensor is a table of its own (``sensor_id`` ...).
    """

    NAME: ClassVar[str] = "series"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("series_line",)

    contact: IntArray = column("1", "Contact, from 1.", "row", dtype=np.int64)
    time_s: FloatArray = column("s", "Time of the row.", "row")
    bearing_deg: FloatArray = column("degree", "Compass bearing.", "row")
    bearing_std_deg: FloatArray = deviation("degree", "row")
    frequency_hz: FloatArray = column("Hz", "Frequency.", "row", "series_line")
    frequency_std_hz: FloatArray = deviation("Hz", "row", "series_line")
    level_db: FloatArray = column("dB", "Level.", "row")
    level_std_db: FloatArray = deviation("dB", "row")
    mirrored_bearing_deg: FloatArray | None = column(
        "degree", "Other bearing that a line array cannot tell from the first; nan where "
        "the side is resolved.", "row", optional=True,
    )  # fmt: skip
    sensor: TextArray | None = column(
        "", "Sensor that heard the row.", "row", dtype=np.str_, optional=True
    )
    sensor_east_m: FloatArray | None = column(
        "m", "Where the sensor was, east of the origin.", "row", optional=True
    )
    sensor_north_m: FloatArray | None = column(
        "m", "Where the sensor was, north of the origin.", "row", optional=True
    )
    sensor_id: TextArray | None = column(
        "", "Identifier of every sensor of the table.", "platform",
        dtype=np.str_, optional=True,
    )  # fmt: skip
    sensor_compass_std_deg: FloatArray | None = column(
        "degree", "Deviation of its compass; nan where it is not told.", "platform",
        optional=True,
    )  # fmt: skip
    sensor_position_std_m: FloatArray | None = column(
        "m", "Deviation of each coordinate of its place.", "platform", optional=True
    )
    origin: str = scalar("", "What the grid is relative to: a sensor or 'grid'.", "")
    origin_latitude: float | None = scalar("degree", "Latitude of the origin.", None)
    origin_longitude: float | None = scalar("degree", "Longitude of the origin.", None)
    start_utc_ns: int | None = scalar("ns", "UTC epoch of time zero.", None)
    where: Callable[[int], str] | None = scalar(
        "", "Names the file and line in which a row stood; not stored.", None
    )

    def begin_of(self, row: int) -> str:
        """Return how a sentence about a row begins: its file and line, if known.

        Parameters
        ----------
        row
            Row of the series, from 0.
        """
        return "" if self.where is None else f"{self.where(row)}: "

    def take(self, axis: str, index: NDArray[Any] | slice) -> Self:
        """Keep the rows ``index`` of every column on ``axis``.

        Where rows stood is no longer known when some of them are left out.
        """
        kept = super().take(axis, index)
        return replace(kept, where=None) if axis == "row" else kept

    def equals(self, other: object) -> bool:
        """Tell whether all values are the same, wherever they stood."""
        if not isinstance(other, Series):
            return False
        return Container.equals(replace(self, where=None), replace(other, where=None))
