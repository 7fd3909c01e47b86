"""What the surroundings do to an encounter: other vessels, and frames that do not fit.

**Method.** Another vessel's sound is directional noise and turns a line's bearings by
about the noise-to-signal ratio of its cell. The peaks are freed of it but for a share
that grows as lines get weak; it is alike in all lines and does not average out. Frames
should be as long as a line's sweep at closest approach allows: shorter ones waste
information, longer ones blur it. Beyond 8 s nothing is gained.

**References.** Frame length min(0.8 / sqrt(f0 v^2 / (c d)), 8 s): the sweep within a
frame stays below the frame's own resolution.
"""

import warnings

import numpy as np

from uwtrack_cli.data.base import IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.stages.passages.report import Row, Setting

LEFT_OF_PULL = 0.3
"""Share of the pull left on bearings of lines near their threshold (9 to 10 dB)."""

LONGEST_S = 8.0
"""Longest frames advised: shafts do not turn evenly for longer."""

TOO_LONG, TOO_SHORT = 2.0, 1 / 12
"""Window over the best frame length beyond which advice is given."""


def widen_for_others(row: Row, lines: Lines | None, line_ids: IntArray) -> None:
    """Widen what rests on bearings by what is left of other vessels' pull on them.

    A turn by an angle that changes along the passage moves its time and width by
    up to the angle times d/v; half of that is taken.

    Parameters
    ----------
    row
        Row of one of several vessels.
    lines
        Tracked lines.
    line_ids
        Lines of this vessel.
    """
    if lines is None or not row.side:
        return
    lag = np.abs(np.asarray(lines.time_s) - row.values["time_s"])
    near = np.isin(lines.line, line_ids) & (lag < row.values["range_over_speed_s"])
    snr = lines.measured_snr_db[near]
    snr = snr[np.isfinite(snr)]
    if not snr.size:
        return
    turned = LEFT_OF_PULL * np.rad2deg(10 ** (-float(np.median(snr)) / 10) / np.sqrt(2))
    moved = 0.5 * np.deg2rad(turned) * row.values["range_over_speed_s"]
    row.covariance[np.diag_indices(4)] += np.array([moved, moved, 0.0, turned]) ** 2
    deviation = np.sqrt(np.diag(row.covariance))
    row.values["time_std_s"] = float(deviation[0])
    row.values["range_over_speed_std_s"] = float(deviation[1])
    row.values["bearing_std_deg"] = row.values["course_std_deg"] = float(deviation[3])
    speed = row.values["speed_mps"]
    if np.isfinite(row.values["slant_range_std_m"]):
        row.values["slant_range_std_m"] = float(
            np.hypot(row.values["slant_range_std_m"], speed * moved)
        )


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
