"""Where the last of live sound holds something that a look could find.

**Method.** A closest approach, and everything else that is told, comes from lines that
were followed, from rises of seconds, or from a level that stands above the rest for some
frames. Each gives a span of time; where there is none, the fits would find nothing, and
are not made. The level is averaged over runs of 4, 8, 16, ... frames that overlap by
half, and a run counts that stands above the median by ``LEAST_SPREADS`` of its
deviation, which is that of neighbouring frames. Noise of independent frames has few
such runs in an hour; where the level wanders there are many, and nothing is saved.

A look at a stretch is worth its cost when such a span has not ended long before the last
look at it, and is longer, and reaches further, than what a shorter stretch shows as well.
Lines of a passage that was told, and the level beside it, are looked at once in its d/v:
what the same vessel does next lasts as long.

**Conventions.** Lines of no contact, such as hum, pass nothing: their beginning alone
counts. Levels with bearings, and whatever else a step reads, count throughout.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.rises import Rises
from uwtrack_cli.data.spectra import Levels

LEAST_SPREADS = 3.9
"""Height of a run of frames from which it counts, in deviations of its mean. A passage
that the level alone shows gains ln(2 N / 0.001) nepers or more, with N up to 400
instants: 5.2 deviations along its own shape, of which the best run keeps three quarters
or more."""

FEWEST_FRAMES = 4
"""Frames of the shortest run."""

AFTER_SHARE = 0.1
"""Share of a stretch for which sound after a span still tells more of it."""

BEYOND_SHARE = 0.8
"""Share of the next shorter stretch beyond which a longer one shows more."""

LONG_SHARE = 0.125
"""Share of the next shorter stretch that a span must last to be looked at in a longer
one: what is briefer has its flanks, of three times its length, in the shorter one."""


SAME_LINE = 0.02
"""Relative difference of a line from a rest frequency that is its own: 30 m/s."""


class HeardSpan(NamedTuple):
    """A time in which there is something to find."""

    begin_s: float
    """Where it begins, s from the first sample."""
    end_s: float
    """Where it ends, s."""
    frequency_hz: float | None = None
    """Frequency of its line, Hz; None for the level and for rises."""

    def is_explained(self, told: "ToldPassage") -> bool:
        """Tell whether it belongs to a passage that was told."""
        if self.begin_s > told.end_s or self.end_s < told.begin_s:
            return False
        if self.frequency_hz is None:
            return bool(np.isfinite(self.begin_s))
        ratios = np.array(told.rest_frequencies_hz) / self.frequency_hz
        return bool((np.abs(ratios - 1.0) < SAME_LINE).any())


class ToldPassage(NamedTuple):
    """A passage that was told, as far as it explains what is heard."""

    begin_s: float
    """From where on it is heard at least, s."""
    end_s: float
    """Up to where, s."""
    rest_frequencies_hz: tuple[float, ...]
    """Frequencies of its lines, Hz."""
    every_s: float
    """Time after which what it explains is worth another look, s."""


ALWAYS = HeardSpan(-np.inf, np.inf)


def spans_of(known: Iterable[Container]) -> list[HeardSpan]:
    """Return where something may be found.

    Parameters
    ----------
    known
        What the steps before the fits have made of a stretch of sound.
    """
    found: list[HeardSpan] = []
    for one in known:
        if isinstance(one, Lines):
            found += _of_lines(one)
        elif isinstance(one, Rises):
            half_s = one.half_length_s
            begins, ends = one.time_s - half_s, one.time_s + half_s
            found += map(HeardSpan, begins.tolist(), ends.tolist())
        elif isinstance(one, Levels) and not np.isfinite(one.bearing_deg).any():
            found += _of_levels(one)
        else:
            found.append(ALWAYS)
    return found


def is_worth_a_look(
    spans: Iterable[HeardSpan],
    now_s: float,
    last_s: float,
    stretch_s: float,
    shorter_s: float,
    told: Sequence[ToldPassage] = (),
) -> bool:
    """Tell whether a look at the last stretch of sound may find what is not known.

    Parameters
    ----------
    spans
        Where there is something to find.
    now_s
        Where the sound ends, s.
    last_s
        Where it ended when this stretch was looked at last, s.
    stretch_s
        Length of the stretch, s.
    shorter_s
        Length of the next shorter stretch, s; 0 for the shortest.
    told
        Passages that were told.
    """
    since_s = last_s - AFTER_SHARE * stretch_s
    until_s = now_s - BEYOND_SHARE * shorter_s
    least_s = LONG_SHARE * shorter_s
    resting = [one for one in told if now_s - last_s < one.every_s]
    return any(
        span.end_s >= since_s
        and span.begin_s <= until_s
        and span.end_s - span.begin_s >= least_s
        and not any(span.is_explained(one) for one in resting)
        for span in spans
    )


def _of_lines(lines: Lines) -> list[HeardSpan]:
    found = []
    passing = set(lines.line_id[lines.line_contact > 0].tolist())
    for line in np.unique(lines.line).tolist():
        own = lines.line == line
        begin_s, end_s = float(lines.time_s[own].min()), float(lines.time_s[own].max())
        frequency_hz = float(np.median(lines.frequency_hz[own]))
        found.append(
            HeardSpan(begin_s, end_s if line in passing else begin_s, frequency_hz)
        )
    return found


def _of_levels(levels: Levels) -> list[HeardSpan]:
    known = np.isfinite(levels.excess_db)
    time_s, excess_db = levels.frames.time_s[known], levels.excess_db[known]
    if excess_db.size < 2:
        return []
    above = excess_db - np.median(excess_db)
    spread = 1.4826 * float(np.median(np.abs(np.diff(excess_db)))) / np.sqrt(2.0)
    sums = np.concatenate([[0.0], np.cumsum(above)])
    found: list[HeardSpan] = []
    length = FEWEST_FRAMES
    while length < excess_db.size:
        first = np.arange(0, excess_db.size - length + 1, length // 2)
        height = (sums[first + length] - sums[first]) / np.sqrt(length)
        high = first[height > LEAST_SPREADS * spread]
        begins, ends = time_s[high].tolist(), time_s[high + length - 1].tolist()
        found += map(HeardSpan, begins, ends)
        length *= 2
    return found
