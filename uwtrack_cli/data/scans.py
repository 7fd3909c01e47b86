"""Scans of measurements among clutter, and the measured curve of a detector."""

from dataclasses import dataclass
from typing import ClassVar

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Scans(Container):
    """One row per measurement, ordered by scan; an empty scan is a row without one.

    The components of a measurement may be anything that a target moves through
    smoothly: two positions, a frequency, a bearing. All rows of a scan share its time.
    """

    NAME: ClassVar[str] = "scans"
    ROW: ClassVar[str] = "row"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("dimension",)

    scan: IntArray = column("Number of the scan, ascending.", cells=Cells(needed=True, every=True))
    time_s: FloatArray = column("Time of the scan.")
    measured: FloatArray = column(
        "Components of the measurement, in the units named; nan in an empty scan.",
        "row", "dimension", unit="",
    )  # fmt: skip
    measured_std: FloatArray = column(
        "Standard deviations, same units; nan if not given.", "row", "dimension", unit=""
    )
    amplitude: FloatArray = column(
        "Amplitude over the standard deviation of the noise; nan if not given.", cells=Cells()
    )
    component: TextArray = column("Name of each component.", "dimension")
    component_unit: TextArray = column("Unit of each component; empty if not given.", "dimension")
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)


PROBABILITY = Cells(0.0, 1.0, needed=True, every=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class Roc(Container):
    """Measured operating curve of a detector, ordered by false alarm probability."""

    NAME: ClassVar[str] = "roc"
    ROW: ClassVar[str] = "point"

    false_alarm_probability: FloatArray = column(
        "Probability of a false alarm per cell and scan.", cells=PROBABILITY
    )
    detection_probability: FloatArray = column(
        "Probability of detecting the target.", cells=PROBABILITY
    )
    threshold: FloatArray = column(
        "Threshold on the amplitude; nan where it is not known.", cells=Cells()
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Contacts(Container):
    """One row per contact and scan; nan is "not measured". Ordered by time."""

    NAME: ClassVar[str] = "contacts"
    ROW: ClassVar[str] = "row"

    contact: IntArray = column("Contact, from 1.", cells=Cells(1, 2**53, every=True))
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
