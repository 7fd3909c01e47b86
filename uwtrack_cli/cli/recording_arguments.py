"""How a recording is named at the shell: its sensor, its start, its span."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uwtrack_cli.cli.command_factory import documented
from uwtrack_cli.cli.console import say
from uwtrack_cli.data.recording import Recording


@dataclass(frozen=True)
class Opening:
    """How a recording is opened.

    Parameters
    ----------
    sensor
        Sensor or deployment file; by default pass.sensor.toml beside pass.wav.
    sensor_sound_speed_mps
        Sound speed in m/s, instead of that in the sensor file.
    own_ship
        CSV table of own ship's track, instead of that in the sensor file.
    start_utc
        Time of the first sample, ISO 8601.
    time_zone
        Zone of times that are given without one: UTC, Asia/Seoul, +09:00.
    time_pattern
        Pattern of the start time in the file name, such as %Y%m%d_%H%M%S.
    channel
        Channel to use, counted from 1.
    start_s
        Begin here, in s from the first sample.
    stop_s
        End here, in s from the first sample.
    allow_truncated
        Use a file that ends too early as far as it goes.
    """

    sensor: Path | None = None
    sensor_sound_speed_mps: float | None = None
    own_ship: Path | None = None
    start_utc: str | None = None
    time_zone: str = "UTC"
    time_pattern: str | None = None
    channel: int | None = None
    start_s: float | None = None
    stop_s: float | None = None
    allow_truncated: bool = False


SOURCE_PARAMETERS = documented(
    Opening, "Recording", {"sensor_sound_speed_mps": "--sound-speed-mps"}
)
"""Options of every command that reads sound."""


def open_source(path: Path, options: Mapping[str, Any]) -> Recording:
    """Open a recording as the options say; tell what was assumed.

    Raises
    ------
    OptionError
        The sound speed is not positive, or an option does not fit the recording.
    """
    from uwtrack_cli.flow.sources import open_with_options

    recording = open_with_options(path, options)
    say(_assumptions(recording), 1)
    return recording


def open_sources(paths: Sequence[Path], options: Mapping[str, Any]) -> Recording:
    """Open a recording, or those of several recorders as that of one array.

    Raises
    ------
    OptionError
        An option does not fit a recording.
    DataError
        The recorders have no time or place in common.
    """
    from uwtrack_cli.flow.sources import joined

    return joined([open_source(path, options) for path in paths])


def _assumptions(recording: Recording) -> str:
    sensor = recording.sensor
    facts = [
        f"{recording.duration_s:.1f} s at {recording.sample_rate_hz:g} Hz",
        f"{sensor.kind} sensor {sensor.id}",
        f"sound speed {sensor.sound_speed_mps:g} m/s",
        "calibrated" if sensor.full_scale_upa else "levels re full scale",
        "start time known" if recording.start_utc_ns is not None else "no start time",
    ]
    return f"{recording.name}: {', '.join(facts)}"
