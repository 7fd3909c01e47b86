"""`forecast`: what one platform hears of another, when both ways are known."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from uwtrack_cli.cli.command_factory import AsJson, Overwrite
from uwtrack_cli.cli.console import put, say_wrote
from uwtrack_cli.errors import OptionError


def forecast(
    *,
    own: Annotated[
        Path, typer.Argument(help="Track of own ship: CSV table or REP.")
    ],
    target: Annotated[
        Path, typer.Argument(help="Way of the target; may be the same REP file.")
    ],
    names: Annotated[
        tuple[str, str] | None,
        typer.Option(help="Names of own track and the target's in REP files of several."),
    ] = None,
    rest_frequency_hz: Annotated[
        list[float] | None,
        typer.Option(help="Tone of the target at rest in Hz; may repeat."),
    ] = None,
    every_s: Annotated[float, typer.Option(help="Interval of the rows in s.")] = 10.0,
    sound_speed_mps: Annotated[
        float, typer.Option(help="Sound speed in m/s.")
    ] = 1500.0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="CSV table to write, as tma reads it."),
    ] = None,
    overwrite: Overwrite = False,
    json_output: AsJson = False,
) -> None:  # fmt: skip
    """Forecast bearing and Doppler of a target along two known tracks.

    Prints a table of bearings and frequencies over time; --json adds ranges.
    """
    from uwtrack_cli.files.atomic import check_target, write_text
    from uwtrack_cli.flow.forecast import forecast_tracks, table_lines

    tones = rest_frequency_hz or []
    _check(tones, every_s, sound_speed_mps)
    if output is not None:
        check_target(output, overwrite=overwrite)
    rows = forecast_tracks(
        (own, target), names, rest_frequencies_hz=tones, every_s=every_s,
        sound_speed_mps=sound_speed_mps,
    )  # fmt: skip
    if output is not None:
        write_text(output, "\n".join(table_lines(rows)) + "\n", overwrite=overwrite)
    if json_output:
        put([json.dumps([asdict(row) for row in rows])])
    elif output is None:
        put(table_lines(rows))
    if output is not None:
        say_wrote(output)


def _check(tones: list[float], every_s: float, sound_speed_mps: float) -> None:
    """Refuse numbers that no forecast can use.

    Raises
    ------
    OptionError
        An option is out of range.
    """
    limits = [
        ("--every-s", every_s, 1e-3, 1e6),
        ("--sound-speed-mps", sound_speed_mps, 100.0, 299_792_458.0),
        *(("--rest-frequency-hz", tone, 1e-3, 1e9) for tone in tones),
    ]
    for flag, value, low, high in limits:
        if not low <= value <= high:
            msg = f"{flag} must be {low:g} to {high:g}, got {value:g}."
            raise OptionError(msg)
