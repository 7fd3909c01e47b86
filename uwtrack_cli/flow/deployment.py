"""What a folder of results says of a deployment: when it listened, what it heard.

**Conventions.** Times are ns since 1970-01-01 UTC; recordings whose start is not known
are counted, and have no place on a calendar.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.decidecades import Decidecades
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.presence import OF_VESSELS, Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import UwtrackError
from uwtrack_cli.files.hdf5.product import Product, read_product
from uwtrack_cli.flow.long_term import HourLevel, hour_levels
from uwtrack_cli.flow.passages import PassageRow, PassageTable, find_results
from uwtrack_cli.flow.sound_hours import SoundSpan

Span = tuple[int, int]

GLANCED: tuple[type[Container], ...] = (Recording, Overview, Encounters)
"""What the small picture of a passage is drawn of."""


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
    """Begins and ends of the segments in which a vessel may have been heard."""
    hours: tuple[HourLevel, ...] = ()
    """Its levels by the hour."""


@dataclass
class Deployment:
    """Everything that a folder says, in the order of time."""

    listened: list[Listened] = field(default_factory=list)
    """Recordings, each once."""
    passages: list[PassageRow] = field(default_factory=list)
    """Passages."""
    sound: list[SoundSpan] = field(default_factory=list)
    """Its sound, each moment of a sensor once."""
    held: dict[str, list[Container]] = field(default_factory=dict)
    """What a small picture needs of the products of the first passages, by their path."""
    problems: list[str] = field(default_factory=list)
    """Products that could not be read, and what is unclear, in words."""


def read_deployment(sources: Sequence[Path], table: PassageTable, glanced: int = 0) -> Deployment:
    """Read what results say of a deployment.

    ``table``: their passages, as `collect_passages` gives them. ``glanced``: passages
    from whose products encounters and overviews are held.

    Raises
    ------
    DataError
        A source does not exist, or a folder holds no product.
    """
    known: dict[tuple[str, str, int], Listened] = {}
    held: dict[str, list[Container]] = {}
    wanted = {Path(row.file).resolve() for row in table.passages[:glanced]}
    for path in find_results(sources):
        try:
            with read_product(path) as product:
                if path.resolve() in wanted:
                    held[str(path.resolve())] = [
                        one for kind in GLANCED for one in product.read_all(kind)
                    ]
                for key, listened in _listened(product):
                    before = known.get(key)
                    if before is None or len(before.heard_ns) < len(listened.heard_ns):
                        known[key] = listened
        except UwtrackError:
            continue  # the table has named it
    order = sorted(known.values(), key=lambda r: (r.span_ns or (0, 0), r.sensor, r.name))
    return Deployment(order, table.passages, table.sound, held, table.problems)


def _listened(product: Product) -> "list[tuple[tuple[str, str, int], Listened]]":
    presence, levels = product.read_all(Presence), product.read_all(Decidecades)
    found = []
    for recording in product.read_all(Recording):
        sensor, start = recording.sensor.id, recording.start_utc_ns
        heard = {
            (int(begin), int(end))
            for segments in presence
            for begin, end, kind, owner in zip(
                segments.from_utc_ns, segments.to_utc_ns, segments.kind,
                segments.sensor, strict=True,
            )
            if owner == sensor and kind in OF_VESSELS and begin >= 0
        }  # fmt: skip
        span = None
        if start is not None:
            span = (start, start + round(recording.duration_s * NANOSECONDS))
        key = (recording.digest or recording.name, sensor, recording.first_sample)
        hours = [h for one in levels if one.sensor == sensor for h in hour_levels(one)]
        listened = Listened(recording.name, sensor, span, tuple(sorted(heard)), tuple(hours))
        found.append((key, listened))
    return found
