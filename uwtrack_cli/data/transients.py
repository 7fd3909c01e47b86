"""Transients: where sound is stronger for seconds than before and after."""

from dataclasses import dataclass
from typing import ClassVar

from uwtrack_cli.data.base import Container, FloatArray, TextArray, column, scalar

LEVEL = "level"
"""A transient of the broadband level."""

LINES = "lines"
"""A transient of what stands above the noise in narrow cells, and keeps its frequency."""

FALL = "fall"
"""The same, where all frequencies fall together as those of a passage do."""

CLIMB = "climb"
"""The same, where they climb: calls do, and nothing that passes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Transients(Container):
    """One row for each transient of a length, in the order in which they were found."""

    NAME: ClassVar[str] = "transients"
    ROW: ClassVar[str] = "transient"
    STREAMS: ClassVar[bool] = True

    time_s: FloatArray = column("Middle, from the first sample.")
    half_length_s: FloatArray = column("Half of its length.")
    kind: TextArray = column(
        "What rises: 'level'; or 'lines' that keep their frequencies, 'fall' or 'climb'."
    )
    spreads: FloatArray = column("Height in spreads of what the recording does all the time.")
    least_spreads: float = scalar("Height from which a transient is reported.")
    sensor: str = scalar("Identifier of the sensor.")
