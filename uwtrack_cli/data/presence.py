"""What was heard, and when: stretches of sound of one kind each."""

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
"""Kinds of stretches, what tells most of a vessel first."""

OF_VESSELS = frozenset({VESSEL, RATES, LINES, BROADBAND})
"""Kinds that may be a vessel: where one is heard, "no vessel" is not said."""

CONSTANT, MACHINERY, JOINED = "constant", "machinery", "joined"

STILL = (CONSTANT, MACHINERY, JOINED)
"""Readings in which nothing passes."""

READINGS = (
    "straight", "frequency-step", "frequency-ramp", "manoeuvre", "two-targets", *STILL,
)  # fmt: skip
"""How the measurements of a contact may be read."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Presence(HasReasons):
    """One row per stretch in which something was heard, in the order of time.

    Kinds: 'vessel' (a harmonic family, lines that move together, or a passage),
    'rates' (shaft and blades in the envelope alone), 'lines' (no family), 'hum' (mains),
    'broadband' (a rise of the level with the shape of a passage), 'rain' (a rise above
    the middle of the band alone) and 'unknown'. Why a stretch is no closest approach
    stands under the reason's key ``encounter``.
    """

    NAME: ClassVar[str] = "presence"
    ROW: ClassVar[str] = "stretch"
    OBJECTS: ClassVar[dict[str, str]] = {
        "alternative_motion_model": (
            "Next motion model with its probability; null if none has 5 %."
        ),
    }

    contact: IntArray = column("Contact of its lines, from 1; 0 for none.", unknown=0)
    encounter: IntArray = column(
        "Contact of the closest approach within it; 0 for none.", unknown=0
    )
    sensor: TextArray = column("Identifier of the sensor.")
    kind: TextArray = column(
        "'vessel', 'rates', 'lines', 'hum', 'broadband', 'rain' or 'unknown'.",
        choices=KINDS,
    )  # fmt: skip
    from_s: FloatArray = column("Begin, from the first sample.")
    to_s: FloatArray = column("End, from the first sample.")
    from_utc_ns: IntArray = column(
        "Begin since 1970-01-01 UTC; -1 if the start is unknown."
    )
    to_utc_ns: IntArray = column(
        "End since 1970-01-01 UTC; -1 if the start is unknown."
    )
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
    probability_of_chance: FloatArray = column(
        "Probability that noise alone gives as much."
    )
    reading: TextArray | None = column(
        "Motion model of its contacts: that of its closest approach; else 'constant', "
        "'machinery' or 'joined' where nothing passes, or a passage that noise alone "
        "gives, too; empty if they have none in common.", unknown="", choices=READINGS,
        key="motion_model",
    )  # fmt: skip
    reading_weight: FloatArray | None = column(
        "Probability of that motion model, of the least certain contact.",
        key="motion_model_probability",
    )
    rival: TextArray | None = column(
        "Next motion model of that contact; empty if it has less than 5 %.",
        key="alternative_motion_model.motion_model",
    )  # fmt: skip
    rival_weight: FloatArray | None = column(
        "Its probability; 0 without one.", key="alternative_motion_model.probability"
    )
    frequency_stretch: IntArray = column(
        "Row of the stretch that a line belongs to.", "frequency", owner="stretch"
    )
    frequency_hz: FloatArray = column(
        "Mean frequency of a line.", "frequency", key="frequencies_hz"
    )
    rate_stretch: IntArray = column(
        "Row of the stretch that a modulation rate belongs to.", "rate", owner="stretch"
    )
    rate_hz: FloatArray = column("Modulation rate.", "rate", key="rates_hz")
    reason_stretch: IntArray = column(
        "Row of the stretch that a reason belongs to.", "reason", owner="stretch"
    )
    reference: str = scalar(
        "Level reference: '1 uPa' or 'full scale'.", key="level_reference"
    )

    def of_sensor(self, sensor: str) -> Self:
        """Return the stretches of one sensor."""
        return self.take("stretch", np.flatnonzero(self.sensor == sensor))
