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
from uwtrack_cli.data.presence import READINGS

TOO_FAST, MAINS = "too-fast", "mains"
"""Codes of rejections that more than one room reads: see `motion/decision.py`."""


class RefusedContact(NamedTuple):
    """What was taken for a passage and is none."""

    contact: int
    """Contact number, from 1."""
    from_s: float
    """Its first measurement."""
    to_s: float
    """Its last measurement."""
    reason: str
    """Why it is no passage."""


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
    ROW: ClassVar[str] = "encounter"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("parameter", "parameter_too")
    OBJECTS: ClassVar[dict[str, str]] = {
        "ambiguities": "Other solutions with their weights.",
        "change": "What changed during a passage, and when; null if nothing did.",
        "evidence": "Log evidence of the passage over each explanation, as it is weighed.",
        "alternative_motion_model": (
            "Next motion model with its probability; null if none has 5 %."
        ),
        "vessel": "Vessel by AIS, and the probability that it was that one.",
    }

    contact: IntArray = column("Contact, from 1.")
    sensor: TextArray = column("Identifier of the sensor.")
    status: TextArray = column(
        "'ok', 'extrapolated', 'level-only' (from the level alone) or 'no-speed' (time "
        "and range over speed from fringes)."
    )
    time_s: FloatArray = column("Geometric closest approach, counted from the first sample.")
    time_std_s: FloatArray = deviation()
    time_utc_ns: IntArray = column("The same since 1970-01-01 UTC; -1 if the start is unknown.")
    arrival_time_s: FloatArray = column("Arrival of the sound made at closest approach.")
    speed_mps: FloatArray = column("Speed of the vessel.")
    speed_std_mps: FloatArray = deviation()
    slant_range_m: FloatArray = column("Range at closest approach.")
    slant_range_std_m: FloatArray = deviation()
    horizontal_range_m: FloatArray = column(
        "Horizontal part of the range; nan without a sensor depth."
    )
    horizontal_range_std_m: FloatArray | None = deviation()
    range_over_speed_s: FloatArray = column("Slant range divided by speed.")
    range_over_speed_std_s: FloatArray = deviation()
    horizontal_range_over_speed_s: FloatArray | None = column("Horizontal range divided by speed.")
    horizontal_range_over_speed_std_s: FloatArray | None = deviation()
    course_deg: FloatArray = column("Compass course.")
    course_std_deg: FloatArray = deviation()
    bearing_deg: FloatArray = column("Compass bearing, sensor to vessel, at closest approach.")
    bearing_std_deg: FloatArray = deviation()
    side: TextArray = column(
        "Side of the vessel on which the sensor lies; empty if unknown.",
        unknown="", choices=("port", "starboard"),
    )  # fmt: skip
    sound_speed_mps: FloatArray = column("Sound speed used.")
    received_level_db: FloatArray = column("Received level at closest approach (re the reference).")
    received_level_std_db: FloatArray = deviation()
    source_level_db: FloatArray = column("Source level at 1 m under the spreading law used.")
    source_level_std_db: FloatArray = deviation()
    source_depth_m: FloatArray | None = column(
        "Depth of the source, by the spacing of fringes that one surface image makes; "
        "nan where range, sensor depth or such fringes are not known."
    )
    source_depth_std_m: FloatArray | None = deviation()
    extrapolated: BoolArray = column("Whether the closest approach lies outside the recording.")
    covariance: FloatArray = column(
        "Covariance of time, range over speed, speed and bearing.",
        "encounter", "parameter", "parameter_too",
    )  # fmt: skip
    horizontal_covariance: FloatArray | None = column(
        "The same of the horizontal range over speed.",
        "encounter", "parameter", "parameter_too", key="",
    )  # fmt: skip
    rest_encounter: IntArray = column(
        "Row of the encounter that a rest frequency belongs to.", "rest_line", owner="encounter"
    )
    ambiguity_encounter: IntArray = column(
        "Row of the encounter that another solution belongs to.", "ambiguity", owner="encounter"
    )
    ambiguity_side: TextArray = column(
        "Side of the vessel on which the sensor lies in that solution.",
        "ambiguity", key="ambiguities.side",
    )  # fmt: skip
    ambiguity_weight: FloatArray = column(
        "Probability of that solution.", "ambiguity", key="ambiguities.weight"
    )
    reason_encounter: IntArray = column(
        "Row of the encounter that a reason belongs to.", "reason", owner="encounter"
    )
    sensor_east_m: FloatArray | None = column(
        "East of a moving sensor at closest approach; nan for a fixed one.", key=""
    )
    sensor_north_m: FloatArray | None = column(
        "North of a moving sensor at closest approach.", key=""
    )
    sensor_velocity_east_mps: FloatArray | None = column(
        "Velocity east of a moving sensor: ranges over speed and covariances are those "
        "of the motion relative to it.", key="",
    )  # fmt: skip
    sensor_velocity_north_mps: FloatArray | None = column(
        "Velocity north of a moving sensor.", key=""
    )
    nuisance_encounter: IntArray | None = column(
        "Row of the encounter that a nuisance belongs to.", "nuisance", owner="encounter"
    )
    rest_frame_evidence: FloatArray | None = column(
        "Nepers by which its lines are sharper in source time than in any other; in air, "
        "by which the pattern of all sound shifts as the passage has it (inverse hyperbolic "
        "sine of half of them); nan where the sound was not asked."
    )
    misfit: FloatArray | None = column(
        "What its lines leave of their curve beyond noise, as a share of the Doppler "
        "shift; nan without lines."
    )
    probability: FloatArray | None = column("Probability that a vessel passes as the row has it.")
    alternative: TextArray | None = column(
        "Code of the strongest explanation in which no vessel passes so, such as "
        "'nothing-passes'; 'not-significant' for none of them.", unknown="",
    )  # fmt: skip
    alternative_probability: FloatArray | None = column("Probability of that explanation.")
    evidence_encounter: IntArray | None = column(
        "Row of the encounter that a log evidence belongs to.", "evidence", owner="encounter"
    )
    evidence_alternative: TextArray | None = column(
        "Code of the explanation that a log evidence speaks against.",
        "evidence", key="evidence.alternative",
    )  # fmt: skip
    evidence_nepers: FloatArray | None = column(
        "Log evidence of the passage over that explanation, as it is weighed.",
        "evidence", unit="neper", key="evidence.nepers",
    )  # fmt: skip
    motion_model: TextArray | None = column(
        "Motion model of the row: 'straight', 'frequency-step', "
        "'frequency-ramp', 'manoeuvre' or 'two-targets' (its contact was divided).",
        unknown="", choices=READINGS,
    )  # fmt: skip
    motion_model_probability: FloatArray | None = column(
        "Probability of that motion model, among those in which nothing passes, too."
    )
    alternative_motion_model: TextArray | None = column(
        "Next motion model, also 'constant', 'machinery' or 'joined', in which nothing "
        "passes; empty if it has less than 5 %.", key="alternative_motion_model.motion_model",
    )  # fmt: skip
    alternative_motion_model_probability: FloatArray | None = column(
        "Its probability; 0 without one.", key="alternative_motion_model.probability"
    )
    change_time_s: FloatArray | None = column(
        "When frequencies or velocity changed; nan for a straight passage.", key="change."
    )
    change_time_std_s: FloatArray | None = deviation()
    change_follows: BoolArray | None = column(
        "Whether the ramp, the other leg or the middle of a turn follows that time or "
        "the closest approach; else it goes before it.", key="change.",
    )  # fmt: skip
    frequency_change: FloatArray | None = column(
        "Share by which all rest frequencies stepped then.", key="change."
    )
    frequency_change_std: FloatArray | None = deviation()
    frequency_slope_per_s: FloatArray | None = column(
        "Share per second by which they ramp from or until then.", key="change."
    )
    frequency_slope_std_per_s: FloatArray | None = deviation()
    other_leg_speed_mps: FloatArray | None = column(
        "Speed on the other side of a manoeuvre: after it, or before it if the closest "
        "approach comes later.", key="change.",
    )  # fmt: skip
    other_leg_speed_std_mps: FloatArray | None = deviation()
    other_leg_course_deg: FloatArray | None = column("Course there.", key="change.")
    other_leg_course_std_deg: FloatArray | None = deviation()
    turn_away_deg: FloatArray | None = column(
        "Angle by which the course turns away from the sensor in a manoeuvre that is "
        "an even turn about that time; nan for one that is not.", key="change.",
    )  # fmt: skip
    turn_away_std_deg: FloatArray | None = deviation()
    turn_duration_s: FloatArray | None = column("How long that turn lasts.", key="change.")
    turn_duration_std_s: FloatArray | None = deviation()
    turn_correlation: FloatArray | None = column(
        "Correlation of the errors of angle and duration.", key="change."
    )
    vessel_name: TextArray | None = column(
        "Name of the vessel by AIS; empty if none of the table fits.", key="vessel."
    )
    vessel_mmsi: TextArray | None = column("Its MMSI.", unknown="", key="vessel.")
    vessel_probability: FloatArray | None = column(
        "Probability that it was that vessel.", key="vessel."
    )
    ais_name: str = scalar("AIS table that the names are from; empty: none.", "")
    ais_digest: str = scalar("SHA-256 of that table.", "")
    ais_within_m: float | None = scalar(
        "Range within which its vessels are expected to be detected.", None
    )
    refused_contact: IntArray | None = column(
        "Contact of what was examined and is no passage.", "refusal"
    )
    refused_sensor: TextArray | None = column("Sensor that received it.", "refusal")
    refused_from_s: FloatArray | None = column("First measurement of it.", "refusal")
    refused_to_s: FloatArray | None = column("Last measurement of it.", "refusal")
    refused_reason: TextArray | None = column("Why it is no passage.", "refusal")
    refused_code: TextArray | None = column(
        "The same as a code, such as 'too-fast' or 'mains'.", "refusal"
    )
    refused_probability: FloatArray | None = column(
        "Probability that a vessel passes all the same; nan where it was not weighed.", "refusal"
    )
    refused_motion_model: TextArray | None = column(
        "Motion model where nothing passes: 'constant', 'machinery' or 'joined', "
        "or a passage that noise alone gives, too; empty for one that was rejected.",
        "refusal",
    )
    refused_motion_model_probability: FloatArray | None = column(
        "Probability of that motion model.", "refusal"
    )
    refused_alternative_motion_model: TextArray | None = column(
        "Next motion model; empty if it has less than 5 %.", "refusal"
    )
    refused_alternative_motion_model_probability: FloatArray | None = column(
        "Its probability; 0 without one.", "refusal"
    )
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.", key="level_reference")
    band_low_hz: float | None = scalar("Lower edge of the levels' band.", None)
    band_high_hz: float | None = scalar("Upper edge of the levels' band.", None)
    spreading_db: float = scalar(
        "Spreading law of the source level, per decade of range.", 20.0, key="spreading_db"
    )

    def of_sensor(self, sensor: str) -> Self:
        """Return the encounters of one sensor, and what it heard that is none."""
        own = self.take("encounter", np.flatnonzero(self.sensor == sensor))
        if self.refused_sensor is None:
            return own
        return own.take("refusal", np.flatnonzero(self.refused_sensor == sensor))

    def refusals(self) -> list[RefusedContact]:
        """Return what was taken for a passage and is refused, with the reason."""
        columns = (
            self.refused_contact, self.refused_from_s, self.refused_to_s,
            self.refused_reason,
        )  # fmt: skip
        known = [values.tolist() for values in columns if values is not None]
        if len(known) != len(columns):
            return []
        every = [RefusedContact(*one) for one in zip(*known, strict=True)]
        if self.refused_motion_model is None:
            return every
        return [one for one, name in zip(every, self.refused_motion_model, strict=True) if not name]

    def refused_as(self, code: str) -> list[str]:
        """Return the reasons of what is refused by one code, such as `TOO_FAST`."""
        if self.refused_code is None or self.refused_reason is None:
            return []
        return list(map(str, self.refused_reason[self.refused_code == code]))

    def still(self) -> list[StillContact]:
        """Return the contacts that are not told to pass, with what they are read as."""
        columns = (
            self.refused_contact, self.refused_reason, self.refused_motion_model,
            self.refused_motion_model_probability, self.refused_alternative_motion_model,
            self.refused_alternative_motion_model_probability,
        )  # fmt: skip
        known = [values.tolist() for values in columns if values is not None]
        every = zip(*known, strict=True) if len(known) == len(columns) else ()
        return [StillContact(*one) for one in every if one[2]]

    def reading_of(self, row: int) -> tuple[str, float, str, float]:
        """Return motion model, its probability, and the same of the next one, of a row."""
        names, weights = (
            (self.motion_model, self.alternative_motion_model),
            (self.motion_model_probability, self.alternative_motion_model_probability),
        )
        name, rival = ("" if one is None else str(one[row]) for one in names)
        weight, other = (np.nan if one is None else float(one[row]) for one in weights)
        return name, weight, rival, other

    def ambiguities(self, row: int) -> list[dict[str, str | float]]:
        """Return the other solutions of an encounter, with their weights."""
        return list(self.ragged("ambiguities", row))

    @property
    def n_encounters(self) -> int:
        """Number of rows."""
        return int(self.time_s.size)


@dataclass(frozen=True, eq=False, kw_only=True)
class Fixes(Container):
    """One row per position, time and mode; modes carry weights that sum to one."""

    NAME: ClassVar[str] = "fixes"
    ROW: ClassVar[str] = "fix"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("coordinate", "coordinate_too")
    OBJECTS: ClassVar[dict[str, str]] = {
        "alternative_motion_model": ("The other motion model; null if it has less than 5 %.")
    }

    contact: IntArray = column("Contact, from 1.")
    mode: IntArray = column("Mode, best first, from 1.")
    weight: FloatArray = column("Probability of the mode.")
    time_s: FloatArray = column("Time from the first sample.")
    time_utc_ns: IntArray = column("The same since 1970-01-01 UTC; -1 if unknown.")
    east_m: FloatArray = column("Position east of the origin.")
    north_m: FloatArray = column("Position north of the origin.")
    latitude: FloatArray = column("Latitude; nan on a local grid.")
    longitude: FloatArray = column("Longitude; nan on a local grid.")
    covariance_m2: FloatArray = column(
        "Covariance of east and north.", "fix", "coordinate", "coordinate_too"
    )
    speed_mps: FloatArray = column("Speed.")
    speed_std_mps: FloatArray = deviation(key="")
    course_deg: FloatArray = column("Compass course; nan where the source is stationary.")
    course_std_deg: FloatArray = deviation(key="")
    sensors: TextArray = column("Sensors that contributed, comma separated.")
    motion_model: TextArray | None = column(
        "Motion model of bearings that cross: 'stationary' or 'moving'; empty where the "
        "two did not compete.", unknown="", choices=("stationary", "moving"),
    )  # fmt: skip
    motion_model_probability: FloatArray | None = column(
        "Probability of that motion model; position and ellipse are those of both."
    )
    alternative_motion_model: TextArray | None = column(
        "The other motion model; empty if it has less than 5 %.",
        key="alternative_motion_model.motion_model",
    )
    alternative_motion_model_probability: FloatArray | None = column(
        "Its probability; 0 without one.", key="alternative_motion_model.probability"
    )
    sensor_contacts: TextArray | None = column(
        "Contacts of the sensors that were joined by evidence: sensor/number, with spaces "
        "between; empty where nothing was joined.", unknown="",
    )  # fmt: skip
    pairing_probability: FloatArray | None = column(
        "Probability of the least certain of these pairings."
    )
    pairing_contact: IntArray | None = column(
        "Contact that a sensor's contact may belong to.", "pairing"
    )
    pairing_sensor: TextArray | None = column("Sensor.", "pairing")
    pairing_number: IntArray | None = column("Number of the contact at that sensor.", "pairing")
    pairing_share: FloatArray | None = column(
        "Probability that it belongs to that contact.", "pairing"
    )
    origin: str = scalar("What the grid is relative to: a sensor or 'grid'.")
    origin_latitude: float | None = scalar("Latitude of the origin.", None)
    origin_longitude: float | None = scalar("Longitude of the origin.", None)
    statement: str = scalar(
        "What the sensors say of each other's clocks, and why a contact of a table has "
        "no position.", "",
    )  # fmt: skip
