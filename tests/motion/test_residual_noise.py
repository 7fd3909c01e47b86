"""Weights of rows of measurements, from their residuals."""

from types import SimpleNamespace

import numpy as np

from uwtrack_cli.motion.passage.fit.residual_noise import block_noises, rough_weight


def test_a_row_of_one_measurement_keeps_its_nominal_weight():
    """Its own rest frequency takes up all of it: a residual of zero is no accuracy."""
    rng = np.random.default_rng(1)
    nominal = np.full((1, 2, 2000), 4.0)
    nominal[0, 1, 1:] = 0.0
    residual = np.zeros((1, 2, 2000))
    residual[0, 0] = 3.0 * 0.5 * rng.standard_normal(2000)
    weight = rough_weight(residual, SimpleNamespace(weight=nominal))
    assert weight[0, 1, 0] == 4.0
    # many measurements tell that they scatter by three times what was stated
    assert abs(np.median(weight[0, 0]) - 4.0 / 9.0) < 0.1 * 4.0 / 9.0


def noise_of(residual):
    """Judge one data set whose rows are frequencies of nominal deviation one."""
    rows, count = residual.shape
    blocks = SimpleNamespace(
        weight=np.ones((1, rows, count)), correlation=np.zeros(rows),
        time_s=np.arange(count, dtype=float), kinds=np.eye(3)[:, [0] * rows],
        parts=(slice(0, rows), slice(rows, rows), slice(rows, rows)),
    )  # fmt: skip
    return block_noises(residual[None], blocks, 60.0, None)[0].scale[0]


def test_a_line_that_wanders_by_itself_is_not_believed_beyond_what_it_states():
    """A smooth course through noise: its neighbours differ little, its sums by much."""
    rng = np.random.default_rng(2)
    clear = 2.0 * rng.standard_normal((3, 600))
    walk = np.cumsum(0.1 * rng.standard_normal((1, 600)), axis=1)
    fine = 0.3 * rng.standard_normal((1, 600))
    scale = noise_of(np.concatenate([clear, walk - walk.mean(), fine]))
    assert np.all(np.abs(scale[:3] - 2.0) < 0.2)
    assert scale[3] == 1.0
    # what scatters little over a passage, too, keeps its weight
    assert abs(scale[4] - 0.3) < 0.05


def test_what_all_lines_share_is_no_wander_of_one():
    rng = np.random.default_rng(3)
    walk = np.cumsum(0.1 * rng.standard_normal(600))
    assert np.all(noise_of(0.5 * rng.standard_normal((4, 600)) + walk) < 0.6)
    assert noise_of(walk[None])[0] < 0.3
