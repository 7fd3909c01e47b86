"""What fringes add to a line: errors of a passage by levels, by a line, and by both.

Draws the sound of `fringe_sounds` with one line of 30 dB in 1 Hz at the closest approach,
deep and shallow by turns, makes lines, levels and fringes of it, and prints for each time,
range over speed, speed, range and depth of the source that levels alone, line and levels,
and all of them tell, over the truth, with their deviations:
python -m tests.draws.fringe_lines 6000 6010
"""

import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from tests.draws.fringe_sounds import draw, scene
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.flow.results import run
from uwtrack_cli.motion.cpa import find_encounters

RECIPE = """
[spectrogram]
window_s = 1.0
band_hz = [10.0, 2000.0]
[levels]
output = true
[peaks]
[track]
output = true
[fringe-spectrogram]
stage = "spectrogram"
window_s = 0.5
zero_padding = 1
band_hz = [40.0, 7000.0]
[fringes]
input = "fringe-spectrogram"
output = true
"""
COLUMNS = ("range_over_speed_s", "speed_mps", "slant_range_m", "source_depth_m")


def main(first: int, last: int, say: Callable[[str], None]) -> None:
    """Print what is told of draws."""
    for seed in range(first, last):
        is_deep = seed % 2 == 0
        drawn, ship = draw(seed, is_deep=is_deep, line_db=30.0)
        sensor_m = scene(seed, is_deep=is_deep)[2].sensor_m
        with tempfile.TemporaryDirectory() as name:
            recipe, path = Path(name, "recipe.toml"), Path(name, "draw.wav")
            recipe.write_text(RECIPE, encoding="utf-8")
            drawn.write(path)
            made = run(path, recipe=recipe)
        lines, levels, fringes = (made[name] for name in ("lines", "levels", "fringes"))
        slant_m = ship.slant_m(sensor_m)
        truth = (slant_m / ship.speed_mps, ship.speed_mps, slant_m, ship.depth_m)
        sensor = Sensor(id="h1", depth_m=sensor_m, depth_std_m=0.5)
        ask = partial(find_encounters, sensor=sensor)
        for kind, table in (
            ("levels", ask(levels=levels)),
            ("line", ask(lines=lines, levels=levels)),
            ("all", ask(lines=lines, levels=levels, fringes=fringes)),
        ):
            told = _told(table, ship.time_s, truth)
            say(f"{seed} deep={is_deep} {kind}: {told}")


def _told(table: Encounters, time_s: float, truth: tuple[float, ...]) -> str:
    """Return a row's values over the truth, with deviations; of the nearest row."""
    off_s = np.abs(table.time_s - time_s)
    if not off_s.size or off_s.min() > truth[0]:
        return "none"
    row = int(off_s.argmin())
    parts = [f"{table.status[row]}, time {table.time_s[row] - time_s:+.2f} s"]
    for name, true in zip(COLUMNS, truth, strict=True):
        value = getattr(table, name)[row] / true
        quantity, unit = name.rsplit("_", 1)
        std = getattr(table, f"{quantity}_std_{unit}")
        parts.append(f"{name} {value:.3f} ± {std[row] / true:.3f}")
    return ", ".join(parts)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), partial(print, flush=True))
