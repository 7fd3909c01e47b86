"""A recording: samples that are read block by block, and never held as a whole."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import Container, IntArray, TextArray, column, scalar
from uwtrack_cli.data.sensor import Sensor

Samples = NDArray[np.float32]
"""Samples in full-scale units, shape (sample, channel)."""

Reader = Callable[[int], Iterator[Samples]]
"""Opens the recording and yields consecutive blocks of at most so many samples."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording(Container):
    """What is known of a recording, and how to read its samples.

    In a file only the facts are kept; ``reader`` is None when read back.
    """

    NAME: ClassVar[str] = "recording"

    sensor: Sensor
    name: str = scalar("", "File name of the source.")
    sample_rate_hz: float = scalar("Hz", "Sample rate.")
    n_samples: int = scalar("1", "Number of samples per channel.")
    n_channels: int = scalar("1", "Number of channels.")
    start_utc_ns: int | None = scalar(
        "ns", "Time of the first sample since 1970-01-01 UTC.", None
    )
    digest: str = scalar("", "SHA-256 of the source file.", "")
    first_sample: int = scalar("1", "Sample of the file that is the first here.", 0)
    file_channels: str = scalar(
        "", "Channels taken of the file, from 1, comma separated; empty if unknown.", ""
    )
    reader: Reader | None = scalar("", "Opens the samples.", None)

    @property
    def duration_s(self) -> float:
        """Length of the recording, s."""
        return self.n_samples / self.sample_rate_hz

    @property
    def first_s(self) -> float:
        """Where in the file the recording begins, s."""
        return self.first_sample / self.sample_rate_hz


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordedFiles(Container):
    """Files that were joined to one recording, in order of time; gaps lie between."""

    NAME: ClassVar[str] = "files"

    name: TextArray = column("", "File name.", "file", dtype=np.str_)
    digest: TextArray = column("", "SHA-256 of the file.", "file", dtype=np.str_)
    start_sample: IntArray = column(
        "1", "First sample of the file in the joined recording.", "file", dtype=np.int64
    )
    n_samples: IntArray = column(
        "1", "Its samples per channel.", "file", dtype=np.int64
    )
    start_utc_ns: IntArray = column(
        "ns", "Time of its first sample since 1970-01-01 UTC.", "file", dtype=np.int64
    )
    sensor: str = scalar("", "Identifier of the sensor.")
