"""The study of rates finds what it draws, and another seed draws something else."""

import numpy as np
import pytest

from studies import demon_study
from studies.demon_study import SCENES, cavitation, study_demon


@pytest.mark.slow
def test_the_vessel_is_found_and_its_shaft_is_right(monkeypatch):
    monkeypatch.setattr(demon_study, "NOISE_S", 120.0)
    study = study_demon(runs=1, seed=4)
    found = [row for row in study.rows if row.quantity.startswith("found")]
    assert len(found) == 3 * len(SCENES)
    assert all(row.ours == 100.0 for row in found)
    rates = [row for row in study.rows if row.quantity == "false rates, 1/h"]
    assert all(row.low <= row.ours <= row.high for row in rates)


def test_a_scene_has_its_ratio_and_its_seed():
    one, other = (cavitation(np.random.default_rng(s), -6.0, 0.15) for s in (1, 2))
    assert not np.array_equal(one, other)
    # unit variance, and in seven tenths of the band a quarter of its density more
    assert np.var(one) == pytest.approx(1.0 + 0.7 * 10**-0.6, abs=0.02)
