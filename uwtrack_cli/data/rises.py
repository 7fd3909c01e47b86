"""Rises: where sound is stronger for seconds than before and after."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import Container, FloatArray, TextArray, column, scalar

LEVEL = "level"
"""A rise of the broadband level."""

LINES = "lines"
"""A rise of what stands above the noise in narrow cells, and keeps its frequency."""

FALL = "fall"
"""The same, where all frequencies fall together as those of a passage do."""

CLIMB = "climb"
"""The same, where they climb: calls do, and nothing that passes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rises(Container):
    """One row for each rise of a length, in the order in which they were found."""

    NAME: ClassVar[str] = "rises"
    STREAMS: ClassVar[bool] = True

    time_s: FloatArray = column("s", "Middle, from the first sample.", "rise")
    half_length_s: FloatArray = column("s", "Half of its length.", "rise")
    kind: TextArray = column(
        "",
        "What rises: 'level'; or 'lines' that keep their frequencies, 'fall' or 'climb'.",
        "rise",
        dtype=np.str_,
    )
    spreads: FloatArray = column(
        "1", "Height in spreads of what the recording does all the time.", "rise"
    )
    least_spreads: float = scalar("1", "Height from which a rise is told.")
    sensor: str = scalar("", "Identifier of the sensor.")
