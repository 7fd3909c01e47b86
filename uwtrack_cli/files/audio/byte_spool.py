"""The last bytes of a stream that cannot go back, kept on disk.

**Method.** Two files without a name, in the folder for temporary files, are written
one after the other; when the newer one is full, the older one makes room. What a full
disk does not take is not kept, and nothing else happens: the sound goes on.
"""

import io
import tempfile
import weakref

SPOOL_BYTES = 1 << 31
"""Most bytes that are kept: 6 hours of 16 bit at 48 kHz."""


class ByteSpool:
    """Keeps the last bytes of a stream on disk.

    ``most_bytes``: most bytes that are kept; at least half of them are.
    """

    def __init__(self, most_bytes: int = SPOOL_BYTES) -> None:
        self._part_bytes = most_bytes // 2
        self._parts: list[tuple[int, io.FileIO]] = []
        self._end = 0
        weakref.finalize(self, _close, self._parts)

    def add(self, content: bytes) -> None:
        """Keep what follows on the bytes before it."""
        begin, self._end = self._end, self._end + len(content)
        try:
            if not self._parts or begin - self._parts[-1][0] >= self._part_bytes:
                file = tempfile.TemporaryFile(prefix="uwtrack-", buffering=0)  # noqa: SIM115
                self._parts.append((begin, file))
            _close(self._parts, -2)
            first, file = self._parts[-1]
            _write(file, begin - first, content)
        except OSError:  # a full disk: what is not whole is not kept
            _close(self._parts)

    def read(self, position: int, count: int) -> bytes | None:
        """Return so many bytes from a position on; None if they are not all kept."""
        found = b""
        for k, (first, file) in enumerate(self._parts):
            last = self._parts[k + 1][0] if k + 1 < len(self._parts) else self._end
            low, high = max(first, position), min(last, position + count)
            if low < high:
                file.seek(low - first)
                found += file.read(high - low)
        return found if len(found) == count else None


def _write(file: io.FileIO, position: int, content: bytes) -> None:
    file.seek(position)
    left = memoryview(content)
    while left:
        left = left[file.write(left) :]


def _close(parts: list[tuple[int, io.FileIO]], until: int | None = None) -> None:
    """Close the parts before one, all of them unless it is named."""
    for _, file in parts[:until]:
        file.close()
    del parts[:until]
