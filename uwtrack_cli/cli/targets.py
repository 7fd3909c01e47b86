"""Where products come from and go to: files, standard input and output."""

import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.input_ledger import read_standard_input, standard_input

if TYPE_CHECKING:  # h5py is slow to import, and --help does not need it
    from uwtrack_cli.data.sensor import Sensor
    from uwtrack_cli.files.hdf5.product import HistoryStep, Product, ProductWriter, Source
    from uwtrack_cli.flow.products import Held

PIPE = Path("-")
"""Standard input or output."""

WANTED_TWICE = "--json and the result file would both go to standard output; give -o FILE."
"""Why a command does not print JSON beside a product on standard output."""


def product_name(source: Path, suffix: str) -> Path:
    """Return the default output beside a source: pass.wav -> pass.lines.h5.

    Raises
    ------
    DataError
        The source is a folder that has no name.

    Examples
    --------
    >>> product_name(Path("a/pass.peaks.h5"), ".lines.h5").as_posix()
    'a/pass.lines.h5'
    >>> product_name(Path("20.1.wav"), ".lines.h5").as_posix()
    '20.1.lines.h5'
    """
    if not source.name:
        raise DataError(f"{source} is a folder, not a file.")
    stem = source.stem
    if source.suffix == ".h5" and "." in stem:
        stem = stem.rpartition(".")[0]
    return source.with_name(stem + suffix)


def target_for(output: Path | None, source: Path, suffix: str) -> Path:
    """Return the output: as asked for, else a pipe for a pipe, else by name."""
    if output is not None:
        return output
    return PIPE if source == PIPE else product_name(source, suffix)


def named_target(output: Path | None, source: Path, suffix: str) -> Path:
    """Return the output of a command that writes no product, and never to a pipe.

    Raises
    ------
    OptionError
        It would go to standard output.
    """
    if output == PIPE or (output is None and source == PIPE):
        raise OptionError("this is written to a file of its own: name it with -o FILE.")
    return output or product_name(source, suffix)


def open_product(source: Path) -> "Product":
    """Open a product file, or one that comes through standard input."""
    from uwtrack_cli.files.hdf5.product import read_product, read_product_bytes

    if source == PIPE:
        return read_product_bytes(read_standard_input())
    return read_product(source)


@contextmanager
def writer_for(
    target: Path,
    history: "Sequence[HistoryStep]" = (),
    *,
    overwrite: bool,
    inputs: Sequence[Path] = (),
) -> "Iterator[ProductWriter]":
    """Write a product to a file, or by way of a temporary one to a pipe."""
    from uwtrack_cli.files.hdf5.product import ProductWriter

    if PIPE in inputs:
        standard_input()  # a file may stand behind it
    if target != PIPE:
        real = [path for path in inputs if path != PIPE]
        with ProductWriter(target, history=history, overwrite=overwrite, inputs=real) as writer:
            yield writer
        return
    refuse_no_pipe()
    with tempfile.TemporaryDirectory(prefix="uwtrack-") as folder:
        path = Path(folder) / "product.h5"
        with ProductWriter(path, history=history) as writer:
            yield writer
        with path.open("rb") as file:
            shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.buffer.flush()


def refuse_no_pipe() -> None:
    """Refuse a product on a standard output that is closed or a terminal.

    Raises
    ------
    OptionError
        It is.
    """
    if sys.__stdout__ is None:
        raise OptionError("standard output is closed; give -o FILE.")
    if sys.stdout.isatty():
        raise OptionError("a result file is binary and is not printed on a terminal; give -o FILE.")


def write_containers(
    target: Path,
    held: "Sequence[Held]",
    history: "Sequence[HistoryStep]",
    *,
    overwrite: bool,
    inputs: Sequence[Path] = (),
) -> None:
    """Write whole containers as one product."""
    with writer_for(target, history, overwrite=overwrite, inputs=inputs) as writer:
        for one in held:
            writer.write(one.container, one.step)


class Inputs:
    """What a whole stage reads: containers of products and of tables.

    ``takes_asides``: whether results that were made for `presence` alone are read, too.
    """

    def __init__(
        self, stack: ExitStack, branch: str | None = None, *, takes_asides: bool = False
    ) -> None:
        self._stack = stack
        self._takes_asides = takes_asides
        self._branch = branch
        self.held: list[Held] = []
        self.products: list[Product] = []
        self.sources: list[Source] = []
        self._sensors: list[Sensor] = []
        self._sensor_file: Path | None = None

    def add_sensors(self, path: Path, *, is_kept: bool) -> None:
        """Read the sensors that a table names, before the table.

        ``is_kept``: whether the stage takes the sensors themselves, too.
        """
        from uwtrack_cli.files.hdf5.product import source_of
        from uwtrack_cli.files.tables.sensors import load_deployment, sensor_files
        from uwtrack_cli.flow.products import Held

        self._sensor_file = path
        self._sensors = [one.sensor for one in load_deployment(path)]
        self.sources += [source_of(file) for file in sensor_files(path, path)]
        if is_kept:
            self.held += [Held(sensor) for sensor in self._sensors]

    def add_replay(self, paths: Sequence[Path], wanted: tuple[type[Container], ...]) -> None:
        """Read REP and DSF files together: tracks of one serve the cuts of another.

        Raises
        ------
        DataError
            The stage reads no bearings, or a sensor file was given, too.
        """
        from uwtrack_cli.files.hdf5.product import source_of
        from uwtrack_cli.files.tables.replay import read_replay
        from uwtrack_cli.flow.products import Held

        if Series not in wanted or self._sensors:
            why = "--sensors belongs to a CSV table" if self._sensors else "not read here"
            raise DataError(f"{paths[0]} is a file of tracks and cuts: {why}.")
        self.held.append(Held(read_replay(paths)))
        self.sources += [source_of(path) for path in paths]

    def check_sensors_used(self) -> None:
        """Refuse a sensor file where no table names sensors.

        Raises
        ------
        DataError
            No table was read.
        """
        if self._sensor_file is not None and self.products:
            raise DataError(
                f"--sensors {self._sensor_file} belongs to a table that names its "
                f"sensors; result files hold their own."
            )

    def add(self, path: Path, wanted: tuple[type[Container], ...]) -> None:
        """Read a product, or a table of what the stage can read.

        What comes through standard input is a table if it is text.

        Raises
        ------
        DataError
            The stage does not read tables, the file is not readable, or it holds what is
            wanted of several steps.
        """
        from uwtrack_cli.files.hdf5.product import read_product_bytes, source_of
        from uwtrack_cli.files.tables.scan_tables import TABLES
        from uwtrack_cli.flow.branches import sole_keys
        from uwtrack_cli.flow.products import Held, small_containers, source_of_product

        content = read_standard_input() if path == PIPE else b""
        if content and b"\0" not in content:
            path = self._kept(content)
        if path.suffix.lower() in TABLES:
            self.held.append(Held(_read_table(path, wanted, self._sensors)))
            self.sources.append(source_of(path))
            return
        opened = read_product_bytes(content) if path == PIPE else open_product(path)
        product = self._stack.enter_context(opened)
        self.products.append(product)
        self.sources.append(source_of_product(product))
        if self._takes_asides:
            self.held += small_containers(product, self._branch)
            return
        sole = sole_keys(product, self._branch, {kind.NAME for kind in wanted})
        self.held += small_containers(product, self._branch, sole)

    def _kept(self, content: bytes) -> Path:
        """Keep a table from standard input in a file, as its readers take it."""
        folder = tempfile.TemporaryDirectory(prefix="uwtrack-")
        path = Path(self._stack.enter_context(folder)) / "standard-input.csv"
        path.write_bytes(content)
        return path

    def add_table(self, path: Path, kind: type[Container]) -> None:
        """Read a table that was given by an option of its own."""
        from uwtrack_cli.files.hdf5.product import source_of
        from uwtrack_cli.flow.products import Held

        self.held.append(Held(_read_table(path, (kind,))))
        self.sources.append(source_of(path))


def _read_table(
    path: Path, wanted: tuple[type[Container], ...], sensors: "Sequence[Sensor]" = ()
) -> Container:
    """Read a CSV table as the first container that has a table and is wanted."""
    from uwtrack_cli.files.tables.replay import SUFFIXES, read_replay_track
    from uwtrack_cli.files.tables.scan_tables import table_readers
    from uwtrack_cli.files.tables.sensors import load_sensor

    readers = table_readers(sensors)
    if path.suffix.lower() in SUFFIXES:
        readers["navigation"] = read_replay_track
    if [kind.NAME for kind in wanted] == ["sensor"]:  # an option of its own
        return load_sensor(path)
    for name, reader in readers.items():
        if name in {kind.NAME for kind in wanted}:
            return reader(path)
    names = " or ".join(kind.NAME for kind in wanted)
    raise DataError(f"{path} is a table; expected is a result file with {names}.")
