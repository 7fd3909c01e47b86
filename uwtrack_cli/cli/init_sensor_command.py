"""`init-sensor`: a sensor file with a comment on every line, to be filled in."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from uwtrack_cli.cli.command_factory import Output, parameter, with_parameters
from uwtrack_cli.cli.console import put, say, say_wrote
from uwtrack_cli.cli.targets import PIPE
from uwtrack_cli.errors import OptionError, OutputError


@dataclass(frozen=True)
class SensorKey:
    """A key of a sensor file, as `init-sensor` writes and asks for it."""

    comment: str
    """What it is, in a few words."""
    example: Any
    """Value that stands behind the comment sign where it is not known."""
    is_asked: bool = False
    """Whether a person is asked for it on a terminal."""


KEYS = {
    "kind": SensorKey(
        "omni: one hydrophone; difar: vector sensor; difar-multiplexed: sonobuoy; array",
        "omni",
        is_asked=True,
    ),
    "channels": SensorKey(
        "channels in the order of the file; - leaves one out", ["omni", "east", "north"]
    ),
    "files": SensorKey("recordings of this sensor, as a pattern", "5482.*.wav"),
    "latitude": SensorKey("degrees, north positive", 35.0, is_asked=True),
    "longitude": SensorKey("degrees, east positive", 128.5, is_asked=True),
    "position_std_m": SensorKey("standard deviation of each coordinate", 10.0),
    "depth_m": SensorKey("depth below the surface, m", 20.0, is_asked=True),
    "depth_std_m": SensorKey("its standard deviation; 0.5 if left out", 0.5),
    "sound_speed_mps": SensorKey("sound speed, m/s; 1500 if left out", 1500.0),
    "sound_speed_std_mps": SensorKey("its standard deviation", 7.5),
    "heading_deg": SensorKey("heading of channels x and y, or of a fixed array", 0.0),
    "compass_std_deg": SensorKey("standard deviation of the compass; 2 if left out", 2.0),
    "declination_deg": SensorKey("for a magnetic compass; east positive", -8.3),
    "clock_std_s": SensorKey("standard deviation of the clock, s", 1.0),
    "element_along_m": SensorKey(
        "line array: place of each hydrophone, positive to the head", [1.0, 0.0, -1.0]
    ),
    "element_positions_m": SensorKey(
        "other arrays: starboard, ahead and up of each hydrophone, m",
        [[0.0, 0.0, 0.8], [0.0, 0.6, 0.0], [0.5, -0.3, 0.0], [-0.5, -0.3, 0.0]],
    ),
    "full_scale_db": SensorKey(
        "level of a full-scale peak, dB re 1 uPa, as recorders quote it", 176.2, is_asked=True
    ),
    "sensitivity_db_re_v_per_upa": SensorKey("or the three terms of it: hydrophone", -165.0),
    "gain_db": SensorKey("gain of the amplifier", 20.0),
    "adc_peak_v": SensorKey("peak voltage at full scale", 1.0),
}
"""Keys in the order of the file."""

STANDARD_INPUT = 0
"""Number of the file that a terminal types into."""

VECTOR = ["omni", "east", "north"]
"""Channels of a vector sensor whose file does not say otherwise."""

PARAMETERS = [
    parameter(
        name, float | None if isinstance(key.example, float) else str | None, None,
        f"{key.comment[0].upper()}{key.comment[1:]}.", panel="What is known of the sensor",
    )
    for name, key in KEYS.items()
]  # fmt: skip
"""An option for every key; lists have commas, positions semicolons between them."""


@with_parameters(PARAMETERS)
def init_sensor(
    identifier: Annotated[str, typer.Argument(metavar="ID")], *, output: Output = None, **given: Any
) -> None:
    """Write a commented sensor file, from options or by asking.

    Without options it asks for each value on a terminal; leave the answer empty if you
    do not know it. Unknown values stay in the file as comments. A file is never
    replaced. With --files it writes an entry of a deployment file, which can be
    appended to one.

    Parameters
    ----------
    identifier
        Identifier of the sensor, such as h1.
    """
    from uwtrack_cli.files.atomic import write_text

    known = {name: value for name, value in given.items() if value is not None}
    if output not in {None, PIPE} and output.exists():
        raise OutputError(
            f"{output} exists already, and init-sensor replaces no file: give another."
        )
    if not known and os.isatty(STANDARD_INPUT):
        known = _asked(identifier)
    text = sensor_file({"id": identifier, **_values(known)})
    if output in {None, PIPE}:
        put(text.splitlines())
        return
    write_text(output, text)
    say_wrote(output)


def sensor_file(table: Mapping[str, Any]) -> str:
    """Return a sensor file with a comment on every line.

    ``table``: the keys that are known, with their values.

    Raises
    ------
    OptionError
        The program would not read the file: a value is wrong, or one is missing.
    """
    from uwtrack_cli.data.options import from_table
    from uwtrack_cli.files.tables.sensors import DeployedSensorTable, SensorTable
    from uwtrack_cli.files.tables.toml_tables import parse_toml

    kind = DeployedSensorTable if "files" in table else SensorTable
    lines = [f"id = {json.dumps(table['id'], ensure_ascii=False)}"]
    for name, key in KEYS.items():
        if name == "files" and name not in table:
            continue
        sign = "" if name in table else "# "
        value = json.dumps(table.get(name, key.example), ensure_ascii=False)
        lines.append(f"{f'{sign}{name} = {value}':<43} # {key.comment}")
    text = "\n".join(lines) + "\n"
    from_table(kind, parse_toml(text), f"sensor {table['id']}")
    return f"[[sensor]]\n{text}" if "files" in table else text


def _values(known: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as a sensor file has them; a vector sensor has its usual channels."""
    found = {name: _value(name, value) for name, value in known.items()}
    if found.get("kind") == "difar":
        found.setdefault("channels", VECTOR)
    return {"kind": KEYS["kind"].example, **found}


def _value(name: str, value: Any) -> Any:
    example = KEYS[name].example
    if not isinstance(example, list):
        return value
    sign = ";" if isinstance(example[0], list) else ","
    parts = [part.strip() for part in value.split(sign)]
    if isinstance(example[0], str):
        return parts
    try:
        if isinstance(example[0], list):
            return [[float(x) for x in part.split(",")] for part in parts]
        return list(map(float, parts))
    except ValueError as error:
        flag = f"--{name.replace('_', '-')}"
        raise OptionError(
            f"{flag} takes numbers with commas between them, got {value!r}."
        ) from error


def _asked(identifier: str) -> dict[str, Any]:
    """Ask a person for the keys that matter most; what is empty is not known."""
    known: dict[str, Any] = {}
    say("An empty answer is not known; it can be filled in later.")
    for name, key in KEYS.items():
        while key.is_asked and name not in known:
            question = f"{name} ({key.comment})"
            answer = typer.prompt(question, default="", show_default=False, err=True)
            if not answer.strip():
                break
            try:
                is_number = isinstance(key.example, float)
                known[name] = _number(answer) if is_number else answer.strip()
                # a latitude is checked before its longitude is asked for
                other = {"longitude": 0.0} if name == "latitude" else {}
                sensor_file({"id": identifier, **_values(known | other)})
            except OptionError as error:
                known.pop(name, None)
                say(f"not accepted: {error}", -1)
    return known


def _number(answer: str) -> float:
    try:
        return float(answer)
    except ValueError as error:
        raise OptionError(f"a number is asked for, got {answer!r}.") from error
