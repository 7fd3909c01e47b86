"""Measurements made elsewhere: bearings, frequencies and levels over time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import (
    Cells,
    Container,
    FloatArray,
    IntArray,
    TextArray,
    column,
    deviation,
    scalar,
)

TINY = float(np.finfo(np.float64).tiny)
BEARING, DEVIATION = Cells(-360.0, 360.0), Cells(TINY, 1e9)


@dataclass(frozen=True, eq=False, kw_only=True)
class Series(Container):
    """One row per time and contact; nan is "not measured". Read from CSV tables.

    The columns of ``frequency_hz`` are the lines: frequency_hz, frequency_hz_2 ... A
    table of several sensors says of every row which one heard it and where that was;
    what is known of each sensor is a table of its own (``sensor_id`` ...).
    """

    NAME: ClassVar[str] = "series"
    ROW: ClassVar[str] = "row"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("series_line",)

    contact: IntArray = column("Contact, from 1.", cells=Cells(1, 2**53, every=True))
    time_s: FloatArray = column("Time of the row.")
    bearing_deg: FloatArray = column("Compass bearing.", cells=BEARING)
    bearing_std_deg: FloatArray = deviation(cells=DEVIATION)
    frequency_hz: FloatArray = column(
        "Frequency.", "row", "series_line", cells=Cells(TINY, 1e15, needed=True)
    )
    frequency_std_hz: FloatArray = deviation("row", "series_line", cells=DEVIATION)
    level_db: FloatArray = column("Level.", cells=Cells(-1e3, 1e3))
    level_std_db: FloatArray = deviation(cells=DEVIATION)
    bounce_delay_s: FloatArray | None = column(
        "Multipath delay: time by which the path that the bottom or the surface reflects "
        "once comes after the direct one.", cells=Cells(TINY, 1e3),
    )  # fmt: skip
    bounce_delay_std_s: FloatArray | None = column("Standard deviation of it.", cells=DEVIATION)
    mirrored_bearing_deg: FloatArray | None = column(
        "Other bearing that fits a line array as well; nan where the side is resolved.",
        cells=BEARING,
    )
    sensor: TextArray | None = column("Sensor that measured the row.", cells=Cells())
    sensor_east_m: FloatArray | None = column("Where the sensor was, east of the origin.")
    sensor_north_m: FloatArray | None = column("Where the sensor was, north of the origin.")
    sensor_id: TextArray | None = column("Identifier of every sensor of the table.", "platform")
    sensor_compass_std_deg: FloatArray | None = column(
        "Standard deviation of its compass; nan where it is not given.", "platform"
    )
    sensor_position_std_m: FloatArray | None = column(
        "Deviation of each coordinate of its place.", "platform"
    )
    origin: str = scalar("What the grid is relative to: a sensor or 'grid'.", "")
    origin_latitude: float | None = scalar("Latitude of the origin.", None)
    origin_longitude: float | None = scalar("Longitude of the origin.", None)
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)
    contact_numbers: str = scalar(
        "Whose the numbers of contacts are where several sensors measured: 'own' of each "
        "sensor, or 'common' to all, as in a table without a column contact.", "own",
    )  # fmt: skip
    where: Callable[[int], str] | None = scalar(
        "Names the file and line in which a row stood; not stored.", None
    )

    def begin_of(self, row: int) -> str:
        """Return how a sentence about a row begins: its file and line, if known.

        ``row``: row of the series, from 0.
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
