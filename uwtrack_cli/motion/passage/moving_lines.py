"""Lines that move together for a few d/v, whatever contact they were put into.

**Method.** A tracker's contact is what lines do over minutes. A passage of seconds is a
small part of that: its lines go on as noise or as another ship's, a gear was changed
before, and lines of two vessels share a contact. So passages are sought among the lines
themselves. On a grid of time and width the shift of a line is linear in speed and rest
frequency; what a line gains by each speed over standing still, within a few widths of
the closest approach and with noise of its own strength, comes in closed form from six
sums; and so does what its level gains by rising and falling with the range over staying
as it is. Lines that gain nothing, or whose level stays, are of another source and count
nothing; those that gain by one time, width and speed are a candidate. It is fitted and
checked as a contact is, from these stretches of its lines alone.

**Conventions.** Gains in nepers, noise taken as white: they choose what is fitted, and
tell nothing. So the constants decide what is tried and not what is told; those without a
script are chosen. Times count from the first sample.

**References.** Kay (1998), Fundamentals of Statistical Signal Processing II, section 6.5
(likelihood ratio with unknown noise).
"""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.motion.passage.model.measurements import NEPER_DB, heard_level_db

REACH = 4.0
"""d/v on either side of the closest approach that are searched and fitted: there a
passage has 97 % of its Doppler shift."""

CELL = 0.25
"""Length over which measurements are averaged, in d/v."""

WIDTH_RATIO = 1.4
"""Ratio of neighbouring widths."""

NARROWEST, WIDEST_S = 3.0, 60.0
"""Smallest width in spacings of the measurements, and largest one, s: what lasts longer
is most of its lines."""

SPEEDS_MPS = np.geomspace(0.8, 40.0, 24)
"""Speeds that are tried, m/s."""

LINE_COST = 2.0
"""Gain of a line below which it is not taken: 1 % of lines in noise alone have it at some
speed, and nine of ten of a vessel that passes (studies/constants/moving_lines.py)."""

LEAST_GAIN = 12.0
"""Gain of all lines together from which a candidate is fitted, whose own threshold is
checked afterwards: of lines in noise none in twenty hours has it, of machines one in ten
hours, and of those that swell four an hour, where all of 60 vessels have
(studies/constants/moving_lines.py)."""

FEWEST_CELLS = 4
"""Averages below which a line tells nothing; half of them on either side of the closest
approach."""

STEADIER = 1.0
"""Gain by which the level of a line may prefer to stay as it is, nepers: none of a vessel's
does, and nine of ten in noise do (studies/constants/moving_lines.py)."""

LEVEL_STD = 0.5
"""Deviation of the level of a line in a cell, nepers (2 dB)."""

PRIOR_COUNT = 4.0
"""Averages for which the stated deviations of a line's measurements count."""

FEWEST_LINES = 2
"""Lines that move together: one alone is its contact."""

APART = 2.0
"""d/v between two candidates: nearer ones are the flanks of one."""

MOST = 3
"""Candidates of one stretch."""

MOST_CELLS = 100_000
"""Cells of all lines that are worked on at once."""

STRETCH_S = 600.0
"""Length of the stretches in which a table is searched, s."""


class Together(NamedTuple):
    """Lines that move together."""

    time_s: float
    """Closest approach as it is heard, s."""
    width_s: float
    """d/v, s."""
    lines: IntArray
    """Numbers of the lines."""
    gain: float
    """What they gain, nepers."""


def lines_together(lines: Lines, sound_speed_mps: float) -> list[Together]:
    """Return the lines of any contact that move together, the strongest first."""
    points = np.flatnonzero(_is_heard(lines))
    if points.size < FEWEST_LINES * FEWEST_CELLS:
        return []
    time_s = np.asarray(lines.time_s[points], float)
    found: list[Together] = []
    first_s, last_s = float(time_s.min()), float(time_s.max())
    margin_s = REACH * WIDEST_S
    count = max(1, int(np.ceil((last_s - first_s) / STRETCH_S)))
    edges = np.linspace(first_s, last_s + 1e-6, count + 1)
    for start_s, stop_s in pairwise(edges.tolist()):
        near = (time_s >= start_s - margin_s) & (time_s < stop_s + margin_s)
        if near.any():
            found += _of_stretch(lines, points[near], (start_s, stop_s), sound_speed_mps)
    return _apart(found)


def line_gains(lines: Lines, place: Together, mach: float) -> Together:
    """Return a place with all lines that gain there by one speed, ``mach`` of sound's."""
    near = np.abs(lines.time_s - place.time_s) <= (REACH + CELL) * place.width_s
    points = np.flatnonzero(near & _is_heard(lines))
    if not points.size:
        return place
    measured = _measured(lines, points)
    half_s = 0.5 * CELL * place.width_s
    span_s = place.time_s - half_s, place.time_s + half_s
    gain = _gains(measured, place.width_s, span_s, np.array([mach]))[:, 0, 0]
    taken = gain > LINE_COST
    return place._replace(lines=measured.names[taken], gain=float(gain[taken].sum()))


def stretch_of(lines: Lines, together: Together, contact: int) -> Lines:
    """Return a table of these lines alone, about their passage, as one contact."""
    near = np.abs(lines.time_s - together.time_s) <= REACH * together.width_s
    near &= np.isin(lines.line, together.lines)
    own = np.isin(lines.line_id, together.lines)
    return replace(
        lines.take("point", np.flatnonzero(near)), line_contact=np.where(own, contact, 0)
    )


def _is_heard(lines: Lines) -> BoolArray:
    """Tell which points are measured, on lines that are no hum."""
    usable = np.isin(lines.line, lines.line_id[lines.line_status != "hum"])
    return np.asarray(usable & np.isfinite(lines.measured_frequency_hz))


class _Measured(NamedTuple):
    """Relative frequencies of the lines of a stretch; arrays of shape (point,)."""

    names: IntArray
    """Numbers of the lines, shape (line,)."""
    row: IntArray
    """Line of each point, as its row."""
    time_s: FloatArray
    """Times, s."""
    value: FloatArray
    """Frequency over the line's median, less one."""
    weight: FloatArray
    """Inverse variance."""
    level: FloatArray
    """Level without the noise in it, ln of power; nan is missing or weak."""
    window_s: float
    """Length of the frames, s."""


def _of_stretch(
    lines: Lines, points: IntArray, span_s: tuple[float, float], sound_speed_mps: float
) -> list[Together]:
    """Search one stretch."""
    measured = _measured(lines, points)
    found: list[Together] = []
    width_s = NARROWEST * lines.frames.hop_s
    while width_s <= min(WIDEST_S, span_s[1] - span_s[0]):
        found += _of_width(measured, width_s, span_s, sound_speed_mps)
        width_s *= WIDTH_RATIO
    return _apart(found)[:MOST]


def _measured(lines: Lines, points: IntArray) -> _Measured:
    """Gather the measurements of some points."""
    names, row = np.unique(lines.line[points], return_inverse=True)
    frequency = np.asarray(lines.measured_frequency_hz[points], float)
    usual = np.array([np.median(frequency[row == k]) for k in range(names.size)])
    deviation = np.asarray(lines.measured_frequency_std_hz[points]) / usual[row]
    known = np.isfinite(deviation) & (deviation > 0)
    return _Measured(
        names, row, np.asarray(lines.time_s[points], float),
        frequency / usual[row] - 1.0,
        np.where(known, 1.0 / np.where(known, deviation, 1.0) ** 2, 0.0),
        heard_level_db(lines, points) / NEPER_DB,
        lines.frames.window_s,
    )  # fmt: skip


def _of_width(
    measured: _Measured, width_s: float, span_s: tuple[float, float], sound_mps: float
) -> list[Together]:
    """Return the best places of one width, a part of the stretch at a time."""
    count = max(1, int(np.ceil((span_s[1] - span_s[0]) / (CELL * width_s))))
    n_parts = int(np.ceil(count * measured.names.size / MOST_CELLS))
    edges = np.linspace(span_s[0], span_s[1], n_parts + 1).tolist()
    found: list[Together] = []
    for part_s in pairwise(edges):
        gain = _gains(measured, width_s, part_s, SPEEDS_MPS / sound_mps)
        own = np.where(gain > LINE_COST, gain, 0.0)
        total = own.sum(axis=0)  # of every place and speed
        total[(own > 0).sum(axis=0) < FEWEST_LINES] = 0.0
        best = np.argmax(total, axis=1)
        height = total[np.arange(best.size), best]
        for _ in range(MOST):
            place = int(np.argmax(height))
            if height[place] < LEAST_GAIN:
                break
            those = np.flatnonzero(own[:, place, best[place]])
            time_s = part_s[0] + (place + 0.5) * CELL * width_s
            gained = float(height[place])
            found.append(Together(time_s, width_s, measured.names[those], gained))
            reach = round(1 / CELL)
            height[max(0, place - reach) : place + reach + 1] = 0.0
    return found


class _Cells(NamedTuple):
    """Where the measurements of a stretch lie among cells of one width."""

    shape: tuple[int, int]
    """Lines, and cells with those before and behind the stretch."""
    at: IntArray
    """Cell of each point in a flat table, -1 outside, shape (point,)."""
    share: float
    """Independent measurements in a cell."""

    def table(self, weight: FloatArray) -> FloatArray:
        """Return sums over the points of each cell, shape (line, cell)."""
        inside = self.at >= 0
        size = self.shape[0] * self.shape[1]
        table = np.bincount(self.at[inside], weight[inside], size)
        return np.asarray(table.reshape(self.shape), np.float64)

    def about(self, table: FloatArray, columns: FloatArray) -> FloatArray:
        """Return sums over the cells about every place, shape (line, place, columns)."""
        windows = np.lib.stride_tricks.sliding_window_view(table, columns.shape[0], axis=1)
        return np.asarray(windows @ columns)

    def gains(
        self, weight: FloatArray, value: FloatArray, law: FloatArray, size: FloatArray
    ) -> FloatArray:
        """Return what a law of so many sizes gains over a constant, nepers.

        Parameters
        ----------
        weight, value
            Inverse variances and values of the points, shape (point,).
        law
            The law in the cells of a place.
        size
            Factors of the law that are tried, shape (sizes,).

        Returns
        -------
        FloatArray
            Shape (line, place, sizes); 0 where too little was measured.
        """
        powers = np.stack([np.ones(law.size), law, law**2], axis=1)
        sides = np.sign(np.arange(law.size) - law.size // 2)
        mass, moment = self.table(weight), self.table(weight * value)
        total, along = self.about(mass, powers), self.about(moment, powers[:, :2])
        each = moment**2 / np.where(mass > 0, mass, 1.0)
        square = self.about(each, powers[:, :1])[..., 0]
        heard = self.about((mass > 0).astype(float), np.stack([sides < 0, sides > 0], axis=1) * 1.0)
        safe = np.where(total[..., 0] > 0, total[..., 0], 1.0)
        still = np.maximum(square - along[..., 0] ** 2 / safe, 0.0)[..., None]
        slope = along[..., 1] - along[..., 0] * total[..., 1] / safe
        length = total[..., 2] - total[..., 1] ** 2 / safe
        moving = still - 2 * size * slope[..., None] + size**2 * length[..., None]
        n_free = heard.sum(axis=-1) * self.share
        ratio = (still + PRIOR_COUNT) / (np.maximum(moving, 0.0) + PRIOR_COUNT)
        known = heard.min(axis=-1) >= FEWEST_CELLS / 2
        known &= heard.sum(axis=-1) >= FEWEST_CELLS
        gain = 0.5 * n_free[..., None] * np.log(ratio)
        return np.where(known[..., None], gain, 0.0)


def _gains(
    measured: _Measured, width_s: float, span_s: tuple[float, float], mach: FloatArray
) -> FloatArray:
    """Return what each line gains at every place by every speed, nepers.

    Returns
    -------
    FloatArray
        Shape (line, place, speed).
    """
    cell_s, half = CELL * width_s, round(REACH / CELL)
    count = max(1, int(np.ceil((span_s[1] - span_s[0]) / cell_s)))
    place = np.floor((measured.time_s - span_s[0]) / cell_s).astype(np.int64) + half
    inside = (place >= 0) & (place < count + 2 * half)
    shape = measured.names.size, count + 2 * half
    at = np.where(inside, measured.row * shape[1] + place, -1)
    cells = _Cells(shape, at, min(1.0, cell_s / measured.window_s))
    x = CELL * np.arange(-half, half + 1)
    bend = -x / np.hypot(1.0, x)
    shifts = cells.gains(measured.weight, measured.value, bend, mach)
    known = np.isfinite(measured.level)
    levels = cells.gains(
        np.where(known, LEVEL_STD**-2, 0.0), np.where(known, measured.level, 0.0),
        -np.log1p(x**2), np.ones(1),
    )  # fmt: skip
    return np.where((shifts > 0) & (levels > -STEADIER), shifts + levels, 0.0)


def _apart(found: list[Together]) -> list[Together]:
    """Return the strongest of those that claim one time."""
    kept: list[Together] = []
    for one in sorted(found, key=lambda item: -item.gain):
        if all(
            abs(one.time_s - other.time_s) > APART * max(one.width_s, other.width_s)
            for other in kept
        ):
            kept.append(one)
    return kept


FEWEST_POINTS, SMALLEST_FALL = 5, 0.01
"""Measurements of a line, and fall of its logarithm of frequency, from which it falls."""


class LineFall(NamedTuple):
    """Where a line falls as by a closest approach."""

    time_s: float
    """Where it falls fastest, s."""
    width_s: float
    """Half of its fall over the slope there: R/v of a passage, s."""
    fall: float
    """Fall of the logarithm of its frequency."""
    contact: int
    """Contact of the line."""


def line_falls(lines: Lines) -> list[LineFall]:
    """Return where each line falls, first where the lines beside it fall by most in all.

    Parameters
    ----------
    lines
        Tracked lines.
    """
    found = []
    for line, contact in zip(lines.line_id, lines.line_contact, strict=True):
        points = np.flatnonzero(lines.line == line)
        frequency = np.asarray(lines.measured_frequency_hz[points], float)
        known = np.isfinite(frequency) & (frequency > 0)
        if contact < 1 or np.count_nonzero(known) < FEWEST_POINTS:
            continue
        time_s, log = np.asarray(lines.time_s[points])[known], np.log(frequency[known])
        smooth = np.convolve(log, np.full(3, 1 / 3), "valid")
        slope = np.gradient(smooth, time_s[1:-1])
        steepest = int(np.argmin(slope))
        fall = float(smooth[: steepest + 1].max() - smooth[steepest:].min())
        if fall < SMALLEST_FALL or slope[steepest] >= 0.0:
            continue
        width_s = 0.5 * fall / -float(slope[steepest])
        found.append(LineFall(float(time_s[1 + steepest]), width_s, fall, int(contact)))
    if not found:
        return []
    time_s, width_s, fall, _ = np.array(found).T
    beside = np.abs(time_s[:, None] - time_s) < np.maximum(width_s[:, None], width_s)
    return [found[k] for k in np.argsort(-(beside @ fall), kind="stable")]
