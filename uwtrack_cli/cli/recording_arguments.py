"""How a recording is named at the shell: its sensor, its start, its span."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from uwtrack_cli.cli.console import say
from uwtrack_cli.data.recording import Recording


def parameters_of(
    options: Mapping[str, tuple[Any, Any, str]],
    flags: Mapping[str, str] | None = None,
    *,
    panel: str | None = None,
) -> list[inspect.Parameter]:
    """Return options that several commands have as parameters of their functions.

    ``options``: type, default and help by name. ``flags``: flags that are not called
    like their options. ``panel``: title under which the help lists them.
    """
    named = {name: f"--{name.replace('_', '-')}" for name in options} | dict(
        flags or {}
    )
    return [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=default,
            annotation=Annotated[
                hint, typer.Option(named[name], help=text, rich_help_panel=panel)
            ],
        )
        for name, (hint, default, text) in options.items()
    ]


SOURCE_PARAMETERS = parameters_of({
    "sensor": (
        Path | None, None, "Sensor or deployment file; by default pass.sensor.toml "
        "beside pass.wav."
    ),
    "sensor_sound_speed_mps": (
        float | None, None, "Sound speed in m/s, instead of that in the sensor file."
    ),
    "own_ship": (
        Path | None, None, "CSV table of own ship's track, instead of that in the sensor "
        "file."
    ),
    "start_utc": (str | None, None, "Time of the first sample, ISO 8601."),
    "time_zone": (str, "UTC", "Zone of times that are given without one: UTC, "
    "Asia/Seoul, +09:00."),
    "time_pattern": (str | None, None, "Where the start time is in the file name, such "
    "as %Y%m%d_%H%M%S."),
    "channel": (int | None, None, "Channel to use, counted from 1."),
    "start_s": (float | None, None, "Begin here, in s from the first sample."),
    "stop_s": (float | None, None, "End here, in s from the first sample."),
    "allow_truncated": (
        bool, False, "Use a file that ends too early as far as it goes."
    ),
}, {"sensor_sound_speed_mps": "--sound-speed-mps"}, panel="Recording")  # fmt: skip
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
