"""Motions: what bearings and Doppler tell of a target's course and speed."""

from dataclasses import dataclass
from typing import ClassVar

from uwtrack_cli.data.base import (
    BoolArray,
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Motions(HasReasons, HasNuisances, HasRestFrequencies):
    """One row per contact and mode, best first; nan is "not observable".

    The state is that at the contact's first measurement. Intervals (low, high) are
    95 % likelihood-ratio intervals; nan is an open end. The covariance is over
    (range_m, bearing_deg, speed_mps, course_deg), in this order. Rest frequencies and
    reasons are ragged tables: any number of rows per motion. The estimates over time
    (``update_*``) are a table of their own, of the first leg.
    """

    NAME: ClassVar[str] = "motions"
    ROW: ClassVar[str] = "motion"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("parameter", "parameter_too")
    OBJECTS: ClassVar[dict[str, str]] = {
        "offsets_deg": "What the bearings of each sensor of a table must be turned by, "
        "by its name. [degree]",
        "legs": "The legs of the target, in order of time.",
    }

    contact: IntArray = column("Contact, from 1.")
    mode: IntArray = column("Mode, best first, from 1.")
    weight: FloatArray = column("Probability of the mode.")
    time_s: FloatArray = column("Time of the first measurement.")
    time_utc_ns: IntArray = column("The same since 1970-01-01 UTC; -1 if unknown.")
    range_m: FloatArray = column("Horizontal range from own ship.")
    range_std_m: FloatArray = deviation()
    range_low_m: FloatArray = column("Lower end of its interval.")
    range_high_m: FloatArray = column("Upper end of its interval.")
    bearing_deg: FloatArray = column("Bearing from own ship.")
    bearing_std_deg: FloatArray = deviation()
    speed_mps: FloatArray = column("Speed.")
    speed_std_mps: FloatArray = deviation()
    speed_low_mps: FloatArray = column("Lower end of its interval.")
    speed_high_mps: FloatArray = column("Upper end of its interval.")
    course_deg: FloatArray = column("Compass course.")
    course_std_deg: FloatArray = deviation()
    course_low_deg: FloatArray = column("Start of its interval, clockwise; 0 to 360 is any course.")
    course_high_deg: FloatArray = column("End of its interval.")
    covariance: FloatArray = column(
        "Covariance of range, bearing, speed and course (m, degree, m/s).",
        "motion", "parameter", "parameter_too",
    )  # fmt: skip
    now_time_s: FloatArray = column("Time of the last measurement.")
    now_range_m: FloatArray = column("Range at that time.")
    now_range_std_m: FloatArray = deviation()
    now_bearing_deg: FloatArray = column("Bearing at that time.")
    now_bearing_std_deg: FloatArray = deviation()
    now_speed_mps: FloatArray | None = column(
        "Speed at that time; of the last leg where the target changed its velocity."
    )
    now_speed_std_mps: FloatArray | None = deviation()
    now_course_deg: FloatArray | None = column("Compass course at that time.")
    now_course_std_deg: FloatArray | None = deviation()
    observable: BoolArray = column("Whether the range is observable.")
    ellipse_trusted: BoolArray = column("Whether the standard deviations agree with the intervals.")
    misfit: FloatArray = column("Sum of the losses (chi-square).")
    n_values: IntArray = column("Number of measured values.")
    rank: IntArray = column("Number of parameter combinations that are observable.", key="")
    n_parameters: IntArray = column("Number of parameters sought.", key="")
    condition_number: FloatArray = column(
        "Condition of the scaled information; nan when singular.", key=""
    )
    criterion_probability: FloatArray = column(
        "Probability that range is within 10 %, speed 3 kn and course 7 degrees.", key=""
    )
    range_per_sound_speed: FloatArray = column(
        "Relative change of range per relative change of sound speed.", key=""
    )
    manoeuvre_needed: BoolArray = column(
        "Whether own ship must manoeuvre to learn the range.", key=""
    )
    motion_model: TextArray | None = column(
        "'straight', or 'manoeuvre' where the target altered its velocity."
    )
    manoeuvre_time_s: FloatArray | None = column(
        "Middle of the first alteration of velocity; nan if there was none."
    )
    manoeuvre_gain: FloatArray | None = column(
        "What the best alteration gains in the misfit, noise with a memory allowed for."
    )
    manoeuvre_probability: FloatArray | None = column(
        "Probability that the target altered its velocity."
    )
    east_m: FloatArray | None = column(
        "Place at the first measurement, east of the sensors' origin; nan without "
        "sensors, or where the range is not given."
    )
    north_m: FloatArray | None = column("The same, north of the origin.")
    latitude: FloatArray | None = column("Its latitude; nan on a local grid.")
    longitude: FloatArray | None = column("Its longitude.")
    reference: TextArray | None = column(
        "Sensor from which range and bearing at the first measurement count; empty: own ship.",
        unknown="",
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
    row_contact: IntArray | None = column("Contact of a measured bearing.", "row")
    row_number: IntArray | None = column("Its row in the table, from 1.", "row")
    row_time_s: FloatArray | None = column("Its time.", "row")
    row_probability: FloatArray | None = column("Probability that it is this contact's.", "row")
    row_residual_deg: FloatArray | None = column(
        "The best mode's bearing less the measured one, offsets taken out; nan where "
        "it took no part.", "row",
    )  # fmt: skip
    offset_motion: IntArray | None = column(
        "Row of the motion that a sensor's offset belongs to.", "offset", owner="motion"
    )
    offset_sensor: TextArray | None = column("Sensor.", "offset", names="offsets_deg")
    offset_deg: FloatArray | None = column(
        "What its bearings must be turned by.", "offset", key="offsets_deg"
    )
    leg_motion: IntArray | None = column(
        "Row of the motion that a leg belongs to.", "leg", owner="motion"
    )
    leg_number: IntArray | None = column("Number of the leg, from 1.", "leg", key="legs.number")
    leg_start_s: FloatArray | None = column(
        "When it begins, behind the alteration before it.", "leg", key="legs.start_s"
    )
    leg_end_s: FloatArray | None = column("When it ends.", "leg", key="legs.end_s")
    leg_range_m: FloatArray | None = column("Range where it begins.", "leg", key="legs.range_m")
    leg_range_std_m: FloatArray | None = deviation("leg", key="legs.range_std_m")
    leg_bearing_deg: FloatArray | None = column(
        "Bearing where it begins.", "leg", key="legs.bearing_deg"
    )
    leg_bearing_std_deg: FloatArray | None = deviation("leg", key="legs.bearing_std_deg")
    leg_speed_mps: FloatArray | None = column("Speed on it.", "leg", key="legs.speed_mps")
    leg_speed_std_mps: FloatArray | None = deviation("leg", key="legs.speed_std_mps")
    leg_course_deg: FloatArray | None = column(
        "Compass course on it.", "leg", key="legs.course_deg"
    )
    leg_course_std_deg: FloatArray | None = deviation("leg", key="legs.course_std_deg")
    leg_alteration_time_s: FloatArray | None = column(
        "Middle of the alteration before it; nan of the first leg.",
        "leg", key="legs.alteration_time_s",
    )  # fmt: skip
    leg_alteration_time_std_s: FloatArray | None = deviation(
        "leg", key="legs.alteration_time_std_s"
    )
    weakest_direction: TextArray = column(
        "Worst observed combination, with its standard deviation.", key=""
    )
    report: TextArray = column("What is observable and what is not, in words.", key="")
    rest_motion: IntArray = column(
        "Row of the motion that a rest frequency belongs to.", "rest_line", owner="motion"
    )
    reason_motion: IntArray = column(
        "Row of the motion that a reason belongs to.", "reason", owner="motion"
    )
    nuisance_motion: IntArray | None = column(
        "Row of the motion that a nuisance belongs to.", "nuisance", owner="motion"
    )
    update_contact: IntArray = column("Contact of an estimate over time.", "update")
    update_time_s: FloatArray = column("Time of the newest measurement used.", "update")
    update_range_m: FloatArray = column("Range at the start.", "update")
    update_range_std_m: FloatArray = deviation("update")
    update_bearing_deg: FloatArray = column("Initial bearing.", "update")
    update_bearing_std_deg: FloatArray = deviation("update")
    update_speed_mps: FloatArray = column("Speed.", "update")
    update_speed_std_mps: FloatArray = deviation("update")
    update_course_deg: FloatArray = column("Compass course.", "update")
    update_course_std_deg: FloatArray = deviation("update")
    solver: str = scalar("Solver: mle, recursive, genetic or annealing.")
    loss: str = scalar("Loss: auto, squares, huber, student or tukey.")
    doppler: str = scalar("Doppler: instantaneous or interval.")
    propagation: str = scalar("Propagation: instant or delayed.")
    sound_speed_mps: float = scalar("Sound speed that was assumed.")
    statement: str = scalar("What no residual can reveal.")
