"""Fringes: a small image of the sound over time and the logarithm of frequency."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import Container, FloatArray, IntArray, column, scalar

STEP_DB = 0.25
"""Step of a shade."""

MIDDLE = 128
"""Shade of a cell on the line through its row; 0 is one without sound."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Fringes(Container):
    """Power in equal parts of an octave, above the line through its row, in 8 bits.

    The pattern of bright and dark bands that a vessel's sound and its images draw keeps
    its shape along this axis, and moves along it while the vessel passes.
    """

    NAME: ClassVar[str] = "fringes"
    ROW: ClassVar[str] = "row"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("fringe_cell",)

    time_s: FloatArray = column("Middle of a row, from the first sample.")
    frequency_hz: FloatArray = column(
        "Middle of a cell; a constant share from one to the next.", "fringe_cell"
    )
    shade: IntArray = column(
        "Density of a cell above the line through its row, in steps of 0.25 dB from 128; "
        "0 without sound.",
        "row", "fringe_cell", unit="1", dtype=np.uint8,
    )  # fmt: skip
    level_db: FloatArray = column(
        "Mean of the row's densities in decibels (re the reference^2/Hz); nan without sound.",
        dtype=np.float32,
    )
    slope_db: FloatArray = column(
        "Slope of the line through the row, dB per octave.", dtype=np.float32
    )
    average_s: float = scalar("Time that a row is averaged over.")
    bin_hz: float = scalar("Resolution of the spectra: cells narrower share a bin.")
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
    sensor: str = scalar("Identifier of the sensor.")
    start_utc_ns: int | None = scalar("First sample since 1970-01-01 UTC; None if unknown.", None)
