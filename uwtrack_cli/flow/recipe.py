"""A recipe: named steps with their stages, inputs and options, as a TOML file.

**Conventions.** The file has a ``description`` and one table per step. The name of a
table is the name of its step. ``stage`` names the stage and is the name of the step
where it is not written; ``input`` names the steps that it reads, and is the nearest
earlier step that fits where it is not written; ``output = true`` keeps a result that
would only pass by. All other keys are options of the stage's function. What is not
mentioned keeps its default; ``uwtrack recipes --show NAME`` prints every value.
"""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Self

from uwtrack_cli.data import renamed
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.options import convert, refuse_unknown, shown
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.tables.toml_tables import parse_toml
from uwtrack_cli.flow.catalogue import STAGES, find_stage
from uwtrack_cli.flow.graph import Graph
from uwtrack_cli.flow.stage import plain
from uwtrack_cli.flow.step import Step

_STEP_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


@dataclass(frozen=True)
class Recipe:
    """A named list of steps."""

    name: str
    """Name of the recipe, for messages."""
    description: str
    """What it is for, in one line."""
    steps: tuple[Step, ...]
    """The steps, in the order of the file."""

    @classmethod
    def from_toml(cls, name: str, text: str) -> Self:
        """Read a recipe, and check that its steps join to a graph.

        Raises
        ------
        OptionError
            The text is not TOML; a stage, step or option does not exist; or a step has
            no input, makes what no step reads, or waits for itself.
        """
        try:
            tables = parse_toml(text)
        except DataError as error:
            raise OptionError(f"recipe {name} is not readable as TOML: {error}.") from error
        description = convert("description", str, tables.pop("description", ""))
        steps = tuple(_step(n, t) for n, t in tables.items())
        return cls(name, description, steps).checked()

    def checked(self) -> Self:
        """Return the recipe itself if its steps join.

        Raises
        ------
        OptionError
            They do not: see `Graph.over_recording`.
        """
        self.graph()
        return self

    def graph(self, keep: Collection[type[Container]] = ()) -> Graph:
        """Return the graph of the steps over a recording.

        ``keep``: containers that are kept although they only pass by.

        Raises
        ------
        OptionError
            The steps do not join.
        """
        if not keep:
            return self._graph
        return Graph.over_recording(self.steps, f"recipe {self.name}", keep)

    @cached_property
    def _graph(self) -> Graph:
        """The graph with nothing more kept: one for all the recordings of a batch."""
        return Graph.over_recording(self.steps, f"recipe {self.name}")

    def __getstate__(self) -> dict[str, Any]:
        """Leave the graph out where a recipe is sent to another process."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def with_settings(self, settings: Sequence[str]) -> Self:
        """Override options given as ``STEP.OPTION=VALUE``, VALUE as in TOML.

        Where a step has the name of its stage, other steps of that stage that do not
        set the option themselves take the value, too: one source depth is meant.

        Raises
        ------
        OptionError
            A setting has another form, or the recipe has no such step or option.
        """
        tables = {step.name: _table(step) for step in self.steps}
        settled = {step.name: set(step.settled) for step in self.steps}
        for setting in settings:
            name, path, value = _parse_setting(setting)
            name = name if name in tables else renamed.STAGES.get(name, name)
            refuse_unknown({name: value}, tables, f"recipe {self.name}", "step")
            alike = [
                other
                for other, table in tables.items()
                if other != name and table.get("stage") == name
            ]
            for one in (name, *alike):
                table = tables[one]
                nested = table.get(path[0], {}) if len(path) == 2 else table
                if one != name and path[-1] in nested:
                    continue
                table[path[0]] = {**nested, path[1]: value} if path[1:] else value
                settled[one].add(path[0])
        steps = tuple(
            replace(_step(name, table), settled=frozenset(settled[name]))
            for name, table in tables.items()
        )
        return replace(self, steps=steps).checked()

    def to_toml(self) -> str:
        """Write the recipe with every value, so that it can be edited."""
        lines = [f"description = {_toml(self.description)}"]
        for step in self.steps:
            lines += ["", f"[{step.name}]", *_pairs(_wiring(step))]
            nested: list[str] = []
            for name, value in step.values().items():
                if isinstance(value, dict):
                    nested += ["", f"[{step.name}.{name}]", *_pairs(value)]
                else:
                    lines += _pairs({name: value})
            lines += nested
        return "\n".join(lines) + "\n"


def _wiring(step: Step) -> dict[str, Any]:
    """Return stage, input and output of a step where they are not the usual ones."""
    wiring: dict[str, Any] = {}
    if step.stage_name != step.name:
        wiring["stage"] = step.stage_name
    if step.inputs is not None:
        one = len(step.inputs) == 1
        wiring["input"] = step.inputs[0] if one else list(step.inputs)
    if step.is_output:
        wiring["output"] = True
    return wiring


def _table(step: Step) -> dict[str, Any]:
    return {**_wiring(step), **{n: plain(v) for n, v in step.options.items()}}


def _step(name: str, table: Any) -> Step:
    if not isinstance(table, Mapping):
        names = ", ".join(STAGES)
        raise OptionError(f"a recipe holds one table per step ({names}), not {name} = {table!r}.")
    if not _STEP_NAME.fullmatch(name):
        raise OptionError(
            f"{name!r} is no name of a step: letters, digits, - and _ are accepted, 64 at most."
        )
    options = dict(table)
    stage_name = convert(f"{name}.stage", str, options.pop("stage", name))
    written = options.pop("input", None)
    if isinstance(written, str):
        written = [written]
    inputs = convert(f"{name}.input", tuple[str, ...] | None, written)
    is_output = convert(f"{name}.output", bool, options.pop("output", False))
    stage = find_stage(stage_name)
    bound = stage.bind(options, name)
    return Step(name, stage.name, bound, inputs, is_output)


def _parse_setting(setting: str) -> tuple[str, list[str], Any]:
    left, equals, right = setting.partition("=")
    name, dot, option = left.strip().partition(".")
    path = option.split(".")
    if not equals or not dot or not option or len(path) > 2:
        raise OptionError(f"a setting has the form STEP.OPTION=VALUE, got {shown(setting)}.")
    try:
        value = parse_toml(f"value = {right}")["value"]
    except DataError:
        value = right.strip()
    return name, path, value


def _pairs(table: Mapping[str, Any]) -> list[str]:
    return [
        f"# {name} is not set" if value is None else f"{name} = {_toml(value)}"
        for name, value in table.items()
    ]


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
