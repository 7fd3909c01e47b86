"""Say whether the closest approach lies in what was heard.

**Method.** What passes must do so within the recording and slower than a frame, and
be heard on both sides of its closest approach: else time and width of the passage
are those of the data's ends.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.estimation.passages.blocks import Blocks
from uwtrack_cli.estimation.passages.fit import PassageFit

LARGEST_RELATIVE_WIDTH = 1.0 / 3.0
"""A bend whose d/v is less certain than this is no passage: machinery drifts, too."""

ONE_SIDE = 0.3
"""Share of d/v that must be heard on either side of the closest approach."""


@dataclass(frozen=True)
class Limits:
    """Length of the frames, and first and last instant of the recording, s."""

    window_s: float
    first_s: float
    last_s: float


def not_a_passage(fit: PassageFit, blocks: Blocks, limits: Limits) -> str | None:
    """Return why a fit that moves has no closest approach to give, or None.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        The measurements.
    limits
        Length of the frames and ends of the recording.
    """
    width = float(fit.range_over_speed_s[0])
    closest = float(fit.theta[0, 0])
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance[0])[:2], 0.0))
    if not np.all(np.isfinite(deviation)):
        return "the measurements do not tell time and width of a passage apart"
    if width < limits.window_s:
        return (
            f"the change within {width:.3g} s is shorter than the frames "
            f"({limits.window_s:.3g} s): use a shorter window_s"
        )
    if deviation[1] > LARGEST_RELATIVE_WIDTH * width or deviation[0] > width:
        return "too little of the passage is in the recording"
    return _one_sided(closest, width, _extent(blocks), limits)


def _one_sided(
    closest: float, width: float, extent: tuple[float, float], limits: Limits
) -> str | None:
    first, last = extent
    if not first - width < closest < last + width:
        return "the closest approach lies far outside the recording"
    slack = 0.1 * (limits.last_s - limits.first_s) + 2 * limits.window_s
    if closest - ONE_SIDE * width < first and first > limits.first_s + slack:
        return "what was heard begins at the closest approach"
    if closest + ONE_SIDE * width > last and last < limits.last_s - slack:
        return "what was heard ends at the closest approach"
    return None


def _extent(blocks: Blocks) -> tuple[float, float]:
    used = np.zeros(blocks.time_s.size, np.bool_)
    for block in (blocks.shift, blocks.bearing, blocks.level):
        used |= (block.weight[0] > 0).any(axis=0)
    times = blocks.time_s[used]
    return float(times[0]), float(times[-1])
