"""Recordings: opened, checked against their sensor, read block by block, and written.

**Conventions.** Samples are float32 in full-scale units, shape (sample, channel).
Channels come in the order omni, east (x), north (y), whatever their order in the
file, those of an array in the order of the file, and `Sensor.channels` of the recording says so. A sample that is no number is
passed on as nan, so that the frames can count it as a gap.
"""

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError, OutputError, warn
from uwtrack_cli.files.atomic import atomic_target
from uwtrack_cli.files.audio.header import SampleBytes, sample_bytes
from uwtrack_cli.files.audio.opening import decodable_samples, open_sound, why_no_recording
from uwtrack_cli.files.audio.reader import AudioReader, file_stamp
from uwtrack_cli.files.checks import check_readable, file_digest
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.text_escaping import file_name
from uwtrack_cli.files.utc import format_utc

__all__ = ["open_recording", "write_wav"]

FORMATS = ("WAV", "WAVEX", "RF64", "W64", "FLAC", "AIFF")
ORDER = ("omni", "east", "x", "north", "y", "multiplex")
UNNAMED = "unnamed"
"""Identifier of the sensor of a recording that comes without a sensor file."""


def open_recording(
    path: Path | str,
    *,
    sensor: Sensor | None = None,
    start_utc_ns: int | None = None,
    channel: int | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    allow_truncated: bool = False,
) -> Recording:
    """Open a WAV, RF64, W64, FLAC or AIFF recording; samples are read later.

    Parameters
    ----------
    path
        The recording.
    sensor
        The sensor that made it; without one, the first channel is taken as an omni
        hydrophone of unknown position and calibration, with a warning.
    start_utc_ns
        Time of the first sample of the file, ns since 1970-01-01 UTC.
    channel
        Channel to take from a recording of several, counted from 1.
    start_s
        Where to begin, s from the first sample of the file.
    stop_s
        Where to end, s from the first sample of the file.
    allow_truncated
        Whether to take what there is of a file that ends too early.

    Returns
    -------
    Recording
        Its time zero is ``start_s``; its channels are those of the sensor.

    Raises
    ------
    DataError
        The file is missing, no recording, empty, truncated, or has other channels
        than its sensor.
    OptionError
        The channel or the span is not in the recording.
    """
    path = Path(path)
    check_readable(path)
    stamp = file_stamp(path)
    info = _sound_info(path)
    n_samples = _usable_samples(path, info, allow_truncated=allow_truncated)
    sensor, columns = select_channels(path, info.channels, sensor, channel)
    first, last = span_in(path, n_samples, info.samplerate, start_s, stop_s)
    if start_utc_ns is not None:
        start_utc_ns += (first * NANOSECONDS + info.samplerate // 2) // info.samplerate
    return Recording(
        sensor=sensor,
        name=file_name(path),
        sample_rate_hz=float(info.samplerate),
        n_samples=last - first,
        n_channels=len(columns),
        start_utc_ns=start_utc_ns,
        digest=file_digest(path),
        first_sample=first,
        file_channels=",".join(str(column + 1) for column in columns),
        reader=AudioReader(path, columns, first, last, stamp),
    )


def _sound_info(path: Path) -> Any:
    try:
        with open_sound(path) as info:
            pass  # what the header says is known, also when it is closed
    except (soundfile.SoundFileError, RuntimeError, OSError) as error:
        raise DataError(why_no_recording(path, error)) from error
    if info.format not in FORMATS:
        raise DataError(f"{path} is {info.format}; accepted are WAV, RF64, W64, FLAC and AIFF.")
    if not 1 <= info.samplerate <= 10_000_000 or info.channels < 1:
        raise DataError(
            f"{path} claims {info.channels} channels at {info.samplerate} Hz, "
            f"which no recording has: its header is damaged."
        )
    return info


def _usable_samples(path: Path, info: Any, *, allow_truncated: bool) -> int:
    """Return how many samples may be read, after comparing header and bytes."""
    counted = sample_bytes(path)
    present = promised = info.frames
    if counted is not None and counted.is_truncated:
        promised = round(promised * counted.promised / max(1, counted.present))
    elif info.frames:
        present = decodable_samples(path, info.frames)
    if promised < 1:
        raise DataError(f"{path} holds no samples.")
    problem = _shortage(path, counted, present, promised, info.samplerate)
    if problem:
        if not allow_truncated or not present:
            raise DataError(f"{problem}; give --allow-truncated to take what is there.")
        warn(f"{problem}; these are used.")
    return int(present)


def _shortage(
    path: Path, counted: SampleBytes | None, present: int, promised: int, rate: int
) -> str:
    """Say how header and bytes disagree; nothing if they do not."""
    there = f"{present / rate:.3f} s"
    if counted is not None and counted.is_unstated and not counted.is_open:
        return (
            f"{path} does not say how much sound it holds, as when a recorder lost its "
            f"power; {there} follow its header"
        )
    if present < promised or (counted is not None and counted.is_truncated):
        return (
            f"{path} is truncated: its header promises {promised / rate:.3f} s of "
            f"sound, {there} are there"
        )
    return ""


def select_channels(
    path: Path, n_channels: int, sensor: Sensor | None, channel: int | None
) -> tuple[Sensor, tuple[int, ...]]:
    """Return the sensor as the recording has it, and its channels' columns.

    ``sensor``: the sensor; without one an omni hydrophone of which nothing is known.
    ``channel``: channel to take, counted from 1; None takes those of the sensor, and
    the first without one.

    Raises
    ------
    DataError
        The recording has other channels than its sensor.
    OptionError
        There is no such channel.
    """
    if channel is not None:
        return _one_channel(path, n_channels, sensor, channel)
    if sensor is None:
        return _unnamed(path, n_channels), (0,)
    names = sensor.channel_names
    if len(names) != n_channels:
        one = ", or take one with --channel" if len(names) == 1 else ""
        raise DataError(
            f"{path} has {n_channels} channels, but sensor {sensor.id!r} names "
            f"{len(names)} ({sensor.channels}): correct `channels` in its file, with "
            f'"-" for a channel to leave out{one}.'
        )
    order = names if sensor.is_array else ORDER
    kept = [name for name in order if name in names and name != "-"]
    columns = tuple(names.index(name) for name in kept)
    return replace(sensor, channels=",".join(kept)), columns


def _one_channel(
    path: Path, n_channels: int, sensor: Sensor | None, channel: int
) -> tuple[Sensor, tuple[int, ...]]:
    if not 1 <= channel <= n_channels:
        raise OptionError(f"{path} has channels 1 to {n_channels}, got channel {channel}.")
    if sensor is None:
        return _unnamed(path), (channel - 1,)
    if sensor.is_multiplexed:
        return replace(sensor, channels="multiplex"), (channel - 1,)
    if sensor.has_direction:
        raise OptionError(
            f"sensor {sensor.id!r} is a vector sensor ({sensor.channels}) and needs "
            f"all its channels; leave out --channel {channel}."
        )
    one = replace(
        sensor, kind="omni", channels="omni",
        element_along_m=None, element_positions_m=None, tow_offset_m=None,
        heading_source=None,
    )  # fmt: skip
    return one, (channel - 1,)


def _unnamed(path: Path, n_channels: int = 1) -> Sensor:
    first = f"channel 1 of {n_channels} is read, " if n_channels > 1 else ""
    warn(
        f"{path.name} has no sensor file: {first}depth and calibration are unknown "
        f"(uwtrack init-sensor)."
    )
    return Sensor(id=UNNAMED)


def sound_s(path: Path) -> float:
    """Return the length of a recording as its header has it, s; 0 if it is unreadable."""
    try:
        facts = soundfile.info(as_input(path))
    except (OSError, soundfile.SoundFileError):
        return 0.0
    return float(facts.duration)


def span_in(
    path: Path, n_samples: int, rate: float, start_s: float | None, stop_s: float | None
) -> tuple[int, int]:
    """Return the first sample of a span of a recording, and the one after its last.

    ``start_s``, ``stop_s``: the span, s; None for the begin and the end of all.

    Raises
    ------
    OptionError
        The span is not in the recording.
    """
    duration_s = n_samples / rate
    start = 0.0 if start_s is None else start_s
    stop = duration_s if stop_s is None else stop_s
    if not 0.0 <= start < duration_s or not start < stop:
        raise OptionError(
            f"{path} lasts {duration_s:.3f} s; start_s and stop_s must lie in it, "
            f"in this order, got {start} and {stop}."
        )
    if round(stop * rate) > n_samples:
        warn(f"{path.name} ends at {duration_s:.3f} s, before stop_s = {stop}.")
    last = min(n_samples, round(min(stop, duration_s) * rate))
    first = min(round(start * rate), last)
    if first == last:
        raise OptionError(f"there is no sample of {path} between {start} s and {stop} s.")
    return first, last


WRITTEN_FORMATS = {
    ".wav": "WAV", ".rf64": "RF64", ".w64": "W64", ".flac": "FLAC",
    ".aif": "AIFF", ".aiff": "AIFF",
}  # fmt: skip
DATED = frozenset({"WAV", "RF64", "FLAC"})
"""Formats whose header holds a date."""
WAV_BYTES = 0xFFFFFFFF - 4096


def write_wav(
    path: Path | str,
    blocks: Iterator[Samples],
    sample_rate_hz: float,
    subtype: str = "PCM_16",
    *,
    overwrite: bool = False,
    start_utc_ns: int | None = None,
) -> int:
    """Write blocks of samples as a recording; the suffix decides its format.

    ``path``: target: .wav, .rf64, .w64, .flac, .aif or .aiff. ``blocks``: float32
    blocks in full-scale units, shape (sample, channel). ``sample_rate_hz``: sample
    rate, whole Hz. ``subtype``: sample format, as libsndfile names it (PCM_16, PCM_24,
    FLOAT, ...). ``start_utc_ns``: time of the first sample, ns since 1970-01-01 UTC, for
    the header of those formats that hold a date (not .w64, .aif).

    Returns
    -------
    int
        Samples written per channel.

    Raises
    ------
    OutputError
        The target exists, cannot be written, or grows beyond what WAV can hold.
    OptionError
        A suffix, sample rate or sample format that cannot be written.
    DataError
        No block, or samples that are no number.
    """
    path = Path(path)
    kind = WRITTEN_FORMATS.get(path.suffix.lower())
    if kind is None:
        raise OptionError(
            f"cannot write {path}: the suffix must be one of {', '.join(WRITTEN_FORMATS)}."
        )
    if sample_rate_hz != int(sample_rate_hz) or sample_rate_hz < 1:
        raise OptionError(f"the sample rate must be whole Hz, at least 1, got {sample_rate_hz}.")
    if not soundfile.check_format(kind, subtype):
        raise OptionError(f"{kind} has no sample format {subtype!r}.")
    with atomic_target(path, overwrite=overwrite) as temporary:
        date = "" if start_utc_ns is None or kind not in DATED else format_utc(start_utc_ns)
        return _write_blocks(
            temporary, path, iter(blocks), int(sample_rate_hz), kind, subtype, date
        )


def flac_bytes(samples: FloatArray, sample_rate_hz: int) -> bytes:
    """Return the sound of one channel as FLAC of 16 bits, for a page.

    ``samples``: shape (sample,), in full-scale units; what is beyond is cut.
    """
    file = BytesIO()
    cut = np.clip(samples, -1.0, 1.0)
    soundfile.write(file, cut, sample_rate_hz, subtype="PCM_16", format="FLAC")
    return file.getvalue()


def _write_blocks(
    temporary: Path,
    path: Path,
    blocks: Iterator[Samples],
    rate: int,
    kind: str,
    subtype: str,
    date: str,
) -> int:
    first = next(blocks, None)
    if first is None:
        raise DataError(f"there are no samples to write to {path}.")
    total = 0
    try:
        with soundfile.SoundFile(
            str(temporary), "w", rate, first.shape[1], subtype, format=kind
        ) as file:
            if date:
                file.date = date
            for block in chain([first], blocks):
                if not np.isfinite(block).all() and "PCM" in subtype:
                    raise DataError(f"samples of {path} are no numbers near sample {total}.")
                file.write(block)
                total += block.shape[0]
                if kind == "WAV" and temporary.stat().st_size > WAV_BYTES:
                    raise OutputError(f"{path} grows beyond 4 GB: name it .w64 or .rf64.")
    except soundfile.SoundFileError as error:
        raise OutputError(f"cannot write {path}: {error}.") from error
    if kind == "WAV":
        _forget_time(temporary)
    return total


def _forget_time(path: Path) -> None:
    """Take the time of writing out of a header: equal sound makes equal files."""
    with path.open("r+b") as file:
        at = file.read(128).find(b"PEAK")  # libsndfile's, in files of floats
        if at > 0:
            file.seek(at + 12)
            file.write(bytes(4))
