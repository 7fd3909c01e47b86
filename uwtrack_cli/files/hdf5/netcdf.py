"""Small containers as one NetCDF-4 file after the CF conventions.

**Method.** NetCDF-4 is HDF5 with dimension scales, so h5py writes it. Every column is
a variable ``CONTAINER_COLUMN`` (of a sensor: ``SENSOR_CONTAINER_COLUMN``, of a step
with a name of its own: ``SENSOR_STEP_CONTAINER_COLUMN``) on the dimensions of its
container; single values are attributes of a scalar variable. What lies on a grid has
the coordinates ``time`` and ``frequency``; a second grid in one file has its container's
name before them, ``CONTAINER_time``.

**Conventions.** Times have units "seconds since" the start of the recording where
that is known. What is not known is nan, which is also the fill value.

**References.** CF Metadata Conventions 1.11 (2023); NetCDF-4 user's guide, "NetCDF-4
format" (Unidata).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from uwtrack_cli.data.base import Column, Container, FloatArray
from uwtrack_cli.files.hdf5.layout import DIMENSION_ONLY, safe_name, sensor_of
from uwtrack_cli.files.utc import format_utc

STANDARD_NAMES = {
    "latitude": "latitude", "longitude": "longitude", "time_s": "time",
    "speed_mps": "platform_speed_wrt_ground", "course_deg": "platform_course",
}  # fmt: skip
UNITS = {"latitude": "degrees_north", "longitude": "degrees_east", "m/s": "m s-1",
         "m^2": "m2", "Hz/s": "Hz s-1", "degree/s": "degree s-1"}  # fmt: skip


def write_netcdf(
    path: Path, containers: Sequence[tuple[Container, str]], history: Sequence[str]
) -> None:
    """Write containers as a NetCDF file.

    ``path``: file to write; it is replaced. ``containers``: what it shall hold, each
    with the name of the step that made it, empty for the usual one. ``history``: what
    was done, one line per step.
    """
    start_ns = _start_ns([container for container, _ in containers])
    with path.open("w+b") as raw, h5py.File(raw, "w", libver=("v110", "v110")) as file:
        file.attrs["Conventions"] = "CF-1.11"
        file.attrs["title"] = "Vessels found in hydrophone recordings"
        file.attrs["source"] = "uwtrack"
        file.attrs["history"] = "\n".join(history)
        for container, step in sorted(containers, key=lambda one: _is_second(one[0])):
            _write(file, container, step, start_ns)


def _start_ns(containers: Sequence[Container]) -> int | None:
    """Return UTC of the earliest time zero: that of the fixes and encounters."""
    starts = [_time_zero_ns(container) for container in containers]
    return min((start for start in starts if start is not None), default=None)


def _time_zero_ns(container: Container) -> int | None:
    """Return UTC of a container's time zero; files that were joined have many."""
    if "start_utc_ns" not in container.scalars():
        return None
    return getattr(container, "start_utc_ns", None)


def _is_second(container: Container) -> bool:
    """Tell whether a container comes after the picture, whose grid is the file's."""
    return container.NAME != "overview"


def _write(file: h5py.File, container: Container, step: str, start_ns: int | None) -> None:
    owners = [safe_name(n) for n in (sensor_of(container), step) if n]
    name = "_".join([*owners, container.NAME])
    own_ns = _own_start_ns(container, start_ns)
    scales = _scales(file, container, name, own_ns)
    for column, spec in container.columns().items():
        values = getattr(container, column)
        if values is not None:
            dataset = _variable(file, f"{name}_{column}", values)
            for position, axis in enumerate(spec.axes):
                dataset.dims[position].attach_scale(scales[axis])
            _describe(dataset, column, spec, own_ns)
    facts = file.create_dataset(name, data=np.int8(0))
    facts.attrs["long_name"] = f"Single values of {container.NAME}, as attributes."
    for key in container.scalars():
        value = getattr(container, key)
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            facts.attrs[key] = value


def _grid(container: Container) -> dict[str, tuple[str, FloatArray]]:
    """Return the axes of a grid, each with its kind and the values along it."""
    found: dict[str, tuple[str, FloatArray]] = {}
    frames = getattr(container, "frames", None)
    if frames is not None and container.sizes().get("frame"):
        found["frame"] = "time", frames.time_s
    for column, kind in (("time_s", "time"), ("frequency_hz", "frequency")):
        spec = container.columns().get(column)
        values = getattr(container, column, None)
        if spec is None or values is None or not _is_grid(container, spec.axes[0]):
            continue
        if values.size and np.all(np.diff(values) > 0.0):
            found[spec.axes[0]] = kind, values
    return found


def _is_grid(container: Container, axis: str) -> bool:
    """Tell whether a matrix of the container lies on an axis."""
    matrices = [s.axes for s in container.columns().values() if len(s.axes) == 2]
    return any(axis in axes and axes[0] != axes[1] for axes in matrices)


def _coordinate(
    file: h5py.File, owner: str, kind: str, values: FloatArray, start_ns: int | None
) -> Any:
    """Return the scale of a coordinate; one with the same values is used again."""
    name = kind
    if name in file:
        units = _units_of(kind, start_ns)
        same = file[name].shape == values.shape and np.array_equal(file[name], values)
        if same and file[name].attrs["units"] == units:
            return file[name]
        name = f"{owner}_{kind}"
    scale = file.create_dataset(name, data=values)
    scale.make_scale(name)
    scale.attrs["units"] = _units_of(kind, start_ns)
    scale.attrs["standard_name"] = {"frequency": "sound_frequency"}.get(kind, kind)
    if kind == "time":
        scale.attrs.update({"axis": "T", "calendar": "standard"})
    return scale


def _units_of(kind: str, start_ns: int | None) -> str:
    if kind == "frequency":
        return "Hz"
    if start_ns is None:
        return "s"
    return f"seconds since {format_utc(start_ns)[:-1].replace('T', ' ')}"


def _scales(
    file: h5py.File, container: Container, name: str, start_ns: int | None
) -> dict[str, Any]:
    """Return the dimension of every axis: a coordinate, or a number of rows."""
    scales: dict[str, Any] = {
        axis: _coordinate(file, name, kind, values, start_ns)
        for axis, (kind, values) in _grid(container).items()
    }
    for axis, size in container.sizes().items():
        if axis not in scales:
            dimension = f"{axis}_row"
            if dimension in container.columns():  # a column has this name already
                dimension = f"{axis}_rows"
            scales[axis] = _scale(file, f"{name}_{dimension}", size)
    return scales


def _own_start_ns(container: Container, start_ns: int | None) -> int | None:
    frames = getattr(container, "frames", None)
    own = _time_zero_ns(frames if frames is not None else container)
    return start_ns if own is None else own


def _scale(file: h5py.File, name: str, size: int) -> Any:
    scale = file.create_dataset(name, shape=(size,), dtype=">f4")
    scale.make_scale(f"{DIMENSION_ONLY}{size:10d}")
    return scale


def _variable(file: h5py.File, name: str, values: Any) -> Any:
    if values.dtype.kind == "U":
        return file.create_dataset(
            name, data=values.astype(object), dtype=h5py.string_dtype("utf-8")
        )
    if values.dtype.kind == "b":
        values = values.astype(np.int8)
    dataset = file.create_dataset(name, data=values)
    if values.dtype.kind == "f":
        dataset.attrs["_FillValue"] = np.array([np.nan], values.dtype)
    return dataset


def _describe(dataset: Any, column: str, spec: Column, start_ns: int | None) -> None:
    units = UNITS.get(column) or UNITS.get(spec.unit, spec.unit)
    if column == "time_s" and start_ns is not None:
        units = _units_of("time", start_ns)
        dataset.attrs["calendar"] = "standard"
    if column.endswith("_utc_ns"):
        units = ""  # a plain number: -1 is unknown
    dataset.attrs["long_name"] = spec.description
    if units and units != "1":
        dataset.attrs["units"] = units
    if column in STANDARD_NAMES:
        dataset.attrs["standard_name"] = STANDARD_NAMES[column]
    if column == "latitude":
        stem = dataset.name.removeprefix("/").removesuffix("latitude")
        dataset.attrs["coordinates"] = f"{stem}time_s {stem}longitude"
