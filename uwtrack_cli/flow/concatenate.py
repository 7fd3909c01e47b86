"""Consecutive files of one recorder as one recording, gaps kept as gaps.

**Method.** Every file is placed by its UTC time on the sample grid of the first one.
Between two files the samples are nan, which frames count as a gap: lines coast
through it. Names of files often tell whole seconds only; a file that begins within
``slack_s`` of where the one before it ended is taken to follow it directly. Since
each file is compared with UTC itself, such differences never add up.

**Conventions.** The joined recording has the name of its first file and the digest of
all their digests.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.recording import (
    Reader,
    RecordedFiles,
    Recording,
    Samples,
    read_stretch,
)
from uwtrack_cli.errors import DataError

SLACK_S = 1.0
MAX_GAP_S = 600.0
"""Files further apart than this are recordings of their own."""


@dataclass(frozen=True)
class Span:
    """When a file was recorded, on which kind of recorder."""

    recorder: tuple[object, ...]
    """What tells recorders apart: folder or sensor, sample rate, channels."""
    start_utc_ns: int
    """First sample, ns since 1970-01-01 UTC."""
    duration_s: float
    """Length of the file, s."""

    @property
    def end_utc_ns(self) -> int:
        """UTC after its last sample."""
        return self.start_utc_ns + round(self.duration_s * NANOSECONDS)


@dataclass(frozen=True)
class JoinedReader:
    """Reads several recordings one after the other, nan between them."""

    parts: tuple[tuple[int, int, Reader], ...]
    """First sample on the common grid, number of samples, reader; in order."""
    n_channels: int
    """Number of channels."""

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield blocks of so many samples, float32, shape (sample, channel)."""
        held: list[Samples] = []
        count = 0
        for piece in self._pieces(block_samples):
            held.append(piece)
            count += len(piece)
            if count >= block_samples:
                joined = np.concatenate(held)
                whole = count - count % block_samples
                for begin in range(0, whole, block_samples):
                    yield joined[begin : begin + block_samples]
                held, count = [joined[whole:]], count - whole
        if count:
            yield np.concatenate(held)

    def stretch(self, first_sample: int, n_samples: int) -> Samples:
        """Read so many samples from one on, nan where there is no file."""
        found = np.full((n_samples, self.n_channels), np.nan, np.float32)
        last = first_sample + n_samples
        for start, count, reader in self.parts:
            low, high = max(start, first_sample), min(start + count, last)
            if low < high:
                part = read_stretch(reader, low - start, high - low)
                found[low - first_sample : high - first_sample] = part
        return found

    def _pieces(self, block_samples: int) -> Iterator[Samples]:
        position = 0
        for start, n_samples, reader in self.parts:
            for begin in range(position, start, block_samples):
                count = min(block_samples, start - begin)
                yield np.full((count, self.n_channels), np.nan, np.float32)
            yield from reader(block_samples)
            position = start + n_samples


def group_spans(
    spans: Sequence[Span], max_gap_s: float = MAX_GAP_S
) -> list[tuple[int, ...]]:
    """Group files that follow each other on the same recorder.

    Parameters
    ----------
    spans
        When each file was recorded.
    max_gap_s
        Longest gap within a group, s.

    Returns
    -------
    list of tuples
        Indices of the files of each group, in order of time.
    """
    order = sorted(range(len(spans)), key=lambda k: spans[k].start_utc_ns)
    groups: list[list[int]] = []
    latest: dict[tuple[object, ...], list[int]] = {}
    for k in order:
        group = latest.get(spans[k].recorder)
        gap_s = np.inf
        if group:
            before = spans[group[-1]].end_utc_ns
            gap_s = (spans[k].start_utc_ns - before) / NANOSECONDS
        if group is None or gap_s > max_gap_s:
            group = []
            groups.append(group)
            latest[spans[k].recorder] = group
        group.append(k)
    return [tuple(group) for group in groups]


def join_recordings(
    recordings: Sequence[Recording], *, slack_s: float = SLACK_S
) -> tuple[Recording, RecordedFiles]:
    """Join recordings of one sensor by their UTC times.

    Parameters
    ----------
    recordings
        Recordings in order of time.
    slack_s
        Difference from UTC up to which a file directly follows the one before it, s.

    Returns
    -------
    tuple
        The joined recording, and which file lies where in it.

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
            msg = (
                f"{recording.name} begins {apart_s:.1f} s before the file before it "
                f"ends; recordings that overlap cannot be joined."
            )
            raise DataError(msg)
        assert recording.reader is not None  # noqa: S101 - opened for reading
        parts.append((start, recording.n_samples, recording.reader))
        end = start + recording.n_samples
    digests = "".join(recording.digest for recording in recordings)
    joined = replace(
        first,
        n_samples=end,
        digest=hashlib.sha256(digests.encode()).hexdigest(),
        reader=JoinedReader(tuple(parts), first.n_channels),
    )
    files = RecordedFiles(
        name=np.array([r.name for r in recordings]),
        digest=np.array([r.digest for r in recordings]),
        start_sample=np.array([start for start, _, _ in parts]),
        n_samples=np.array([n_samples for _, n_samples, _ in parts]),
        start_utc_ns=np.array([r.start_utc_ns for r in recordings]),
        sensor=first.sensor.id,
    )
    return joined, files


def _check_same(first: Recording, other: Recording) -> None:
    if first.start_utc_ns is None or other.start_utc_ns is None:
        unknown = first if first.start_utc_ns is None else other
        msg = f"the start of {unknown.name} is not known; give --time-pattern."
        raise DataError(msg)
    same = (
        first.sample_rate_hz == other.sample_rate_hz
        and first.n_channels == other.n_channels
        and first.sensor.equals(other.sensor)
    )
    if not same:
        msg = f"{first.name} and {other.name} differ in sensor, channels or rate."
        raise DataError(msg)


def _position(first: Recording, other: Recording) -> int:
    apart_ns = (other.start_utc_ns or 0) - (first.start_utc_ns or 0)
    rate = first.sample_rate_hz
    if rate.is_integer():  # exact, however long the recording
        return (apart_ns * int(rate) + NANOSECONDS // 2) // NANOSECONDS
    return round(apart_ns * rate / NANOSECONDS)
