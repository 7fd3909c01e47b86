"""What a product, a recording or a folder is, in about ten lines.

**Conventions.** Every line is a word and what it says, parted by a colon. What is not
known is said to be so.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.opening import SUFFIXES, SoundFacts, sound_facts
from uwtrack_cli.files.hdf5.product import Product
from uwtrack_cli.files.text_escaping import file_name, shell_word
from uwtrack_cli.files.utc import format_utc

MOST_NAMES = 6
"""Names that a line lists; of the others it gives the number."""


def product_lines(product: Product) -> Iterator[str]:
    """Yield what a product is and what was found."""
    yield (
        f"{Path(product.name).name}: result file of uwtrack {product.program_version}, made "
        f"{product.created_utc}, schema {product.schema_version}"
    )
    recordings = product.read_all(Recording)
    read = {source.digest for step in product.history for source in step.sources}
    recordings = [one for one in recordings if one.digest in read] or recordings
    if len(recordings) == 1:
        yield from _sound_lines(recordings[0])
    elif recordings:
        yield f"sound: {len(recordings)} recordings: {_listed([r.name for r in recordings])}"
    if recordings:
        yield f"gaps: {_gaps(product)}"
    yield from _sensor_lines(product.read_all(Sensor))
    yield f"passages: {_passages(product.read_all(Encounters), product)}"
    yield f"steps: {_listed([step.step_name for step in product.history])}"
    yield f"holds: {_listed(sorted({key.name for key in product.paths}))}"


def recording_lines(path: Path) -> Iterator[str]:
    """Yield what a recording is.

    ``path``: the recording; its sensor file lies beside it, its name tells the start.

    Raises
    ------
    DataError
        It is no recording, or ends too early.
    """
    from uwtrack_cli.files.tables.sensors import find_sensor
    from uwtrack_cli.flow.sources import open_with_options

    sensor = find_sensor(path)
    channel = 1 if sensor is None else None
    recording = open_with_options(path, {"channel": channel})
    yield f"{file_name(path)}: recording"
    yield from _sound_lines(recording, sound_facts(path))
    if sensor is None:
        yield "sensor: no sensor file beside it; give one with --sensor to what reads it"
    else:
        yield from _sensor_lines([recording.sensor])
    yield f"next: uwtrack run {shell_word(path)}"


def folder_lines(folder: Path) -> Iterator[str]:
    """Yield what the recordings in a folder have to do with each other.

    Raises
    ------
    DataError
        It holds no recording.
    """
    from uwtrack_cli.flow.batch_sources import describe_recorders, find_recordings

    inside = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
    if not inside and any(folder.glob("*.h5")):
        raise DataError(
            f"{folder} is a folder of result files; uwtrack passages "
            f"{shell_word(folder)} "
            f"lists them."
        )
    if not inside:
        raise DataError(f"{folder} is a folder that holds no recording ({', '.join(SUFFIXES)}).")
    found = find_recordings(inside)
    word = "recording" if len(found) == 1 else "recordings"
    yield f"{folder}: {len(found)} {word}"
    yield from describe_recorders(found, {})


def _sound_lines(recording: Recording, in_file: SoundFacts | None = None) -> Iterator[str]:
    """Yield what sound there is; ``in_file``: what its file holds, where it is read."""
    n_read = recording.n_channels
    rate_hz, n_channels = recording.sample_rate_hz, n_read
    if in_file is not None:
        rate_hz, n_channels = in_file.sample_rate_hz, in_file.n_channels
    channels = "1 channel" if n_channels == 1 else f"{n_channels} channels"
    if recording.sample_rate_hz != rate_hz:
        names = recording.sensor.channels.replace(",", ", ")
        channels += f"; read: {names} at {recording.sample_rate_hz:.8g} Hz"
    elif n_read < n_channels:
        taken = recording.file_channels.replace(",", ", ")
        channels += f"; read: {'channels' if n_read > 1 else 'channel'} {taken}"
    yield (
        f"sound: {recording.name}, {_duration(recording.duration_s)} at "
        f"{rate_hz:.8g} Hz, {channels}"
    )
    start = "not known; give it with --start-utc or --time-pattern"
    if recording.start_utc_ns is not None:
        start = f"{format_utc(recording.start_utc_ns)[:-1].replace('T', ' ')} UTC"
    yield f"start: {start}"


def _sensor_lines(sensors: Sequence[Sensor]) -> Iterator[str]:
    if len(sensors) == 1:
        sensor = sensors[0]
        facts = [sensor.id, sensor.kind, _place(sensor)]
        if sensor.depth_m is not None:
            facts.append(f"depth {sensor.depth_m:g} m")
        yield f"sensor: {', '.join(facts)}"
    elif sensors:
        yield f"sensors: {_listed([s.id for s in sensors])}"
    if sensors:
        known = sum(sensor.full_scale_upa is not None for sensor in sensors)
        levels = "dB re 1 uPa" if known == len(sensors) else "dB re full scale"
        some = "" if known in {0, len(sensors)} else f"; {known} sensors are calibrated"
        none = "; not calibrated" if not known else ""
        yield f"levels: {levels}{some}{none}"


def _place(sensor: Sensor) -> str:
    if sensor.navigation is not None:
        return "moving"
    if sensor.latitude is not None:
        return f"latitude {sensor.latitude:.5f} longitude {sensor.longitude:.5f}"
    if sensor.east_m is not None:
        return f"{sensor.east_m:g} m east {sensor.north_m:g} m north of the origin"
    return "position not known"


def _gaps(product: Product) -> str:
    for files in product.read_all(RecordedFiles):
        rate_hz = next(r.sample_rate_hz for r in product.read_all(Recording))
        ends = files.start_sample + files.n_samples
        gaps_s = (files.start_sample[1:] - ends[:-1]) / rate_hz
        gaps_s = gaps_s[gaps_s > 0.0]
        between = f"{gaps_s.size} of {gaps_s.sum():.1f} s together" if gaps_s.size else ("none")
        return f"{between}, between {files.name.size} files"
    for levels in product.read_all(Levels):
        empty = levels.frames.valid_fraction == 0.0
        begins = np.count_nonzero(empty[1:] & ~empty[:-1]) + bool(empty[:1].any())
        hop_s = float(np.median(np.diff(levels.frames.time_s))) if empty.size > 1 else 0.0
        if begins:
            return f"{begins} of {np.count_nonzero(empty) * hop_s:.1f} s together"
        return "none"
    return "not looked for"


def _passages(found: Sequence[Encounters], product: Product) -> str:
    if not any(key.name == Encounters.NAME for key in product.paths):
        return "not sought"
    counts = Counter(str(status) for encounters in found for status in encounters.status)
    each = ", ".join(f"{n} {status}" for status, n in counts.most_common())
    return f"{counts.total()} ({each})" if counts else "0"


def _duration(seconds: float) -> str:
    """Return a length in the units that people use.

    Examples
    --------
    >>> _duration(300.0), _duration(86_400.0), _duration(2.25)
    ('5 min 0 s', '24 h 0 min', '2.25 s')
    """
    if seconds < 60.0:
        return f"{seconds:.4g} s"
    whole = round(seconds * NANOSECONDS) // NANOSECONDS
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:MOST_NAMES])
    rest = len(names) - MOST_NAMES
    return f"{shown} and {rest} more" if rest > 0 else shown or "none"
