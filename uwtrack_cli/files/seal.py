"""The seal behind a product: a digest of its bytes, checked before HDF5 sees one.

**Method.** The last 80 bytes of a product hold SHA-256 over all the bytes before
them. HDF5 itself ends earlier and never looks at them. A file without a right seal
was cut short, changed or made by another program, and is not opened here, because
damaged bytes can make the HDF5 library stop the whole program; what it is, is asked
of a program of its own, with little time and memory (`diagnose`).
"""

import contextlib
import hashlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, BinaryIO

import h5py

from uwtrack_cli.files.checks import HDF5_ERRORS, attribute

HEAD = b"uwtrack sha256 "
SEAL_BYTES = len(HEAD) + 64 + 1
BLOCK_BYTES = 1 << 20
PATIENCE_S = 8.0
MEMORY_BYTES = 1 << 30
FACTS = ("format", "schema_version", "program_version", "complete")


def append_seal(file: Any) -> None:
    """Seal a product that is complete; the file is open for reading and writing."""
    file.seek(0)
    digest = hashlib.file_digest(file, "sha256").hexdigest()
    file.seek(0, 2)
    file.write(_seal(digest))


def sealed(content: bytes) -> bytes:
    """Return a product in memory with its seal."""
    return content + _seal(hashlib.sha256(content).hexdigest())


def is_sealed(file: BinaryIO) -> bool:
    """Tell whether the bytes are those that were sealed."""
    size = file.seek(0, 2) - SEAL_BYTES
    if size < 0:
        return False
    file.seek(size)
    seal = file.read(SEAL_BYTES)
    if not seal.startswith(HEAD):
        return False
    file.seek(0)
    total = hashlib.sha256()
    while size > 0:
        block = file.read(min(BLOCK_BYTES, size))
        if not block:
            return False
        total.update(block)
        size -= len(block)
    return seal == _seal(total.hexdigest())


def diagnose(source: Path | BinaryIO) -> dict[str, Any] | None:
    """Return what a file without a seal says of itself; None if it cannot.

    The file is opened in a program of its own, whose end does not harm this one.
    """
    name, content = str(source), b""
    if not isinstance(source, Path):
        source.seek(0)
        name, content = "-", source.read()
    with contextlib.suppress(OSError, ValueError, subprocess.SubprocessError):
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-m", "uwtrack_cli.files.seal", name],
            input=content,
            capture_output=True,
            timeout=PATIENCE_S,
            check=True,
        )
        found = json.loads(done.stdout)
        if isinstance(found, dict):
            return found
    return None


def _seal(digest: str) -> bytes:
    return HEAD + digest.encode() + b"\n"


def _root_facts(name: str) -> dict[str, Any]:
    """Return the root attributes that say what a file is, as far as it has them."""
    import io
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    source = name if name != "-" else io.BytesIO(sys.stdin.buffer.read())
    found: dict[str, Any] = {}
    with h5py.File(source, "r", locking=False) as file:
        for key in FACTS:
            with contextlib.suppress(*HDF5_ERRORS):
                found[key] = attribute(file, key)
    return found


if __name__ == "__main__":
    sys.stdout.write(json.dumps(_root_facts(sys.argv[1])))
