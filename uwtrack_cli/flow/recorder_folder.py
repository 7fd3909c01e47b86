"""Files of recorders: recognised, put in order, cut into parts with overlap.

**Method.** A file belongs to the recorder of its folder or sensor, with its sample rate
and channels. Files of a recorder whose times follow each other are one recording. A
file that begins before the one before it has ended belongs to another recording: a
clock was set back, or two recorders write into one folder. Of several recordings that
a file could go on with, it follows the one that ended when it begins.

A long recording is cut into parts, one per UTC day or per file. A part reads some sound
before and after its own span, so that a passage near the cut is whole in it, and keeps
the closest approaches within its span and ``GUARD_S`` beside it. One within that of a
cut may stand in both parts, whichever side of the cut their estimates lie on; whoever
counts passages counts it once (`distinct_passages`).

**Conventions.** Times are ns since 1970-01-01 UTC.
"""

import itertools
import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.recording import GUARD_S
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import UwtrackError
from uwtrack_cli.files.audio.opening import sound_facts
from uwtrack_cli.files.audio.start_time import find_start_utc_ns
from uwtrack_cli.files.tables.sensors import find_sensor
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.motion.association import PassageReport, same_vessel

Cut = Literal["day", "file"]

SLACK_S = 1.0
MAX_GAP_S = 600.0
"""Files further apart than this are recordings of their own."""

OVERLAP_S = 900.0
"""Sound before and after its own span that a part reads, s."""

DAY_NS = 86_400 * NANOSECONDS

T = TypeVar("T")


@dataclass(frozen=True)
class Joining:
    """How files of a recorder are joined, and cut again."""

    max_gap_s: float = MAX_GAP_S
    """Longest gap within a joined recording, s."""
    slack_s: float = SLACK_S
    """Difference from UTC up to which a file directly follows the one before it, s."""
    per: Cut | None = None
    """What is made one product each; None joins whatever follows."""
    overlap_s: float = OVERLAP_S
    """Sound beside its own span that a part reads, s."""


@dataclass(frozen=True)
class Span:
    """When a file was recorded, on which kind of recorder."""

    recorder: tuple[Hashable, ...]
    """What tells recorders apart: folder or sensor, sample rate, channels."""
    start_utc_ns: int
    """First sample, ns since 1970-01-01 UTC."""
    duration_s: float
    """Length of the file, s."""

    @property
    def end_utc_ns(self) -> int:
        """UTC after its last sample."""
        return self.start_utc_ns + round(self.duration_s * NANOSECONDS)


@dataclass(frozen=True)
class Part:
    """Files that make one product."""

    files: tuple[int, ...]
    """Numbers of the files, in order of time."""
    own_ns: tuple[int, int] | None = None
    """Begin and end of its own span; None is everything."""
    first: int | None = None
    """Number of the first file of its own span; None is that of all."""
    label: str = ""
    """What names it among the parts of its recorder."""


def find_span(path: Path, options: Mapping[str, Any]) -> Span | None:
    """Return when a file was recorded, None where nothing tells.

    ``options``: how it is opened: sensor, time_pattern and time_zone.
    """
    try:
        facts = sound_facts(path)
        sensor = find_sensor(path, options.get("sensor"))
        start = find_start_utc_ns(
            path,
            time_pattern=options.get("time_pattern"),
            time_zone=options.get("time_zone") or "UTC",
        )
    except UwtrackError:
        return None  # its own job tells what is wrong with it
    if start is None:
        return None
    owner = (str(path.parent),) if sensor is None else _facts(sensor)
    recorder = (owner, facts.sample_rate_hz, facts.n_channels)
    return Span(recorder, start, facts.n_samples / facts.sample_rate_hz)


def group_spans(
    spans: Sequence[Span], max_gap_s: float = MAX_GAP_S, slack_s: float = SLACK_S
) -> list[tuple[int, ...]]:
    """Group files that follow each other on the same recorder.

    ``max_gap_s``: longest gap within a group, s. ``slack_s``: difference from UTC up to
    which a file directly follows another, s.

    Returned: indices of the files of each group, in order of time.
    """
    order = sorted(range(len(spans)), key=lambda k: spans[k].start_utc_ns)
    groups: list[list[int]] = []
    of_recorder: dict[Hashable, list[list[int]]] = {}
    for k in order:
        known = of_recorder.setdefault(spans[k].recorder, [])
        gaps_s = [_gap_s(spans[group[-1]], spans[k]) for group in known]
        fitting = [n for n, gap in enumerate(gaps_s) if -slack_s <= gap <= max_gap_s]
        if fitting:
            known[min(fitting, key=lambda n: abs(gaps_s[n]))].append(k)
        else:
            known.append([k])
            groups.append(known[-1])
    return [tuple(group) for group in groups]


def plan_parts(spans: Sequence[Span], joining: Joining) -> list[Part]:
    """Return the products that files of recorders are made into.

    ``joining``: how they are joined and cut.
    """
    groups = group_spans(spans, joining.max_gap_s, joining.slack_s)
    if joining.per is None:
        return [Part(group) for group in groups]
    if joining.per == "day":  # a gap does not part a day
        groups = group_spans(spans, math.inf, joining.slack_s)
    return [part for group in groups for part in _cut(spans, group, joining.per, joining.overlap_s)]


def remarks(
    paths: Sequence[Path], spans: Sequence[Span], joining: Joining, *, is_joined: bool
) -> Iterator[str]:
    """Yield what a folder holds, in words: what follows, gaps, clocks and rates.

    ``is_joined``: whether they are; else the option that does so is named.
    """
    max_gap_s = joining.max_gap_s
    if is_joined and joining.per == "day":  # a gap does not part a day
        max_gap_s = math.inf
    groups = group_spans(spans, max_gap_s, joining.slack_s)
    for group in groups:
        if len(group) > 1:
            yield _follows(paths, spans, group, joining.slack_s, is_joined=is_joined)
    for one, other in _neighbours(spans, groups):
        a, b = spans[one[-1]], spans[other[0]]
        name = paths[other[0]].name
        if a.recorder == b.recorder and b.start_utc_ns < a.end_utc_ns:
            back_s = -_gap_s(a, b)
            yield (
                f"{name} begins {back_s:.1f} s before {paths[one[-1]].name} ends: a "
                f"clock was set back, or two recorders write here; they are not joined."
            )
        elif a.recorder[0] == b.recorder[0] and a.recorder[1] != b.recorder[1]:
            yield (
                f"the sample rate changes from {a.recorder[1]} to {b.recorder[1]} Hz "
                f"at {name}: they are not joined."
            )


@dataclass(frozen=True)
class OwnSpan:
    """What a part of a recording counts the passages of, and what it was made of."""

    begin_ns: int
    """Begin of the span."""
    end_ns: int
    """End of the span."""
    files: frozenset[str]
    """Its files; parts that share one are of one recording."""

    def is_before(self, other: "OwnSpan") -> bool:
        """Tell whether another part begins where this one ends."""
        return self.end_ns == other.begin_ns and bool(self.files & other.files)


def distinct_passages(
    parts: Sequence[Sequence[T]],
    owns: Sequence[OwnSpan | None],
    time_of: Callable[[T], tuple[int, float] | None],
) -> list[list[T]]:
    """Return the passages of parts of recordings, each of them once.

    Of two that are the same, that one stays which lies in its part's own span; if both
    do, or none, that of the earlier part.

    ``owns``: what each part counts; None is a whole recording. ``time_of``: time of a
    passage, ns, and its standard deviation, s; None if it is unknown.
    """
    kept: list[list[T]] = [list(part) for part in parts]
    for chain in _chains(owns):
        known: list[_Counted[T]] = []
        for number, own in chain:
            guard_ns = 2 * round(GUARD_S * NANOSECONDS)
            known = [k for k in known if k.time_ns > own.begin_ns - guard_ns]
            free, kept[number] = list(known), []
            for passage in parts[number]:
                time = time_of(passage)
                if time is None:
                    kept[number].append(passage)
                    continue
                is_inside = own.begin_ns <= time[0] < own.end_ns
                new = _Counted(*time, passage, number, is_inside)
                twin = _twin(new, free)
                if twin is not None:
                    free.remove(twin)
                    if twin.is_inside or not is_inside:
                        continue
                    known.remove(twin)
                    kept[twin.part].remove(twin.passage)
                known.append(new)
                kept[number].append(passage)
    return kept


@dataclass(frozen=True, eq=False)
class _Counted(Generic[T]):
    """A passage that counts."""

    time_ns: int
    """Its time."""
    time_std_s: float
    """Standard deviation of the time, s."""
    passage: T
    """The passage."""
    part: int
    """Number of the part that it is of."""
    is_inside: bool
    """Whether it lies in that part's own span."""


def _twin(new: _Counted[T], others: Sequence[_Counted[T]]) -> _Counted[T] | None:
    """Return the passage that is the same as one of a later part, if there is one."""

    def log_odds(other: _Counted[T]) -> float:
        apart_s = (other.time_ns - new.time_ns) / NANOSECONDS
        return same_vessel(
            PassageReport(apart_s, other.time_std_s), PassageReport(0.0, new.time_std_s)
        )

    best = max(others, key=log_odds, default=None)
    return best if best is not None and log_odds(best) > 0.0 else None


def _chains(owns: Sequence[OwnSpan | None]) -> Iterator[list[tuple[int, OwnSpan]]]:
    """Yield the parts of each recording in order of time, with their numbers."""
    chains: list[list[tuple[int, OwnSpan]]] = []
    numbered = [(n, own) for n, own in enumerate(owns) if own is not None]
    ended: dict[int, list[list[tuple[int, OwnSpan]]]] = {}
    for number, own in sorted(numbered, key=lambda item: item[1].begin_ns):
        fits = (c for c in ended.get(own.begin_ns, ()) if c[-1][1].is_before(own))
        chain = next(fits, None)
        if chain is None:
            chain = []
            chains.append(chain)
        chain.append((number, own))
        ended.setdefault(own.end_ns, []).append(chain)
    yield from chains


def _facts(sensor: Sensor) -> tuple[Hashable, ...]:
    return tuple(str(getattr(sensor, name)) for name in sensor.scalars())


def _gap_s(before: Span, after: Span) -> float:
    return (after.start_utc_ns - before.end_utc_ns) / NANOSECONDS


def _cut(
    spans: Sequence[Span], group: tuple[int, ...], per: Cut, overlap_s: float
) -> Iterator[Part]:
    """Yield the parts of a recording; the outer ones reach on without an end."""
    overlap_ns = round(overlap_s * NANOSECONDS)
    cuts = _cuts(spans, group, per)
    for k, (begin, end) in enumerate(cuts):
        inside = [n for n in group if _meets(spans[n], begin, end)]
        if not inside:
            continue
        read = [n for n in group if _meets(spans[n], begin - overlap_ns, end + overlap_ns)]
        own = (begin - (DAY_NS if k == 0 else 0), end + (DAY_NS if k == len(cuts) - 1 else 0))
        label = format_utc(begin)[:10] if per == "day" else ""
        yield Part(tuple(read), own, inside[0], label)


def _cuts(spans: Sequence[Span], group: tuple[int, ...], per: Cut) -> list[tuple[int, int]]:
    starts = [spans[n].start_utc_ns for n in group]
    last = max(spans[n].end_utc_ns for n in group)
    if per == "day":
        days = range(starts[0] // DAY_NS, (last - 1) // DAY_NS + 1)
        return [(day * DAY_NS, (day + 1) * DAY_NS) for day in days]
    return list(zip(starts, [*starts[1:], last], strict=True))


def _meets(span: Span, begin: int, end: int) -> bool:
    return span.start_utc_ns < end and span.end_utc_ns > begin


def _follows(
    paths: Sequence[Path],
    spans: Sequence[Span],
    group: tuple[int, ...],
    slack_s: float,
    *,
    is_joined: bool,
) -> str:
    pairs = itertools.pairwise(group)
    gaps = [gap for a, b in pairs if (gap := _gap_s(spans[a], spans[b])) > slack_s]
    with_gaps = "without a gap"
    if gaps:
        word = "gap" if len(gaps) == 1 else "gaps"
        with_gaps = f"with {len(gaps)} {word} of {sum(gaps):.1f} s together"
    text = f"{len(group)} files from {paths[group[0]].name} on follow each other {with_gaps}"
    if is_joined:
        return f"{text}."
    return f"{text}: --join makes one recording of them, --join --per day one a day."


def _neighbours(
    spans: Sequence[Span], groups: Sequence[tuple[int, ...]]
) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Yield the recordings of one recorder that follow each other, pair by pair."""
    of_owner: dict[Hashable, list[tuple[int, ...]]] = {}
    for group in groups:
        of_owner.setdefault(spans[group[0]].recorder[0], []).append(group)
    for own in of_owner.values():
        yield from itertools.pairwise(own)
