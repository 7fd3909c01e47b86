"""Bytes that are still coming: through a pipe, or into a file that is being written.

**Method.** A thread reads a pipe and holds at most ``HELD_BYTES`` that have not been
worked on. When these are full it reads no further, the pipe fills, and the program
that writes into it waits or drops sound: that is all the back-pressure there is. A
file that grows is asked again and again for what has been added.

**Conventions.** Waiting is done in short turns, so that a signal is met at once.
"""

import abc
import hashlib
import io
import os
import tempfile
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.input_ledger import as_input, standard_input

HELD_BYTES = 1 << 24
"""Bytes that a pipe may be ahead of the work: 3 minutes of 16 bit at 48 kHz."""

PIECE_BYTES = 1 << 16
"""Bytes that are asked for at once."""

TURN_S = 0.2
"""How long is waited before it is looked whether to go on, s."""

STALL_S = 5.0
"""A pipe that gives nothing for so long has stalled, s."""

NAMELESS_S = 1.0
"""A file that has lost its name and does not grow for so long is complete, s."""

JUMP_S = 1.0
"""A change of the computer's clock by so much is a jump, s."""


class ByteStream(abc.ABC):
    """Bytes taken in order, as many as asked for unless the stream ends.

    ``idle_s``: the stream ends when nothing came for so long, s; None waits for ever.
    """

    def __init__(self, name: str, idle_s: float | None = None) -> None:
        self.name = name
        self.n_bytes = 0
        """Bytes taken so far."""
        self.stalls_s: list[float] = []
        """How long it stalled, s, since somebody emptied the list."""
        self.clock_jumps_s: list[float] = []
        """By how much the computer's clock jumped, s, likewise."""
        self._idle_s = idle_s
        self._held = bytearray()
        self._is_over = False
        self._sha256 = hashlib.sha256()
        self._last_s = time.monotonic()
        self._clock_s = time.time() - self._last_s

    def take(self, count: int) -> bytes:
        """Take so many bytes; fewer only when the stream has ended."""
        while len(self._held) < count and not self._is_over:
            self._wait()
        found = bytes(self._held[:count])
        del self._held[:count]
        self.n_bytes += len(found)
        return found

    def end(self) -> None:
        """End the stream here: what has not been taken is left."""
        self._is_over = True
        self._held.clear()

    @property
    def digest(self) -> str:
        """SHA-256 of everything that came."""
        return self._sha256.hexdigest()

    @abc.abstractmethod
    def again(self, position: int, count: int) -> bytes | None:
        """Return bytes again that were taken; None if they are no longer at hand.

        ``position``: bytes before them in the stream.
        """

    @abc.abstractmethod
    def _next(self) -> bytes | None:
        """Return what came; nothing at the end, None when there is nothing yet."""

    def _wait(self) -> None:
        piece = self._next()
        now_s = time.monotonic()
        waited_s = now_s - self._last_s
        if piece is None:
            self._is_over |= self._idle_s is not None and waited_s >= self._idle_s
            return
        self._last_s = now_s
        jump_s = time.time() - now_s - self._clock_s
        if abs(jump_s) > JUMP_S:
            self.clock_jumps_s.append(jump_s)
            self._clock_s += jump_s
        if not piece and not self._is_over:
            self._is_over = True
        elif not self._is_over:
            self._sha256.update(piece)
            self._held += piece


class PipeStream(ByteStream):
    """Standard input, a named pipe, or another file that cannot be read twice.

    ``opener``: opens it, unbuffered. ``idle_s``: it ends when nothing came for so long,
    s; None waits for ever.
    """

    def __init__(
        self, name: str, opener: Callable[[], BinaryIO], idle_s: float | None = None
    ) -> None:
        super().__init__(name, idle_s)
        self._opener = opener
        self._spool = ByteSpool()
        self._pieces: deque[tuple[bytes, float]] = deque()
        self._n_waiting = 0
        self._failure: OSError | None = None
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def take(self, count: int) -> bytes:
        """Take so many bytes, and keep them on disk; fewer when the stream has ended."""
        found = super().take(count)
        self._spool.add(found)
        return found

    @property
    def n_waiting(self) -> int:
        """Bytes that have come and wait to be worked on."""
        return self._n_waiting

    def end(self) -> None:
        """End the stream here: what has not been taken is left."""
        super().end()
        with self._changed:
            self._changed.notify_all()

    def again(self, position: int, count: int) -> bytes | None:
        """Return bytes again that were taken; None if they are no longer kept."""
        return self._spool.read(position, count)

    def _next(self) -> bytes | None:
        with self._changed:
            if not self._pieces:
                self._changed.wait(TURN_S)
            if not self._pieces:
                return None
            piece, read_s = self._pieces.popleft()
            self._n_waiting -= len(piece)
            self._changed.notify_all()
        if piece and read_s > STALL_S and self.n_bytes:
            self.stalls_s.append(read_s)
        if not piece and self._failure is not None:
            reason = self._failure.strerror or self._failure
            raise DataError(f"cannot read {self.name}: {reason}.")
        return piece

    def _read(self) -> None:
        """Read until the end; the thread ends with the program or with the stream."""
        try:
            with self._opener() as file:
                piece = b" "
                while piece:
                    begin_s = time.monotonic()
                    piece = file.read(PIECE_BYTES)
                    if not self._hold(piece, time.monotonic() - begin_s):
                        return
        except OSError as error:
            self._failure = error
            self._hold(b"", 0.0)

    def _hold(self, piece: bytes, read_s: float) -> bool:
        """Hold a piece when there is room; return False if nobody wants it."""
        with self._changed:
            while self._n_waiting >= HELD_BYTES and not self._is_over:
                self._changed.wait(TURN_S)
            if self._is_over:
                return False
            self._pieces.append((piece, read_s))
            self._n_waiting += len(piece)
            self._changed.notify_all()
            return True


class GrowingFile(ByteStream):
    """A file that another program is still writing.

    It is held open: when its name is taken from it, or given to another file, what was
    written into it is there to the end. One that becomes shorter ends where it was read
    to. Both are told.

    ``idle_s``: it is complete when it has not grown for so long, s; None waits for
    ever. ``stated_end``: tells of the open file where the sound ends as it says by now;
    None if it does not.
    """

    def __init__(
        self,
        path: Path,
        idle_s: float | None,
        stated_end: Callable[[BinaryIO], int | None] | None = None,
    ) -> None:
        super().__init__(str(path), idle_s)
        self._stated_end = stated_end
        self._path = as_input(path)
        self._file = self._path.open("rb", buffering=0)
        weakref.finalize(self, self._file.close)
        self._position = 0
        self._is_shorter = False

    @property
    def digest(self) -> str:
        """SHA-256 of the file as it is now, whose header is written last.

        Of a file that has become shorter, it is that of what came.
        """
        if self._is_shorter:
            return super().digest
        self._file.seek(0)
        return hashlib.file_digest(self._file, "sha256").hexdigest()

    def again(self, position: int, count: int) -> bytes | None:
        """Return bytes of the file again; None if they are no longer there."""
        self._file.seek(position)
        found = self._file.read(count)
        return found if len(found) == count else None

    def _next(self) -> bytes | None:
        if os.fstat(self._file.fileno()).st_size < self._position:
            self._is_shorter = True
            warn(
                f"{self.name} has become shorter while it was followed: what was read "
                f"before is used."
            )
            return b""
        end = None if self._stated_end is None else self._stated_end(self._file)
        room = PIECE_BYTES if end is None else max(0, end - self._position)
        self._file.seek(self._position)
        piece = self._file.read(min(PIECE_BYTES, room))
        self._position += len(piece)
        if piece:
            return piece
        if time.monotonic() - self._last_s >= NAMELESS_S and not self._has_its_name():
            warn(
                f"{self.name} was moved, replaced or removed while it was followed: "
                f"what was written into it is used."
            )
            return b""
        time.sleep(TURN_S)
        return None

    def _has_its_name(self) -> bool:
        """Tell whether the file is still the one that its name leads to."""
        try:
            return os.path.samestat(os.fstat(self._file.fileno()), self._path.stat())
        except OSError:
            return False


def open_pipe(path: Path, idle_s: float | None) -> PipeStream:
    """Open a named pipe or a device; it is waited for its writer."""
    return PipeStream(str(path), lambda: as_input(path).open("rb", buffering=0), idle_s)


def open_standard_input(idle_s: float | None) -> PipeStream:
    """Open standard input as a stream of bytes.

    Raises
    ------
    DataError
        It is a terminal, or closed.
    """
    name = "standard input"
    stream = standard_input()
    if stream is None:
        raise DataError("standard input is closed: there is no sound.")
    if stream.isatty():
        raise DataError(
            "standard input is a terminal: send sound through a pipe, as with "
            "sox FILE -t wav - | uwtrack run - -o pass.run.h5."
        )
    try:
        number = os.dup(stream.fileno())
    except (OSError, io.UnsupportedOperation):  # a stream without a file
        return PipeStream(name, lambda: io.BytesIO(stream.read()), idle_s)
    return PipeStream(name, lambda: os.fdopen(number, "rb", buffering=0), idle_s)


SPOOL_BYTES = 1 << 31
"""Most bytes that are kept: 6 hours of 16 bit at 48 kHz."""


class ByteSpool:
    """Keeps the last bytes of a stream on disk.

    Two files without a name, in the folder for temporary files, are written one after
    the other; when the newer one is full, the older one makes room. What a full disk
    does not take is not kept, and nothing else happens: the sound goes on.

    ``most_bytes``: most bytes that are kept; at least half of them are.
    """

    def __init__(self, most_bytes: int = SPOOL_BYTES) -> None:
        self._part_bytes = most_bytes // 2
        self._parts: list[tuple[int, io.FileIO]] = []
        self._end = 0
        weakref.finalize(self, _close_parts, self._parts)

    def add(self, content: bytes) -> None:
        """Keep what follows on the bytes before it."""
        begin, self._end = self._end, self._end + len(content)
        try:
            if not self._parts or begin - self._parts[-1][0] >= self._part_bytes:
                file = tempfile.TemporaryFile(prefix="uwtrack-", buffering=0)  # noqa: SIM115
                self._parts.append((begin, file))
            _close_parts(self._parts, -2)
            first, file = self._parts[-1]
            _write_at(file, begin - first, content)
        except OSError:  # a full disk: what is not whole is not kept
            _close_parts(self._parts)

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


def _write_at(file: io.FileIO, position: int, content: bytes) -> None:
    file.seek(position)
    left = memoryview(content)
    while left:
        left = left[file.write(left) :]


def _close_parts(parts: list[tuple[int, io.FileIO]], until: int | None = None) -> None:
    """Close the parts before one, all of them unless it is named."""
    for _, file in parts[:until]:
        file.close()
    del parts[:until]
