"""A stored container read back as blocks of frames, as the stages take them.

**Conventions.** A block holds so many frames and the rows that refer to them: rows
with a column ``frame`` are stored in its order. `Container.join` of the blocks is
what `Product.read` gives, bit for bit.
"""

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import replace

import h5py
import numpy as np

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.checks import attribute
from uwtrack_cli.files.reading import (
    C,
    column_dataset,
    container_group,
    part_path,
    read_group,
)
from uwtrack_cli.files.registry import CONTAINERS, part_classes

INDEXED_AXES: dict[str, tuple[tuple[str, str], ...]] = {
    "spectrogram": (),
    "levels": (),
    "peaks": (("peaks", "peak"),),
    "families": (("peaks", "peak"), ("families", "family")),
}
"""Containers that can be streamed, with the axes whose rows name their frame."""


def stream_group(
    file: h5py.File, path: str, kind: type[C], block_rows: int
) -> Iterator[C]:
    """Yield a container in blocks of frames.

    Raises
    ------
    OptionError
        A block of no frames.
    DataError
        The container does not follow frames, or its rows are not in their order.
    """
    if block_rows < 1:
        msg = f"a block must have at least 1 frame, got {block_rows}."
        raise OptionError(msg)
    paths = _paths(file, path, kind)
    if kind.NAME not in INDEXED_AXES or "frames" not in paths:
        msg = f"{kind.NAME} cannot be read in blocks of frames"
        raise DataError(msg)
    frames = container_group(file, paths["frames"], Frames)
    n_frames = column_dataset(frames, "time_s", Frames.columns()["time_s"]).shape[0]
    first = int(attribute(frames, "first_frame"))
    begins = dict.fromkeys(INDEXED_AXES[kind.NAME], 0)
    for start in range(0, max(1, n_frames), block_rows):
        stop = min(start + block_rows, n_frames)
        rows: dict[tuple[str, str], slice] = {
            (name, "frame"): slice(start, stop) for name in CONTAINERS
        }
        for name, axis in begins:
            group = container_group(file, paths[name], CONTAINERS[name])
            begin = begins[name, axis]
            column = column_dataset(group, "frame", CONTAINERS[name].columns()["frame"])
            last = stop == n_frames
            end = (
                column.shape[0] if last else bisect_left(column, first + stop, lo=begin)
            )
            _check_order(column[begin:end], first + start, first + stop, column.name)
            begins[name, axis] = end
            rows[name, axis] = slice(begin, end)
        if ("peaks", "peak") in rows:  # families hold a column of their peaks
            rows["families", "peak"] = rows["peaks", "peak"]
        yield _numbered(read_group(file, path, kind, rows), first + start)


def _paths(file: h5py.File, path: str, kind: type[Container]) -> dict[str, str]:
    """Return the groups of a container and its parts, by name."""
    found = {kind.NAME: path}
    group = container_group(file, path, kind)
    for name, part in part_classes(kind).items():
        target = part_path(group, name)
        if target is not None:
            found |= _paths(file, target, part)
    return found


def _check_order(frame: object, first: int, stop: int, name: str) -> None:
    rows = np.asarray(frame)
    if rows.size and (rows[0] < first or rows[-1] >= stop or np.any(np.diff(rows) < 0)):
        msg = f"{name} is not in the order of the frames"
        raise DataError(msg)


def _numbered(block: C, first_frame: int) -> C:
    """Return a block whose frames know the index of their first row."""
    changes: dict[str, object] = {}
    for name in part_classes(type(block)):
        part = getattr(block, name)
        if isinstance(part, Frames):
            changes[name] = replace(part, first_frame=first_frame)
        elif part is not None:
            changes[name] = _numbered(part, first_frame)
    return replace(block, **changes)
