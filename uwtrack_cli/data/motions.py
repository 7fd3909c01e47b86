"""Motions: what bearings and Doppler tell of a target's course and speed."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

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
    (``update_*``) are a table of their own.
    """

    NAME: ClassVar[str] = "motions"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("parameter", "parameter_too")

    contact: IntArray = column("1", "Contact, from 1.", "motion", dtype=np.int64)
    mode: IntArray = column("1", "Mode, best first, from 1.", "motion", dtype=np.int64)
    weight: FloatArray = column("1", "Probability of the mode.", "motion")
    time_s: FloatArray = column("s", "Time of the first measurement.", "motion")
    time_utc_ns: IntArray = column(
        "ns", "The same since 1970-01-01 UTC; -1 if unknown.", "motion", dtype=np.int64
    )
    range_m: FloatArray = column("m", "Horizontal range from own ship.", "motion")
    range_std_m: FloatArray = deviation("m", "motion")
    range_low_m: FloatArray = column("m", "Lower end of its interval.", "motion")
    range_high_m: FloatArray = column("m", "Upper end of its interval.", "motion")
    bearing_deg: FloatArray = column("degree", "Bearing from own ship.", "motion")
    bearing_std_deg: FloatArray = deviation("degree", "motion")
    speed_mps: FloatArray = column("m/s", "Speed.", "motion")
    speed_std_mps: FloatArray = deviation("m/s", "motion")
    speed_low_mps: FloatArray = column("m/s", "Lower end of its interval.", "motion")
    speed_high_mps: FloatArray = column("m/s", "Upper end of its interval.", "motion")
    course_deg: FloatArray = column("degree", "Compass course.", "motion")
    course_std_deg: FloatArray = deviation("degree", "motion")
    course_low_deg: FloatArray = column(
        "degree", "Start of its interval, clockwise; 0 to 360 is any course.", "motion"
    )
    course_high_deg: FloatArray = column("degree", "End of its interval.", "motion")
    covariance: FloatArray = column(
        "1", "Covariance of range, bearing, speed and course (m, degree, m/s).",
        "motion", "parameter", "parameter_too",
    )  # fmt: skip
    now_time_s: FloatArray = column("s", "Time of the last measurement.", "motion")
    now_range_m: FloatArray = column("m", "Range at that time.", "motion")
    now_range_std_m: FloatArray = deviation("m", "motion")
    now_bearing_deg: FloatArray = column("degree", "Bearing at that time.", "motion")
    now_bearing_std_deg: FloatArray = deviation("degree", "motion")
    now_speed_mps: FloatArray | None = column(
        "m/s", "Speed at that time; of the last leg where the target changed its "
        "velocity.", "motion", optional=True,
    )  # fmt: skip
    now_speed_std_mps: FloatArray | None = deviation("m/s", "motion", optional=True)
    now_course_deg: FloatArray | None = column(
        "degree", "Compass course at that time.", "motion", optional=True
    )
    now_course_std_deg: FloatArray | None = deviation("degree", "motion", optional=True)
    observable: BoolArray = column(
        "1", "Whether the range is observable.", "motion", dtype=np.bool_
    )
    ellipse_trusted: BoolArray = column(
        "1", "Whether the deviations agree with the intervals.", "motion",
        dtype=np.bool_,
    )  # fmt: skip
    misfit: FloatArray = column("1", "Sum of the losses (chi-square).", "motion")
    n_values: IntArray = column(
        "1", "Number of measured values.", "motion", dtype=np.int64
    )
    rank: IntArray = column(
        "1",
        "Number of parameter combinations that are observable.",
        "motion",
        dtype=np.int64,
    )
    n_parameters: IntArray = column(
        "1", "Number of parameters sought.", "motion", dtype=np.int64
    )
    condition_number: FloatArray = column(
        "1", "Condition of the scaled information; nan when singular.", "motion"
    )
    criterion_probability: FloatArray = column(
        "1", "Probability that range is within 10 %, speed 3 kn and course 7 degrees.",
        "motion",
    )  # fmt: skip
    range_per_sound_speed: FloatArray = column(
        "1", "Relative change of range per relative change of sound speed.", "motion"
    )
    manoeuvre_needed: BoolArray = column(
        "1", "Whether own ship must manoeuvre to learn the range.", "motion",
        dtype=np.bool_,
    )  # fmt: skip
    reading: TextArray | None = column(
        "", "'straight', or 'manoeuvre' where the target changed its velocity.",
        "motion", dtype="U", optional=True,
    )  # fmt: skip
    manoeuvre_time_s: FloatArray | None = column(
        "s", "When the target changed its velocity, if it did; nan if not.",
        "motion", optional=True,
    )  # fmt: skip
    manoeuvre_gain: FloatArray | None = column(
        "1", "What the best change of velocity gains in the misfit; straight targets "
        "exceed 14.5 (20 in coloured noise) in less than 2 % of the records.", "motion", optional=True,
    )  # fmt: skip
    east_m: FloatArray | None = column(
        "m", "Place at the first measurement, east of the sensors' origin; nan without "
        "sensors, or where the range is not given.", "motion", optional=True,
    )  # fmt: skip
    north_m: FloatArray | None = column(
        "m", "The same, north of the origin.", "motion", optional=True
    )
    latitude: FloatArray | None = column(
        "degree", "Its latitude; nan on a local grid.", "motion", optional=True
    )
    longitude: FloatArray | None = column(
        "degree", "Its longitude.", "motion", optional=True
    )
    reference: TextArray | None = column(
        "", "Sensor from which range and bearing at the first measurement count; empty: "
        "own ship.", "motion", dtype=np.str_, optional=True,
    )  # fmt: skip
    row_contact: IntArray | None = column(
        "1", "Contact of a measured bearing.", "row", dtype=np.int64, optional=True
    )
    row_number: IntArray | None = column(
        "1", "Its row in the table, from 1.", "row", dtype=np.int64, optional=True
    )
    row_time_s: FloatArray | None = column(
        "s", "Its time.", "row", optional=True
    )  # fmt: skip
    row_probability: FloatArray | None = column(
        "1", "Probability that it is this contact's.", "row", optional=True
    )
    row_residual_deg: FloatArray | None = column(
        "degree", "The best mode's bearing less the measured one, offsets taken out; nan "
        "where it took no part.", "row", optional=True,
    )  # fmt: skip
    offset_motion: IntArray | None = column(
        "1", "Row of the motion that a sensor's offset belongs to.", "offset",
        dtype=np.int64, owner="motion", optional=True,
    )  # fmt: skip
    offset_sensor: TextArray | None = column(
        "", "Sensor.", "offset", dtype=np.str_, optional=True
    )
    offset_deg: FloatArray | None = column(
        "degree", "What its bearings must be turned by.", "offset", optional=True
    )
    weakest_direction: TextArray = column(
        "", "Worst observed combination, with its deviation.", "motion", dtype="U"
    )
    report: TextArray = column(
        "", "What is observable and what is not, in words.", "motion", dtype="U"
    )
    rest_motion: IntArray = column(
        "1", "Row of the motion that a rest frequency belongs to.", "rest_line",
        dtype=np.int64, owner="motion",
    )  # fmt: skip
    reason_motion: IntArray = column(
        "1", "Row of the motion that a reason belongs to.", "reason",
        dtype=np.int64, owner="motion",
    )  # fmt: skip
    nuisance_motion: IntArray | None = column(
        "1", "Row of the motion that a nuisance belongs to.", "nuisance",
        dtype=np.int64, owner="motion", optional=True,
    )  # fmt: skip
    update_contact: IntArray = column(
        "1", "Contact of an estimate over time.", "update", dtype=np.int64
    )
    update_time_s: FloatArray = column(
        "s", "Time of the newest measurement used.", "update"
    )
    update_range_m: FloatArray = column("m", "Range at the start.", "update")
    update_range_std_m: FloatArray = deviation("m", "update")
    update_bearing_deg: FloatArray = column("degree", "Initial bearing.", "update")
    update_bearing_std_deg: FloatArray = deviation("degree", "update")
    update_speed_mps: FloatArray = column("m/s", "Speed.", "update")
    update_speed_std_mps: FloatArray = deviation("m/s", "update")
    update_course_deg: FloatArray = column("degree", "Compass course.", "update")
    update_course_std_deg: FloatArray = deviation("degree", "update")
    solver: str = scalar("", "Solver: mle, recursive, genetic or annealing.")
    loss: str = scalar("", "Loss: auto, squares, huber, student or tukey.")
    doppler: str = scalar("", "Doppler: instantaneous or interval.")
    propagation: str = scalar("", "Propagation: instant or delayed.")
    sound_speed_mps: float = scalar("m/s", "Sound speed that was assumed.")
    statement: str = scalar("", "What no residual can reveal.")
