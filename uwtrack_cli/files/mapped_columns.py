"""Long columns of a container, held on disk and taken from there page by page.

**Method.** What a run reads back of a day is mostly not looked at: noise that only
pictures show, covariances that no fit takes, levels hours away from a passage. Long
columns are written into a file without a name, in the folder for temporary files, and
mapped: the system reads the pages that are asked for, and may drop them again.
"""

import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST_BYTES = 1 << 18
"""Columns below this stay in memory: hours of most columns do."""


def on_disk(values: NDArray[Any]) -> NDArray[Any]:
    """Return a long array as a mapped file with the same values, a short one as it is.

    On a disk that is full it stays in memory, too.

    ``values``: an array of any shape.
    """
    if values.nbytes < LEAST_BYTES:
        return values
    try:
        with tempfile.TemporaryFile(prefix="uwtrack-") as file:
            file.write(np.ascontiguousarray(values).data)
            file.flush()
            mapped = np.memmap(file, values.dtype, "r", shape=values.shape)
    except OSError:
        return values
    return mapped.view(np.ndarray)
