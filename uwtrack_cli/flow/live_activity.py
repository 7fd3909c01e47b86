"""Where the last of live sound holds something that a look could find.

**Method.** A closest approach, and everything else that is told, comes from lines that
were followed, from rises of seconds, or from a level that stands above the rest for some
frames. Each gives a span of time; where there is none, the fits would find nothing, and
are not made. The level is averaged over runs of 4, 8, 16, ... frames that overlap by
half, and a run counts that stands above the median by ``LEAST_SPREADS`` of its
deviation, which is that of neighbouring frames. What counted in shorter runs counts no
more in longer ones, which would stand above the median for its sake alone; runs that
are no further apart than the longer one lasts are one span. Noise of independent frames
has few such runs in an hour; where the level wanders there are many, and nothing is
saved.

A look at a segment is worth its cost when such a span has not ended long before the last
look at it, and is longer, and reaches further, than what a shorter segment shows as well.
Lines of a passage that was told, and the level beside it, are looked at once in its d/v,
by the shortest segment that holds it: what the same vessel does next lasts as long. They
are not looked at when it is final, unless they go on.

**Conventions.** Lines of no contact, such as hum, pass nothing: their beginning alone
counts. Levels with bearings, and whatever else a step reads, count throughout.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, Container, FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.data.transients import Transients

LEAST_SPREADS = 3.9
"""Height of a run of frames from which it counts, in deviations of its mean. A passage
that the level alone shows gains ln(2 N / 0.001) nepers or more, with N up to 400
instants: 5.2 deviations along its own shape, of which the best run keeps three quarters
or more."""

FEWEST_FRAMES = 4
"""Frames of the shortest run."""

AFTER_SHARE = 0.1
"""Share of a segment for which sound after a span still tells more of it."""

BEYOND_SHARE = 0.8
"""Share of the next shorter segment beyond which a longer one shows more."""

LONG_SHARE = 0.125
"""Share of the next shorter segment that a span must last to be looked at in a longer
one: what is briefer has its flanks, of three times its length, in the shorter one."""

LINE_SHARE = 0.5
"""The same for a line, which has no flanks."""


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

    @property
    def long_share(self) -> float:
        """Share of the next shorter segment that it must last to need a longer one."""
        return LONG_SHARE if self.frequency_hz is None else LINE_SHARE

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
    needed_s: float = np.inf
    """From where on a segment must hold the sound to show it, s."""
    looked_s: float = -np.inf
    """Where the sound ended when a look showed it last, s."""
    is_final: bool = False
    """Whether later sound cannot change it."""

    def rests(self, span: "HeardSpan", now_s: float, last_s: float, from_s: float) -> bool:
        """Tell whether a span that it explains is not worth a look now.

        ``now_s``: where the sound ends, s. ``last_s``: where it ended when this segment
        was looked at last, s. ``from_s``: where the segment begins, s.
        """
        if not span.is_explained(self):
            return False
        if span.end_s > self.end_s:
            return now_s - last_s < self.every_s
        is_held = from_s <= self.needed_s
        return self.is_final or not is_held or now_s - self.looked_s < self.every_s


ALWAYS = HeardSpan(-np.inf, np.inf)


def spans_of(known: Iterable[Container]) -> list[HeardSpan]:
    """Return where something may be found.

    ``known``: what the steps before the fits have made of a segment of sound.
    """
    found: list[HeardSpan] = []
    for one in known:
        if isinstance(one, Lines):
            found += _of_lines(one)
        elif isinstance(one, Transients):
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
    segment_s: float,
    shorter_s: float,
    told: Sequence[ToldPassage] = (),
) -> bool:
    """Tell whether a look at the last segment of sound may find what is not known.

    Parameters
    ----------
    spans
        Where there is something to find.
    now_s
        Where the sound ends, s.
    last_s
        Where it ended when this segment was looked at last, s.
    segment_s
        Length of the segment, s.
    shorter_s
        Length of the next shorter segment, s; 0 for the shortest.
    told
        Passages that were told.
    """
    since_s = last_s - AFTER_SHARE * segment_s
    until_s = now_s - BEYOND_SHARE * shorter_s
    from_s = now_s - segment_s
    return any(
        span.end_s >= since_s
        and span.begin_s <= until_s
        and span.end_s - span.begin_s >= span.long_share * shorter_s
        and not any(one.rests(span, now_s, last_s, from_s) for one in told)
        for span in spans
    )


def _of_lines(lines: Lines) -> list[HeardSpan]:
    found = []
    passing = set(lines.line_id[lines.line_contact > 0].tolist())
    for line in np.unique(lines.line).tolist():
        own = lines.line == line
        begin_s, end_s = float(lines.time_s[own].min()), float(lines.time_s[own].max())
        frequency_hz = float(np.median(lines.frequency_hz[own]))
        found.append(HeardSpan(begin_s, end_s if line in passing else begin_s, frequency_hz))
    return found


def _of_levels(levels: Levels) -> list[HeardSpan]:
    known = np.isfinite(levels.excess_db)
    time_s, excess_db = levels.frames.time_s[known], levels.excess_db[known]
    if excess_db.size < 2:
        return []
    above = excess_db - np.median(excess_db)
    spread = 1.4826 * float(np.median(np.abs(np.diff(excess_db)))) / np.sqrt(2.0)
    counted = np.zeros(above.size, bool)
    length = FEWEST_FRAMES
    while length < above.size:
        first = np.arange(0, above.size - length + 1, length // 2)
        sums, numbers = (
            np.concatenate([[0.0], np.cumsum(values)])
            for values in (np.where(counted, 0.0, above), ~counted)
        )
        height = sums[first + length] - sums[first]
        n_new = numbers[first + length] - numbers[first]
        is_high = height > LEAST_SPREADS * spread * np.sqrt(n_new)
        for k in first[is_high & (n_new >= length // 2)].tolist():
            counted[k : k + length] = True
        length *= 2
    return _joined(counted, time_s)


def _joined(counted: BoolArray, time_s: FloatArray) -> list[HeardSpan]:
    """Return the spans of frames that counted, those that lie close as one."""
    steps = np.flatnonzero(np.diff(np.concatenate([[0], counted, [0]])))
    found: list[HeardSpan] = []
    for first, end in zip(steps[::2].tolist(), steps[1::2].tolist(), strict=True):
        begin_s, end_s = float(time_s[first]), float(time_s[end - 1])
        while found:
            lasts_s = max(end_s - begin_s, found[-1].end_s - found[-1].begin_s)
            if begin_s - found[-1].end_s > lasts_s:
                break
            begin_s = found.pop().begin_s
        found.append(HeardSpan(begin_s, end_s))
    return found
