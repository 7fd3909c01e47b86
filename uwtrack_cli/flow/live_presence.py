"""What is heard while live sound comes: segments, told as they begin and as they end.

**Method.** Every look at the last of the sound gives a table of presence of its own. A
row of it is the same segment as one that was told when both share time and a spacing,
half of the lines or half of the rates; a rise without any is known by its time alone. A
segment is told when it is first seen, again when something new is known of it, and as
final when it has been over for some minutes and the longest look has decided.

**Conventions.** What noise alone may give (`unknown`, or a probability of chance above
``GREATEST_CHANCE``) is not told before the end: there are hundreds of looks in an hour.
A rise of the level is told when the look holds as much sound on either side of it as it
is long. Lines break off where they fall fast: such as begin beside those of a segment that
goes on or has just ended, and no further from them than a vessel's speed shifts them, may be
its own after the closest approach, and are told by themselves when they have lasted
``HELD_S`` without having been joined to it. ``segment`` numbers what was told in its order; ``encounter`` is the contact of
the closest approach as it was told.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uwtrack_cli.data.presence import UNKNOWN

Event = dict[str, Any]

GREATEST_CHANCE = 1e-3
"""Probability in noise alone above which a segment is told at the end alone."""

OVER_S = 300.0
"""A segment that was not heard for so long is over, s."""

GAP_S = 60.0
"""Two rows with more time than this between them are two segments, s."""

SAME_SPACING = 0.01
"""Relative difference of two spacings that are one."""

SAME_SHARE = 0.5
"""Share of the lines of the shorter list that two rows of one segment share."""

LINE_REACH = {"frequencies_hz": (5e-3, 0.5), "rates_hz": (4e-3, 0.05)}
"""Relative and absolute distance, Hz, of two lines or rates that are one."""

HELD_S = 60.0
"""Time for which lines that may be those of a segment that was told are held back, s."""

FALL = 0.02
"""Relative fall of lines at a passage of 15 m/s."""

NOT_CONFIRMED = "more sound does not confirm it"
NOT_DECIDED = "its closest approach is not decided yet"


@dataclass
class _Told:
    """A segment that was told."""

    row: Event
    """What is known of it now."""
    said: Event
    """What was said of it last."""
    number: int
    """Its number."""
    segment_s: float
    """Length of the look that knows it, s."""
    revision: int = 0
    """How often it was told anew."""
    is_final: bool = False
    """Whether later sound cannot change it."""
    is_withdrawn: bool = False
    """Whether more sound has not confirmed it."""

    def withdraw(self) -> None:
        """Tell it as something that is not known."""
        reasons = {**self.row["reasons"], "encounter": NOT_CONFIRMED}
        self.row = {**self.row, "kind": UNKNOWN, "encounter": None, "reasons": reasons}
        self.is_withdrawn = True


class LivePresence:
    """The segments that were told, each with its last values.

    ``say``: takes the kind of an event, its time, its facts, its revision, and whether
    it is final.
    """

    def __init__(self, say: Callable[..., None]) -> None:
        self._say = say
        self._known: list[_Told] = []

    def see(self, rows: Sequence[Event], span_s: tuple[float, float], segment_s: float) -> None:
        """Take the rows of a look.

        ``rows``: rows of its presence, their closest approaches named as they were
        told. ``span_s``: where its sound begins and ends, s from the first sample.
        ``segment_s``: how long it is at most, s: longer looks know more.
        """
        wanted = [row for row in rows if _is_certain(row) and _is_inside(row, span_s)]
        found = _paired(wanted, self._open())
        for told, row in found:
            known = told.row
            both = _lasting(known, row)
            longer = segment_s >= told.segment_s or row["n_lines"] > known["n_lines"]
            told.row = both(row if longer else known)
            told.segment_s = max(told.segment_s, segment_s)
            if _is_news(told.row, told.said):
                self._revise(told)
        paired = [id(row) for _, row in found]
        for row in wanted:
            if id(row) in paired or any(_are_one(row, t.row) for t in self._known):
                continue
            is_new = span_s[1] - row["from_s"] < HELD_S
            if is_new and any(_may_go_on(t.row, row) for t in self._open()):
                continue
            self._known.append(_Told(row, row, 1 + len(self._known), segment_s))
            self._tell(self._known[-1])

    def some_are_due(self, now_s: float) -> bool:
        """Tell whether a segment is over and waits to be decided."""
        return any(now_s - told.row["to_s"] >= OVER_S for told in self._open())

    def decide(self, rows: Sequence[Event], now_s: float) -> None:
        """Decide what is over by what the longest look shows."""
        found = {id(told): row for told, row in _paired(rows, self._open())}
        for told in self._open():
            row = found.get(id(told))
            if row is not None:
                told.row = _lasting(told.row, row)(row)
            if now_s - told.row["to_s"] >= OVER_S:
                told.is_final = True
                if row is None:
                    told.withdraw()
                self._revise(told)

    def finish(self, rows: Sequence[Event]) -> None:
        """Tell what the whole sound says otherwise, or for the first time."""
        found = _paired(rows, self._known)
        paired = [id(row) for _, row in found]
        rows_of = {id(told): row for told, row in found}
        for told in self._known:
            row = rows_of.get(id(told))
            was_final, told.is_final = told.is_final, True
            if row is not None:
                told.row = row
            elif any(_are_one(told.row, other) for other in rows):
                row = told.row  # a part of a longer one
            elif not told.is_withdrawn:
                told.withdraw()
                was_final = False
            if not was_final or (row is not None and _is_news(row, told.said)):
                self._revise(told)
        for row in rows:
            if id(row) not in paired:
                new = _Told(row, row, 1 + len(self._known), np.inf, is_final=True)
                self._known.append(new)
                self._tell(new)

    def _open(self) -> list[_Told]:
        return [told for told in self._known if not told.is_final]

    def _revise(self, told: _Told) -> None:
        told.said, told.revision = told.row, told.revision + 1
        self._tell(told)

    def _tell(self, told: _Told) -> None:
        facts = {**told.row, "segment": told.number}
        del facts["contact"]  # a tracker's number, which another look does not know
        self._say("presence", facts["from_s"], facts, told.revision, is_final=told.is_final)


def with_told_encounter(row: Event, contacts: Mapping[int, int]) -> Event:
    """Return a row whose closest approach is named as it was told.

    ``contacts``: contact that was told, for each one of the table that the row came
    with.
    """
    own = row["encounter"]
    told = None if own is None else contacts.get(own)
    reasons = dict(row["reasons"])
    if own is not None and told is None:
        reasons["encounter"] = NOT_DECIDED
    return {**row, "encounter": told, "reasons": reasons}


def _is_certain(row: Event) -> bool:
    chance = row["probability_of_chance"]
    return row["kind"] != UNKNOWN and (chance is None or chance <= GREATEST_CHANCE)


def _is_inside(row: Event, span_s: tuple[float, float]) -> bool:
    if _has_lines(row):
        return True
    length_s = row["to_s"] - row["from_s"]
    begin_s, end_s = max(0.0, row["from_s"] - length_s), row["to_s"] + length_s
    return bool(span_s[0] <= begin_s and end_s <= span_s[1])


def _has_lines(row: Event) -> bool:
    return bool(row["frequencies_hz"] or row["rates_hz"])


def _lasting(one: Event, other: Event) -> Callable[[Event], Event]:
    """Return what gives a row the time of both."""
    first = min((one, other), key=lambda row: row["from_s"])
    last = max((one, other), key=lambda row: row["to_s"])
    times = {key: first[key] for key in ("from_s", "from_utc")}
    times |= {key: last[key] for key in ("to_s", "to_utc")}
    return lambda row: {**row, **times}


def _is_news(row: Event, said: Event) -> bool:
    """Tell whether something is known that was not said: more time is no news."""
    if (row["kind"], row["encounter"]) != (said["kind"], said["encounter"]):
        return True
    for key in ("spacing_hz", "blade_rate_hz"):
        new, old = row[key], said[key]
        if (new is None) != (old is None):
            return True
        if new is not None and abs(new / old - 1.0) > SAME_SPACING:
            return True
    return any(len(row[key]) >= 1.5 * len(said[key]) + 1 for key in ("frequencies_hz", "rates_hz"))


def _are_one(row: Event, other: Event) -> bool:
    """Tell whether two rows are of one segment."""
    if _between_s(row, other) > GAP_S:
        return False
    if _has_lines(row) != _has_lines(other):
        return row["encounter"] is not None and row["encounter"] == other["encounter"]
    if not _has_lines(row):
        return True
    spacings = row["spacing_hz"], other["spacing_hz"]
    if None not in spacings and abs(spacings[0] / spacings[1] - 1.0) < SAME_SPACING:
        return True
    return any(_shared(row[key], other[key], *LINE_REACH[key]) for key in LINE_REACH)


def _may_go_on(row: Event, later: Event) -> bool:
    """Tell whether lines may be those of a row, fallen at a closest approach."""
    own, others = np.array(row["frequencies_hz"]), later["frequencies_hz"]
    if not (own.size and others) or later["rates_hz"]:
        return False
    if _between_s(row, later) > GAP_S or later["from_s"] <= row["from_s"]:
        return False
    falls = 1.0 - np.divide.outer(np.array(others), own)
    return bool(((falls > 0.0) & (falls < FALL)).any(axis=1).all())


def _between_s(row: Event, other: Event) -> float:
    """Return the time between two rows; what they share counts below zero."""
    begin_s = max(row["from_s"], other["from_s"])
    return float(begin_s - min(row["to_s"], other["to_s"]))


def _shared(
    own: Sequence[float], others: Sequence[float], relative: float, least_hz: float
) -> bool:
    if not own or not others:
        return False
    few, many = sorted((own, others), key=len)
    apart = np.abs(np.subtract.outer(np.array(few), np.array(many))).min(axis=1)
    near = apart <= np.maximum(relative * np.array(few), least_hz)
    return bool(near.mean() >= SAME_SHARE)


def _paired(rows: Sequence[Event], known: Sequence[_Told]) -> list[tuple[_Told, Event]]:
    """Pair rows with segments one to one, those that share the most time first."""
    near = sorted(
        (_between_s(row, told.row), k, n)
        for n, row in enumerate(rows)
        for k, told in enumerate(known)
        if _are_one(row, told.row)
    )
    found: list[tuple[_Told, Event]] = []
    taken: tuple[set[int], set[int]] = (set(), set())
    for _, k, n in near:
        if k not in taken[0] and n not in taken[1]:
            found.append((known[k], rows[n]))
            taken[0].add(k)
            taken[1].add(n)
    return found
