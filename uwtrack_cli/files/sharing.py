"""Parts that several containers of a file have in common are stored once.

**Method.** While a file is being written, every container keeps its parts in its
own group. At the end each part moves to its sensor's group, unless another one of
its kind is there: then it is dropped if the two are the same, and otherwise stays
with its owner. Of two `Frames` with one time base that one is kept which knows the
noise, since peaks are sought after the spectrogram has been written.
"""

from dataclasses import dataclass, field

import h5py
import numpy as np

from uwtrack_cli.files.digest import structure_digest
from uwtrack_cli.files.growing import GrowingGroup
from uwtrack_cli.files.layout import group_path

TIME_BASE = ("start_sample", "time_s", "effort")


@dataclass
class Slot:
    """A container being written, with the slots of its parts by field name."""

    growing: GrowingGroup
    sensor: str | None
    parts: dict[str, "Slot"] = field(default_factory=dict)
    absent_parts: set[str] = field(default_factory=set)

    @property
    def name(self) -> str:
        """Name of the container."""
        return self.growing.kind.NAME

    @property
    def path(self) -> str:
        """Path of the container's group at this moment."""
        return str(self.growing.group.name)


def share_parts(file: h5py.File, tops: dict[str, Slot]) -> None:
    """Store equal parts once, and let every owner name the group of its part."""
    shared = dict(tops)
    owned = [edge for slot in tops.values() for edge in _edges(slot)]
    for owner, name in sorted(owned, key=lambda edge: _depth(edge[0].parts[edge[1]])):
        _settle(file, owner, name, shared)
    for slot in {id(slot): slot for slot in shared.values()}.values():
        name_parts(slot)


def _edges(slot: Slot) -> list[tuple[Slot, str]]:
    """Return every owner and the field of its part, below and at a slot."""
    edges = [(slot, name) for name in slot.parts]
    return edges + [edge for part in slot.parts.values() for edge in _edges(part)]


def _depth(slot: Slot) -> int:
    """Return how deep the parts of a slot are nested: the deepest settle first."""
    return max((1 + _depth(part) for part in slot.parts.values()), default=0)


def _settle(file: h5py.File, owner: Slot, name: str, shared: dict[str, Slot]) -> None:
    part = owner.parts[name]
    path = group_path(part.sensor, part.name)
    other = shared.get(path)
    if other is None:
        file.move(part.path, path)
        shared[path] = part
    elif _agree(part, other):
        owner.parts[name] = _keep_fuller(file, part, other)


def _agree(a: Slot, b: Slot) -> bool:
    """Tell whether one of two parts may stand for both."""
    if a.growing.absent != b.growing.absent or a.absent_parts != b.absent_parts:
        return False
    if any(part is not b.parts[name] for name, part in a.parts.items()):
        return False
    mine, yours = a.growing.digests(), b.growing.digests()
    names = TIME_BASE if a.name == "frames" else tuple(mine)
    return all(mine[name] == yours[name] for name in names) and _same_facts(a, b)


def _same_facts(a: Slot, b: Slot) -> bool:
    return structure_digest({"": a.growing.group}) == structure_digest(
        {"": b.growing.group}
    )


def _keep_fuller(file: h5py.File, part: Slot, other: Slot) -> Slot:
    """Drop one of two agreeing parts; what remains stays in the shared place."""
    if _n_known(part) > _n_known(other):
        path = other.path
        del file[path]
        file.move(part.path, path)
        other.growing = part.growing
    else:
        del file[part.path]
    return other


def _n_known(slot: Slot) -> int:
    if slot.name != "frames":
        return 0
    return int(np.isfinite(slot.growing.datasets["threshold_db"][:]).sum())


def name_parts(slot: Slot) -> None:
    """Let a container's group name the groups of its parts."""
    group = slot.growing.group
    for name, part in slot.parts.items():
        group.attrs[name] = part.path
        name_parts(part)
    absent = slot.growing.absent | slot.absent_parts
    group.attrs["absent"] = ",".join(sorted(absent))
