"""Closest approaches, and the positions that follow from them."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Self

import numpy as np

from uwtrack_cli.data.base import (
    BoolArray,
    Container,
    FloatArray,
    HasNuisances,
    HasReasons,
    HasRestFrequencies,
    IntArray,
    TextArray,
    column,
    deviation,
    scalar,
)


class StillContact(NamedTuple):
    """A contact that is not told to pass, and what it is read as."""

    contact: int
    """Contact number, from 1."""
    reason: str
    """Why it is no passage."""
    reading: str
    """What it is read as."""
    weight: float
    """Probability of that reading."""
    rival: str
    """The next reading; empty if it has less than 5 %."""
    rival_weight: float
    """Its probability; 0 without one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Encounters(HasReasons, HasNuisances, HasRestFrequencies):
    """One row per closest approach of a contact; nan is "not observable".

    The covariance is over (time_s, range_over_speed_s, speed_mps, bearing_deg),
    in this order, nan where a quantity is not known. Range over speed is the slant
    range divided by the speed. Rest frequencies, ambiguities and reasons are ragged
    tables: any number of rows per encounter. What was examined and is no passage is a
    table of its own, which `presence` reads.
    """

    NAME: ClassVar[str] = "encounters"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("parameter", "parameter_too")

    contact: IntArray = column("1", "Contact, from 1.", "encounter", dtype=np.int64)
    sensor: TextArray = column("", "Identifier of the sensor.", "encounter", dtype="U")
    status: TextArray = column(
        "", "'ok', 'extrapolated' or 'level-only'.", "encounter", dtype="U",
    )  # fmt: skip
    time_s: FloatArray = column(
        "s", "Geometric closest approach, counted from the first sample.", "encounter"
    )
    time_std_s: FloatArray = deviation("s", "encounter")
    time_utc_ns: IntArray = column(
        "ns", "The same since 1970-01-01 UTC; -1 if the start is unknown.",
        "encounter", dtype=np.int64,
    )  # fmt: skip
    arrival_time_s: FloatArray = column(
        "s", "Arrival of the sound made at closest approach.", "encounter"
    )
    speed_mps: FloatArray = column("m/s", "Speed of the vessel.", "encounter")
    speed_std_mps: FloatArray = deviation("m/s", "encounter")
    slant_range_m: FloatArray = column("m", "Range at closest approach.", "encounter")
    slant_range_std_m: FloatArray = deviation("m", "encounter")
    horizontal_range_m: FloatArray = column(
        "m", "Horizontal part of the range; nan without a sensor depth.", "encounter"
    )
    horizontal_range_std_m: FloatArray | None = deviation(
        "m", "encounter", optional=True
    )
    range_over_speed_s: FloatArray = column(
        "s", "Slant range divided by speed.", "encounter"
    )
    range_over_speed_std_s: FloatArray = deviation("s", "encounter")
    horizontal_range_over_speed_s: FloatArray | None = column(
        "s", "Horizontal range divided by speed.", "encounter", optional=True
    )
    horizontal_range_over_speed_std_s: FloatArray | None = deviation(
        "s", "encounter", optional=True
    )
    course_deg: FloatArray = column("degree", "Compass course.", "encounter")
    course_std_deg: FloatArray = deviation("degree", "encounter")
    bearing_deg: FloatArray = column(
        "degree", "Compass bearing, sensor to vessel, at closest approach.", "encounter"
    )
    bearing_std_deg: FloatArray = deviation("degree", "encounter")
    side: TextArray = column(
        "", "Side of the vessel on which the sensor lies; empty if unknown.",
        "encounter", dtype="U",
    )  # fmt: skip
    sound_speed_mps: FloatArray = column("m/s", "Sound speed used.", "encounter")
    received_level_db: FloatArray = column(
        "dB", "Received level at closest approach (re the reference).", "encounter"
    )
    received_level_std_db: FloatArray = deviation("dB", "encounter")
    source_level_db: FloatArray = column(
        "dB", "Source level at 1 m under the spreading law used.", "encounter"
    )
    source_level_std_db: FloatArray = deviation("dB", "encounter")
    extrapolated: BoolArray = column(
        "1", "Whether the closest approach lies outside the recording.", "encounter",
        dtype=np.bool_,
    )  # fmt: skip
    covariance: FloatArray = column(
        "1", "Covariance of time, range over speed, speed and bearing.",
        "encounter", "parameter", "parameter_too",
    )  # fmt: skip
    horizontal_covariance: FloatArray | None = column(
        "1", "The same of the horizontal range over speed.",
        "encounter", "parameter", "parameter_too", optional=True,
    )  # fmt: skip
    rest_encounter: IntArray = column(
        "1", "Row of the encounter that a rest frequency belongs to.", "rest_line",
        dtype=np.int64, owner="encounter",
    )  # fmt: skip
    ambiguity_encounter: IntArray = column(
        "1", "Row of the encounter that another solution belongs to.", "ambiguity",
        dtype=np.int64, owner="encounter",
    )  # fmt: skip
    ambiguity_side: TextArray = column(
        "", "Side of the vessel on which the sensor lies in that solution.",
        "ambiguity", dtype=np.str_,
    )  # fmt: skip
    ambiguity_weight: FloatArray = column(
        "1", "Probability of that solution.", "ambiguity"
    )
    reason_encounter: IntArray = column(
        "1", "Row of the encounter that a reason belongs to.", "reason",
        dtype=np.int64, owner="encounter",
    )  # fmt: skip
    sensor_east_m: FloatArray | None = column(
        "m", "East of a moving sensor at closest approach; nan for a fixed one.",
        "encounter", optional=True,
    )  # fmt: skip
    sensor_north_m: FloatArray | None = column(
        "m", "North of a moving sensor at closest approach.", "encounter",
        optional=True,
    )  # fmt: skip
    sensor_velocity_east_mps: FloatArray | None = column(
        "m/s", "Velocity east of a moving sensor: ranges over speed and covariances "
        "are those of the motion relative to it.", "encounter", optional=True,
    )  # fmt: skip
    sensor_velocity_north_mps: FloatArray | None = column(
        "m/s", "Velocity north of a moving sensor.", "encounter", optional=True
    )
    nuisance_encounter: IntArray | None = column(
        "1", "Row of the encounter that a nuisance belongs to.", "nuisance",
        dtype=np.int64, owner="encounter", optional=True,
    )  # fmt: skip
    rest_frame_evidence: FloatArray | None = column(
        "1", "Nepers by which the sound of its lines is sharper in the vessel's own "
        "time than in any rival's; nan where the sound was not asked.",
        "encounter", optional=True,
    )  # fmt: skip
    misfit: FloatArray | None = column(
        "1", "What its lines leave of their curve beyond noise, as a share of the "
        "Doppler shift; nan without lines.", "encounter", optional=True,
    )  # fmt: skip
    reading: TextArray | None = column(
        "", "How the measurements are read: 'straight', 'frequency-step', "
        "'frequency-ramp', 'manoeuvre' or 'two-targets' (its contact was divided).",
        "encounter", dtype=np.str_, optional=True,
    )  # fmt: skip
    reading_weight: FloatArray | None = column(
        "1", "Probability of that reading, among those in which nothing passes, too.",
        "encounter", optional=True,
    )  # fmt: skip
    rival: TextArray | None = column(
        "", "Next reading, also 'constant', 'machinery' or 'joined', in which nothing "
        "passes; empty if it has less than 5 %.", "encounter",
        dtype=np.str_, optional=True,
    )  # fmt: skip
    rival_weight: FloatArray | None = column(
        "1", "Its probability; 0 without one.", "encounter", optional=True
    )
    change_time_s: FloatArray | None = column(
        "s", "When frequencies or velocity changed; nan for a straight passage.",
        "encounter", optional=True,
    )  # fmt: skip
    change_time_std_s: FloatArray | None = deviation("s", "encounter", optional=True)
    change_follows: BoolArray | None = column(
        "1", "Whether the ramp, the other leg or the middle of a turn follows that time or "
        "the closest approach; else it goes before it.", "encounter", dtype=np.bool_, optional=True,
    )  # fmt: skip
    frequency_change: FloatArray | None = column(
        "1", "Share by which all rest frequencies stepped then.", "encounter",
        optional=True,
    )  # fmt: skip
    frequency_change_std: FloatArray | None = deviation("1", "encounter", optional=True)
    frequency_slope_per_s: FloatArray | None = column(
        "1/s", "Share per second by which they ramp from or until then.", "encounter",
        optional=True,
    )  # fmt: skip
    frequency_slope_std_per_s: FloatArray | None = deviation(
        "1/s", "encounter", optional=True
    )
    other_leg_speed_mps: FloatArray | None = column(
        "m/s", "Speed on the other side of a manoeuvre: after it, or before it if the "
        "closest approach comes later.", "encounter", optional=True,
    )  # fmt: skip
    other_leg_speed_std_mps: FloatArray | None = deviation(
        "m/s", "encounter", optional=True
    )
    other_leg_course_deg: FloatArray | None = column(
        "degree", "Course there.", "encounter", optional=True
    )
    other_leg_course_std_deg: FloatArray | None = deviation(
        "degree", "encounter", optional=True
    )
    turn_away_deg: FloatArray | None = column(
        "degree", "Angle by which the course turns away from the sensor in a manoeuvre "
        "that is an even turn about that time; nan for one that is not.", "encounter",
        optional=True,
    )  # fmt: skip
    turn_away_std_deg: FloatArray | None = deviation(
        "degree", "encounter", optional=True
    )
    turn_duration_s: FloatArray | None = column(
        "s", "How long that turn lasts.", "encounter", optional=True
    )
    turn_duration_std_s: FloatArray | None = deviation("s", "encounter", optional=True)
    turn_correlation: FloatArray | None = column(
        "1", "Correlation of the errors of angle and duration.", "encounter",
        optional=True,
    )  # fmt: skip
    vessel_name: TextArray | None = column(
        "", "Name of the vessel by AIS; empty if none of the table fits.", "encounter",
        dtype=np.str_, optional=True,
    )  # fmt: skip
    vessel_mmsi: TextArray | None = column(
        "", "Its MMSI.", "encounter", dtype=np.str_, optional=True
    )
    vessel_probability: FloatArray | None = column(
        "1", "Probability that it was that vessel.", "encounter", optional=True
    )
    ais_name: str = scalar("", "AIS table that the names are from; empty: none.", "")
    ais_digest: str = scalar("", "SHA-256 of that table.", "")
    ais_within_m: float | None = scalar(
        "m", "Range within which its vessels are expected to be detected.", None
    )
    refused_contact: IntArray | None = column(
        "1", "Contact of what was examined and is no passage.", "refusal",
        dtype=np.int64, optional=True,
    )  # fmt: skip
    refused_sensor: TextArray | None = column(
        "", "Sensor that heard it.", "refusal", dtype=np.str_, optional=True
    )
    refused_from_s: FloatArray | None = column(
        "s", "First measurement of it.", "refusal", optional=True
    )
    refused_to_s: FloatArray | None = column(
        "s", "Last measurement of it.", "refusal", optional=True
    )
    refused_reason: TextArray | None = column(
        "", "Why it is no passage.", "refusal", dtype=np.str_, optional=True
    )
    refused_reading: TextArray | None = column(
        "", "What it is read as where nothing passes: 'constant', 'machinery' or 'joined', "
        "or a passage that noise alone gives, too; empty for one that was refused.",
        "refusal", dtype=np.str_, optional=True,
    )  # fmt: skip
    refused_reading_weight: FloatArray | None = column(
        "1", "Probability of that reading.", "refusal", optional=True
    )
    refused_rival: TextArray | None = column(
        "", "Next reading; empty if it has less than 5 %.", "refusal",
        dtype=np.str_, optional=True,
    )  # fmt: skip
    refused_rival_weight: FloatArray | None = column(
        "1", "Its probability; 0 without one.", "refusal", optional=True
    )
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")
    band_low_hz: float | None = scalar("Hz", "Lower edge of the levels' band.", None)
    band_high_hz: float | None = scalar("Hz", "Upper edge of the levels' band.", None)
    spreading_db: float = scalar(
        "dB", "Spreading law of the source level, per decade of range.", 20.0
    )

    def of_sensor(self, sensor: str) -> Self:
        """Return the encounters of one sensor, and what it heard that is none."""
        own = self.take("encounter", np.flatnonzero(self.sensor == sensor))
        if self.refused_sensor is None:
            return own
        return own.take("refusal", np.flatnonzero(self.refused_sensor == sensor))

    def refusals(self) -> list[tuple[int, float, float, str]]:
        """Return contact, begin and end in s, and reason of what was taken for a passage."""
        columns = (
            self.refused_contact, self.refused_from_s, self.refused_to_s,
            self.refused_reason,
        )  # fmt: skip
        known = [values.tolist() for values in columns if values is not None]
        if len(known) != len(columns):
            return []
        every = list(zip(*known, strict=True))
        if self.refused_reading is None:
            return every
        return [
            one
            for one, name in zip(every, self.refused_reading, strict=True)
            if not name
        ]

    def still(self) -> list[StillContact]:
        """Return the contacts that are not told to pass, with what they are read as."""
        columns = (
            self.refused_contact, self.refused_reason, self.refused_reading,
            self.refused_reading_weight, self.refused_rival, self.refused_rival_weight,
        )  # fmt: skip
        known = [values.tolist() for values in columns if values is not None]
        every = zip(*known, strict=True) if len(known) == len(columns) else ()
        return [StillContact(*one) for one in every if one[2]]

    def reading_of(self, row: int) -> tuple[str, float, str, float]:
        """Return reading, its weight, the rival and its weight of a closest approach."""
        names, weights = (
            (self.reading, self.rival),
            (self.reading_weight, self.rival_weight),
        )
        name, rival = ("" if one is None else str(one[row]) for one in names)
        weight, other = (np.nan if one is None else float(one[row]) for one in weights)
        return name, weight, rival, other

    def ambiguities(self, row: int) -> list[dict[str, str | float]]:
        """Return the other solutions of an encounter, with their weights."""
        return [
            {
                "side": str(self.ambiguity_side[i]),
                "weight": float(self.ambiguity_weight[i]),
            }
            for i in self.owned_rows("ambiguity_encounter", row)
        ]

    @property
    def n_encounters(self) -> int:
        """Number of rows."""
        return int(self.time_s.size)


@dataclass(frozen=True, eq=False, kw_only=True)
class Fixes(Container):
    """One row per position, time and mode; modes carry weights that sum to one."""

    NAME: ClassVar[str] = "fixes"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("coordinate", "coordinate_too")

    contact: IntArray = column("1", "Contact, from 1.", "fix", dtype=np.int64)
    mode: IntArray = column("1", "Mode, best first, from 1.", "fix", dtype=np.int64)
    weight: FloatArray = column("1", "Probability of the mode.", "fix")
    time_s: FloatArray = column("s", "Time from the first sample.", "fix")
    time_utc_ns: IntArray = column(
        "ns", "The same since 1970-01-01 UTC; -1 if unknown.", "fix", dtype=np.int64
    )
    east_m: FloatArray = column("m", "Position east of the origin.", "fix")
    north_m: FloatArray = column("m", "Position north of the origin.", "fix")
    latitude: FloatArray = column("degree", "Latitude; nan on a local grid.", "fix")
    longitude: FloatArray = column("degree", "Longitude; nan on a local grid.", "fix")
    covariance_m2: FloatArray = column(
        "m^2", "Covariance of east and north.", "fix", "coordinate", "coordinate_too"
    )
    speed_mps: FloatArray = column("m/s", "Speed.", "fix")
    speed_std_mps: FloatArray = deviation("m/s", "fix")
    course_deg: FloatArray = column(
        "degree", "Compass course; nan where the source is read as still.", "fix"
    )
    course_std_deg: FloatArray = deviation("degree", "fix")
    sensors: TextArray = column(
        "", "Sensors that contributed, comma separated.", "fix", dtype="U"
    )
    reading: TextArray | None = column(
        "", "How bearings that cross are read: 'still' or 'moving'; empty where the two "
        "did not compete.", "fix", dtype=np.str_, optional=True,
    )  # fmt: skip
    reading_weight: FloatArray | None = column(
        "1", "Probability of that reading; position and ellipse are those of both.",
        "fix", optional=True,
    )  # fmt: skip
    rival: TextArray | None = column(
        "", "The other reading; empty if it has less than 5 %.", "fix",
        dtype=np.str_, optional=True,
    )  # fmt: skip
    rival_weight: FloatArray | None = column(
        "1", "Its probability; 0 without one.", "fix", optional=True
    )
    origin: str = scalar("", "What the grid is relative to: a sensor or 'grid'.")
    origin_latitude: float | None = scalar("degree", "Latitude of the origin.", None)
    origin_longitude: float | None = scalar("degree", "Longitude of the origin.", None)
    statement: str = scalar(
        "", "What the sensors say of each other's clocks, and why a contact of a table "
        "has no position.", "",
    )  # fmt: skip
