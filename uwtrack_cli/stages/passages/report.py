"""From fits to rows of encounters: what is known, and why the rest is not.

**Method.** A value is given when the data tell it (its deviation is small enough);
otherwise it is nan and its reason stands under its key. Deviations of bearing and
course hold the sensor's compass; the clock is left to `locate`.

**Conventions.** Times count from the first sample; see `Encounters`.
"""

import json
from dataclasses import dataclass, field

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.estimation.passages.fit import PassageFit
from uwtrack_cli.physics.geometry import (
    course_deg,
    horizontal_range_m,
    side_of_vessel,
)

OK, EXTRAPOLATED, LEVEL_ONLY, NOT_A_PASSAGE = (
    "ok", "extrapolated", "level-only", "not-a-passage",
)  # fmt: skip

LARGEST_RELATIVE_DEVIATION = 0.5
"""A quantity less certain than this is not given."""

SMALLEST_SPEED_DEVIATIONS = 3.0
"""A speed within so many deviations of zero is not given."""

LAW_SHARE = 0.3
"""Deviation of d/v, as a share, from a fit of levels alone: with 15 log R instead of
20 log R it is 27 to 87 % too long."""

VALUES = (
    "time_s", "time_std_s", "arrival_time_s", "speed_mps", "speed_std_mps",
    "slant_range_m", "slant_range_std_m", "horizontal_range_m", "range_over_speed_s",
    "range_over_speed_std_s", "course_deg", "course_std_deg", "bearing_deg",
    "bearing_std_deg", "received_level_db", "received_level_std_db",
    "source_level_db", "source_level_std_db",
)  # fmt: skip
"""Columns of Encounters that are numbers about the passage."""


@dataclass(frozen=True)
class Setting:
    """What is known of the sensor and the medium."""

    sensor: Sensor
    sound_speed_mps: float
    source_depth_m: float
    start_utc_ns: int | None
    reference: str
    band_hz: tuple[float, float] | None
    spreading_db: float

    @property
    def height_m(self) -> float:
        """Difference of the depths of sensor and source; 0 when unknown."""
        if self.sensor.depth_m is None:
            return 0.0
        return abs(self.sensor.depth_m - self.source_depth_m)


@dataclass
class Row:
    """One encounter while it is being filled in."""

    contact: int
    status: str
    values: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(VALUES, float("nan"))
    )
    covariance: FloatArray = field(default_factory=lambda: np.full((4, 4), np.nan))
    side: str = ""
    extrapolated: bool = False
    ambiguities: list[dict[str, float | str]] = field(default_factory=list)
    reasons: dict[str, str] = field(default_factory=dict)
    rest: list[tuple[int, float, float]] = field(default_factory=list)

    def explain(self, reason: str, *names: str) -> None:
        """State why values are missing, unless they are there or explained."""
        for name in names:
            if name in VALUES and np.isfinite(self.values[name]):
                continue
            self.reasons.setdefault(name, reason)


def passage_row(
    contact: int, fit: PassageFit, setting: Setting, line_ids: IntArray
) -> Row:
    """Fill a row from the fit of a passage.

    Parameters
    ----------
    contact
        Contact number.
    fit
        Fit of one data set.
    setting
        Sensor and medium.
    line_ids
        Identifiers of the lines in the order of the fit's rows.
    """
    row = Row(contact, OK)
    variance = np.diag(fit.covariance[0])
    width, speed = float(fit.range_over_speed_s[0]), float(fit.theta[0, 2])
    row.covariance = fit.covariance[0].copy()
    row.values["time_s"] = float(fit.theta[0, 0])
    row.values["time_std_s"] = float(np.sqrt(variance[0]))
    row.values["range_over_speed_s"] = width
    row.values["range_over_speed_std_s"] = float(np.sqrt(variance[1]))
    _add_speed(row, fit, setting, line_ids)
    delay = width * speed / setting.sound_speed_mps
    row.values["arrival_time_s"] = row.values["time_s"] + delay
    _add_direction(row, fit, setting)
    if not (np.isfinite(row.values["speed_mps"]) or row.side):
        _add_law(row)
    return row


def _add_law(row: Row) -> None:
    """Widen d/v from levels alone by what an unknown law of spreading can do to it."""
    width = row.values["range_over_speed_s"]
    row.covariance[1, 1] += (LAW_SHARE * width) ** 2
    row.values["range_over_speed_std_s"] = float(np.sqrt(row.covariance[1, 1]))


def _add_speed(row: Row, fit: PassageFit, setting: Setting, line_ids: IntArray) -> None:
    keys = ("speed_mps", "slant_range_m", "horizontal_range_m", "source_level_db")
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
    for line, rest, std in zip(
        line_ids, fit.rest_hz[0], fit.rest_std_hz[0], strict=True
    ):
        if np.isfinite(std):
            row.rest.append((int(line), float(rest), float(std)))
    gradient = np.array([speed, width])
    range_std = float(np.sqrt(gradient @ covariance[1:3, 1:3] @ gradient))
    slant = width * speed
    if range_std > LARGEST_RELATIVE_DEVIATION * slant:
        row.explain("its deviation is more than half its value", *keys[1:])
        return
    row.values["slant_range_m"], row.values["slant_range_std_m"] = slant, range_std
    if setting.sensor.depth_m is None:
        row.explain("the depth of the sensor is not known", "horizontal_range_m")
        return
    flat = float(horizontal_range_m(slant, setting.height_m))
    row.values["horizontal_range_m"] = flat
    row.explain("the slant range is shorter than the depths allow", keys[2])


def _forget_speed(row: Row, reason: str, *keys: str) -> None:
    row.covariance[2, :] = row.covariance[:, 2] = np.nan
    row.explain(reason, "rest_frequencies_hz", *keys)


def _add_direction(row: Row, fit: PassageFit, setting: Setting) -> None:
    keys = ("bearing_deg", "course_deg", "side")
    variance = float(fit.covariance[0, 3, 3]) + setting.sensor.compass_std_deg**2
    row.covariance[3, 3] = variance
    if not np.isfinite(variance):
        row.explain("no bearing channel", *keys)
        return
    if np.sqrt(variance) > 60.0:
        row.covariance[3, :] = row.covariance[:, 3] = np.nan
        row.explain("the bearings do not stand out from their noise", *keys)
        return
    turn = int(fit.turn[0])
    bearing = float(fit.bearing_deg[0])
    row.values["bearing_deg"] = bearing
    row.values["course_deg"] = float(course_deg(bearing, turn))
    row.values["bearing_std_deg"] = row.values["course_std_deg"] = float(
        np.sqrt(variance)
    )
    row.side = side_of_vessel(turn)


def empty_row(contact: int, reason: str) -> Row:
    """Return a row for what moves but has no closest approach to give.

    Parameters
    ----------
    contact
        Contact number.
    reason
        Why there is none.
    """
    row = Row(contact, NOT_A_PASSAGE)
    row.explain(reason, *VALUES, "side", "rest_frequencies_hz")
    return row


def make_encounters(rows: list[Row], setting: Setting) -> Encounters:
    """Gather the rows into the container.

    Parameters
    ----------
    rows
        Filled rows.
    setting
        Sensor and medium.
    """
    start = setting.start_utc_ns
    times = np.array([row.values["time_s"] for row in rows])
    utc = [
        -1 if start is None or not np.isfinite(time)
        else start + round(float(time) * NANOSECONDS)
        for time in times
    ]  # fmt: skip
    rest = [(n, *item) for n, row in enumerate(rows) for item in row.rest]
    table = np.array(rest, float).reshape(len(rest), 4)
    low, high = setting.band_hz or (None, None)
    columns = {
        name: np.array([row.values[name] for row in rows], float) for name in VALUES
    }
    return Encounters(
        **columns,
        contact=np.array([row.contact for row in rows], np.int64),
        sensor=np.array([setting.sensor.id] * len(rows), dtype=np.str_),
        status=np.array([row.status for row in rows], dtype=np.str_),
        time_utc_ns=np.array(utc, np.int64),
        side=np.array([row.side for row in rows], dtype=np.str_),
        sound_speed_mps=np.full(len(rows), setting.sound_speed_mps),
        extrapolated=np.array([row.extrapolated for row in rows], np.bool_),
        covariance=np.array([row.covariance for row in rows]).reshape(-1, 4, 4),
        ambiguities=np.array([json.dumps(r.ambiguities) for r in rows], np.str_),
        reasons=np.array([json.dumps(r.reasons) for r in rows], np.str_),
        rest_encounter=table[:, 0].astype(np.int64),
        rest_line_id=table[:, 1].astype(np.int64),
        rest_frequency_hz=table[:, 2],
        rest_frequency_std_hz=table[:, 3],
        reference=setting.reference,
        band_low_hz=low,
        band_high_hz=high,
        spreading_db=setting.spreading_db,
    )
