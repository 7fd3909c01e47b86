"""Live sound as a recording: from standard input, a pipe, or a file that grows.

**Conventions.** The length of the recording is not known before its sound has ended
(`Recording.ended`). Samples, sensor and channels are those that the same bytes give
when they are read from a file.
"""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.options import refuse_unknown
from uwtrack_cli.data.recording import UNENDED, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import OptionError
from uwtrack_cli.files.audio.byte_stream import (
    ByteStream,
    GrowingFile,
    open_pipe,
    open_standard_input,
)
from uwtrack_cli.files.audio.header import sample_bytes_of
from uwtrack_cli.files.audio.live_reader import LiveReader
from uwtrack_cli.files.audio.recording_file import select_channels
from uwtrack_cli.files.audio.stream_header import RAW_FORMATS, StreamHeader, read_stream_header
from uwtrack_cli.files.checks import STANDARD_INPUT, check_readable, is_pipe
from uwtrack_cli.files.text_escaping import file_name

NOW = -1
"""A start time that is the moment in which the first sound comes."""


@dataclass(frozen=True)
class RawSound:
    """What samples without a header are."""

    sample_format: str
    """Name of the sample format: s16le, s24le, f32le, ..."""
    sample_rate_hz: float
    """Sample rate, Hz."""
    n_channels: int = 1
    """Number of channels."""

    def header(self) -> StreamHeader:
        """Return what a header would say.

        Raises
        ------
        OptionError
            There is no such format, or rate or channels are out of range.
        """
        known = dict.fromkeys(RAW_FORMATS)
        refuse_unknown({self.sample_format: None}, known, "--raw", "sample format")
        if not 1 <= self.sample_rate_hz <= 1e7:
            raise OptionError(f"--rate-hz must be 1 to 1e7 Hz, got {self.sample_rate_hz:g}.")
        if not 1 <= self.n_channels <= 1024:
            raise OptionError(f"--channels must be 1 to 1024, got {self.n_channels}.")
        sample_format = RAW_FORMATS[self.sample_format]
        return StreamHeader(self.sample_rate_hz, self.n_channels, sample_format)


def open_live_recording(
    path: Path,
    *,
    sensor: Sensor | None = None,
    start_utc_ns: int | None = None,
    channel: int | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    raw: RawSound | None = None,
    idle_s: float | None = None,
) -> Recording:
    """Open sound that is still coming; it waits for the first of it.

    Parameters
    ----------
    path
        ``-`` for standard input, a named pipe or device, or a file that is written.
    sensor
        The sensor that makes it; without one, a single channel is taken as an omni
        hydrophone of unknown position and calibration.
    start_utc_ns
        Time of the first sample, ns since 1970-01-01 UTC; `NOW` is when it comes.
    channel
        Channel to take of several, counted from 1.
    start_s, stop_s
        Where to begin and to end, s from the first sample.
    raw
        What the samples are, where there is no header.
    idle_s
        The sound has ended when nothing came for so long, s; None waits for ever.

    Returns
    -------
    Recording
        Its length is not known; its reader reads once.

    Raises
    ------
    DataError
        There is no sound, or other channels than the sensor has. Lines of text in the
        place of raw samples are refused when they are read.
    OptionError
        An option does not fit.
    """
    header = None if raw is None else raw.header()
    stream = _open(path, idle_s, is_raw=raw is not None)
    if header is None:
        header = read_stream_header(stream.take, stream.name)
    if isinstance(stream, GrowingFile):  # it takes the end from the file as it grows
        header = replace(header, n_bytes=None)
    shown = Path("standard-input") if path == STANDARD_INPUT else path
    sensor, columns = select_channels(shown, header.n_channels, sensor, channel)
    first, last = live_span(header.sample_rate_hz, start_s, stop_s)
    if start_utc_ns == NOW:
        start_utc_ns = time.time_ns()
    if start_utc_ns is not None:
        start_utc_ns += round(first * NANOSECONDS / header.sample_rate_hz)
    return Recording(
        sensor=sensor,
        name=file_name(shown),
        sample_rate_hz=header.sample_rate_hz,
        n_samples=UNENDED,
        n_channels=len(columns),
        start_utc_ns=start_utc_ns,
        first_sample=first,
        file_channels=",".join(str(column + 1) for column in columns),
        reader=LiveReader(stream, header, columns, first, last, is_raw=raw is not None),
    )


def _open(path: Path, idle_s: float | None, *, is_raw: bool) -> ByteStream:
    if idle_s is not None and not idle_s > 0:
        raise OptionError(f"--idle-s must be more than 0 s, got {idle_s:g}.")
    if path == STANDARD_INPUT:
        return open_standard_input(idle_s)
    if is_pipe(path):
        return open_pipe(path, idle_s)
    check_readable(path)
    return GrowingFile(path, idle_s, None if is_raw else _stated_end)


def _stated_end(file: BinaryIO) -> int | None:
    """Return where the sound of a file ends as its header says by now, if it does."""
    counted = sample_bytes_of(file)
    if counted is None or counted.promised == 0:
        return None
    return counted.start + counted.promised


def live_span(
    rate_hz: float, start_s: float | None, stop_s: float | None
) -> tuple[int, int | None]:
    """Return the first sample of a span, and the one after its last if it is given.

    Raises
    ------
    OptionError
        The span is none.
    """
    first = round((start_s or 0.0) * rate_hz)
    last = None if stop_s is None else round(stop_s * rate_hz)
    if first < 0 or (last is not None and last <= first):
        raise OptionError(
            f"start_s must be 0 or more and stop_s after it, got {start_s} and {stop_s}."
        )
    return first, last
