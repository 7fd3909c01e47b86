"""Scans of measurements among clutter, and the measured curve of a detector."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import (
    Container,
    FloatArray,
    IntArray,
    TextArray,
    column,
    scalar,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Scans(Container):
    """One row per measurement, ordered by scan; an empty scan is a row without one.

    The components of a measurement may be anything that a target moves through
    smoothly: two positions, a frequency, a bearing. All rows of a scan share its time.
    """

    NAME: ClassVar[str] = "scans"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("dimension",)

    scan: IntArray = column(
        "1", "Number of the scan, ascending.", "row", dtype=np.int64
    )
    time_s: FloatArray = column("s", "Time of the scan.", "row")
    measured: FloatArray = column(
        "", "Components of the measurement, in the units named; nan in an empty scan.",
        "row", "dimension",
    )  # fmt: skip
    measured_std: FloatArray = column(
        "", "Standard deviations, same units; nan if not given.", "row", "dimension"
    )
    amplitude: FloatArray = column(
        "1", "Amplitude over the noise deviation; nan if not given.", "row"
    )
    component: TextArray = column(
        "", "Name of each component.", "dimension", dtype=np.str_
    )
    component_unit: TextArray = column(
        "", "Unit of each component; empty if not given.", "dimension", dtype=np.str_
    )
    start_utc_ns: int | None = scalar("ns", "UTC epoch of time zero.", None)


@dataclass(frozen=True, eq=False, kw_only=True)
class Roc(Container):
    """Measured operating curve of a detector, ordered by false alarm probability."""

    NAME: ClassVar[str] = "roc"

    false_alarm_probability: FloatArray = column(
        "1", "Probability of a false alarm per cell and scan.", "point"
    )
    detection_probability: FloatArray = column(
        "1", "Probability of detecting the target.", "point"
    )
    threshold: FloatArray = column(
        "1", "Threshold on the amplitude; nan where it is not known.", "point"
    )
