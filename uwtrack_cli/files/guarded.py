"""A file that keeps quiet about a full disk until it is asked.

The HDF5 library stops the whole program when a write fails and the file is then
closed. So its writes go through here: the first failure is kept, everything after it
is swallowed, HDF5 closes in peace, and the writer raises what was kept.
"""

import io
from typing import Any


class GuardedFile(io.FileIO):
    """An unbuffered file whose failed writes are kept in ``failure``."""

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of the data, or keep the failure."""
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view) and self.failure is None:
            try:
                done += super().write(view[done:]) or 0
            except OSError as error:
                self.failure = error
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file, or keep the failure."""
        if self.failure is None:
            try:
                return super().truncate(size)
            except OSError as error:
                self.failure = error
        return size or 0
