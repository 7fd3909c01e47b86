"""Long columns of a container, held on disk and taken from there page by page.

**Method.** What a run reads back of a day is mostly not looked at: noise that only
pictures show, covariances that no fit takes, levels hours away from a passage. Long
columns are written into a file without a name, in the folder for temporary files, and
mapped: the system reads the pages that are asked for, and may drop them again.
"""

import tempfile
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import Container

C = TypeVar("C", bound=Container)

LEAST_BYTES = 1 << 18
"""Columns below this stay in memory: hours of most columns do."""


def on_disk(container: C) -> C:
    """Return a container with the same values whose long columns are mapped files.

    On a disk that is full the columns stay in memory.

    Parameters
    ----------
    container
        A container, with its parts.
    """
    changes: dict[str, Any] = {}
    for name in container.columns():
        values = getattr(container, name)
        if values is not None and values.nbytes >= LEAST_BYTES:
            changes[name] = _mapped(values)
    for name in container.parts():
        part = getattr(container, name)
        if part is not None:
            changes[name] = on_disk(part)
    return replace(container, **changes)


def _mapped(values: NDArray[Any]) -> NDArray[Any]:
    try:
        with tempfile.TemporaryFile(prefix="uwtrack-") as file:
            file.write(np.ascontiguousarray(values).data)
            file.flush()
            mapped = np.memmap(file, values.dtype, "r", shape=values.shape)
    except OSError:
        return values
    return mapped.view(np.ndarray)
