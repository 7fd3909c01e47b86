"""What every container has in common: named axes, units, shapes checked once.

**Conventions.** A container is a frozen dataclass. A field made by `column` is an
array whose axes have names; all columns that share an axis have the same length
along it. A field made by `scalar` is one value. A field whose type is a container
itself is a *part*: it is stored as a group of its own beside its owner. The unit
is the last word of a field's name, and is also given to the field for the files.
"""

from collections.abc import Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from uwtrack_cli.errors import DataError

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]
TextArray = NDArray[np.str_]


@dataclass(frozen=True)
class Column:
    """What is known of an array field: axes, unit, element type, description."""

    axes: tuple[str, ...]
    unit: str
    dtype: np.dtype[Any]
    description: str
    optional: bool


def column(
    unit: str,
    description: str,
    *axes: str,
    dtype: DTypeLike = np.float64,
    optional: bool = False,
) -> Any:
    """Declare an array field with its axes (``optional``: it may be None)."""
    spec = Column(axes, unit, np.dtype(dtype), description, optional)
    return field(default=None if optional else MISSING, metadata={"column": spec})


def scalar(unit: str, description: str, default: Any = MISSING) -> Any:
    """Declare a single value (int, float, str or bool; None means unknown)."""
    return field(default=default, metadata={"unit": unit, "description": description})


@dataclass(frozen=True, eq=False, kw_only=True)
class Container:
    """Base of the containers; checks and freezes the arrays on creation."""

    NAME: ClassVar[str] = ""
    """The name of the container in files and on the command line."""

    FIXED_AXES: ClassVar[tuple[str, ...]] = ()
    """Axes that do not grow when blocks of a stream are joined."""

    STREAMS: ClassVar[bool] = False
    """Whether the chain passes it on block by block."""

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

    def _check_axes(
        self,
        name: str,
        array: NDArray[Any],
        axes: tuple[str, ...],
        sizes: dict[str, int],
    ) -> None:
        kind = type(self).__name__
        if array.ndim != len(axes):
            msg = f"{kind}.{name} must have axes {axes}, got shape {array.shape}."
            raise DataError(msg)
        for axis, size in zip(axes, array.shape, strict=True):
            if sizes.setdefault(axis, size) != size:
                msg = (
                    f"{kind}.{name} has {size} values along {axis!r}, "
                    f"the columns before it have {sizes[axis]}."
                )
                raise DataError(msg)

    @classmethod
    def columns(cls) -> dict[str, Column]:
        """Array fields by name, in the order of their declaration."""
        return {
            f.name: f.metadata["column"] for f in fields(cls) if "column" in f.metadata
        }

    @classmethod
    def scalars(cls) -> dict[str, Field[Any]]:
        """Single-value fields by name."""
        return {f.name: f for f in fields(cls) if "unit" in f.metadata}

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
        """Keep the rows ``index`` of every column on ``axis``, in the parts too."""
        chosen: dict[str, Any] = {
            name: _take(getattr(self, name), spec.axes.index(axis), index)
            for name, spec in self.columns().items()
            if axis in spec.axes and getattr(self, name) is not None
        }
        for name in self.parts():
            part = getattr(self, name)
            if part is not None and axis in part.sizes():
                chosen[name] = part.take(axis, index)
        return replace(self, **chosen)

    @classmethod
    def join(cls, blocks: Sequence[Self]) -> Self:
        """Join consecutive blocks of a stream along every axis that grows.

        Single values and fixed axes are those of the last block.

        Raises
        ------
        DataError
            There is no block to join.
        """
        if not blocks:
            msg = f"there is no block of {cls.__name__} to join."
            raise DataError(msg)
        last = blocks[-1]
        if len(blocks) == 1:
            return last
        changes: dict[str, Any] = {
            name: np.concatenate([getattr(block, name) for block in blocks])
            for name, spec in cls.columns().items()
            if spec.axes[0] not in cls.FIXED_AXES and getattr(last, name) is not None
        }
        for name in cls.parts():
            part = getattr(last, name)
            if part is not None:
                changes[name] = type(part).join([getattr(b, name) for b in blocks])
        return replace(last, **changes)

    def equals(self, other: object) -> bool:
        """Tell whether all values are the same, bit for bit (nan equals nan)."""
        if type(other) is not type(self):
            return False
        return all(
            _same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)
        )


def _as_column(values: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    array = np.asarray(values, dtype=None if dtype.kind == "U" else dtype)
    if dtype.kind == "U" and array.dtype.kind != "U":
        array = array.astype(np.str_)
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def _take(
    array: NDArray[Any], position: int, index: NDArray[Any] | slice
) -> NDArray[Any]:
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
