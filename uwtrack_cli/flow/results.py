"""`run` from Python: the tables of a recording, and those of a product file.

**Method.** A run writes the same product as the command `uwtrack run`, to a temporary
file where no output is named, and reads it back: library and command cannot differ.
"""

import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import datetime
from html import escape
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from uwtrack_cli.data.base import Container, html_table
from uwtrack_cli.data.recording import Reader, Recording
from uwtrack_cli.data.spectra import MODULATION, Overview
from uwtrack_cli.errors import OptionError, UwtrackNote, needing
from uwtrack_cli.files.hdf5.container_keys import ContainerHolder
from uwtrack_cli.files.hdf5.layout import CONTAINERS, container_class
from uwtrack_cli.files.hdf5.product import ContainerKey, HistoryStep, ProductWriter, read_product
from uwtrack_cli.files.tables.dataframes import to_pandas, to_xarray
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.files.tables.summaries import SUMMARIES, summary_of
from uwtrack_cli.flow.branches import without_asides
from uwtrack_cli.flow.engine import Progress
from uwtrack_cli.flow.products import run_into_product
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe, usual_recipe
from uwtrack_cli.flow.sources import open_with_options

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

ANSWERS = ("encounters", "motions", "fixes", "target", "decision", "lines", "levels")
"""Containers that a table is made of when none is named: the first that is there."""


class SourceOptions(TypedDict, total=False):
    """How a recording is opened; all may be left out."""

    sensor: Path | str | None
    """Sensor or deployment file; `pass.sensor.toml` beside `pass.wav` is found."""
    own_ship: Path | str | None
    """CSV table of the platform's way, instead of the sensor's."""
    sound_speed_mps: float | None
    """Sound speed, m/s, instead of the sensor's."""
    start_utc: str | datetime | np.datetime64 | None
    """Time of the first sample; a text is ISO 8601."""
    time_zone: str
    """Zone of times that name none."""
    time_pattern: str | None
    """Pattern of the start time in the file name, such as %Y%m%d_%H%M%S."""
    channel: int | None
    """Channel to use, counted from 1."""
    start_s: float | None
    """Where to begin, s from the first sample."""
    stop_s: float | None
    """Where to end, s from the first sample."""
    allow_truncated: bool
    """Whether to take what is there of a file that ends too early."""


@dataclass(frozen=True, eq=False, repr=False)
class Results(ContainerHolder, Mapping[str, Container]):
    """What a run found, or a product file holds: containers by name.

    ``results["encounters"]`` is a container of arrays; `to_pandas` and `to_xarray`
    give it as a table. ``list(results)`` names what is there.
    """

    name: str
    """File that was read."""
    tables: Mapping[ContainerKey, Container]
    """The containers by sensor, name and step."""
    history: tuple[HistoryStep, ...]
    """What was done, with the options used."""
    usual: tuple[ContainerKey, ...] = ()
    """What is meant of each kind where no step is named."""
    sound: Mapping[str, Reader | None] = field(default_factory=dict)
    """Readers of the recordings that a run read, by sensor, for pictures of them."""

    def __getitem__(self, name: str) -> Container:
        """Return the container of a name; see `read` where there are several."""
        if name not in list(self):
            raise KeyError(name)
        return self.read(name)

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the containers."""
        return iter(dict.fromkeys(key.name for key in self.tables))

    def __len__(self) -> int:
        """Return how many names there are."""
        return len(list(iter(self)))

    def __repr__(self) -> str:
        """Name the file and what it holds."""
        return f"<uwtrack results of {self.name}: {', '.join(self)}>"

    def _repr_html_(self) -> str:
        """Show in a notebook what is there, and the answer as a table."""
        counts = [(name, self._rows(name)) for name in self]
        text = f"<b>{escape(self.name)}</b>{html_table(('container', 'rows'), counts)}"
        for key, container in self.tables.items():
            if key.name in SUMMARIES and container.sizes().get(container.ROW, 0):
                summary = summary_of(key.name, json_rows(container))
                text += f"<b>{key.name}</b>{html_table(summary.titles, summary.rows)}"
        return text

    def _rows(self, name: str) -> str:
        own = [c for key, c in self.tables.items() if key.name == name]
        return str(sum(c.sizes().get(c.ROW, 1) for c in own))

    def plot(
        self,
        output: Path | str | None = None,
        *,
        passage: int | None = None,
        sensor: str | None = None,
        demon: bool = False,
        overwrite: bool = False,
        **view: Any,
    ) -> Any:
        """Draw the page of the recording, or of one passage, as `uwtrack plot` does.

        Parameters
        ----------
        output
            Picture to write: PNG, SVG or PDF; without one, the figure is returned alone.
        passage
            Number of a passage, by time from 1; None for the page of the recording.
        sensor
            Whose page, where several sensors have one.
        demon
            Whether the averaged spectrum of the envelope is drawn.
        overwrite
            Whether an existing picture may be replaced.
        **view
            How it is drawn: ``begin``, ``end``, ``band_hz``, ``is_log``, ``has_lines``,
            ``units`` (``"kn"`` or ``"m/s"``), ``width_in``, ``height_in``, ``dpi``.

        Returns
        -------
        matplotlib.figure.Figure
            The page, which a notebook shows by itself.

        Raises
        ------
        DataError
            There is no such page, or matplotlib is not installed.
        OptionError
            There is no such option, or it is not accepted.
        """
        shown = [
            replace(c, reader=self.sound.get(c.sensor.id)) if isinstance(c, Recording) else c
            for key, c in self.tables.items()
            if key in self.usual or (isinstance(c, Overview) and c.reference == MODULATION)
        ]
        with needing(
            "plots need matplotlib", "plot"
        ):  # as pandas finds what draws its tables: this room knows no pictures
            pages = import_module("uwtrack_cli.plotting.page")
        return pages.draw_page(
            shown, output, passage=passage, sensor=sensor, is_demon=demon,
            overwrite=overwrite, **view,
        )  # fmt: skip

    def _held(self) -> Collection[ContainerKey]:
        return self.tables.keys()

    def _container(self, key: ContainerKey) -> Container:
        return self.tables[key]

    def to_pandas(
        self,
        kind: type[Container] | str | None = None,
        sensor: str | None = None,
        step: str | None = None,
    ) -> "pd.DataFrame":
        """Return a container as a pandas frame.

        Parameters
        ----------
        kind, sensor, step
            Which container, as for `read`; without a kind it is the answer of the
            recipe: closest approaches, or motions.

        Raises
        ------
        DataError
            There is no such container, or pandas is not installed.
        """
        container = self.read(kind or self._answer(), sensor, step)
        return to_pandas(container, self._start_utc_ns())

    def to_xarray(
        self,
        kind: type[Container] | str | None = None,
        sensor: str | None = None,
        step: str | None = None,
    ) -> "xr.Dataset":
        """Return a container as an xarray dataset.

        Parameters
        ----------
        kind, sensor, step
            Which container, as for `to_pandas`.

        Raises
        ------
        DataError
            There is no such container, or xarray is not installed.
        """
        container = self.read(kind or self._answer(), sensor, step)
        return to_xarray(container, self._start_utc_ns())

    def _answer(self) -> str:
        return next((name for name in ANSWERS if name in list(self)), ANSWERS[0])

    def _start_utc_ns(self) -> int | None:
        """Return the start of the recordings if they have one in common."""
        recordings = [c for c in self.tables.values() if isinstance(c, Recording)]
        starts = {recording.start_utc_ns for recording in recordings}
        return starts.pop() if len(starts) == 1 else None


def run(
    source: Path | str,
    *,
    recipe: Recipe | Path | str | None = None,
    settings: Sequence[str] = (),
    keep: Sequence[type[Container] | str] = (),
    output: Path | str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    **source_options: Unpack[SourceOptions],
) -> Results:
    """Run the whole chain over a recording, as `uwtrack run` does.

    Parameters
    ----------
    source
        The recording: WAV, RF64, W64, FLAC or AIFF.
    recipe
        Name of a shipped recipe, a TOML file, or a `Recipe`; without one, that of the
        command.
    settings
        Options of steps to override, as ``STEP.OPTION=VALUE``.
    keep
        Passing containers to keep, too: ``"spectrogram"``, ``"peaks"``.
    output
        Product file to write; without one, nothing is left behind.
    overwrite
        Whether an existing product may be replaced.
    progress
        Called with the time in seconds that has been dealt with.
    **source_options
        How the recording is opened: see `SourceOptions`.

    Returns
    -------
    Results
        All containers of the product, in memory.

    Raises
    ------
    DataError
        The recording or its sensor file is missing, damaged or of the wrong kind.
    OptionError
        The recipe, a setting or an option is not accepted.
    OutputError
        The output exists already, or cannot be written.

    Examples
    --------
    >>> from uwtrack_cli.flow.shipped_recipes import shipped_folder
    >>> sound = shipped_folder("sample_data") / "mono.wav"
    >>> results = run(sound, start_utc="2024-05-01T12:00:00Z", stop_s=40.0)
    >>> "lines" in results
    True
    >>> results.to_xarray("levels").level_db.dims
    ('time',)
    """
    path = Path(source)
    unknown = set(source_options) - set(SourceOptions.__annotations__)
    if unknown:
        raise OptionError(
            f"run has no option {min(unknown)!r}; it has recipe, settings, keep, "
            f"output, overwrite, progress, {', '.join(SourceOptions.__annotations__)}."
        )
    recording = open_with_options(path, _opening(source_options))
    chosen = recipe or usual_recipe([recording.sensor])
    if not isinstance(chosen, Recipe):
        chosen = load_recipe(chosen)
    kinds = [container_class(k) if isinstance(k, str) else k for k in keep]
    with ExitStack() as stack, warnings.catch_warnings():
        warnings.simplefilter("ignore", UwtrackNote)  # the results say it in its place
        if output is None:
            folder = stack.enter_context(TemporaryDirectory(prefix="uwtrack-"))
            target = Path(folder) / "run.h5"
        else:
            target = Path(output)
        with ProductWriter(target, overwrite=overwrite, inputs=[path]) as writer:
            run_into_product(
                recording, chosen.with_settings(settings), writer, keep=kinds, progress=progress
            )
        found = _read_all(target, path.name if output is None else str(output))
    return replace(found, sound={recording.sensor.id: recording.reader})


def _opening(given: SourceOptions) -> dict[str, object]:
    """Return the options of opening as the commands have them."""
    options: dict[str, object] = dict(given)
    if "sound_speed_mps" in options:
        options["sensor_sound_speed_mps"] = options.pop("sound_speed_mps")
    if options.get("start_utc") is not None:
        options["start_utc"] = str(options["start_utc"])
    if options.get("own_ship") is not None:
        options["own_ship"] = Path(str(options["own_ship"]))
    return options


def read_results(path: Path | str) -> Results:
    """Read all containers of a product file.

    Parameters
    ----------
    path
        The product. All of it is read: a long spectrogram is better read in blocks,
        with `read_product` and `Product.stream`.

    Raises
    ------
    DataError
        The file is missing, no product, damaged or too new.
    """
    return _read_all(Path(path), str(path))


def _read_all(path: Path, name: str) -> Results:
    with read_product(path) as product:
        names = list(CONTAINERS)
        keys = sorted(product.paths, key=lambda key: names.index(key.name))
        tables = {key: product.read(key.name, key.sensor, key.step) for key in keys}
        usual = tuple(without_asides(product, keys))
        return Results(name, tables, tuple(product.history), usual)
