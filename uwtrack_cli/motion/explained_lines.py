"""Passages told by lines that another passage explains.

**Method.** Frames of another length, or another contact, may hear a piece of a line that
passes: on its way out alone it falls as that of a slow vessel far off would. Whether it
is steady in that vessel's own time only the sound can tell, which is not always at hand.
So each line of a row is held against the rest frequencies of every better determined
passage at another time, under its Doppler shift: it is explained where most of the weight of its
measurements lies on one of them. A row of explained lines is no passage of its own. The
same line of another vessel passes at a time of its own, and leaves that path.

**Conventions.** Times count from the first sample. The law is that of a straight
passage, in time of arrival; weights are inverse variances.

**References.** Quinn (1995) for the Doppler law of a passage.
"""

from collections.abc import Sequence

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.motion.competition import overlaps

DEVIATIONS = 3.0
"""Deviations within which a measurement lies on a path."""

SMALLEST_STD = 0.1
"""Deviation of a measured frequency that is assumed at least, in resolutions: the path
leaves what a frame resolves while it turns."""

EXPLAINED_SHARE = 0.6
"""Share of the weight of a line's measurements from which a path explains it."""

LARGEST_REACH = 0.5
"""Reach of a measurement, in Doppler shifts of the row, from which it says nothing."""

FEWEST_POINTS = 4
"""Measurements of a line below which nothing is said of it."""


def unexplained(table: Encounters, lines: Lines, known: Sequence[Encounters]) -> BoolArray:
    """Tell which rows have a line that no better passage explains, shape (row,).

    ``lines`` are those that the table's rows are made of; rows without any are not
    explained. The tables that may explain them include the table itself.
    """
    kept = np.ones(table.n_encounters, np.bool_)
    for row in range(table.n_encounters):
        own = table.rest_line_id[table.rest_encounter == row]
        own = own[own > 0]
        mach = float(table.speed_mps[row] / table.sound_speed_mps[row])
        kept[row] = not own.size or not any(
            _is_better(other, k, table, row)
            and all(_is_on_path(lines, int(line), mach, other, k) for line in own)
            for other in known
            for k in range(other.n_encounters)
        )
    return kept


def _is_better(other: Encounters, k: int, table: Encounters, row: int) -> bool:
    """Tell whether a row is another passage whose speed is better known."""
    if other.sensor[k] != table.sensor[row] or overlaps(other, k, table, row):
        return False  # rows that claim one time compete
    known = other.speed_mps[k] / other.speed_std_mps[k]
    own = table.speed_mps[row] / table.speed_std_mps[row]
    more = np.count_nonzero(other.rest_encounter == k) >= np.count_nonzero(
        table.rest_encounter == row
    )
    return bool(more and known > own)


def _is_on_path(lines: Lines, line: int, mach: float, passage: Encounters, row: int) -> bool:
    """Tell whether a passage explains most of what was measured of a line.

    ``mach`` is the speed of the vessel that the line tells itself, over sound speed.
    """
    points = lines.line == line
    frequency = np.asarray(lines.measured_frequency_hz[points], float)
    std = np.asarray(lines.measured_frequency_std_hz[points], float)
    used = np.isfinite(frequency) & np.isfinite(std)
    if np.count_nonzero(used) < FEWEST_POINTS:
        return False
    frequency = frequency[used]
    std = np.maximum(std[used], SMALLEST_STD / lines.frames.window_s)
    rests = np.flatnonzero(passage.rest_encounter == row)
    ratio, ratio_std = _ratio(np.asarray(lines.time_s[points])[used], passage, row)
    expected = passage.rest_frequency_hz[rests, None] * ratio
    spread = np.nan_to_num(passage.rest_frequency_std_hz[rests, None]) ** 2
    spread = spread + (passage.rest_frequency_hz[rests, None] * ratio_std) ** 2 + std**2
    reach = DEVIATIONS * np.sqrt(spread)
    near = np.abs(frequency - expected) < reach
    near &= reach < LARGEST_REACH * mach * frequency
    share = (near / std**2).sum(axis=1) / (1 / std**2).sum()
    return bool((share > EXPLAINED_SHARE).any())


def _ratio(time_s: FloatArray, passage: Encounters, row: int) -> tuple[FloatArray, FloatArray]:
    """Return received over emitted frequency, and its deviation by that of the speed."""
    closest_s = passage.arrival_time_s[row]
    if not np.isfinite(closest_s):
        closest_s = passage.time_s[row]
    lag = (time_s - closest_s) / max(float(passage.range_over_speed_s[row]), 1e-3)
    along = lag / np.sqrt(1.0 + lag**2)
    sound_mps = float(passage.sound_speed_mps[row])
    ratio = 1.0 / (1.0 + along * passage.speed_mps[row] / sound_mps)
    return ratio, np.abs(along) * float(passage.speed_std_mps[row]) / sound_mps
