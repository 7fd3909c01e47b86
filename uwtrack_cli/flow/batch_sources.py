"""From files, folders and patterns to jobs whose products mirror the source tree."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from glob import has_magic
from pathlib import Path
from typing import Any

from uwtrack_cli.errors import DataError, OptionError, UwtrackError
from uwtrack_cli.files.audio.opening import SUFFIXES, sound_facts
from uwtrack_cli.files.audio.start_time import find_start_utc_ns
from uwtrack_cli.files.input_ledger import as_input, refuse_input
from uwtrack_cli.files.tables.sensors import find_sensor, sensor_files
from uwtrack_cli.flow.batch import Job
from uwtrack_cli.flow.concatenate import MAX_GAP_S, SLACK_S, Span, group_spans
from uwtrack_cli.flow.recipe import Recipe

SUFFIX = ".run.h5"


@dataclass(frozen=True)
class Found:
    """A recording, and its place below what the user named."""

    path: Path
    """Path of the recording."""
    place: Path
    """Path relative to what the user named."""


@dataclass(frozen=True)
class Joining:
    """How files are joined: greatest gap and least difference from UTC, s."""

    max_gap_s: float = MAX_GAP_S
    """Longest gap within a joined recording, s."""
    slack_s: float = SLACK_S
    """Difference from UTC up to which a file directly follows the one before it, s."""


def find_recordings(sources: Sequence[Path]) -> list[Found]:
    """Return the recordings of files, folders and patterns, each one once.

    Raises
    ------
    DataError
        A folder or pattern holds no recording.
    """
    found: dict[Path, Found] = {}
    for source in sources:
        here = list(_recordings(source))
        if not here:
            msg = f"{source} holds no recording ({', '.join(SUFFIXES)})."
            raise DataError(msg)
        for item in here:
            found.setdefault(item.path.absolute(), item)
    return list(found.values())


def make_jobs(
    found: Sequence[Found],
    folder: Path,
    recipe: Recipe,
    options: Mapping[str, Any],
    *,
    resume: bool = False,
    overwrite: bool = False,
    joining: Joining | None = None,
) -> list[Job]:
    """Return one job per recording, or per group of recordings that are joined.

    Raises
    ------
    OptionError
        Two recordings would be written to one file.
    OutputError
        A product would replace a file that is read, for this or another product.
    """
    groups: list[tuple[int, ...]] = [(k,) for k in range(len(found))]
    if joining is not None:
        groups = _join(found, options, joining)
    targets = _targets([found[group[0]] for group in groups], folder)
    _protect(found, options.get("sensor"), targets)
    return [
        Job(
            tuple(found[k].path.absolute() for k in group),
            target.absolute(),
            recipe,
            dict(options),
            resume,
            overwrite,
            joining.slack_s if joining else SLACK_S,
        )
        for group, target in zip(groups, targets, strict=True)
    ]


def _protect(
    found: Sequence[Found], sensor_file: Path | None, targets: Sequence[Path]
) -> None:
    """Note what the jobs will read, wherever they run, and refuse it as a target."""
    for item in found:
        as_input(item.path)
        for path in sensor_files(item.path, sensor_file):
            as_input(path)
    for target in targets:
        refuse_input(target)


def _recordings(source: Path) -> list[Found]:
    if source.is_dir():
        inside = sorted(p for p in source.rglob("*") if _is_sound(p, source))
        return [Found(path, path.relative_to(source)) for path in inside]
    if has_magic(str(source)) and not source.exists():
        return _matching(source)
    return [Found(source, Path(source.name))]


def _matching(pattern: Path) -> list[Found]:
    parts = pattern.parts
    first = next(k for k, part in enumerate(parts) if has_magic(part))
    base = Path(*parts[:first]) if first else Path()
    paths = sorted(base.glob(str(Path(*parts[first:]))))
    return [Found(p, p.relative_to(base)) for p in paths if _is_sound(p, base)]


def _is_sound(path: Path, base: Path) -> bool:
    hidden = any(part.startswith(".") for part in path.relative_to(base).parts)
    return path.suffix.lower() in SUFFIXES and not hidden and path.is_file()


def _targets(found: Sequence[Found], folder: Path) -> list[Path]:
    short = [item.place.with_name(item.place.stem + SUFFIX) for item in found]
    counts = Counter(short)
    places = [
        name if counts[name] == 1 else item.place.with_name(item.place.name + SUFFIX)
        for name, item in zip(short, found, strict=True)
    ]
    twice = [place for place, n in Counter(places).items() if n > 1]
    if twice:
        clash = [item.path for item, p in zip(found, places, strict=True)
                 if p == twice[0]]  # fmt: skip
        msg = (
            f"{' and '.join(map(str, clash))} would both be written to "
            f"{folder / twice[0]}: name the folder above them, or run them apart."
        )
        raise OptionError(msg)
    return [folder / place for place in places]


def _join(
    found: Sequence[Found], options: Mapping[str, Any], joining: Joining
) -> list[tuple[int, ...]]:
    """Group the files whose time is known; the others stay alone."""
    spans: dict[int, Span] = {}
    for k, item in enumerate(found):
        span = _span(item, options)
        if span is not None:
            spans[k] = span
    known = list(spans)
    groups = group_spans(list(spans.values()), joining.max_gap_s)
    joined = [tuple(known[k] for k in group) for group in groups]
    alone = [(k,) for k in range(len(found)) if k not in spans]
    return sorted([*joined, *alone])


def _span(item: Found, options: Mapping[str, Any]) -> Span | None:
    try:
        facts = sound_facts(item.path)
        sensor = find_sensor(item.path, options.get("sensor"))
        start = find_start_utc_ns(
            item.path,
            time_pattern=options.get("time_pattern"),
            time_zone=options.get("time_zone") or "UTC",
        )
    except UwtrackError:
        return None  # its own job tells what is wrong with it
    if start is None:
        return None
    place = str(item.path.parent) if sensor is None else ""
    recorder = (
        place,
        None if sensor is None else sensor.id,
        facts.sample_rate_hz,
        facts.n_channels,
    )
    return Span(recorder, start, facts.n_samples / facts.sample_rate_hz)
