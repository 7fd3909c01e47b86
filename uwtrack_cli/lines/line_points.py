"""Points of tracked lines, and the container in which they leave a stage.

**Conventions.** Bearings leave as compass degrees from 0 up to 360; a bearing that was
never measured is nan, and so is its covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray, TextArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.lines.families.lasting_families import no_families

_BEARING_KNOWN_BELOW_DEG2 = 1e6
"""Variance below which a smoothed bearing rests on a measurement."""


N_MEASURED = 6
"""Values that are measured of a point: see `LinePoints.measured`."""


@dataclass(frozen=True)
class LinePoints(Rows):
    """Points of lines that have become final, one row each."""

    line: IntArray
    """Number of the line, shape (point,)."""
    frame: IntArray
    """Index of the frame, shape (point,)."""
    time_s: FloatArray
    """Centre of the frame from the first sample, s, shape (point,)."""
    state: FloatArray
    """Smoothed entries of `kalman.KalmanState` of frequency (Hz) and bearing (degree,
    unwrapped), shape (point, 5, 2)."""
    measured: FloatArray
    """Associated measurement: frequency and its deviation (Hz), bearing and its
    deviation (degree), level (dB) and SNR (dB); nan if coasted; shape (point, N_MEASURED)."""
    association: IntArray
    """How the point was measured, as `Lines.association`, shape (point,)."""

    @property
    def frequency_hz(self) -> FloatArray:
        """Smoothed frequency in Hz, shape (point,)."""
        return self.state[:, 0, 0]

    @property
    def frequency_variance_hz2(self) -> FloatArray:
        """Variance of the smoothed frequency in Hz^2, shape (point,)."""
        return self.state[:, 2, 0]

    @property
    def bearing_deg(self) -> FloatArray:
        """Smoothed bearing in degree, unwrapped; nan if unknown; shape (point,)."""
        return np.where(self.has_bearing, self.state[:, 0, 1], np.nan)

    @property
    def bearing_variance_deg2(self) -> FloatArray:
        """Variance of the smoothed bearing in degree^2, shape (point,)."""
        return self.state[:, 2, 1]

    @property
    def has_bearing(self) -> BoolArray:
        """Whether the bearing rests on a measurement, shape (point,)."""
        return np.asarray(self.bearing_variance_deg2 < _BEARING_KNOWN_BELOW_DEG2)

    def sorted(self) -> "LinePoints":
        """Return the points by line, then by frame."""
        return self.take(np.lexsort((self.frame, self.line)))

    def since(self, start_s: float) -> "LinePoints":
        """Return the points from a time on, s."""
        return self.take(np.flatnonzero(self.time_s >= start_s))

    @classmethod
    def join(cls, parts: Sequence["LinePoints"]) -> "LinePoints":
        """Put the points of several emissions behind each other."""
        none = np.zeros(0, dtype=np.int64)
        nothing = np.zeros((0, 5, 2)), np.zeros((0, N_MEASURED))
        return super().join(parts or [cls(none, none, np.zeros(0), *nothing, none)])


@dataclass
class FamilyJump:
    """A machine's change of speed at once, by which its lines jump together."""

    time_s: float
    """Middle of the lines' last peaks before it and their first ones after it, s."""
    ratio: float
    """Rate after it over the rate before."""
    ratio_std: float
    """Standard deviation of the ratio."""
    lines: set[int]
    """Numbers of the lines that jumped."""


@dataclass(frozen=True)
class LineTable:
    """What is known of whole lines at the end of a recording."""

    line: IntArray
    """Number of each line, shape (line,)."""
    contact: IntArray
    """Contact of each line, 0 for none, shape (line,)."""
    family: IntArray
    """Harmonic family of each line, -1 for none, shape (line,)."""
    status: TextArray
    """'moving', 'steady' or 'hum', shape (line,)."""
    unresolved_share: FloatArray
    """Share of its time in which another line runs beside each, shape (line,)."""
    families: Families
    """The lasting families, one row each."""
    jumps: Sequence[FamilyJump] = ()
    """Jumps of families, in time."""


def no_table() -> LineTable:
    """Return the table of a block before the end."""
    none = np.zeros(0, dtype=np.int64)
    return LineTable(none, none, none, np.zeros(0, dtype="U6"), np.zeros(0), no_families())


def to_lines(
    frames: Frames, points: LinePoints, table: LineTable, scalars: dict[str, Any]
) -> Lines:
    """Make the container of a block from final points and the table of lines.

    The table has no rows before the end; ``scalars`` are the single values of `Lines`.
    """
    frequency, bearing = points.state[:, :, 0], points.state[:, :, 1]
    measured = points.measured
    unknown = np.where(points.has_bearing, 0.0, np.nan)
    return Lines(
        frames=frames,
        families=table.families,
        line=points.line,
        frame=points.frame,
        time_s=points.time_s,
        frequency_hz=frequency[:, 0],
        frequency_rate_hzps=frequency[:, 1],
        frequency_covariance=_covariance(frequency),
        bearing_deg=bearing[:, 0] % 360.0 + unknown,
        bearing_rate_degps=bearing[:, 1] + unknown,
        bearing_covariance=_covariance(bearing) + unknown[:, None, None],
        measured_frequency_hz=measured[:, 0],
        measured_frequency_std_hz=measured[:, 1],
        measured_bearing_deg=measured[:, 2],
        measured_bearing_std_deg=measured[:, 3],
        measured_level_db=measured[:, 4],
        measured_snr_db=measured[:, 5],
        association=points.association,
        line_id=table.line,
        line_contact=table.contact,
        line_family=table.family,
        line_status=table.status,
        line_unresolved_share=table.unresolved_share,
        **_jumps(table),
        **scalars,
    )


def _jumps(table: LineTable) -> dict[str, Any]:
    """Return the columns of the jumps; a contact is that of most of a jump's lines."""
    contacts = []
    for jump in table.jumps:
        own = table.contact[np.isin(table.line, list(jump.lines))]
        contacts.append(int(np.bincount(own).argmax()) if own.size else 0)
    return {
        "jump_time_s": np.array([jump.time_s for jump in table.jumps], float),
        "jump_ratio": np.array([jump.ratio for jump in table.jumps], float),
        "jump_ratio_std": np.array([jump.ratio_std for jump in table.jumps], float),
        "jump_line_count": np.array([len(jump.lines) for jump in table.jumps], np.int64),
        "jump_contact": np.array(contacts, np.int64),
    }


def _covariance(state: FloatArray) -> FloatArray:
    """Covariance of position and rate, shape (point, 2, 2)."""
    return state[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
