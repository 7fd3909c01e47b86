"""What is told of live sound while it comes: lines, presence, closest approaches, gaps.

**Method.** At fixed times of the sound the scans of a recipe are asked what they would
have found if it ended now, and the whole stages are run over the last of it: often over
short segments, which hold the passages of small ``range_over_speed_s`` (d/v), and seldom
over long ones; not at all where nothing can be found (`live_activity`). A scan that cannot
tell is run anew over the blocks that it took, which are kept for ``RING_S`` seconds. What
a segment shows is told as provisional as soon as the closest approach lies d/v behind.
When 4 d/v and a minute have passed, the longest segment decides, and what is told is
final. The product is made from the whole sound, whatever was told.

**Conventions.** Everything depends on the sound alone, never on the clock: the same
sound gives the same events. An event is told again, with the next ``revision``, when a
value has moved by its deviation or the deviation has shrunk by a third.
"""

import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import COASTED, Lines
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.live_reader import UNCHANGED_S, DisturbedSource
from uwtrack_cli.files.tables.json_rows import json_rows, plain
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.flow.engine import Engine, MemorySink, OpenScan, context_of
from uwtrack_cli.flow.graph import Graph
from uwtrack_cli.flow.live_activity import ALWAYS, ToldPassage, is_worth_a_look, spans_of
from uwtrack_cli.flow.live_presence import LivePresence, with_told_encounter
from uwtrack_cli.flow.step import Step
from uwtrack_cli.motion.association import PassageReport, same_vessel

Event = dict[str, Any]
"""A JSON object: ``event`` names its kind, ``revision`` and ``final`` its state."""

Tell = Callable[[Event], None]
"""Takes an event as soon as it is decided."""

STRETCHES_S = {160.0: 20.0, 400.0: 60.0, 1000.0: 140.0, 2500.0: 300.0}
"""Segments of sound that are looked at, and how often at most: 2500 s hold 4 times the
longest d/v, 600 s. A segment S shows passages up to d/v = (S - 30 s) / 3 in time; so the
next one is due within 30 s and that d/v, less the 12 s by which blocks are late."""

RING_S = max(STRETCHES_S)
RING_BYTES = 1 << 28
"""Most bytes of blocks that are kept for one scan; segments are shorter then."""

FINAL_WIDTHS, FINAL_S = 4.0, 60.0
"""A passage is final when so many d/v and seconds have passed since."""

HEARD_WIDTHS = 8.0
"""d/v on either side of a passage in which its level is heard: 18 dB down."""

PASSED = ("ok", "level-only", "no-speed")
"""Status of a closest approach that lies in the sound."""

KNOWN_WIDTH_S = 10.0
"""d/v of a passage of which it is not known, s."""

WITHDRAWN = "not-a-passage"


class LiveWatch:
    """Watches an engine that runs over live sound, and tells what is decided.

    ``graph``: the graph of the run, its options resolved.
    """

    def __init__(self, graph: Graph, recording: Recording, tell: Tell) -> None:
        self._tell = tell
        self._recording = recording
        self._passages = _Passages(self._say)
        self._presence = LivePresence(self._say)
        self._lines: dict[str, _OpenLines] = {}
        self._whole = [
            node.step
            for node in graph.nodes
            if node.step.name in graph.outputs and node.step.stage.output in (Encounters, Presence)
        ]
        self._graph = graph.part([step.name for step in self._whole])
        self._open: dict[str, tuple[Step, OpenScan]] = {}
        self._rings = {step.name: _Ring(step) for step in _roots(self._graph)}
        self._results = {step.name: _Ring(step) for step in _direct(self._graph)}
        self._due_s = dict(STRETCHES_S)
        self._looked_s = dict.fromkeys(STRETCHES_S, -np.inf)
        self._now_s = 0.0

    def attend(self, engine: Engine) -> None:
        """Take the engine whose scans are asked what they have so far.

        Scans that can tell this need not be run anew over blocks that are kept.
        """
        for name in list(self._rings):
            scan = engine.open_scan(name)
            if scan is not None:
                scan.remember(RING_S)
                self._open[name] = self._rings.pop(name).step, scan

    def entering(self, step: Step, block: Container) -> None:
        """Note a block that a step is about to take."""
        if step.name in self._rings:
            kept = step.stage.condensed(block, step.options)
            self._rings[step.name].add(kept)

    def made(self, step: Step, block: Container) -> None:
        """Note a block that a step has made."""
        if step.name in self._results:
            self._results[step.name].add(block)
        if isinstance(block, Lines):
            lines = self._lines.setdefault(step.name, _OpenLines(step, self._say))
            lines.add(block)

    def advanced(self, now_s: float) -> None:
        """Tell what the sound up to now decides.

        ``now_s``: how much sound was taken, s from the first sample.
        """
        self._now_s = now_s
        self._tell_gaps()
        if not self._whole:
            return
        is_long_due = now_s >= self._due_s[RING_S]
        if self._passages.some_are_due(now_s) or (
            is_long_due and self._presence.some_are_due(now_s)
        ):
            self._decide()
        before = 0.0
        for segment_s, due_s in self._due_s.items():
            if now_s >= due_s:
                self._due_s[segment_s] = now_s + STRETCHES_S[segment_s]
                if now_s > before:  # a shorter segment does not hold it all
                    self._look(segment_s, before)
            before = segment_s

    def finish(self, found: Sequence[Container]) -> None:
        """Tell what the whole sound has decided.

        ``found``: the results of the run, its encounters and presence among them.
        """
        self._tell_gaps()
        for lines in self._lines.values():
            lines.finish()
        passages = _with_status(_rows_of(found, Encounters), (*PASSED, "extrapolated"))
        self._passages.finish(passages)
        heard = _rows_of(found, Presence)
        last = _Found(passages, heard, 0.0)
        self._presence.finish(self._with_told_encounters(last))

    def _decide(self) -> None:
        known = self._known_so_far(RING_S)
        assert known is not None  # noqa: S101 - something was told of it
        found = self._found(RING_S, known)
        self._passages.decide(found.passages, self._now_s)
        self._see(found, RING_S)
        self._presence.decide(self._with_told_encounters(found), self._now_s)

    def _look(self, segment_s: float, shorter_s: float) -> None:
        known = self._known_so_far(segment_s)
        if known is None:
            return
        last_s = self._looked_s[segment_s]
        spans = [ALWAYS] if self._rings or self._results else spans_of(known.values())
        told = self._passages.explaining()
        if not is_worth_a_look(spans, self._now_s, last_s, segment_s, shorter_s, told):
            return
        self._see(self._found(segment_s, known), segment_s)

    def _see(self, found: "_Found", segment_s: float) -> None:
        """Tell what a look shows that was not known."""
        self._looked_s[segment_s] = self._now_s
        for row in found.passages:
            is_inside = found.start_s <= max(0.0, _needed_from_s(row))
            if is_inside and row["time_s"] + _width_s(row) <= self._now_s:
                self._passages.see(row, segment_s)
        self._passages.looked(max(0.0, self._now_s - segment_s), self._now_s)
        heard = self._with_told_encounters(found)
        self._presence.see(heard, (found.start_s, self._now_s), segment_s)

    def _with_told_encounters(self, found: "_Found") -> list[Event]:
        """Return what was heard, its closest approaches named as they were told."""
        contacts = {row["contact"]: self._passages.told(row) for row in found.passages}
        known = {own: told for own, told in contacts.items() if told is not None}
        return [with_told_encounter(row, known) for row in found.presence]

    def _known_so_far(self, segment_s: float) -> dict[str, Container] | None:
        """Return what the scans know of the last segment; None if none knows any."""
        made = {
            name: scan.so_far(self._now_s - segment_s) for name, (_, scan) in self._open.items()
        }
        known = {name: one for name, one in made.items() if one is not None}
        return known or ({} if self._rings or self._results else None)

    def _found(self, segment_s: float, known: Mapping[str, Container]) -> "_Found":
        """Run the last segment of the sound on from its scans; return what it shows."""
        sink = MemorySink()
        rings = [*self._rings.values(), *self._results.values()]
        late = [name for name in self._open if name not in known]
        late += [ring.step.name for ring in rings if ring.is_empty]
        graph = self._graph.without(late)  # long frames come later than short ones
        engine = Engine(graph, context_of(self._recording), sink)
        start_s = max(
            (s for s, _ in map(_span, known.values()) if np.isfinite(s)), default=self._now_s
        )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the run itself will say it
                for name, one in known.items():
                    engine.push(name, one, self._open[name][0])
                for name, ring in self._rings.items():
                    for block in ring.since(self._now_s - segment_s):
                        start_s = min(start_s, _span(block)[0])
                        engine.feed(name, block)
                for ring in self._results.values():
                    for block in ring.since(self._now_s - segment_s):
                        sink.append(ring.step, block)
                engine.finish()
        except DataError:  # too little sound for one of the stages
            return _Found([], [], start_s)
        there = {step.name for step in graph.steps()}
        made = [sink.read(step) for step in self._whole if step.name in there]
        passages = _with_status(_rows_of(made, Encounters), PASSED)
        return _Found(passages, _rows_of(made, Presence), start_s)

    def _tell_gaps(self) -> None:
        reader = self._recording.reader
        if not isinstance(reader, DisturbedSource):
            return
        rate_hz = self._recording.sample_rate_hz
        for gap in reader.take_disturbances():
            time_s = gap.start_sample / rate_hz
            is_long = gap.is_over and gap.n_samples >= UNCHANGED_S * rate_hz
            facts = {"duration_s": gap.n_samples / rate_hz, "reason": gap.reason}
            self._say("gap", time_s, facts, int(is_long), is_final=gap.is_over)

    def _say(
        self, kind: str, time_s: float, facts: Event, revision: int, *, is_final: bool
    ) -> None:
        start_ns, sensor = self._recording.start_utc_ns, self._recording.sensor
        event: Event = {"event": kind, "sensor": sensor.id}
        event |= {"time_s": time_s, "time_utc": None}
        if start_ns is not None:
            after_ms = round((time_s + sensor.clock_offset_s) * 1000)
            event["time_utc"] = format_utc(start_ns + after_ms * (NANOSECONDS // 1000))
        event |= facts
        event |= {"revision": revision, "final": is_final, "decided_s": self._now_s}
        self._tell(event)


@dataclass(frozen=True)
class _Found:
    """What a look at the last of the sound shows."""

    passages: list[Event]
    """Rows of the closest approaches in it."""
    presence: list[Event]
    """Rows of what was heard."""
    start_s: float
    """Where its sound begins, s from the first sample."""


@dataclass
class _Passage:
    """A closest approach that was told."""

    row: Event
    """Its facts as they were told last."""
    contact: int
    """Number of its contact."""
    revision: int
    """How often they were told anew."""
    segment_s: float
    """Length of the look that found it, s."""
    is_final: bool = False
    """Whether later sound cannot change it."""
    looked_s: float = -np.inf
    """Where the sound ended when a look held it last, s."""

    @property
    def due_s(self) -> float:
        """When it is decided, s."""
        return float(self.row["time_s"] + FINAL_WIDTHS * _width_s(self.row) + FINAL_S)


class _Passages:
    """The closest approaches that were told, each with its last values."""

    def __init__(self, say: Callable[..., None]) -> None:
        self._say = say
        self._known: list[_Passage] = []

    def see(self, row: Event, segment_s: float) -> None:
        """Take a passage that a segment shows."""
        known = _nearest(row, self._known)
        if known is None:
            known = _Passage(row, 1 + len(self._known), 0, segment_s)
            self._known.append(known)
            self._tell(known)
        elif not known.is_final and _is_news(row, known, segment_s):
            known.segment_s = max(segment_s, known.segment_s)
            self._revise(known, row)

    def told(self, row: Event) -> int | None:
        """Return the contact under which a passage was told; None if it was not."""
        known = _nearest(row, [p for p in self._known if p.row["status"] != WITHDRAWN])
        return None if known is None else known.contact

    def explaining(self) -> list[ToldPassage]:
        """Return what the passages explain that were told and not withdrawn."""
        return [
            ToldPassage(
                p.row["time_s"] - HEARD_WIDTHS * _width_s(p.row),
                p.row["time_s"] + HEARD_WIDTHS * _width_s(p.row),
                tuple(p.row["rest_frequencies_hz"]),
                _width_s(p.row),
                max(0.0, _needed_from_s(p.row)),
                p.looked_s,
                p.is_final,
            )
            for p in self._known
            if p.row["status"] in PASSED
        ]

    def looked(self, start_s: float, now_s: float) -> None:
        """Note a look at the sound between two times."""
        for passage in self._known:
            if start_s <= max(0.0, _needed_from_s(passage.row)):
                passage.looked_s = now_s

    def some_are_due(self, now_s: float) -> bool:
        """Tell whether a passage waits to be decided."""
        return any(not p.is_final and p.due_s <= now_s for p in self._known)

    def decide(self, rows: Sequence[Event], now_s: float) -> None:
        """Decide what is due by what the longest segment shows."""
        due = [p for p in self._known if not p.is_final and p.due_s <= now_s]
        found = _paired(rows, due)
        for k, passage in enumerate(due):
            passage.is_final = True
            self._revise(passage, found.get(k) or _withdrawn(passage.row))

    def finish(self, rows: Sequence[Event]) -> None:
        """Tell what the whole sound says otherwise, or for the first time."""
        found = _paired(rows, self._known)
        paired = [id(row) for row in found.values()]
        for k, passage in enumerate(self._known):
            row = found.get(k)
            was_final, passage.is_final = passage.is_final, True
            if row is None and passage.row["status"] != WITHDRAWN:
                self._revise(passage, _withdrawn(passage.row))
            elif row is not None and not (was_final and _agrees(row, passage.row)):
                self._revise(passage, row)
        for row in rows:
            if id(row) not in paired:
                known = _Passage(row, 1 + len(self._known), 0, RING_S, is_final=True)
                self._known.append(known)
                self._tell(known)

    def _revise(self, passage: _Passage, row: Event) -> None:
        passage.row, passage.revision = row, passage.revision + 1
        self._tell(passage)

    def _tell(self, passage: _Passage) -> None:
        row = {**passage.row, "contact": passage.contact}
        self._say("encounter", row["time_s"], row, passage.revision, is_final=passage.is_final)


def _rows_of(found: Sequence[Container], kind: type[Container]) -> list[Event]:
    return [row for c in found if isinstance(c, kind) for row in json_rows(c)]


def _with_status(rows: Sequence[Event], wanted: Sequence[str]) -> list[Event]:
    """Return the passages of some kinds; without a time there is nothing to tell."""
    return [r for r in rows if r["status"] in wanted and r["time_s"] is not None]


def _width_s(row: Event) -> float:
    """Return d/v of a passage, s."""
    known = row["range_over_speed_s"] or row["horizontal_range_over_speed_s"]
    return float(known or KNOWN_WIDTH_S)


def _needed_from_s(row: Event) -> float:
    """Return from where on the sound shows a passage, s: a level needs its flanks."""
    widths = 1.0 if row["status"] == "ok" else 3.0
    return float(row["time_s"] - widths * _width_s(row))


def _log_odds(row: Event, other: Event) -> float:
    """Return the log odds that two events are of one vessel, by time, R/v and lines."""
    return same_vessel(*(
        PassageReport(
            one["time_s"], one["time_std_s"] or np.nan, _width_s(one),
            one["range_over_speed_std_s"] or np.nan,
            rest_frequencies_hz=one["rest_frequencies_hz"] or (),
        )
        for one in (row, other)
    ))  # fmt: skip


def _nearest(row: Event, known: Sequence[_Passage]) -> _Passage | None:
    odds = [(_log_odds(row, p.row), -k) for k, p in enumerate(known)]
    best = max(odds, default=(-np.inf, 0))
    return known[-best[1]] if best[0] > 0.0 else None


def _paired(rows: Sequence[Event], known: Sequence[_Passage]) -> dict[int, Event]:
    """Pair rows with passages one to one, the likeliest first."""
    likely = sorted(
        (-_log_odds(row, p.row), k, n) for n, row in enumerate(rows) for k, p in enumerate(known)
    )
    found: dict[int, Event] = {}
    taken: set[int] = set()
    for against, k, n in likely:
        if against < 0.0 and k not in found and n not in taken:
            found[k] = rows[n]
            taken.add(n)
    return found


TOLD = ("time_s", "speed_mps", "range_over_speed_s")
"""Quantities whose change is worth a revision; each has a deviation."""


def _std(row: Event, name: str) -> float | None:
    stem, unit = name.rsplit("_", 1)
    value: float | None = row.get(f"{stem}_std_{unit}")
    return value


def _agrees(row: Event, told: Event) -> bool:
    """Tell whether a passage is within a deviation of what was told."""
    if row["status"] != told["status"]:
        return False
    for name in TOLD:
        new, old, std = row[name], told[name], _std(told, name)
        if (new is None) != (old is None):
            return False
        if new is not None and std is not None and abs(new - old) > std:
            return False
    return True


def _is_news(row: Event, known: _Passage, segment_s: float) -> bool:
    """Tell whether a look is worth a revision: it knows more, and something new."""
    sharper = []
    for name in TOLD:
        new, old = _std(row, name), _std(known.row, name)
        sharper.append(new is not None and (old is None or new < 0.67 * old))
    longer = segment_s >= known.segment_s
    return any(sharper) or (longer and not _agrees(row, known.row))


def _withdrawn(row: Event) -> Event:
    reasons = {**row["reasons"], "status": "more sound does not confirm the passage"}
    return {**row, "status": WITHDRAWN, "reasons": reasons}


class _Ring:
    """The last blocks that a step took, or made."""

    def __init__(self, step: Step) -> None:
        self.step = step
        self._blocks: deque[Container] = deque()
        self._n_bytes = 0

    def add(self, block: Container) -> None:
        """Keep a block, and let go of what is too old."""
        self._blocks.append(block)
        self._n_bytes += block.nbytes
        oldest_s = _span(block)[1] - RING_S
        while len(self._blocks) > 1 and (
            _span(self._blocks[0])[1] < oldest_s or self._n_bytes > RING_BYTES
        ):
            self._n_bytes -= self._blocks.popleft().nbytes

    @property
    def is_empty(self) -> bool:
        """Whether there was none yet."""
        return not self._blocks

    def since(self, start_s: float) -> Iterator[Container]:
        """Return the blocks that end after a time."""
        return (block for block in self._blocks if _span(block)[1] > start_s)


class _OpenLines:
    """The lines of a step that have not ended, and what was told of them."""

    def __init__(self, step: Step, say: Callable[..., None]) -> None:
        self._step = step
        self._say = say
        self._open: dict[int, Event] = {}

    def add(self, block: Lines) -> None:
        """Take the points that have become final; tell which lines begin and end."""
        if not block.line.size:
            return
        present = set(np.unique(block.line).tolist())
        for line in [line for line in self._open if line not in present]:
            self._end(line)
        for line in sorted(present):
            is_new = line not in self._open
            self._open[line] = self._facts(line, block)
            if is_new:
                self._tell(line, 0, is_final=False)

    def finish(self) -> None:
        """Tell that the lines that are open have ended."""
        for line in list(self._open):
            self._end(line)

    def _facts(self, line: int, block: Lines) -> Event:
        own = block.line == line
        known = self._open.get(line)
        times, frequency = block.time_s[own], block.frequency_hz[own]
        heard = block.association[own] != COASTED
        snr_db = block.measured_snr_db[own][heard]
        facts: Event = {
            "step": self._step.name,
            "line": line,
            "time_s": float(times.min()),
            "end_time_s": float(times.max()),
            "frequency_hz": float(frequency[np.argmax(times)]),
            "frequency_low_hz": float(frequency.min()),
            "frequency_high_hz": float(frequency.max()),
            "snr_db": plain(float(np.median(snr_db)) if snr_db.size else np.nan),
            "n_points": int(own.sum()),
        }
        if known is not None:
            low = min(known["frequency_low_hz"], facts["frequency_low_hz"])
            high = max(known["frequency_high_hz"], facts["frequency_high_hz"])
            facts |= {"time_s": known["time_s"], "frequency_low_hz": low,
                      "frequency_high_hz": high,
                      "n_points": known["n_points"] + facts["n_points"]}  # fmt: skip
        return facts

    def _end(self, line: int) -> None:
        self._tell(line, 1, is_final=True)
        del self._open[line]

    def _tell(self, line: int, revision: int, *, is_final: bool) -> None:
        facts = self._open[line]
        self._say("line", facts["time_s"], facts, revision, is_final=is_final)


def _span(block: Container) -> tuple[float, float]:
    """Return the times of a block's first and last frame, s."""
    frames = getattr(block, "frames", None)
    if not isinstance(frames, Frames) or not frames.n_frames:
        return np.inf, -np.inf
    return float(frames.time_s[0]), float(frames.time_s[-1])


def _behind_scans(graph: Graph) -> set[str]:
    """Return the scans, and every step that reads one or what follows from one."""
    behind: set[str] = set()
    for node in graph.nodes:
        sources = {name for names in node.sources.values() for name in names}
        if node.step.stage.kind == "scan" or sources & behind:
            behind.add(node.step.name)
    return behind


def _roots(graph: Graph) -> Iterator[Step]:
    """Yield the scans that no other scan precedes: from them on all can be done anew."""
    behind = _behind_scans(graph)
    for node in graph.nodes:
        if node.step.stage.kind == "scan" and node.stream_source not in behind:
            yield node.step


def _direct(graph: Graph) -> Iterator[Step]:
    """Yield the sources and maps before all scans whose results a whole stage reads."""
    behind = _behind_scans(graph)
    whole = [node for node in graph.nodes if node.step.stage.kind == "whole"]
    read = {s for node in whole for names in node.sources.values() for s in names}
    for node in graph.nodes:
        if node.step.name in read - behind and node not in whole:
            yield node.step
