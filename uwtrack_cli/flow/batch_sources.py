"""From files, folders and patterns to jobs whose products mirror the source tree."""

import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from glob import has_magic
from pathlib import Path
from typing import Any

from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.files.audio.opening import SUFFIXES
from uwtrack_cli.files.audio.start_time import check_clock_options
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.files.input_ledger import as_input, not_an_input, refuse_input
from uwtrack_cli.files.tables.sensors import load_deployment, sensor_files
from uwtrack_cli.files.text_escaping import file_name
from uwtrack_cli.flow.batch import Job
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.recorder_folder import Joining, Part, find_span, plan_parts, remarks
from uwtrack_cli.flow.vessel_names import WITHIN_M, read_vessels

SUFFIX = ".run.h5"

TIME_DIGITS = re.compile(r"[ ._-]*\d{4}[\dTZ._-]*$")
"""The time at the end of the name of a recorder's file."""


@dataclass(frozen=True)
class FoundRecording:
    """A recording, and its place below what the user named."""

    path: Path
    """Path of the recording."""
    place: Path
    """Path relative to what the user named."""

    @property
    def root(self) -> Path:
        """The folder that the user named, or in which what was named lies."""
        return self.path.absolute().parents[len(self.place.parts) - 1]


def find_recordings(sources: Sequence[Path]) -> list[FoundRecording]:
    """Return the recordings of files, folders and patterns, each one once.

    Raises
    ------
    DataError
        A folder or pattern holds no recording.
    """
    found: dict[Path, FoundRecording] = {}
    for source in sources:
        here = list(_recordings(source))
        if not here:
            raise DataError(f"{source} holds no recording ({', '.join(SUFFIXES)}).")
        for item in here:
            found.setdefault(item.path.absolute(), item)
    return list(found.values())


def other_source(
    sources: Iterable[str], found: Sequence[FoundRecording], roots: Iterable[Path]
) -> str | None:
    """Return the first recording of a report that is of another batch; None without one.

    One that is no longer there is of this batch if it lay below one of its folders.
    ``found``: the recordings of this batch. ``roots``: where they were looked for.
    """
    own = {_place_of(item.path) for item in found}
    folders = {root.resolve() for root in roots}
    for source in sources:
        path = _place_of(Path(source))
        is_gone = not path.exists() and not folders.isdisjoint(path.parents)
        if path not in own and not is_gone:
            return source
    return None


def _place_of(path: Path) -> Path:
    """Return the one path of a file, which may be a link, by whatever way it is named."""
    return path.parent.resolve() / path.name


def make_jobs(
    found: Sequence[FoundRecording],
    folder: Path,
    recipe: Recipe,
    options: Mapping[str, Any],
    *,
    resume: bool = False,
    overwrite: bool = False,
    joining: Joining | None = None,
    ais: Path | None = None,
    within_m: float = WITHIN_M,
) -> list[Job]:
    """Return one job per recording, or per group of recordings that are joined.

    Raises
    ------
    OptionError
        Two recordings would be written to one file, or the time zone or the pattern of
        names is not understood.
    DataError
        The sensor file, the way of own ship or the AIS table cannot be read.
    OutputError
        A product would replace a file that is read, for this or another product.
    """
    check_clock_options(options.get("time_pattern"), options.get("time_zone"))
    _check_files(options)
    # a worker of a cluster has another working directory
    whole = {k: v.absolute() if isinstance(v, Path) else v for k, v in options.items()}
    parts = [Part((k,)) for k in range(len(found))]
    if joining is not None:
        parts = _parts(found, options, joining)
    targets = _targets([_product_place(found, part) for part in parts], folder)
    _protect(found, options.get("sensor"), targets)
    if ais is not None:
        read_vessels(ais)  # a wrong table is told once, before the work
    return [
        Job(
            tuple(found[k].path.absolute() for k in part.files),
            target.absolute(),
            recipe,
            whole,
            resume,
            overwrite,
            joining,
            part.own_ns,
            None if ais is None else ais.absolute(),
            within_m,
        )
        for part, target in zip(parts, targets, strict=True)
    ]


def describe_recorders(
    found: Sequence[FoundRecording], options: Mapping[str, Any], joining: Joining | None = None
) -> list[str]:
    """Return what recordings have to do with each other, in words.

    ``joining``: how they are joined; None if they are not.
    """
    spans = {k: find_span(item.path, options) for k, item in enumerate(found)}
    known = {k: span for k, span in spans.items() if span is not None}
    paths = [found[k].path for k in known]
    return list(
        remarks(paths, list(known.values()), joining or Joining(), is_joined=joining is not None)
    )


def _check_files(options: Mapping[str, Any]) -> None:
    """Refuse files for all recordings that cannot be read: once, before the work."""
    sensor, own_ship = options.get("sensor"), options.get("own_ship")
    with warnings.catch_warnings():  # the jobs warn of what is odd in them
        warnings.simplefilter("ignore", UwtrackWarning)
        if sensor is not None:
            load_deployment(sensor)
    if own_ship is not None:
        check_readable(own_ship)


def _protect(
    found: Sequence[FoundRecording], sensor_file: Path | None, targets: Sequence[Path]
) -> None:
    """Note what the jobs will read, wherever they run, and refuse it as a target."""
    for item in found:
        as_input(item.path)
        for path in sensor_files(item.path, sensor_file):
            as_input(path)
    for target in targets:
        refuse_input(target)


def _recordings(source: Path) -> list[FoundRecording]:
    if source.is_dir():
        inside = sorted(p for p in source.rglob("*") if _is_sound(p, source))
        return [FoundRecording(path, path.relative_to(source)) for path in inside]
    if has_magic(str(source)) and not source.exists():
        return _matching(source)
    return [FoundRecording(source, Path(source.name))]


def _matching(pattern: Path) -> list[FoundRecording]:
    parts = pattern.parts
    first = next(k for k, part in enumerate(parts) if has_magic(part))
    base = Path(*parts[:first]) if first else Path()
    paths = sorted(base.glob(str(Path(*parts[first:]))))
    return [FoundRecording(p, p.relative_to(base)) for p in paths if _is_sound(p, base)]


def _is_sound(path: Path, base: Path) -> bool:
    hidden = any(part.startswith(".") for part in path.relative_to(base).parts)
    return path.suffix.lower() in SUFFIXES and not hidden and path.is_file()


def _targets(places: Sequence[tuple[Path, Path]], folder: Path) -> list[Path]:
    """Return the products of recordings, each given with its place without an ending.

    Recordings whose names differ in their endings alone keep them. What a recording has
    been written to remains its product, whatever arrives or goes beside it.
    """
    short = [folder / place.with_name(place.name + SUFFIX) for _, place in places]
    counts = Counter(short)
    targets = []
    for name, (path, _) in zip(short, places, strict=True):
        full = name.with_name(path.name + SUFFIX)
        is_free = counts[name] == 1 and not full.exists()
        targets.append(name if is_free or _is_made_of(name, path) else full)
    twice = [target for target, n in Counter(targets).items() if n > 1]
    if twice:
        clash = [path for (path, _), p in zip(places, targets, strict=True) if p == twice[0]]
        raise OptionError(
            f"{' and '.join(map(str, clash))} would both be written to "
            f"{twice[0]}: name the folder above them, or run them apart."
        )
    return targets


def _is_made_of(target: Path, recording: Path) -> bool:
    """Tell whether a product that is there was made of a recording of this name."""
    try:
        status = target.stat()
    except OSError:
        return False
    return file_name(recording) in _sources(target, status.st_size, status.st_mtime_ns)


@lru_cache
def _sources(target: Path, *_: int) -> frozenset[str]:
    """Return the names of what a product was made of, as long as it does not change."""
    with suppress(DataError), not_an_input(), read_product(target) as product:
        steps = product.history
        return frozenset(source.name for step in steps for source in step.sources)
    return frozenset()


def _product_place(found: Sequence[FoundRecording], part: Part) -> tuple[Path, Path]:
    """Return the recording that a product is named after, and the product's place."""
    first = found[part.files[0] if part.first is None else part.first]
    if not part.label:
        return first.path, first.place.with_name(first.place.stem)
    name = TIME_DIGITS.sub("", first.path.stem) or first.path.absolute().parent.name
    return first.path, first.place.with_name(f"{name or 'recording'}_{part.label}")


def _parts(
    found: Sequence[FoundRecording], options: Mapping[str, Any], joining: Joining
) -> list[Part]:
    """Join and cut the files whose time is known; the others stay alone."""
    spans = {k: find_span(item.path, options) for k, item in enumerate(found)}
    known = {k: span for k, span in spans.items() if span is not None}
    numbers = list(known)
    parts = [
        replace(
            part,
            files=tuple(numbers[k] for k in part.files),
            first=None if part.first is None else numbers[part.first],
        )
        for part in plan_parts(list(known.values()), joining)
    ]
    parts += [Part((k,)) for k, span in spans.items() if span is None]
    return sorted(_numbered(parts), key=lambda part: part.files)


def _numbered(parts: Sequence[Part]) -> Iterator[Part]:
    """Yield parts, with a number where several recordings have a part of one label."""
    seen: Counter[str] = Counter()
    for part in parts:
        seen[part.label] += 1
        n = seen[part.label]
        yield replace(part, label=f"{part.label}-{n}") if part.label and n > 1 else part
