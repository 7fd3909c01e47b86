"""A recording: samples that are read block by block, and never held as a whole."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Container, FloatArray, IntArray, TextArray, column, scalar
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError

Samples = NDArray[np.float32]
"""Samples in full-scale units, shape (sample, channel)."""

GUARD_S = 60.0
"""A part of a recording keeps closest approaches so far beside its own span, s."""

Reader = Callable[[int], Iterator[Samples]]
"""Opens the recording and yields consecutive blocks of at most so many samples.

One that can go back has a method ``segment(first_sample, n_samples)``, too, and one that
shares its sound with others a method ``decimated(factor)``: the reader of a lower rate.
"""

READ_VALUES = 1 << 18
"""Values (samples times channels) that are read at once."""

UNENDED = 1 << 62
"""Samples of a recording that has not ended: more than there can be."""


@runtime_checkable
class LiveSource(Protocol):
    """A reader of sound that is still coming, and can be read once."""

    n_samples: int
    """Samples per channel that were read so far."""

    @property
    def digest(self) -> str:
        """SHA-256 of everything that came."""

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield blocks of so many samples, the last one shorter."""

    def end(self) -> None:
        """End the sound here."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording(Container):
    """What is known of a recording, and how to read its samples.

    In a file only the facts are kept; ``reader`` is None when read back.
    """

    NAME: ClassVar[str] = "recording"

    sensor: Sensor
    """The sensor that recorded it."""
    name: str = scalar("File name of the source.")
    sample_rate_hz: float = scalar("Sample rate.")
    n_samples: int = scalar("Number of samples per channel.")
    n_channels: int = scalar("Number of channels.")
    start_utc_ns: int | None = scalar("Time of the first sample since 1970-01-01 UTC.", None)
    digest: str = scalar("SHA-256 of the source file.", "")
    first_sample: int = scalar("Sample of the file that is the first here.", 0)
    file_channels: str = scalar(
        "Channels taken of the file, from 1, comma separated; empty if unknown.", ""
    )
    reader: Reader | None = scalar("Opens the samples.", None)

    @property
    def duration_s(self) -> float:
        """Length of the recording, s; of one that has not ended, beyond all bounds."""
        return self.n_samples / self.sample_rate_hz

    @property
    def of_recorders(self) -> tuple["Recording", ...]:
        """Recordings of several recorders that it is made of, or itself alone."""
        found: tuple[Recording, ...] = getattr(self.reader, "recordings", (self,))
        return found

    @property
    def is_live(self) -> bool:
        """Whether the sound is still coming, so that its length is not known."""
        return self.n_samples == UNENDED

    @property
    def can_be_read_again(self) -> bool:
        """Whether the reader can go back: of live sound, as far as it is still held."""
        return hasattr(self.reader, "segment")

    def ended(self) -> "Recording":
        """Return the recording as it is when its sound has been read.

        Live sound has its length and digest then; any other recording stays as it is.
        """
        if not (self.is_live and isinstance(self.reader, LiveSource)):
            return self
        return replace(self, n_samples=self.reader.n_samples, digest=self.reader.digest)

    @property
    def block_samples(self) -> int:
        """Samples per channel to read at once: of live sound at most a second."""
        usual = max(1, READ_VALUES // self.n_channels)
        return min(usual, max(1, round(self.sample_rate_hz))) if self.is_live else usual

    def elapsed_ns(self, n_samples: int) -> int:
        """Return how long so many samples last, ns; exact where the rate is whole."""
        rate_hz = self.sample_rate_hz
        if rate_hz.is_integer():
            return (n_samples * NANOSECONDS + int(rate_hz) // 2) // int(rate_hz)
        return round(n_samples * NANOSECONDS / rate_hz)

    def part(self, first: int, last: int) -> "Recording":
        """Return the part from a sample to before another one.

        Its reader is a dataclass that has them as ``first`` and ``last``.
        """
        start_ns = self.start_utc_ns
        if start_ns is not None:
            start_ns += self.elapsed_ns(first)
        reader: Any = self.reader
        own = replace(reader, first=reader.first + first, last=reader.first + last)
        return replace(
            self,
            n_samples=UNENDED if self.is_live else last - first,
            first_sample=self.first_sample + first,
            start_utc_ns=start_ns,
            reader=own,
        )

    def segment(self, start_s: float, stop_s: float) -> Samples:
        """Read a segment of the sound again.

        ``start_s``, ``stop_s``: where it begins and ends, s from the first sample; what
        lies outside the recording is left out.

        Returned: array, shape (sample, channel); samples in full-scale units.

        Raises
        ------
        DataError
            The sound is not at hand: the recording was read from a product, or a live
            source has passed the segment and no longer holds it.
        """
        first = max(0, round(start_s * self.sample_rate_hz))
        last = min(self.n_samples, round(stop_s * self.sample_rate_hz))
        return read_segment(self.reader, first, max(0, last - first))

    @property
    def first_s(self) -> float:
        """Where in the file the recording begins, s."""
        return self.first_sample / self.sample_rate_hz


def read_segment(reader: Reader | None, first_sample: int, n_samples: int) -> Samples:
    """Read so many samples from one on with a reader that can go back.

    Raises
    ------
    DataError
        The reader cannot, or no longer has them.
    """
    read = getattr(reader, "segment", None)
    if read is None:
        raise DataError("the sound is not at hand to be read again; open the recording's file.")
    samples: Samples = read(first_sample, n_samples)
    return samples


def check_block(block_samples: int) -> None:
    """Refuse a block of no sample.

    Raises
    ------
    OptionError
        It has less than one.
    """
    if block_samples < 1:
        raise OptionError(f"block_samples must be 1 or more, got {block_samples}.")


def in_blocks(pieces: Iterable[Samples], block_samples: int) -> Iterator[Samples]:
    """Yield pieces of any length as blocks of so many samples, the last one shorter."""
    held: list[Samples] = []
    count = 0
    for piece in pieces:
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


@dataclass(frozen=True)
class HeldSamples:
    """A reader of sound that is held as a whole."""

    samples: Samples
    """All samples, shape (sample, channel)."""

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield consecutive blocks of so many samples, the last one shorter."""
        for first in range(0, self.samples.shape[0], block_samples):
            yield self.samples[first : first + block_samples]

    def segment(self, first_sample: int, n_samples: int) -> Samples:
        """Return so many samples from one on."""
        return self.samples[first_sample : first_sample + n_samples]


@dataclass(frozen=True)
class PartReader:
    """A reader of a part of the sound that another one can read again."""

    whole: Reader
    """Reader that can go back."""
    first_sample: int
    """First sample of the part."""
    n_samples: int
    """Its samples per channel."""

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield consecutive blocks of so many samples, the last one shorter."""
        for first in range(0, self.n_samples, block_samples):
            count = min(block_samples, self.n_samples - first)
            yield self.segment(first, count)

    def segment(self, first_sample: int, n_samples: int) -> Samples:
        """Read so many samples from one on.

        Raises
        ------
        DataError
            The sound is no longer at hand.
        """
        return read_segment(self.whole, self.first_sample + first_sample, n_samples)


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordedFiles(Container):
    """Files that were joined to one recording, in order of time; gaps lie between.

    A part of a longer recording has a span of its own and reads some sound beside it.
    """

    NAME: ClassVar[str] = "files"
    ROW: ClassVar[str] = "file"

    name: TextArray = column("File name.")
    digest: TextArray = column("SHA-256 of the file.")
    start_sample: IntArray = column("First sample of the file in the joined recording.")
    n_samples: IntArray = column("Its samples per channel.")
    start_utc_ns: IntArray = column("Time of its first sample since 1970-01-01 UTC.")
    first_sample: IntArray | None = column("Sample of the file that is its first here.")
    sensor: str = scalar("Identifier of the sensor.")
    own_start_utc_ns: int | None = scalar(
        "Where a part's own span begins; None for a whole recording.", None
    )
    own_stop_utc_ns: int | None = scalar(
        "Where a part's own span ends; None for a whole recording.", None
    )

    @property
    def own_ns(self) -> tuple[int, int] | None:
        """Begin and end of a part's own span, ns since 1970; None of a whole recording."""
        if self.own_start_utc_ns is None or self.own_stop_utc_ns is None:
            return None
        return self.own_start_utc_ns, self.own_stop_utc_ns

    def kept_span_s(self, start_utc_ns: int | None) -> tuple[float, float] | None:
        """Return where closest approaches are kept, s of a recording; None: everywhere.

        ``start_utc_ns``: time of the first sample of the recording, ns since 1970-01-01
        UTC.
        """
        own = self.own_ns
        if start_utc_ns is None or own is None:
            return None
        return (
            (own[0] - start_utc_ns) / NANOSECONDS - GUARD_S,
            (own[1] - start_utc_ns) / NANOSECONDS + GUARD_S,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Lock(Container):
    """Lock of a demultiplexer on the pilots of a buoy."""

    NAME: ClassVar[str] = "lock"
    ROW: ClassVar[str] = "second"

    time_s: FloatArray = column("Begin of the second, counted from the first sample.")
    locked_share: FloatArray = column(
        "Share of the second that is locked; the rest is a gap.", unit="1"
    )
    pilot_snr_db: FloatArray = column(
        "Power of the 7.5 kHz pilot over that of the noise in its band."
    )
    phase_pilot_db: FloatArray = column(
        "Level of the 15 kHz pilot over that of the 7.5 kHz pilot; nan without lock."
    )
    clock_error_ppm: FloatArray = column(
        "Frequency of the pilot over 7.5 kHz less 1; nan without lock.", unit="1e-6"
    )
    sensor: str = scalar("Identifier of the sensor.")
