"""A step: a stage bound to its options, with the names of the steps that it reads."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from uwtrack_cli.flow.catalogue import find_stage
from uwtrack_cli.flow.stage import Stage, plain


@dataclass(frozen=True)
class Step:
    """A stage bound to its options; a picklable task of about a kilobyte."""

    name: str
    """Name of the step, unique in its recipe."""
    stage_name: str
    """Name of its stage in the catalogue."""
    options: Mapping[str, Any]
    """Options that differ from the defaults, option groups as objects."""
    inputs: tuple[str, ...] | None = None
    """Names of the steps that it reads; None: the nearest earlier ones that fit."""
    is_output: bool = False
    """Whether its result is kept although others only pass by."""
    settled: frozenset[str] = frozenset()
    """Options that a person has set beside a recipe: they are meant as they stand."""

    @property
    def stage(self) -> Stage:
        """The stage itself, looked up by its name."""
        return find_stage(self.stage_name)

    def values(self) -> dict[str, Any]:
        """Every option with its value, defaults too, option groups as tables."""
        merged = {**self.stage.defaults, **self.options}
        return {name: plain(value) for name, value in merged.items()}


def simple_step(stage_name: str, **options: Any) -> Step:
    """Return a step that has the name of its stage."""
    return Step(stage_name, stage_name, find_stage(stage_name).bind(options))
