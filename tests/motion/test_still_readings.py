"""What does not pass: read as it was drawn, by weights that faint sound leaves open."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from studies.constants.still_readings import faint
from tests.draws.measured_passages import SENSOR, STILL, draw
from uwtrack_cli.estimation.row_offsets import Design
from uwtrack_cli.motion.coloured_noise import gains_of_shapes
from uwtrack_cli.motion.cpa import find_encounters


@pytest.mark.parametrize(
    ("kind", "seed"), [("machinery", 4), ("constant", 4), ("joined", 3), ("joined", 4)]
)
def test_what_stays_is_read_as_it_was_drawn(kind, seed):
    found = find_encounters(series=draw(kind, seed).series, sensor=SENSOR)
    assert not found.n_encounters
    assert not found.refusals()
    (one,) = found.still()
    assert (one.contact, one.reading) == (1, kind)
    assert one.weight > 0.5
    rest = 1.0 - one.weight - one.rival_weight
    assert -1e-9 < rest < 0.2


def test_sound_too_faint_to_tell_leaves_both_open():
    """With noise hundreds of times that of the shift no reading is certain."""
    rng = np.random.default_rng(8)
    series = faint(draw("straight", 12).series, rng, (3.0, 2.5, 2.5), least=0.95)
    found = find_encounters(series=series, sensor=SENSOR)
    assert not found.n_encounters
    (one,) = found.still()
    assert {one.reading, one.rival} & {"straight"}
    assert {one.reading, one.rival} & set(STILL)
    assert one.weight < 0.9


def test_the_gain_of_a_shape_is_that_of_the_normal_distribution():
    """White noise of known variance: the ratio of two densities (scipy)."""
    rng = np.random.default_rng(5)
    time_s, std = np.arange(100.0), 2.0
    shape = np.tanh((time_s - 40.0) / 10.0)
    value = shape + std * rng.normal(size=100)
    value -= value.mean()
    free = shape - shape.mean()
    normal = multivariate_normal(np.zeros(100), std**2)
    expected = normal.logpdf(value - free) - normal.logpdf(value)
    inflation = max(float((value**2).mean()) / std**2, 1.0)
    (gain,) = gains_of_shapes(
        value, Design.free(np.ones((100, 1))), shape[:, None], np.full(100, std**-2), time_s, 1.0,
        with_coloured_noise=False,
    )  # fmt: skip
    assert gain == pytest.approx(expected / inflation, rel=1e-6)
