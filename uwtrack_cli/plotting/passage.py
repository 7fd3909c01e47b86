"""A passage that was found: its curves at any time, with deviations, and its words.

**Method.** The law of a passage at the values of the encounter, with what changed
beside it; deviations follow from the covariance of its motion to first order. The speed
that counts is that relative to the sensor: slant range over (slant range over speed),
which is the vessel's own where the sensor is at rest.
"""

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.files.tables.json_rows import Row, json_rows
from uwtrack_cli.files.tables.summaries import Head, numbered, utc_text
from uwtrack_cli.motion.passage.model import unknowns
from uwtrack_cli.motion.passage.model.law import Passage
from uwtrack_cli.plotting.style import Span
from uwtrack_cli.plotting.view import Scene, Units, View

REACH = 4.0
"""d/v on either side of the closest approach that are shown."""

FEWEST_FRAMES, FEWEST_AT_HAND = 12, 3
"""Frames of its lines that are shown on either side at least, and where the sound is at
hand and is resolved finer."""

TURN = {"starboard": 1.0, "port": -1.0}
"""Sense in which the bearing turns, by the side of the vessel where the sensor is."""

MARKED_MISFIT = 0.2
"""Misfit from which a page warns: half of what refuses a passage."""

UNIT = re.compile(r"_(m|mps|deg|s|hz|db)$")
"""Unit at the end of a column's name."""

LEAST_CHANCE = 0.005
"""Probability of another explanation below which it is not said."""

SURE = 0.9
"""Probability below which a passage is marked."""

OTHERWISE = {"not-significant": "", "outside": "it passes outside of the recording"}
"""Words for what else a passage may be, where its code does not say it."""

FACTS = (
    ("slant range", "slant_range_m", 1, "m"),
    ("horizontal range", "horizontal_range_m", 1, "m"),
    ("range/speed", "range_over_speed_s", 2, "s"),
    ("source depth", "source_depth_m", 1, "m"),
    ("course", "course_deg", 1, "deg"),
    ("bearing", "bearing_deg", 1, "deg"),
    ("received level", "received_level_db", 1, "dB re {}"),
    ("source level", "source_level_db", 1, "dB re {}"),
)
"""What stands beside the panels: name, key, decimals, unit."""


@dataclass(frozen=True, eq=False)
class ReportedPassage:
    """One closest approach, and the law that was fitted to it."""

    encounters: Encounters
    """Closest approaches of one sensor."""
    row: int
    """Which one."""

    @cached_property
    def printed(self) -> Row:
        """Its row, as it is printed, with the number of the passage."""
        return numbered(json_rows(self.encounters))[self.row]

    @property
    def number(self) -> int:
        """Number of the passage, by time from 1, as in pictures and tables."""
        return self.row + 1

    def value(self, name: str) -> float:
        """Return a value of the encounter; nan if it is not known."""
        column = getattr(self.encounters, name)
        return float("nan") if column is None else float(column[self.row])

    @property
    def contact(self) -> int:
        """Number of its contact."""
        return int(self.encounters.contact[self.row])

    @property
    def time_s(self) -> float:
        """Closest approach, s from the first sample; its arrival if that is all."""
        known = self.value("time_s")
        return known if np.isfinite(known) else self.value("arrival_time_s")

    @property
    def marked_s(self) -> float:
        """When pictures mark it: the arrival of its sound, s; nan if unknown."""
        arrival = self.value("arrival_time_s")
        return arrival if np.isfinite(arrival) else self.time_s

    @property
    def width_s(self) -> float:
        """Slant range over speed, s; nan if unknown."""
        return self.value("range_over_speed_s")

    @property
    def mach(self) -> float:
        """Speed relative to the sensor over sound speed; 0 if unknown."""
        speed = np.nan_to_num(self.value("slant_range_m") / self.width_s, posinf=0.0)
        return float(speed) / self.value("sound_speed_mps")

    @property
    def range_m(self) -> float:
        """Horizontal range at closest approach, else the slant range, m."""
        known = self.value("horizontal_range_m")
        return known if np.isfinite(known) else self.value("slant_range_m")

    @property
    def is_mapped(self) -> bool:
        """Whether the track past the sensor is known."""
        known = self.range_m, self.value("bearing_deg"), self.value("course_deg")
        return bool(np.isfinite(known).all())

    @property
    def rest_rows(self) -> IntArray:
        """Rows of its rest frequencies, those that are frequencies."""
        frequency = self.encounters.rest_frequency_hz
        known = (self.encounters.rest_encounter == self.row) & np.isfinite(frequency)
        return np.flatnonzero(known & (frequency > 0))

    @property
    def is_drawn(self) -> bool:
        """Whether enough is known for a curve."""
        return bool(np.isfinite([self.time_s, self.width_s]).all() and self.width_s > 0)

    @property
    def has_doppler(self) -> bool:
        """Whether enough is known for a curve of frequencies."""
        return self.is_drawn and self.mach > 0

    def shift(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the relative Doppler shift and its deviation."""
        law = self._law(time_s, self.width_s)
        return law.shift[0], self._std(law.shift_d[0][:, :3], self.width_s)

    @property
    def has_level(self) -> bool:
        """Whether enough is known for a curve of its level."""
        return self.is_drawn and bool(np.isfinite(self.value("received_level_db")))

    def power(self, time_s: FloatArray) -> FloatArray:
        """Return the received power: ten to its level over 10."""
        spread = np.exp(self._law(time_s, self.width_s).spread[0])
        return np.asarray(10 ** (self.value("received_level_db") / 10) * spread)

    def bearing(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return compass bearing and deviation, degrees; None where it is not known."""
        turn = TURN.get(str(self.encounters.side[self.row]))
        middle = self.value("bearing_deg")
        if turn is None or not np.isfinite(middle) or not self.is_drawn:
            return None
        width_s = self.value("horizontal_range_over_speed_s")
        width_s = width_s if np.isfinite(width_s) and width_s > 0 else self.width_s
        law = self._law(time_s, width_s)
        partials = np.degrees(turn * law.angle_d[0][:, :3])
        columns = np.column_stack([partials, np.ones(time_s.size)])
        return middle + turn * np.degrees(law.angle[0]), self._std(columns, width_s)

    def _law(self, time_s: FloatArray, width_s: float) -> Passage:
        """Return the law with what changed beside it; nan where that is not known."""
        known, sound = self.value, self.value("sound_speed_mps")
        theta = [self.time_s, np.log(width_s), self.mach * sound, 0.0, 0.0]
        turn = TURN.get(str(self.encounters.side[self.row]), float("nan"))
        angle = np.radians(known("other_leg_course_deg") - known("course_deg"))
        other = known("other_leg_speed_mps")
        sizes = {
            unknowns.STEP: [known("frequency_change")],
            unknowns.RAMP: [known("frequency_slope_per_s"), 0.0],
            unknowns.TURN: [np.radians(known("turn_away_deg")), known("turn_duration_s"), 0.0],
            unknowns.MANOEUVRE: [other * np.cos(angle) - theta[2], -other * turn * np.sin(angle)],
        }
        at_s = known("change_time_s")
        kind = next((k for k, v in sizes.items() if np.isfinite(v).all()), None)
        sign = 1.0 if known("change_follows") or kind == unknowns.STEP else -1.0
        if not np.isfinite(at_s) or kind is None:
            law = unknowns.law_of(np.array([theta]), time_s, Medium(sound))
            law.rows[..., sign * (time_s - at_s) > 0] = np.nan
            return law
        change = unknowns.Change(kind, np.array([at_s]), np.array([sign]))
        changed = np.array([[*theta, *sizes[kind]]])
        return unknowns.law_of(changed, time_s, Medium(sound), change)

    def _std(self, partials: FloatArray, width_s: float) -> FloatArray:
        """Return deviations from partials by time, ln(d/v), speed and more."""
        count = partials.shape[1]
        covariance = self.encounters.covariance[self.row][:count, :count]
        scale = np.ones(count)
        scale[1] = 1.0 / width_s
        along = partials * scale
        variance = (along @ np.nan_to_num(covariance, posinf=0.0) * along).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def span_s(self, scene: Scene, view: View) -> Span:
        """Return begin and end of what its page shows, s.

        Raises
        ------
        DataError
            The sound is asked for outside of the recording.
        """
        known = scene.times_s or (-np.inf, np.inf)
        reach, lines = REACH * self.width_s, scene.first(Lines)
        if lines is not None:
            longest_s = lines.point_window_s.max(initial=lines.frames.window_s)
            count = FEWEST_FRAMES if scene.sound is None else FEWEST_AT_HAND
            reach = np.fmax(reach, count * longest_s / lines.overlap_frames)
        low, high = (self.marked_s + side * reach for side in (-1.0, 1.0))
        low, high = max(known[0], low), min(known[1], high)
        return view.span_s((low, high) if low < high else known, scene.clock)


def passages_of(scene: Scene) -> list[ReportedPassage]:
    """Return the passages of a sensor, in the order of time."""
    found = scene.encounters
    count = 0 if found is None else found.n_encounters
    return [ReportedPassage(found, row) for row in range(count)]  # type: ignore[arg-type]


def passage_title(row: Row, units: Units) -> str:
    """Return when, how fast, how near and who, with deviations.

    ``row``: the passage, as `json_rows` gives it. ``units``: unit of the speed.
    """
    std = row["time_std_s"]
    if row["time_utc"]:
        digits = 0 if std is None or std >= 1.0 else 1
        parts = [f"{utc_text(row['time_utc'], digits)} UTC"]
    else:
        parts = [f"closest at {value_text(row, 'time_s', 1)} s"]
    parts.append(speed_text(row, units))
    if row["slant_range_m"] is not None:
        parts.append(f"{value_text(row, 'slant_range_m', 0)} m")
    elif row["range_over_speed_s"] is not None:
        parts.append(f"range/speed {value_text(row, 'range_over_speed_s', 1)} s")
    parts.append(row["vessel"]["name"] if row["vessel"] else "")
    return "   ".join(filter(None, parts))


def value_text(row: Row, key: str, digits: int) -> str:
    """Return a value with its deviation, for a column whose name ends in its unit."""
    stem, _, unit = key.rpartition("_")
    return Head("", key, digits, f"{stem}_std_{unit}").text(row)


def speed_text(row: Row, units: Units) -> str:
    """Return the speed with its deviation in a unit; empty where it is not known."""
    if row["speed_mps"] is None:
        return ""
    scale, keys = KNOT_MPS if units == "kn" else 1.0, ("speed_mps", "speed_std_mps")
    shown = {key: row[key] / scale for key in keys if row.get(key) is not None}
    return f"{value_text(shown, 'speed_mps', 1)} {units}"


def _otherwise(row: Row) -> str:
    """Return what else a passage is likeliest to be; empty for nothing that is known."""
    code = str(row.get("alternative") or "")
    return OTHERWISE.get(code, code.replace("-", " "))


def cautions(row: Row) -> list[str]:
    """Return what a reader of a passage must not overlook, a sentence each."""
    found = []
    chance = row.get("probability")
    if chance is not None and chance < SURE:
        other = f", else {text}" if (text := _otherwise(row)) else ""
        found.append(f"uncertain: it passes with a probability of {chance:.2f}{other}")
    if (row["misfit"] or 0.0) >= MARKED_MISFIT:
        found.append(
            f"the lines leave the fit by {100 * row['misfit']:.0f} % of the Doppler "
            f"shift beyond their noise"
        )
    if row["extrapolated"]:
        found.append("extrapolated: the closest approach was not recorded")
    return found


def fact_lines(row: Row, units: Units) -> list[tuple[str, str]]:
    """Return what is known of a passage, by name, as text with units.

    ``row``: the passage, as `json_rows` gives it. ``units``: unit of the speed.
    """
    found = [("speed", speed_text(row, units))]
    found += [
        (name, f"{value_text(row, key, digits)} {unit.format(row['level_reference'])}")
        for name, key, digits, unit in FACTS
        if row.get(key) is not None
    ]
    if row.get("probability") is not None:
        found.append(("probability", f"{row['probability']:.2f} that it passes"))
        chance, other = row.get("alternative_probability"), _otherwise(row)
        if other and (chance is None or chance >= LEAST_CHANCE):
            found.append(("else", other + ("" if chance is None else f", {chance:.2f}")))
    if row["misfit"] is not None:
        left = f"{100 * row['misfit']:.0f} % of the shift unexplained"
        follows = row["misfit"] < MARKED_MISFIT
        found.append(("lines", "follow the fit" if follows else left))
    rest = ", ".join(f"{f:.2f}" for f in sorted(filter(None, row["rest_frequencies_hz"])))
    found.append(("at rest", rest and f"{rest} Hz"))
    if row.get("motion_model") not in {None, "straight"}:  # as in the table
        weight = Head("", "motion_model_probability", 2).text(row)
        found.append(("motion", f"{row['motion_model']}, weight {weight}"))
    found.append(("sound speed", f"{row['sound_speed_mps']:g} m/s"))
    return [(name, text) for name, text in found if text]


def reasons_once(rows: Sequence[Row]) -> list[str]:
    """Return why values are not known: each reason once, with the passages it is of.

    ``rows``: passages, as `numbered` gives them, or motions.
    """
    known = defaultdict[tuple[str, str], list[str]](list)
    for row in rows:
        by_reason = defaultdict[str, list[str]](list)
        for key, reason in row["reasons"].items():
            if key not in {"vessel", "time_utc"}:
                by_reason[reason].append(UNIT.sub("", key).replace("_", " "))
        for reason, keys in by_reason.items():
            owner = str(row.get("passage", row["contact"]))
            known[(", ".join(sorted(keys)), reason)].append(owner)
    return [
        f"No {keys}: {reason}"
        + ("." if len(owners) == len(rows) else
           f" (passage{'s' * (len(owners) > 1)} {', '.join(owners)}).")
        for (keys, reason), owners in known.items()
    ]  # fmt: skip
