"""`forecast`: what one platform hears of another, when both ways are known."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from uwtrack_cli.cli.command_factory import AsJson, Output, Overwrite
from uwtrack_cli.cli.console import put, say_wrote
from uwtrack_cli.data.options import AtLeast, AtMost, Unit
from uwtrack_cli.data.sensor import SoundSpeed

Tone = Annotated[float, Unit("Hz"), AtLeast(1e-3), AtMost(1e9)]
"""Rest frequency of a tone."""


def forecast(
    own: Path,
    target: Path,
    *,
    names: tuple[str, str] | None = None,
    rest_frequency_hz: list[Tone] | None = None,
    every_s: Annotated[float, Unit("s"), AtLeast(1e-3), AtMost(1e6)] = 10.0,
    sound_speed_mps: SoundSpeed = 1500.0,
    output: Output = None,
    overwrite: Overwrite = False,
    json_output: AsJson = False,
) -> None:
    """Forecast bearing and Doppler of a target along two known tracks.

    Prints a table of bearings and frequencies over time; --json adds ranges.

    Parameters
    ----------
    own
        Track of own ship: CSV table or REP.
    target
        Way of the target; may be the same REP file.
    names
        Names of own track and the target's in REP files of several.
    rest_frequency_hz
        Tone of the target at rest in Hz; may repeat.
    every_s
        Interval of the rows in s.
    sound_speed_mps
        Sound speed in m/s.
    output
        CSV table to write, as tma reads it.
    """
    from uwtrack_cli.files.atomic import check_target, write_text
    from uwtrack_cli.flow.forecast import forecast_tracks, table_lines

    tones = rest_frequency_hz or []
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
