"""Directions that an array heard, and the delays between its hydrophones."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import (
    Cells,
    Container,
    FloatArray,
    IntArray,
    TextArray,
    column,
    deviation,
    scalar,
)

LINE = "line"
"""Ambiguity of a line array: the other side of it fits as well."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Directions(Container):
    """One row per direction from which broadband sound came, in the order of time.

    Several sources of one frame are rows of the same time, the strongest first.
    What an array of a given shape cannot tell apart is on the axis ``lobe``: for every
    direction the others that would explain the sound, with their weights.
    """

    NAME: ClassVar[str] = "directions"
    ROW: ClassVar[str] = "direction"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("coordinate", "coordinate_too")

    frame: IntArray = column("Index of the frame in the recording.")
    time_s: FloatArray = column("Centre of the frame, from the first sample.")
    bearing_deg: FloatArray = column("Compass bearing; nan without heading.")
    bearing_std_deg: FloatArray = deviation()
    elevation_deg: FloatArray = column(
        "Angle above the horizontal; a level plane has no sign, and a line none at all: "
        "its bearing is that of a source level with it."
    )
    elevation_std_deg: FloatArray = deviation()
    slowness_ratio: FloatArray = column(
        "Slowness as measured times the sound speed: of a level plane that along the "
        "ground, of a line that along it; of a volume array 1."
    )
    slowness_ratio_std: FloatArray = column("Its standard deviation; nan for a volume array.")
    snr_db: FloatArray = column("Power over noise in the beam, mean over the band; nan for delays.")
    level_db: FloatArray = column("Level from the direction in the band; nan for delays.")
    range_m: FloatArray = column(
        "Horizontal range of a source near the surface, from elevation and depth; nan "
        "if they do not determine it."
    )
    range_std_m: FloatArray = deviation()
    east_m: FloatArray | None = column(
        "Where that source is, east on the grid of the array at rest, or east of it "
        "where it has latitude and longitude; nan without range."
    )
    north_m: FloatArray | None = column("The same to the north.")
    covariance_m2: FloatArray | None = column(
        "Covariance of east and north.", "direction", "coordinate", "coordinate_too"
    )
    latitude: FloatArray | None = column("Its latitude; nan if the array has none.")
    longitude: FloatArray | None = column("Its longitude.")
    source: IntArray | None = column(
        "Number of the source in its frame, 1 the strongest; None: all are."
    )
    lobe_source: IntArray | None = column(
        "Number of the source that may be in that direction; None: 1.", "lobe"
    )
    lobe_frame: IntArray = column("Frame whose direction may be another.", "lobe")
    lobe_bearing_deg: FloatArray = column("Compass bearing.", "lobe")
    lobe_elevation_deg: FloatArray = column("Elevation.", "lobe")
    lobe_weight: FloatArray = column(
        "Probability of that direction among those of the source.", "lobe"
    )
    false_alarm_probability: float = scalar(
        "Nominal share of frames of noise with a direction; nan for delays."
    )
    band_low_hz: float = scalar("Lower edge of the band; nan for delays.")
    band_high_hz: float = scalar("Upper edge of the band; nan for delays.")
    method: str = scalar("'beams' or 'delays'.")
    ambiguity: str = scalar(
        "'none', 'elevation' (its sign is open), 'plane' (both sides of it) or 'line' "
        "(bearings to starboard; those to port are its lobes)."
    )
    reference: str = scalar("Level reference: '1 uPa' or 'full scale'.")
    sensor: str = scalar("Identifier of the sensor.")
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)

    def strongest(self) -> "Directions":
        """Return the strongest direction of every frame alone."""
        if self.source is None:
            return self
        return self.take("direction", np.flatnonzero(self.source == 1))


@dataclass(frozen=True, eq=False, kw_only=True)
class Delays(Container):
    """One row per pair of hydrophones and frame: how much later the second hears."""

    NAME: ClassVar[str] = "delays"
    ROW: ClassVar[str] = "delay"
    STREAMS: ClassVar[bool] = True

    time_s: FloatArray = column("Centre of the frame.")
    channel_a: TextArray = column("First channel.", cells=Cells(needed=True))
    channel_b: TextArray = column("Second channel.", cells=Cells(needed=True))
    delay_s: FloatArray = column(
        "Arrival at the second less arrival at the first.",
        cells=Cells(-1e6, 1e6, needed=True, every=True),
    )
    delay_std_s: FloatArray = deviation(cells=Cells(1e-12, 1e6, needed=True, every=True))
    coherence: FloatArray | None = column(
        "Coherence (not squared) of the pair in the band; None where it is not given.",
        cells=Cells(0.0, 1.0, every=True),
    )
    clock_std_s: FloatArray | None = column(
        "Standard deviation of the difference of the clocks of two recorders, the same "
        "error in all frames; nan where it is not given; None: one recorder.",
        cells=Cells(0.0, 1e6),
    )
    sensor: str | None = scalar("Identifier of the sensor; None if not known.", None)
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)
