"""One table over many results: every passage of files and folders, once.

**Method.** Each product is read for its encounters, and for its positions where it has
them. Products of one recording and sensor are different views of the same passages:
the one that was made last counts. What a product gave is kept in a cache under its
path, size and time of change, so that a folder is read once and then only what is new
in it; the cache is no result and may be deleted at any time.

**Conventions.** Rows are in the order of UTC; those without a start time come last. A
product that cannot be read is named and left out; it does not end the table.
"""

import json
import os
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from uwtrack_cli import __version__
from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.data.decidecades import RadiatedLevels
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, UwtrackError
from uwtrack_cli.files.hdf5.product import Product, read_many, read_product
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.files.utc import parse_utc
from uwtrack_cli.flow.recorder_folder import OwnSpan, distinct_passages
from uwtrack_cli.flow.scoring.encounter_scores import SCORED
from uwtrack_cli.flow.sound_hours import SoundSpan, each_once, hours_per_day, sound_of, total_h
from uwtrack_cli.flow.vessel_names import WITHIN_M, AisVessels, read_vessels

Group = Literal["day", "month", "vessel", "sensor"]
UNKNOWN = "unknown"

SAVED_AT_ONCE = 500
"""Results after which the cache is written."""

SAME_PLACE_M = 50.0
"""Distance within which two positions of one sensor identifier are the same place."""


@dataclass(frozen=True, kw_only=True)
class PassageRow:
    """A closest approach, with where it was found.

    As in `Encounters`, with their units, None where not known: sensor, contact, status,
    time_s, speed_mps, slant_range_m, horizontal_range_m, range_over_speed_s, course_deg,
    bearing_deg, side and received_level_db, with the deviations time_std_s,
    speed_std_mps, slant_range_std_m, range_over_speed_std_s, course_std_deg,
    bearing_std_deg and received_level_std_db.
    """

    time_utc: str | None = None
    """Closest approach, UTC; None where the start of the recording is not known."""
    sensor: str
    contact: int
    status: str
    vessel: str | None = None
    """Name of the vessel by AIS."""
    mmsi: str | None = None
    """Its MMSI."""
    vessel_probability: float | None = None
    """Probability that it is that vessel."""
    time_s: float | None = None
    time_std_s: float | None = None
    speed_mps: float | None = None
    speed_std_mps: float | None = None
    slant_range_m: float | None = None
    slant_range_std_m: float | None = None
    horizontal_range_m: float | None = None
    range_over_speed_s: float | None = None
    range_over_speed_std_s: float | None = None
    course_deg: float | None = None
    course_std_deg: float | None = None
    bearing_deg: float | None = None
    bearing_std_deg: float | None = None
    side: str | None = None
    received_level_db: float | None = None
    received_level_std_db: float | None = None
    level_reference: str | None = None
    """'1 uPa' or 'full scale'."""
    latitude: float | None = None
    """Latitude at closest approach, degrees."""
    longitude: float | None = None
    """Longitude at closest approach, degrees."""
    recording: str | None = None
    """File name of the recording."""
    file: str
    """Product that the row was read from."""


@dataclass(frozen=True, kw_only=True)
class PassageLevel:
    """Radiated noise level of a passage in one decidecade band; not ISO 17208.

    As in `PassageRow`: time_utc, sensor, contact, vessel, mmsi and file; as in
    `RadiatedLevels`, with their units, None where the vessel is not heard over the
    background: centre_hz, radiated_noise_level_db with radiated_noise_level_std_db,
    received_level_db and background_level_db.
    """

    time_utc: str | None = None
    sensor: str
    contact: int
    vessel: str | None = None
    mmsi: str | None = None
    centre_hz: float
    radiated_noise_level_db: float | None = None
    radiated_noise_level_std_db: float | None = None
    received_level_db: float | None = None
    background_level_db: float | None = None
    file: str


@dataclass(frozen=True)
class Result:
    """What one product says."""

    path: str
    """The product."""
    created_utc: str
    """When it was made."""
    recordings: tuple[str, ...]
    """Digest, sensor and first sample of each recording: what it is a view of."""
    places: dict[str, tuple[float, float]]
    """Latitude and longitude by sensor, where they are known."""
    passages: tuple[PassageRow, ...]
    """Its passages."""
    levels: tuple[PassageLevel, ...]
    """Radiated noise levels of its passages."""
    own_ns: tuple[int, int] | None = None
    """Span whose passages it counts, ns since 1970-01-01 UTC; None is everything."""
    files: tuple[str, ...] = ()
    """Digests of the files that it was joined of."""
    sound: tuple[SoundSpan, ...] = ()
    """The sound that it was made of."""
    unnamed: tuple[str, ...] = ()
    """Why its vessels have no names, though AIS was given."""


@dataclass
class PassageTable:
    """All passages, and what was left out on the way."""

    passages: list[PassageRow] = field(default_factory=list)
    """The rows, in the order of UTC."""
    levels: list[PassageLevel] = field(default_factory=list)
    """Radiated noise levels of the passages, in the same order."""
    sound: list[SoundSpan] = field(default_factory=list)
    """The sound in which they were found, each moment of a sensor once."""
    problems: list[str] = field(default_factory=list)
    """Products that could not be read, and what is unclear, in words."""
    n_results: int = 0
    """Products that gave rows or could have."""
    n_read: int = 0
    """Products that had to be read, since the cache did not know them."""


def find_results(sources: Sequence[Path]) -> list[Path]:
    """Return the products of files and folders, each one once.

    Raises
    ------
    DataError
        A source does not exist, or a folder holds no product.
    """
    found: dict[Path, None] = {}
    for source in sources:
        if source.is_dir():
            inside = sorted(p for p in source.rglob("*.h5") if p.is_file())
            if not inside:
                raise DataError(f"{source} holds no result file (*.h5): run uwtrack batch.")
            found |= dict.fromkeys(inside)
        elif source.exists():
            found[source] = None
        else:
            raise DataError(f"{source} does not exist.")
    return list(found)


def collect_passages(
    sources: Sequence[Path],
    *,
    ais: Path | None = None,
    within_m: float = WITHIN_M,
    cache: Path | None = None,
) -> PassageTable:
    """Read the passages of files and folders.

    ``within_m``: largest range at which an AIS vessel is expected to be detected, m.
    ``cache``: file that remembers what products gave; None reads every one.

    Raises
    ------
    DataError
        A source does not exist, or a folder holds no product.
    """
    table = PassageTable()
    results: list[Result] = []
    remembered = _Cache(cache, ais, within_m)
    vessels = None if ais is None else read_vessels(ais, within_m)
    # an input, even if not opened
    known = {path: remembered.find(as_input(path)) for path in find_results(sources)}
    new = _read_results([p for p, found in known.items() if found is None], vessels)
    try:
        for path, found in known.items():
            result = next(new) if found is None else found
            if isinstance(result, UwtrackError):
                named = "" if str(path) in str(result) else f"{path}: "
                table.problems.append(f"left out: {named}{result}")
                table.n_read += 1
                continue
            if found is None:
                table.n_read += 1
                remembered.keep(path, result)
            results.append(result)
    finally:  # an interrupt, too: the next time goes on from here
        remembered.save()
    table.n_results = len(results)
    table.sound = each_once(span for result in results for span in result.sound)
    table.problems += _places_that_differ(results)
    table.problems += dict.fromkeys(text for r in results for text in r.unnamed)
    rows = [row for part in _once(list(_last_views(results))) for row in part]
    table.passages = sorted(rows, key=lambda row: (row.time_utc or "9999", row.file))
    if vessels is not None and rows and not any(row.mmsi for row in rows):
        table.problems.append(
            f"no passage has a name: {vessels.said_span()}, and no vessel fits within "
            f"{within_m:g} m."
        )
    levels: dict[tuple[str, str, int], list[PassageLevel]] = {}
    for result in results:
        for level in result.levels:
            key = (level.file, level.sensor, level.contact)
            levels.setdefault(key, []).append(level)
    for row in table.passages:
        own = levels.get((row.file, row.sensor, row.contact), [])
        table.levels += (
            replace(level, vessel=row.vessel, mmsi=row.mmsi, time_utc=row.time_utc) for level in own
        )
    return table


def count_passages(table: PassageTable, per: Group) -> list[dict[str, Any]]:
    """Return the number of passages per day, month, vessel or sensor.

    But for vessels each row also has the ``hours`` of sound, of all sensors together,
    and ``passages_per_hour``; it is there without a passage, too.

    ``per``: what they are counted by; what is not known is counted as unknown.
    """
    keys: dict[str, Callable[[PassageRow], str]] = {
        "day": lambda row: (row.time_utc or UNKNOWN)[:10],
        "month": lambda row: (row.time_utc or UNKNOWN)[:7],
        "vessel": lambda row: row.vessel or row.mmsi or UNKNOWN,
        "sensor": lambda row: row.sensor,
    }
    counts = Counter(keys[per](row) for row in table.passages)
    hours = {} if per == "vessel" else _hours(table.sound, per)
    order = sorted({*counts, *hours}, key=lambda name: (name == UNKNOWN, name))
    if per == "vessel":
        return [{per: name, "passages": counts[name]} for name in order]
    return [
        {
            per: name,
            "passages": counts[name],
            "hours": round(hours.get(name, 0.0), 3),
            "passages_per_hour": round(counts[name] / hours[name], 3) if hours.get(name) else None,
        }
        for name in order
    ]


def _hours(sound: Sequence[SoundSpan], per: Group) -> dict[str, float]:
    """Return how long there was sound per day, month or sensor, h."""
    found: dict[str, float] = {}
    if per == "sensor":
        for span in sound:
            found[span.sensor] = found.get(span.sensor, 0.0) + total_h([span])
        return found
    for day, hours in hours_per_day(sound).items():
        name = day if per == "day" else day[:7]
        found[name] = found.get(name, 0.0) + hours
    unknown = [span for span in sound if span.recording]
    return found | ({UNKNOWN: total_h(unknown)} if unknown else {})


def usual_cache() -> Path:
    """Return the file that remembers what products gave."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "uwtrack" / "passages.sqlite"


def _read_results(
    paths: Sequence[Path], vessels: AisVessels | None
) -> Iterator[Result | UwtrackError]:
    """Yield what products say, or why one cannot be read.

    They are read in a process of their own, many at once; but where there are vessels,
    which it would have to read again.
    """
    if vessels is None:
        for path, raw in zip(paths, read_many(f"{__name__}:values_of", paths), strict=True):
            is_wrong = isinstance(raw, DataError)
            yield raw if is_wrong else _from_json(raw, path)
        return
    for path in paths:
        try:
            with read_product(path) as product:
                yield _result_of(product, vessels)
        except UwtrackError as error:
            yield error


def values_of(product: Product) -> dict[str, Any]:
    """Return the fields of the `Result` of a product, for another process."""
    return asdict(_result_of(product, None))


def _result_of(product: Product, vessels: AisVessels | None) -> Result:
    path = Path(product.name)
    recordings = product.read_all(Recording)
    sensors = product.read_all(Sensor)
    found = _distinct(product)
    views = [f"{r.digest} {r.sensor.id} {r.first_sample}" for r in recordings]
    rows: list[PassageRow] = []
    unnamed: set[str] = set()
    for encounters in found:
        named, reason = _named(encounters, vessels, sensors, recordings)
        unnamed.update({reason} if reason else ())
        rows += passage_rows(product, named)
    joined = product.read_all(RecordedFiles)
    return Result(
        str(path), product.created_utc, tuple(sorted(views)),
        {s.id: place for s in sensors if (place := _place(s)) is not None},
        tuple(rows),
        tuple(_levels(path, product)),
        next((files.own_ns for files in joined), None),
        tuple(str(digest) for files in joined for digest in files.digest),
        tuple(sound_of(product)),
        tuple(sorted(unnamed)),
    )  # fmt: skip


def passage_rows(product: Product, encounters: Encounters) -> Iterator[PassageRow]:
    """Yield the passages of a product's closest approaches."""
    recordings = product.read_all(Recording)
    places = _positions(product.read_all(Fixes), encounters)
    for row, place in zip(json_rows(encounters), places, strict=True):
        if row["status"] in SCORED:
            yield _passage(Path(product.name), row, recordings, place)


def _levels(path: Path, product: Product) -> Iterator[PassageLevel]:
    names = [f.name for f in fields(PassageLevel)]
    for table in product.read_all(RadiatedLevels):
        for row in json_rows(table):
            own = {name: row[name] for name in names if name in row}
            yield PassageLevel(**own, file=str(path))


def _distinct(product: Product) -> list[Encounters]:
    found: list[Encounters] = []
    for encounters in product.read_all(Encounters):
        if not any(encounters.equals(other) for other in found):
            found.append(encounters)
    return found


def _named(
    encounters: Encounters,
    vessels: AisVessels | None,
    sensors: Sequence[Sensor],
    recordings: Sequence[Recording],
) -> tuple[Encounters, str]:
    """Return encounters with names, or as they are with the reason why not."""
    if vessels is None or not encounters.n_encounters:
        return encounters, ""
    try:
        return vessels.name(encounters, sensors, recordings), ""
    except DataError as error:
        return encounters, f"without names of vessels: {error}"


def _positions(
    all_fixes: Sequence[Fixes], encounters: Encounters
) -> list[tuple[float, float] | None]:
    """Return the position of each encounter at its closest approach, if there is one."""
    found: list[tuple[float, float] | None] = []
    for contact, time_s in zip(encounters.contact, encounters.time_s, strict=True):
        place = None
        for fixes in all_fixes:
            own = (fixes.contact == contact) & (fixes.mode == 1)
            own &= np.abs(fixes.time_s - time_s) < 0.5
            for row in np.flatnonzero(own & np.isfinite(fixes.latitude))[:1]:
                place = (float(fixes.latitude[row]), float(fixes.longitude[row]))
        found.append(place)
    return found


def _passage(
    path: Path,
    row: dict[str, Any],
    recordings: Sequence[Recording],
    place: tuple[float, float] | None,
) -> PassageRow:
    own = {f.name: row[f.name] for f in fields(PassageRow) if f.name in row}
    vessel = row["vessel"] or {}
    own |= {
        "vessel": vessel.get("name"),
        "mmsi": vessel.get("mmsi"),
        "vessel_probability": vessel.get("probability"),
    }
    own |= dict(zip(("latitude", "longitude"), place or (), strict=False))
    names = [r.name for r in recordings if r.sensor.id == row["sensor"]]
    return PassageRow(**own, recording=names[0] if names else None, file=str(path))


def _place(sensor: Sensor) -> tuple[float, float] | None:
    if sensor.latitude is None or sensor.longitude is None:
        return None
    return float(sensor.latitude), float(sensor.longitude)


def _last_views(results: Sequence[Result]) -> Iterator[Result]:
    """Yield of the products of the same recordings the one that was made last."""
    last: dict[Any, Result] = {}
    for result in results:
        key = result.recordings or (result.path,)
        known = last.get(key)
        better = known is None or (
            (bool(result.passages), result.created_utc) >= (bool(known.passages), known.created_utc)
        )
        if better:
            last[key] = result
    yield from last.values()


def _once(results: Sequence[Result]) -> list[list[PassageRow]]:
    """Return the passages of results; those in two parts of a recording stand once."""
    owns = [None if r.own_ns is None else OwnSpan(*r.own_ns, frozenset(r.files)) for r in results]
    return distinct_passages([r.passages for r in results], owns, _time_of)


def _time_of(row: PassageRow) -> tuple[int, float] | None:
    if row.time_utc is None:
        return None
    return parse_utc(row.time_utc), row.time_std_s or 0.0


def _places_that_differ(results: Sequence[Result]) -> list[str]:
    """Say which sensor identifiers stand for sensors at different places."""
    known: dict[str, tuple[tuple[float, float], str]] = {}
    problems: dict[str, str] = {}
    for result in results:
        for sensor, place in result.places.items():
            before, path = known.setdefault(sensor, (place, result.path))
            if _apart_m(before, place) > SAME_PLACE_M:
                problems[sensor] = (
                    f"sensor {sensor!r} is at {before} in {path} and at {place} in "
                    f"{result.path}: give different sensors different ids."
                )
    return list(problems.values())


def _apart_m(a: tuple[float, float], b: tuple[float, float]) -> float:
    return float(np.hypot(*to_grid(*b, Origin(*a))))


def _from_json(raw: dict[str, Any], path: Path) -> Result:
    """Return the result of a product from its fields as JSON has them."""
    own_ns, file = raw["own_ns"], {"file": str(path)}  # as it is named now
    lists = {name: tuple(raw[name]) for name in ("recordings", "files", "unnamed")}
    return Result(**{
        **raw,
        **lists,
        "path": str(path),
        "places": {name: (a, b) for name, (a, b) in raw["places"].items()},
        "passages": tuple(PassageRow(**row | file) for row in raw["passages"]),
        "levels": tuple(PassageLevel(**row | file) for row in raw["levels"]),
        "sound": tuple(SoundSpan(*span) for span in raw["sound"]),
        "own_ns": None if own_ns is None else (own_ns[0], own_ns[1]),
    })  # fmt: skip


class _Cache:
    """Remembers what products gave, in a database of one table."""

    def __init__(self, path: Path | None, ais: Path | None, within_m: float) -> None:
        self._path = path
        kinds = (PassageRow, PassageLevel, Result)
        columns = ",".join(f.name for kind in kinds for f in fields(kind))
        named = "" if ais is None else f" {ais.absolute()} {within_m:g} {_stamp(ais)}"
        self._made_by = f" {__version__} {columns}{named}"
        self._new: list[tuple[bytes, str, str]] = []
        self._known: dict[bytes, tuple[str, str]] = {}
        if path is not None and path.exists():
            with suppress(sqlite3.Error), closing(sqlite3.connect(path)) as database:
                rows = database.execute("SELECT path, stamp, result FROM results")
                self._known = {name: (stamp, text) for name, stamp, text in rows}

    def find(self, path: Path) -> Result | None:
        """Return what a product gave, None if it has changed or is not known."""
        stamp, text = self._known.get(_key(path), ("", ""))
        if stamp != _stamp(path) + self._made_by:
            return None
        try:
            return _from_json(json.loads(text), path)
        except (ValueError, TypeError, KeyError):
            return None

    def keep(self, path: Path, result: Result) -> None:
        """Note what a product gave."""
        stamp = _stamp(path) + self._made_by
        self._new.append((_key(path), stamp, json.dumps(asdict(result))))
        if len(self._new) >= SAVED_AT_ONCE:  # the program may be killed
            self.save()

    def save(self) -> None:
        """Write what is new; a cache that cannot be written is done without."""
        if self._path is None or not self._new:
            return
        with suppress(sqlite3.Error, OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with closing(sqlite3.connect(self._path)) as database, database:
                database.execute(
                    "CREATE TABLE IF NOT EXISTS results"
                    " (path BLOB PRIMARY KEY, stamp TEXT, result TEXT)"
                )
                database.executemany("INSERT OR REPLACE INTO results VALUES (?, ?, ?)", self._new)
                self._new = []


def _key(path: Path) -> bytes:
    return os.fsencode(path.absolute())


def _stamp(path: Path) -> str:
    facts = path.stat()
    return f"{facts.st_size} {facts.st_mtime_ns}"
