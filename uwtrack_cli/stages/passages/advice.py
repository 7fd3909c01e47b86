"""Advice on an encounter whose frames do not fit it.

**Method.** Frames should be as long as a line's sweep at closest approach allows:
shorter ones waste information, longer ones blur it. Beyond 8 s nothing is gained.

**References.** Frame length min(0.8 / sqrt(f0 v^2 / (c d)), 8 s): the sweep within a
frame stays below the frame's own resolution.
"""

import warnings

import numpy as np

from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.stages.passages.report import Row, Setting

LONGEST_S = 8.0
"""Longest frames advised: shafts do not turn evenly for longer."""

TOO_LONG, TOO_SHORT = 2.0, 1 / 12
"""Window over the best frame length beyond which advice is given."""


def advise_frames(row: Row, setting: Setting, window_s: float) -> None:
    """Warn if other frames would suit the passage that was found much better.

    Parameters
    ----------
    row
        Row of an encounter with a speed.
    setting
        Sound speed.
    window_s
        Length of the frames in seconds; zero if unknown.
    """
    slant = row.values["slant_range_m"]
    if not np.isfinite(slant) or not row.rest or window_s <= 0:
        return
    highest = max(frequency for _, frequency, _ in row.rest)
    sweep = highest * row.values["speed_mps"] ** 2 / (setting.sound_speed_mps * slant)
    best_s = min(0.8 / float(np.sqrt(sweep)), LONGEST_S)
    if TOO_SHORT * best_s <= window_s <= TOO_LONG * best_s:
        return
    wrong = "long: they blur" if window_s > best_s else "short: they waste"
    msg = (
        f"contact {row.contact}: frames of {window_s:.3g} s are too {wrong} what its "
        f"lines tell; window_s = {best_s:.2g} would suit (see 'uwtrack recipes')."
    )
    warnings.warn(msg, UwtrackWarning, stacklevel=3)
