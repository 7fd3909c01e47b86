"""Truth files: what a simulation says that happened (``NAME.truth.json``)."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from uwtrack_cli.data.truth import TruePassage, Truth, VesselTrack
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.utc import parse_utc

FORMAT = "uwtrack-truth"
VERSION = 1
MAX_BYTES = 1 << 28
QUANTITIES = (
    "time_s", "arrival_time_s", "speed_mps", "slant_range_m", "horizontal_range_m",
    "range_over_speed_s", "course_deg", "bearing_deg",
)  # fmt: skip


def read_truth(path: Path) -> Truth:
    """Read a truth file.

    ``path``: a JSON file as `uwtrack simulate` writes it beside a recording.

    Raises
    ------
    DataError
        The file is missing, no truth file, too new, or contradicts itself.
    """
    check_readable(path)
    if path.stat().st_size > MAX_BYTES:
        raise DataError(f"{path} is larger than {MAX_BYTES >> 20} MB, and no truth file.")
    try:
        return _truth(path.name, _content(path))
    except DataError:
        raise
    except (ValueError, TypeError, KeyError, AttributeError,
            RecursionError, OverflowError) as error:  # fmt: skip
        reason = f"{type(error).__name__}: {error}"
        raise DataError(
            f"{path} is no readable truth file ({reason}); simulate it again."
        ) from error


def _content(path: Path) -> dict[str, Any]:
    content = json.loads(as_input(path).read_text(encoding="utf-8"))
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise DataError(f"{path} is no truth file: its format must be {FORMAT!r}.")
    if content.get("version") != VERSION:
        raise DataError(f"{path} has version {content.get('version')}, accepted is {VERSION}.")
    return content


def _truth(name: str, content: dict[str, Any]) -> Truth:
    start = content.get("start_utc")
    names = {row["vessel"]: _label(row) for row in content["vessels"]}
    return Truth(
        name=name,
        start_utc_ns=None if start is None else parse_utc(start),
        is_geographic=False,
        tracks=tuple(_track(row) for row in content["vessels"]),
        passages=tuple(_passage(row, names) for row in content["encounters"]),
        origin=_origin(content["sensors"]),
        sensor_places={
            str(row["id"]): (float(row["east_m"]), float(row["north_m"]))
            for row in content["sensors"]
            if row["east_m"] is not None and row["north_m"] is not None
        },
    )


def _label(row: dict[str, Any]) -> str:
    return f"{row['name']} ({row['vessel']})" if row.get("name") else str(row["vessel"])


def _track(row: dict[str, Any]) -> VesselTrack:
    track = row["track"]
    time_s, east, north, east_rate, north_rate = (
        np.asarray(track[key], float)
        for key in ("time_s", "east_m", "north_m", "velocity_east_mps", "velocity_north_mps")
    )
    if not time_s.shape == east.shape == north.shape == east_rate.shape:
        raise DataError(f"the track of vessel {row['vessel']} has columns of different length.")
    return VesselTrack(
        vessel=_label(row),
        time_s=time_s,
        first=east,
        second=north,
        speed_mps=np.hypot(east_rate, north_rate),
        course_deg=np.degrees(np.arctan2(east_rate, north_rate)) % 360.0,
    )


def _passage(row: dict[str, Any], names: dict[Any, str]) -> TruePassage:
    return TruePassage(
        vessel=names[row["vessel"]],
        sensor=str(row["sensor"]),
        inside=bool(row["inside"]),
        values={key: float(row[key]) for key in QUANTITIES},
        side=row["side"],
        rest_frequencies_hz=tuple(float(f) for f in row["rest_frequencies_hz"]),
    )


def _origin(sensors: list[dict[str, Any]]) -> tuple[float, float] | None:
    """Return where the grid lies, if a sensor in its origin says so."""
    for row in sensors:
        at_origin = row["east_m"] == 0.0 and row["north_m"] == 0.0
        if at_origin and row["latitude"] is not None:
            return float(row["latitude"]), float(row["longitude"])
    return None
