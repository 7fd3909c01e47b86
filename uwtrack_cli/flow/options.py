"""Options of a stage: their help, their types, and policies as tables of options.

**Conventions.** A stage with many options gathers some in a *policy*, a small frozen
dataclass with a docstring of its own. On the command line its fields are flat
(``--feedback-alpha``); in a recipe they are a table (``[track.feedback]``).
"""

import math
import re
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from inspect import getdoc
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from uwtrack_cli.errors import OptionError


@dataclass(frozen=True)
class Option:
    """An option of a stage; ``owner`` is the policy that it is a field of, if any."""

    name: str
    type: Any
    default: Any
    help: str
    owner: str | None = None

    @property
    def flat_name(self) -> str:
        """Name on the command line, with underscores."""
        return self.name if self.owner is None else f"{self.owner}_{self.name}"


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


def is_policy(hint: Any) -> bool:
    """Tell whether an annotation is a policy."""
    return isinstance(hint, type) and is_dataclass(hint)


def policy_options(owner: str, default: Any) -> list[Option]:
    """Return the fields of a policy as options, with the values of its default."""
    policy = type(default)
    texts, hints = parameter_texts(policy), get_type_hints(policy)
    return [
        Option(f.name, hints[f.name], getattr(default, f.name), texts[f.name], owner)
        for f in fields(policy)
    ]


def build_policy(where: str, default: Any, given: Any) -> Any:
    """Build a policy from a table of some of its fields.

    Raises
    ------
    OptionError
        The table has a key that is no field, or a value of another type.
    """
    policy = type(default)
    if isinstance(given, policy):
        return given
    if not isinstance(given, Mapping):
        msg = f"{where} must be a table of options, got {given!r}."
        raise OptionError(msg)
    hints = get_type_hints(policy)
    known = [f.name for f in fields(policy)]
    for name in given:
        if name not in known:
            msg = f"{where} has no option {name!r}; it has: {', '.join(known)}."
            raise OptionError(msg)
    chosen = {k: convert(f"{where}.{k}", hints[k], v) for k, v in given.items()}
    before = {name: getattr(default, name) for name in known}
    return policy(**{**before, **chosen})


def convert(where: str, hint: Any, value: Any) -> Any:
    """Check a value against an annotation, and return it in that type.

    Raises
    ------
    OptionError
        The value is of another type or not among the choices.
    """
    if is_union(hint):
        return None if value is None else convert(where, without_none(hint), value)
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Literal:
        return _one_of(where, arguments, value)
    if origin in {tuple, list}:
        return _sequence(where, origin, arguments, value)
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return _finite(where, value)
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        msg = f"{where} must be of type {hint.__name__}, got {value!r}."
        raise OptionError(msg)
    return value


def _finite(where: str, value: float) -> float:
    """Return a number that floating point can hold, as no option means infinity."""
    try:
        number = float(value)
    except OverflowError:  # an integer of hundreds of digits
        number = math.inf
    if not math.isfinite(number):
        msg = f"{where} must be a finite number, got {number}."
        raise OptionError(msg)
    return number


def is_union(hint: Any) -> bool:
    """Tell whether an annotation allows several types."""
    return get_origin(hint) in {Union, types.UnionType}


def without_none(hint: Any) -> Any:
    """Return an annotation without its None."""
    rest = tuple(a for a in get_args(hint) if a is not type(None))
    return rest[0] if len(rest) == 1 else Union[rest]  # noqa: UP007


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
