"""A product while it is being made: containers go in, a sealed HDF5 tree comes out."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

import h5py
import numpy as np

from uwtrack_cli import __version__
from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.digest import data_digest, root_digest, structure_digest
from uwtrack_cli.files.growing import GrowingGroup, make_scale
from uwtrack_cli.files.history import HistoryStep
from uwtrack_cli.files.layout import (
    FORMAT,
    SCHEMA_VERSION,
    encode,
    group_path,
    sensor_of,
)
from uwtrack_cli.files.reading import read_whole
from uwtrack_cli.files.registry import CONTAINERS, part_classes
from uwtrack_cli.files.sharing import Slot, name_parts, share_parts

LIBVER = ("v110", "v110")
"""HDF5 1.10 and later read the files: object headers carry checksums of their own."""


class ProductStore:
    """An open, still incomplete product: takes containers, then is sealed."""

    def __init__(self, file: h5py.File) -> None:
        self.file = file
        self.tops: dict[str, Slot] = {}
        self.whole: set[str] = set()

    def append(self, block: Container) -> None:
        """Add the rows of a block to its container."""
        sensor = sensor_of(block)
        path = group_path(sensor, block.NAME)
        if path in self.whole:
            msg = f"{path} is written already and takes no further blocks."
            raise DataError(msg)
        if path not in self.tops:
            self.tops[path] = self._open(path, block, sensor)
        _append(self.tops[path], block)

    def write(self, container: Container) -> None:
        """Write a container that is complete."""
        sensor = sensor_of(container)
        path = group_path(sensor, container.NAME)
        if path in self.tops:
            where = "" if sensor is None else f" of sensor {sensor!r}"
            msg = (
                f"a file holds one container {container.NAME!r}{where}, got two; "
                f"give the sensors different ids, or write two files."
            )
            raise DataError(msg)
        self.append(container)
        self.whole.add(path)

    def flush(self) -> None:
        """Hand every row that waits to the file."""
        for slot in _walk(self.tops.values()):
            slot.growing.flush()
        self.file.flush()

    def read_back(self) -> list[Container]:
        """Finish without a seal, and read each container as a product's reader does."""
        self.file.attrs["schema_version"] = np.int64(SCHEMA_VERSION)
        for slot in self.tops.values():
            _finish(slot)
            name_parts(slot)
        return [
            read_whole(self.file, path, slot.growing.kind)
            for path, slot in self.tops.items()
        ]

    def seal(self, history: Sequence[HistoryStep]) -> None:
        """Label, share, describe, digest, and mark the file as complete."""
        digests: dict[str, str] = {}
        for slot in self.tops.values():
            _finish(slot)
        share_parts(self.file, self.tops)
        self._name_sensors()
        self._describe(history)
        objects = all_objects(self.file)
        known = self._known_digests()
        for path, item in objects.items():
            if isinstance(item, h5py.Dataset) and not item.is_scale:
                digests[path] = known.get(path) or data_digest(item)
        total = root_digest(structure_digest(objects), digests)
        self.file.attrs["sha256"] = total
        self.file.attrs["complete"] = np.int8(1)

    def _open(self, path: str, block: Container, sensor: str | None) -> Slot:
        kind = CONTAINERS.get(block.NAME)
        if kind is not type(block):
            msg = f"{type(block).__name__} is not a container that files can hold."
            raise DataError(msg)
        slot = Slot(GrowingGroup(self.file.create_group(path), kind), sensor)
        for name in part_classes(kind):
            part = getattr(block, name)
            if part is None:
                slot.absent_parts.add(name)
            else:
                own = sensor_of(part)
                inner = sensor if own is None else own
                slot.parts[name] = self._open(f"{path}/{name}", part, inner)
        return slot

    def _name_sensors(self) -> None:
        for slot in list(_walk(self.tops.values())):
            if slot.sensor is not None:
                owner = self.file["/" + slot.path.split("/")[1]]
                if "container" not in owner.attrs:
                    owner.attrs["sensor"] = slot.sensor

    def _describe(self, history: Sequence[HistoryStep]) -> None:
        root = self.file.attrs
        root["format"] = FORMAT
        root["schema_version"] = np.int64(SCHEMA_VERSION)
        root["program_version"] = __version__
        root["created_utc"] = utc_now()
        steps = encode(np.array([step.to_json() for step in history], dtype=np.str_))
        dataset = self.file.create_dataset(
            "history", data=steps, maxshape=(None,), chunks=(max(1, steps.size),),
            fletcher32=True,
        )  # fmt: skip
        dataset.attrs["units"] = "1"
        dataset.attrs["long_name"] = "What was done, one step per row, as JSON."
        dataset.dims[0].attach_scale(make_scale(self.file, "step", steps.size))

    def _known_digests(self) -> dict[str, str]:
        return {
            f"{slot.path}/{name}": digest
            for slot in _walk(self.tops.values())
            for name, digest in slot.growing.digests().items()
        }


def utc_now() -> str:
    """Return the time of day as it is stored."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def all_objects(file: h5py.File) -> dict[str, Any]:
    """Return every group and dataset of a file that this program wrote."""
    found: dict[str, Any] = {"/": file}

    def keep(name: str, item: Any) -> None:
        found[f"/{name}"] = item

    file.visititems(keep)
    return found


def _append(slot: Slot, block: Container) -> None:
    slot.growing.append(block)
    for name in part_classes(slot.growing.kind):
        part = getattr(block, name)
        if (part is None) != (name in slot.absent_parts):
            msg = f"some blocks of {slot.name} have {name}, others have not."
            raise DataError(msg)
        if part is not None:
            _append(slot.parts[name], part)


def _finish(slot: Slot) -> None:
    slot.growing.finish()
    for part in slot.parts.values():
        _finish(part)


def _walk(slots: Iterable[Slot]) -> Iterator[Slot]:
    for slot in slots:
        yield slot
        yield from _walk(slot.parts.values())
