"""Older layouts, read as if they were of today's.

**Method.** A chain: each version has one function that turns a column of its own files
into that of the next version, and a column read from an older file passes through all
that follow. The file itself is never changed.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.files.layout import SCHEMA_VERSION

Migration = Callable[[str, str, NDArray[Any]], NDArray[Any]]
"""Takes the names of container and column, and elements; returns the elements."""


def migrate(
    version: int, container: str, column: str, values: NDArray[Any]
) -> NDArray[Any]:
    """Turn elements of a column as a version stores them into those of today's.

    Parameters
    ----------
    version
        Version of the layout of the file that was read.
    container
        Name of the container.
    column
        Name of the column.
    values
        Elements as they are stored.
    """
    for older in range(version, SCHEMA_VERSION):
        values = MIGRATIONS[older](container, column, values)
    return values


def _points_in_single(
    container: str, column: str, values: NDArray[Any]
) -> NDArray[Any]:
    """Version 1 kept every column of lines in double precision."""
    if container != Lines.NAME or column not in Lines.columns():
        return values
    now = Lines.columns()[column].dtype
    if now.kind not in "if" or values.dtype.kind != now.kind:
        return values
    with np.errstate(over="ignore"):  # a variance beyond single precision is infinite
        return values.astype(now, copy=False)


MIGRATIONS: dict[int, Migration] = {1: _points_in_single}
"""What leads from each older version to the next."""
