"""`difar`: omni, east and north out of the audio of a sonobuoy."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from uwtrack_cli.cli.command_factory import Output, Overwrite, with_parameters
from uwtrack_cli.cli.console import progress_bar, say_wrote, signals_end
from uwtrack_cli.cli.live_run import IDLE_S, LIVE_PARAMETERS, LiveOptions, say_disturbances
from uwtrack_cli.cli.recording_arguments import SOURCE_PARAMETERS
from uwtrack_cli.data.recording import LiveSource, Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError

RATE_HZ = 6000
"""Sample rate in the header of what is written, Hz; a second is written at once."""


@with_parameters([*SOURCE_PARAMETERS, *LIVE_PARAMETERS])
def difar(
    source: Path,
    *,
    multiplex: tuple[str, str] | None = None,
    declination_deg: float | None = None,
    output: Output = None,
    overwrite: Overwrite = False,
    **options: Any,
) -> None:
    """Extract omni, east and north from the audio of a DIFAR sonobuoy.

    Writes a recording of three channels at 6 kHz, its sensor file and the level of the
    pilots (buoy.lock.csv). Times without lock are gaps. `run` and all other commands
    can also read the audio itself, if its sensor file has kind = "difar-multiplexed".

    Parameters
    ----------
    source
        Audio of a DIFAR sonobuoy; - is standard input.
    multiplex
        Dipole in phase with the 15 kHz pilot and the one ahead of it, - inverts
        one; -east north, unless the sensor file says otherwise.
    declination_deg
        Declination in degrees, east positive, for true bearings.
    output
        Recording to write; by default BUOY.difar.wav.
    """
    from uwtrack_cli.files.atomic import check_target, write_text
    from uwtrack_cli.files.audio.recording_file import write_wav
    from uwtrack_cli.files.tables.container_tables import write_table
    from uwtrack_cli.flow.concatenate import lock_of
    from uwtrack_cli.flow.sample_recordings import sensor_names, write_sensor

    live = LiveOptions(**{p.name: options.pop(p.name) for p in LIVE_PARAMETERS})
    is_live = live.is_live([source])
    buoy = _buoy(source, options["sensor"], multiplex, declination_deg)
    if output is None and str(source) == "-":
        raise OptionError("the audio comes without a name: name the recording with -o.")
    target = output or source.with_name(f"{source.stem}.difar.wav")
    if target.suffix.lower() == ".flac":
        raise OptionError(f"{target}: FLAC holds no gaps; name it .wav, .w64, .rf64 or .aiff.")
    check_target(target, overwrite=overwrite, inputs=[source])
    beside = target.with_suffix(".lock.csv")
    for one in (beside, *sensor_names(target, buoy)):
        check_target(one, overwrite=overwrite, inputs=[source])
    recording = _open(source, options, buoy, live if is_live else None)
    with _ending(recording), progress_bar("difar", recording.duration_s) as done:
        write_wav(target, _told(recording, done), RATE_HZ, "FLOAT", overwrite=overwrite)
    if recording.is_live and isinstance(recording.reader, LiveSource):
        say_disturbances(recording.reader, recording)
    made = replace(recording.sensor, kind="difar", multiplex=None, response=None)
    written = write_sensor(target, made, overwrite=overwrite)
    (lock,) = lock_of(recording)
    rows = write_table(lock, "csv")
    write_text(beside, "\n".join(rows) + "\n", overwrite=overwrite)
    for path in (target, *written, beside):
        say_wrote(path)


def _buoy(
    source: Path,
    sensor_file: Path | None,
    multiplex: tuple[str, str] | None,
    declination_deg: float | None,
) -> Sensor:
    """Return the sensor of the buoy, of its file or else of the options alone."""
    from uwtrack_cli.data.options import from_table
    from uwtrack_cli.files.tables.sensors import SensorTable, find_sensor

    is_named = str(source) != "-" or sensor_file is not None
    found = find_sensor(source, sensor_file) if is_named else None
    if found is not None and not found.is_multiplexed:
        raise DataError(
            f"the sensor of {source} is of kind {found.kind!r}; the audio of a buoy has "
            f'kind = "difar-multiplexed".'
        )
    if found is None:
        name = "buoy" if str(source) == "-" else source.stem
        table = {"id": name, "kind": "difar-multiplexed"}
        found = from_table(SensorTable, table, "the buoy").sensor(Path())
    # checked as the keys of a file are
    told = {"multiplex": multiplex, "declination_deg": declination_deg}
    given = {key: value for key, value in told.items() if value is not None}
    own = from_table(SensorTable, {"id": "-", "kind": found.kind, **given}, "difar")
    if multiplex is not None:
        found = replace(found, multiplex=own.sensor(Path()).multiplex)
    if declination_deg is not None:
        offset_deg = found.compass_offset_deg + declination_deg
        found = replace(found, compass_offset_deg=offset_deg, north=None)
    return found


def _open(
    source: Path, options: dict[str, Any], buoy: Sensor, live: LiveOptions | None
) -> Recording:
    from uwtrack_cli.flow.sources import open_live_with_options, open_with_options

    if live is None:
        return open_with_options(source, options, buoy)
    idle_s = IDLE_S if live.follow and live.idle_s is None else live.idle_s
    return open_live_with_options(source, options, raw=live.raw_sound(), idle_s=idle_s, sensor=buoy)


def _ending(recording: Recording) -> AbstractContextManager[None]:
    """Let a signal end live sound, and not the command."""
    reader = recording.reader
    if recording.is_live and isinstance(reader, LiveSource):
        return signals_end(reader.end)
    return nullcontext()


def _told(recording: Recording, done: Callable[[float], None]) -> Iterator[Samples]:
    """Yield the samples, and tell how far they are."""
    assert recording.reader is not None  # noqa: S101 - it was opened
    for number, block in enumerate(recording.reader(RATE_HZ), 1):
        yield block
        done(float(number))
