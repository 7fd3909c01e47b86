"""A stage, read from its function: the signature and the docstring define it.

**Method.** Containers come first and are inputs; keyword-only parameters are options;
the numpydoc text gives the summary and the help of each option. Nothing about a stage
is written down a second time: commands, recipe steps, tasks and history are views.

**Conventions.** A *source* turns a recording into a stream of blocks, a *map* turns a
block into a block, a *scan* turns a stream of blocks into another with bounded state,
and a *whole* stage turns small tables into a table.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from inspect import Parameter, getdoc, signature
from typing import Any, Literal, get_args, get_origin, get_type_hints

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import OptionError
from uwtrack_cli.flow.options import (
    Option,
    build_policy,
    convert,
    is_policy,
    is_union,
    parameter_texts,
    policy_options,
    without_none,
)

Kind = Literal["source", "map", "scan", "whole"]


@dataclass(frozen=True)
class Input:
    """A container that a stage reads."""

    name: str
    kinds: tuple[type[Container], ...]
    is_list: bool
    is_optional: bool
    is_stream: bool


@dataclass(frozen=True)
class Stage:
    """One arrow of the chain: its name on the command line and its function."""

    name: str
    target: str

    @cached_property
    def function(self) -> Callable[..., Any]:
        """The function itself, imported when it is needed."""
        module, _, function = self.target.partition(":")
        found: Callable[..., Any] = getattr(import_module(module), function)
        return found

    @cached_property
    def inputs(self) -> tuple[Input, ...]:
        """Containers that the stage reads, in order."""
        return tuple(
            _input(p.name, self._hints[p.name])
            for p in self._parameters
            if p.kind is Parameter.POSITIONAL_OR_KEYWORD
        )

    @cached_property
    def defaults(self) -> dict[str, Any]:
        """Default of every keyword-only parameter, policies as objects."""
        return {
            p.name: p.default
            for p in self._parameters
            if p.kind is Parameter.KEYWORD_ONLY
        }

    @cached_property
    def options(self) -> tuple[Option, ...]:
        """Options with their help; fields of policies stand for the policies."""
        texts = parameter_texts(self.function)
        found: list[Option] = []
        for name, default in self.defaults.items():
            if is_policy(self._hints[name]):
                found += policy_options(name, default)
            else:
                text = texts.get(name, "")
                found.append(Option(name, self._hints[name], default, text))
        return tuple(found)

    @cached_property
    def output(self) -> type[Container]:
        """Class of the container that the stage makes."""
        hint = self._hints["return"]
        if get_origin(hint) is not None:
            hint = get_args(hint)[0]
        if not (isinstance(hint, type) and issubclass(hint, Container)):
            msg = f"stage {self.name} returns {hint!r}, which is no container."
            raise TypeError(msg)
        return hint

    @cached_property
    def kind(self) -> Kind:
        """How the stage is fed: see the module's conventions."""
        first = self.inputs[0]
        if Recording in first.kinds:
            return "source"
        if first.is_stream:
            return "scan"
        one = len(self.inputs) == 1 and not first.is_list
        return "map" if one and first.kinds[0].STREAMS else "whole"

    @property
    def suffix(self) -> str:
        """Ending of the output file: ``.lines.h5``, or ``.trace.h5`` for `trace`."""
        product = "trace" if self.name == "trace" else self.output.NAME
        return f".{product}.h5"

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (getdoc(self.function) or "").split("\n", 1)[0]

    def bind(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return keyword arguments for the options given, nested for policies.

        Raises
        ------
        OptionError
            The stage has no such option; the known ones are listed.
        """
        bound: dict[str, Any] = {}
        for name, value in given.items():
            if name not in self.defaults:
                known = ", ".join(self.defaults)
                msg = f"{self.name} has no option {name!r}; it has: {known}."
                raise OptionError(msg)
            where, hint = f"{self.name}.{name}", self._hints[name]
            if is_policy(hint):
                bound[name] = build_policy(where, self.defaults[name], value)
            else:
                bound[name] = convert(where, hint, value)
        return bound

    @cached_property
    def _hints(self) -> dict[str, Any]:
        return get_type_hints(self.function)

    @property
    def _parameters(self) -> list[Parameter]:
        return list(signature(self.function).parameters.values())


def _input(name: str, hint: Any) -> Input:
    optional = is_union(hint) and type(None) in get_args(hint)
    if optional:
        hint = without_none(hint)
    origin = get_origin(hint)
    is_stream, is_list = origin is Iterator, origin is list
    inner = get_args(hint)[0] if is_stream or is_list else hint
    kinds = get_args(inner) if is_union(inner) else (inner,)
    return Input(name, tuple(kinds), is_list, optional, is_stream)
