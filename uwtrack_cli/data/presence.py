"""What was detected, and when: segments of sound of one kind each."""

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from uwtrack_cli.data.base import (
    FloatArray,
    HasReasons,
    IntArray,
    TextArray,
    column,
    deviation,
    scalar,
)

VESSEL, RATES, LINES, HUM, BROADBAND, RAIN, UNKNOWN = (
    "vessel", "rates", "lines", "hum", "broadband", "rain", "unknown",
)  # fmt: skip

KINDS = (VESSEL, RATES, LINES, HUM, BROADBAND, RAIN, UNKNOWN)
"""Kinds of segments, most likely a vessel first."""

OF_VESSELS = frozenset({VESSEL, RATES, LINES, BROADBAND})
"""Kinds that may be a vessel: where one is detected, "no vessel" is not reported."""

CONSTANT, MACHINERY, JOINED = "constant", "machinery", "joined"

STILL = (CONSTANT, MACHINERY, JOINED)
"""Readings in which nothing passes."""

READINGS = ("straight", "frequency-step", "frequency-ramp", "manoeuvre", "two-targets", *STILL)
"""How the measurements of a contact may be read."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Presence(HasReasons):
    """One row per segment in which something was detected, in the order of time.

    Kinds: 'vessel' (a harmonic family, lines that move together, or a passage),
    'rates' (shaft and blades in the envelope alone), 'lines' (no family), 'hum' (mains),
    'broadband' (a rise of the level with the shape of a passage), 'rain' (a rise above
    the middle of the band alone) and 'unknown'. Why a segment is no closest approach
    stands under the reason's key ``encounter``.
    """

    NAME: ClassVar[str] = "presence"
    ROW: ClassVar[str] = "segment"
    OBJECTS: ClassVar[dict[str, str]] = {
        "alternative_motion_model": (
            "Next motion model with its probability; null if none has 5 %."
        )
    }

    contact: IntArray = column("Contact of its lines, from 1; 0 for none.", unknown=0)
    encounter: IntArray = column(
        "Contact of the closest approach within it; 0 for none.", unknown=0
    )
    sensor: TextArray = column("Identifier of the sensor.")
    kind: TextArray = column(
        "'vessel', 'rates', 'lines', 'hum', 'broadband', 'rain' or 'unknown'.", choices=KINDS
    )
    from_s: FloatArray = column("Begin, from the first sample.")
    to_s: FloatArray = column("End, from the first sample.")
    from_utc_ns: IntArray = column("Begin since 1970-01-01 UTC; -1 if the start is unknown.")
    to_utc_ns: IntArray = column("End since 1970-01-01 UTC; -1 if the start is unknown.")
    spacing_hz: FloatArray = column(
        "Distance of the lines of a family: its shaft rate, or a part of it."
    )
    spacing_std_hz: FloatArray = deviation()
    blade_rate_hz: FloatArray = column(
        "Multiple of the spacing, or of the lowest rate, that stands out."
    )
    n_lines: IntArray = column("Lines of the sound.")
    level_db: FloatArray = column(
        "Level of all its lines, or greatest broadband level (re the reference)."
    )
    bearing_deg: FloatArray = column("Mean compass bearing; nan if unknown.")
    bearing_std_deg: FloatArray = column("Spread of its lines' bearings.")
    probability_of_chance: FloatArray = column("Probability that noise alone gives as much.")
    motion_model: TextArray | None = column(
        "Motion model of its contacts: that of its closest approach; else 'constant', "
        "'machinery' or 'joined' where nothing passes, or a passage that noise alone "
        "gives, too; empty if they have none in common.", unknown="", choices=READINGS,
       
    )  # fmt: skip
    motion_model_probability: FloatArray | None = column(
        "Probability of that motion model, of the least certain contact."
    )
    alternative_motion_model: TextArray | None = column(
        "Next motion model of that contact; empty if it has less than 5 %.",
        key="alternative_motion_model.motion_model",
    )
    alternative_motion_model_probability: FloatArray | None = column(
        "Its probability; 0 without one.", key="alternative_motion_model.probability"
    )
    frequency_segment: IntArray = column(
        "Row of the segment that a line belongs to.", "frequency", owner="segment"
    )
    frequency_hz: FloatArray = column(
        "Mean frequency of a line.", "frequency", key="frequencies_hz"
    )
    rate_segment: IntArray = column(
        "Row of the segment that a modulation rate belongs to.", "rate", owner="segment"
    )
    rate_hz: FloatArray = column("Modulation rate.", "rate", key="rates_hz")
    reason_segment: IntArray = column(
        "Row of the segment that a reason belongs to.", "reason", owner="segment"
    )
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.", key="level_reference")

    def of_sensor(self, sensor: str) -> Self:
        """Return the segments of one sensor."""
        return self.take("segment", np.flatnonzero(self.sensor == sensor))
