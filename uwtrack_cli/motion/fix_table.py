"""Motions carried to times, as the table of fixes.

**Conventions.** A state is east, north (m) and their rates (m/s) on the grid of the
sensors. Every row has latitude and longitude where the grid has an origin.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.acoustics.geodesy import Origin, to_latitude_longitude
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Fixes

FixRows = dict[str, NDArray[Any]]
"""Columns of `Fixes` of one mode, shape (time, ...) each."""


def fix_rows(
    state: FloatArray, covariance: FloatArray, time_s: FloatArray, **same: float | str
) -> FixRows:
    """Return place, speed and course of states (time, 4), and what is the same in all."""
    velocity, spread = state[:, 2:], covariance[:, 2:, 2:]
    speed = np.maximum(np.hypot(*velocity.T), 1e-9)
    along = velocity / speed[:, None]
    across = np.stack([along[:, 1], -along[:, 0]], axis=1)
    std, across_std = (
        np.sqrt(np.einsum("ti,tij,tj->t", axis, spread, axis)) for axis in (along, across)
    )
    return {
        "time_s": time_s,
        "east_m": state[:, 0],
        "north_m": state[:, 1],
        "covariance_m2": covariance[:, :2, :2],
        "speed_mps": speed,
        "speed_std_mps": std,
        "course_deg": np.degrees(np.arctan2(*velocity.T)) % 360.0,
        "course_std_deg": np.degrees(across_std / speed),
        **{name: np.repeat(value, time_s.size) for name, value in same.items()},
    }


def fix_table(
    parts: Sequence[FixRows],
    start_utc_ns: int | None,
    grid: tuple[str, Origin | None],
    statement: str,
    **tables: NDArray[Any],
) -> Fixes:
    """Put the rows of all modes one after the other, on a grid of a name and origin.

    ``tables``: columns of other axes.
    """
    name, origin = grid
    columns: dict[str, Any] = {}
    for key, spec in Fixes.columns().items():
        is_there = bool(parts) and all(key in part for part in parts)
        if key not in {"time_utc_ns", "latitude", "longitude"} and (is_there or not spec.optional):
            kind = "U1" if spec.dtype.kind == "U" else spec.dtype
            nothing = np.empty((0, *(2 for _ in spec.axes[1:])), kind)
            columns[key] = np.concatenate([nothing, *(part[key] for part in parts)])
    east, north = columns["east_m"], columns["north_m"]
    latitude = longitude = np.full(east.shape, np.nan)
    if origin is not None:
        latitude, longitude = to_latitude_longitude(east, north, origin)
    return Fixes(
        **columns,
        time_utc_ns=to_utc_ns(columns["time_s"], start_utc_ns),
        latitude=latitude,
        longitude=longitude,
        origin=name,
        origin_latitude=origin.latitude if origin else None,
        origin_longitude=origin.longitude if origin else None,
        statement=statement,
        **tables,
    )


def to_utc_ns(time_s: FloatArray, start_utc_ns: int | None) -> NDArray[np.int64]:
    """Return epochs of times in s, -1 without a start time."""
    if start_utc_ns is None:
        return np.full(time_s.shape, -1, np.int64)
    return start_utc_ns + np.rint(time_s * NANOSECONDS).astype(np.int64)
