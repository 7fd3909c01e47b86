"""Sensor and deployment files: what the hydrophone is, and where.

**Conventions.** A sensor file is one TOML table, a deployment file several
``[[sensor]]`` tables, each with ``files``: the patterns of the recordings it made.
`pass.sensor.toml` beside `pass.wav` is found by itself. Nothing is invented: what
the file does not say stays unknown.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from warnings import warn

from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.errors import DataError, UwtrackWarning
from uwtrack_cli.files.calibration import CALIBRATION, check_calibration
from uwtrack_cli.files.navigation import read_navigation
from uwtrack_cli.files.toml_tables import (
    Number,
    check_keys,
    number,
    read_toml,
    text,
    texts,
)

NUMBERS: dict[str, Number] = {
    "latitude": Number(-90.0, 90.0, "degrees"),
    "longitude": Number(-180.0, 180.0, "degrees"),
    "east_m": Number(-1e7, 1e7, "m"),
    "north_m": Number(-1e7, 1e7, "m"),
    "position_std_m": Number(0.0, 1e6, "m"),
    "depth_m": Number(0.0, 11_000.0, "m below the surface"),
    "heading_deg": Number(-360.0, 360.0, "degrees"),
    "sound_speed_mps": Number(100.0, 299_792_458.0, "m/s"),
    "compass_offset_deg": Number(-360.0, 360.0, "degrees"),
    "compass_std_deg": Number(0.0, 180.0, "degrees"),
    "clock_offset_s": Number(-1e9, 1e9, "s"),
    "clock_std_s": Number(0.0, 1e6, "s"),
    **CALIBRATION,
}
KEYS = ("id", "kind", "channels", *NUMBERS, "navigation")
WAVE_GUIDES = (2_000.0, 2.9e8)
"""Speeds between these, m/s, belong neither to sound in a fluid nor to light."""


@dataclass(frozen=True, kw_only=True)
class DeployedSensor:
    """A sensor of a deployment, and the patterns of its recordings."""

    sensor: Sensor
    files: tuple[str, ...]


def find_sensor(recording: Path, sensor_file: Path | None = None) -> Sensor | None:
    """Return the sensor of a recording, None if nothing says what it is.

    Parameters
    ----------
    recording
        The recording.
    sensor_file
        A sensor or deployment file; without it, `NAME.sensor.toml` beside the
        recording is taken, if there is one.

    Raises
    ------
    DataError
        The file is wrong, or a deployment names no or several sensors for it.
    """
    if sensor_file is None:
        sensor_file = recording.with_name(f"{recording.stem}.sensor.toml")
        if not sensor_file.exists():
            return None
    deployed = load_deployment(sensor_file)
    if len(deployed) == 1 and not deployed[0].files:
        return deployed[0].sensor
    matching = [d.sensor for d in deployed if _matches(recording, d.files)]
    if len(matching) != 1:
        ids = ", ".join(repr(s.id) for s in matching) or "none"
        msg = (
            f"{sensor_file}: exactly one sensor must claim {recording.name} with its "
            f"`files` patterns, found {ids}."
        )
        raise DataError(msg)
    return matching[0]


def load_sensor(path: Path | str) -> Sensor:
    """Read a sensor file.

    Raises
    ------
    DataError
        The file is wrong, or is a deployment of several sensors.
    """
    deployed = load_deployment(Path(path))
    if len(deployed) != 1:
        msg = f"{path} describes {len(deployed)} sensors; a single one is needed here."
        raise DataError(msg)
    return deployed[0].sensor


def load_deployment(path: Path | str) -> list[DeployedSensor]:
    """Read a deployment file, or a sensor file as a deployment of one.

    Raises
    ------
    DataError
        Missing file, unknown key, wrong type or range, or an id used twice.
    """
    path = Path(path)
    content = read_toml(path)
    if "sensor" not in content:
        return [DeployedSensor(sensor=_sensor(content, path, str(path)), files=())]
    check_keys(content, ("sensor",), str(path))
    tables = content["sensor"]
    is_list = isinstance(tables, list) and all(isinstance(t, dict) for t in tables)
    if not is_list or not tables:
        msg = f"{path}: sensors are given as one [[sensor]] table each."
        raise DataError(msg)
    deployed = [_deployed(t, path, i) for i, t in enumerate(tables, 1)]
    ids = [d.sensor.id for d in deployed]
    for identifier in ids:
        if ids.count(identifier) > 1:
            msg = f"{path}: the id {identifier!r} is given to {ids.count(identifier)}"
            msg += " sensors; each needs its own."
            raise DataError(msg)
    return deployed


def _deployed(table: dict[str, Any], path: Path, index: int) -> DeployedSensor:
    where = f"{path}, sensor {index}"
    if "files" not in table:
        msg = f"{where}: `files` is missing: the pattern of its recordings."
        raise DataError(msg)
    facts = {key: value for key, value in table.items() if key != "files"}
    return DeployedSensor(
        sensor=_sensor(facts, path, where), files=tuple(texts(table, "files", where))
    )


def _sensor(table: Mapping[str, Any], path: Path, where: str) -> Sensor:
    check_keys(table, KEYS, where)
    if "id" not in table:
        msg = f'{where}: `id` is missing, such as id = "h1".'
        raise DataError(msg)
    facts: dict[str, Any] = {
        key: number(table, key, spec, where)
        for key, spec in NUMBERS.items()
        if key in table
    }
    _check_position(facts, where)
    check_calibration(facts, where)
    _check_speed(facts, where)
    kind = text(table, "kind", where) if "kind" in table else "omni"
    navigation = _navigation(table, path, where)
    channels = _channels(table, kind, where)
    turning = "x" in channels and "heading_deg" not in facts
    if turning and navigation is None:
        msg = f'{where}: channels "x" and "y" turn with the housing: give heading_deg.'
        raise DataError(msg)
    return Sensor(
        id=text(table, "id", where),
        kind=kind,
        channels=",".join(channels),
        navigation=navigation,
        **facts,
    )


def _check_position(facts: Mapping[str, float], where: str) -> None:
    for pair in (("latitude", "longitude"), ("east_m", "north_m")):
        given = [key for key in pair if key in facts]
        if len(given) == 1:
            missing = next(key for key in pair if key not in facts)
            msg = f"{where}: {given[0]} is given without {missing}."
            raise DataError(msg)
    if "latitude" in facts and "east_m" in facts:
        msg = f"{where}: give latitude and longitude, or east_m and north_m, not both."
        raise DataError(msg)


def _check_speed(facts: Mapping[str, float], where: str) -> None:
    speed = facts.get("sound_speed_mps", 0.0)
    if WAVE_GUIDES[0] < speed < WAVE_GUIDES[1]:
        msg = (
            f"{where}: sound_speed_mps = {speed:g} is faster than sound in water or "
            f"air and slower than light; 4900 ft/s are 1500 m/s."
        )
        warn(msg, UwtrackWarning, stacklevel=4)


def _channels(table: Mapping[str, Any], kind: str, where: str) -> list[str]:
    if kind not in {"omni", "difar"}:
        msg = f"{where}: kind must be 'omni' or 'difar', got {kind!r}."
        raise DataError(msg)
    if "channels" not in table:
        if kind == "omni":
            return ["omni"]
        msg = f'{where}: a difar sensor needs channels = ["omni", "east", "north"].'
        raise DataError(msg)
    names = texts(table, "channels", where)
    used = sorted(name for name in names if name != "-")
    accepted = [["omni"]] if kind == "omni" else [
        ["east", "north", "omni"], ["omni", "x", "y"],
    ]  # fmt: skip
    if used not in accepted:
        wanted = '"omni" once' if kind == "omni" else (
            '"omni", "east", "north" or "omni", "x", "y", each once'
        )  # fmt: skip
        msg = (
            f"{where}: channels of a {kind} sensor must be {wanted} in file order, "
            f'with "-" for one to leave out, got {names}.'
        )
        raise DataError(msg)
    return names


def _navigation(table: Mapping[str, Any], path: Path, where: str) -> Navigation | None:
    if "navigation" not in table:
        return None
    return read_navigation(path.parent / text(table, "navigation", where))


def _matches(recording: Path, patterns: tuple[str, ...]) -> bool:
    """Tell whether a name, or the path's end, matches one of the patterns."""
    places = ["/".join(recording.parts[i:]) for i in range(len(recording.parts))]
    return any(fnmatchcase(place, p) for p in patterns for place in places)
