"""Directions that an array heard, as the bearings of a passage.

**Method.** A direction belongs to its frame. The levels of one hydrophone have frames
of their own: each takes the direction that is nearest in time, if it lies within the
hop. Without levels the bearings are a series by themselves. Of several sources in a
frame the strongest one's direction is taken. The error of the array's
heading, the same for all, is not among their deviations.
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.directions import Directions
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Levels


def with_directions(
    levels: Levels | None, directions: Directions | None
) -> Levels | None:
    """Return levels with the bearings of an array.

    Parameters
    ----------
    levels
        Levels of one hydrophone.
    directions
        What the array heard, in the order of time; None leaves the levels as they are.
    """
    if levels is None or directions is None:
        return levels
    frames, directions = levels.frames, directions.strongest()
    bearing, std = np.full((2, frames.n_frames), np.nan)
    if directions.time_s.size and frames.n_frames:
        reach_s = 0.5 * max(frames.hop_s, _step_s(directions)) + 1e-6
        right = np.searchsorted(directions.time_s, frames.time_s)
        right = np.clip(right, 1, directions.time_s.size - 1) if (
            directions.time_s.size > 1
        ) else np.zeros_like(right)  # fmt: skip
        left = np.maximum(right - 1, 0)
        apart = np.abs(directions.time_s[[left, right]] - frames.time_s)
        nearest = np.where(apart[0] <= apart[1], left, right)
        is_near = apart.min(axis=0) <= reach_s
        # a direction counts once: for the frame that is nearest to it
        _, first = np.unique(np.where(is_near, nearest, -1), return_index=True)
        once = np.zeros(frames.n_frames, np.bool_)
        once[first] = True
        taken = is_near & once
        bearing[taken] = directions.bearing_deg[nearest[taken]]
        std[taken] = directions.bearing_std_deg[nearest[taken]]
    return replace(levels, bearing_deg=bearing, bearing_std_deg=std)


def _step_s(directions: Directions) -> float:
    steps = np.diff(np.unique(directions.time_s))
    return float(steps.min()) if steps.size else 0.0


def bearing_series(directions: Directions) -> Series:
    """Return directions as a series of bearings of one contact."""
    directions = directions.strongest()
    n = directions.time_s.size
    nothing = np.full(n, np.nan)
    return Series(
        contact=np.ones(n, np.int64),
        time_s=directions.time_s,
        bearing_deg=directions.bearing_deg,
        bearing_std_deg=directions.bearing_std_deg,
        frequency_hz=np.zeros((n, 0)),
        frequency_std_hz=np.zeros((n, 0)),
        level_db=nothing,
        level_std_db=nothing,
        start_utc_ns=directions.start_utc_ns,
    )
