"""How a recording is named at the shell: its sensor, its start, its span."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from uwtrack_cli.cli.console import say
from uwtrack_cli.data.recording import Recording


def _option(hint: Any, flag: str, text: str) -> Any:
    return Annotated[hint, typer.Option(flag, help=text)]


HINTS: dict[str, Any] = {
    "sensor": _option(
        Path | None, "--sensor", "Sensor or deployment file; pass.sensor.toml is found."
    ),
    "sensor_sound_speed_mps": _option(
        float | None, "--sound-speed-mps", "Sound speed in m/s, instead of the sensor's."
    ),
    "own_ship": _option(
        Path | None, "--own-ship", "CSV table of the platform's way, instead of the sensor's."
    ),
    "start_utc": _option(
        str | None, "--start-utc", "Time of the first sample, ISO 8601."
    ),
    "time_zone": _option(
        str, "--time-zone", "Zone of times that name none: UTC, Asia/Seoul, +09:00."
    ),
    "time_pattern": _option(
        str | None, "--time-pattern", "How the file name tells the start."
    ),
    "channel": _option(int | None, "--channel", "Channel to take, counted from 1."),
    "start_s": _option(float | None, "--start-s", "Begin here, s from the first sample."),
    "stop_s": _option(float | None, "--stop-s", "End here, s from the first sample."),
    "allow_truncated": _option(
        bool, "--allow-truncated", "Take what is there of a file that ends too early."
    ),
}  # fmt: skip
DEFAULTS: dict[str, Any] = {"time_zone": "UTC", "allow_truncated": False}

SOURCE_PARAMETERS = [
    inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=DEFAULTS.get(name),
        annotation=hint,
    )
    for name, hint in HINTS.items()
]
"""Options of every command that reads sound."""


def with_parameters(
    extra: Sequence[inspect.Parameter],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a function that takes ``**options`` named parameters instead."""

    def named(function: Callable[..., None]) -> Callable[..., None]:
        own = [
            p
            for p in inspect.signature(function).parameters.values()
            if p.kind is not inspect.Parameter.VAR_KEYWORD
        ]
        function.__signature__ = inspect.Signature([*own, *extra])  # type: ignore[attr-defined]
        return function

    return named


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
