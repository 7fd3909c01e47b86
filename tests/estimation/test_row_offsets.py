"""Rows with offsets of their own, against least squares over all rows and offsets."""

import numpy as np
import pytest

from uwtrack_cli.estimation.row_offsets import mean_of_rows, padded


def of_all(value, weight, shape):
    """Size of a shape beside an offset of every row, its information, by least squares."""
    rows, n = value.shape
    columns = np.column_stack([np.repeat(np.eye(rows), n, axis=0), np.tile(shape, rows)])
    root = np.sqrt(weight.ravel())
    normal = (columns * root[:, None] ** 2).T @ columns
    right = columns.T @ (weight.ravel() * value.ravel())
    found = np.linalg.pinv(normal, rcond=1e-12) @ right
    left = (
        columns[:, -1]
        - columns[:, :-1]
        @ np.linalg.lstsq(columns[:, :-1] * root[:, None], columns[:, -1] * root, rcond=None)[0]
    )
    return found[-1], float(weight.ravel() @ left**2)


def of_mean(value, weight, shape):
    used = weight.any(axis=0)
    mean, offsets = mean_of_rows(value[:, used], weight[:, used])
    root = np.sqrt(weight.sum(axis=0)[used])
    basis = np.linalg.qr(offsets.rows(root))[0]
    column = padded(shape[used] * root, len(basis))
    column = column - basis @ (basis.T @ column)
    size = column @ padded(mean * root, len(basis)) / (column @ column)
    return float(size), float(column @ column)


@pytest.mark.parametrize("n_rows", [1, 3, 40])
@pytest.mark.parametrize("kind", ["all heard", "one after another"])
def test_the_mean_tells_of_a_shape_what_all_rows_tell(n_rows, kind):
    rng = np.random.default_rng(n_rows)
    n = 120
    weight = np.repeat(rng.uniform(0.5, 2.0, (n_rows, 1)), n, axis=1)
    if kind == "one after another":
        weight *= np.arange(n) * n_rows // n == np.arange(n_rows)[:, None]
    shape = np.tanh((np.arange(n) - 70.0) / 20.0)
    value = 3.0 * shape + rng.normal(0.0, 5.0, (n_rows, 1)) + rng.standard_normal((n_rows, n))
    expected = of_all(value, weight, shape)
    np.testing.assert_allclose(of_mean(value, weight, shape), expected, rtol=1e-9)


def test_rows_that_overlap_in_part_lose_little_of_what_they_tell():
    """Pieces of lines, each a third as long as the record, as trackers leave them.

    Offsets that are known to a third of the noise are taken as known: a tenth too much.
    """
    losses, errors = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n_rows, n = 60, 120
        begin = rng.integers(0, n - 40, n_rows)
        time = np.arange(n)
        weight = ((time >= begin[:, None]) & (time < begin[:, None] + 40)).astype(float)
        shape = np.tanh((time - 60.0) / 25.0)
        value = 0.3 * shape + rng.normal(0.0, 5.0, (n_rows, 1))
        value = np.where(weight > 0, value + rng.standard_normal((n_rows, n)), 0.0)
        size, information = of_mean(value, weight, shape)
        losses.append(information / of_all(value, weight, shape)[1])
        errors.append((size - 0.3) * np.sqrt(information))
    assert min(losses) > 0.98
    assert max(losses) < 1.15
    assert 0.6 < np.std(errors) < 1.4
