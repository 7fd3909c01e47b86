"""How long there was sound: each moment of a sensor once.

**Method.** Parts of a recording read sound beside their own span, files of a recorder
may overlap, and several products may be of one recording. What a product read is
therefore a list of spans, those of its files where it was joined, without the gaps; the
length of sound is that of their union, sensor by sensor.
"""

from collections.abc import Iterable, Iterator
from datetime import timedelta
from typing import NamedTuple

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.files.hdf5.product import Product
from uwtrack_cli.files.utc import EPOCH
from uwtrack_cli.flow.recorder_folder import DAY_NS

HOUR_NS = DAY_NS // 24


class SoundSpan(NamedTuple):
    """Sound without a gap."""

    sensor: str
    """Identifier of the sensor."""
    recording: str
    """Recording whose start is not known, from which times count; empty: they are UTC."""
    begin_ns: int
    """Begin, ns since 1970-01-01 UTC or since the start of the recording."""
    end_ns: int
    """End, as the begin."""


def sound_of(product: Product) -> list[SoundSpan]:
    """Return the sound that a product was made of."""
    joined = {files.sensor: files for files in product.read_all(RecordedFiles)}
    return [
        span
        for recording in product.read_all(Recording)
        for span in _spans(recording, joined.get(recording.sensor.id))
    ]


def _spans(recording: Recording, files: RecordedFiles | None) -> Iterator[SoundSpan]:
    sensor, rate = recording.sensor.id, recording.sample_rate_hz
    if files is not None:
        for begin, n in zip(files.start_utc_ns, files.n_samples, strict=True):
            length_ns = round(int(n) / rate * NANOSECONDS)
            yield SoundSpan(sensor, "", int(begin), int(begin) + length_ns)
        return
    start_ns, owner = recording.start_utc_ns, ""
    if start_ns is None:
        start_ns = round(recording.first_s * NANOSECONDS)
        owner = recording.digest or recording.name
    length_ns = round(recording.duration_s * NANOSECONDS)
    yield SoundSpan(sensor, owner, start_ns, start_ns + length_ns)


def each_once(spans: Iterable[SoundSpan]) -> list[SoundSpan]:
    """Return the union of spans, in the order of sensors and times."""
    found: list[SoundSpan] = []
    for span in sorted(spans):
        last = found[-1] if found else None
        if last is None or last[:2] != span[:2] or span.begin_ns > last.end_ns:
            found.append(span)
        else:
            found[-1] = last._replace(end_ns=max(last.end_ns, span.end_ns))
    return found


def by_day(spans: Iterable[SoundSpan]) -> Iterator[tuple[int, SoundSpan]]:
    """Yield spans in UTC, cut at midnight, with their days since 1970-01-01."""
    for span in spans:
        if span.recording:
            continue
        last = max(span.end_ns - 1, span.begin_ns) // DAY_NS
        for day in range(span.begin_ns // DAY_NS, last + 1):
            begin, end = day * DAY_NS, (day + 1) * DAY_NS
            begin, end = max(span.begin_ns, begin), min(span.end_ns, end)
            yield day, span._replace(begin_ns=begin, end_ns=end)


def total_h(spans: Iterable[SoundSpan]) -> float:
    """Return how long spans are together, h."""
    return sum(span.end_ns - span.begin_ns for span in spans) / HOUR_NS


def day_name(day: int) -> str:
    """Return the date of a day since 1970-01-01.

    Examples
    --------
    >>> day_name(19844)
    '2024-05-01'
    """
    return f"{EPOCH + timedelta(days=day):%Y-%m-%d}"


def hours_per_day(spans: Iterable[SoundSpan]) -> dict[str, float]:
    """Return how long there was sound on each UTC day, h, by its date."""
    found: dict[str, float] = {}
    for day, span in by_day(spans):
        found[day_name(day)] = found.get(day_name(day), 0.0) + total_h([span])
    return found
