"""Every container that a product file may hold, by its name.

A new container is added here and nowhere else: the codec, `uwtrack info`, `show`
and `diff` all work from this list.
"""

from functools import cache
from typing import Any, get_args, get_type_hints

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.contacts import Contacts
from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.scans import Roc, Scans
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Levels, Overview, Spectrogram
from uwtrack_cli.data.targets import Target
from uwtrack_cli.errors import DataError

CONTAINERS: dict[str, type[Container]] = {
    kind.NAME: kind
    for kind in (
        Recording,
        RecordedFiles,
        Sensor,
        Navigation,
        Frames,
        Spectrogram,
        Overview,
        Levels,
        Peaks,
        Families,
        Lines,
        Encounters,
        Fixes,
        Motions,
        Series,
        Contacts,
        Scans,
        Roc,
        Target,
        Decision,
    )
}
"""Container classes by name, in the order of the chain."""

UNSTORED: frozenset[tuple[str, str]] = frozenset({("recording", "reader")})
"""Fields that live in memory only: they read back as None."""


def container_class(name: str) -> type[Container]:
    """Return the container class of a name such as ``"lines"``.

    Raises
    ------
    DataError
        There is no container of that name.
    """
    if name not in CONTAINERS:
        msg = f"there is no container {name!r}; there are: {', '.join(CONTAINERS)}."
        raise DataError(msg)
    return CONTAINERS[name]


def part_classes(kind: type[Container]) -> dict[str, type[Container]]:
    """Return the class of every part of a container, by the name of its field."""
    hints = _hints(kind.NAME)
    return {name: _container_in(hints[name]) for name in kind.parts()}


def scalar_types(kind: type[Container]) -> dict[str, type]:
    """Return the plain type (str, bool, int or float) of every stored scalar."""
    hints = _hints(kind.NAME)
    return {
        name: _plain(hints[name])
        for name in kind.scalars()
        if (kind.NAME, name) not in UNSTORED
    }


@cache
def _hints(name: str) -> dict[str, Any]:
    return get_type_hints(container_class(name))


def _container_in(hint: object) -> type[Container]:
    for choice in (hint, *get_args(hint)):
        if isinstance(choice, type) and issubclass(choice, Container):
            return choice
    msg = f"{hint!r} is neither a column, a scalar nor a container."
    raise TypeError(msg)


def _plain(hint: object) -> type:
    for choice in (hint, *get_args(hint)):
        if choice in {str, bool, int, float} and isinstance(choice, type):
            return choice
    msg = f"a scalar of type {hint!r} cannot be stored."
    raise TypeError(msg)
