"""What a folder of results says of a deployment: when it listened, what it heard.

**Conventions.** Times are ns since 1970-01-01 UTC; recordings whose start is not known
are counted, and have no place on a calendar.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.presence import OF_VESSELS, Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import UwtrackError
from uwtrack_cli.files.hdf5.product import Product, read_product
from uwtrack_cli.flow.passages import PassageRow, PassageTable, find_results
from uwtrack_cli.flow.sound_hours import SoundSpan

Span = tuple[int, int]


@dataclass(frozen=True)
class Listened:
    """A recording of a deployment."""

    name: str
    """Its file name."""
    sensor: str
    """Identifier of the sensor."""
    span_ns: Span | None
    """Begin and end; None where the start is not known."""
    heard_ns: tuple[Span, ...] = ()
    """Begins and ends of the stretches in which a vessel may have been heard."""


@dataclass
class Deployment:
    """Everything that a folder says, in the order of time."""

    listened: list[Listened] = field(default_factory=list)
    """Recordings, each once."""
    passages: list[PassageRow] = field(default_factory=list)
    """Passages."""
    sound: list[SoundSpan] = field(default_factory=list)
    """Its sound, each moment of a sensor once."""
    problems: list[str] = field(default_factory=list)
    """Products that could not be read, and what is unclear, in words."""


def read_deployment(sources: Sequence[Path], table: PassageTable) -> Deployment:
    """Read what results say of a deployment.

    ``table``: their passages, as `collect_passages` gives them.

    Raises
    ------
    DataError
        A source does not exist, or a folder holds no product.
    """
    known: dict[tuple[str, str, int], Listened] = {}
    for path in find_results(sources):
        try:
            with read_product(path) as product:
                for key, listened in _listened(product):
                    before = known.get(key)
                    if before is None or len(before.heard_ns) < len(listened.heard_ns):
                        known[key] = listened
        except UwtrackError:
            continue  # the table has named it
    order = sorted(
        known.values(), key=lambda r: (r.span_ns or (0, 0), r.sensor, r.name)
    )
    return Deployment(order, table.passages, table.sound, table.problems)


def _listened(
    product: Product,
) -> "list[tuple[tuple[str, str, int], Listened]]":
    presence = product.read_all(Presence)
    found = []
    for recording in product.read_all(Recording):
        sensor, start = recording.sensor.id, recording.start_utc_ns
        heard = {
            (int(begin), int(end))
            for stretches in presence
            for begin, end, kind, owner in zip(
                stretches.from_utc_ns, stretches.to_utc_ns, stretches.kind,
                stretches.sensor, strict=True,
            )
            if owner == sensor and kind in OF_VESSELS and begin >= 0
        }  # fmt: skip
        span = None
        if start is not None:
            span = (start, start + round(recording.duration_s * NANOSECONDS))
        key = (recording.digest or recording.name, sensor, recording.first_sample)
        listened = Listened(recording.name, sensor, span, tuple(sorted(heard)))
        found.append((key, listened))
    return found
