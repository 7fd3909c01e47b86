"""The bearing-time record of an array, and where the array was."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import Container, FloatArray, column, scalar
from uwtrack_cli.data.directions import Directions
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks

MIRROR = "mirror"
"""Ambiguity of a line array: port and starboard look alike."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BearingTime(Container):
    """Broadband level of every beam over time, with place and heading of the array.

    It carries the peaks that were found in the beams, where these are kept, and of a
    planar or volume array the directions of broadband sound.
    """

    NAME: ClassVar[str] = "bearing_time"
    ROW: ClassVar[str] = "frame"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("beam",)
    STANDS_FOR: ClassVar[str] = "peaks"
    """The part that a stage takes which reads such a container and not this one."""

    frames: Frames
    """Time base of the rows."""
    cos_angle: FloatArray | None = column(
        "Cosine of the angle from the array's head; beyond 1 in the last beams; None: "
        "no line array.", "beam",
    )  # fmt: skip
    azimuth_deg: FloatArray | None = column(
        "Angle from the array's head, clockwise; the level is that of the loudest "
        "elevation. None: a line array.", "beam",
    )  # fmt: skip
    diffuse_power: FloatArray | None = column(
        "Power that noise from all around would give over the median of all beams; "
        "None: not known.", "beam",
    )  # fmt: skip
    level_db: FloatArray = column(
        "Level of the beam in the band (re the reference).", "frame", "beam", dtype=np.float32
    )
    excess_db: FloatArray = column(
        "Mean over the band of the power over the median of all beams' noise; a line "
        "counts as much as strong noise.", "frame", "beam", dtype=np.float32,
    )  # fmt: skip
    east_m: FloatArray = column("East of the array's middle; nan if unknown.")
    north_m: FloatArray = column("North of the array's middle; nan if unknown.")
    heading_deg: FloatArray = column("Compass heading of the array; nan if unknown.")
    bend_deg: FloatArray = column("Change of heading from tail to head; nan if unknown.")
    band_low_hz: float = scalar("Lower edge of the band.")
    band_high_hz: float = scalar("Upper edge of the band.")
    design_frequency_hz: float = scalar("Frequency above which directions are not unique.")
    sidelobe_db: float | None = scalar(
        "Sidelobes of its beams below the main lobe; None: not known.", None
    )
    shading: str = scalar("Weights of the hydrophones; empty: not known.", "")
    beamformer: str = scalar("'conventional' or 'mvdr'.")
    side: str = scalar("Side that bearings are written for, starboard or port.")
    ambiguity: str = scalar(
        "'mirror' if the side is open, 'elevation' or 'plane' as in directions, else 'none'."
    )
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
    peaks: Peaks | None = None
    """Peaks in frequency and direction; None where they only passed by."""
    directions: Directions | None = None
    """Directions of broadband sound; None of a line array."""
