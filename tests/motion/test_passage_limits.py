"""The bounds that drawn passages are held against agree with an independent reference."""

import numpy as np
import pytest

from tests.motion.passage_limits import bounds
from uwtrack_cli.studies.seatrial import RANGE_M, SPEED_MPS, trial_scenario

PUBLISHED = {
    (35.0, 10.0): (0.00131, 0.193, 0.0182, 0.0223),
    (28.0, 3.0): (0.0024, 0.347, 0.0267, 0.0434),
    (20.0, -6.0): (0.00569, 0.782, 0.0519, 0.11),
}
"""C/N0 and ratio in the band; bounds of speed, range, time and course."""


@pytest.mark.parametrize(("ratios", "published"), PUBLISHED.items())
def test_the_bounds_are_the_published_ones(ratios, published):
    case = {
        "cn0_db_hz": ratios[0], "snr_db": ratios[1], "surface_image": 0.0, "frequency_jitter": 0.0
    }  # fmt: skip
    found = bounds(trial_scenario(case, 1), 0)
    ours = (
        found["speed"] * SPEED_MPS,
        found["range"] * np.hypot(RANGE_M, 19.0),
        found["time"],
        found["course"],
    )
    np.testing.assert_allclose(ours, published, rtol=0.15)


def test_wander_bounds_the_speed_as_published():
    """Section 6: (jitter / M) sqrt(2 tau / W) of the speed; a fit to it 7 %."""
    case = {
        "cn0_db_hz": 28.0,
        "snr_db": 3.0,
        "surface_image": 0.0,
        "frequency_jitter": 1e-3,
    }
    found = bounds(trial_scenario(case, 1), 0)
    law = 1e-3 / (SPEED_MPS / 1500.0) * np.sqrt(2 * 20.0 / 600.0)
    assert 0.6 * law < found["speed"] < 1.4 * law
    assert found["course"] < 0.1
