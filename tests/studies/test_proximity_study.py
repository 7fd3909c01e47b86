"""The proximity study against the reference table and closed form."""

import numpy as np
import pytest

from studies.proximity import SPEED_SHARES, study_proximity
from uwtrack_cli.constants import KNOT_MPS


def test_every_figure_is_within_3_percent_and_its_own_scatter():
    study = study_proximity(runs=1500, seed=3)
    for row in study.rows:
        scatter = (row.high - row.low) / 2
        assert abs(row.ours - row.reference) <= 0.03 * row.reference + 1.5 * scatter


@pytest.mark.long
def test_one_sensor_agrees_with_the_closed_form():
    study = study_proximity(runs=4000, seed=5)
    for row in study.rows:
        name = row.quantity.split(",")[0]
        if name not in SPEED_SHARES:
            continue
        knots, minutes = (float(part.split()[0]) for part in row.case.split(","))
        speed, share = knots * KNOT_MPS, SPEED_SHARES[name]
        lag = 60 * minutes - 771.7 / speed
        bearing = np.deg2rad(3.0) ** 2 / 3
        square = (
            25**2 / 2
            + 200**2 * (0.04 / 3 + share**2 / 3)
            + (200**2 + (speed * lag) ** 2) * bearing
            + speed**2 * 25 / 3
            + (speed * lag * share) ** 2 / 3
        )
        scatter = (row.high - row.low) / 2
        assert abs(row.ours - np.sqrt(square)) <= 0.03 * row.ours + scatter


def test_another_seed_changes_the_figures():
    first, second = (study_proximity(runs=50, seed=seed) for seed in (1, 2))
    assert all(a.ours != b.ours for a, b in zip(first.rows, second.rows, strict=True))
