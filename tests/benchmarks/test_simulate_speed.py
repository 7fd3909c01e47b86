"""The cost of a simulated hour beside the cost of its random numbers alone."""

import time

import numpy as np
import pytest

from uwtrack_cli.simulate import make_scenario, simulate_recordings

HOUR = {
    "seed": 1,
    "duration_s": 3600.0,
    "sample_rate_hz": 4000.0,
    "sensor": [{"id": "h1", "depth_m": 22.0, "full_scale_db": 150.0}],
    "vessel": [
        {
            "closest_approach": {
                "time_s": 1800.0,
                "horizontal_range_m": 250.0,
                "speed_mps": 6.0,
                "course_deg": 80.0,
                "side": "port",
            },
            "line": [{"fundamental_hz": 63.0, "harmonics": 5, "cn0_db_hz": 35.0}],
            "broadband": {"band_hz": [100.0, 1500.0], "snr_db": 10.0},
        }
    ],
    "noise": {"density_db": 70.0, "slope_db_per_decade": -17.0},
}


@pytest.mark.benchmark
def test_simulated_hour_costs_at_most_twelve_draws_of_its_random_numbers():
    reader = simulate_recordings(make_scenario(HOUR))[0].reader

    def simulate():
        for _ in reader(65_536):
            pass

    def draw():
        for tile in range(2 * 938):  # ambient noise and the vessel's own
            np.random.default_rng([1, tile]).standard_normal(15_360)

    pairs = [(cpu_s(simulate), cpu_s(draw)) for _ in range(3)]  # in turn
    ratio = min(s for s, _ in pairs) / min(d for _, d in pairs)
    assert ratio < 12.0, f"{ratio:.1f} times the draw of the random numbers"


def cpu_s(work):
    begin = time.process_time()
    work()
    return time.process_time() - begin
