"""Tables of bearings, frequencies and own ship for the published scenarios."""

import numpy as np

from studies.tma_scenarios import COUNT, STEP_S, make_scenario
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.data.series import Series


def own_ship(name, start_utc_ns=None):
    scenario = make_scenario(name)
    time = STEP_S * np.arange(-1, COUNT)
    return Navigation(
        time_s=time,
        east_m=scenario.own_east_m,
        north_m=scenario.own_north_m,
        heading_deg=np.full(time.size, np.nan),
        start_utc_ns=start_utc_ns,
    )


def heard(name, *, noise=1.0, rows=COUNT, seed=1, contact=1, start_utc_ns=None):
    bearing, _, frequency = make_scenario(name).truth()
    draw = np.random.default_rng(seed).standard_normal((2, rows))
    bearing = np.degrees(bearing[:rows]) + noise * draw[0]
    return Series(
        contact=np.full(rows, contact),
        time_s=STEP_S * np.arange(rows),
        bearing_deg=bearing % 360.0,
        bearing_std_deg=np.full(rows, noise),
        frequency_hz=(frequency[:rows] + 0.25 * noise * draw[1])[:, np.newaxis],
        frequency_std_hz=np.full((rows, 1), 0.25 * noise),
        level_db=np.full(rows, np.nan),
        level_std_db=np.full(rows, np.nan),
        start_utc_ns=start_utc_ns,
    )
