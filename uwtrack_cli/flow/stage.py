"""A stage, read from its function: the signature and the docstring define it.

**Method.** Containers come first and are inputs; keyword-only parameters are options;
the numpydoc text gives the summary and the help of each option. Nothing about a stage
is written down a second time: commands, recipe steps, tasks and history are views.

**Conventions.** A *source* turns a recording into a stream of blocks, a *map* turns a
block into a block, a *scan* turns a stream of blocks into another with bounded state,
and a *whole* stage turns small tables into a table.
"""

import re
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cached_property
from importlib import import_module
from inspect import Parameter, getdoc, signature
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import OptionError

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
class Option:
    """An option of a stage; ``owner`` is the policy that it is a field of, if any.

    Where a policy is one of several classes, ``choice`` names the class.
    """

    name: str
    type: Any
    default: Any
    help: str
    owner: str | None = None
    choice: str | None = None


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

    @property
    def suffix(self) -> str:
        """Ending of the output file: ``.lines.h5``, or ``.trace.h5`` for `trace`."""
        product = "trace" if self.name == "trace" else self.output.NAME
        return f".{product}.h5"

    @cached_property
    def _hints(self) -> dict[str, Any]:
        return get_type_hints(self.function)

    @property
    def _parameters(self) -> list[Parameter]:
        return list(signature(self.function).parameters.values())

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
            hint = self._hints[name]
            policies = policy_classes(hint)
            if not policies:
                found.append(Option(name, hint, default, texts.get(name, "")))
            for policy in policies:
                choice = policy.__name__ if len(policies) > 1 else None
                found += _policy_options(name, policy, default, choice)
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
            where = f"{self.name}.{name}"
            policies = policy_classes(self._hints[name])
            if policies:
                bound[name] = _policy(where, policies, self.defaults[name], value)
            else:
                bound[name] = convert(where, self._hints[name], value)
        return bound


def parameter_texts(function: Callable[..., Any] | type) -> dict[str, str]:
    """Return the description of every parameter from a numpydoc docstring."""
    doc = getdoc(function) or ""
    match = re.search(
        r"^Parameters\n-+\n(.*?)(?=^\w[^\n]*\n---|\Z)", doc, re.MULTILINE | re.DOTALL
    )
    texts: dict[str, str] = {}
    names: list[str] = []
    for line in (match.group(1) if match else "").splitlines():
        if line and not line.startswith(" "):
            names = [name.strip() for name in line.split(",")]
        elif line.strip():
            for name in names:
                texts[name] = f"{texts.get(name, '')} {line.strip()}".strip()
    return texts


def policy_classes(hint: Any) -> tuple[type, ...]:
    """Return the policy dataclasses that an annotation allows."""
    choices = get_args(hint) if _is_union(hint) else (hint,)
    return tuple(c for c in choices if isinstance(c, type) and is_dataclass(c))


def convert(where: str, hint: Any, value: Any) -> Any:
    """Check a value against an annotation, and return it in that type.

    Raises
    ------
    OptionError
        The value is of another type or not among the choices.
    """
    if _is_union(hint):
        return None if value is None else convert(where, _without_none(hint), value)
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Literal:
        return _one_of(where, arguments, value)
    if origin in {tuple, list}:
        return _sequence(where, origin, arguments, value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        msg = f"{where} must be of type {hint.__name__}, got {value!r}."
        raise OptionError(msg)
    return value


def _one_of(where: str, choices: tuple[Any, ...], value: Any) -> Any:
    if value not in choices:
        names = ", ".join(map(repr, choices))
        msg = f"{where} must be one of {names}, got {value!r}."
        raise OptionError(msg)
    return value


def _sequence(
    where: str, origin: type, arguments: tuple[Any, ...], value: Any
) -> list[Any] | tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        msg = f"{where} must be a list of values, got {value!r}."
        raise OptionError(msg)
    if origin is list:
        return [convert(where, arguments[0], v) for v in value]
    if Ellipsis in arguments:
        return tuple(convert(where, arguments[0], v) for v in value)
    if len(value) != len(arguments):
        msg = f"{where} takes {len(arguments)} values, got {len(value)}: {value!r}."
        raise OptionError(msg)
    pairs = zip(arguments, value, strict=True)
    return tuple(convert(where, hint, v) for hint, v in pairs)


def _policy(where: str, policies: tuple[type, ...], default: Any, given: Any) -> Any:
    """Build a policy from a table; ``kind`` names the class where there are several."""
    if isinstance(given, policies):
        return given
    if not isinstance(given, Mapping):
        msg = f"{where} must be a table of options, got {given!r}."
        raise OptionError(msg)
    values = dict(given)
    by_name = {policy.__name__: policy for policy in policies}
    named = values.pop("kind", type(default).__name__ if default else None)
    if named not in by_name:
        msg = f"{where}.kind must be one of {', '.join(by_name)}, got {named!r}."
        raise OptionError(msg)
    policy = by_name[named]
    known = [f.name for f in fields(policy)]
    hints = get_type_hints(policy)
    for name in values:
        if name not in known:
            msg = f"{where} has no option {name!r}; it has: {', '.join(known)}."
            raise OptionError(msg)
    chosen = {k: convert(f"{where}.{k}", hints[k], v) for k, v in values.items()}
    before = vars(default) if type(default) is policy else {}
    return policy(**{**before, **chosen})


def _policy_options(
    owner: str, policy: type, default: Any, choice: str | None
) -> list[Option]:
    texts, hints = parameter_texts(policy), get_type_hints(policy)
    same = isinstance(default, policy)
    return [
        Option(
            f.name,
            hints[f.name],
            getattr(default, f.name) if same else _field_default(f),
            texts.get(f.name, ""),
            owner,
            choice,
        )
        for f in fields(policy)
    ]


def _field_default(item: Any) -> Any:
    return None if item.default is MISSING else item.default


def _input(name: str, hint: Any) -> Input:
    optional = _is_union(hint) and type(None) in get_args(hint)
    if optional:
        hint = _without_none(hint)
    origin = get_origin(hint)
    is_stream = origin in {Iterator, types.GeneratorType}
    is_list = origin is list
    inner = get_args(hint)[0] if is_stream or is_list else hint
    kinds = get_args(inner) if _is_union(inner) else (inner,)
    return Input(name, tuple(kinds), is_list, optional, is_stream)


def _is_union(hint: Any) -> bool:
    return get_origin(hint) in {Union, types.UnionType}


def _without_none(hint: Any) -> Any:
    rest = tuple(a for a in get_args(hint) if a is not type(None))
    return rest[0] if len(rest) == 1 else Union[rest]  # noqa: UP007
