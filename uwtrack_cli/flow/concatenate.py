"""Consecutive files of one recorder as one recording, gaps kept as gaps.

**Method.** Every file is placed by its UTC time on the sample grid of the first one.
Between two files the samples are nan, which frames count as a gap: lines coast
through it. Names of files often tell whole seconds only; a file that begins within
``slack_s`` of where the one before it ended is taken to follow it directly. Since
each file is compared with UTC itself, such differences never add up. Where a file can
be read no further, the rest of it is a gap, too.

**Conventions.** The joined recording has the name of its first file and the digest of
all their digests, and of its own span if it is a part.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.recording import (
    Lock,
    Reader,
    RecordedFiles,
    Recording,
    Samples,
    in_blocks,
    read_segment,
)
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.audio.reader import AudioReader
from uwtrack_cli.flow.recorder_folder import SLACK_S
from uwtrack_cli.flow.sonobuoy import DifarReader, NoPilotsError


@dataclass(frozen=True)
class JoinedReader:
    """Reads several recordings one after the other, nan between them."""

    parts: tuple[tuple[int, int, Reader], ...]
    """First sample on the common grid, number of samples, reader; in order."""
    n_channels: int
    """Number of channels."""

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield blocks of so many samples, float32, shape (sample, channel)."""
        return in_blocks(self._pieces(block_samples), block_samples)

    def segment(self, first_sample: int, n_samples: int) -> Samples:
        """Read so many samples from one on, nan where there is no file."""
        found = np.full((n_samples, self.n_channels), np.nan, np.float32)
        last = first_sample + n_samples
        for start, count, reader in self.parts:
            low, high = max(start, first_sample), min(start + count, last)
            if low < high:
                part = read_segment(reader, low - start, high - low)
                found[low - first_sample : high - first_sample] = part
        return found

    def _pieces(self, block_samples: int) -> Iterator[Samples]:
        position = 0
        for start, n_samples, reader in self.parts:
            for begin in range(position, start, block_samples):
                count = min(block_samples, start - begin)
                yield np.full((count, self.n_channels), np.nan, np.float32)
            yield from self._file(reader, n_samples, block_samples)
            position = start + n_samples

    def _file(self, reader: Reader, n_samples: int, block_samples: int) -> Iterator[Samples]:
        """Yield the samples of a file; where it breaks off, the rest is a gap."""
        count = 0
        try:
            for block in reader(block_samples):
                count += len(block)
                yield block
        except DataError as error:
            has_no_sound = isinstance(error, NoPilotsError)
            if count == n_samples and not has_no_sound:
                raise  # it has changed: what was read is not what it is
            part = "file" if has_no_sound else "rest of the file"
            warn(f"{error} The {part} is a gap.")
        for begin in range(count, n_samples, block_samples):
            rest = min(block_samples, n_samples - begin)
            yield np.full((rest, self.n_channels), np.nan, np.float32)


def join_recordings(
    recordings: Sequence[Recording],
    *,
    slack_s: float = SLACK_S,
    own_ns: tuple[int, int] | None = None,
) -> tuple[Recording, RecordedFiles]:
    """Join recordings of one sensor by their UTC times.

    ``recordings``: recordings in order of time. ``slack_s``: difference from UTC up to
    which a file directly follows the one before it, s. ``own_ns``: begin and end of the
    span whose closest approaches are kept, ns since 1970-01-01 UTC; None keeps all.

    Returned: the joined recording, and which file lies where in it.

    Raises
    ------
    DataError
        A start is unknown, two overlap, or their sensors or sample rates differ.
    """
    first = recordings[0]
    parts: list[tuple[int, int, Reader]] = []
    end = 0
    for recording in recordings:
        _check_same(first, recording)
        start = _position(first, recording)
        if abs(start - end) <= slack_s * first.sample_rate_hz:
            start = end
        elif start < end:
            apart_s = (end - start) / first.sample_rate_hz
            raise DataError(
                f"{recording.name} begins {apart_s:.1f} s before the file before it "
                f"ends; recordings that overlap cannot be joined."
            )
        assert recording.reader is not None  # noqa: S101 - opened for reading
        parts.append((start, recording.n_samples, recording.reader))
        end = start + recording.n_samples
    digests = "".join(recording.digest for recording in recordings)
    if own_ns is not None:  # parts of one day may read the same files
        digests += f"{own_ns[0]} {own_ns[1]}"
    joined = replace(
        first,
        n_samples=end,
        first_sample=0,
        digest=hashlib.sha256(digests.encode()).hexdigest(),
        reader=JoinedReader(tuple(parts), first.n_channels),
    )
    files = RecordedFiles(
        name=np.array([r.name for r in recordings]),
        digest=np.array([r.digest for r in recordings]),
        start_sample=np.array([start for start, _, _ in parts]),
        n_samples=np.array([n_samples for _, n_samples, _ in parts]),
        start_utc_ns=np.array([r.start_utc_ns for r in recordings]),
        first_sample=np.array([r.first_sample for r in recordings]),
        sensor=first.sensor.id,
        own_start_utc_ns=None if own_ns is None else own_ns[0],
        own_stop_utc_ns=None if own_ns is None else own_ns[1],
    )
    return joined, files


def lock_of(recording: Recording) -> list[Lock]:
    """Return how well the pilots of a buoy were received, once all was read.

    It is one; of any other sensor there is none.
    """
    reader, sensor = recording.reader, recording.sensor.id
    parts = reader.parts if isinstance(reader, JoinedReader) else [(0, 0, reader)]
    found = []
    for start, _, one in parts:
        if isinstance(one, DifarReader):
            lock = one.lock(sensor)
            start_s = start / recording.sample_rate_hz
            found.append(replace(lock, time_s=lock.time_s + start_s))
    return [Lock.join(found)] if found else []


def clip_recording(recording: Recording, begin_ns: int, end_ns: int) -> Recording | None:
    """Return what of a recording lies in a span of time, None if nothing does.

    ``recording``: a recording of one file; one whose start is not known is returned
    whole. ``begin_ns``, ``end_ns``: the span, ns since 1970-01-01 UTC.
    """
    start_ns = recording.start_utc_ns
    if start_ns is None or not isinstance(recording.reader, AudioReader | DifarReader):
        return recording
    rate = recording.sample_rate_hz
    first = max(0, -round((start_ns - begin_ns) * rate / NANOSECONDS))
    last = min(recording.n_samples, round((end_ns - start_ns) * rate / NANOSECONDS))
    if first >= last:
        return None
    if (first, last) == (0, recording.n_samples):
        return recording
    return recording.part(first, last)


def _check_same(first: Recording, other: Recording) -> None:
    if first.start_utc_ns is None or other.start_utc_ns is None:
        unknown = first if first.start_utc_ns is None else other
        raise DataError(f"the start of {unknown.name} is not known; give --time-pattern.")
    same = (
        first.sample_rate_hz == other.sample_rate_hz
        and first.n_channels == other.n_channels
        and first.sensor.equals(other.sensor)
    )
    if not same:
        raise DataError(f"{first.name} and {other.name} differ in sensor, channels or rate.")


def _position(first: Recording, other: Recording) -> int:
    apart_ns = (other.start_utc_ns or 0) - (first.start_utc_ns or 0)
    rate = first.sample_rate_hz
    if rate.is_integer():  # exact, however long the recording
        return (apart_ns * int(rate) + NANOSECONDS // 2) // NANOSECONDS
    return round(apart_ns * rate / NANOSECONDS)
