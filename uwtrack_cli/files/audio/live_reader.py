"""Samples of sound that is still coming, block by block, with what disturbs it.

**Method.** The stream is decoded as it comes, in blocks of at most a second. Where
samples are no number, where the sound does not change at all, and where the pipe
stalled, a disturbance is noted; whoever works on the sound takes the notes.

**Conventions.** Times count samples. A pipe that stalls does not say what was lost in
the meantime, so nothing is put in its place.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum, auto
from itertools import chain
from typing import Protocol, runtime_checkable

import numpy as np

from uwtrack_cli.data.base import BoolArray
from uwtrack_cli.data.recording import LiveSource, Samples, check_block
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.audio.byte_stream import ByteStream
from uwtrack_cli.files.audio.dropouts import Dropouts, segment_without_dropouts, without_dropouts
from uwtrack_cli.files.audio.reader import Tally
from uwtrack_cli.files.audio.stream_header import StreamHeader

UNCHANGED_S = 60.0
"""Sound that does not change for so long is noted, s."""

LEAST_TEXT_BYTES = 256
"""Fewer first bytes than this are not taken for text."""

FEWEST_CHARACTERS = 8
"""Different characters that text has at least; a converter that is stuck has fewer."""

TEXT_BYTES = bytes({9, 10, 13, *range(32, 127), *range(128, 256)})
"""What text in UTF-8 may consist of."""

TRAILING_BYTES = 1 << 16
"""More bytes than this after the promised end are told: they are no usual chunk."""


class DisturbanceKind(Enum):
    """Kinds of what disturbs the sound."""

    LOST = auto()
    """Samples that are no number."""
    UNCHANGED = auto()
    """Sound that does not change."""
    STALL = auto()
    """A pause in which no sound came."""
    CLOCK_JUMP = auto()
    """A jump of the computer's clock."""


@dataclass(frozen=True)
class Disturbance:
    """Something that disturbs the sound."""

    kind: DisturbanceKind
    """What it is."""
    reason: str
    """The same in words."""
    start_sample: int
    """Where it begins, in samples from the first."""
    n_samples: int
    """How long it is so far; 0 for a moment between two samples."""
    is_over: bool
    """Whether it has ended."""


@runtime_checkable
class DisturbedSource(LiveSource, Protocol):
    """A reader of live sound that notes what disturbs it."""

    def take_disturbances(self) -> list[Disturbance]:
        """Return what was noted since this was last asked."""


@dataclass
class LiveReader:
    """Read the samples of a stream, once: `reader(block_samples)`.

    They are kept beside, on disk, so that a passage may be held against its sound.

    Parameters
    ----------
    stream
        The bytes, taken up to the first sample.
    header
        What they are.
    columns
        Channels to yield, in this order, counted from 0.
    first
        First sample to yield.
    last
        Sample after the last one; None for all that come.
    """

    stream: ByteStream
    header: StreamHeader
    columns: tuple[int, ...]
    first: int = 0
    last: int | None = None
    is_raw: bool = False
    """Whether no header has said that this is sound."""
    n_samples: int = 0
    """Samples per channel that were yielded so far."""
    disturbances: list[Disturbance] = field(default_factory=list)
    """What was noted since somebody emptied the list."""

    def __post_init__(self) -> None:
        """Begin to look for what disturbs the sound."""
        self._missing = DisturbanceRun(DisturbanceKind.LOST, "the samples are no number", 0.0)
        self._unchanged = DisturbanceRun(
            DisturbanceKind.UNCHANGED, "the sound does not change", UNCHANGED_S
        )
        self._taken = self._n_read = 0
        self._is_cut = False
        self._start = self.stream.n_bytes + self.first * self.header.frame_bytes

    @property
    def digest(self) -> str:
        """SHA-256 of everything that came, the header included."""
        return self.stream.digest

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield blocks of at most so many samples.

        ``block_samples``: samples per channel of a block, 1 or more.

        Yields
        ------
        array, shape (sample, channel)
            Float32 in full-scale units, nan where there is no number or sound is lost.

        Raises
        ------
        OptionError
            Less than one sample.
        """
        check_block(block_samples)
        return self._blocks(block_samples)

    def segment(self, first_sample: int, n_samples: int) -> Samples:
        """Read so many samples again, counted from the first that was yielded.

        Raises
        ------
        DataError
            They are no longer kept, or have not come yet.
        """
        rate_hz = self.header.sample_rate_hz
        span = first_sample, first_sample + n_samples
        for begin in sorted({0, first_sample}):  # what is beside it may have gone
            try:
                return segment_without_dropouts(
                    self._again, span, (begin, max(self.n_samples, span[1])), rate_hz
                )
            except DataError as error:
                failure = error
        raise failure

    def _again(self, first_sample: int, n_samples: int) -> Samples:
        frame = self.header.frame_bytes
        content = None
        if 0 <= first_sample <= first_sample + n_samples <= self.n_samples:
            begin = self._start + first_sample * frame
            content = self.stream.again(begin, n_samples * frame)
        if content is None:
            raise DataError(
                f"samples {first_sample} to {first_sample + n_samples} of "
                f"{self.stream.name} are not at hand, of {self.n_samples} that came."
            )
        block = self.header.sample_format.decode(content, self.header.n_channels)
        return block[:, list(self.columns)]

    def _blocks(self, block_samples: int) -> Iterator[Samples]:
        tally, dropouts = (Tally(len(self.columns)), Dropouts(self.header.sample_rate_hz))
        self._pass_over()
        raw = self._read_blocks(block_samples, tally)
        for block in without_dropouts(raw, dropouts, block_samples):
            self.n_samples += block.shape[0]
            yield block
        self._finish(tally, dropouts)

    def _read_blocks(self, block_samples: int, tally: Tally) -> Iterator[Samples]:
        while True:
            block = self._take(block_samples)
            if block.shape[0]:
                tally.add(block)
                self._note(block)
                self._n_read += block.shape[0]
                yield block
            if block.shape[0] < block_samples:
                break

    def end(self) -> None:
        """End the sound here, as if the stream had ended."""
        self._is_cut = True
        self.stream.end()

    def take_disturbances(self) -> list[Disturbance]:
        """Return what was noted since this was last asked."""
        found, self.disturbances = self.disturbances, []
        return found

    def _pass_over(self) -> None:
        left = self.first
        while left:
            block = self._frames(min(left, int(self.header.sample_rate_hz)))
            if not block.shape[0]:
                break
            left -= block.shape[0]

    def _take(self, count: int) -> Samples:
        if self.last is not None:
            count = min(count, self.last - self.first - self._n_read)
        block = self._frames(count)
        return block[:, list(self.columns)]

    def _frames(self, count: int) -> Samples:
        """Decode so many samples of every channel, fewer at the end."""
        header = self.header
        wanted = count * header.frame_bytes
        if header.n_bytes is not None:
            wanted = min(wanted, header.n_bytes - self._taken)
        content = self.stream.take(wanted)
        if self.is_raw and not self._taken and _is_text(content):
            start = content.split(b"\n")[0][:40].decode(errors="replace").strip()
            raise DataError(
                f"{self.stream.name} gives text, which begins with {start!r}, and --raw "
                f"takes samples: look at what the program writes, and have it write its "
                f"messages to standard error."
            )
        self._taken += len(content)
        odd = len(content) % header.frame_bytes
        if odd:
            warn(
                f"{self.stream.name} ends in the middle of a sample: its last {odd} "
                f"bytes are left out."
            )
        whole = content[: len(content) - odd]
        return header.sample_format.decode(whole, header.n_channels)

    def _note(self, block: Samples) -> None:
        rate_hz = self.header.sample_rate_hz
        is_lost = np.asarray(np.isnan(block).any(axis=1))
        same = (block == block[0]).all(axis=0) | np.isnan(block).all(axis=0)
        is_same = np.full(block.shape[0], bool(same.all()) and not is_lost.any())
        for run, flags in ((self._missing, is_lost), (self._unchanged, is_same)):
            self.disturbances += run.add(self._n_read, flags, rate_hz)
        for stall_s in self._emptied(self.stream.stalls_s):
            self._note_moment(DisturbanceKind.STALL, f"no sound came for {stall_s:.1f} s")
        for jump_s in self._emptied(self.stream.clock_jumps_s):
            self._note_moment(
                DisturbanceKind.CLOCK_JUMP,
                f"the computer's clock jumped by {jump_s:+.1f} s; times count samples",
            )

    def _emptied(self, noted: list[float]) -> list[float]:
        found = list(noted)
        noted.clear()
        return found

    def _note_moment(self, kind: DisturbanceKind, reason: str) -> None:
        self.disturbances.append(Disturbance(kind, reason, self._n_read, 0, True))

    def _finish(self, tally: Tally, dropouts: Dropouts) -> None:
        for run in (self._missing, self._unchanged):
            self.disturbances += run.finish(self.header.sample_rate_hz)
        promised = self.header.n_bytes
        if promised is not None and self.last is None and not self._is_cut:
            self._compare(promised)
        name = self.stream.name
        said = tally.problems(name, self.columns), dropouts.problems(name)
        for msg in chain(*said):
            warn(msg)

    def _compare(self, promised: int) -> None:
        """Compare the end of the sound with the end that the header promises."""
        per_second = self.header.sample_rate_hz * self.header.frame_bytes
        came = f"{self._taken / per_second:.3f} s"
        if self._taken < promised:
            warn(
                f"{self.stream.name} ended after {came}; its header promises "
                f"{promised / per_second:.3f} s."
            )
            return
        n_trailing = 0
        while piece := self.stream.take(TRAILING_BYTES):
            n_trailing += len(piece)
        if n_trailing > TRAILING_BYTES:
            warn(
                f"{self.stream.name} went on for {n_trailing} bytes after the {came} "
                f"that its header promises; they are left out."
            )


def _is_text(content: bytes) -> bool:
    """Tell whether the first second of sound is lines of text.

    Samples of 16 bits and more have bytes of every value, or those of a zero. Samples of
    8 bits would have to reach a line feed without a value between it and the space.
    """
    if len(content) < LEAST_TEXT_BYTES or b"\n" not in content:
        return False
    if content.translate(None, TEXT_BYTES) or len(set(content)) < FEWEST_CHARACTERS:
        return False
    try:  # the last character may be cut
        content[: content.rfind(b"\n")].decode()
    except UnicodeDecodeError:
        return False
    return True


class DisturbanceRun:
    """Samples in a row of which something is true."""

    def __init__(self, kind: DisturbanceKind, reason: str, least_s: float) -> None:
        self.kind, self.reason = kind, reason
        self.least_s = least_s
        self.start = self.count = self.told = 0

    def add(self, first_sample: int, flags: BoolArray, rate_hz: float) -> Iterator[Disturbance]:
        """Take the flags of a block; return what has ended or is worth a word now."""
        at = np.flatnonzero(flags)
        is_broken = not at.size or at[0] > 0 or self.start + self.count != first_sample
        if self.count and is_broken:
            yield from self.finish(rate_hz)
        if not at.size:
            return
        if not self.count:
            self.start = first_sample + int(at[0])
        self.count = first_sample + int(at[-1]) + 1 - self.start
        least = max(self.least_s, UNCHANGED_S) * rate_hz
        if not self.told and self.count >= least:
            self.told = 1
            yield Disturbance(self.kind, self.reason, self.start, self.count, False)
        if at[-1] + 1 < flags.size:
            yield from self.finish(rate_hz)

    def finish(self, rate_hz: float) -> Iterator[Disturbance]:
        """End the run; return it if it was long enough."""
        if self.count and self.count >= self.least_s * rate_hz:
            yield Disturbance(self.kind, self.reason, self.start, self.count, True)
        self.count = self.told = 0
