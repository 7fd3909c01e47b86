"""Opening a sound file, whatever its name, and where its header lacks the length.

**Method.** A recorder that loses its power leaves a WAV file whose header says that
no sound follows, since the length is written last. Such a header is read as if it
named all that follows it, and that of a streamed FLAC or RF64 file as if it named all
that is there; the file itself is not touched.

Every frame of a FLAC file says which one it is, or which sample it begins with. The last
header in the file that its own checksum confirms, and that agrees with the head of the
file, begins the last frame; where the frame's checksum does not hold, it was cut short,
and the sound ends before it.

**References.** RFC 9639 (FLAC), sections 8.2 (streaminfo) and 9.1 (frame header).
"""

import contextlib
import io
import os
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import soundfile

from uwtrack_cli.errors import DataError
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
            f"{path} is a result file (HDF5), not a recording; "
            f"uwtrack info {shell_word(path)} describes it."
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


MAGIC = b"fLaC"
STREAMINFO = 8
"""Place of the content of the first block, which says what the sound is."""

LENGTH_AT = STREAMINFO + 13
"""Place of the byte whose lower half begins the 36 bits of the length."""

TAIL_BYTES = 1 << 21
"""Bytes before the end of the file in which its last frames are sought: of 16 channels of
24 bits, two frames of 16384 samples are 1.6 MB."""

BLOCK_SIZES = {1: 192, **{2 + k: 576 << k for k in range(4)}, **{8 + k: 256 << k for k in range(8)}}
"""Samples of a frame by their code; codes 6 and 7 are followed by the number."""


@dataclass(frozen=True)
class FlacHead:
    """What the head of a file says of its sound."""

    length_bytes: bytes
    """The five bytes that hold the length, with what else is in the first of them."""
    first_frame: int
    """Place of the first frame."""

    @property
    def n_samples(self) -> int:
        """Samples per channel; 0 if it is not said."""
        return int.from_bytes(self.length_bytes, "big") & ((1 << 36) - 1)

    def with_length(self, n_samples: int) -> bytes:
        """Return the five bytes with another length."""
        kept = int.from_bytes(self.length_bytes, "big") >> 36 << 36
        return (kept | n_samples).to_bytes(5, "big")


class _Frame(NamedTuple):
    start: int
    """Place of its header in the tail of the file."""
    number: int
    """Which frame it is, or the sample that it begins with."""
    n_samples: int
    """Samples per channel."""
    is_variable: bool
    """Whether the number counts samples."""


def flac_head(file: BinaryIO) -> FlacHead | None:
    """Return what the head of a FLAC file says; None of another file."""
    file.seek(0)
    content = file.read(STREAMINFO + 34)
    if content[:4] != MAGIC or len(content) < STREAMINFO + 34 or content[4] & 0x7F:
        return None
    place, is_last = 4, False
    while not is_last:
        file.seek(place)
        header = file.read(4)
        if len(header) < 4:
            return None
        is_last = bool(header[0] & 0x80)
        place += 4 + int.from_bytes(header[1:], "big")
    return FlacHead(content[LENGTH_AT : LENGTH_AT + 5], place)


def flac_samples(file: BinaryIO, head: FlacHead) -> int:
    """Return the samples per channel that the frames of a file hold."""
    size = file.seek(0, 2)
    begin = min(size, max(head.first_frame, size - TAIL_BYTES))
    file.seek(begin)
    tail = file.read(size - begin)
    file.seek(head.first_frame)
    first = _frame(file.read(32), 0)
    stops = [len(tail)]
    place = tail.rfind(b"\xff")
    while first is not None and place >= 0:
        frame = _frame(tail, place)
        # the last one may be shorter
        if frame is not None and frame.is_variable == first.is_variable:
            if _is_whole(tail, place, stops):
                begins = frame.number * (1 if frame.is_variable else first.n_samples)
                return begins + frame.n_samples
            stops.append(place)  # cut short, and the one before it ends here
        place = tail.rfind(b"\xff", 0, place)
    return 0


def _frame(content: bytes, place: int) -> _Frame | None:
    """Return the frame whose header begins at a place; None if none does."""
    head = content[place : place + 16]
    if len(head) < 6 or head[0] != 0xFF or head[1] & 0xFE != 0xF8:
        return None
    size_code, rate_code = head[2] >> 4, head[2] & 0x0F
    if size_code == 0 or rate_code == 15 or head[3] >> 4 > 10 or head[3] & 1:
        return None
    n_more = _leading_ones(head[4])
    if n_more == 1 or n_more > 7:
        return None
    number, end = head[4] & (0x7F >> n_more), 5
    for byte in head[5 : 4 + max(n_more, 1)]:
        if byte & 0xC0 != 0x80:
            return None
        number, end = number << 6 | byte & 0x3F, end + 1
    n_samples = BLOCK_SIZES.get(size_code, 0)
    if size_code in {6, 7}:
        width = size_code - 5
        n_samples = int.from_bytes(head[end : end + width], "big") + 1
        end += width
    end += {12: 1, 13: 2, 14: 2}.get(rate_code, 0)
    if len(head) <= end or _crc(head[: end + 1], 8, 0x07):
        return None
    return _Frame(place, number, n_samples, bool(head[1] & 1))


def _is_whole(content: bytes, start: int, stops: Sequence[int]) -> bool:
    """Tell whether a frame with its checksum ends at one of some places."""
    value, begin = 0, start
    for stop in sorted(stops):
        value = _crc(content[begin:stop], 16, 0x8005, value)
        if value == 0:
            return True
        begin = stop
    return False


def _leading_ones(byte: int) -> int:
    return 8 - (~byte & 0xFF).bit_length()


def _crc(content: bytes, n_bits: int, polynomial: int, value: int = 0) -> int:
    """Return a cyclic checksum, carried on from a value: zero where it ends with its own."""
    table, shift, mask = _table(n_bits, polynomial), n_bits - 8, (1 << n_bits) - 1
    for byte in content:
        value = (value << 8 & mask) ^ table[(value >> shift) ^ byte]
    return value


@cache
def _table(n_bits: int, polynomial: int) -> tuple[int, ...]:
    top, mask = 1 << (n_bits - 1), (1 << n_bits) - 1
    found = []
    for byte in range(256):
        value = byte << (n_bits - 8)
        for _ in range(8):
            value = (value << 1 ^ (polynomial if value & top else 0)) & mask
        found.append(value)
    return tuple(found)
