"""The study's section B: trackers with and without feedback, over scenes.

**Method.** The reference lists scenes, settings and the figures that are known of them;
each is run again here. All settings see the same scenes.

**References.** Choi (2014), figures 6-9; specification, sections B.1 to B.5.
"""

from collections.abc import Iterator
from dataclasses import astuple, fields
from functools import cache
from typing import Any

import numpy as np

from uwtrack_cli.flow.studies.line_rows import mean_row
from uwtrack_cli.flow.studies.line_runs import run_figures
from uwtrack_cli.flow.studies.line_scene import SceneRule
from uwtrack_cli.flow.studies.line_tally import RunFigures
from uwtrack_cli.flow.studies.table import StudyRow

QUANTITIES = {
    "association": "association %",
    "loud_association": "loud association %",
    "coverage": "coverage %",
    "frequency_mse": "frequency MSE Hz^2",
    "penalised_mse": "same, missed 9 Hz^2",
    "bearing_mse": "bearing MSE deg^2",
    "fused_mse": "fused MSE deg^2",
    "lines_told": "lines told per run",
    "breaks": "breaks per line",
    "false_lines": "false per frame",
    "tentative": "tentative per frame",
}
"""What a figure of `RunFigures` is called in the table."""

_FEWEST_RUNS = 2
_SEED_STEP = 1_000_003


def tracking_rows(
    cases: list[dict[str, Any]], runs: int, seed: int
) -> Iterator[StudyRow]:
    """Run the trackers over all scenes of the reference.

    Parameters
    ----------
    cases
        Scenes with their settings and known figures.
    runs
        Runs of a scene; some scenes take a stated share of them.
    seed
        Seed of all random numbers.
    """
    names = [field.name for field in fields(RunFigures)]
    for case in cases:
        rule = SceneRule(**case["scene"])
        count = max(round(case["share_of_runs"] * runs), _FEWEST_RUNS)
        for setting, known in case["settings"].items():
            table = np.array(
                [astuple(_run(setting, rule, _SEED_STEP * seed + k))
                 for k in range(count)]
            )  # fmt: skip
            for name, value in known.items():
                yield from mean_row(
                    f"{case['section']} {case['case']}, {setting}",
                    QUANTITIES[name], value, table[:, names.index(name)],
                )  # fmt: skip


@cache
def _run(setting: str, rule: SceneRule, seed: int) -> RunFigures:
    """Run once what several sections ask for."""
    return run_figures(setting, rule, seed)
