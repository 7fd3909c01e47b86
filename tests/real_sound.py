"""Every real recording with every shipped recipe, in one table.

Reads the folder in UWTRACK_REAL_DATA and prints Markdown, in some minutes:
UWTRACK_REAL_DATA=FOLDER python -m tests.real_sound > tests/baselines/real_sound.md
"""

import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from typer.testing import CliRunner

from uwtrack_cli.cli.app import app
from uwtrack_cli.flow.shipped_recipes import shipped_recipes


class Known(NamedTuple):
    """A real recording and what is known of it."""

    pattern: str
    """Its file below the folder."""
    known: str
    """What is known, in words."""
    words: tuple[str, ...] = ()
    """Options that it is run with."""
    time_s: float | None = None
    """Closest approach; None where nothing may be claimed."""
    speed_mps: float | None = None
    """Speed, where it is known and can be heard."""
    width_s: float | None = None
    """Range over speed."""


AIR = ("--sound-speed-mps", "343")
RECORDINGS = (
    Known("train/*.wav", "34.1 m/s at 9.60 s", AIR, 9.60, 34.1),
    Known("cars/*.wav", "0.45 s range over speed, no line", AIR, None, None, 0.45),
    Known("ships/kennicott*.wav", "no closest approach"),
    Known("ships/nave*.wav", "no closest approach"),
    Known("ships/ruby*.wav", "no closest approach"),
    Known("orcasound/*.flac", "electrical hum, no vessel"),
    Known("array/*.wav", "four microphones, first channel: no vessel", AIR),
    Known("array/*.wav", "four microphones, with their places: no vessel",
          (*AIR, "--sensor", "{array}")),
)  # fmt: skip

DEVIATIONS = 3.0
"""Deviations beyond which a row is false."""


def array_sensor(folder: Path, target: Path) -> None:
    """Write the sensor file of the infrasound array from its table of places."""
    (path,) = (folder / "array").glob("*.positions.csv")
    places = np.loadtxt(path, delimiter=",", skiprows=1)
    rows = [[float(east), float(north), 0.0] for _, east, north in places]
    names = [f"e{number}" for number in range(1, len(rows) + 1)]
    target.write_text(
        f'id = "array"\nkind = "array"\nchannels = {json.dumps(names)}\n'
        f"element_positions_m = {json.dumps(rows)}\nheading_deg = 0.0\n"
        "depth_m = 0.0\nsound_speed_mps = 343.0\n"
    )


def verdict(row: dict[str, object], known: Known) -> str:
    """Tell whether a row is right, by what is known of its recording."""
    truths = (("time_s", known.time_s, "time_std_s"),
              ("speed_mps", known.speed_mps, "speed_std_mps"),
              ("range_over_speed_s", known.width_s, "range_over_speed_std_s"))  # fmt: skip
    checked = [
        abs(float(str(row[name])) - truth) / float(str(row[std]))
        for name, truth, std in truths
        if truth is not None and row[name] is not None
    ]
    if known.speed_mps is None and row["speed_mps"] is not None:
        return "FALSE"
    if not checked:
        return "FALSE"
    return "right" if max(checked) < DEVIATIONS else "FALSE"


def told(row: dict[str, object], known: Known) -> str:
    """Write a row of encounters into a cell."""
    speed = "no speed"
    if row["speed_mps"] is not None:
        speed = f"{row['speed_mps']:.1f} ± {row['speed_std_mps']:.1f} m/s"
    evidence = row.get("rest_frame_evidence")
    heard = "" if evidence is None else f", evidence {evidence:.2f}"
    return (
        f"{verdict(row, known)}: `{row['status']}`, {speed}, "
        f"{row['range_over_speed_s']:.2f} ± {row['range_over_speed_std_s']:.2f} s"
        f" at {row['time_s']:.2f} s{heard}"
    )


def cell(path: Path, recipe: str, known: Known, array: Path) -> tuple[str, float]:
    """Run a recording, and return what came out and the seconds of CPU it took."""
    words = [word.format(array=array) for word in known.words]
    begin = time.process_time()
    done = CliRunner().invoke(
        app,
        ["run", str(path), "--recipe", recipe, "-o", str(array.with_suffix(".h5")),
         "--overwrite", "--json", "--quiet", *words],
    )  # fmt: skip
    cost = time.process_time() - begin
    if done.exit_code:
        return f"refused: {done.stderr.strip().splitlines()[-1]}", cost
    rows = json.loads(done.stdout)
    if rows and "speed_mps" not in rows[0]:
        return f"{len(rows)} rows of another kind", cost
    return "; ".join(told(row, known) for row in rows) or "none", cost


def main(*wanted: str) -> None:
    """Print the table, of all recipes unless some are named."""
    folder = Path(os.environ["UWTRACK_REAL_DATA"])
    out = sys.stdout
    out.write(
        "# Real recordings with every shipped recipe\n\n"
        "Made by `UWTRACK_REAL_DATA=FOLDER python -m tests.real_sound`. A row is right"
        f" when what is known lies\nwithin {DEVIATIONS:g} of its standard deviations,"
        " else FALSE. CPU is user time of one run.\n\n"
        "| recording | known | recipe | found | CPU s |\n|---|---|---|---|---|\n"
    )
    with tempfile.TemporaryDirectory() as temporary:
        array = Path(temporary) / "array.sensor.toml"
        array_sensor(folder, array)
        for known in RECORDINGS:
            (path,) = folder.glob(known.pattern)
            for recipe in wanted or shipped_recipes():
                found, cost = cell(path, recipe, known, array)
                out.write(
                    f"| {path.parent.name} ({path.stem[:12]}) | {known.known} "
                    f"| `{recipe}` | {found} | {cost:.1f} |\n"
                )
                out.flush()


if __name__ == "__main__":
    if not os.environ.get("UWTRACK_REAL_DATA"):
        sys.exit("UWTRACK_REAL_DATA is not set: give the folder of real recordings.")
    main(*sys.argv[1:])
