"""A stage, read from its function: the signature and the docstring define it.

**Method.** Containers come first and are inputs; keyword-only parameters are options;
the numpydoc text gives the summary and the help of each option, the annotation its
type, unit and range. Nothing about a stage is written down a second time: commands,
recipe steps, tasks and history are views.

**Conventions.** A *source* turns a recording into a stream of blocks, a *map* turns a
block into a block, a *scan* turns a stream of blocks into another with bounded state,
and a *whole* stage turns small tables into a table. A stage with many options gathers
some in an option group, a small frozen dataclass with a docstring of its own: on the
command line its fields are flat (``--feedback-alpha``), in a recipe they are a table
(``[track.feedback]``).
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from functools import cache, cached_property
from importlib import import_module
from inspect import Parameter, getdoc, signature
from typing import Any, Literal, get_args, get_origin, get_type_hints

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.options import (
    convert,
    from_table,
    is_union,
    plain_type,
    range_of,
    refuse_unknown,
    unit_of,
    without_none,
)
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.renamed import with_old_options

Kind = Literal["source", "map", "scan", "whole"]

PRODUCTS = {
    "trace": "trace", "combs": "combs", "demon": "demon", "beamform": "beams",
    "zoom": "zoom",
}  # fmt: skip
"""What the product of a stage is called where it is not called by its container."""


@dataclass(frozen=True)
class Input:
    """A container that a stage reads."""

    name: str
    """Name of the parameter."""
    kinds: tuple[type[Container], ...]
    """Containers that are accepted, any one of them."""
    is_list: bool
    """Whether it takes several containers at once."""
    is_optional: bool
    """Whether the stage does without it."""
    is_stream: bool
    """Whether it takes blocks one after the other."""


@dataclass(frozen=True)
class Option:
    """An option of a stage, with all that is known of it."""

    name: str
    """Name of the parameter, or of the field of its group."""
    hint: Any
    """Annotation with unit and range."""
    default: Any
    """Value when nothing is said."""
    text: str
    """Its description in the docstring."""
    group: str | None = None
    """Parameter that holds the group which it is a field of, if any."""

    @property
    def flat_name(self) -> str:
        """Name on the command line, with underscores."""
        return self.name if self.group is None else f"{self.group}_{self.name}"

    @property
    def type(self) -> Any:
        """Type without unit and range."""
        return plain_type(self.hint)

    @property
    def help(self) -> str:
        """Description with unit and range."""
        facts = [unit_of(self.hint), range_of(self.hint)]
        known = ", ".join(fact for fact in facts if fact)
        return f"{self.text} ({known})" if known else self.text


@dataclass(frozen=True)
class Stage:
    """One arrow of the chain: its name on the command line and its function."""

    name: str
    """Name of the command and of the recipe step."""
    target: str
    """Module and function, ``package.module:function``."""

    @cached_property
    def function(self) -> Callable[..., Any]:
        """The function itself, imported when it is needed."""
        module, _, function = self.target.partition(":")
        found: Callable[..., Any] = getattr(import_module(module), function)
        return found

    def condensed(self, block: Container, options: Mapping[str, Any]) -> Container:
        """Return what the stage needs of a block it takes, to take this later instead.

        A module may define ``condense`` for its stage, with the stage's own options,
        where the block itself is too large to be kept.
        """
        module = import_module(self.target.partition(":")[0])
        condense = getattr(module, "condense", None)
        if condense is None:
            return block
        made: Container = condense(block, **{**self.defaults, **options})
        return made

    @cached_property
    def inputs(self) -> tuple[Input, ...]:
        """Containers that the stage reads, in order."""
        return tuple(
            _input(p.name, plain_type(self._hints[p.name]))
            for p in self._parameters
            if p.kind is Parameter.POSITIONAL_OR_KEYWORD
        )

    @cached_property
    def defaults(self) -> dict[str, Any]:
        """Default of every keyword-only parameter, option groups as objects."""
        return {p.name: p.default for p in self._parameters if p.kind is Parameter.KEYWORD_ONLY}

    @cached_property
    def options(self) -> tuple[Option, ...]:
        """Options with their help; the fields of a group stand for the group."""
        texts = parameter_texts(self.function)
        found: list[Option] = []
        for name, default in self.defaults.items():
            if is_group(self._hints[name]):
                found += _group_options(name, default)
            else:
                found.append(Option(name, self._hints[name], default, texts.get(name, "")))
        return tuple(found)

    @cached_property
    def output(self) -> type[Container]:
        """Class of the container that the stage makes."""
        hint = self._hints["return"]
        if get_origin(hint) is not None:
            hint = get_args(hint)[0]
        if not (isinstance(hint, type) and issubclass(hint, Container)):
            raise TypeError(f"stage {self.name} returns {hint!r}, which is no container.")
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
        return f".{PRODUCTS.get(self.name, self.output.NAME)}.h5"

    def bind(self, given: Mapping[str, Any], step: str = "") -> dict[str, Any]:
        """Return keyword arguments for the options given, nested for groups.

        ``given``: options by name, a table for a group. ``step``: name of the step that
        is bound, for messages; empty: the stage's.

        Raises
        ------
        OptionError
            The stage has no such option, or a value is not accepted.
        """
        whose = step or self.name
        given = with_old_options(self.name, given)
        refuse_unknown(given, self.defaults, whose, "option")
        return {name: self._bound(f"{whose}.{name}", name, value) for name, value in given.items()}

    def resolve(self, recording: Recording, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options as they are used on a recording.

        What a function derives from the recording (`resolved_by`) takes the place of
        what was left open, so that history says what was done.
        """
        resolver = getattr(self.function, "resolver", None)
        if resolver is None:
            return dict(options)
        whole = {**self.defaults, **options}
        return {**options, **resolver(recording, whole)}

    def _bound(self, where: str, name: str, value: Any) -> Any:
        hint = self._hints[name]
        if not is_group(hint) or not isinstance(value, Mapping):
            return convert(where, hint, value)
        default = self.defaults[name]
        before = {f.name: getattr(default, f.name) for f in fields(default)}
        refuse_unknown(value, before, where, "option")
        return from_table(type(default), {**before, **value}, where)

    @cached_property
    def _hints(self) -> dict[str, Any]:
        return _type_hints(self.function)

    @property
    def _parameters(self) -> tuple[Parameter, ...]:
        return _parameters_of(self.function)


@cache
def _type_hints(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the annotations of a stage's function: they are looked up often."""
    return get_type_hints(function, include_extras=True)


@cache
def _parameters_of(function: Callable[..., Any]) -> tuple[Parameter, ...]:
    return tuple(signature(function).parameters.values())


def is_group(hint: Any) -> bool:
    """Tell whether an annotation is a group of options."""
    return isinstance(hint, type) and is_dataclass(hint)


def plain(value: Any) -> Any:
    """Return a value as JSON and TOML know it; a group becomes a table."""
    if is_dataclass(value) and not isinstance(value, type):
        return {name: plain(field) for name, field in asdict(value).items()}
    if isinstance(value, tuple | list):
        return [plain(element) for element in value]
    return value


def parameter_texts(function: Callable[..., Any] | type) -> dict[str, str]:
    """Return the description of every parameter from a numpydoc docstring."""
    doc = getdoc(function) or ""
    match = re.search(r"^Parameters\n-+\n(.*?)(?=^\w[^\n]*\n---|\Z)", doc, re.MULTILINE | re.DOTALL)
    texts: dict[str, str] = {}
    names: list[str] = []
    for line in (match.group(1) if match else "").splitlines():
        if line and not line.startswith(" "):
            names = [name.strip() for name in line.split(",")]
        elif line.strip():
            for name in names:
                texts[name] = f"{texts.get(name, '')} {line.strip()}".strip()
    return texts


def _group_options(group: str, default: Any) -> list[Option]:
    """Return the fields of a group as options, with the values of its default."""
    kind = type(default)
    texts = parameter_texts(kind)
    hints = get_type_hints(kind, include_extras=True)
    return [
        Option(f.name, hints[f.name], getattr(default, f.name), texts[f.name], group)
        for f in fields(kind)
    ]


def _input(name: str, hint: Any) -> Input:
    optional = is_union(hint) and type(None) in get_args(hint)
    if optional:
        hint = without_none(hint)
    origin = get_origin(hint)
    is_stream, is_list = origin is Iterator, origin is list
    inner = get_args(hint)[0] if is_stream or is_list else hint
    kinds = get_args(inner) if is_union(inner) else (inner,)
    return Input(name, tuple(kinds), is_list, optional, is_stream)
