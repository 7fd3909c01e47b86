"""The sea trial: recordings that match the paper's, through the whole chain.

**Method.** A vessel passes a vector sensor at 6 m/s, 250 m abeam; the recordings are
simulated, analysed by the recipe for vessels, and the errors of speed, range, time and
course are set beside those of an independent robust fit and of the trial itself.

**Conventions.** Figures are root-mean-square errors, and for the clean case the mean
absolute errors in percent beside the trial's. Intervals of 95 % from the scatter.

**References.** Choi et al. (2014), section 4.2: errors of 5.3 % in speed and 9.8 % in
range against AIS.
"""

from typing import Any

import numpy as np

from studies.rows import load_reference, mean_row, normal_root_row
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.study import Study, StudyRow
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import Scenario, make_scenario, simulate_recordings

SPEED_MPS, RANGE_M, COURSE_DEG, TIME_S = 6.0, 250.0, 81.0, 300.0
DEPTH_M, SOURCE_DEPTH_M, DURATION_S, RATE_HZ = 22.0, 3.0, 600.0, 3200.0
LINES_HZ = (63.0, 126.0, 189.0, 310.0)


def study_seatrial(*, runs: int = 6, seed: int = 1) -> Study:
    """Set the errors of the whole chain beside those of the paper's sea trial.

    ``runs``: recordings per case.
    """
    reference = load_reference("seatrial")
    rows: list[StudyRow] = []
    for number, case in enumerate(reference["cases"]):
        errors = np.array(
            [
                trial_errors(case, int(child))
                for child in np.random.SeedSequence([seed, number]).generate_state(runs)
            ]
        )
        rows += [
            normal_root_row(
                case["name"],
                f"{quantity}, error",
                known,
                float(np.sqrt((errors[:, column] ** 2).mean())),
                runs,
            )
            for column, (quantity, known) in enumerate(
                zip(reference["order"], case["rmse"], strict=True)
            )
        ]
        if number == 0:
            rows += _percent_rows(errors, reference["trial"])
    remarks = (
        "one-second frames; the reference tracks its lines with their frequencies given",
        "nan: no closest approach was found in one of the recordings",
        "the trial's own errors hold those of AIS and of its envelope model",
    )
    return Study("seatrial", reference["source"], runs, seed, tuple(rows), remarks)


def trial_scenario(case: dict[str, Any], seed: int) -> Scenario:
    """Describe a recording like the trial's.

    ``case``: C/N0, in-band ratio, surface image and frequency jitter.
    """
    vessel = {
        "source_depth_m": SOURCE_DEPTH_M,
        "surface_image": case["surface_image"],
        "closest_approach": {
            "time_s": TIME_S,
            "horizontal_range_m": RANGE_M,
            "speed_mps": SPEED_MPS,
            "course_deg": COURSE_DEG,
            "side": "port",
        },
        "line": [
            {"frequency_hz": frequency, "cn0_db_hz": float(case["cn0_db_hz"])}
            for frequency in LINES_HZ
        ],
        "frequency_jitter": {"fraction": case["frequency_jitter"]},
        "broadband": {"band_hz": [100.0, 1500.0], "snr_db": float(case["snr_db"])},
    }
    table = {
        "seed": seed,
        "duration_s": DURATION_S,
        "sample_rate_hz": RATE_HZ,
        "sensor": [{"id": "h1", "kind": "difar", "depth_m": DEPTH_M, "full_scale_db": 170.0}],
        "vessel": [vessel],
        "noise": {"density_db": 70.0, "slope_db_per_decade": 0.0},
    }
    return make_scenario(table)


def analyse(scenario: Scenario, recipe: str = "vessel") -> list[Encounters]:
    """Run the chain over every recording of a scenario."""
    chain = load_recipe(recipe)
    return [
        made
        for recording in simulate_recordings(scenario)
        for made in run_recipe(recording, chain)
        if isinstance(made, Encounters)
    ]


def trial_errors(case: dict[str, Any], seed: int) -> FloatArray:
    """Return errors of speed, slant range, time and course; nan if nothing passed."""
    found = analyse(trial_scenario(case, seed))[0]
    near = np.flatnonzero(np.isfinite(found.speed_mps))
    if near.size != 1:
        return np.full(4, np.nan)
    row = near[0]
    slant = np.hypot(RANGE_M, DEPTH_M - SOURCE_DEPTH_M)
    return np.array(
        [
            found.speed_mps[row] - SPEED_MPS,
            found.slant_range_m[row] - slant,
            found.time_s[row] - TIME_S,
            float(wrap_deg(found.course_deg[row] - COURSE_DEG)),
        ]
    )


def _percent_rows(errors: FloatArray, trial: dict[str, float]) -> list[StudyRow]:
    """Mean absolute errors in percent beside those of the trial."""
    truth = {"speed_percent": SPEED_MPS, "range_percent": RANGE_M}
    rows = []
    for column, (key, value) in enumerate(truth.items()):
        rows += mean_row(
            "clean, beside the trial at sea",
            f"{key.split('_')[0]}, error (%)",
            trial[key],
            100 * np.abs(errors[:, column]) / value,
        )
    return rows
