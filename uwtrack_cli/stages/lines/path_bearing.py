"""Whether the sound along a path comes from one bearing.

**Method.** Along a path the active intensity of each cell is taken, less what the
bearing of the noise around it predicts for the cell's power: ambient noise has a
bearing, too. Whether the mean of these vectors is zero is asked by Hotelling's
statistic; half of it is exponential in noise of any directionality, with mean one. Times
the slope of the path score's tail it has that score's own tail, so that their sum has a
gamma tail, which sets the threshold.

**Conventions.** Nepers. Arrays have the shape (frame, cell), paths (path, frame).

**References.** Hotelling (1931); D'Spain et al. (1991) for the intensity.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.stages.lines.trace_threshold import TraceThreshold
from uwtrack_cli.stages.lines.trace_window import WindowData

_NEAR_BINS, _OWN_BINS = 24, 3
"""Natural bins to either side that tell the noise's bearing, and those left out."""

_FEWEST_FRAMES = 16
"""Frames below which a path's bearing is not tested."""


def path_thresholds(
    threshold: TraceThreshold, data: WindowData
) -> tuple[float, float, "PathBearing | None"]:
    """Scores for new and for continued lines of a window, and what to add to paths."""
    if data.east is None:
        return *threshold.scores(data.frame.size), None
    strict, lax, least, slope = threshold.scores_with_bearing(data.frame.size)
    return strict, lax, PathBearing(data, slope, least)


@dataclass(frozen=True)
class PathBearing:
    """Adds the evidence of one bearing to the scores of paths."""

    data: WindowData
    slope: float
    least_score: float
    is_masked: BoolArray | None = None

    def without(self, is_masked: BoolArray) -> "PathBearing":
        """Leave cells out that belong to lines already found."""
        return replace(self, is_masked=is_masked)

    def scores(self, paths: IntArray) -> FloatArray:
        """Return the slope times half of Hotelling's statistic for each path."""
        return np.array([self.slope * self._evidence(path) for path in paths])

    def _evidence(self, path: IntArray) -> float:
        data = self.data
        rows = np.arange(path.size)
        use = data.is_valid.copy()
        if self.is_masked is not None:
            use &= ~self.is_masked[rows, path]
        rows, path = rows[use], path[use]
        if rows.size < _FEWEST_FRAMES or data.east is None or data.north is None:
            return 0.0
        power = data.power[rows, path]
        off = np.arange(_OWN_BINS, _NEAR_BINS + 1) * data.cells_per_bin
        near = path[:, None] + np.concatenate([-off, off])
        near = np.clip(near, 0, data.power.shape[1] - 1)
        around = data.power[rows[:, None], near]
        vectors = np.empty((rows.size, 2))
        for k, part in enumerate((data.east, data.north)):
            usual = np.median(part[rows[:, None], near] / around, axis=1)
            vectors[:, k] = (part[rows, path] - usual * power) / data.floor[rows, path]
        total = vectors.sum(axis=0)
        try:
            turned = np.linalg.solve(vectors.T @ vectors, total)
        except np.linalg.LinAlgError:
            return 0.0
        return 0.5 * float(total @ turned)
