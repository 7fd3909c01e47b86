"""The engine that runs graphs: for recordings, and for the commands of single stages.

**Method.** Blocks are pushed from the sources through maps and scans in the order of
the graph; a scan is a generator that gives one block for each block it takes, and its
rest when the input ends. All branches see the same blocks, and the engine holds none:
what stays goes to a sink. The recording is read once, however many sources there are:
the source whose next block ends first is advanced, so that little sound is taken before
it is used; they share the samples that one of them has not taken yet, at the rates to which
they reduce them (`SharedSound`). When the streams have ended, the whole stages
follow on what the sink gives back.

What is read of a recording goes at once to every rate that is asked for, and is held there
until the last of its takers has it: a source that waits for long frames holds sound of
its own rate alone.

**Conventions.** Results are known by the step that made them. Options that follow from
the recording are resolved before the run, and written into history as they are used.
"""

from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import Reader, Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.estimation.decimation import Decimator
from uwtrack_cli.estimation.noise_floor import TILE_FRAMES
from uwtrack_cli.flow.graph import Graph, Node, taken
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.stage import Input
from uwtrack_cli.flow.step import Step

Progress = Callable[[float], None]
"""Called with the time in seconds that has been dealt with."""

Revision = Callable[[Encounters], Encounters]
"""What is done last to the encounters of a run."""

STREAM_SHARE = 0.8
"""Share of a run's time that is told while its sound passes by; the fits follow."""


class Sink(Protocol):
    """Takes what stays of a run, and gives it back whole."""

    def append(self, step: Step, block: Container) -> None:
        """Take a block of a step's result."""

    def write(self, step: Step, container: Container) -> None:
        """Take the whole result of a step."""

    def read(self, step: Step) -> Container:
        """Return the whole result of a step."""

    def forget(self, kept: Collection[str]) -> None:
        """Let go of what can be read again, but for the results of some steps."""


@runtime_checkable
class OpenScan(Protocol):
    """A scan that tells its result at any time, not at its end alone."""

    def remember(self, last_s: float) -> None:
        """Keep what has left for so long, s."""

    def so_far(self, start_s: float) -> Container | None:
        """Return the result from a time on, as if the input ended here."""


class Watch(Protocol):
    """Sees what passes through an engine, while it passes."""

    def entering(self, step: Step, block: Container) -> None:
        """See a block that a map or scan is about to take."""

    def made(self, step: Step, block: Container) -> None:
        """See a block that a step has made."""

    def advanced(self, now_s: float) -> None:
        """See how much sound was taken, s from the first sample."""


class MemorySink:
    """Keeps results in memory: for Python, and for what is small."""

    def __init__(self) -> None:
        self._blocks: dict[str, list[Container]] = {}

    def append(self, step: Step, block: Container) -> None:
        """Take a block of a step's result."""
        self._blocks.setdefault(step.name, []).append(block)

    def write(self, step: Step, container: Container) -> None:
        """Take the whole result of a step."""
        self._blocks[step.name] = [container]

    def read(self, step: Step) -> Container:
        """Return the whole result of a step, its blocks joined."""
        blocks = self._blocks[step.name]
        if len(blocks) > 1:
            blocks[:] = [type(blocks[0]).join(blocks)]
        return blocks[0]

    def forget(self, kept: Collection[str]) -> None:
        """Keep everything: there is no other place that has it."""


class Engine:
    """One run of a graph.

    ``graph``: the steps, joined. ``given``: containers from outside, which steps find
    by their kind. ``watch``: sees the blocks that pass, if anybody wants to.
    ``revise``: last change to the encounters of a run; None leaves them.
    """

    def __init__(
        self,
        graph: Graph,
        given: Sequence[Container],
        sink: Sink,
        watch: Watch | None = None,
        revise: Revision | None = None,
    ) -> None:
        self.graph = graph
        self._watch = watch
        self._revise = revise
        self._given = list(given)
        self._sink = sink
        self._revised: dict[str, Container] = {}
        self._streams = {
            node.step.name: _StreamNode(node)
            for node in graph.nodes
            if node.step.stage.kind in {"map", "scan"}
        }

    def run_recording(self, recording: Recording, progress: Progress | None = None) -> None:
        """Run every step over a recording, reading it once.

        ``progress``: called after each block, and after each of the fits that follow.
        """
        sources = [n.step for n in self.graph.nodes if n.step.stage.kind == "source"]
        by_name = {step.name: step for step in sources}
        readers = dict(zip(by_name, _readers(recording, sources), strict=True))
        streams: dict[str, Iterator[Container]] = {
            step.name: step.stage.function(
                replace(recording, reader=readers[step.name]), **step.options
            )
            for step in sources
        }
        reached = dict.fromkeys(streams, 0.0)
        expected = {name: _first_end_s(step) for name, step in by_name.items()}
        # a product's time base is that of the first source, whatever is kept beside it
        expected[sources[0].name] = 0.0
        began: set[str] = set()
        while streams:
            name = min(streams, key=lambda key: expected[key])
            block = next(streams[name], None)
            if block is None:
                if not (name in began or recording.is_live):
                    raise DataError(_too_short(recording, by_name[name]))
                del streams[name]
                if isinstance(reader := readers[name], SharedReader):
                    reader.leave()
                continue
            began.add(name)
            before_s, reached[name] = reached[name], max(reached[name], _end_s(block))
            expected[name] = 2.0 * reached[name] - before_s
            self.push(name, block, by_name[name])
            if self._watch is not None:
                self._watch.advanced(max(reached.values()))
            if progress is not None:
                progress(STREAM_SHARE * min(reached[key] for key in streams))
        ended = recording.ended()
        if not began:
            raise DataError(_too_short(ended, sources[0]))
        self._leave_out(set(by_name) - began, ended)
        self._given = [ended if c is recording else c for c in self._given]
        self.finish(_share_of(progress, ended.duration_s))

    def _leave_out(self, too_long: Collection[str], recording: Recording) -> None:
        """Leave out sources whose frames live sound was too short for, with what follows.

        The length of a file is known before, and its frames are shortened to it.
        """
        for name in sorted(too_long):
            warn(
                f"{recording.name} lasts {recording.duration_s:g} s, less than a frame "
                f"of {name}, which is left out."
            )
        self.graph = self.graph.without(too_long)
        left = {node.step.name for node in self.graph.nodes}
        self._streams = {name: node for name, node in self._streams.items() if name in left}

    def push(self, origin: str | None, block: Container, step: Step | None) -> None:
        """Push a block through all that follows from it.

        ``origin``: the step that made it; None if it was given from outside. ``step``:
        the step that made it, if its result may stay.
        """
        if step is not None:
            self._keep(step, block)
            if self._watch is not None:
                self._watch.made(step, block)
        made: dict[str | None, Container] = {origin: block}
        for name, stream in self._streams.items():
            source = stream.node.stream_source
            if source in made:
                own = taken(made[source], stream.node.step.stage.inputs[0].kinds)
                if self._watch is not None:
                    self._watch.entering(stream.node.step, own)
                made[name] = stream.push(own)
                self._keep(stream.node.step, made[name])
                if self._watch is not None:
                    self._watch.made(stream.node.step, made[name])

    def feed(self, name: str, block: Container) -> None:
        """Give a map or scan a block of its input, and push on what follows."""
        stream = self._streams[name]
        self.push(name, stream.push(block), stream.node.step)

    def open_scan(self, name: str) -> OpenScan | None:
        """Return what a scan can be asked while it runs; None if it cannot."""
        results: object = self._streams[name].results
        return results if isinstance(results, OpenScan) else None

    def finish(self, progress: Progress | None = None) -> None:
        """End the streams in order, then run the whole stages.

        ``progress``: called after each whole stage, with the share of them that is
        done.
        """
        for name in list(self._streams):
            self._end_stream(name)
        last = [node for node in self.graph.nodes if node.step.stage.kind == "whole"]
        for number, node in enumerate(last, 1):
            made = self._whole(node)
            # a day of lines and levels is held for those who read it, not to the end
            follows = [s for n in last[number : number + 1] for s in n.sources.values()]
            self._sink.forget({name for names in follows for name in names})
            if node.step.name in self.graph.outputs:
                self._sink.write(node.step, made)
            else:  # a later step makes this table again
                self._revised[node.step.name] = made
            if progress is not None:
                progress(number / len(last))

    def _end_stream(self, name: str) -> None:
        """Take what a stream still holds, and let go of it: the fits need its memory."""
        stream = self._streams[name]
        for rest in stream.finish():
            self.push(name, rest, stream.node.step)
        del self._streams[name]

    def _keep(self, step: Step, block: Container) -> None:
        if step.name in self.graph.outputs:
            self._sink.append(step, self.graph.kept(step, block))

    def _whole(self, node: Node) -> Container:
        by_name = {n.step.name: n.step for n in self.graph.nodes}
        step = node.step
        inputs: list[Any] = []
        for wanted in step.stage.inputs:
            names = node.sources.get(wanted.name, ())
            found = [
                self._revised[name] if name in self._revised else self._sink.read(by_name[name])
                for name in names
            ]
            if not names:
                found = [c for c in self._given if isinstance(c, wanted.kinds)]
            inputs.append(_as_argument(step, wanted, found))
        made: Container = step.stage.function(*inputs, **step.options)
        is_last = step.name in self.graph.outputs
        if is_last and isinstance(made, Encounters) and self._revise is not None:
            return self._revise(made)
        return made


def _too_short(recording: Recording, step: Step) -> str:
    return (
        f"{recording.name} lasts {recording.duration_s:g} s, which is too short for "
        f"the first frame of {step.name}; give it a shorter window."
    )


def _as_argument(step: Step, wanted: Input, found: Sequence[Container]) -> Any:
    """Return what a parameter takes of the containers found for it."""
    kinds = " or ".join(kind.NAME for kind in wanted.kinds)
    if wanted.is_list and (found or wanted.is_optional):
        return list(found)
    if not found and not wanted.is_optional:
        raise DataError(f"{step.name} needs {kinds}, and the input has none.")
    if len(found) > 1:
        raise DataError(f"{step.name} takes one {kinds}, and the input has {len(found)}.")
    return found[0] if found else None


def run_recipe(
    recording: Recording,
    recipe: Recipe,
    *,
    keep: Sequence[type[Container]] = (),
    progress: Progress | None = None,
) -> list[Container]:
    """Run a recipe over a recording, and keep what follows in memory.

    Parameters
    ----------
    recording
        The recording, opened for reading.
    recipe
        The steps.
    keep
        Passing containers that are wanted in the result all the same.
    progress
        Called after each block.

    Returns
    -------
    list[Container]
        The recording's facts, the sensor and every output, in the order of the
        recipe.

    Raises
    ------
    OptionError
        The steps of the recipe do not join.
    DataError
        The sound is too short.
    """
    graph = recipe.graph(keep).resolved(recording)
    sink = MemorySink()
    given = context_of(recording)
    engine = Engine(graph, given, sink)
    engine.run_recording(recording, progress)
    graph = engine.graph
    steps = [step for step in graph.steps() if step.name in graph.outputs]
    return [recording.ended(), recording.sensor, *(sink.read(step) for step in steps)]


def _share_of(progress: Progress | None, duration_s: float) -> Progress | None:
    """Return the progress of what follows when the sound has passed by."""
    if progress is None:
        return None
    return lambda done: progress(duration_s * (STREAM_SHARE + (1 - STREAM_SHARE) * done))


def context_of(recording: Recording) -> list[Container]:
    """Return what a recording gives to every step: itself, sensor, navigation."""
    sensor: Sensor = recording.sensor
    own = [sensor.navigation] if sensor.navigation is not None else []
    return [recording, sensor, *own]


def _readers(recording: Recording, sources: Sequence[Step]) -> list[Reader | None]:
    """Return a reader for each source; several read and decimate the sound together."""
    if len(sources) == 1 or recording.reader is None:
        return [recording.reader] * len(sources)
    used = (step.stage.resolve(recording, step.options) for step in sources)
    factors = [options.get("decimation", 1) for options in used]
    return [*SharedSound(recording.reader, factors).readers]


class _StreamNode:
    """A map or scan that blocks are pushed into."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self._waiting: list[Container] = []
        self.results: Iterator[Container] | None = None
        step = node.step
        if step.stage.kind == "scan":
            self.results = step.stage.function(self._feed(), **step.options)

    def push(self, block: Container) -> Container:
        """Give one block and take the one that follows from it."""
        if self.results is None:
            step = self.node.step
            made: Container = step.stage.function(block, **step.options)
            return made
        self._waiting.append(block)
        return next(self.results)

    def finish(self) -> Iterator[Container]:
        """Take what the stage still holds."""
        return iter(()) if self.results is None else self.results

    def _feed(self) -> Iterator[Container]:
        while self._waiting:
            yield self._waiting.pop()


def _first_end_s(step: Step) -> float:
    """Return about where the first block of a source ends, s: at a tile of frames."""
    window_s, overlap = (step.options.get(name) for name in ("window_s", "overlap"))
    return TILE_FRAMES * (window_s or 0.0) * (1.0 - (overlap or 0.0))


def _end_s(block: Container) -> float:
    frames = getattr(block, "frames", None)
    return float(frames.time_s[-1]) if frames is not None and frames.n_frames else 0.0


class SharedSound:
    """Sound of one reader for several, which must be advanced in turn.

    ``factors``: by how much each reduces the sample rate.
    """

    def __init__(self, reader: Reader, factors: Sequence[int]) -> None:
        self._reader = reader
        self._blocks: Iterator[Samples] | None = None
        self._is_over = False
        self._rates = {factor: _Rate(factor) for factor in factors}
        self.readers = [
            SharedReader(self, self._rates[factor], number) for number, factor in enumerate(factors)
        ]
        """A reader for each of them."""
        for own in self.readers:
            own.rate.positions[own.number] = 0

    def more(self, block_samples: int) -> bool:
        """Read on; tell whether there was more."""
        if self._blocks is None:
            self._blocks = self._reader(block_samples)
        block = next(self._blocks, None)
        if not self._is_over:
            for rate in self._rates.values():
                rate.add(block)
        self._is_over = block is None
        return not self._is_over


class _Rate:
    """Sound of one rate, held until the last one has taken it."""

    def __init__(self, factor: int) -> None:
        self.factor = factor
        self.positions: dict[int, int] = {}
        """First sample that each taker has not taken."""
        self._decimator = Decimator(factor)
        self._held: deque[Samples] = deque()
        self._first = self._end = self._n_channels = 0

    def add(self, block: Samples | None) -> None:
        """Take sound of the full rate; None at its end."""
        if block is None:
            block = self._decimator.finish(self._n_channels)
        else:
            self._n_channels = block.shape[1]
            block = self._decimator.feed(block)
        if self.positions and len(block):
            self._held.append(block)
            self._end += len(block)

    def lacks(self, number: int, count: int) -> bool:
        """Tell whether fewer samples are held than a taker wants."""
        return self._end < self.positions[number] + count

    def take(self, number: int, count: int) -> Samples:
        """Return so many samples, fewer if there are no more."""
        begin, start = self.positions[number], self._first
        parts: list[Samples] = []
        for held in self._held:
            low, high = max(begin - start, 0), min(begin + count - start, len(held))
            if low < high:
                parts.append(held[low:high])
            start += len(held)
        self.positions[number] = begin + sum(map(len, parts))
        self._drop()
        if not parts:
            return np.empty((0, self._n_channels), np.float32)
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def leave(self, number: int) -> None:
        """Hold nothing more for a taker."""
        self.positions.pop(number, None)
        self._drop()

    def _drop(self) -> None:
        least = min(self.positions.values(), default=self._end)
        while self._held and self._first + len(self._held[0]) <= least:
            self._first += len(self._held.popleft())


class SharedReader:
    """A reader of one of the rates."""

    def __init__(self, sound: SharedSound, rate: _Rate, number: int) -> None:
        self._sound, self.rate, self.number = sound, rate, number

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield blocks of so many samples, of the rate that was asked for."""
        rate, number = self.rate, self.number
        block = None
        while block is None or len(block) == block_samples:
            while rate.lacks(number, block_samples):
                if not self._sound.more(block_samples * rate.factor):
                    break
            block = rate.take(number, block_samples)
            if len(block):
                yield block
        self.leave()

    def decimated(self, factor: int) -> Reader:
        """Return the reader of the lower rate: this one."""
        assert factor == self.rate.factor  # noqa: S101 - it was asked for
        return self

    def leave(self) -> None:
        """Take no more: nothing is held for this reader."""
        self.rate.leave(self.number)
