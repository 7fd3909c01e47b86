"""Where the constants of levels in air come from: drawn vehicles of a simulator of its own.

Draws cars, lorries, motorbikes and cars that change gear (tests/draws/vehicle_sounds.py:
directivity of up to 3 dB, a ground that reflects, wind, hum, clipping), measures the
levels that recipe `vehicle` measures about the closest approach, and fits a passage to
them alone. Prints, over the draws whose level tells a passage,

* how late the level is, as a share of the shorter d/v, and its d/v over the true one, by
  quantiles;
* errors of time and of ln d/v in stated deviations, before and after the patterns of
  `directivity` are considered: those of `source_patterns` (`AHEAD_STD_DB`, ...) are
  right where the root mean square is one, too small above.

Its numbers are draws of each kind and the first seed; a draw takes five seconds of CPU:
python -m studies.constants.vehicle_levels 3 171000
"""

import sys
import tempfile
import warnings
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from tests.draws.vehicle_sounds import SOUND_MPS, SPEEDS_MPS, recording_file
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.flow.engine import Engine, MemorySink, context_of
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.motion.passage.candidates import examine
from uwtrack_cli.motion.passage.fit.directivity import consider_directivity
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors
from uwtrack_cli.motion.passage.model.measurements import contact_data

KINDS = ("car", "lorry", "motorbike", "gear")
REACH_S = 10.0
"""Sound to either side of the closest approach, as `zoom` looks at it."""

NEAR = 2.0
"""d/v, and factors of it, beyond which a fit is of something else, such as a gust."""

SHARES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


class Told(NamedTuple):
    """What the level of a drawn passage tells."""

    late: float
    """Time of the level less that of arrival, over the shorter d/v."""
    ratio: float
    """d/v of the level over the true one."""
    before: tuple[float, float]
    """Errors of time and ln d/v in deviations of the fit."""
    after: tuple[float, float]
    """The same with the patterns considered."""


def levels_about(path: Path, time_s: float) -> tuple[Levels, float]:
    """Return the levels about an instant of a recording, and where they begin, s."""
    sensor = Sensor(id="h1", sound_speed_mps=SOUND_MPS)
    start_s = max(0.0, time_s - REACH_S)
    recording = open_recording(
        path, sensor=sensor, channel=1, start_s=start_s,
        stop_s=min(time_s + REACH_S, open_recording(path, channel=1).duration_s),
    )  # fmt: skip
    graph = load_recipe("vehicle").graph().part(["levels"]).resolved(recording)
    sink = MemorySink()
    Engine(graph, context_of(recording), sink).run_recording(recording)
    (last,) = [step for step in graph.steps() if step.stage.output is Levels]
    return cast("Levels", sink.read(last)), start_s


def told_of(rng: np.random.Generator, kind: str, path: Path) -> Told | None:
    """Draw a passage and fit its level; None where it tells none near the true one."""
    (truth,) = recording_file(rng, kind, path)
    levels, start_s = levels_about(path, truth.time_s)
    sensor = Sensor(id="h1", sound_speed_mps=SOUND_MPS)
    medium = nuisance_priors(sensor, None, None, 3.0, 2.0).medium
    data, no_line = contact_data(None, levels, ()), np.empty(0, np.int64)
    found = examine(data, (1,), no_line, medium, 1e-3)
    if found is None:
        return None
    width_s = truth.range_m / truth.speed_mps
    own_s = float(found.fit.range_over_speed_s[0])
    off_s = start_s + float(found.fit.theta[0, 0]) - truth.time_s
    off_s -= truth.range_m / SOUND_MPS
    ratio = own_s / width_s
    if abs(off_s) > NEAR * width_s or not 1 / NEAR**2 < ratio < NEAR**2:
        return None
    wider = consider_directivity(found.fit, found.blocks)
    errors = []
    for fit in (found.fit, wider):
        deviation = np.sqrt(np.diag(fit.covariance[0])[:2]) / (1.0, own_s)
        errors.append(tuple(np.array([off_s, np.log(ratio)]) / deviation))
    return Told(off_s / min(width_s, own_s), ratio, *errors)


def told(name: str, values: list[float]) -> str:
    """Tell quantiles."""
    words = ", ".join(f"{value:.2f}" for value in np.quantile(values, SHARES))
    return f"{name} at {', '.join(map(str, SHARES))}: {words}\n"


def main(count: int, seed: int) -> None:
    """Print what the levels of so many draws of each kind tell."""
    warnings.simplefilter("ignore")
    found: list[Told] = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            for number in range(seed, seed + count):
                rng = np.random.default_rng([number, list(SPEEDS_MPS).index(kind)])
                one = told_of(rng, kind, Path(folder) / "drawn.wav")
                found += [one] if one is not None else []
    out = sys.stdout
    out.write(f"{len(found)} of {count * len(KINDS)} levels tell the passage.\n")
    out.write(told("late / shorter d/v", [one.late for one in found]))
    out.write(told("d/v / true d/v", [one.ratio for one in found]))
    for name in ("before", "after"):
        errors = np.array([getattr(one, name) for one in found])
        rms = np.sqrt(np.median(errors**2, axis=0) / 0.455)
        beyond = (np.abs(errors) > 2.5).mean(axis=0)
        out.write(
            f"errors {name}: robust root mean square {rms[0]:.2f} (time), {rms[1]:.2f} "
            f"(ln d/v); beyond 2.5 deviations {beyond[0]:.2f}, {beyond[1]:.2f}\n"
        )


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3]))
