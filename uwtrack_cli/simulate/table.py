"""Tables of plain values into checked, frozen dataclasses.

**Method.** The fields of a dataclass are the keys of its table. A nested dataclass
is a table within the table, a tuple of them an array of tables. Numbers are checked
against the bounds given with `fact`, text against its choices.

**Conventions.** Every refusal names the place in the table (``vessel[1].line[2]``),
the value, and what is accepted.
"""

from collections.abc import Mapping
from dataclasses import MISSING, Field, field, fields, is_dataclass
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from uwtrack_cli.errors import OptionError

T = TypeVar("T")

HUGE = 1e300
"""Magnitude from which a number is none: nan, infinite, or a slip of the keyboard."""


def fact(
    default: Any = MISSING,
    *,
    low: float = -np.inf,
    high: float = np.inf,
    choices: tuple[str, ...] = (),
    key: str = "",
) -> Any:
    """Declare a field with its bounds (both included), its choices or its key."""
    checks = {"low": low, "high": high, "choices": choices}
    return field(default=default, metadata=checks | ({"key": key} if key else {}))


def from_table(kind: type[T], table: object, where: str = "scenario") -> T:
    """Make a ``kind`` of a table, refusing unknown keys and values out of range.

    Raises
    ------
    OptionError
        A key is unknown or missing, or a value is not accepted.
    """
    if not isinstance(table, Mapping):
        msg = f"{where} must be a table of keys and values, got {table!r}."
        raise OptionError(msg)
    known = _keys(kind)
    unknown = sorted(set(table) - set(known))
    if unknown:
        msg = f"{where} has no key {unknown[0]!r}; known keys: {', '.join(known)}."
        raise OptionError(msg)
    hints = get_type_hints(kind)
    values = {
        spec.name: _convert(table[key], hints[spec.name], spec, f"{where}.{key}")
        for key, spec in known.items()
        if key in table
    }
    _require(known, values, where)
    try:
        return kind(**values)
    except OptionError as error:
        msg = f"{where}: {error}"
        raise OptionError(msg) from error


def _keys(kind: type[Any]) -> dict[str, Field[Any]]:
    return {spec.metadata.get("key", spec.name): spec for spec in fields(kind)}


def _require(known: dict[str, Field[Any]], values: dict[str, Any], where: str) -> None:
    for key, spec in known.items():
        if spec.name not in values and spec.default is MISSING:
            msg = f"{where} needs the key {key!r}; known keys: {', '.join(known)}."
            raise OptionError(msg)


def _convert(value: Any, hint: Any, spec: Field[Any], where: str) -> Any:
    if get_origin(hint) in (Union, UnionType):
        hint = next(kind for kind in get_args(hint) if kind is not type(None))
    if is_dataclass(hint):
        return from_table(hint, value, where)  # type: ignore[arg-type]
    if get_origin(hint) is tuple:
        return _convert_list(value, get_args(hint), spec, where)
    if hint in (float, int):
        return _number(value, hint, spec, where)
    choices = spec.metadata.get("choices", ())
    if not isinstance(value, str) or (choices and value not in choices):
        accepted = " or ".join(repr(choice) for choice in choices) or "text"
        msg = f"{where} must be {accepted}, got {value!r}."
        raise OptionError(msg)
    return value


def _convert_list(
    value: Any, kinds: tuple[Any, ...], spec: Field[Any], where: str
) -> tuple[Any, ...]:
    any_length = kinds[-1] is Ellipsis
    if not isinstance(value, list | tuple) or not (
        any_length or len(value) == len(kinds)
    ):
        count = "" if any_length else f" of {len(kinds)}"
        msg = f"{where} must be a list{count}, got {value!r}."
        raise OptionError(msg)
    return tuple(
        _convert(item, kinds[0] if any_length else kind, spec, f"{where}[{i}]")
        for i, (item, kind) in enumerate(
            zip(value, [kinds[0]] * len(value) if any_length else kinds, strict=True), 1
        )
    )


def _number(value: Any, kind: type, spec: Field[Any], where: str) -> float | int:
    low, high = spec.metadata.get("low", -np.inf), spec.metadata.get("high", np.inf)
    whole = isinstance(value, int) and not isinstance(value, bool)
    right_kind = whole or (kind is float and isinstance(value, float))
    if not right_kind or not low <= value <= high or not abs(value) < HUGE:
        noun = "a number" if kind is float else "a whole number"
        msg = f"{where} must be {noun} in [{low:g}, {high:g}], got {value!r}."
        raise OptionError(msg)
    return kind(value)  # type: ignore[no-any-return]


def exactly_one(owner: object, *names: str) -> None:
    """Refuse an object of which none or several of the named facts are given."""
    given = [name for name in names if getattr(owner, name) is not None]
    if len(given) != 1:
        msg = f"give exactly one of {' and '.join(names)}, got {given or 'none'}."
        raise OptionError(msg)
