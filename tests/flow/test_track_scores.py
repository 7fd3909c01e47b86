"""Positions beside a true track: of modes that share the weight the right one counts."""

import numpy as np
import pytest

from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.flow.scoring.track_scores import score_fixes

TIME_S = np.array([0.0, 100.0])
EAST_AT_5 = VesselTrack(
    vessel="ferry", time_s=TIME_S, first=5.0 * TIME_S, second=np.full(2, 100.0),
    speed_mps=np.full(2, 5.0), course_deg=np.full(2, 90.0),
)  # fmt: skip
TRUTH = Truth(name="made.json", start_utc_ns=None, is_geographic=False, tracks=(EAST_AT_5,))


def fixes_of(weights):
    """A mirror image south of the sensor first, then the vessel, two metres off."""
    nothing = np.full(4, np.nan)
    return Fixes(
        contact=np.ones(4, int), mode=np.array([1, 1, 2, 2]),
        weight=np.repeat(weights, 2), time_s=np.tile([20.0, 60.0], 2),
        time_utc_ns=np.full(4, -1), east_m=np.tile([100.0, 300.0], 2),
        north_m=np.repeat([-100.0, 102.0], 2), latitude=nothing, longitude=nothing,
        covariance_m2=np.tile(4.0 * np.eye(2), (4, 1, 1)), speed_mps=nothing,
        speed_std_mps=nothing, course_deg=nothing, course_std_deg=nothing,
        sensors=np.full(4, "h1,h2"), origin="grid",
    )  # fmt: skip


def test_the_nearest_of_modes_that_share_the_weight_is_compared_and_named():
    found = score_fixes(fixes_of([0.5, 0.5]), TRUTH, None)
    assert [(s.estimate, s.sigmas) for s in found.scores] == [(2.0, 1.0)] * 2
    assert (found.gospa_m, found.ospa_m, found.n_times) == (2.0, 2.0, 2)
    (said,) = found.ambiguous
    assert said.startswith("contact 1: mode 2 is compared, the nearest of 2 ")
    assert said.endswith("(its own 0.50)")


def test_a_mode_that_is_hardly_believed_excuses_nothing():
    found = score_fixes(fixes_of([0.96, 0.04]), TRUTH, None)
    assert [s.estimate for s in found.scores] == [200.0, 200.0]
    assert found.scores[0].sigmas == pytest.approx(100.0)
    assert found.gospa_m == pytest.approx(200.0)
    assert found.ambiguous == ()
