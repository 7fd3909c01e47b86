"""The graph of a recipe: which step reads which, checked before anything runs.

**Method.** Every input of a stage is joined to a step by the kind of container that it
takes: to the steps that ``input`` names, or else to the nearest earlier step that makes
such a container. What no step makes may be given from outside: the recording and its
sensor to every step, the containers of product files to a single command. The steps
are then put into an order in which each follows what it reads.

**Conventions.** A list input takes all steps that are named, and one if none is. Of
several steps that make the same, every one must be read or be an output: nothing runs
in vain.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from typing import Any, Self

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.options import refuse_unknown
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import DataError, OptionError, warn
from uwtrack_cli.flow.catalogue import STAGES, find_stage
from uwtrack_cli.flow.stage import Input, Stage
from uwtrack_cli.flow.step import Step

HELD_SHARE = 0.8
"""Share of the highest frequency of a recording below which every band must begin."""

PASSING: tuple[type[Container], ...] = (Spectrogram, Peaks, Families)
"""Containers too large to keep: they pass by and only what follows from them stays."""

CONTEXT: tuple[type[Container], ...] = (Recording, Sensor, Navigation, BearingTime)
"""What a step may read beside its data: facts of the recording, and where its array was;
by itself it is not enough."""


@dataclass(frozen=True)
class Node:
    """A step with its inputs joined."""

    step: Step
    """Stage and options."""
    sources: Mapping[str, tuple[str, ...]]
    """Names of the steps that each parameter reads; none if given from outside."""

    @property
    def stream_source(self) -> str | None:
        """The step whose blocks a map or scan takes; None if given from outside."""
        names = self.sources.get(self.step.stage.inputs[0].name, ())
        return names[0] if names else None


@dataclass(frozen=True)
class Graph:
    """Steps in an order in which each follows what it reads."""

    nodes: tuple[Node, ...]
    """The steps with their inputs."""
    outputs: frozenset[str]
    """Names of the steps whose results are kept."""
    keep: tuple[type[Container], ...] = ()
    """Containers that are kept although they only pass by."""

    @classmethod
    def over_recording(
        cls, steps: Sequence[Step], name: str, keep: Collection[type[Container]] = ()
    ) -> Self:
        """Join the steps of a recipe, which begin with a recording.

        ``keep``: containers that are kept although they only pass by.

        Raises
        ------
        OptionError
            A step has no input, is read by nobody, names a step that does not exist,
            or waits for itself; or no step reads the recording.
        """
        if not any(step.stage.kind == "source" for step in steps):
            raise OptionError(
                f"{name} has no step that reads the recording, such as [spectrogram]; "
                f"it has: {', '.join(s.name for s in steps) or 'none'}."
            )
        return cls.of_steps(steps, name, CONTEXT, keep)

    @classmethod
    def of_steps(
        cls,
        steps: Sequence[Step],
        name: str,
        given: Collection[type[Container]],
        keep: Collection[type[Container]] = (),
    ) -> Self:
        """Join steps of which some read what is given from outside.

        ``given``: containers that come from outside. ``keep``: containers that are kept
        although they only pass by.

        Raises
        ------
        OptionError
            As `over_recording`, but a recording need not be read.
        """
        nodes = {
            step.name: Node(step, _joined(position, steps, name, given))
            for position, step in enumerate(steps)
        }
        ordered = _in_order(nodes, name)
        outputs = _outputs(ordered, keep)
        _refuse_idle(ordered, outputs, name)
        return cls(ordered, outputs, tuple(keep))

    def kept(self, step: Step, block: Container) -> Container:
        """Return what is kept of a block of an output."""
        return block if step.is_output else without_passing(block, self.keep)

    def product_key(self, step: "Step") -> str:
        """Return the name under which a product keeps a result.

        It is empty for a step that has the name of its stage, unless another such step
        makes the same.
        """
        makers = [
            node.step.name
            for node in self.nodes
            if node.step.name in self.outputs
            and node.step.name == node.step.stage_name
            and node.step.stage.output is step.stage.output
        ]
        return "" if makers == [step.name] else step.name

    def resolved(self, recording: Recording) -> Self:
        """Return the graph with the options that follow from a recording.

        A recipe for faster recorders is slowed down: where a band lies above all that
        the recording holds, the bands that reach higher than it are lowered and their
        windows lengthened, by one factor. A band that a person has set is meant as it
        stands, for the stage to refuse.

        Raises
        ------
        DataError
            The recording is so slow that the windows would be longer than any may be.
        """
        highest_hz = 0.5 * recording.sample_rate_hz
        slower = self._slowness(highest_hz)
        if slower > 1.0:
            warn(
                f"{recording.name} reaches {highest_hz:g} Hz: the recipe's windows are "
                f"taken {slower:g} times as long, and its bands as much lower."
            )
        nodes = []
        for node in self.nodes:
            own = _slowed(node.step, slower, highest_hz)
            options = node.step.stage.resolve(recording, own)
            if slower > 1.0:
                _check_slowed(node.step, options, recording)
            nodes.append(replace(node, step=replace(node.step, options=options)))
        return replace(self, nodes=tuple(nodes))

    def _slowness(self, highest_hz: float) -> float:
        """Return by what to slow the steps down for sound up to a frequency.

        The lowest of the bands that reach beyond it decides; of a recipe for closest
        approaches one of those that they are told by.
        """
        bands = _bands(self.steps())
        if all(low < HELD_SHARE * highest_hz for low, _ in bands):
            return 1.0
        told = [s.name for s in self.steps() if s.stage.output is Encounters]
        beyond = [high for _, high in bands if high > highest_hz]
        for_passages = [high for _, high in _bands(self.part(told).steps()) if high > highest_hz]
        return min(for_passages or beyond) / highest_hz

    def part(self, wanted: Collection[str]) -> Self:
        """Return the part of the graph that some steps need."""
        by_name = {node.step.name: node for node in self.nodes}
        names, waiting = set(wanted), list(wanted)
        while waiting:
            for sources in by_name[waiting.pop()].sources.values():
                waiting += [name for name in sources if name not in names]
                names.update(sources)
        nodes = tuple(node for node in self.nodes if node.step.name in names)
        return replace(self, nodes=nodes, outputs=self.outputs & names)

    def without(self, absent: Collection[str]) -> Self:
        """Return the graph without some steps, and without what needs their results."""
        gone, nodes = set(absent), []
        for node in self.nodes:
            left = {
                key: tuple(name for name in names if name not in gone)
                for key, names in node.sources.items()
            }
            needed = {i.name for i in node.step.stage.inputs if not i.is_optional}
            lacks = any(node.sources[key] and not left[key] for key in needed & set(left))
            lacks |= any(node.sources.values()) and not any(left.values())
            if lacks or node.step.name in gone:
                gone.add(node.step.name)
            else:
                nodes.append(replace(node, sources=left))
        return replace(self, nodes=tuple(nodes), outputs=self.outputs - gone)

    def edges(self) -> list[tuple[str, str, str]]:
        """Return who reads whom: source, reader and the container that passes.

        A step that reads the recording has the source ``recording``; what is kept has
        the reader ``product``.
        """
        by_name = {node.step.name: node.step for node in self.nodes}
        found: list[tuple[str, str, str]] = []
        for node in self.nodes:
            name = node.step.name
            if node.step.stage.kind == "source":
                found.append(("recording", name, "sound"))
            for names in node.sources.values():
                found += [(s, name, by_name[s].stage.output.NAME) for s in names]
            if name in self.outputs:
                found.append((name, "product", node.step.stage.output.NAME))
        return found

    def lines(self) -> list[str]:
        """Return a line for each step: what it reads, and what it makes."""
        width = max(len(node.step.name) for node in self.nodes)
        rows = []
        for node in self.nodes:
            step = node.step
            read = [s for names in node.sources.values() for s in names]
            of = " + ".join(read) or "recording"
            stage = "" if step.name == step.stage_name else f" ({step.stage_name})"
            kept = " *" if step.name in self.outputs else ""
            made = step.stage.output.NAME
            rows.append(f"{step.name:{width}}{stage}  <- {of}  -> {made}{kept}")
        return [*rows, "* kept in the result file"]

    def steps(self) -> Iterator[Step]:
        """Return the steps in the order in which they run."""
        return (node.step for node in self.nodes)


def _bands(steps: Iterable[Step]) -> list[tuple[float, float]]:
    """Return the bands of some steps that no person has set, Hz."""
    return [band for band in map(_band_of_recipe, steps) if band is not None]


def _band_of_recipe(step: Step) -> tuple[float, float] | None:
    """Return a step's band, Hz; None if it has none, or a person has set it."""
    whole = {**step.stage.defaults, **step.options}
    return None if "band_hz" in step.settled else whole.get("band_hz")


def _slowed(step: Step, factor: float, highest_hz: float) -> dict[str, Any]:
    """Return a step's options with lower bands and longer windows, if it needs them."""
    whole = {**step.stage.defaults, **step.options}
    band_hz = _band_of_recipe(step)
    if factor == 1.0 or band_hz is None or band_hz[1] <= highest_hz:
        return dict(step.options)
    slower = {"band_hz": tuple(edge / factor for edge in band_hz)}
    if whole.get("window_s") is not None:
        slower["window_s"] = factor * whole["window_s"]
    return {**step.options, **slower}


def _check_slowed(step: Step, options: dict[str, Any], recording: Recording) -> None:
    """Refuse a recording for which a recipe would have to be slowed down too far."""
    if step.options.get("window_s") == options.get("window_s"):
        return
    try:
        step.stage.bind({"window_s": options["window_s"]}, step.name)
    except OptionError as error:
        raise DataError(
            f"{recording.name} has a sample rate of {recording.sample_rate_hz:g} Hz: "
            f"slowed down to it, the frames of [{step.name}] would last "
            f"{options['window_s']:g} s, longer than any may. Give a recipe of your own for "
            f"such sound (uwtrack recipes --show vessel prints one to begin with)."
        ) from error


def taken(container: Container, kinds: Sequence[type[Container]]) -> Container:
    """Return what a stage takes of a container: itself, or the part it stands for.

    ``kinds``: containers that the stage accepts.
    """
    if isinstance(container, tuple(kinds)):
        return container
    part: Container = getattr(container, getattr(container, "STANDS_FOR"))  # noqa: B009
    return part


def _makes(stage: Stage, kinds: Sequence[type[Container]]) -> bool:
    """Tell whether a stage makes one of some containers, or one that stands for it."""
    part = getattr(stage.output, "STANDS_FOR", "")
    return stage.output in kinds or part in {kind.NAME for kind in kinds}


def without_passing(container: Container, keep: Collection[type[Container]] = ()) -> Container:
    """Return a container without parts that only pass by.

    ``keep``: containers that are kept all the same.
    """
    part = getattr(container, "STANDS_FOR", "")
    if not part or isinstance(getattr(container, part), tuple(keep)):
        return container
    return replace(container, **{part: None})


def _joined(
    position: int, steps: Sequence[Step], name: str, given: Collection[type[Container]]
) -> dict[str, tuple[str, ...]]:
    """Return the steps that each parameter of a step reads."""
    step = steps[position]
    wanted = step.stage.inputs
    if step.inputs is not None:
        sources = _as_written(step, steps, name)
    else:
        before = list(reversed(steps[:position]))
        sources = {}
        for one in wanted:
            near = next((s.name for s in before if _makes(s.stage, one.kinds)), None)
            if near is not None:
                sources[one.name] = (near,)
    for one in wanted:
        from_outside = any(kind in given for kind in one.kinds)
        if not (one.is_optional or one.name in sources or from_outside):
            raise OptionError(_missing(step, steps, one, name))
    data = [one for one in wanted if not all(kind in CONTEXT for kind in one.kinds)]
    is_fed = any(one.name in sources or any(kind in given for kind in one.kinds) for one in data)
    if data and not is_fed:
        raise OptionError(_missing(step, steps, data[0], name))
    return sources


def _as_written(step: Step, steps: Sequence[Step], name: str) -> dict[str, tuple[str, ...]]:
    """Share the named inputs out to the parameters; each one must find its place."""
    known = {other.name: other for other in steps}
    names = step.inputs or ()
    refuse_unknown(dict.fromkeys(names), known, f"the input of [{step.name}] of {name}", "step")
    sources: dict[str, tuple[str, ...]] = {}
    for source in names:
        made = known[source].stage.output
        takers = [i for i in step.stage.inputs if _makes(known[source].stage, i.kinds)]
        free = [i for i in takers if i.is_list or i.name not in sources]
        if not free:
            accepted = [kind.NAME for i in step.stage.inputs for kind in i.kinds]
            problem = (
                f"takes one {made.NAME}, and {source!r} is one more"
                if takers
                else f"reads {' or '.join(accepted)}, and [{source}] makes {made.NAME}"
            )
            raise OptionError(f"[{step.name}] of {name} {problem}.")
        sources[free[0].name] = (*sources.get(free[0].name, ()), source)
    return sources


def _missing(step: Step, steps: Sequence[Step], one: Input, name: str) -> str:
    wanted = " or ".join(kind.NAME for kind in one.kinds)
    makers = [s for s in STAGES if _makes(find_stage(s), one.kinds)]
    later = [s.name for s in steps if _makes(s.stage, one.kinds) and s is not step]
    remedy = (
        f"[{later[0]}] makes it: move it before [{step.name}], or name it with input = {later[0]!r}"
        if later
        else f"add a step before it: {' or '.join(f'[{m}]' for m in makers)}"
        if makers
        else "no stage makes it"
    )
    return f"[{step.name}] of {name} reads {wanted}, and no step before it makes it; {remedy}."


def _in_order(nodes: Mapping[str, Node], name: str) -> tuple[Node, ...]:
    """Sort the nodes so that each follows what it reads; keep the written order else."""
    sorter = TopologicalSorter(
        {key: [s for names in node.sources.values() for s in names] for key, node in nodes.items()}
    )
    try:
        sorter.prepare()
    except CycleError as error:
        circle = " -> ".join(error.args[1])
        raise OptionError(f"steps of {name} wait for each other: {circle}.") from error
    rank = {key: k for k, key in enumerate(nodes)}
    ordered: list[Node] = []
    ready: list[str] = []
    while sorter.is_active():
        ready = sorted([*ready, *sorter.get_ready()], key=lambda key: rank[key])
        first = ready.pop(0)
        ordered.append(nodes[first])
        sorter.done(first)
    return tuple(ordered)


def _outputs(nodes: Sequence[Node], keep: Collection[type[Container]]) -> frozenset[str]:
    """Return what is kept: all that is small, is marked, or that a whole stage reads.

    A table that a whole stage makes again, better, is not: there is one answer.
    """
    kept = {
        node.step.name
        for node in nodes
        if node.step.is_output
        or node.step.stage.output not in PASSING
        or node.step.stage.output in keep
    }
    for node in nodes:
        if node.step.stage.kind == "whole":
            kept.update(name for names in node.sources.values() for name in names)
    return frozenset(kept - _revised(nodes))


def _revised(nodes: Sequence[Node]) -> set[str]:
    """Return the steps whose table another step reads and makes again."""
    made = {node.step.name: node.step for node in nodes}
    return {
        name
        for node in nodes
        for names in node.sources.values()
        for name in names
        if node.step.stage.kind == made[name].stage.kind == "whole"
        and node.step.stage.output is made[name].stage.output
        and not made[name].is_output
    }


def _refuse_idle(nodes: Sequence[Node], outputs: frozenset[str], name: str) -> None:
    """Refuse a step whose result nobody reads, unless it is wanted for itself.

    Wanted are results that are marked as outputs, and the last of each kind that is
    kept.
    """
    read = {s for node in nodes for names in node.sources.values() for s in names}
    last = {n.step.stage.output: n.step.name for n in nodes if n.step.name in outputs}
    for node in nodes:
        step, made = node.step, node.step.stage.output
        if step.name in read or step.is_output or last.get(made) == step.name:
            continue
        others = [
            n.step.name
            for n in nodes
            if n.step is not step and any(_makes(step.stage, i.kinds) for i in n.step.stage.inputs)
        ]
        could = f"name it as input of [{others[-1]}], " if others else ""
        raise OptionError(
            f"[{step.name}] of {name} makes {made.NAME} that no step reads: {could}"
            f"keep it with output = true, or leave it out."
        )
