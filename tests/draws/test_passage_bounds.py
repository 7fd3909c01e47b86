"""The bounds that drawn passages are held against agree with an independent reference."""

from dataclasses import replace

import numpy as np
import pytest

from studies.seatrial import RANGE_M, SPEED_MPS, trial_scenario
from tests.draws.passage_bounds import _density, bounds
from uwtrack_cli.simulate.vessels import GearChange

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
    case = {"cn0_db_hz": 28.0, "snr_db": 3.0, "surface_image": 0.0, "frequency_jitter": 1e-3}
    found = bounds(trial_scenario(case, 1), 0)
    law = 1e-3 / (SPEED_MPS / 1500.0) * np.sqrt(2 * 20.0 / 600.0)
    assert 0.6 * law < found["speed"] < 1.4 * law
    assert found["course"] < 0.1


@pytest.mark.parametrize("jitter", [0.0, 1e-4])
def test_a_gear_change_costs_a_rest_frequency_where_the_lines_bend(jitter):
    """Far behind the passage it costs nothing; at it, the step of the Doppler shift."""
    case = {"cn0_db_hz": 28.0, "snr_db": -30.0, "surface_image": 0.0, "frequency_jitter": jitter}
    scenario = trial_scenario(case, 1)
    (vessel,) = scenario.vessels
    time_s = vessel.closest_approach.time_s

    def speed_bound(at_s, factor=1.0):
        change = GearChange(at_s=at_s, factor=factor, duration_s=0.1)
        changed = replace(vessel, gear_changes=(change,))
        return bounds(replace(scenario, vessels=(changed,)), 0)["speed"]

    whole = bounds(scenario, 0)["speed"]
    late = speed_bound(scenario.duration_s - 1.0)
    assert late == pytest.approx(whole, rel=0.02)
    assert speed_bound(time_s) > 1.15 * whole
    # a higher gear shifts by more hertz from then on
    assert speed_bound(time_s, 1.4) < speed_bound(time_s)


def test_a_tilted_spectrum_is_loud_below_and_as_strong_in_all():
    """The simulator's law: power in the band is stated, density falls as stated."""
    case = {"cn0_db_hz": 28.0, "snr_db": 3.0, "surface_image": 0.0, "frequency_jitter": 0.0}
    scenario = trial_scenario(case, 1)
    (vessel,) = scenario.vessels
    low, high = vessel.broadband.band_hz
    grid = np.linspace(low, high, 2001)
    at = np.array([vessel.closest_approach.time_s])

    def density(slope):
        plan = replace(vessel.broadband, slope_db_per_decade=slope)
        return _density(scenario, replace(vessel, broadband=plan), grid, at)[:, 0]

    flat, tilted = density(0.0), density(-20.0)
    assert np.trapezoid(tilted, grid) == pytest.approx(np.trapezoid(flat, grid), rel=5e-3)
    fall = 10 * np.log10(tilted[0] / tilted[-1])
    assert fall == pytest.approx(20 * np.log10(high / low), rel=1e-6)
