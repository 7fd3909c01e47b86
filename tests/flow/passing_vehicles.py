"""Recipe `auto` on vehicles of a simulator that shares nothing with the program's.

Its numbers are draws of each kind and the first seed, and kinds may follow. Prints each
draw with its rows, and a table in Markdown; a draw takes some seconds:
python -m tests.flow.passing_vehicles 2 5000 car aircraft
"""

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from tests.flow.vehicle_sounds import SOUND_MPS, SPEEDS_MPS, recording_file
from uwtrack_cli.cli.app import app

DEVIATIONS = 2.5
"""Deviations beyond which a row is false."""


def say(*words):
    """Print words at once."""
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def verdict(row, truth):
    """Return 'right' or why a row is false, and the passage that it tells."""
    near = [one for one in truth if abs(row["time_s"] - one.time_s) <
            max(2 * one.range_m / one.speed_mps, 1.5)]  # fmt: skip
    if not near:
        return "false: nothing passes", None
    one = min(near, key=lambda it: abs(row["time_s"] - it.time_s))
    told = (("time_s", one.time_s, "time_std_s"), ("speed_mps", one.speed_mps, "speed_std_mps"),
            ("range_over_speed_s", one.range_m / one.speed_mps, "range_over_speed_std_s"))  # fmt: skip
    off = [
        abs(row[name] - due) / row[std]
        for name, due, std in told
        if row[name] is not None
    ]
    return (
        "right" if max(off) < DEVIATIONS else f"false: {max(off):.1f} deviations"
    ), one


def main(count, first_seed, *kinds, recipe="auto"):
    """Print every draw with its rows, and the table."""
    tables = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind in kinds or SPEEDS_MPS:
            counts = tables[kind] = Counter()
            for seed in range(first_seed, first_seed + count):
                rng = np.random.default_rng([seed, list(SPEEDS_MPS).index(kind)])
                path = Path(folder) / "drawn.wav"
                truth = recording_file(rng, kind, path)
                words = [] if kind == "ship" else ["--sound-speed-mps", str(SOUND_MPS)]
                done = CliRunner().invoke(app, [
                    "run", str(path), "--recipe", recipe, "-o", str(path.with_suffix(".h5")),
                    "--overwrite", "--json", "--quiet", *words,
                ])  # fmt: skip
                assert done.exit_code == 0, done.stderr
                say(kind, seed, *truth)
                counts["passages"] += len(truth)
                found, near = set(), set()
                for row in json.loads(done.stdout):
                    said, one = verdict(row, truth)
                    if said == "right" and one in found:
                        said = "false: told twice"
                    near |= {one} - {None}
                    found |= {one} if said == "right" else set()
                    has_speed = "speed" if row["speed_mps"] is not None else "level"
                    counts[f"{said.split(':')[0]} {has_speed}"] += 1
                    told = ("status", "time_s", "time_std_s", "range_over_speed_s",
                            "range_over_speed_std_s", "speed_mps", "speed_std_mps")  # fmt: skip
                    say("   ", said, *(row[name] for name in told))
                if kind == "ship":
                    shown = CliRunner().invoke(
                        app, ["show", str(path.with_suffix(".h5")), "presence"]
                    )
                    say(shown.stdout)
                counts["missed"] += len(truth) - len(near)
    columns = (
        "passages",
        "right speed",
        "right level",
        "false speed",
        "false level",
        "missed",
    )
    say("| kind |", *(f"{name} |" for name in columns))
    for kind, counts in tables.items():
        say(f"| {kind} |", *(f"{counts[name]} |" for name in columns))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
