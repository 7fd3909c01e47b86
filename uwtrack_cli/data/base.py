"""What every container has in common: named axes, units, shapes checked once.

**Conventions.** A container is a frozen dataclass. A field made by `column` is an
array whose axes have names; all columns that share an axis have the same length
along it. A field made by `scalar` is one value. A field whose type is a container
itself is a *part*: it is stored as a group of its own beside its owner.

What a declaration says of itself is not said again: a column that names no axis lies
on the class's `Container.ROW`; its elements are those of its annotation (64 bits, where
it names no narrower ``dtype``), and it may be left out where the annotation has None;
the unit is the last word of its name, as in ``bearing_deg``, where it gives no other.

A *ragged table* holds what the rows of another axis have in any number: rest
frequencies of an encounter, reasons. It is an axis of its own whose first column, the
one with an ``owner``, holds the row of that axis that each row belongs to.

The object that stands for a row in JSON, in CSV and on the screen follows from the
declarations, too: a column of the main axis stands under its own name, one of a ragged
table under the ``key`` that it names. A dot in the key divides the name of an object from
the key within it; ``"vessel."`` is the key ``name`` of the object ``vessel`` for a column
``vessel_name``.
"""

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from html import escape
from inspect import get_annotations
from types import NoneType, UnionType
from typing import Any, ClassVar, Self, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.errors import DataError

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]
TextArray = NDArray[np.str_]
T = TypeVar("T")

UNITS = {
    "per_s": "1/s", "s": "s", "ns": "ns", "hz": "Hz", "hzps": "Hz/s", "db": "dB",
    "m": "m", "m2": "m^2", "mps": "m/s", "deg": "degree", "degps": "degree/s",
    "latitude": "degree", "longitude": "degree",
}  # fmt: skip
"""Unit as files give it, by the end of a field's name; the first that fits."""

ELEMENTS: dict[Any, type[np.generic]] = {
    FloatArray: np.float64, IntArray: np.int64, BoolArray: np.bool_, TextArray: np.str_
}  # fmt: skip
"""Elements of a column that names no narrower type, by its annotation."""


SHOWN = 4
"""Values of a column that a notebook shows."""


def html_table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table for a notebook; its text cannot take effect."""
    marked = [("th", heads), *(("td", row) for row in rows)]
    lines = ("".join(f"<{tag}>{escape(text)}</{tag}>" for text in row) for tag, row in marked)
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


@dataclass(frozen=True)
class Cells:
    """What the cells of a column hold in a table that people give, such as a CSV file."""

    low: float = -np.inf
    """Least number accepted."""
    high: float = np.inf
    """Greatest number accepted."""
    needed: bool = False
    """Whether the table must have the column."""
    every: bool = False
    """Whether every cell must hold a value; else an empty one is not measured."""
    aliases: tuple[str, ...] = ()
    """Other names that leave no doubt about quantity and unit."""


@dataclass(frozen=True)
class Column:
    """What is known of an array field."""

    axes: tuple[str, ...]
    """Names of its axes, the one of the rows first."""
    unit: str
    """Unit as files give it; "1" for a plain number, empty for text."""
    dtype: np.dtype[Any]
    """Type of the elements."""
    description: str
    """What it is, in one sentence."""
    optional: bool
    """Whether it may be None."""
    owner: str = ""
    """Axis whose row numbers it holds, in a ragged table; else empty."""
    key: str = ""
    """Where it stands in the object of a row, a dot before a key within an object; empty:
    nowhere."""
    names: str = ""
    """Key of the objects whose own keys are its texts, in a ragged table; else empty."""
    unknown: str | int | None = None
    """Value that stands for one that is not known; None: nan alone does."""
    choices: tuple[str, ...] = ()
    """Texts that it may hold; empty: any."""
    cells: Cells | None = None
    """How tables that people give hold it; None: they do not."""


@dataclass(frozen=True)
class RowKey:
    """What stands under one key of the object of a row."""

    columns: dict[str, str]
    """Columns by their keys within it; one under the empty key is the value itself."""
    owner: str
    """Column with the rows that those of a ragged table belong to; empty: they are
    columns of the main axis."""
    names: str
    """Column with the keys of a mapping; empty: a ragged table is a list."""


@dataclass(frozen=True)
class _Declared:
    """A field as its class declares it; `Container` completes it by its annotation.

    ``axes`` is None for a single value, which may have a ``default``; ``description`` and
    what ``told`` holds are those of `Column`.
    """

    description: str
    axes: tuple[str, ...] | None
    told: dict[str, Any]
    default: Any


def column(description: str, *axes: str, **told: Any) -> Any:
    """Declare an array field.

    ``told``: unit, dtype, owner, key, names, unknown, choices and cells as of `Column`, where
    they do not follow from the conventions above.
    """
    return _Declared(description, axes, told, MISSING)


def deviation(*axes: str, **told: Any) -> Any:
    """Declare the standard deviation of the column that stands before it.

    It stands in the same object as that one, unless it has a key of its own.
    """
    return column("Its standard deviation.", *axes, **told)


def scalar(description: str, default: Any = MISSING, **told: Any) -> Any:
    """Declare a single value (int, float, str or bool; None means unknown).

    ``told``: its unit, and the ``key`` under which the object of a row has it, if any.
    """
    return _Declared(description, None, told, default)


def _completed(name: str, hint: Any, declared: _Declared, row: str, before: str) -> Any:
    """Return the field of a declaration, by its name and its annotation.

    ``row``: axis of the rows. ``before``: key of the column that stands before it.
    """
    kinds = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    text, told = declared.description, dict(declared.told)
    usual = "1" if kinds[0] in {int, float, bool, *ELEMENTS} - {TextArray} else ""
    ends = (each for each in UNITS if f"_{name}".endswith(f"_{each}"))
    unit = told.pop("unit", UNITS.get(next(ends, ""), usual))
    if declared.axes is None:
        metadata = {"unit": unit, "description": text, "key": "", **told}
        return field(default=declared.default, metadata=metadata)
    axes = declared.axes or (row,)
    stands = name.removesuffix("_ns") if name.endswith("_utc_ns") else name
    usual = stands if axes[0] == row else ""
    if text == deviation().description and ("." in before or not before):
        usual = f"{before.partition('.')[0]}." if before else ""
    outer, dot, inner = told.pop("key", usual).partition(".")
    spec = Column(
        axes=axes,
        unit=unit,
        dtype=np.dtype(told.pop("dtype", None) or ELEMENTS[kinds[0]]),
        description=text,
        optional=NoneType in kinds,
        key=f"{outer}{dot}{inner or (stands.removeprefix(f'{outer}_') if dot else '')}",
        **told,
    )
    default = None if spec.optional else MISSING
    return field(default=default, metadata={"column": spec})


@dataclass(frozen=True, eq=False, kw_only=True)
class Container:
    """Base of the containers; checks and freezes the arrays on creation."""

    NAME: ClassVar[str] = ""
    """The name of the container in files and on the command line."""

    ROW: ClassVar[str] = ""
    """The axis of its rows, which is that of the columns that name none."""

    FIXED_AXES: ClassVar[tuple[str, ...]] = ()
    """Axes that do not grow when blocks of a stream are joined."""

    STREAMS: ClassVar[bool] = False
    """Whether the chain passes it on block by block."""

    OBJECTS: ClassVar[dict[str, str]] = {}
    """What the keys that hold lists and objects are, in one sentence each."""

    _known_columns: ClassVar[dict[str, Column]]
    """What `columns` returns, once it was asked of the class itself."""

    def __init_subclass__(cls) -> None:
        """Complete what the class declares, before it is made a dataclass."""
        before = ""
        for name, hint in get_annotations(cls).items():
            declared = cls.__dict__.get(name)
            if isinstance(declared, _Declared):
                made = _completed(name, hint, declared, cls.ROW, before)
                setattr(cls, name, made)
                if "column" in made.metadata:
                    before = made.metadata["column"].key

    def __post_init__(self) -> None:
        """Convert every column to its type, freeze it and check the axes."""
        sizes: dict[str, int] = {}
        for name, spec in self.columns().items():
            values = getattr(self, name)
            if values is None and spec.optional:
                continue
            array = _as_column(values, spec.dtype)
            self._check_axes(name, array, spec.axes, sizes)
            object.__setattr__(self, name, array)
        for name, spec in self.owner_columns().items():
            rows, count = getattr(self, name), sizes[spec.owner]
            if rows is None:
                continue
            if rows.size and not (rows.min() >= 0 and rows.max() < count):
                raise DataError(
                    f"{type(self).__name__}.{name} must hold rows from 0 to "
                    f"{count - 1}, got {rows.min()} to {rows.max()}."
                )

    def _check_axes(
        self, name: str, array: NDArray[Any], axes: tuple[str, ...], sizes: dict[str, int]
    ) -> None:
        kind = type(self).__name__
        if array.ndim != len(axes):
            raise DataError(f"{kind}.{name} must have axes {axes}, got shape {array.shape}.")
        for axis, size in zip(axes, array.shape, strict=True):
            if sizes.setdefault(axis, size) != size:
                raise DataError(
                    f"{kind}.{name} has {size} values along {axis!r}, "
                    f"the columns before it have {sizes[axis]}."
                )

    @classmethod
    def columns(cls) -> dict[str, Column]:
        """Array fields by name: the class's own as declared, then the inherited."""
        known = cls.__dict__.get("_known_columns")
        if known is None:  # containers are made by the thousand
            own = get_annotations(cls)
            ordered = sorted(fields(cls), key=lambda each: each.name not in own)
            known = {f.name: f.metadata["column"] for f in ordered if "column" in f.metadata}
            cls._known_columns = known
        return dict(known)

    @classmethod
    def scalars(cls) -> dict[str, Field[Any]]:
        """Single-value fields by name."""
        return {f.name: f for f in fields(cls) if "unit" in f.metadata}

    @classmethod
    def owner_columns(cls) -> dict[str, Column]:
        """Columns that say which row of another axis a row belongs to, by name."""
        return {name: spec for name, spec in cls.columns().items() if spec.owner}

    def owned_rows(self, name: str, row: int) -> IntArray:
        """Return the rows of a ragged table that belong to one row of its owner.

        ``name``: the column with the row numbers, such as ``rest_encounter``. ``row``:
        row of the owner.
        """
        return np.flatnonzero(getattr(self, name) == row)

    @classmethod
    @functools.cache
    def row_keys(cls) -> dict[str, RowKey]:
        """Return the keys of the object of a row that hold columns, in their order."""
        owned = {s.axes[0]: n for n, s in cls.owner_columns().items() if s.owner == cls.ROW}
        names = {spec.names: name for name, spec in cls.columns().items()}
        found: dict[str, RowKey] = {}
        for name, spec in cls.columns().items():
            outer, _, inner = spec.key.partition(".")
            if outer:
                new = RowKey({}, owned.get(spec.axes[0], ""), names.get(outer, ""))
                found.setdefault(outer, new).columns[inner] = name
        return found

    def ragged(self, key: str, row: int) -> Any:
        """Return what a row has in a ragged table: a list, or a mapping by its names.

        ``key``: its key in the object of a row. ``row``: row of the main axis.
        """
        one = self.row_keys()[key]
        columns = {
            inner: values
            for inner, name in one.columns.items()
            if (values := getattr(self, name)) is not None
        }
        rows = self.owned_rows(one.owner, row).tolist() if columns else []
        items: list[Any] = [
            {inner: values[i].item() for inner, values in columns.items()} for i in rows
        ]
        if "" in columns:
            items = [item[""] for item in items]
        if not one.names:
            return items
        names = getattr(self, one.names)
        return {str(names[i]): item for i, item in zip(rows, items, strict=True)}

    @classmethod
    def parts(cls) -> tuple[str, ...]:
        """Names of the fields that are containers themselves."""
        known = {*cls.columns(), *cls.scalars()}
        return tuple(f.name for f in fields(cls) if f.name not in known)

    def sizes(self) -> dict[str, int]:
        """Length of every axis that has a column."""
        return {
            axis: size
            for name, spec in self.columns().items()
            if getattr(self, name) is not None
            for axis, size in zip(spec.axes, getattr(self, name).shape, strict=True)
        }

    @property
    def nbytes(self) -> int:
        """Bytes of all columns, those of the parts included."""
        values = [getattr(self, name) for name in (*self.columns(), *self.parts())]
        return sum(value.nbytes for value in values if value is not None)

    def take(self, axis: str, index: NDArray[Any] | slice) -> Self:
        """Keep the rows ``index`` of every column on ``axis``, in the parts too.

        Ragged tables that belong to the axis keep the rows of what is kept, in its
        order.
        """
        chosen: dict[str, Any] = {
            name: _take(getattr(self, name), spec.axes.index(axis), index)
            for name, spec in self.columns().items()
            if axis in spec.axes and getattr(self, name) is not None
        }
        for owner, ragged in self.owner_columns().items():
            if ragged.owner == axis and getattr(self, owner) is not None:
                kept = np.arange(self.sizes()[axis])[index]
                rows, owners = _owned(getattr(self, owner), kept)
                for name, spec in self.columns().items():
                    if spec.axes[0] == ragged.axes[0]:
                        chosen[name] = getattr(self, name)[rows]
                chosen[owner] = owners
        for name in self.parts():
            part = getattr(self, name)
            if part is not None and axis in part.sizes():
                chosen[name] = part.take(axis, index)
        return replace(self, **chosen)

    @classmethod
    def join(cls, blocks: Sequence[Self]) -> Self:
        """Join consecutive blocks of a stream along every axis but the fixed ones.

        Single values and fixed axes are those of the last block; ragged tables
        keep naming the rows that they belong to.

        Raises
        ------
        DataError
            There is no block to join.
        """
        if not blocks:
            raise DataError(f"there is no block of {cls.__name__} to join.")
        last = blocks[-1]
        if len(blocks) == 1:
            return last
        changes: dict[str, Any] = {
            name: np.concatenate([getattr(block, name) for block in blocks])
            for name, spec in cls.columns().items()
            if spec.axes[0] not in cls.FIXED_AXES
            and all(getattr(block, name) is not None for block in blocks)
        }
        changes |= {
            name: None
            for name, spec in cls.columns().items()
            if spec.optional and name not in changes and spec.axes[0] not in cls.FIXED_AXES
        }
        for name, spec in cls.owner_columns().items():
            if changes[name] is None:
                continue
            sizes = [block.sizes()[spec.owner] for block in blocks]
            before = np.cumsum([0, *sizes[:-1]])
            changes[name] = np.concatenate(
                [getattr(b, name) + n for b, n in zip(blocks, before, strict=True)]
            )
        for name in cls.parts():
            part = getattr(last, name)
            if part is not None:
                changes[name] = type(part).join([getattr(b, name) for b in blocks])
        return replace(last, **changes)

    def _repr_html_(self) -> str:
        """Show the columns in a notebook: name, unit, size, first values, meaning."""
        rows = []
        for name, spec in self.columns().items():
            values = getattr(self, name)
            if values is not None:
                size = " x ".join(map(str, values.shape))
                first = ", ".join(f"{v:.6g}" if spec.dtype.kind == "f" else str(v)
                                  for v in values.ravel()[:SHOWN])  # fmt: skip
                more = ", ..." if values.size > SHOWN else ""
                rows.append((name, spec.unit, size, first + more, spec.description))
        for name, one in self.scalars().items():
            text = str(one.metadata["description"])
            rows.append((name, one.metadata["unit"], "", str(getattr(self, name)), text))
        count = f"{self.sizes().get(self.ROW, 1)} rows of {self.ROW}" if self.ROW else ""
        heads = ("column", "unit", "size", "values", "meaning")
        return f"<b>{self.NAME}</b> {count}{html_table(heads, rows)}"

    def equals(self, other: object) -> bool:
        """Tell whether all values are the same, bit for bit (nan equals nan)."""
        if type(other) is not type(self):
            return False
        return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))


@dataclass(frozen=True, eq=False, kw_only=True)
class HasReasons(Container):
    """A container whose rows say why a value is missing, as a ragged table.

    Beside these columns, it has one with the rows that the reasons belong to.
    """

    reason_key: TextArray = column(
        "Name of the value that is missing or limited.", "reason", names="reasons"
    )
    reason_text: TextArray = column("Why it is.", "reason", key="reasons")

    def reasons(self, row: int) -> dict[str, str]:
        """Return what is missing in a row of the main axis, and why, by key."""
        return dict(self.ragged("reasons", row))


@dataclass(frozen=True, eq=False, kw_only=True)
class HasNuisances(Container):
    """A container whose rows rest on facts that are not known exactly.

    Beside these columns of a ragged table, it has one with the rows that the nuisances
    belong to; older files have none.
    """

    nuisance_name: TextArray | None = column(
        "Fact that is not known exactly, with its unit.", "nuisance", names="nuisances"
    )
    nuisance_value: FloatArray | None = column(
        "Its estimate, or the value that was assumed.", "nuisance", key="nuisances.value"
    )
    nuisance_std: FloatArray | None = deviation("nuisance", key="nuisances.std")
    nuisance_share: FloatArray | None = column(
        "Share of the variance of the speed (encounters) or of the range (motions) "
        "that it causes; nan without one.", "nuisance", key="nuisances.share",
    )  # fmt: skip

    def nuisances(self, row: int) -> dict[str, dict[str, float]]:
        """Return value, standard deviation and share of each nuisance, by name."""
        return dict(self.ragged("nuisances", row))


@dataclass(frozen=True, eq=False, kw_only=True)
class HasRestFrequencies(Container):
    """A container whose rows have rest frequencies of lines, as a ragged table.

    Beside these columns, it has one with the rows that the frequencies belong to.
    """

    rest_line_id: IntArray = column("Line that it was fitted to.", "rest_line")
    rest_frequency_hz: FloatArray = column(
        "Rest frequency.", "rest_line", key="rest_frequencies_hz"
    )
    rest_frequency_std_hz: FloatArray = deviation("rest_line", key="rest_frequencies_std_hz")


def flatten(lists: Iterable[Iterable[T]]) -> tuple[IntArray, list[T]]:
    """Return the rows of a ragged table: the number of each one's owner, and itself.

    Examples
    --------
    >>> owner, items = flatten([["a", "b"], [], ["c"]])
    >>> owner.tolist(), items
    ([0, 0, 2], ['a', 'b', 'c'])
    """
    pairs = [(row, item) for row, items in enumerate(lists) for item in items]
    return np.array([row for row, _ in pairs], np.int64), [item for _, item in pairs]


def reason_columns(owner: str, reasons: Iterable[Mapping[str, str]]) -> dict[str, NDArray[Any]]:
    """Return the columns of a table of reasons.

    ``owner``: name of the column with the rows that the reasons belong to. ``reasons``:
    reasons by key, for each of these rows.
    """
    rows, items = flatten(each.items() for each in reasons)
    return {
        owner: rows,
        "reason_key": np.array([key for key, _ in items], np.str_),
        "reason_text": np.array([text for _, text in items], np.str_),
    }


def _owned(owner: IntArray, kept: IntArray) -> tuple[IntArray, IntArray]:
    """Return the rows of a ragged table that belong to rows kept, and their owners."""
    order = np.argsort(owner, kind="stable")
    first = np.searchsorted(owner[order], kept, "left")
    count = np.searchsorted(owner[order], kept, "right") - first
    owners = np.repeat(np.arange(kept.size), count)
    within = np.arange(owners.size) - np.repeat(np.cumsum(count) - count, count)
    return order[np.repeat(first, count) + within], owners


def _as_column(values: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    array = np.asarray(values, dtype=None if dtype.kind == "U" else dtype)
    if dtype.kind == "U" and array.dtype.kind != "U":
        array = array.astype(np.str_)
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def _take(array: NDArray[Any], position: int, index: NDArray[Any] | slice) -> NDArray[Any]:
    selection = (slice(None),) * position + (index,)
    return array[selection]


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, Container):
        return a.equals(b)
    if isinstance(a, np.ndarray):
        if not isinstance(b, np.ndarray) or a.shape != b.shape:
            return False
        if a.dtype.kind == "U":  # the width of a text column carries no meaning
            return bool(np.array_equal(a, b))
        return a.dtype == b.dtype and a.tobytes() == b.tobytes()
    if isinstance(a, float) and isinstance(b, float):
        return bool(np.array_equal(a, b, equal_nan=True))
    return bool(a == b)
