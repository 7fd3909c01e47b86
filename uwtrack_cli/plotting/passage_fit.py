"""What a fitted passage says at any time, with deviations, for the panels of its page.

**Method.** The law of a passage at the values of the encounter, with what changed
beside it; deviations follow from the covariance of its motion to first order. The speed that counts is that relative to the
sensor: slant range over (slant range over speed), which is the vessel's own where the
sensor is at rest.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.files.tables.json_rows import Row, json_rows
from uwtrack_cli.motion.passage.model import unknowns
from uwtrack_cli.motion.passage.model.law import Passage
from uwtrack_cli.plotting.style import Span
from uwtrack_cli.plotting.view import Scene, View

REACH = 4.0
"""d/v on either side of the closest approach that are shown."""


FEWEST_FRAMES, FEWEST_AT_HAND = 12, 3
"""Frames of its lines that are shown on either side at least, and where the sound is at
hand and is resolved finer."""

TURN = {"starboard": 1.0, "port": -1.0}
"""Sense in which the bearing turns, by the side of the vessel where the sensor is."""


@dataclass(frozen=True, eq=False)
class ReportedPassage:
    """One closest approach, and the law that was fitted to it."""

    encounters: Encounters
    """Closest approaches."""
    row: int
    """Which one."""

    @cached_property
    def printed(self) -> Row:
        """Its row, as it is printed."""
        return json_rows(self.encounters)[self.row]

    @property
    def contact(self) -> int:
        """Number of its contact."""
        return int(self.encounters.contact[self.row])

    @property
    def number(self) -> int:
        """Number of the passage, by time from 1, as in pictures and tables."""
        return self.row + 1

    @property
    def time_s(self) -> float:
        """Closest approach, s from the first sample; its arrival if that is all."""
        known = float(self.encounters.time_s[self.row])
        return known if np.isfinite(known) else self.arrival_s

    @property
    def arrival_s(self) -> float:
        """Arrival of the sound of the closest approach, s."""
        return float(self.encounters.arrival_time_s[self.row])

    @property
    def width_s(self) -> float:
        """Slant range over speed, s; nan if unknown."""
        return float(self.encounters.range_over_speed_s[self.row])

    @property
    def speed_mps(self) -> float:
        """Speed relative to the sensor, m/s; nan if unknown."""
        return float(self.encounters.slant_range_m[self.row]) / self.width_s

    @property
    def mach(self) -> float:
        """Speed over sound speed; 0 if unknown."""
        speed = self.speed_mps if np.isfinite(self.speed_mps) else 0.0
        return speed / float(self.encounters.sound_speed_mps[self.row])

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
    def marked_s(self) -> float:
        """When pictures mark it: the arrival of its sound, s; nan if unknown."""
        return self.arrival_s if np.isfinite(self.arrival_s) else self.time_s

    def shift(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the relative Doppler shift and its deviation."""
        law = self._law(time_s, self.width_s)
        return law.shift[0], self._std(law.shift_d[0][:, :3], self.width_s)

    def spread_db(self, time_s: FloatArray) -> FloatArray:
        """Return the level less that at closest approach, dB."""
        return np.asarray(10 / np.log(10) * self._law(time_s, self.width_s).spread[0])

    def bearing(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return compass bearing and deviation, degrees; None where it is not known."""
        turn = TURN.get(str(self.encounters.side[self.row]))
        middle = float(self.encounters.bearing_deg[self.row])
        if turn is None or not np.isfinite(middle) or not self.is_drawn:
            return None
        width = self.encounters.horizontal_range_over_speed_s
        width_s = self.width_s if width is None else float(width[self.row])
        width_s = width_s if np.isfinite(width_s) and width_s > 0 else self.width_s
        law = self._law(time_s, width_s)
        partials = np.degrees(turn * law.angle_d[0][:, :3])
        columns = np.column_stack([partials, np.ones(time_s.size)])
        return middle + turn * np.degrees(law.angle[0]), self._std(columns, width_s)

    def _law(self, time_s: FloatArray, width_s: float) -> Passage:
        """Return the law with what changed beside it; nan where that is not known."""

        def known(name: str) -> float:
            values = getattr(self.encounters, name)
            return float("nan") if values is None else float(values[self.row])

        sound, at_s = known("sound_speed_mps"), known("change_time_s")
        theta = [self.time_s, np.log(width_s), self.mach * sound, 0.0, 0.0]
        turn = TURN.get(str(self.encounters.side[self.row]), float("nan"))
        angle = np.radians(known("other_leg_course_deg") - known("course_deg"))
        along, away = known("other_leg_speed_mps") * np.array(
            [np.cos(angle), -turn * np.sin(angle)]
        )
        sizes = {
            unknowns.STEP: [known("frequency_change")],
            unknowns.RAMP: [known("frequency_slope_per_s"), 0.0],
            unknowns.TURN: [
                np.radians(known("turn_away_deg")), known("turn_duration_s"), 0.0
            ],
            unknowns.MANOEUVRE: [along - theta[2], away],
        }  # fmt: skip
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
        covariance = self.encounters.covariance[self.row][:count, :count].copy()
        unknown = ~np.isfinite(np.diag(covariance))
        covariance[unknown, :] = covariance[:, unknown] = 0.0
        scale = np.ones(count)
        scale[1] = 1.0 / width_s
        along = partials * scale
        return np.asarray(np.sqrt(np.maximum(
            np.einsum("ni,ij,nj->n", along, covariance, along), 0.0
        )))  # fmt: skip


def shown_span(scene: Scene, fit: ReportedPassage, view: View) -> Span:
    """Return begin and end of what the page of a passage shows, s.

    Raises
    ------
    DataError
        The sound is asked for outside of the recording.
    """
    known = scene.times_s or (-np.inf, np.inf)
    middle, reach, lines = fit.marked_s, REACH * fit.width_s, scene.first(Lines)
    if lines is not None:
        longest_s = lines.point_window_s.max(initial=lines.frames.window_s)
        recording = scene.first(Recording)
        is_at_hand = recording is not None and recording.reader is not None
        count = FEWEST_AT_HAND if is_at_hand else FEWEST_FRAMES
        reach = np.fmax(reach, count * longest_s / lines.overlap_frames)
    low, high = max(known[0], middle - reach), min(known[1], middle + reach)
    return view.span_s((low, high) if low < high else known, scene.clock)
