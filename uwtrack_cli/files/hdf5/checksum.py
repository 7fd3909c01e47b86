"""The line behind a product: SHA-256 of all its bytes, and when it was made.

**Method.** The line follows the HDF5 bytes; HDF5 ends before it and never looks at
it. It is checked before HDF5 sees the file. Because the time of day stands here and
not among the HDF5 bytes, equal results are equal bytes with an equal checksum,
whenever they were made; a history names its sources by this checksum.

The checksum is there for damage: a bad disk, a transfer that was cut, a file that was
edited. It has no key, so it proves nothing about who wrote a file: anybody can change
one and write the line anew (see `examination` for what happens to such a file).

**Conventions.** Versions 1 and 2 of the layout have the checksum alone; their time is
the root attribute ``created_utc`` and their histories name the root attribute
``sha256``.
"""

import hashlib
import re
import zlib
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, BinaryIO

BLOCK_BYTES = 1 << 20
LINE = re.compile(
    rb"(?P<head>uwtrack sha256 (?P<sha256>[0-9a-f]{64})"
    rb"(?: made (?P<made>[0-9T:Z-]{20}) crc32 )?)(?P<crc32>[0-9a-f]{8})?\n"
)


@dataclass(frozen=True)
class Checksum:
    """What the line behind a product says."""

    sha256: str
    """SHA-256 of the bytes before the line, hexadecimal."""
    created_utc: str
    """When the product was made, ISO 8601 to the second; empty before version 3."""


def checksum_line(sha256: str) -> bytes:
    """Return the line for a product that is complete now."""
    made = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    head = f"uwtrack sha256 {sha256} made {made} crc32 ".encode()
    return head + f"{zlib.crc32(head):08x}\n".encode()


LINE_BYTES = len(checksum_line("0" * 64))


def append_checksum(file: Any) -> str:
    """Write the line behind a complete product, and return its SHA-256."""
    file.seek(0)
    sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    file.seek(0, 2)
    file.write(checksum_line(sha256))
    return sha256


def checked(file: BinaryIO) -> Checksum | None:
    """Return the checksum of a product; None if its bytes do not match it."""
    size = file.seek(0, 2)
    file.seek(max(0, size - LINE_BYTES))
    tail = file.read(LINE_BYTES)
    found = LINE.search(tail, max(0, tail.rfind(b"uwtrack sha256 ")))
    if found is None or found.end() != len(tail):
        return None
    made, crc32 = found["made"], found["crc32"]
    if (made is None) != (crc32 is None):
        return None
    if crc32 is not None and int(crc32, 16) != zlib.crc32(found["head"]):
        return None
    left = size - len(found[0])
    total = hashlib.sha256()
    file.seek(0)
    while left > 0:
        block = file.read(min(BLOCK_BYTES, left))
        if not block:
            return None
        total.update(block)
        left -= len(block)
    if total.hexdigest().encode() != found["sha256"]:
        return None
    return Checksum(total.hexdigest(), (made or b"").decode())
