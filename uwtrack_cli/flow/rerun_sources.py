"""The sources that a history names: found, checked, opened as they were."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from uwtrack_cli.arrays.recorders import join_recorders
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Container, IntArray
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, UwtrackError
from uwtrack_cli.files.audio.opening import sound_facts
from uwtrack_cli.files.hdf5.product import HistoryStep, Product, Source, source_of
from uwtrack_cli.files.tables.replay import SUFFIXES as REPLAYS
from uwtrack_cli.files.tables.replay import read_replay
from uwtrack_cli.files.tables.scan_tables import TABLES, table_readers
from uwtrack_cli.files.tables.sensors import load_deployment, sensor_files
from uwtrack_cli.files.text_escaping import file_name
from uwtrack_cli.flow.catalogue import find_stage
from uwtrack_cli.flow.concatenate import join_recordings
from uwtrack_cli.flow.sources import open_file


@dataclass
class SourceFinder:
    """Looks for sources beside a product, or where the user says they are."""

    product: Path
    """The product that is made again."""
    given: tuple[Path, ...]
    """Files and folders that the user named."""
    found: list[Path] = field(default_factory=list)
    """Sources that were found, in order."""

    def find(self, source: Source) -> Path:
        """Return the file that a history names, the same to the bit.

        Raises
        ------
        DataError
            There is none, or it has changed.
        """
        name = Path(source.name).name  # a history may not lead elsewhere
        folders = [p for p in self.given if p.is_dir()] or [self.product.parent]
        places = [p for p in self.given if p.is_file()]
        places += [folder / name for folder in folders]
        there = [place for place in places if place.is_file()]
        if not there:  # a name that is not UTF-8 is written out in the history
            there = [p for f in folders for p in f.glob("*") if file_name(p) == name]
        for place in there:
            if source_of(place).digest == source.digest:
                self.found.append(place)
                return place
        if there:
            raise DataError(
                f"{there[-1]} is not the file that the result file was made from: its "
                f"digest differs; give the right one with --source."
            )
        raise DataError(
            f"{name}, of which {self.product.name} was made, is not in {folders[0]}; "
            f"give it, or the folder it lies in, with --source."
        )


def reopen(
    product: Product, step: HistoryStep, finder: SourceFinder
) -> tuple[Recording, list[Container]]:
    """Open the recording of a step as it was opened for the product.

    Raises
    ------
    DataError
        A source is missing or has changed, or the product does not carry its facts.
    """
    paths = [finder.find(source) for source in step.sources]
    by_digest = {one.digest: one for one in product.read_all(Recording)}
    known = [by_digest[one.digest] for one in step.sources if one.digest in by_digest]
    if len(known) == len(paths) > 1:  # recorders of one clock
        parts = list(map(_reopen_one, paths, known))
        return join_recorders(parts), [each for one in parts for each in (one, one.sensor)]
    stored = _stored(product, step)
    joined = [f for f in product.read_all(RecordedFiles) if f.sensor == stored.sensor.id]
    if len(paths) == 1 and not joined:
        return _reopen_one(paths[0], stored), []
    files = product.read(RecordedFiles, stored.sensor.id)
    if len(paths) != files.name.size:
        raise DataError(f"{product.name} does not say how its {len(paths)} sources were joined.")
    opened = [
        _reopen_one(
            path,
            replace(stored, n_samples=int(n), start_utc_ns=int(start), first_sample=int(first)),
        )
        for path, n, start, first in zip(
            paths, files.n_samples, files.start_utc_ns, _first_samples(files), strict=True
        )
    ]
    slack_s = _slack_s(files, stored.sample_rate_hz)
    recording, again = join_recordings(opened, slack_s=slack_s, own_ns=files.own_ns)
    return recording, [again]


def _first_samples(files: RecordedFiles) -> IntArray:
    """Return the sample of each file that is its first; 0 in older products."""
    if files.first_sample is None:
        return np.zeros(files.name.size, np.int64)
    return files.first_sample


def with_sound(stored: Recording, products: Sequence[Product]) -> Recording:
    """Return a recording with its sound, if its files lie unchanged beside a product."""
    for product in products:
        for step in product.history:
            named = {source.name for source in step.sources}
            if find_stage(step.stage).kind != "source" or stored.name not in named:
                continue
            try:
                opened, _ = reopen(product, step, SourceFinder(Path(product.name), ()))
            except UwtrackError:
                continue
            return replace(stored, reader=opened.reader)
    return stored


def read_tables(history: Sequence[HistoryStep], finder: SourceFinder) -> list[Container]:
    """Read the tables that the steps of a history read."""
    tables: list[Container] = []
    for step in history:
        stage = find_stage(step.stage)
        left = [kind.NAME for i in stage.inputs for kind in i.kinds]
        found = [finder.find(source) for source in step.sources]
        sensors = [
            one.sensor
            for path in found
            if path.suffix.lower() == ".toml"
            for one in load_deployment(path)
        ]
        named = sensors if stage.output in {Motions, Fixes} else []  # in their rows
        beside = {file for path in found for file in _navigation_of(path)}
        tables += [
            _read_table(path, left, named)
            for path in found
            if path.suffix.lower() in TABLES and path not in beside
        ]
        replays = [path for path in found if path.suffix.lower() in REPLAYS]
        if replays and "series" in left:
            tables.append(read_replay(replays))
        if any(Sensor in i.kinds for i in stage.inputs):
            tables += sensors
    return tables


def _navigation_of(path: Path) -> list[Path]:
    """Return the tables that a sensor file names; none of another file."""
    return sensor_files(path, path)[1:] if path.suffix.lower() == ".toml" else []


def _read_table(path: Path, left: list[str], sensors: Sequence[Sensor]) -> Container:
    """Read a table as the first kind that it can be and that is still missing."""
    reason = "the stage reads no table"
    readers = table_readers(sensors)
    for name in [name for name in left if name in readers]:
        try:
            table = readers[name](path)
        except UwtrackError as error:
            reason = str(error)
        else:
            left.remove(name)
            return table
    raise DataError(f"{path} cannot be read again: {reason}")


def _stored(product: Product, step: HistoryStep) -> Recording:
    named = {source.name for source in step.sources}
    for recording in product.read_all(Recording):
        if recording.name in named:
            return recording
    raise DataError(f"{product.name} does not carry the facts of {', '.join(sorted(named))}.")


def _reopen_one(path: Path, stored: Recording) -> Recording:
    start_utc_ns = stored.start_utc_ns
    if start_utc_ns is not None:
        start_utc_ns -= stored.elapsed_ns(stored.first_sample)
    return open_file(
        path,
        sensor=_sensor_of_file(path, stored),
        start_utc_ns=start_utc_ns,
        start_s=stored.first_s,
        stop_s=(stored.first_sample + stored.n_samples) / stored.sample_rate_hz,
        allow_truncated=True,
    )


def _sensor_of_file(path: Path, stored: Recording) -> Sensor:
    """Return the sensor with its channels in the order of the file."""
    names = ["-"] * sound_facts(path).n_channels
    columns = [int(text) for text in stored.file_channels.split(",") if text.isdigit()]
    sensor = stored.sensor
    kept = ("multiplex",) if sensor.is_multiplexed else sensor.channel_names
    if len(columns) != len(kept) or not all(1 <= c <= len(names) for c in columns):
        raise DataError(f"the result file does not say which channels of {path} it was made of.")
    for name, column in zip(kept, columns, strict=True):
        names[column - 1] = name
    return replace(stored.sensor, channels=",".join(names))


def _slack_s(files: RecordedFiles, rate_hz: float) -> float:
    """Return the slack that puts the files where they were."""
    ends = files.start_sample[:-1] + files.n_samples[:-1]
    follows = files.start_sample[1:] == ends
    expected = (files.start_utc_ns[1:] - files.start_utc_ns[0]) / NANOSECONDS
    off_s = abs(expected - files.start_sample[1:] / rate_hz)
    return float(off_s[follows].max(initial=0.0)) + 1.0 / rate_hz
