"""From fits to rows of encounters: what is known, and why the rest is not.

**Method.** A value is given when the data determine it (its deviation is small
enough); otherwise it is nan and its reason stands under its key. Deviations of bearing
and course hold the sensor's compass; the clock is left to `locate`.

The calibrated levels are the sum of the vessels' shares, which fall with the square of
the range as the fitted passages say, and of a constant background: all powers are
fitted in decibels. The source level adds the loss over the slant range under a stated
law of spreading.

Another vessel's sound is directional noise and turns a line's bearings by about the
noise-to-signal ratio of its cell. The peaks are freed of it except for a share that
grows as lines get weak; it is alike in all lines and does not average out. Frames
should be as long as a line's sweep at closest approach allows: shorter ones waste
information, longer ones blur it. Beyond 8 s nothing is gained.

**Conventions.** Times count from the first sample; see `Encounters`. Levels are dB re
the levels' reference, in their band; source levels at 1 m, and only where the
recording is calibrated.

**References.** Choi et al. (2014), eq. 3 as a sum, with a background. Frame length
min(0.8 / sqrt(f0 v^2 / (c d)), 8 s): the sweep within a frame stays below the frame's
own resolution.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from uwtrack_cli.acoustics.geometry import course_deg, side_of_vessel
from uwtrack_cli.acoustics.medium import WATER_MPS, spreading_loss_db
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray, IntArray, flatten, reason_columns
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.presence import STILL
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import MICROPASCAL, Levels
from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.estimation.robust import bisquare_weight, median_scale
from uwtrack_cli.motion.correlation import long_run_excess
from uwtrack_cli.motion.decision import (
    NOT_SIGNIFICANT,
    SENSOR_TURNED,
    UNDECIDED,
    PassageDecision,
    Rejection,
    reject,
)
from uwtrack_cli.motion.passage.candidates import CandidatePassage, Still
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.fit.nuisances import NuisanceEstimate, NuisancePriors, marginalise
from uwtrack_cli.motion.passage.fit.source_patterns import LAW_SHARE
from uwtrack_cli.motion.passage.model.moving_sensor import (
    AT_REST_MPS,
    LARGEST_M,
    LARGEST_SHARE,
    SensorMotion,
    over_ground,
    sensor_motion,
)
from uwtrack_cli.motion.passage.model.unknowns import CHANGED, RAMP, STEP, TURN
from uwtrack_cli.motion.passage.readings.change_priors import STRAIGHT, VESSEL_MPS, VESSEL_STD_MPS

OK, EXTRAPOLATED, LEVEL_ONLY = "ok", "extrapolated", "level-only"
NO_SPEED = "no-speed"

LARGEST_RELATIVE_DEVIATION = 0.5
"""A quantity less certain than this is not given."""

SMALLEST_SPEED_DEVIATIONS = 3.0
"""A speed within so many deviations of zero is not given."""

NO_SOUND = "the sound is not at hand"
NOTHING_TO_CHECK = "the lines show too little of a passage to be checked"

VALUES = (
    "time_s", "time_std_s", "arrival_time_s", "speed_mps", "speed_std_mps",
    "slant_range_m", "slant_range_std_m", "horizontal_range_m",
    "horizontal_range_std_m", "range_over_speed_s", "range_over_speed_std_s",
    "horizontal_range_over_speed_s", "horizontal_range_over_speed_std_s",
    "course_deg", "course_std_deg", "bearing_deg",
    "bearing_std_deg", "received_level_db", "received_level_std_db",
    "source_level_db", "source_level_std_db", "source_depth_m", "source_depth_std_m",
    "rest_frame_evidence", "misfit",
    "motion_model_probability", "alternative_motion_model_probability", "change_time_s", "change_time_std_s",
    "frequency_change", "frequency_change_std", "frequency_slope_per_s",
    "frequency_slope_std_per_s", "other_leg_speed_mps", "other_leg_speed_std_mps",
    "other_leg_course_deg", "other_leg_course_std_deg", "turn_away_deg",
    "turn_away_std_deg", "turn_duration_s", "turn_duration_std_s", "turn_correlation",
)  # fmt: skip
"""Columns of Encounters that are numbers about the passage."""


@dataclass(frozen=True)
class CpaContext:
    """What is known of the sensor and the medium."""

    sensor: Sensor
    """The sensor, of unknown position and depth if none is given."""
    priors: NuisancePriors
    """Depths, sound speed and compass before the fit."""
    start_utc_ns: int | None
    """UTC epoch of the first sample, ns; None if unknown."""
    reference: str
    """Reference of the levels."""
    band_hz: tuple[float, float] | None
    """Lower and upper edge of the levels' band, Hz; None without levels."""
    spreading_db: float
    """Spreading loss, dB per decade of range."""

    @property
    def sound_speed_mps(self) -> float:
        """Sound speed, m/s."""
        return float(self.priors.mean[2])


class Refusal(NamedTuple):
    """What was examined and is no passage."""

    contact: int
    """Contact number, from 1."""
    from_s: float
    """Time of its first measurement, s."""
    to_s: float
    """Time of its last measurement, s."""
    reason: Rejection
    """Why it is no passage."""
    reading: str = ""
    """What it is read as; empty for one that was taken for a passage and refused."""
    weight: float = np.nan
    """Probability of that reading."""
    rival: str = ""
    """The next reading; empty if it has less than 5 %."""
    rival_weight: float = np.nan
    """Its probability; 0 without one."""
    probability: float = np.nan
    """That a vessel passes all the same; nan if that was not asked."""


@dataclass
class Row:
    """One encounter while it is being filled in."""

    contact: int
    """Contact number, from 1."""
    status: str
    """'ok', 'extrapolated', 'level-only' or 'no-speed'."""
    values: dict[str, float] = field(default_factory=lambda: dict.fromkeys(VALUES, float("nan")))
    """Numbers by column of Encounters; nan is unknown."""
    covariance: FloatArray = field(default_factory=lambda: np.full((4, 4), np.nan))
    """Of time (s), range over speed (s), speed (m/s) and bearing (degrees), shape
    (4, 4)."""
    side: str = ""
    """Side of the vessel on which the sensor lies; empty if unknown."""
    extrapolated: bool = False
    """Whether the closest approach lies outside the recording."""
    other_sides: list[tuple[str, float]] = field(default_factory=list)
    """Another side of the vessel on which the sensor may lie, and its probability."""
    reasons: dict[str, str] = field(default_factory=dict)
    """Why a value is missing, by column."""
    rest: list[tuple[int, float, float]] = field(default_factory=list)
    """Line, rest frequency (Hz) and deviation (Hz) of every line."""
    horizontal_covariance: FloatArray = field(default_factory=lambda: np.full((4, 4), np.nan))
    """As the covariance, of the horizontal range over speed."""
    nuisances: list[NuisanceEstimate] = field(default_factory=list)
    """Depths, sound speed and compass after the fit."""
    sensor: SensorMotion | None = None
    """Motion of the sensor; None for a fixed one."""
    reading: str = STRAIGHT
    """How the measurements are read."""
    rival: str = ""
    """The next reading; empty if it has less than 5 %."""
    decision: PassageDecision = UNDECIDED
    """How sure it is that a vessel passes."""
    change_follows: bool = False
    """Whether what changed follows its time; else it goes before it."""

    def explain(self, reason: str, *names: str) -> None:
        """State why values are missing, unless they are there or explained."""
        for name in names:
            if name in VALUES and np.isfinite(self.values[name]):
                continue
            self.reasons.setdefault(name, reason)


def passage_row(contact: int, fit: PassageFit, context: CpaContext, line_ids: IntArray) -> Row:
    """Fill a row from the fit of a passage.

    Parameters
    ----------
    contact
        Contact number.
    fit
        Fit of one data set.
    context
        Sensor and medium.
    line_ids
        Identifiers of the lines in the order of the fit's rows.
    """
    row = Row(contact, OK)
    fit, row.nuisances = marginalise(fit, context.priors)
    variance = np.diag(fit.covariance[0])
    width, speed = float(fit.range_over_speed_s[0]), float(fit.theta[0, 2])
    row.covariance = fit.covariance[0].copy()
    row.horizontal_covariance = fit.full_covariance[0, :4, :4].copy()
    row.values["time_s"] = float(fit.theta[0, 0])
    row.values["time_std_s"] = float(np.sqrt(variance[0]))
    row.values["range_over_speed_s"] = width
    row.values["range_over_speed_std_s"] = float(np.sqrt(variance[1]))
    _add_speed(row, fit, context, line_ids)
    delay = width * speed / context.sound_speed_mps
    row.values["arrival_time_s"] = row.values["time_s"] + delay
    _add_direction(row, fit, context)
    if not fit.rest_hz.shape[1]:
        _without_speed(row, fit, context)
    told_by_level = not (np.isfinite(row.values["speed_mps"]) or row.side)
    if told_by_level and not fit.medium.is_air:  # in air `directivity` holds it
        _add_law(row)
    _add_change(row, fit)
    return row


def _add_change(row: Row, fit: PassageFit) -> None:
    """Give what changed beside the passage: a manoeuvre's other leg or its turn."""
    change, v = fit.change, row.values
    if change is None or not np.isfinite(v["speed_mps"]):
        return
    v["change_time_s"] = float(change.time_s[0])
    row.change_follows = bool(change.sign[0] > 0)
    size = fit.theta[0, CHANGED:]
    spread = fit.full_covariance[0]
    names = {STEP: "frequency_change{}", RAMP: "frequency_slope{}_per_s"}
    if change.kind in names:
        name = names[change.kind]
        v[name.format("")] = float(size[0])
        v[name.format("_std")] = float(np.sqrt(spread[5, 5]))
        return
    if change.kind == TURN:
        half_s, lag_s = 0.5 * size[1], float(change.time_s[0] - fit.theta[0, 0])
        row.change_follows = lag_s > 0
        own = spread[5:7, 5:7]
        std = np.sqrt(np.diag(own))
        v["turn_away_deg"], v["turn_away_std_deg"] = np.rad2deg([size[0], std[0]])
        v["turn_duration_s"], v["turn_duration_std_s"] = size[1], std[1]
        v["turn_correlation"] = float(own[0, 1] / (std[0] * std[1]))
        if abs(lag_s) > half_s:
            v["other_leg_speed_mps"] = v["speed_mps"]
            v["other_leg_speed_std_mps"] = v["speed_std_mps"]
            _add_other_course(row, fit, size[0] * np.sign(lag_s), {5: np.sign(lag_s)})
        return
    # velocity along the course and away from the sensor; each by speed and both
    velocity = np.array([v["speed_mps"] + size[0], size[1]])
    speed = float(np.hypot(*velocity))
    unit = velocity / max(speed, 1e-9)
    places = [2, 5, 6]
    own = spread[np.ix_(places, places)]
    along = np.array([unit[0], unit[0], unit[1]])
    across = np.array([-unit[1], -unit[1], unit[0]]) / max(speed, 1e-9)
    v["other_leg_speed_mps"] = speed
    v["other_leg_speed_std_mps"] = float(np.sqrt(along @ own @ along))
    angle = float(np.arctan2(velocity[1], velocity[0]))
    _add_other_course(row, fit, angle, dict(zip(places, across.tolist(), strict=True)))


def _add_other_course(
    row: Row, fit: PassageFit, angle_rad: float, slopes: dict[int, float]
) -> None:
    """Give the course of another leg, from its angle away from the sensor.

    ``slopes`` are the partials of that angle by place among the unknowns.
    """
    if not row.side:
        return
    # away from the sensor is to port of the course if the sensor is to starboard
    turn, v = float(fit.turn[0]), row.values
    v["other_leg_course_deg"] = float((v["course_deg"] - turn * np.rad2deg(angle_rad)) % 360.0)
    gradient = np.zeros(fit.full_covariance.shape[1])
    for place, slope in slopes.items():
        gradient[place] = -turn * np.rad2deg(slope)
    gradient[3] = 1.0
    variance = gradient @ fit.full_covariance[0] @ gradient
    v["other_leg_course_std_deg"] = float(np.sqrt(variance))


def _without_speed(row: Row, fit: PassageFit, context: CpaContext) -> None:
    """Give what bearings and levels tell: arrival and both ranges over speed.

    Without a speed the fit has the time of arrival; the closest approach was earlier
    by the slant range over the sound speed, which the speeds of vessels bound.
    """
    if WATER_MPS[0] < context.sound_speed_mps < WATER_MPS[1]:
        slant_s = row.values["range_over_speed_s"]
        each_s = slant_s / context.sound_speed_mps
        row.values["time_s"] -= each_s * VESSEL_MPS
        row.covariance[0, 0] += (each_s * VESSEL_STD_MPS) ** 2
        row.horizontal_covariance[0, 0] = row.covariance[0, 0]
        row.values["time_std_s"] = float(np.sqrt(row.covariance[0, 0]))
    if row.side and context.sensor.depth_m is not None:
        row.values["horizontal_range_over_speed_s"] = float(np.exp(fit.theta[0, 1]))
        row.values["horizontal_range_over_speed_std_s"] = float(
            np.sqrt(row.horizontal_covariance[1, 1])
        )
        row.reasons.pop("horizontal_range_over_speed_s", None)


def _add_law(row: Row) -> None:
    """Widen d/v from levels alone by what an unknown law of spreading can do to it."""
    width = row.values["range_over_speed_s"]
    for covariance in (row.covariance, row.horizontal_covariance):
        covariance[1, 1] += (LAW_SHARE * width) ** 2
    row.values["range_over_speed_std_s"] = float(np.sqrt(row.covariance[1, 1]))


def _add_speed(row: Row, fit: PassageFit, context: CpaContext, line_ids: IntArray) -> None:
    keys = (
        "speed_mps", "slant_range_m", "horizontal_range_m",
        "horizontal_range_over_speed_s", "source_level_db",
    )  # fmt: skip
    if not fit.rest_hz.shape[1]:
        row.status = LEVEL_ONLY
        _forget_speed(row, "no line", *keys)
        return
    (width, speed), covariance = (
        (float(fit.range_over_speed_s[0]), float(fit.theta[0, 2])),
        fit.covariance[0],
    )
    deviation = float(np.sqrt(covariance[2, 2]))
    if not speed > SMALLEST_SPEED_DEVIATIONS * deviation:
        row.status = LEVEL_ONLY
        _forget_speed(row, "the lines show no Doppler shift beyond their noise", *keys)
        return
    row.values["speed_mps"], row.values["speed_std_mps"] = speed, deviation
    for line, rest, std in zip(line_ids, fit.rest_hz[0], fit.rest_std_hz[0], strict=True):
        if np.isfinite(std):
            row.rest.append((int(line), float(rest), float(std)))
    gradient = np.array([speed, width])
    range_std = float(np.sqrt(gradient @ covariance[1:3, 1:3] @ gradient))
    slant = width * speed
    if range_std > LARGEST_RELATIVE_DEVIATION * slant:
        row.explain("its standard deviation is more than half its value", *keys[1:])
        return
    row.values["slant_range_m"], row.values["slant_range_std_m"] = slant, range_std
    if context.sensor.depth_m is None:
        row.explain("the depth of the sensor is not known", *keys[2:4])
        return
    inner = fit.full_covariance[0, 1:3, 1:3]
    flat_s = float(np.exp(fit.theta[0, 1]))
    gradient = np.array([speed, flat_s])
    row.values["horizontal_range_m"] = flat_s * speed
    row.values["horizontal_range_std_m"] = float(np.sqrt(gradient @ inner @ gradient))
    row.values["horizontal_range_over_speed_s"] = flat_s
    row.values["horizontal_range_over_speed_std_s"] = float(np.sqrt(inner[0, 0]))


def _forget_speed(row: Row, reason: str, *keys: str) -> None:
    for covariance in (row.covariance, row.horizontal_covariance):
        covariance[2, :] = covariance[:, 2] = np.nan
    row.nuisances = [item._replace(share=np.nan) for item in row.nuisances]
    row.explain(reason, "rest_frequencies_hz", *keys)


def _add_direction(row: Row, fit: PassageFit, context: CpaContext) -> None:
    keys = ("bearing_deg", "course_deg", "side")
    variance = float(fit.covariance[0, 3, 3])
    if not np.isfinite(variance):
        is_omni = len(context.sensor.channel_names) == 1
        why = "no bearing channel" if is_omni else "no bearing that stands out"
        row.explain(why, *keys)
        return
    if np.sqrt(variance) > LARGEST_BEARING_STD_DEG:
        for covariance in (row.covariance, row.horizontal_covariance):
            covariance[3, :] = covariance[:, 3] = np.nan
        row.explain("the bearings do not stand out from their noise", *keys)
        return
    turn = int(fit.turn[0])
    bearing = float(fit.bearing_deg[0])
    row.values["bearing_deg"] = bearing
    row.values["course_deg"] = float(course_deg(bearing, turn))
    row.values["bearing_std_deg"] = row.values["course_std_deg"] = float(np.sqrt(variance))
    row.side = side_of_vessel(turn)


def add_sensor_motion(row: Row, context: CpaContext) -> Rejection | None:
    """Turn what is relative to a moving sensor into motion over ground.

    Parameters
    ----------
    row
        Row of a passage.
    context
        Sensor and medium.

    Returns
    -------
    Rejection | None
        Why the passage cannot be given, or None.
    """
    navigation, v = context.sensor.navigation, row.values
    if navigation is None:
        return None
    motion = sensor_motion(navigation, context.start_utc_ns, v["time_s"], v["range_over_speed_s"])
    speed = v["speed_mps"]
    range_m = v["range_over_speed_s"] * speed if np.isfinite(speed) else 0.0
    if motion.departure_m > max(LARGEST_SHARE * range_m, LARGEST_M):
        return reject(SENSOR_TURNED, departure_m=motion.departure_m)
    if float(np.hypot(*motion.velocity_mps)) < AT_REST_MPS:
        motion = motion._replace(velocity_mps=np.zeros(2))
    row.sensor = motion
    if not row.side or not motion.velocity_mps.any():
        return None
    if not np.isfinite(speed):
        v["course_deg"] = v["course_std_deg"] = np.nan
        row.side = ""
        row.explain("the sensor moves and no speed is known", "course_deg", "side")
        return None
    ground = over_ground(
        speed, v["course_deg"], v["bearing_deg"], row.covariance[2:, 2:], motion.velocity_mps
    )
    v["speed_mps"], v["speed_std_mps"] = ground.speed_mps, ground.speed_std_mps
    v["course_deg"], v["course_std_deg"] = ground.course_deg, ground.course_std_deg
    if np.isfinite(v["other_leg_speed_mps"]):
        other = over_ground(
            v["other_leg_speed_mps"], v["other_leg_course_deg"], v["bearing_deg"],
            np.diag([v["other_leg_speed_std_mps"], v["other_leg_course_std_deg"]]) ** 2,
            motion.velocity_mps,
        )  # fmt: skip
        v["other_leg_speed_mps"] = other.speed_mps
        v["other_leg_speed_std_mps"] = other.speed_std_mps
        v["other_leg_course_deg"] = other.course_deg
        v["other_leg_course_std_deg"] = other.course_std_deg
    row.side = side_of_vessel(1 if ground.is_starboard else -1)
    return None


def add_checks(row: Row, candidate: CandidatePassage, *, has_sound: bool) -> None:
    """Add what the checks of the fit found, or why they were not made.

    Parameters
    ----------
    row
        Row of a contact.
    candidate
        Its fit with its checks.
    has_sound
        Whether the recording was at hand.
    """
    reading = candidate.reading
    row.reading, row.rival = reading.name, reading.rival
    row.values["motion_model_probability"] = reading.weight
    row.values["alternative_motion_model_probability"] = reading.rival_weight
    if np.isfinite(row.values["change_time_s"]):
        row.values["change_time_std_s"] = reading.change_time_std_s
    row.values["rest_frame_evidence"] = candidate.rest_frame_evidence
    row.values["misfit"] = candidate.misfit
    for name in ("rest_frame_evidence", "misfit"):
        if np.isfinite(row.values[name]):
            row.reasons.pop(name, None)
    lacking = "no line" if candidate.blocks.shift.is_empty else NOTHING_TO_CHECK
    row.explain(lacking, "misfit")
    heard = lacking if has_sound or candidate.blocks.shift.is_empty else NO_SOUND
    row.explain(heard, "rest_frame_evidence")


def _place_and_velocity(row: Row) -> FloatArray:
    """Return east, north, and their rates of a moving sensor; nan for a fixed one."""
    if row.sensor is None:
        return np.full(4, np.nan)
    return np.concatenate([row.sensor.place_m, row.sensor.velocity_mps])


def still_contact(still: Still) -> Refusal:
    """Return what is said of a contact that is not told to pass.

    Parameters
    ----------
    still
        The contact, with its reading.
    """
    one = still.reading
    return Refusal(
        still.contact, still.from_s, still.to_s,
        reject(one.name if one.name in STILL else NOT_SIGNIFICANT),
        one.name, one.weight, one.rival, one.rival_weight,
    )  # fmt: skip


def make_encounters(rows: list[Row], refusals: list[Refusal], context: CpaContext) -> Encounters:
    """Gather the rows into the container.

    Parameters
    ----------
    rows
        Filled rows.
    refusals
        What is no passage.
    context
        Sensor and medium.
    """
    start = context.start_utc_ns
    times = np.array([row.values["time_s"] for row in rows])
    utc = [
        -1 if start is None or not np.isfinite(time) else start + round(float(time) * NANOSECONDS)
        for time in times
    ]
    rest = [(n, *item) for n, row in enumerate(rows) for item in row.rest]
    table = np.array(rest, float).reshape(len(rest), 4)
    owner, other_sides = flatten(row.other_sides for row in rows)
    low, high = context.band_hz or (None, None)
    columns: dict[str, Any] = {
        name: np.array([row.values[name] for row in rows], float) for name in VALUES
    }
    columns |= reason_columns("reason_encounter", [row.reasons for row in rows])
    moved = np.array([_place_and_velocity(row) for row in rows]).reshape(-1, 4)
    holder, left = flatten(row.nuisances for row in rows)
    weighed, nepers = flatten(row.decision.nepers for row in rows)
    decisions = [row.decision for row in rows]
    return Encounters(
        **columns,
        contact=np.array([row.contact for row in rows], np.int64),
        sensor=np.array([context.sensor.id] * len(rows), dtype=np.str_),
        status=np.array([row.status for row in rows], dtype=np.str_),
        time_utc_ns=np.array(utc, np.int64),
        side=np.array([row.side for row in rows], dtype=np.str_),
        probability=np.array([one.probability for one in decisions], float),
        alternative=np.array([one.alternative for one in decisions], np.str_),
        alternative_probability=np.array([one.alternative_probability for one in decisions], float),
        evidence_encounter=weighed,
        evidence_alternative=np.array([code for code, _ in nepers], np.str_),
        evidence_nepers=np.array([value for _, value in nepers], float),
        motion_model=np.array([row.reading for row in rows], dtype=np.str_),
        alternative_motion_model=np.array([row.rival for row in rows], dtype=np.str_),
        change_follows=np.array([row.change_follows for row in rows], np.bool_),
        sound_speed_mps=np.full(len(rows), context.sound_speed_mps),
        extrapolated=np.array([row.extrapolated for row in rows], np.bool_),
        covariance=np.array([row.covariance for row in rows]).reshape(-1, 4, 4),
        horizontal_covariance=np.array([row.horizontal_covariance for row in rows]).reshape(
            -1, 4, 4
        ),
        sensor_east_m=moved[:, 0],
        sensor_north_m=moved[:, 1],
        sensor_velocity_east_mps=moved[:, 2],
        sensor_velocity_north_mps=moved[:, 3],
        nuisance_encounter=holder,
        nuisance_name=np.array([item.name for item in left], np.str_),
        nuisance_value=np.array([item.value for item in left], float),
        nuisance_std=np.array([item.std for item in left], float),
        nuisance_share=np.array([item.share for item in left], float),
        ambiguity_encounter=owner,
        ambiguity_side=np.array([side for side, _ in other_sides], np.str_),
        ambiguity_weight=np.array([weight for _, weight in other_sides]),
        rest_encounter=table[:, 0].astype(np.int64),
        rest_line_id=table[:, 1].astype(np.int64),
        rest_frequency_hz=table[:, 2],
        rest_frequency_std_hz=table[:, 3],
        refused_contact=np.array([one.contact for one in refusals], np.int64),
        refused_sensor=np.array([context.sensor.id] * len(refusals), dtype=np.str_),
        refused_from_s=np.array([one.from_s for one in refusals], float),
        refused_to_s=np.array([one.to_s for one in refusals], float),
        refused_reason=np.array([one.reason.sentence for one in refusals], np.str_),
        refused_code=np.array([one.reason.code for one in refusals], np.str_),
        refused_probability=np.array([one.probability for one in refusals], float),
        refused_motion_model=np.array([one.reading for one in refusals], dtype=np.str_),
        refused_motion_model_probability=np.array([one.weight for one in refusals], float),
        refused_alternative_motion_model=np.array([one.rival for one in refusals], dtype=np.str_),
        refused_alternative_motion_model_probability=np.array(
            [one.rival_weight for one in refusals], float
        ),
        reference=context.reference,
        band_low_hz=low,
        band_high_hz=high,
        spreading_db=context.spreading_db,
    )


KEYS = ("received_level_db", "source_level_db")
LARGEST_BEARING_STD_DEG = 60.0
"""Deviation of the bearing at the closest approach above which none is told."""

LARGEST_LEVEL_STD_DB = 3.0
"""A level less certain than this is not given."""

MOST_FRAMES, MOST_FAR = 20_000, 5_000
"""Frames beyond which those far from all vessels are thinned, and to how many."""

FAR = np.log(0.01)
"""Spreading beyond ten times the range at closest approach: background alone."""

FAR_WIDTHS, NEAR_WIDTHS = 10.0, 15.0
"""d/v beyond which a vessel is far, and up to which a long recording's levels about a
closest approach are taken: its background is that of the time, not of the day."""


def add_levels(
    rows: list[Row], levels: Levels | None, fits: list[PassageFit], context: CpaContext
) -> None:
    """Add received and source level to the rows, or why there are none.

    Parameters
    ----------
    rows
        Rows of the passages of one recording.
    levels
        Broadband levels, or None.
    fits
        Their fits.
    context
        Sensor, medium and spreading law.
    """
    if levels is None or not rows:
        for row in rows:
            row.explain("no broadband levels", *KEYS)
        return
    middle_s = np.array([row.values["time_s"] for row in rows])
    width_s = np.array([float(fit.range_over_speed_s[0]) for fit in fits])
    time = np.asarray(levels.frames.time_s, float)
    level_db = np.asarray(levels.level_db, float)
    if time.size <= MOST_FRAMES:
        found = _levels_of(level_db, time, fits, width_s)
    else:  # one by one, with its neighbours: what is far is no matter of it
        found = np.empty((2, len(fits)))
        for k, reach_s in enumerate(NEAR_WIDTHS * width_s):
            near = np.abs(time - middle_s[k]) <= reach_s
            lag_s = np.abs(middle_s - middle_s[k])
            own = np.flatnonzero(lag_s <= reach_s + FAR_WIDTHS * width_s)
            part = _levels_of(level_db[near], time[near], [fits[j] for j in own], width_s[own])
            found[:, k] = part[:, own == k][:, 0]
    for row, level, std in zip(rows, *found, strict=True):
        if not std < LARGEST_LEVEL_STD_DB:
            row.explain("the level does not stand out from the background", *KEYS)
            continue
        row.values["received_level_db"] = float(level)
        row.values["received_level_std_db"] = float(std)
        _add_source_level(row, context)


def _levels_of(
    level_db: FloatArray, time_s: FloatArray, fits: Sequence[PassageFit], width_s: FloatArray
) -> FloatArray:
    """Return levels at closest approach and deviations, shape (2, fit)."""
    spread = np.empty((len(fits), time_s.size))
    for number, fit in enumerate(fits):  # a copy each: the law's other rows may go
        spread[number] = fit.law(time_s).spread[0]
    if time_s.size > MOST_FRAMES:
        kept = _telling(spread)
        level_db, spread, time_s = level_db[kept], spread[:, kept], time_s[kept]
    return np.stack(_fit_levels(level_db, spread, time_s, float(width_s.max())))


def _telling(spread: FloatArray) -> IntArray:
    """Choose the frames that some vessel is near, and some of all the others."""
    is_near = (spread > FAR).any(axis=0)
    is_near[:: -(-is_near.size // MOST_FAR)] = True
    return np.flatnonzero(is_near)


def _add_source_level(row: Row, context: CpaContext) -> None:
    level, std = row.values["received_level_db"], row.values["received_level_std_db"]
    slant, slant_std = row.values["slant_range_m"], row.values["slant_range_std_m"]
    if not np.isfinite(slant):
        return
    if context.reference != MICROPASCAL:
        row.explain("the recording is not calibrated", "source_level_db")
        return
    row.reasons.pop("source_level_db", None)
    loss, loss_std = spreading_loss_db(slant, slant_std, context.spreading_db)
    row.values["source_level_db"] = level + loss
    row.values["source_level_std_db"] = float(np.hypot(std, loss_std))


def _fit_levels(
    level_db: FloatArray, spread: FloatArray, time_s: FloatArray, width_s: float
) -> tuple[FloatArray, FloatArray]:
    """Fit vessels and background in dB; levels at closest approach and deviations."""
    good = np.isfinite(level_db)
    if good.sum() < 8:
        unknown = np.full(spread.shape[0], np.nan)
        return unknown, unknown
    level, spread, time = level_db[good], spread[:, good], time_s[good]
    background = float(np.quantile(level, 0.1))
    theta: FloatArray = np.array(
        [_loudest(level, row, background) for row in spread] + [background]
    )
    weight: FloatArray = np.ones(level.size)
    slope: FloatArray = np.empty((level.size, theta.size))
    for _ in range(30):
        total, slope = _level_model(theta, spread)
        residual = level - total
        scale = max(float(median_scale(residual, np.ones(level.size))), 1e-9)
        weight = bisquare_weight(residual / scale)
        normal = slope.T @ (weight[:, None] * slope) + 1e-9 * np.eye(theta.size)
        step = np.linalg.solve(normal, slope.T @ (weight * residual))
        theta = theta + np.clip(step, -6.0, 6.0)
        if np.abs(step).max() < 1e-6:
            break
    residual = level - _level_model(theta, spread)[0]
    precision = weight / scale**2
    excess = long_run_excess(
        residual[None], precision[None], time, max(1.5 * width_s, float(np.ptp(time)) / 50)
    )
    weight = precision / (1 + excess[0] * precision)
    normal = slope.T @ (weight[:, None] * slope) + 1e-12 * np.eye(theta.size)
    return theta[:-1], np.sqrt(np.diag(np.linalg.inv(normal)))[:-1]


def _loudest(level: FloatArray, spread: FloatArray, background: float) -> float:
    """Level about the closest approach, to start from."""
    near = spread > np.log(0.5)
    loudest = float(np.median(level[near])) if near.any() else float(level.max())
    return max(loudest, background + 1.0)


def _level_model(theta: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Total level, and the shares of the vessels and of the background."""
    unit = np.log(10) / 10
    parts = theta[:, None] * unit
    parts = np.concatenate([parts[:-1] + spread, parts[-1:] + 0 * spread[:1]])
    total: FloatArray = np.logaddexp.reduce(parts, axis=0)
    return total / unit, np.exp(parts - total).T


LEFT_OF_PULL = 0.3
"""Share of the pull left on bearings of lines near their threshold (9 to 10 dB)."""

LONGEST_S = 8.0
"""Longest frames advised: shafts do not turn evenly for longer."""

TOO_LONG, TOO_SHORT = 2.0, 1 / 12
"""Window over the best frame length beyond which advice is given."""


def widen_for_others(row: Row, lines: Lines | None, line_ids: IntArray) -> None:
    """Widen what rests on bearings by what is left of other vessels' pull on them.

    A turn by an angle that changes along the passage moves its time and width by
    up to the angle times d/v; half of that is taken.

    Parameters
    ----------
    row
        Row of one of several vessels.
    lines
        Tracked lines.
    line_ids
        Lines of this vessel.
    """
    if lines is None or not row.side:
        return
    lag = np.abs(np.asarray(lines.time_s) - row.values["time_s"])
    near = np.isin(lines.line, line_ids) & (lag < row.values["range_over_speed_s"])
    snr = lines.measured_snr_db[near]
    snr = snr[np.isfinite(snr)]
    if not snr.size:
        return
    turned = LEFT_OF_PULL * np.rad2deg(10 ** (-float(np.median(snr)) / 10) / np.sqrt(2))
    moved = 0.5 * np.deg2rad(turned) * row.values["range_over_speed_s"]
    for covariance in (row.covariance, row.horizontal_covariance):
        covariance[np.diag_indices(4)] += np.array([moved, moved, 0.0, turned]) ** 2
    deviation = np.sqrt(np.diag(row.covariance))
    row.values["time_std_s"] = float(deviation[0])
    row.values["range_over_speed_std_s"] = float(deviation[1])
    row.values["bearing_std_deg"] = row.values["course_std_deg"] = float(deviation[3])
    speed = row.values["speed_mps"]
    if np.isfinite(row.values["slant_range_std_m"]):
        row.values["slant_range_std_m"] = float(
            np.hypot(row.values["slant_range_std_m"], speed * moved)
        )


def advise_frames(row: Row, context: CpaContext, window_s: float) -> None:
    """Warn if other frames would suit the passage that was found much better.

    Parameters
    ----------
    row
        Row of an encounter with a speed.
    context
        Sound speed.
    window_s
        Length of the frames in seconds; zero if unknown.
    """
    slant = row.values["slant_range_m"]
    if not np.isfinite(slant) or not row.rest or window_s <= 0:
        return
    highest = max(frequency for _, frequency, _ in row.rest)
    sweep = highest * row.values["speed_mps"] ** 2 / (context.sound_speed_mps * slant)
    best_s = min(0.8 / float(np.sqrt(sweep)), LONGEST_S)
    if TOO_SHORT * best_s <= window_s <= TOO_LONG * best_s:
        return
    wrong = "long: they blur" if window_s > best_s else "short: they waste"
    msg = (
        f"contact {row.contact}: frames of {window_s:.3g} s are too {wrong} what its "
        f"lines measure; window_s = {best_s:.2g} would suit (see 'uwtrack recipes')."
    )
    warnings.warn(msg, UwtrackWarning, stacklevel=3)
