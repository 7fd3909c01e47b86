"""How much sound a file promises, and how much of it is there.

**Method.** The chunks of WAV, RF64, W64 and AIFF are walked with the standard
layouts, down to the one that holds the samples: its promised length is compared
with the bytes that follow, because audio libraries shorten a truncated file without
a word. A FLAC file has no such length; its last sample is asked for instead. An RF64
header without a length, as it is streamed, leaves it to the file.

**References.** Microsoft Multimedia Programming Interface 1.0 (RIFF WAVE);
EBU Tech 3306 (RF64); Sony Sound Forge 64 (W64); Apple AIFF-C draft 8/26/91.
"""

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from uwtrack_cli.files.input_ledger import as_input

UNKNOWN_SIZE = 0xFFFFFFFF
"""Data size that a pipe writes, and that audio libraries take for all that follows."""

W64_RIFF = bytes.fromhex("726966662e91cf11a5d628db04c10000")
W64_TAIL = bytes.fromhex("f3acd3118cd100c04f8edb8a")
MAX_CHUNKS = 10_000


@dataclass(frozen=True)
class SampleBytes:
    """Bytes of samples that a header promises, and those that follow it."""

    start: int
    """Where the samples begin, bytes from the begin of the file."""
    promised: int
    """Bytes of samples that the header names."""
    present: int
    """Bytes of samples that there are."""
    is_open: bool = False
    """Whether the header leaves the length to the file, as what is streamed: RF64."""
    length_at: int = 0
    """Where the length stands that is not stated, bytes from the begin of the file."""

    @property
    def is_unstated(self) -> bool:
        """Whether the header says that nothing follows, and something does."""
        return self.promised == 0 < self.present

    @property
    def is_truncated(self) -> bool:
        """Whether the file ends before its promised end."""
        return self.present < self.promised


def sample_bytes(path: Path) -> SampleBytes | None:
    """Return promised and present bytes of samples; None if the file does not say."""
    with as_input(path).open("rb") as file:
        return sample_bytes_of(file)


def sample_bytes_of(file: BinaryIO) -> SampleBytes | None:
    """Return promised and present bytes of samples of an open file, or None."""
    size = os.fstat(file.fileno()).st_size
    magic = _exact(file, 0, 16)
    if magic[:4] in {b"RIFF", b"RF64", b"BW64", b"RIFX"}:
        found: tuple[int, ...] | None = _riff_data(file, magic[:4])
    elif magic == W64_RIFF:
        found = _w64_data(file)
    elif magic[:4] == b"FORM":
        found = _aiff_data(file)
    else:
        return None
    if found is None:
        return None
    start, promised, *is_open = found
    present = max(0, min(promised or size, size - start))
    if is_open:
        return SampleBytes(start, promised, present, True, is_open[0])
    return SampleBytes(start, promised, present, length_at=start - 4)


def _riff_data(file: BinaryIO, magic: bytes) -> tuple[int, ...] | None:
    """Return begin and bytes of the samples, and where an open length stands."""
    order = ">" if magic == b"RIFX" else "<"
    large = large_at = 0
    position = 12
    for _ in range(MAX_CHUNKS):
        name, size = _chunk(file, position, order + "4sI")
        if name == b"":
            return None
        if name == b"ds64":
            large_at = position + 16
            large = struct.unpack("<Q", _exact(file, large_at, 8))[0]
        if name == b"data":
            promised = large if size == 0xFFFFFFFF and large else size
            if promised == 0 and _is_chunk(file, position + 8, order + "4sI"):
                return None  # no sound, but other chunks
            if size == UNKNOWN_SIZE and large_at and not large:
                return position + 8, 0, large_at
            return None if promised == UNKNOWN_SIZE else (position + 8, promised)
        position += 8 + size + size % 2
    return None


def _w64_data(file: BinaryIO) -> tuple[int, int] | None:
    position = 40
    for _ in range(MAX_CHUNKS):
        name, size = _chunk(file, position, "<16sQ")
        if name == b"" or size < 24:
            return None
        if name == b"data" + W64_TAIL:
            return position + 24, size - 24
        position += (size + 7) // 8 * 8
    return None


def _aiff_data(file: BinaryIO) -> tuple[int, int] | None:
    position = 12
    for _ in range(MAX_CHUNKS):
        name, size = _chunk(file, position, ">4sI")
        if name == b"":
            return None
        if name == b"SSND" and size > 8:
            return position + 16, size - 8
        position += 8 + size + size % 2
    return None


def _is_chunk(file: BinaryIO, position: int, layout: str) -> bool:
    """Tell whether a chunk begins here, or the file ends: not so where sound does."""
    name, size = _chunk(file, position, layout)
    end = file.seek(0, os.SEEK_END)
    is_name = name.isascii() and name.decode("ascii", "replace").isprintable()
    return position >= end or (bool(name) and is_name and position + 8 + size <= end)


def _chunk(file: BinaryIO, position: int, layout: str) -> tuple[bytes, int]:
    header = _exact(file, position, struct.calcsize(layout))
    if not header.strip(b"\0"):
        return b"", 0
    name, size = struct.unpack(layout, header)
    return name, size


def _exact(file: BinaryIO, position: int, count: int) -> bytes:
    """Return bytes at a place that a damaged header may have made up."""
    try:
        file.seek(position, os.SEEK_SET)
    except (OSError, OverflowError):
        return bytes(count)
    return file.read(count).ljust(count, b"\0")
