"""What a closest approach explains of what was heard, and what was refused as one.

**Method.** A passage is told by lines of one tracker, but trackers of other frames hear
the same vessel: as whole lines, or as pieces before and after what they cannot resolve.
A line is the passage's where its mean frequency is the mean of a rest frequency under
the passage's Doppler shift over the life of the line. A family, or lines that move
together, are hers as a whole when most of them are, or most of her rest frequencies are
among them; of lines that nothing joins, those that are hers are taken out. What she
explains is no row of its own, and no candidate that was refused for it is.

**Conventions.** Times count from the first sample. The law is that of a straight
passage, in time of arrival.

**References.** Quinn (1995) for the Doppler law of a passage.
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.presence import BROADBAND, HUM, LINES, UNKNOWN, VESSEL
from uwtrack_cli.lines.rungs.same_line import SAME_LINE
from uwtrack_cli.presence.line_summary import LineSummary
from uwtrack_cli.presence.segment import SoundSegment, segment_of_lines

PASSAGE_WIDTHS = 2.0
"""Ranges over speed on either side of a closest approach for which it is heard, where no
line tells."""

LINE_WIDTHS, LEAST_LINE_S = 5.0, 30.0
"""The same within which a line may be hers, and at least so many seconds."""

SAME_LINE_SHARE = 0.003
"""Distance of a line's mean frequency from the expected one up to which both are one,
relative to the frequency; that of two lines is added."""


class _Passage(NamedTuple):
    """A closest approach, as far as its lines are concerned."""

    contact: int
    """Contact."""
    time_s: float
    """Time of arrival of the closest approach, s."""
    width_s: float
    """Range over speed, s."""
    speed_share: float
    """Speed over sound speed."""
    speed_share_std: float
    """Its standard deviation."""
    rest_hz: FloatArray
    """Rest frequencies, Hz, shape (line,)."""

    @classmethod
    def of_row(cls, table: Encounters, row: int) -> Self:
        """Return a row of a table; unknown values count as zero."""
        time_s = np.nan_to_num(table.arrival_time_s[row], nan=table.time_s[row])
        sound_mps = float(table.sound_speed_mps[row])
        return cls(
            int(table.contact[row]),
            float(time_s),
            float(np.nan_to_num(table.range_over_speed_s[row])),
            float(np.nan_to_num(table.speed_mps[row])) / sound_mps,
            float(np.nan_to_num(table.speed_std_mps[row])) / sound_mps,
            table.rest_frequency_hz[table.rest_encounter == row],
        )

    def match(self, tones: LineSummary) -> BoolArray:
        """Tell which lines are which of her rest frequencies, shape (line, rest)."""
        width_s = max(self.width_s, 1e-3)
        begin = (tones.from_s - self.time_s) / width_s
        end = (tones.to_s - self.time_s) / width_s
        life = np.maximum(end - begin, 1e-9)
        # mean and mean square of s = u / sqrt(1 + u^2), the share of the speed along the
        # line of sight; 1 / (1 + x s) is (1 - x s) / (1 - (x s)^2)
        mean = (np.sqrt(1 + end**2) - np.sqrt(1 + begin**2)) / life
        square = 1.0 - (np.arctan(end) - np.arctan(begin)) / life
        ratio = (1 - self.speed_share * mean) / (1 - self.speed_share**2 * square)
        expected_hz = ratio[:, None] * self.rest_hz
        reach_hz = (SAME_LINE_SHARE + self.speed_share_std) * expected_hz
        reach_hz += SAME_LINE * tones.resolution_hz[:, None]
        reach_s = max(LEAST_LINE_S, LINE_WIDTHS * self.width_s)
        near = (tones.from_s < self.time_s + reach_s) & (tones.to_s > self.time_s - reach_s)
        off_hz = np.abs(tones.frequency_hz[:, None] - expected_hz)
        matched: BoolArray = near[:, None] & (off_hz < reach_hz)
        return matched


def mark_passages(table: Encounters, found: list[SoundSegment]) -> None:
    """Mark what passed; a passage that nothing else tells of gets a row."""
    for row in range(table.n_encounters):
        passage = _Passage.of_row(table, row)
        reach_s = PASSAGE_WIDTHS * passage.width_s
        from_s, to_s = passage.time_s - reach_s, passage.time_s + reach_s
        middle = (0.5 * (from_s + passage.time_s), 0.5 * (passage.time_s + to_s))
        own = [
            one
            for one in found
            if _has_lines(one, passage) or (_is_free_rise(one) and one.overlaps(*middle))
        ]
        for one in own:
            one.kind = VESSEL
        loose, chance = _loose_lines(found, passage)
        heard = [one for one in own if one.tones is not None]
        if loose and heard:
            heard[0].hold(LineSummary.join([*_tones(heard[:1]), *loose]))
        elif loose:
            own.append(segment_of_lines(VESSEL, LineSummary.join(loose), chance, ""))
            found.append(own[-1])
        if not own:
            own = [
                SoundSegment(
                    kind=VESSEL,
                    from_s=from_s,
                    to_s=to_s,
                    level_db=float(table.received_level_db[row]),
                    bearing_deg=float(table.bearing_deg[row]),
                    bearing_std_deg=float(table.bearing_std_deg[row]),
                )
            ]
            found += own
        for one in own:
            one.encounter = one.contact = passage.contact
            one.read_as(*table.reading_of(row))


def _is_free_rise(segment: SoundSegment) -> bool:
    """Tell whether a rise of the level alone is no passage's yet."""
    return segment.tones is None and not segment.rates_hz and not segment.encounter


def _has_lines(segment: SoundSegment, passage: _Passage) -> bool:
    """Tell whether a family, or lines that move together, are a passage's."""
    if segment.tones is None or segment.kind != VESSEL:
        return False
    if passage.contact in segment.contacts:
        return True
    if segment.encounter or not passage.rest_hz.size:
        return False
    match = passage.match(segment.tones)
    share = max(match.any(axis=0).mean(), match.any(axis=1).mean())
    return bool(share > 0.5)


def _tones(segments: Sequence[SoundSegment]) -> list[LineSummary]:
    return [one.tones for one in segments if one.tones is not None]


def _loose_lines(found: list[SoundSegment], passage: _Passage) -> tuple[list[LineSummary], float]:
    """Take the passage's lines out of those that nothing joins, with their chance."""
    taken: list[LineSummary] = []
    chance = 1.0
    for one in list(found):
        if one.kind not in {LINES, UNKNOWN} or one.tones is None:
            continue
        is_own = one.tones.contact == passage.contact
        is_own |= passage.match(one.tones).any(axis=1)
        if not is_own.any():
            continue
        taken.append(one.tones.take(np.flatnonzero(is_own)))
        chance = min(chance, one.probability_of_chance)
        if is_own.all():
            found.remove(one)
        else:
            one.hold(one.tones.take(np.flatnonzero(~is_own)))
    return taken, chance


def add_refusals(table: Encounters, found: list[SoundSegment]) -> None:
    """Give every refused candidate's reason to its segment, or a row of its own.

    A candidate whose lines, or whose time without any, a passage explains has none:
    passages are marked before.
    """
    for contact, from_s, to_s, reason in table.refusals():
        lines = [one for one in found if contact in one.contacts and one.kind != HUM]
        rises = [
            one
            for one in found
            if one.kind in {BROADBAND, UNKNOWN}
            and one.tones is None
            and not one.rates_hz
            and one.overlaps(from_s, to_s)
        ]
        own = [one for one in lines if not one.encounter] or ([] if lines else rises)
        for one in own:
            one.reason = reason
        is_explained = bool(lines) or _passes(table, from_s, to_s)
        if not own and not is_explained:
            found.append(SoundSegment(kind=UNKNOWN, from_s=from_s, to_s=to_s, reason=reason))


def add_readings(table: Encounters, found: list[SoundSegment]) -> None:
    """Give the segments without a passage what all of their contacts are read as."""
    read = {one.contact: one for one in table.still()}
    for segment in found:
        own = [read[contact] for contact in segment.contacts if contact in read]
        is_whole = len(own) == len(segment.contacts) and len({o.reading for o in own}) == 1
        if segment.encounter or not is_whole:
            continue
        least = min(own, key=lambda one: one.weight)
        segment.read_as(least.reading, least.weight, least.rival, least.rival_weight)


def _passes(table: Encounters, from_s: float, to_s: float) -> bool:
    time_s = np.where(np.isfinite(table.arrival_time_s), table.arrival_time_s, table.time_s)
    return bool(((time_s >= from_s) & (time_s <= to_s)).any())
