"""The one codec of product files: write, read, stream and verify.

Everything that reads or writes a product goes through the names of this module;
`Product` draws what a file looks like inside.

**Method.** To verify a product is to do everything that opening it checks, in a child
process with limits (see `examination`), and to read every array and container there. Then the
digests named in the history are compared with the files of these names that lie
beside the product. What is wanted of many products is read in one such process, which
gives it back; where it is lost, each product is read in one of its own.
"""

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import file_digest
from uwtrack_cli.files.hdf5.container_keys import ContainerKey
from uwtrack_cli.files.hdf5.examination import (
    BYTES_PER_S,
    HDF5_ERRORS,
    PATIENCE_S,
    check_bytes,
    examined,
    is_product,
    look_apart,
    structure_problem,
)
from uwtrack_cli.files.hdf5.history import HistoryStep, Source
from uwtrack_cli.files.hdf5.layout import CONTAINERS
from uwtrack_cli.files.hdf5.reader import Product, read_in_child, read_product, read_product_bytes
from uwtrack_cli.files.hdf5.writer import ProductWriter, write_product
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.limited_process import run_limited
from uwtrack_cli.files.text_escaping import file_name

__all__ = [
    "ContainerKey",
    "HistoryStep",
    "Product",
    "ProductWriter",
    "Source",
    "is_product",
    "read_many",
    "read_product",
    "read_product_bytes",
    "source_of",
    "verify_product",
    "write_product",
]


READ_AT_ONCE = 64
"""Products that one child process reads."""

BLOCK_BYTES = 1 << 22
READ_WHOLE_BYTES = 1 << 26
"""Containers up to this size are read as such; of larger ones only the arrays."""


def verify_product(path: Path | str) -> list[str]:
    """Return what is wrong with a product file; an empty list if nothing is.

    This finds damage. It cannot find forgery: see `checksum`.
    """
    path = Path(path)
    try:
        checksum = check_bytes(path, str(path))
        problems = [
            str(problem) for problem in look_apart(f"{__name__}:content_problems", path, str(path))
        ]
        if problems:
            return problems
        examined.add(checksum.sha256)
        with read_product(path) as product:
            history = product.history
    except DataError as error:
        return [str(error)]
    for step in history:
        problems += step.problems()
        problems += _source_problems(path, step)
    return problems


def content_problems(path: str, name: str) -> list[str]:
    """Read everything that a product holds; return what cannot be read."""
    structure_problem(path, name)
    problems: list[str] = []
    with read_in_child(Path(path)) as product:
        product.file.visititems(lambda _, item: _read(item, problems))
        for key in product.paths:
            try:
                if _column_bytes(product, key) <= READ_WHOLE_BYTES:
                    product.read(CONTAINERS[key.name], key.sensor, key.step)
            except DataError as error:
                problems.append(str(error))
    return problems


def read_many(function: str, paths: Sequence[Path]) -> Iterator[Any]:
    """Yield what a function gives of each of many products, or why one cannot be read.

    ``function``: its module and name, ``package.module:name``; it takes a product, and
    returns what JSON can hold.

    Yielded: for each path a value, or the DataError that says what is wrong.
    """
    for start in range(0, len(paths), READ_AT_ONCE):
        some = paths[start : start + READ_AT_ONCE]
        try:
            yield from _in_one_child(function, some)
        except DataError:  # the child is lost, and one of them was too much for it
            for path in some:
                try:
                    yield from _in_one_child(function, [path])
                except DataError as error:
                    msg = f"{path} is damaged: {error}. Make it again from its source."
                    yield DataError(msg)


def _in_one_child(function: str, paths: Sequence[Path]) -> list[Any]:
    sizes = [path.stat().st_size for path in paths if path.exists()]
    found = run_limited(
        f"{__name__}:values_in_child", function, *map(str, paths),
        seconds=PATIENCE_S + sum(sizes) / BYTES_PER_S,
    )  # fmt: skip
    return [value if is_read else DataError(value) for is_read, value in found]


def values_in_child(function: str, *paths: str) -> list[tuple[bool, Any]]:
    """Return what a function gives of products, each with whether it could be read."""
    module, _, name = function.partition(":")
    found: list[tuple[bool, Any]] = []
    for path in paths:
        try:
            with read_in_child(Path(path)) as product:
                value = getattr(import_module(module), name)(product)
            found.append((True, value))
        except DataError as error:
            found.append((False, str(error)))
    return found


def source_of(path: Path) -> Source:
    """Return name and digest of a file, as a step of the history names it.

    A product is named by its checksum, any other file by that of all its bytes.
    """
    if h5py.is_hdf5(as_input(path)):
        with read_product(path) as product:
            return Source(name=file_name(path), digest=product.digest)
    return Source(name=file_name(path), digest=file_digest(path))


def _read(item: h5py.Group | h5py.Dataset, problems: list[str]) -> None:
    """Read an array, block by block, as its fletcher32 asks for."""
    if not isinstance(item, h5py.Dataset) or item.is_scale:
        return
    step = max(1, BLOCK_BYTES // max(1, item.nbytes // max(1, len(item))))
    try:
        for start in range(0, len(item), step):
            item[start : start + step]
    except HDF5_ERRORS as error:
        problems.append(f"{item.name} is damaged: {error}.")


def _column_bytes(product: Product, key: ContainerKey) -> int:
    group = product.file[product.paths[key]]
    arrays = [item for item in group.values() if isinstance(item, h5py.Dataset)]
    return sum(item.nbytes for item in arrays if not item.is_scale)


def _source_problems(path: Path, step: HistoryStep) -> list[str]:
    problems: list[str] = []
    for source in step.sources:
        beside = path.parent / Path(source.name).name
        if not beside.is_file():
            continue
        try:
            now = source_of(beside).digest
        except DataError as error:
            problems.append(str(error))
            continue
        if now != source.digest:
            problems.append(
                f"{beside.name} beside it is no longer the file that step {step.stage!r} read."
            )
    return problems
