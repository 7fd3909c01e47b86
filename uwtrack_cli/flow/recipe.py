"""A recipe: the stages of a run and their options, as a TOML file.

**Conventions.** The file has a ``description`` and one table per stage, in the order
of the chain; a table's keys are the options of the stage's function. What is not
mentioned keeps its default, and ``uwtrack recipes --show NAME`` prints every value.
"""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, Self

from uwtrack_cli.errors import OptionError
from uwtrack_cli.flow.catalogue import STAGES, find_stage
from uwtrack_cli.flow.stage import Stage


@dataclass(frozen=True)
class Step:
    """A stage bound to its options; a picklable task of about a kilobyte."""

    stage_name: str
    options: Mapping[str, Any]

    @property
    def stage(self) -> Stage:
        """The stage itself, looked up by its name."""
        return find_stage(self.stage_name)

    def values(self) -> dict[str, Any]:
        """Every option with its value, defaults too, policies as tables."""
        merged = {**self.stage.defaults, **self.options}
        return {name: plain(value) for name, value in merged.items()}


@dataclass(frozen=True)
class Recipe:
    """A named list of steps."""

    name: str
    description: str
    steps: tuple[Step, ...]

    @classmethod
    def from_toml(cls, name: str, text: str) -> Self:
        """Read a recipe.

        Raises
        ------
        OptionError
            The text is not TOML, or names a stage or option that does not exist.
        """
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            msg = f"recipe {name} is not readable as TOML: {error}."
            raise OptionError(msg) from error
        description = str(tables.pop("description", ""))
        return cls(name, description, tuple(_step(n, t) for n, t in tables.items()))

    def with_settings(self, settings: Sequence[str]) -> Self:
        """Override options given as ``STAGE.OPTION=VALUE``, VALUE as in TOML.

        Raises
        ------
        OptionError
            A setting has another form, or the recipe has no such stage or option.
        """
        tables = {step.stage_name: dict(step.options) for step in self.steps}
        for setting in settings:
            stage_name, path, value = _parse_setting(setting)
            if stage_name not in tables:
                names = ", ".join(tables)
                msg = (
                    f"recipe {self.name} has no stage {stage_name!r}; it has: {names}."
                )
                raise OptionError(msg)
            table = tables[stage_name]
            if len(path) == 2:
                before = table.get(path[0])
                inner = plain(before) if before is not None else {}
                table[path[0]] = {**inner, path[1]: value}
            else:
                table[path[0]] = value
        steps = tuple(_step(name, table) for name, table in tables.items())
        return type(self)(self.name, self.description, steps)

    def to_toml(self) -> str:
        """Write the recipe with every value, so that it can be edited."""
        lines = [f"description = {_toml(self.description)}"]
        for step in self.steps:
            lines += ["", f"[{step.stage_name}]"]
            nested: list[str] = []
            for name, value in step.values().items():
                if isinstance(value, dict):
                    nested += ["", f"[{step.stage_name}.{name}]", *_pairs(value)]
                else:
                    lines += _pairs({name: value})
            lines += nested
        return "\n".join(lines) + "\n"


def plain(value: Any) -> Any:
    """Return a value as JSON and TOML know it; a policy becomes a table."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, tuple):
        return list(value)
    return value


def _step(name: str, table: Any) -> Step:
    if not isinstance(table, Mapping):
        names = ", ".join(STAGES)
        msg = f"a recipe holds one table per stage ({names}), not {name} = {table!r}."
        raise OptionError(msg)
    return Step(name, find_stage(name).bind(table))


def _parse_setting(setting: str) -> tuple[str, list[str], Any]:
    left, equals, right = setting.partition("=")
    stage_name, dot, option = left.strip().partition(".")
    path = option.split(".")
    if not equals or not dot or not option or len(path) > 2:
        msg = f"a setting has the form STAGE.OPTION=VALUE, got {setting!r}."
        raise OptionError(msg)
    try:
        value = tomllib.loads(f"value = {right}")["value"]
    except tomllib.TOMLDecodeError:
        value = right.strip()
    return stage_name, path, value


def _pairs(table: Mapping[str, Any]) -> list[str]:
    return [
        f"# {name} is not set" if value is None else f"{name} = {_toml(value)}"
        for name, value in table.items()
    ]


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
