"""Opening a product: what is no whole product of ours is refused, and named.

**Method.** The seal is checked before HDF5 sees the file (see `seal`); then format,
completeness and schema version, and that every object is a plain one.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import h5py

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import (
    attribute,
    check_readable,
    reading,
    safe_objects,
)
from uwtrack_cli.files.layout import FORMAT, SCHEMA_VERSION
from uwtrack_cli.files.seal import FACTS, diagnose, is_sealed

SIGNATURE = b"\x89HDF\r\n\x1a\n"


def open_file(source: Path | io.BytesIO, name: str) -> h5py.File:
    """Open a product file for reading.

    Raises
    ------
    DataError
        The file is missing, no HDF5, damaged, foreign, incomplete or too new.
    """
    if isinstance(source, Path):
        check_readable(source)
        try:
            with source.open("rb") as file:
                _check_seal(file, source, name)
        except OSError as error:
            msg = f"cannot read {name}: {error.strerror or error}."
            raise DataError(msg) from error
    else:
        _check_seal(source, source, name)
    with reading(name):
        opened = h5py.File(source, "r", locking=False)
        try:
            check_facts({key: attribute(opened, key) for key in FACTS}, name)
            safe_objects(opened)
        except BaseException:
            opened.close()
            raise
    return opened


def check_facts(facts: Mapping[str, Any], name: str) -> None:
    """Refuse a file that says itself that it cannot be read.

    Raises
    ------
    DataError
        The file is foreign, too new or incomplete.
    """
    version = facts.get("schema_version")
    if facts.get("format") != FORMAT or not isinstance(version, int):
        msg = f"{name} is an HDF5 file of another program, not a uwtrack product."
        raise DataError(msg)
    if version > SCHEMA_VERSION:
        msg = (
            f"{name} has schema version {version}, written by uwtrack "
            f"{facts.get('program_version')}; this program reads up to version "
            f"{SCHEMA_VERSION}: install a newer uwtrack, or make the file again."
        )
        raise DataError(msg)
    if version < 1:
        msg = f"{name} has schema version {version}; the first one is 1."
        raise DataError(msg)
    if facts.get("complete") != 1:
        msg = f"{name} is incomplete: the run that wrote it was stopped. Run it again."
        raise DataError(msg)


def _check_seal(file: BinaryIO, source: Path | BinaryIO, name: str) -> None:
    if is_sealed(file):
        return
    file.seek(0)
    if file.read(len(SIGNATURE)) != SIGNATURE:
        msg = f"{name} is not an HDF5 file, so it is no uwtrack product."
        raise DataError(msg)
    facts = diagnose(source)
    if facts is None:
        msg = (
            f"{name} is damaged or was cut short: it cannot be opened. "
            f"Make it again from its source."
        )
        raise DataError(msg)
    check_facts(facts, name)
    msg = (
        f"{name} was changed or cut short after it was written: its bytes do not "
        f"match their digest. Make it again from its source."
    )
    raise DataError(msg)
