"""Directions that an array heard, and the delays between its hydrophones."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import (
    Container,
    FloatArray,
    IntArray,
    TextArray,
    column,
    deviation,
    scalar,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Directions(Container):
    """One row per direction from which broadband sound came, in the order of time.

    Several sources of one frame are rows of the same time, the strongest first.
    What an array of a given shape cannot tell apart is on the axis ``lobe``: for every
    direction the others that would explain the sound, with their weights.
    """

    NAME: ClassVar[str] = "directions"
    STREAMS: ClassVar[bool] = True
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("coordinate", "coordinate_too")

    frame: IntArray = column(
        "1", "Index of the frame in the recording.", "direction", dtype=np.int64
    )
    time_s: FloatArray = column(
        "s", "Centre of the frame, from the first sample.", "direction"
    )
    bearing_deg: FloatArray = column(
        "degree", "Compass bearing; nan without heading.", "direction"
    )
    bearing_std_deg: FloatArray = deviation("degree", "direction")
    elevation_deg: FloatArray = column(
        "degree", "Angle above the horizontal; a level plane has no sign.", "direction"
    )
    elevation_std_deg: FloatArray = deviation("degree", "direction")
    slowness_ratio: FloatArray = column(
        "1", "Slowness as heard times the sound speed: of a level plane that along the "
        "ground; of a volume array 1.", "direction",
    )  # fmt: skip
    slowness_ratio_std: FloatArray = column(
        "1", "Its standard deviation; nan for a volume array.", "direction"
    )
    snr_db: FloatArray = column(
        "dB", "Power over noise in the beam, mean over the band; nan for delays.",
        "direction",
    )  # fmt: skip
    level_db: FloatArray = column(
        "dB", "Level from the direction in the band; nan for delays.", "direction"
    )
    range_m: FloatArray = column(
        "m", "Horizontal range of a source near the surface, from elevation and depth; "
        "nan if they do not tell.", "direction",
    )  # fmt: skip
    range_std_m: FloatArray = deviation("m", "direction")
    east_m: FloatArray | None = column(
        "m", "Where that source is, east on the grid of the array at rest, or east of it "
        "where it has latitude and longitude; nan without range.", "direction",
        optional=True,
    )  # fmt: skip
    north_m: FloatArray | None = column(
        "m", "The same to the north.", "direction", optional=True
    )
    covariance_m2: FloatArray | None = column(
        "m^2", "Covariance of east and north.", "direction", "coordinate",
        "coordinate_too", optional=True,
    )  # fmt: skip
    latitude: FloatArray | None = column(
        "degree", "Its latitude; nan if the array has none.", "direction", optional=True
    )
    longitude: FloatArray | None = column(
        "degree", "Its longitude.", "direction", optional=True
    )
    source: IntArray | None = column(
        "1", "Number of the source in its frame, 1 the strongest; None: all are.",
        "direction", dtype=np.int64, optional=True,
    )  # fmt: skip
    lobe_source: IntArray | None = column(
        "1", "Number of the source that may be in that direction; None: 1.", "lobe",
        dtype=np.int64, optional=True,
    )  # fmt: skip
    lobe_frame: IntArray = column(
        "1", "Frame whose direction may be another.", "lobe", dtype=np.int64
    )
    lobe_bearing_deg: FloatArray = column("degree", "Compass bearing.", "lobe")
    lobe_elevation_deg: FloatArray = column("degree", "Elevation.", "lobe")
    lobe_weight: FloatArray = column(
        "1", "Probability of that direction among those of the source.", "lobe"
    )
    false_alarm_probability: float = scalar(
        "1", "Nominal share of frames of noise with a direction; nan for delays."
    )
    band_low_hz: float = scalar("Hz", "Lower edge of the band; nan for delays.")
    band_high_hz: float = scalar("Hz", "Upper edge of the band; nan for delays.")
    method: str = scalar("", "'beams' or 'delays'.")
    ambiguity: str = scalar(
        "", "'none', 'elevation' (its sign is open) or 'plane' (both sides of it)."
    )
    reference: str = scalar("", "Level reference: '1 uPa' or 'full scale'.")
    sensor: str = scalar("", "Identifier of the sensor.")
    start_utc_ns: int | None = scalar("ns", "UTC epoch of time zero.", None)

    def strongest(self) -> "Directions":
        """Return the strongest direction of every frame alone."""
        if self.source is None:
            return self
        return self.take("direction", np.flatnonzero(self.source == 1))


@dataclass(frozen=True, eq=False, kw_only=True)
class Delays(Container):
    """One row per pair of hydrophones and frame: how much later the second hears."""

    NAME: ClassVar[str] = "delays"
    STREAMS: ClassVar[bool] = True

    time_s: FloatArray = column("s", "Centre of the frame.", "delay")
    channel_a: TextArray = column("", "First channel.", "delay", dtype=np.str_)
    channel_b: TextArray = column("", "Second channel.", "delay", dtype=np.str_)
    delay_s: FloatArray = column(
        "s", "Arrival at the second less arrival at the first.", "delay"
    )
    delay_std_s: FloatArray = deviation("s", "delay")
    coherence: FloatArray | None = column(
        "1", "Coherence (not squared) of the pair in the band; None in tables.",
        "delay", optional=True,
    )  # fmt: skip
    sensor: str | None = scalar(
        "", "Identifier of the sensor; None if not known.", None
    )
    start_utc_ns: int | None = scalar("ns", "UTC epoch of time zero.", None)
