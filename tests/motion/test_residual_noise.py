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


def test_a_course_smoother_than_its_bound_weighs_no_more_than_stated():
    """A path through noise: neighbours differ by a tenth of what each is known to."""
    rng = np.random.default_rng(2)
    clear = 2.0 * rng.standard_normal((1, 600))
    walk = np.cumsum(0.1 * rng.standard_normal((1, 600)), axis=1)
    residual = np.concatenate([clear, walk, walk])[None]
    blocks = SimpleNamespace(
        weight=np.ones((1, 3, 600)), correlation=np.zeros(3),
        time_s=np.arange(600.0), kinds=np.eye(3)[:, [0, 0, 1]],
        parts=(slice(0, 2), slice(2, 3), slice(3, 3)),
    )  # fmt: skip
    frequencies, bearings, _ = block_noises(residual, blocks, 0.0)
    assert abs(frequencies.scale[0, 0] - 2.0) < 0.1
    assert frequencies.scale[0, 1] == 1.0
    assert bearings.scale[0, 0] < 0.3
