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

    contact: IntArray = column(
        "1", "Contact of its lines, from 1; 0 for none.", "stretch", dtype=np.int64
    )
    encounter: IntArray = column(
        "1", "Contact of the closest approach within it; 0 for none.", "stretch",
        dtype=np.int64,
    )  # fmt: skip
    sensor: TextArray = column("", "Identifier of the sensor.", "stretch", dtype="U")
    kind: TextArray = column(
        "", "'vessel', 'rates', 'lines', 'hum', 'broadband', 'rain' or 'unknown'.",
        "stretch", dtype="U",
    )  # fmt: skip
    from_s: FloatArray = column("s", "Begin, from the first sample.", "stretch")
    to_s: FloatArray = column("s", "End, from the first sample.", "stretch")
    from_utc_ns: IntArray = column(
        "ns", "Begin since 1970-01-01 UTC; -1 if the start is unknown.", "stretch",
        dtype=np.int64,
    )  # fmt: skip
    to_utc_ns: IntArray = column(
        "ns", "End since 1970-01-01 UTC; -1 if the start is unknown.", "stretch",
        dtype=np.int64,
    )  # fmt: skip
    spacing_hz: FloatArray = column(
        "Hz", "Distance of the lines of a family: its shaft rate, or a part of it.",
        "stretch",
    )  # fmt: skip
    spacing_std_hz: FloatArray = deviation("Hz", "stretch")
    blade_rate_hz: FloatArray = column(
        "Hz", "Multiple of the spacing, or of the lowest rate, that stands out.",
        "stretch",
    )  # fmt: skip
    n_lines: IntArray = column("1", "Lines of the sound.", "stretch", dtype=np.int64)
    level_db: FloatArray = column(
        "dB", "Level of all its lines, or greatest broadband level (re the reference).",
        "stretch",
    )  # fmt: skip
    bearing_deg: FloatArray = column(
        "degree", "Mean compass bearing; nan if unknown.", "stretch"
    )
    bearing_std_deg: FloatArray = column(
        "degree", "Spread of its lines' bearings.", "stretch"
    )
    probability_of_chance: FloatArray = column(
        "1", "Probability that noise alone gives as much.", "stretch"
    )
    reading: TextArray | None = column(
        "", "What its contacts are read as: that of its closest approach; else 'constant', "
        "'machinery' or 'joined' where nothing passes, or a passage that noise alone gives, "
        "too; empty if they are not read as one.", "stretch", dtype=np.str_, optional=True,
    )  # fmt: skip
    reading_weight: FloatArray | None = column(
        "1", "Probability of that reading, of the least certain contact.", "stretch",
        optional=True,
    )  # fmt: skip
    rival: TextArray | None = column(
        "", "Next reading of that contact; empty if it has less than 5 %.", "stretch",
        dtype=np.str_, optional=True,
    )  # fmt: skip
    rival_weight: FloatArray | None = column(
        "1", "Its probability; 0 without one.", "stretch", optional=True
    )
    frequency_stretch: IntArray = column(
        "1", "Row of the stretch that a line belongs to.", "frequency",
        dtype=np.int64, owner="stretch",
    )  # fmt: skip
    frequency_hz: FloatArray = column("Hz", "Mean frequency of a line.", "frequency")
    rate_stretch: IntArray = column(
        "1", "Row of the stretch that a modulation rate belongs to.", "rate",
        dtype=np.int64, owner="stretch",
    )  # fmt: skip
    rate_hz: FloatArray = column("Hz", "Modulation rate.", "rate")
    reason_stretch: IntArray = column(
        "1", "Row of the stretch that a reason belongs to.", "reason",
        dtype=np.int64, owner="stretch",
    )  # fmt: skip
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")

    def of_sensor(self, sensor: str) -> Self:
        """Return the stretches of one sensor."""
        return self.take("stretch", np.flatnonzero(self.sensor == sensor))
