"""Opening a sound file, whatever its name, and where its header lacks the length.

**Method.** A recorder that loses its power leaves a WAV file whose header says that
no sound follows, since the length is written last. Such a header is read as if it
named all that follows it, and that of a streamed FLAC or RF64 file as if it named all
that is there; the file itself is not touched.
"""

import contextlib
import io
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import soundfile

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.flac_length import LENGTH_AT, flac_head, flac_samples
from uwtrack_cli.files.audio.header import sample_bytes
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.text_escaping import shell_word

DECODE_SAMPLES = 512
MOST_BYTES = 0xFFFFFFF0
"""More than this a WAV header cannot name."""

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""First bytes of an HDF5 file, by which a product is known that is given as sound."""

SUFFIXES = (".wav", ".rf64", ".w64", ".flac", ".aif", ".aiff")
"""Endings of recordings, in lower case."""


@dataclass(frozen=True)
class SoundFacts:
    """Rate, length and channels as the header tells them."""

    sample_rate_hz: int
    """Sample rate, Hz."""
    n_samples: int
    """Samples per channel."""
    n_channels: int
    """Number of channels."""


@contextlib.contextmanager
def open_sound(path: Path) -> Iterator[soundfile.SoundFile]:
    """Open a sound file for reading.

    Raises
    ------
    SoundFileError
        The file is no sound.
    """
    with contextlib.ExitStack() as stack:
        length, completed = _missing_length(path), None
        if length is not None:
            completed = stack.enter_context(_Completed(path, *length))
        file = soundfile.SoundFile(completed or _system_name(as_input(path)))
        yield stack.enter_context(file)


def _missing_length(path: Path) -> tuple[int, bytes] | None:
    """Return where the header of a file lacks its length, and the bytes of it."""
    counted = sample_bytes(path)
    if counted is not None and counted.is_unstated:
        at = counted.length_at
        if counted.is_open:
            return at, struct.pack("<Q", counted.present)
        with as_input(path).open("rb") as file:
            order = ">" if file.read(4) == b"RIFX" else "<"
        return at, struct.pack(order + "I", min(counted.present, MOST_BYTES))
    facts = as_input(path).stat()
    return _missing_flac_length(path, facts.st_size, facts.st_mtime_ns)


@lru_cache(maxsize=16)
def _missing_flac_length(path: Path, *_stamp: int) -> tuple[int, bytes] | None:
    """Return the same of a FLAC file as it is now."""
    with as_input(path).open("rb") as file:
        head = flac_head(file)
        if head is None or head.n_samples:
            return None
        return LENGTH_AT, head.with_length(flac_samples(file, head))


def _system_name(path: Path) -> bytes | str:
    """Return a name as the system takes it: on POSIX any bytes."""
    return os.fsencode(path) if os.name == "posix" else str(path)


def decodable_samples(path: Path, n_samples: int) -> int:
    """Return how many samples per channel can be decoded, at most those promised."""
    with open_sound(path) as file:
        try:
            file.seek(n_samples - 1)
            if len(file.read(1, dtype="float32")) == 1:
                return n_samples
        except soundfile.SoundFileError:
            pass  # cut short: what precedes the cut is counted below
    count = 0
    with open_sound(path) as file:
        try:
            while part := len(file.read(DECODE_SAMPLES, dtype="float32")):
                count += part
        except soundfile.SoundFileError:
            pass
    return count


def sound_facts(path: Path) -> SoundFacts:
    """Return what the header of a recording says.

    Raises
    ------
    DataError
        The file is missing or no recording.
    """
    check_readable(path)
    try:
        with open_sound(path) as sound:
            return SoundFacts(sound.samplerate, sound.frames, sound.channels)
    except (soundfile.SoundFileError, RuntimeError, OSError) as error:
        raise DataError(why_no_recording(path, error)) from error


def why_no_recording(path: Path, error: Exception) -> str:
    """Return a sentence about a file that is no recording."""
    with as_input(path).open("rb") as file:
        is_hdf5 = file.read(len(HDF5_SIGNATURE)) == HDF5_SIGNATURE
    if is_hdf5:
        return (
            f"{path} is a product (HDF5), no recording that can be read; "
            f"uwtrack info {shell_word(path)} tells what it holds."
        )
    told = str(getattr(error, "error_string", error)).rstrip(".")
    return (
        f"{path} is no recording that can be read ({told}); "
        f"accepted are WAV, RF64, W64, FLAC and AIFF."
    )


class _Completed(io.FileIO):
    """A file that is read as if its header named the length of its sound."""

    def __init__(self, path: Path, at: int, length: bytes) -> None:
        super().__init__(path)
        self._at, self._length = at, length

    def readinto(self, buffer: Any) -> int:
        """Read bytes, those of the length from memory."""
        begin = self.tell()
        count = super().readinto(buffer) or 0
        view = memoryview(buffer).cast("B")
        for k, byte in enumerate(self._length, self._at - begin):
            if 0 <= k < count:
                view[k] = byte
        return count
