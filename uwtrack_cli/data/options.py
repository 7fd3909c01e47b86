"""Options and settings: units, ranges, and the one converter that checks them.

**Method.** The annotation of a parameter or field says all that is accepted:
``Annotated[float, Unit("Hz"), Above(0)]``. Commands, recipes, sensor files, scenarios
and tolerances convert their values with `convert` and their tables with `from_table`;
functions made by `checked` and classes derived from `OptionGroup` check the values
that Python code gives them. Nobody compares an option with its range by hand.

**Conventions.** A bound on a list or tuple holds for each of its elements. Numbers
are finite; whole numbers fit into 64 bits. Every refusal names the place, the value
and what is accepted.
"""

import difflib
import functools
import inspect
import itertools
import math
import numbers
import operator
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from uwtrack_cli.errors import OptionError

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

_LARGEST_WHOLE = 2**63 - 1


@dataclass(frozen=True)
class Unit:
    """Unit of a number, as it is printed in help and messages."""

    name: str
    """Name of the unit, such as Hz; empty text for a plain number."""


@dataclass(frozen=True)
class Bound:
    """A limit of numbers; its kinds say on which side of it they lie."""

    limit: float
    """Where numbers end to be accepted, or begin."""

    WORDS: ClassVar[str]
    """What is said before the limit."""
    HOLDS: ClassVar[Callable[[Any, Any], bool]]
    """Whether a number and the limit are in this order."""

    def accepts(self, value: float) -> bool:
        """Tell whether the number lies inside."""
        return type(self).HOLDS(value, self.limit)

    def __str__(self) -> str:
        """Return the range in words."""
        return f"{self.WORDS} {self.limit:g}"


class Above(Bound):
    """A number greater than a limit."""

    WORDS, HOLDS = "above", operator.gt


class AtLeast(Bound):
    """A number not less than a limit."""

    WORDS, HOLDS = "at least", operator.ge


class Below(Bound):
    """A number less than a limit."""

    WORDS, HOLDS = "below", operator.lt


class AtMost(Bound):
    """A number not greater than a limit."""

    WORDS, HOLDS = "at most", operator.le


@dataclass(frozen=True)
class Increasing:
    """A list of numbers, each greater than the one before."""

    def __str__(self) -> str:
        """Return the rule in words."""
        return "increasing"


@dataclass(frozen=True)
class Rungs:
    """An option of which a command takes several values, one step of the stage each."""


@dataclass(frozen=True)
class Key:
    """Name of a field in its table, where it differs from the field's own."""

    name: str
    """The key in the table."""


class OptionGroup:
    """Base of frozen dataclasses of options: every field is checked on creation."""

    def __post_init__(self) -> None:
        """Check and convert every field against its annotation.

        Raises
        ------
        OptionError
            A value is of another type or out of range.
        """
        hints = _field_hints(type(self))  # type: ignore[arg-type]  # classes are hashable
        for spec in fields(self):  # type: ignore[arg-type]  # derived classes only
            value = convert(spec.name, hints[spec.name], getattr(self, spec.name))
            object.__setattr__(self, spec.name, value)


@functools.cache
def _field_hints(group: type) -> dict[str, Any]:
    return get_type_hints(group, include_extras=True)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function check its keyword-only options when it is called.

    The checks run at the call itself, also where the function is a generator.

    ``function``: a function whose keyword-only parameters are annotated with their
    ranges.
    """

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        hints = _option_hints(function)
        for name, value in kwargs.items():
            if name in hints:
                kwargs[name] = convert(name, hints[name], value)
        return function(*args, **kwargs)

    return call


def resolved_by(
    resolver: Callable[[Any, Mapping[str, Any]], Mapping[str, Any]],
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Name the function that derives open options from the recording.

    ``resolver``: takes the recording and all options; returns those that it decides.
    What it returns is used, and written into history.
    """

    def mark(function: Callable[P, R]) -> Callable[P, R]:
        function.resolver = resolver  # type: ignore[attr-defined]
        return function

    return mark


@functools.cache
def _option_hints(function: Callable[..., Any]) -> dict[str, Any]:
    hints = get_type_hints(function, include_extras=True)
    parameters = inspect.signature(function).parameters.values()
    return {p.name: hints[p.name] for p in parameters if p.kind is p.KEYWORD_ONLY}


def convert(where: str, hint: Any, value: Any) -> Any:
    """Check a value against an annotation, and return it in that type.

    ``hint``: the annotation, with the ranges among its ``Annotated`` arguments.

    Raises
    ------
    OptionError
        The value is of another type, out of range, or not among the choices.

    Examples
    --------
    >>> convert("window_s", Annotated[float, Unit("s"), Above(0)], 2)
    2.0
    >>> convert("window_s", Annotated[float, Unit("s"), Above(0)], -1)
    Traceback (most recent call last):
    uwtrack_cli.errors.OptionError: window_s must be a number (s, above 0), got -1.
    """
    if value is None and _is_optional(hint):
        return None
    plain, rules = _split(hint)
    return _converted(where, plain, rules, value)


def from_table(kind: type[T], table: object, where: str) -> T:
    """Make a dataclass of a table, refusing unknown and missing keys.

    ``kind``: dataclass whose fields are the keys; a field that is a dataclass is a
    table within the table, a tuple of dataclasses an array of tables. ``table``: the
    table, as TOML or JSON gives it.

    Raises
    ------
    OptionError
        A key is unknown or missing, or a value is not accepted.
    """
    if isinstance(table, kind):
        return table
    if not isinstance(table, Mapping):
        raise OptionError(f"{where} must be a table of keys and values, got {shown(table)}.")
    hints = get_type_hints(kind, include_extras=True)
    known = {_key(hints[spec.name], spec.name): spec for spec in _fields(kind)}
    refuse_unknown(table, known, where)
    for key, spec in known.items():
        if key not in table and spec.default is MISSING:
            if spec.default_factory is not MISSING:
                continue
            raise OptionError(f"{where} needs the key {key!r}; known keys: {', '.join(known)}.")
    values = {
        spec.name: convert(f"{where}.{key}", hints[spec.name], table[key])
        for key, spec in known.items()
        if key in table
    }
    try:
        return kind(**values)
    except OptionError as error:
        raise OptionError(f"{where}: {error}") from error


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a question for the nearest of the known names; nothing if none is near.

    Examples
    --------
    >>> nearest("vesel", ["auto", "vessel"])
    " Did you mean 'vessel'?"
    """
    near = difflib.get_close_matches(name, list(known), n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


def refuse_unknown(
    given: Mapping[str, Any], known: Mapping[str, Any], where: str, noun: str = "key"
) -> None:
    """Refuse names that mean nothing here, since a misspelt one would be lost.

    Raises
    ------
    OptionError
        A name is unknown; the nearest and all known ones are given.
    """
    for name in given:
        if name not in known:
            hint = nearest(str(name), known)
            raise OptionError(
                f"{where} has no {noun} {shown(name)}.{hint} It has: {', '.join(known)}."
            )


def unit_of(hint: Any) -> str:
    """Return the unit in an annotation, empty if it names none."""
    return next((r.name for r in _rules(hint) if isinstance(r, Unit)), "")


def range_of(hint: Any) -> str:
    """Return the range in an annotation in words, empty if everything is accepted.

    Examples
    --------
    >>> range_of(Annotated[float, Unit("Hz"), Above(0), AtMost(1e6)])
    'above 0, at most 1e+06'
    """
    rules = [r for r in _rules(hint) if isinstance(r, Bound | Increasing)]
    return ", ".join(map(str, rules))


def makes_rungs(hint: Any) -> bool:
    """Tell whether a command takes several values of an option, for a step each."""
    return any(isinstance(rule, Rungs) for rule in _split(hint)[1])


def plain_type(hint: Any) -> Any:
    """Return an annotation without units and ranges, those of its parts included."""
    if get_origin(hint) is Annotated:
        return plain_type(get_args(hint)[0])
    origin, arguments = get_origin(hint), get_args(hint)
    if is_union(hint):
        return Union[tuple(plain_type(a) for a in arguments)]  # noqa: UP007
    if origin in {tuple, list}:
        plain = tuple(a if a is Ellipsis else plain_type(a) for a in arguments)
        return origin[plain]
    return hint


def is_union(hint: Any) -> bool:
    """Tell whether an annotation allows several types."""
    return get_origin(hint) in {Union, types.UnionType}


def without_none(hint: Any) -> Any:
    """Return an annotation without its None."""
    rest = tuple(a for a in get_args(hint) if a is not type(None))
    return rest[0] if len(rest) == 1 else Union[rest]  # noqa: UP007


def _split(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the type and all the rules of an annotation, outer ones last."""
    rules: tuple[Any, ...] = ()
    while True:
        if get_origin(hint) is Annotated:
            hint, *more = get_args(hint)
            rules = (*more, *rules)
        elif is_union(hint):
            hint = without_none(hint)
            if is_union(hint):
                return hint, rules
        else:
            return hint, rules


def _rules(hint: Any) -> tuple[Any, ...]:
    """Return the rules of an annotation and of the elements of a list."""
    plain, rules = _split(hint)
    if get_origin(plain) in {tuple, list}:
        return (*_split(get_args(plain)[0])[1], *rules)
    return rules


def _is_optional(hint: Any) -> bool:
    if get_origin(hint) is Annotated:
        return _is_optional(get_args(hint)[0])
    return is_union(hint) and type(None) in get_args(hint)


def _fields(kind: type[Any]) -> Iterator[Field[Any]]:
    return (spec for spec in fields(kind) if spec.init)


def _key(hint: Any, name: str) -> str:
    return next((r.name for r in _split(hint)[1] if isinstance(r, Key)), name)


def _converted(where: str, plain: Any, rules: tuple[Any, ...], value: Any) -> Any:
    origin, arguments = get_origin(plain), get_args(plain)
    if origin is Literal:
        return _one_of(where, arguments, value)
    if origin in {tuple, list}:
        return _sequence(where, plain, rules, value)
    if plain in {float, int}:
        return _number(where, plain, rules, value)
    if is_dataclass(plain) and isinstance(plain, type):
        return from_table(plain, value, where)
    if is_union(plain):
        return _any_of(where, arguments, rules, value)
    if isinstance(plain, type) and not isinstance(value, plain):
        noun = {str: "a text", bool: "true or false"}.get(plain, plain.__name__)
        raise OptionError(f"{where} must be {noun}, got {shown(value)}.")
    return value


def _any_of(where: str, kinds: tuple[Any, ...], rules: tuple[Any, ...], value: Any) -> Any:
    refusal = ""
    for kind in kinds:
        plain, own = _split(kind)
        try:
            return _converted(where, plain, (*own, *rules), value)
        except OptionError as error:
            refusal = str(error)
    raise OptionError(refusal)


def _one_of(where: str, choices: tuple[Any, ...], value: Any) -> Any:
    if value not in choices or isinstance(value, bool) != any(
        isinstance(choice, bool) for choice in choices
    ):
        names = ", ".join(map(repr, choices))
        raise OptionError(f"{where} must be one of {names}, got {shown(value)}.")
    return value


def _sequence(where: str, plain: Any, rules: tuple[Any, ...], value: Any) -> Any:
    origin, arguments = get_origin(plain), get_args(plain)
    if not isinstance(value, list | tuple):
        raise OptionError(f"{where} must be a list of values, got {shown(value)}.")
    if origin is list or Ellipsis in arguments:
        hints: tuple[Any, ...] = (arguments[0],) * len(value)
    else:
        hints = arguments
    if len(value) != len(hints):
        raise OptionError(f"{where} takes {len(hints)} values, got {len(value)}: {shown(value)}.")
    found = []
    each = tuple(r for r in rules if not isinstance(r, Increasing))
    for number, (hint, element) in enumerate(zip(hints, value, strict=True), 1):
        inner, own = _split(hint)
        place = f"{where}[{number}]" if is_dataclass(inner) else where
        found.append(_converted(place, inner, (*own, *each), element))
    increasing = any(isinstance(r, Increasing) for r in rules)
    if increasing and any(a >= b for a, b in itertools.pairwise(found)):
        raise OptionError(f"{where} must be increasing, got {shown(value)}.")
    return origin(found)


def _number(where: str, plain: Any, rules: tuple[Any, ...], value: Any) -> float | int:
    kind = numbers.Integral if plain is int else numbers.Real
    if isinstance(value, bool) or not isinstance(value, kind):
        raise OptionError(_refusal(where, plain, rules, value))
    try:
        number = plain(value)
    except OverflowError:  # an integer of hundreds of digits
        number = math.inf
    outside = not math.isfinite(number) if plain is float else abs(number) > _LARGEST_WHOLE
    if outside or not all(r.accepts(number) for r in rules if isinstance(r, Bound)):
        raise OptionError(_refusal(where, plain, rules, value))
    return number  # type: ignore[no-any-return]


def _refusal(where: str, plain: Any, rules: tuple[Any, ...], value: Any) -> str:
    noun = "a whole number" if plain is int else "a number"
    if isinstance(value, float) and not math.isfinite(value):
        noun = "a finite number"
    facts = [str(r) for r in rules if isinstance(r, Bound)]
    facts = [*(r.name for r in rules if isinstance(r, Unit)), *facts]
    limits = f" ({', '.join(facts)})" if facts else ""
    return f"{where} must be {noun}{limits}, got {shown(value)}."


def shown(value: Any) -> str:
    """Return a value as text that fits into a sentence.

    Examples
    --------
    >>> shown("a"), shown(10**5000)
    ("'a'", 'a whole number beyond 64 bits')
    """
    if isinstance(value, int) and abs(value) > _LARGEST_WHOLE:
        return "a whole number beyond 64 bits"
    text = repr(value[:80] if isinstance(value, str) else value)
    return text if len(text) <= 80 else f"{text[:77]}..."
