"""What of a product is drawn, and how: the choices that a page is asked for."""

import math
import re
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Container, IntArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, convert
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import MODULATION, Overview
from uwtrack_cli.data.truth import VesselTrack
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.hdf5.layout import sensor_of
from uwtrack_cli.files.utc import parse_utc
from uwtrack_cli.plotting.style import WIDE_IN, Clock, Span

C = TypeVar("C", bound=Container)
O = TypeVar("O", Encounters, Presence)
T = TypeVar("T")

Units = Literal["kn", "m/s"]
SizeIn = Annotated[tuple[float, float], Unit("in"), AtLeast(2), AtMost(60)]
Dpi = Annotated[float, AtLeast(20), AtMost(1200)] | None

DPI = 110
"""Dots per inch of a page that is stored as dots."""

MOST_KEPT = 16
"""Pictures and tables of a scene that are kept for its next page."""

MOST_DOTS = 5e7
"""Dots of a picture at most, which take four bytes each."""

DAYTIME = re.compile(r"\d\d:\d\d(:\d\d(\.\d+)?)?")


@dataclass(frozen=True, kw_only=True)
class View:
    """How pages are drawn; a size or number of dots out of range is an `OptionError`."""

    begin: str | None = None
    """Begin: UTC, time of day or seconds; None is that of what is drawn."""
    end: str | None = None
    """End, in the same form."""
    band_hz: tuple[float, float] | None = None
    """Band, Hz; None is everything."""
    is_log: bool | None = None
    """Whether the frequency axis is logarithmic; None: as the lines lie."""
    has_lines: bool | None = None
    """Whether tracked lines are outlined; None: all but fragments."""
    units: Units = "kn"
    """Unit of every speed."""
    width_in: float = WIDE_IN
    """Width of the page, inches."""
    height_in: float | None = None
    """Height of the page, inches; None is what its panels need."""
    dpi: float | None = None
    """Dots per inch of a page that is stored as dots; None is the usual number."""
    stands_alone: bool = True
    """Whether the page has its title and numbers; else they stand beside it."""

    def __post_init__(self) -> None:
        """Refuse pictures of a size that cannot be drawn."""
        convert("--dpi", Dpi, self.dpi)
        if self.height_in is None:
            return
        size = self.width_in, self.height_in
        convert("--size", SizeIn, size)
        dpi = self.dpi or DPI
        if (dots := size[0] * size[1] * dpi**2) > MOST_DOTS:
            raise OptionError(
                f"--size {size[0]:g} {size[1]:g} with --dpi {dpi:g} makes {dots / 1e6:.0f} "
                f"million dots; {MOST_DOTS / 1e6:.0f} million are accepted."
            )

    @property
    def is_wide(self) -> bool:
        """Whether panels can stand side by side."""
        return self.width_in > 0.7 * WIDE_IN

    @property
    def is_zoomed(self) -> bool:
        """Whether a part of the time is asked for."""
        return self.begin is not None or self.end is not None

    @property
    def ticks(self) -> int:
        """Number of ticks that a time axis has room for."""
        return 8 if self.is_wide else 4

    def span_s(self, usual: Span, clock: Clock) -> Span:
        """Return begin and end of what is drawn, s from the first sample.

        ``usual``: begin and end where none is asked for, s.

        Raises
        ------
        OptionError
            A time cannot be read, or the end does not come after the begin.
        DataError
            A time of day is asked for where none is known.
        """
        low = usual[0] if self.begin is None else to_seconds(self.begin, clock)
        high = usual[1] if self.end is None else to_seconds(self.end, clock)
        if self.is_zoomed and (low >= usual[1] or high <= usual[0]):
            ends = {"from": self.begin, "to": self.end}
            asked = " ".join(f"{word} {end}" for word, end in ends.items() if end)
            known = " to ".join(map(clock.text, usual))
            raise DataError(f"nothing was recorded {asked}; there is sound from {known}.")
        if not low < high:
            raise OptionError(
                f"what is drawn ends at {self.end or f'{high:g} s'}, not after its "
                f"begin, {self.begin or f'{low:g} s'}."
            )
        return low, high


def to_seconds(text: str, clock: Clock) -> float:
    """Return a time as seconds from the first sample.

    ``text``: seconds, a time of day (the first after the start), or a time in UTC.

    Raises
    ------
    OptionError
        The text is none of these.
    DataError
        The start of the recording is not known in UTC.

    Examples
    --------
    >>> to_seconds("00:01", Clock(1515859921862000000)), to_seconds("90", Clock())
    (28138.138, 90.0)
    """
    with suppress(ValueError):
        if np.isfinite(seconds := float(text)):
            return seconds
    is_of_day = DAYTIME.fullmatch(text.strip()) is not None
    try:
        wanted_ns = parse_utc(f"1970-01-01T{text.strip()}Z" if is_of_day else text)
    except DataError as error:
        raise OptionError(
            f"{text!r} is no time: give seconds from the first sample, a time of day "
            f"such as 12:25 or UTC such as 2024-05-01T12:25:00Z."
        ) from error
    if clock.start_utc_ns is None:
        raise DataError(
            f"{text!r} needs the start of the recording in UTC, which is not known: give "
            f"seconds from the first sample, or run again with --start-utc."
        )
    lag_ns = wanted_ns - clock.start_utc_ns
    return (lag_ns % (86_400 * NANOSECONDS) if is_of_day else lag_ns) / NANOSECONDS


@dataclass(frozen=True)
class Scene:
    """What is known of one recording or table, by kind."""

    containers: Sequence[Container]
    """Everything that the page may show."""
    sensor: str | None = None
    """Sensor whose page it is; None for tables."""
    tracks: Sequence[VesselTrack] = field(default=())
    """Tracks of vessels by AIS: s from the first sample, east and north of the sensor, m."""
    view: View = field(default_factory=View)
    """How it is drawn."""
    span_s: Span = (-math.inf, math.inf)
    """Begin and end of what is drawn, s."""
    taken: dict[Any, Any] = field(default_factory=dict, compare=False, repr=False)
    """What was taken of the sound before: pages of several sizes show the same."""

    def shown(self, view: View, span_s: Span) -> "Scene":
        """Return a span of it, s, as a view draws it; what was taken is shared."""
        return replace(self, view=view, span_s=span_s)

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what was made under a key lately, else make it."""
        found: T = self.taken.pop(key) if key in self.taken else make()
        self.taken[key] = found  # the latest stands last
        if len(self.taken) > MOST_KEPT:
            del self.taken[next(iter(self.taken))]
        return found

    def first(self, kind: type[C]) -> C | None:
        """Return the first container of a kind that the sensor owns or shares."""
        return next(iter(self.all(kind)), None)

    def all(self, kind: type[C]) -> list[C]:
        """Return all containers of a kind that the sensor owns or shares."""
        own = (None, self.sensor)
        return [c for c in self.containers if isinstance(c, kind)
                and (self.sensor is None or sensor_of(c) in own)]  # fmt: skip

    def _own(self, kind: type[O]) -> O | None:
        """Return a table of the sensor's rows, which a page asks for once a line."""
        if (found := self.first(kind)) is None or (sensor := self.sensor) is None:
            return found
        return self.once(kind.NAME, lambda: found.of_sensor(sensor))

    @property
    def recording(self) -> Recording | None:
        """Its recording."""
        return self.first(Recording)

    @property
    def sound(self) -> Recording | None:
        """Its recording, where the sound is at hand."""
        found = self.recording
        return None if found is None or found.reader is None else found

    @property
    def overview(self) -> Overview | None:
        """Picture of the sound; where only its envelope has one, that."""
        of_sound = (o for o in self.all(Overview) if o.reference != MODULATION)
        return next(of_sound, self.first(Overview))

    @property
    def envelope(self) -> Overview | None:
        """Picture of the envelope of the sound."""
        return next((o for o in self.all(Overview) if o.reference == MODULATION), None)

    @property
    def encounters(self) -> Encounters | None:
        """Closest approaches to the sensor."""
        return self._own(Encounters)

    def number(self, contact: int) -> int:
        """Return the number of a contact's passage, by time from 1; 0 without one.

        Where closest approaches were not sought, it is that of the contact.
        """
        if self.encounters is None:
            return max(int(contact), 0)
        own = np.flatnonzero(self.encounters.contact == contact)
        return int(own[0]) + 1 if own.size else 0

    @property
    def presence(self) -> Presence | None:
        """What was detected at the sensor."""
        return self._own(Presence)

    @property
    def segments(self) -> IntArray:
        """Rows of what was detected within the span."""
        found, (low, high) = self.presence, self.span_s
        is_near = found is not None and (found.to_s >= low) & (found.from_s <= high)
        return np.flatnonzero(is_near)

    def owner(self, segment: int) -> int:
        """Return the number of the passage that a segment belongs to; 0 for none."""
        found = self.presence
        if found is None or self.encounters is None:
            return 0
        return self.number(found.encounter[segment] or found.contact[segment])

    @property
    def clock(self) -> Clock:
        """The clock of its recording."""
        owners = (getattr(c, "frames", c) for c in self.all(Container))
        starts = [getattr(one, "start_utc_ns", None) for one in (self.recording, *owners)]
        return Clock(next((start for start in starts if start is not None), None))

    @property
    def times_s(self) -> Span | None:
        """Begin and end of everything that was recorded, s from the first sample."""
        own = self.recording
        if own is not None and own.n_samples and not own.is_live:
            return 0.0, own.duration_s
        frames = [getattr(c, "frames", None) or c for c in self.all(Container)]
        known = [getattr(one, "time_s", None) for one in frames]
        found = [np.ravel(t) for t in known if isinstance(t, np.ndarray)]
        times = np.concatenate([np.zeros(0), *found])
        if not np.isfinite(times).any():
            return None
        low, high = float(np.nanmin(times)), float(np.nanmax(times))
        return (low, high) if low < high else (low - 0.5, low + 0.5)
