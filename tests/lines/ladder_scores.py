"""Lines of a ladder of frames of a tenth, one and eight seconds, joined to one table.

Three questions, each beside the single rungs: are steady lines heard that are too weak
for a second, are lines that move followed as well as by the rung that hears them best,
and what does joining cost? Steady lines are those of `long_lines`, sweeps and the other
scenes those of `line_sounds`; a point counts for the time up to the next frame of its
own length. A line is heard when a tenth of its time is told.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.draws.line_sounds import STEP_S, Scene, tracked
from uwtrack_cli.data.lines import Lines

WINDOWS_S = (0.1, 1.0, 8.0)


@dataclass(frozen=True)
class Spread:
    """Points at every step of a scene that they stand for."""

    line: np.ndarray
    time_s: np.ndarray
    frequency_hz: np.ndarray


def spread(lines: Lines) -> Spread:
    """Let every point stand for the time up to the next frame of its own length."""
    hop_s = lines.point_window_s / lines.overlap_frames
    count = np.maximum(1, np.rint(hop_s / STEP_S).astype(int))
    row = np.repeat(np.arange(count.size), count)
    number = np.arange(row.size) - np.repeat(np.cumsum(count) - count, count)
    off_s = (number - count[row] // 2) * STEP_S
    frequency = lines.frequency_hz[row] + lines.frequency_rate_hzps[row] * off_s
    return Spread(lines.line[row], lines.time_s[row] + off_s, frequency)


def rungs_of(
    scene: Scene, seed: int, stage: str = "track", windows_s: Sequence[float] = WINDOWS_S
) -> list[Lines]:
    """Follow the lines of a scene in frames of each length."""
    return [tracked(scene, seed, stage, window_s=window_s) for window_s in windows_s]


def doubled_share(lines: Lines) -> float:
    """Share of the told time of all lines that a line of another rung tells again."""
    hop_s = lines.point_window_s / lines.overlap_frames
    again = 0.0
    for name in lines.line_id:
        own = np.flatnonzero(lines.line == name)
        time_s, step_s = lines.time_s[own], hop_s[own]
        other = np.append(step_s[1:] != step_s[:-1], False)
        reach = 0.5 * np.minimum(step_s, np.append(step_s[1:], step_s[-1:]))
        again += float((reach * (other & (np.diff(time_s, append=np.inf) < reach))).sum())
    return again / max(float(hop_s.sum()), 1e-9)
