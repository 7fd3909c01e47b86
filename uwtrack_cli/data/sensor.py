"""The sensor: what it is, where it is, and how well its facts are known."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from uwtrack_cli.constants import SOUND_SPEED_WATER_MPS
from uwtrack_cli.data.base import Cells, Container, FloatArray, column, scalar
from uwtrack_cli.data.options import AtLeast, AtMost, Unit

SoundSpeed = Annotated[float, Unit("m/s"), AtLeast(100), AtMost(299_792_458)]
"""A speed of sound in any medium; up to that of light, for Doppler of other waves."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Navigation(Container):
    """Position, velocity and heading of a moving platform over time.

    Local coordinates are metres east and north; where the source gave latitude
    and longitude, these are kept and the grid's origin is the first position.
    """

    NAME: ClassVar[str] = "navigation"
    ROW: ClassVar[str] = "row"

    time_s: FloatArray = column("Time of the row.")
    east_m: FloatArray = column("Position east of the origin.", cells=Cells(every=True))
    north_m: FloatArray = column("Position north of the origin.", cells=Cells(every=True))
    heading_deg: FloatArray = column(
        "Compass heading of the platform; nan if not given.", cells=Cells(-360.0, 360.0)
    )
    origin_latitude: float | None = scalar("Latitude of the origin.", None)
    origin_longitude: float | None = scalar("Longitude of the origin.", None)
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensor(Container):
    """One hydrophone, vector sensor or array; None is unknown, never invented.

    The level of full scale is known from ``full_scale_db``, or from sensitivity, gain
    and input voltage together; not from both.
    """

    NAME: ClassVar[str] = "sensor"

    id: str = scalar("Identifier, unique in a deployment.")
    kind: str = scalar("'omni', 'difar', 'difar-multiplexed' or 'array'.", "omni")
    channels: str = scalar("Channel names in file order, comma separated.", "omni")
    latitude: float | None = scalar("Latitude.", None)
    longitude: float | None = scalar("Longitude.", None)
    east_m: float | None = scalar("Position on a local grid.", None)
    north_m: float | None = scalar("Position on a local grid.", None)
    position_std_m: float = scalar("Deviation of each coordinate.", 0.0)
    depth_m: float | None = scalar("Depth below the surface.", None)
    depth_std_m: float | None = scalar("Deviation of the depth.", None)
    heading_deg: float = scalar("Heading of housing-fixed axes.", 0.0)
    sound_speed_mps: float = scalar("Sound speed.", SOUND_SPEED_WATER_MPS)
    sound_speed_std_mps: float | None = scalar("Deviation of the sound speed.", None)
    compass_offset_deg: float = scalar("Added once to every bearing.", 0.0)
    compass_std_deg: float | None = scalar("Deviation of the compass.", None)
    north: str | None = scalar(
        "'compass' where the declination is not known, 'place' where it is still to be "
        "had from there; None: bearings are from true north.", None,
    )  # fmt: skip
    multiplex: str | None = scalar(
        "Of a buoy whose audio is multiplexed: the dipole in phase with the phase pilot "
        "and the one ahead of it, comma separated; - inverts one.", None,
    )  # fmt: skip
    response: str | None = scalar(
        "Of such a buoy: frequency in Hz and response in dB, by a colon, comma "
        "separated; None: it is flat.", None,
    )  # fmt: skip
    clock_offset_s: float = scalar("Added once to every time.", 0.0)
    clock_std_s: float | None = scalar("Deviation of the clock.", None)
    clock_error_ppm: float | None = scalar(
        "By how much the recorder's clock makes frequencies too high; it is taken off.",
        None, unit="1e-6",
    )  # fmt: skip
    sensitivity_db_re_v_per_upa: float | None = scalar("Sensitivity.", None, unit="dB")
    gain_db: float | None = scalar("Gain of the amplifier.", None)
    adc_peak_v: float | None = scalar("Input voltage at full scale.", None, unit="V")
    full_scale_db: float | None = scalar("Level of a full-scale peak.", None, unit="dB re 1 uPa")
    dipole_gains: str | None = scalar(
        "Output of the first and of the second dipole for sound along its axis, over "
        "that of the omni channel, comma separated; None: both are 1.", None, unit="1",
    )  # fmt: skip
    dipole_crosstalk: float = scalar("Share of the other dipole in each dipole.", 0.0)
    omni_crosstalk: str | None = scalar(
        "Share of the omni channel in the first and in the second dipole, comma "
        "separated; None: in neither.", None, unit="1",
    )  # fmt: skip
    element_along_m: str | None = scalar(
        "Places of the hydrophones of a line array from its middle, positive to its "
        "head, comma separated.", None,
    )  # fmt: skip
    element_positions_m: str | None = scalar(
        "Places of the hydrophones of a planar or volume array from its middle, x to "
        "starboard, y ahead and z up, comma separated, one after the other by "
        "semicolons.", None,
    )  # fmt: skip
    tow_offset_m: float | None = scalar(
        "Way from the place that the navigation gives to the array's middle.", None
    )
    heading_source: str | None = scalar(
        "Source of an array's heading: 'track', 'compass' or 'fixed'; None: unknown.", None
    )
    navigation_position_std_m: float | None = scalar(
        "Deviation of each coordinate of the navigation.", None
    )
    navigation_velocity_std_mps: float | None = scalar(
        "Deviation of each component of its velocity.", None
    )
    navigation: Navigation | None = None
    """Positions and headings of a moving platform; None if it does not move."""

    @property
    def has_direction(self) -> bool:
        """Whether the sensor hears directions."""
        return self.kind == "difar" or self.is_multiplexed

    @property
    def is_multiplexed(self) -> bool:
        """Whether omni and dipoles come in one channel of audio."""
        return self.kind == "difar-multiplexed"

    @property
    def is_array(self) -> bool:
        """Whether it is an array."""
        return self.kind == "array"

    @property
    def dipole_response(self) -> FloatArray:
        """What each dipole channel holds of both dipoles and of the omni channel.

        Shape (2, 3): a recorded dipole is its row times the ideal first and second
        dipole and the omni channel.
        """
        gains = np.array(_pair(self.dipole_gains, 1.0))
        cross, leak = self.dipole_crosstalk, _pair(self.omni_crosstalk, 0.0)
        shares = np.array([[1.0, cross, leak[0]], [cross, 1.0, leak[1]]])
        return np.asarray(gains[:, None] * shares)

    @property
    def element_places_m(self) -> FloatArray:
        """Places of the hydrophones of a line array, positive to its head; else none."""
        texts = self.element_along_m.split(",") if self.element_along_m else []
        return np.array([float(text) for text in texts])

    @property
    def element_xyz_m(self) -> FloatArray:
        """Places of the hydrophones of any array, starboard, ahead and up, m.

        Shape (element, 3); no rows for a sensor that is no array.
        """
        if self.element_positions_m is None:
            along = self.element_places_m
            return np.stack([0.0 * along, along, 0.0 * along], axis=1)
        rows = self.element_positions_m.split(";")
        return np.array([[float(text) for text in row.split(",")] for row in rows])

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Channel names in file order."""
        return tuple(self.channels.split(","))

    @property
    def full_scale_upa(self) -> float | None:
        """Sound pressure of a full-scale sample, uPa; None without calibration."""
        if self.full_scale_db is not None:
            return float(np.power(10.0, self.full_scale_db / 20.0))
        if self.sensitivity_db_re_v_per_upa is None or self.adc_peak_v is None:
            return None
        total_db = self.sensitivity_db_re_v_per_upa + (self.gain_db or 0.0)
        return float(self.adc_peak_v * np.power(10.0, -total_db / 20.0))


def _pair(text: str | None, usual: float) -> tuple[float, float]:
    """Return two numbers from text; the usual one twice where there is none."""
    first, second = text.split(",") if text else (usual, usual)
    return float(first), float(second)
