"""From the points of the line bank to the container that leaves the stage.

**Conventions.** Bearings leave as compass degrees in [0, 360); a bearing that was
never measured is nan, with its covariance.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray, TextArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.estimation.lines.line_bank import N_ROWS, Points
from uwtrack_cli.stages.lines.lasting_families import no_families

_BEARING_KNOWN_BELOW_DEG2 = 1e6


@dataclass(frozen=True)
class LineTable:
    """What is known of whole lines at the end of a recording."""

    line: IntArray
    contact: IntArray
    family: IntArray
    status: TextArray
    families: Families


def no_table() -> LineTable:
    """Return the table of a block before the end."""
    none = np.zeros(0, dtype=np.int64)
    return LineTable(none, none, none, np.zeros(0, dtype="U6"), no_families())


def join_points(parts: list[Points]) -> Points:
    """Put the points of several emissions behind each other."""
    empty = {
        "values": np.zeros((0, N_ROWS)),
        "line": np.zeros(0, dtype=np.int64),
        "frame": np.zeros(0, dtype=np.int64),
        "time_s": np.zeros(0),
    }
    return {name: np.concatenate([empty[name], *(p[name] for p in parts)])
            for name in empty}  # fmt: skip


def to_lines(
    frames: Frames,
    points: Points,
    table: LineTable,
    scalars: dict[str, Any],
) -> Lines:
    """Make the container of a block from final points and the table of lines."""
    v = points["values"]
    has_bearing = v[:, 5] < _BEARING_KNOWN_BELOW_DEG2
    unknown = np.where(has_bearing, 0.0, np.nan)
    return Lines(
        frames=frames,
        families=table.families,
        line=points["line"],
        frame=points["frame"],
        time_s=points["time_s"],
        frequency_hz=v[:, 0],
        frequency_rate_hzps=v[:, 2],
        frequency_covariance=_covariance(v[:, 4], v[:, 6], v[:, 8]),
        bearing_deg=v[:, 1] % 360.0 + unknown,
        bearing_rate_degps=v[:, 3] + unknown,
        bearing_covariance=_covariance(v[:, 5], v[:, 7], v[:, 9])
        + unknown[:, None, None],
        measured_frequency_hz=v[:, 10],
        measured_frequency_std_hz=v[:, 11],
        measured_bearing_deg=v[:, 12],
        measured_bearing_std_deg=v[:, 13],
        measured_level_db=v[:, 14],
        measured_snr_db=v[:, 15],
        association=v[:, 16],
        line_id=table.line,
        line_contact=table.contact,
        line_family=table.family,
        line_status=table.status,
        **scalars,
    )


def _covariance(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    return np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], -1)
