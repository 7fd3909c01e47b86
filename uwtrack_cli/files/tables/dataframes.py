"""Containers as the tables of others: a pandas frame, an xarray dataset.

**Conventions.** pandas and xarray come with the extra ``export``. Names, units and
meanings are those of the containers. Where the start of the recording is known, times
are given as UTC, too: in a frame as a column, in a dataset as the coordinate ``time``.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.data.decidecades import Decidecades
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import needing
from uwtrack_cli.files.tables.json_rows import OBJECTS, facts, json_rows, object_keys

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Columns = dict[str, tuple[Column, NDArray[Any]]]

FRAME = "frame"
"""Axis of the frames, and the column that says to which frame a row belongs."""


def to_pandas(container: Container, start_utc_ns: int | None = None) -> "pd.DataFrame":
    """Return the rows of a container's main axis as a pandas frame.

    Parameters
    ----------
    container
        What is turned into a table. Encounters, fixes, motions and presence have the
        keys of their JSON output; others have their columns, a matrix one column for
        each of its elements.
    start_utc_ns
        Time of the first sample, ns since 1970-01-01 UTC, for containers that do not
        carry it.

    Returns
    -------
    pandas.DataFrame
        One row per row of the main axis; times as ``datetime64`` in UTC where the
        start is known.

    Raises
    ------
    DataError
        pandas is not installed.
    """
    with needing("this needs pandas", "export"):
        import pandas as pd
    if container.NAME in OBJECTS:
        names = object_keys(type(container))
        frame = pd.DataFrame(json_rows(container), columns=names)
        for name in names:
            if name.endswith("_utc"):
                frame[name] = pd.to_datetime(frame[name], utc=True, format="ISO8601")
        return frame
    if not container.columns():
        return pd.DataFrame([facts(container)])
    table = _table(container)
    start_ns = _start_ns(container, start_utc_ns)
    if start_ns is not None and "time_s" in table:
        utc = pd.to_datetime(_utc(table["time_s"], start_ns), utc=True)
        table = {"time_utc": utc, **table}
    return pd.DataFrame(table)


def to_xarray(container: Container, start_utc_ns: int | None = None) -> "xr.Dataset":
    """Return a container as an xarray dataset.

    Parameters
    ----------
    container
        What is turned into a dataset; its frames come with it, other parts do not.
    start_utc_ns
        Time of the first sample, ns since 1970-01-01 UTC, for containers that do not
        carry it.

    Returns
    -------
    xarray.Dataset
        Variables with ``units`` and ``long_name``. Frames lie along the dimension
        ``time``, bins along ``frequency``, both with coordinates: ``datetime64`` where
        the start is known and seconds from the first sample where not; Hz. Rows of
        decidecades lie along ``time``, too. Other axes keep their names, with the time
        of their rows, and what a fixed axis like ``band`` stands for, as coordinates.

    Raises
    ------
    DataError
        xarray is not installed.
    """
    with needing("this needs xarray", "export"):
        import xarray as xr
    columns = _columns(container)
    start_ns = _start_ns(container, start_utc_ns)
    dimensions = _dimensions(container, columns)
    coordinates: dict[str, Any] = {}
    variables: dict[str, Any] = {}
    for name, (spec, values) in columns.items():
        axes = tuple(dimensions.get(axis, axis) for axis in spec.axes)
        told = {"units": spec.unit, "long_name": spec.description}
        if name == "time_s" and start_ns is not None:
            utc = {"long_name": f"{spec.description[:-1]}, as UTC."}
            coordinates["time"] = (axes, _utc(values, start_ns), utc)
            variables[name] = (axes, values, told)
        elif name == "time_s":
            coordinates["time"] = (axes, values, told)
        elif name == "frequency_hz" and spec.axes[0] in container.FIXED_AXES:
            coordinates["frequency"] = (axes, values, told)
        elif spec.axes[0] in container.FIXED_AXES and len(spec.axes) == 1:
            coordinates[name] = (axes, values, told)
        else:
            variables[name] = (axes, values, told)
    known = {k: v for k, v in facts(container).items() if v is not None}
    return xr.Dataset(variables, coordinates, known)


def _frames(container: Container) -> Frames | None:
    """Return the frames that a container's rows refer to."""
    part = getattr(container, "frames", None)
    if part is None and hasattr(container, "peaks"):  # families have those of the peaks
        part = getattr(container.peaks, "frames", None)
    return part if isinstance(part, Frames) else None


def _columns(container: Container) -> Columns:
    """Return all columns that have values, those of the frames that are its rows first."""
    own = container.columns()
    has_frames = "frames" in container.parts()
    is_framed = has_frames and any(FRAME in spec.axes for spec in own.values())
    owners = [_frames(container), container] if is_framed else [container]
    return {
        name: (spec, getattr(owner, name))
        for owner in owners
        if owner is not None
        for name, spec in owner.columns().items()
        if getattr(owner, name) is not None
    }


def _table(container: Container) -> dict[str, Any]:
    """Return the columns of the main axis, with the times of the rows' frames."""
    columns = _columns(container)
    axis = container.ROW
    table: dict[str, Any] = {}
    for name, (spec, values) in columns.items():
        if spec.axes[0] == axis:
            table |= dict(_elements(name, values))
    frames = _frames(container)
    if frames is not None and "time_s" not in table and FRAME in table:
        table["time_s"] = frames.time_s[table[FRAME] - frames.first_frame]
    return table


def _dimensions(container: Container, columns: Columns) -> dict[str, str]:
    """Return the names of the dimensions that are not called as their axes.

    Grids are along time and frequency; an axis with the name of a column that does not
    lie on it gets another one.
    """
    axes = {axis for spec, _ in columns.values() for axis in spec.axes}
    names = {
        axis: f"{axis}_row" for axis in axes & set(columns) if columns[axis][0].axes != (axis,)
    }
    if "time_s" in columns and columns["time_s"][0].axes[0] in _time_axes(container):
        names[columns["time_s"][0].axes[0]] = "time"
    if "frequency_hz" in columns:
        axis = columns["frequency_hz"][0].axes[0]
        names |= {axis: "frequency"} if axis in container.FIXED_AXES else {}
    return names


def _time_axes(container: Container) -> tuple[str, ...]:
    has_rows = isinstance(container, Overview | Decidecades)
    return (FRAME, "row") if has_rows else (FRAME,)


def _elements(name: str, values: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the columns of a table that a column of any rank becomes."""
    for index in np.ndindex(values.shape[1:]):
        yield "_".join([name, *map(str, index)]), values[(slice(None), *index)]


def _start_ns(container: Container, given: int | None) -> int | None:
    for owner in (container, _frames(container)):
        own = getattr(owner, "start_utc_ns", None)
        if isinstance(own, int):
            return own
    return given


def _utc(time_s: NDArray[Any], start_ns: int) -> NDArray[np.datetime64]:
    """Return times as datetime64; a time that is not known is NaT."""
    known = np.isfinite(time_s)
    since_ns = np.round(np.where(known, time_s, 0.0) * NANOSECONDS).astype(np.int64)
    utc = (start_ns + since_ns).astype("datetime64[ns]")
    utc[~known] = np.datetime64("NaT")
    return utc
