"""Whether a file is a whole product of ours, found out before anything of it is used.

**Method.** Three steps, each before the next one. The line behind the HDF5 bytes is
compared with them: damage ends here. Then the file is examined in a child process with
little time and memory, because HDF5 may crash, hang or claim any memory on a file
whose checksum was written anew: every link, object, attribute and chunk is looked at,
and none may lead out of the file, claim more than the file holds, or be of a kind that
products do not have. Only then is the file opened here. A product that this process
has written or examined before is known by its checksum.

What the examination accepts is readable; it proves nothing about who wrote the numbers.
"""

import contextlib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.opening import SUFFIXES
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.hdf5.checksum import Checksum, checked
from uwtrack_cli.files.hdf5.layout import FORMAT, SCHEMA_VERSION
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.limited_process import run_limited
from uwtrack_cli.files.text_escaping import shell_word

SIGNATURE = b"\x89HDF\r\n\x1a\n"
FACTS = ("format", "schema_version", "program_version", "complete")
MAX_OBJECTS = 100_000
MAX_DEPTH = 8
MAX_ATTRIBUTES = 500
MAX_ATTRIBUTE_BYTES = 1 << 20
PATIENCE_S = 6.0
BYTES_PER_S = 5e6
HDF5_ERRORS = (
    OSError, RuntimeError, KeyError, ValueError, TypeError, UnicodeError,
    AttributeError, IndexError, OverflowError, MemoryError, RecursionError,
)  # fmt: skip

examined: set[str] = set()
"""Checksums of the products that this process has written or examined."""


@contextlib.contextmanager
def reading(name: str) -> Iterator[None]:
    """Turn what HDF5 says of a damaged file into an error of ours."""
    try:
        yield
    except DataError:
        raise
    except HDF5_ERRORS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DataError(f"{name} is damaged: {reason}. Make it again from its source.") from error


def open_examined(
    path: Path, name: str, *, may_be_lost: bool = False
) -> tuple[h5py.File, Checksum]:
    """Open a product for reading, and return its checksum, too.

    ``may_be_lost``: whether this process may be, so that nothing need be examined before.

    Raises
    ------
    DataError
        The file is missing, no HDF5, damaged, foreign, incomplete or too new.
    """
    checksum = check_bytes(path, name)
    if not may_be_lost and checksum.sha256 not in examined:
        look_apart(f"{__name__}:structure_problem", path, name)
        examined.add(checksum.sha256)
    with reading(name):
        file = h5py.File(as_input(path), "r", locking=False)
    return file, checksum


def check_bytes(path: Path, name: str) -> Checksum:
    """Return the checksum of a product, and refuse one that does not match it.

    Raises
    ------
    DataError
        The file is missing, no HDF5, or damaged; what it is, is said.
    """
    try:
        check_readable(path)
        with as_input(path).open("rb") as file:
            found = checked(file)
            file.seek(0)
            head = file.read(len(SIGNATURE))
    except OSError as error:
        raise DataError(f"cannot read {name}: {error.strerror or error}.") from error
    if found is not None:
        return found
    if head != SIGNATURE:
        msg = f"{name} is not an HDF5 file, so it is no result file of uwtrack."
        if Path(name).suffix.lower() in SUFFIXES:
            msg += f" uwtrack run {shell_word(name)} makes one of a recording."
        raise DataError(msg)
    try:
        facts = run_limited(f"{__name__}:root_facts", str(path), seconds=PATIENCE_S)
    except DataError as error:
        raise DataError(
            f"{name} is damaged or was cut short: it cannot be opened. "
            f"Make it again from its source."
        ) from error
    check_facts(facts, name)
    raise DataError(
        f"{name} was changed or cut short after it was written: its bytes do not "
        f"match their checksum. Make it again from its source."
    )


def is_product(path: Path) -> bool:
    """Tell whether a file is one of ours, whole or damaged: one that may be made again.

    An HDF5 file that cannot be opened any more counts as damaged, and a file of no
    bytes has nothing to lose.
    """
    try:
        with path.open("rb") as file:
            head = file.read(len(SIGNATURE))
        if head != SIGNATURE:
            return not head
        facts = run_limited(f"{__name__}:root_facts", str(path), seconds=PATIENCE_S)
    except OSError:
        return False
    except DataError:
        return True
    return bool(facts.get("format") == FORMAT)


def look_apart(function: str, path: Path, name: str) -> Any:
    """Run a function, ``module:name``, on a product in a limited child process.

    Raises
    ------
    DataError
        It raised one, or the child died.
    """
    seconds = PATIENCE_S + path.stat().st_size / BYTES_PER_S
    try:
        return run_limited(function, str(path), name, seconds=seconds)
    except DataError as error:
        text = str(error)
        if not text.startswith(name):
            text = f"{name} is damaged: {text}. Make it again from its source."
        raise DataError(text) from error


def check_facts(facts: Mapping[str, Any], name: str) -> None:
    """Refuse a file that says itself that it cannot be read.

    Raises
    ------
    DataError
        The file is foreign, too new or incomplete.
    """
    version = facts.get("schema_version")
    if facts.get("format") != FORMAT or not isinstance(version, int):
        raise DataError(f"{name} is an HDF5 file of another program, not of uwtrack.")
    if version > SCHEMA_VERSION:
        raise DataError(
            f"{name} has schema version {version}, written by uwtrack "
            f"{facts.get('program_version')}; this program reads up to version "
            f"{SCHEMA_VERSION}: install a newer uwtrack, or make the file again."
        )
    if version < 1:
        raise DataError(f"{name} has schema version {version}; the first one is 1.")
    if facts.get("complete") != 1:
        raise DataError(f"{name} is incomplete: the run that wrote it was stopped. Run it again.")


def attribute(item: Any, name: str) -> Any:
    """Return a scalar attribute as str, bool, int or float.

    Raises
    ------
    DataError
        The attribute is missing, too large, an array, or of a foreign type.
    """
    try:
        handle = h5py.h5a.open(item.id, name.encode())
    except KeyError as error:
        raise DataError(f"{item.name} lacks the attribute {name!r}") from error
    kind = handle.get_type()
    is_text = isinstance(kind, h5py.h5t.TypeStringID)
    is_number = isinstance(kind, h5py.h5t.TypeIntegerID | h5py.h5t.TypeFloatID)
    if handle.shape != () or not (is_text or is_number):
        raise DataError(f"attribute {name!r} of {item.name} is no single number or text")
    too_large = f"attribute {name!r} of {item.name} is too large"
    if handle.get_storage_size() > MAX_ATTRIBUTE_BYTES:
        raise DataError(too_large)
    if is_text and kind.is_variable_str():  # of any length, in the heap of the file
        value = item.attrs[name]
        if len(value) > MAX_ATTRIBUTE_BYTES:
            raise DataError(too_large)
    else:
        held = np.empty((), f"S{kind.get_size()}" if is_text else kind.dtype)
        handle.read(held, mtype=kind)
        value = held.item()
    return value.decode() if isinstance(value, bytes) else value


def check_stored(dataset: h5py.Dataset) -> None:
    """Refuse a dataset whose elements do not lie, plainly, in the file itself.

    Raises
    ------
    DataError
        Elements elsewhere, a foreign filter or type, or more of them than the file
        holds.
    """
    plist = dataset.id.get_create_plist()
    layout = plist.get_layout()
    if layout == h5py.h5d.VIRTUAL or plist.get_external_count():
        raise DataError(f"{dataset.name} keeps its elements in other files")
    filters = {plist.get_filter(i)[0] for i in range(plist.get_nfilters())}
    if filters - {h5py.h5z.FILTER_FLETCHER32}:
        raise DataError(f"{dataset.name} uses a filter that result files do not have")
    dtype = dataset.id.dtype
    if dtype.kind not in "iufS":
        raise DataError(f"{dataset.name} has elements of a type that result files do not have")
    chunks = plist.get_chunk() if layout == h5py.h5d.CHUNKED else ()
    claimed = math.prod(dataset.id.shape) * dtype.itemsize
    chunk = math.prod(chunks) * dtype.itemsize
    held = min(dataset.id.get_storage_size(), h5py.h5i.get_file_id(dataset.id).get_filesize())
    if max(claimed, chunk if claimed and chunks else 0) > held:
        raise DataError(
            f"{dataset.name} claims {max(claimed, chunk)} bytes, more than the file holds"
        )


# What follows runs in a child process.


def root_facts(path: str) -> dict[str, Any]:
    """Return the root attributes that say what a file is, as far as it has them."""
    found: dict[str, Any] = {}
    with h5py.File(as_input(Path(path)), "r", locking=False) as file:
        for key in FACTS:
            with contextlib.suppress(*HDF5_ERRORS):
                found[key] = attribute(file, key)
    return found


def structure_problem(path: str, name: str) -> None:
    """Raise a DataError if a file has anything that products do not have."""
    with reading(name), h5py.File(as_input(Path(path)), "r", locking=False) as file:
        check_facts({key: attribute(file, key) for key in FACTS}, name)
        check_structure(file)


def check_structure(file: h5py.File) -> None:
    """Look at every object of a file without following a link out of it.

    Raises
    ------
    DataError
        A link leads elsewhere, an object is met twice or is of a foreign kind, or
        there are too many of them.
    """
    seen = {_address(file)}
    todo: list[tuple[h5py.Group, int]] = [(file, 0)]
    while todo:
        group, depth = todo.pop()
        _check_attributes(group)
        if len(seen) + len(group) > MAX_OBJECTS or depth > MAX_DEPTH:
            raise DataError("it has more objects, or deeper groups, than result files have")
        for name in group:
            item = _object(group, name)
            if _address(item) in seen:
                raise DataError(f"{item.name} is linked twice")
            seen.add(_address(item))
            if isinstance(item, h5py.Group):
                todo.append((item, depth + 1))
            elif not item.is_scale:
                check_stored(item)
                _check_chunks(item)


def _check_attributes(group: h5py.Group) -> None:
    if h5py.h5a.get_num_attrs(group.id) > MAX_ATTRIBUTES:
        raise DataError(f"{group.name} has more attributes than result files have")
    for name in group.attrs:
        with contextlib.suppress(DataError):  # read only where a container has it
            attribute(group, name)


def _check_chunks(dataset: h5py.Dataset) -> None:
    """Refuse a chunk that is not as long as its elements and their checksum."""
    chunks = dataset.chunks
    if not chunks:
        return
    plain = math.prod(chunks) * dataset.id.dtype.itemsize
    whole = plain + (4 if dataset.fletcher32 else 0)
    end = h5py.h5i.get_file_id(dataset.id).get_filesize()

    def check(chunk: Any) -> None:
        is_within = 0 < chunk.byte_offset <= end - chunk.size
        if chunk.filter_mask or chunk.size != whole or not is_within:
            raise DataError(f"a chunk of {dataset.name} is not where or what it should be")

    dataset.id.chunk_iter(check)


def _object(group: h5py.Group, name: str) -> Any:
    if group.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
        raise DataError(
            f"{group.name}/{name} is a link to elsewhere, which result files do not have"
        )
    item = h5py.h5o.open(group.id, name.encode())
    if isinstance(item, h5py.h5g.GroupID):
        return h5py.Group(item)
    if isinstance(item, h5py.h5d.DatasetID):
        return h5py.Dataset(item)
    raise DataError(f"{group.name}/{name} is neither a group nor a dataset")


def _address(item: Any) -> int:
    return int(h5py.h5o.get_info(item.id).addr)
