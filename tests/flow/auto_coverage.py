"""Coverage of the rows of recipe `auto`: errors on drawn passages in stated deviations.

Passages of `random_passages` pass one omni or DIFAR sensor: without a disturbance, with
drawn ones, and overhead, with drawn ones, too. What a recording's sensor file tells is
not exact: its depth, the sound speed and the compass are drawn about the true ones, with
the deviations that it states. A row is right where the truth lies within 1.96 deviations;
the mean square of the errors in deviations is one where these are honest, and its exact
95 % interval for so many rows (chi-square) tells too wide ones from too narrow ones.
Prints Markdown and every row; its numbers are passages of each class and the first seed,
and classes may follow; a passage takes a quarter of a minute of CPU:
python -m tests.flow.auto_coverage 12 220000
"""

import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from tests.flow.auto_scores import in_memory, passages
from tests.motion.nuisance_coverage import interval
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import Scenario
from uwtrack_cli.simulate.random_passages import draw_scenario

RATE_HZ, LENGTH_S = 4000.0, 480.0
DEPTH_STD_M, SOUND_STD_MPS, COMPASS_STD_DEG = 0.5, 7.5, 2.0
NEAREST_M = 5.0
CLASSES = ("quiet", "disturbed", "overhead")
COLUMNS = (
    "time{}_s",
    "range_over_speed{}_s",
    "speed{}_mps",
    "slant_range{}_m",
    "course{}_deg",
)
NAMES = ("time", "d/v", "speed", "slant range", "course")


class Scored(NamedTuple):
    """What came of one passage."""

    kind: str
    """Its class."""
    seed: int
    """Its seed."""
    status: str
    """Status of its row; empty where it has none."""
    error: np.ndarray
    """Errors in stated deviations in the order of `NAMES`; nan where nothing is given."""
    n_false: int
    """Rows beside it."""


def of_class(kind: str, count: int, seed: int) -> Iterator[tuple[int, Scenario]]:
    """Draw passages of a class from a seed on."""
    while count:
        scenario = draw_scenario(
            seed, n_vessels=1, kinds=() if kind == "quiet" else None,
            sample_rate_hz=RATE_HZ, duration_s=LENGTH_S,
        )  # fmt: skip
        nearest = scenario.vessels[0].closest_approach.horizontal_range_m
        if (nearest < NEAREST_M) == (kind == "overhead"):
            count -= 1
            yield seed, scenario
        seed += 1


def told(recording: Recording, seed: int) -> Recording:
    """Return a recording whose sensor is told with the errors that it states."""
    rng = np.random.default_rng([seed, 4])
    own = recording.sensor
    sensor = replace(
        own, depth_m=own.depth_m + DEPTH_STD_M * rng.normal(), depth_std_m=DEPTH_STD_M,
        sound_speed_mps=own.sound_speed_mps + SOUND_STD_MPS * rng.normal(),
        sound_speed_std_mps=SOUND_STD_MPS, compass_std_deg=COMPASS_STD_DEG,
        compass_offset_deg=COMPASS_STD_DEG * rng.normal(),
    )  # fmt: skip
    return replace(recording, sensor=sensor)


def score(kind: str, seed: int, scenario: Scenario) -> Scored:
    """Hold the row of `auto` that is next to a passage against it."""
    ((time_s, width_s, speed_mps),) = passages(scenario)
    plan = scenario.vessels[0].closest_approach
    truth = np.array([time_s, width_s, speed_mps, width_s * speed_mps, plan.course_deg])
    made = run_recipe(told(in_memory(scenario), seed), load_recipe("auto"))
    table = next(item for item in made if isinstance(item, Encounters))
    off_s = np.abs(table.time_s - time_s)
    near = np.flatnonzero(off_s < max(1.0, width_s))
    order = np.lexsort((off_s[near], table.status[near] == "level-only"))
    if not near.size:
        return Scored(kind, seed, "", np.full(truth.size, np.nan), table.n_encounters)
    row = int(near[order[0]])
    value, std = (
        np.array([getattr(table, name.format(part))[row] for name in COLUMNS])
        for part in ("", "_std")
    )
    error = value - truth
    error[4] = (error[4] + 180.0) % 360.0 - 180.0
    return Scored(
        kind, seed, str(table.status[row]), error / std, table.n_encounters - 1
    )


def lines_of(kind: str, scored: list[Scored]) -> Iterator[str]:
    """Yield the rows of a class."""
    for place, name in enumerate(NAMES):
        error = np.array([one.error[place] for one in scored])
        error = error[np.isfinite(error)]
        if not error.size:
            continue
        hits = int((np.abs(error) <= 1.96).sum())
        low, high = interval(hits, error.size)
        least, most = chi2.ppf([0.025, 0.975], error.size) / error.size
        yield (
            f"| {kind} | {name} | {error.size} of {len(scored)} | {hits} "
            f"({100 * low:.0f} to {100 * high:.0f} %) | {np.mean(error**2):.2f} "
            f"| {least:.2f} to {most:.2f} |"
        )


def main(count: int, seed: int, kinds: list[str]) -> None:
    """Print the table and every row."""
    warnings.simplefilter("ignore")
    out, every = sys.stdout, []
    for kind in kinds:
        for number, scenario in of_class(kind, count, seed):
            every.append(score(kind, number, scenario))
            words = ", ".join(
                f"{name} {error:.2f}"
                for name, error in zip(NAMES, every[-1].error, strict=True)
                if np.isfinite(error)
            )
            one = every[-1]
            out.write(
                f"{kind} {number}: {one.status or 'none'}, {words}; {one.n_false} false\n"
            )
            out.flush()
    out.write(
        "\n| class | quantity | given | within 1.96 deviations | mean square "
        "| of honest deviations |\n|---|---|---|---|---|---|\n"
    )
    for kind in [*kinds, "all"]:
        part = [one for one in every if kind in (one.kind, "all")]
        out.write("\n".join(lines_of(kind, part)) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:] or list(CLASSES))
