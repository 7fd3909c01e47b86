"""Damaged inputs: recordings, products, settings and tables that nobody should trust."""

import contextlib
import io
import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import soundfile

from uwtrack_cli.files.hdf5.checksum import LINE_BYTES, append_checksum

Random = np.random.Generator
MUTANTS = ("wav", "hdf5", "toml", "csv")
METADATA = b"OHDR|OCHK|FRHP|FHDB|FHIB|FADB|FAHD|EAHD|EAIB|EADB|BTHD|BTLF|BTIN|GCOL"
"""Signatures of the structures inside an HDF5 file."""
EDGES = (0, 1, 2, 127, 255, 32767, 65535, 2**31 - 1, 2**31, 2**32 - 1)


def flipped(data: bytes, rng: Random, first: int = 0) -> bytes:
    """Change a few bytes, cut, double, or put edge values into words."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(first, max(first + 1, len(changed) - 4)))
        kind = rng.integers(5)
        if kind == 0:
            changed[at : at + 1] = bytes([int(rng.integers(256))])
        elif kind == 1:
            changed[at : at + 4] = struct.pack("<I", int(rng.choice(EDGES)))
        elif kind == 2:
            del changed[at : at + int(rng.integers(1, 200))]
        elif kind == 3:
            changed[at:at] = changed[at : at + int(rng.integers(1, 200))]
        else:
            changed = changed[: max(first + 4, at)]
    return bytes(changed)


def wav(rng: Random) -> bytes:
    """A recording whose header mostly survives: data, sizes, subtype or chunks differ."""
    subtype = str(rng.choice(["PCM_16", "PCM_24", "FLOAT", "DOUBLE", "PCM_U8"]))
    channels = int(rng.integers(1, 3))
    sound = 0.1 * rng.standard_normal((2500, channels))
    if subtype in {"FLOAT", "DOUBLE"} and rng.random() < 0.5:
        wrong = rng.choice([np.nan, np.inf, -np.inf, 1e38])
        sound[rng.integers(0, 2500, 50)] = wrong
    memory = io.BytesIO()
    rate = int(rng.choice([1, 7, 500, 500, 500, 192_000]))
    soundfile.write(memory, sound, rate, subtype=subtype, format="WAV")
    data = memory.getvalue()
    header = rng.random() < 0.3
    return flipped(data, rng, 0 if header else 44)


def product(source: Path, rng: Random, target: Path) -> None:
    """A product whose checksum was written anew after a change, or was not."""
    if rng.random() < 0.3:
        target.write_bytes(flipped(source.read_bytes(), rng))
        return
    data = source.read_bytes()
    target.write_bytes(data)
    try:
        with h5py.File(target, "r+") as file:
            names: list[str] = []
            file.visit(names.append)
            for _ in range(int(rng.integers(1, 4))):
                _change(file, str(rng.choice(names)), rng)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError):
        target.write_bytes(flipped(data, rng, 2000))
    with target.open("r+b") as written:
        append_checksum(written)


def forged(source: Path, rng: Random, target: Path) -> None:
    """A product that was changed and whose checksum was written anew."""
    data = source.read_bytes()[:-LINE_BYTES]
    kind = int(rng.integers(3))
    if kind == 2:
        target.write_bytes(source.read_bytes())
        with (
            contextlib.suppress(OSError, RuntimeError, KeyError, ValueError, TypeError),
            h5py.File(target, "r+") as file,
        ):
            names: list[str] = []
            file.visit(names.append)
            for _ in range(int(rng.integers(1, 4))):
                _change(file, str(rng.choice(names)), rng)
    elif kind == 1:  # some words of its metadata, which lie near signatures
        changed = bytearray(data)
        marks = [found.start() for found in re.finditer(METADATA, data)]
        for _ in range(int(rng.integers(1, 5))):
            at = int(rng.choice(marks)) + int(rng.integers(4, 120))
            size = int(rng.choice([1, 2, 4, 8]))
            word = int(rng.choice(EDGES)) + int(rng.integers(-2, 3))
            changed[at : at + size] = (word % 256**size).to_bytes(size, "little")
        target.write_bytes(_with_metadata_checksums(changed))
    else:
        target.write_bytes(flipped(data, rng, 8))
    with target.open("r+b") as written:
        append_checksum(written)


def _with_metadata_checksums(data: bytearray) -> bytes:
    """Write the checksums of object headers anew, so that HDF5 goes on to read them."""
    for found in re.finditer(b"OHDR\x02", bytes(data)):
        start = found.start()
        flags = data[start + 5]
        head = start + 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0)
        width = 1 << (flags & 3)
        end = head + width + int.from_bytes(data[head : head + width], "little")
        if end + 4 <= len(data):
            total = lookup3(bytes(data[start:end]))
            data[end : end + 4] = total.to_bytes(4, "little")
    return bytes(data)


def lookup3(data: bytes) -> int:
    """Return the checksum of HDF5's metadata (Jenkins 2006, hashlittle)."""
    mask = 0xFFFFFFFF

    def turned(x: int, k: int) -> int:
        return ((x << k) | (x >> (32 - k))) & mask

    a = b = c = (0xDEADBEEF + len(data)) & mask
    while len(data) > 12:
        words = struct.unpack("<3I", data[:12])
        a, b, c = (a + words[0]) & mask, (b + words[1]) & mask, (c + words[2]) & mask
        for k in (4, 6, 8, 16, 19, 4):
            a = ((a - c) & mask) ^ turned(c, k)
            c = (c + b) & mask
            a, b, c = b, c, a
        data = data[12:]
    if not data:
        return c
    words = struct.unpack("<3I", data.ljust(12, b"\0"))
    a, b, c = (a + words[0]) & mask, (b + words[1]) & mask, (c + words[2]) & mask
    for k in (14, 11, 25, 16, 4, 14, 24):
        c = ((c ^ b) - turned(b, k)) & mask
        a, b, c = b, c, a
    return b


def _change(file: h5py.File, name: str, rng: Random) -> None:
    if name not in file:
        return
    item = file[name]
    changes: list[Callable[[], object]] = [
        lambda: file.__delitem__(name),
        lambda: _foreign_link(file, name, rng),
        lambda: _other_data(file, name, rng),
        lambda: _attribute(item, rng),
        lambda: _attribute(item, rng),
        lambda: _values(item, rng),
        lambda: _values(item, rng),
    ]
    changes[int(rng.integers(len(changes)))]()


def _foreign_link(file: h5py.File, name: str, rng: Random) -> None:
    del file[name]
    links = [h5py.ExternalLink("/etc/passwd", "/"), h5py.SoftLink("/"), h5py.SoftLink("/nowhere")]
    file[name] = links[int(rng.integers(len(links)))]


def _other_data(file: h5py.File, name: str, rng: Random) -> None:
    del file[name]
    kind = int(rng.integers(5))
    if kind == 0:
        file.create_dataset(name, shape=(2**40,), dtype="f8", chunks=(1024,))
    elif kind == 1:
        file.create_dataset(name, data=rng.standard_normal((3, 2)))
    elif kind == 2:
        file.create_dataset(name, data=["a", "b"], dtype=h5py.string_dtype())
    elif kind == 3:
        file.create_dataset(name, data=np.arange(50), compression="gzip")
    else:
        file.create_group(name)


def _attribute(item: h5py.Dataset, rng: Random) -> None:
    names = list(item.attrs)
    if not names:
        return
    name = str(rng.choice(names))
    if name in {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"}:
        return
    values = [-1, 2**62, np.nan, 0.0, "", "x" * 100, "../../etc/passwd", [1, 2, 3], b"\xff"]
    item.attrs[name] = values[int(rng.integers(len(values)))]


def _values(item: h5py.Dataset, rng: Random) -> None:
    if not isinstance(item, h5py.Dataset) or item.size in {0, None} or item.ndim == 0:
        return
    row = int(rng.integers(item.shape[0]))
    if item.dtype.kind == "f":
        item[row] = rng.choice([np.nan, np.inf, -1e300, 0.0, 1e-300])
    elif item.dtype.kind in "iu":
        limits = np.iinfo(item.dtype)
        item[row] = rng.choice([limits.min, limits.max, 0])
    elif item.dtype.kind == "S":
        item[row] = b'\xff{["'


def text(source: str, rng: Random) -> bytes:
    """A text whose values, words or bytes were changed."""
    lines = source.splitlines()
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(lines)))
        words = ["nan", "-1", "1e400", "[]", "{}", '""', '"\\u0000"', "true", "99999999999999999999",
                 "", "inf", "'", "[[[[", "1979-05-27", "0x", "../../../etc/passwd"]  # fmt: skip
        kind = int(rng.integers(4))
        if kind == 0 and ("=" in lines[at] or "," in lines[at]):
            cut = "=" if "=" in lines[at] else ","
            head, _, _ = lines[at].partition(cut)
            lines[at] = f"{head}{cut} {rng.choice(words)}"
        elif kind == 1:
            lines.insert(at, lines[int(rng.integers(len(lines)))])
        elif kind == 2:
            del lines[at]
            lines = lines or [""]
        else:
            spot = int(rng.integers(len(lines[at]) + 1))
            lines[at] = lines[at][:spot] + str(rng.choice(words)) + lines[at][spot:]
    data = "\n".join(lines).encode() + b"\n"
    return flipped(data, rng) if rng.random() < 0.2 else data


def commands(kind: str, folder: Path, base: Path, rng: Random) -> Iterator[tuple[list[str], bool]]:
    """Write a mutant and yield the command line that meets it."""
    if kind == "forged":
        forged(base / "base.h5", rng, folder / "m.h5")
        name = str(rng.choice(["encounters", "lines", "levels", "frames", "families"]))
        form = str(rng.choice(["csv", "json", "table"]))
        to = str(rng.choice(["csv", "geojson", "kml", "raven", "netcdf"]))
        yield from (
            (["verify", "m.h5", str(base / "base.h5")], True),
            (["show", "m.h5", name, "--format", form], True),
            (["export", "m.h5", "--to", to, "-o", "out.x"], True),
        )
        if rng.random() < 0.2:  # the slowest
            yield ["plot", "m.h5", "-o", "out.png"], True
    elif kind == "wav":
        (folder / "m.wav").write_bytes(wav(rng))
        yield (["run", "m.wav", "-o", "out.h5", "--channel", "1", "--allow-truncated"], True)
    elif kind == "hdf5":
        product(base / "base.h5", rng, folder / "m.h5")
        choices = [
            ["show", "m.h5", "encounters", "--format", "json"],
            ["show", "m.h5", "lines", "--format", "csv"],
            ["info", "m.h5"], ["verify", "m.h5"], ["cpa", "m.h5", "-o", "out.h5"],
            ["diff", "m.h5", str(base / "base.h5")],
            ["export", "m.h5", "--to", "raven", "-o", "out.txt"],
        ]  # fmt: skip
        yield choices[int(rng.integers(len(choices)))], True
    elif kind == "toml":
        target, words = [
            ("m.toml", ["run", str(base / "base.wav"), "--recipe", "m.toml"]),
            ("m.sensor.toml", ["run", str(base / "base.wav"), "--sensor", "m.sensor.toml"]),
            ("s.toml", ["simulate", "s.toml", "-o", "s.wav"]),
        ][int(rng.integers(3))]
        source = (base / target).read_text()
        (folder / target).write_bytes(text(source, rng))
        extra = ["-o", "out.h5"] if words[0] == "run" else []
        yield [*words, *extra], True
    else:
        (folder / "m.csv").write_bytes(text((base / "base.csv").read_text(), rng))
        yield ["cpa", "m.csv", "-o", "out.h5"], True
