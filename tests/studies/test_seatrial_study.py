"""The sea trial through the whole chain, against the stated bands."""

import numpy as np
import pytest

from studies.rows import load_reference
from studies.seatrial import RANGE_M, SPEED_MPS, study_seatrial, trial_errors

CASES = {case["name"]: case for case in load_reference("seatrial")["cases"]}
BANDS = {"clean": (0.015, 0.03, 1.0, 1.5), "weak": (0.04, 0.08, 2.0, 3.0)}


@pytest.mark.long
@pytest.mark.parametrize("name", BANDS)
def test_errors_of_one_recording_are_within_the_acceptance_band(name):
    error = np.abs(trial_errors(CASES[name], 5))
    speed, reach, time, course = BANDS[name]
    assert error[0] <= speed * SPEED_MPS
    assert error[1] <= reach * RANGE_M
    assert error[2] <= time
    assert error[3] <= course


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_root_mean_squares_are_those_of_the_independent_robust_fit():
    study = study_seatrial(runs=6, seed=2)
    for row in study.rows:
        if row.quantity.endswith("error") and row.reference is not None:
            assert row.low <= 1.5 * row.reference
    percent = [row for row in study.rows if "%" in row.quantity]
    assert all(row.ours < row.reference / 5 for row in percent)
