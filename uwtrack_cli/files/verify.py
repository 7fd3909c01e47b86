"""Whether a product file is what it was when it was written.

**Method.** Everything that opening a product checks (completeness, schema,
structure digest), then every array is read and digested, every container is read
back, and the digests named in the history are compared with the files of these
names that lie beside the product.
"""

import hashlib
from pathlib import Path

import h5py

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import HDF5_ERRORS, attribute, safe_objects
from uwtrack_cli.files.digest import data_digest, root_digest, structure_digest
from uwtrack_cli.files.history import HistoryStep, Source
from uwtrack_cli.files.opening import open_file
from uwtrack_cli.files.reader import Product, read_product
from uwtrack_cli.files.registry import CONTAINERS

READ_WHOLE_BYTES = 1 << 26
"""Containers up to this size are read back; larger ones only digested."""


def verify_product(path: Path | str) -> list[str]:
    """Return what is wrong with a product file; an empty list if nothing is.

    Parameters
    ----------
    path
        The product file.
    """
    path = Path(path)
    try:
        product = read_product(path)
    except DataError as error:
        return [str(error)]
    with product:
        problems = _data_problems(product)
        problems += _container_problems(product)
        for step in product.history:
            problems += step.problems()
            problems += _source_problems(path, step)
    return problems


def file_digest(path: Path) -> str:
    """Return the SHA-256 digest of the bytes of a file, read block by block.

    Raises
    ------
    DataError
        The file cannot be read.
    """
    try:
        with path.open("rb") as handle:
            return hashlib.file_digest(handle, "sha256").hexdigest()
    except OSError as error:
        msg = f"cannot read {path}: {error.strerror or error}."
        raise DataError(msg) from error


def source_of(path: Path) -> Source:
    """Return name and digest of a file, as a step of the history names it.

    A product is named by its root digest, any other file by that of its bytes.
    """
    if h5py.is_hdf5(path):
        with open_file(path, str(path)) as file:
            return Source(name=path.name, digest=str(attribute(file, "sha256")))
    return Source(name=path.name, digest=file_digest(path))


def _data_problems(product: Product) -> list[str]:
    problems: list[str] = []
    digests: dict[str, str] = {}
    for path, item in safe_objects(product.file).items():
        if not isinstance(item, h5py.Dataset) or item.is_scale:
            continue
        try:
            digests[path] = data_digest(item)
        except HDF5_ERRORS as error:
            problems.append(f"{path} is damaged: {error}.")
    structure = structure_digest(safe_objects(product.file))
    if not problems and root_digest(structure, digests) != product.digest:
        problems.append("the data do not match their digest.")
    return problems


def _container_problems(product: Product) -> list[str]:
    problems: list[str] = []
    for (sensor, name), path in product.paths.items():
        arrays = [d for d in product.file[path].values() if hasattr(d, "nbytes")]
        if sum(d.nbytes for d in arrays if not d.is_scale) > READ_WHOLE_BYTES:
            continue
        try:
            product.read(CONTAINERS[name], sensor)
        except DataError as error:
            problems.append(str(error))
    return problems


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
                f"{beside.name} beside it is no longer the file that step "
                f"{step.stage!r} read."
            )
    return problems
