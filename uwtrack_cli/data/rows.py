"""Records of arrays with one row each: choose rows, and put records behind each other."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, IntArray


@dataclass(frozen=True)
class Rows:
    """Base of a frozen dataclass; what is no array, or None, is the same in all rows."""

    SHARED: ClassVar[frozenset[str]] = frozenset()
    """Arrays that are the same in all rows, too."""

    def take(self, rows: BoolArray | IntArray | slice | list[int] | int) -> Self:
        """Return some of the rows; of a single one no axis is left."""
        chosen = {name: values[rows] for name, values in self.arrays().items()}
        return replace(self, **chosen)

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of one or more records, one after the other."""
        joined = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in parts[-1].arrays()
        }
        return replace(parts[-1], **joined)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that have a row each."""
        found = {}
        for one in fields(self):
            values = getattr(self, one.name)
            if isinstance(values, np.ndarray) and one.name not in self.SHARED:
                found[one.name] = values
        return found
