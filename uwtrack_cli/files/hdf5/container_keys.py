"""Which container is meant: by its kind, its sensor and the step that made it.

**Conventions.** Where only one container of a kind is held, sensor and step need not be
named. A step of its stage's own name needs no naming either.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection
from typing import NamedTuple, TypeVar, overload

from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.layout import container_class

C = TypeVar("C", bound=Container)


class ContainerKey(NamedTuple):
    """Which container of a product is meant."""

    sensor: str | None
    """Identifier of its sensor; None for a container of the whole file."""
    name: str
    """Name of the container."""
    step: str = ""
    """Name of the step that made it, where that is not the name of its stage."""


def sole_key(
    keys: Collection[ContainerKey],
    kind: type[Container],
    sensor: str | None,
    step: str | None,
    owner: str,
) -> ContainerKey:
    """Return which container is meant by a kind, and a sensor and a step if given.

    Raises
    ------
    DataError
        There is none, or several.
    """
    found = [
        key
        for key in keys
        if key.name == kind.NAME and sensor in (None, key.sensor) and step in (None, key.step)
    ]
    usual = [key for key in found if not key.step]
    for chosen in (found, usual):  # a step of its stage's name needs no naming
        if len(chosen) == 1:
            return chosen[0]
    if found:
        sensors = ", ".join(sorted({repr(key.sensor) for key in found}))
        steps = ", ".join(sorted({repr(key.step or kind.NAME) for key in found}))
        several = "sensors" if len({key.sensor for key in found}) > 1 else "steps"
        named = sensors if several == "sensors" else steps
        raise DataError(f"{owner} holds {kind.NAME} of several {several}: {named}.")
    of = "" if sensor is None else f" of sensor {sensor!r}"
    of += f" of step {step!r}" if step else ""
    held = ", ".join(sorted({key.name for key in keys})) or "nothing"
    raise DataError(f"{owner} holds no {kind.NAME}{of}; it holds: {held}.")


class ContainerHolder(ABC):
    """What gives containers by kind, sensor and step: a file, or what was read of one."""

    name: str
    """What holds them, for messages."""

    @abstractmethod
    def _held(self) -> Collection[ContainerKey]:
        """Return the keys of what is held."""

    @abstractmethod
    def _container(self, key: ContainerKey) -> Container:
        """Return the container of a key."""

    @overload
    def read(self, kind: type[C], sensor: str | None = None, step: str | None = None) -> C: ...

    @overload
    def read(self, kind: str, sensor: str | None = None, step: str | None = None) -> Container: ...

    def read(
        self, kind: type[Container] | str, sensor: str | None = None, step: str | None = None
    ) -> Container:
        """Return a container.

        ``kind``: its class, such as `Lines`, or its name, such as ``"lines"``.
        ``sensor``: its sensor; not needed where only one has such a container.
        ``step``: the step that made it, empty for the usual one; not needed where only
        one step made such a container.

        Raises
        ------
        DataError
            There is none, or several and no sensor or step is named, or no container
            has such a name; in a file it may be damaged.
        """
        wanted = container_class(kind) if isinstance(kind, str) else kind
        key = sole_key(self._held(), wanted, sensor, step, self.name)
        return self._container(key)
