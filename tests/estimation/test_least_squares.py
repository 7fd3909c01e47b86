"""Damped least squares of many small problems at once, against scipy's."""

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from uwtrack_cli.estimation.least_squares import damped_least_squares, inverse_or_nan

TIME_S = np.linspace(0, 4, 60)
DECAY = 3 * np.exp(-0.7 * TIME_S)
DECAY = DECAY + 0.05 * np.random.default_rng(5).normal(size=TIME_S.size)
STARTS = np.array([[1.0, 0.1], [5.0, 2.0], [2.0, 1.0]])


def residual(theta):
    return DECAY - theta[0] * np.exp(-theta[1] * TIME_S)


def evaluate(theta, _):
    decay = np.exp(-theta[:, 1:] * TIME_S)
    error = DECAY - theta[:, :1] * decay
    slope = np.stack([-decay, theta[:, :1] * TIME_S * decay], axis=-1)
    gradient = np.einsum("bnp,bn->bp", slope, error)
    return 0.5 * (error**2).sum(axis=1), gradient, np.swapaxes(slope, 1, 2) @ slope


def any_step(_, step):
    return step


def test_damped_steps_reach_scipys_optimum_from_every_start():
    found = damped_least_squares(evaluate, STARTS, any_step, max_steps=60, tolerance=1e-14)
    oracle = least_squares(residual, [1.0, 0.1], xtol=1e-14).x
    np.testing.assert_allclose(found, np.tile(oracle, (3, 1)), rtol=1e-5)


@pytest.mark.parametrize(("lower", "upper"), [([0.0, 0.0], [2.5, 9.0]), ([3.5, 0.0], [9.0, 0.75])])
def test_bounds_are_met_where_scipy_meets_them(lower, upper):
    bounds = np.array(lower), np.array(upper)
    found = damped_least_squares(
        evaluate, STARTS, any_step, bounds=bounds, max_steps=60, tolerance=1e-14
    )
    inner = np.clip([1.0, 0.1], bounds[0] + 1e-3, bounds[1] - 1e-3)
    oracle = least_squares(residual, inner, bounds=bounds, xtol=1e-14).x
    assert oracle == pytest.approx(found[0], rel=1e-4)
    np.testing.assert_allclose(found, np.tile(found[0], (3, 1)), rtol=1e-5)
    assert ((found == bounds[0]) | (found == bounds[1])).any(axis=1).all()


def test_an_unknown_that_is_held_stays_and_the_others_follow():
    found = damped_least_squares(
        evaluate, STARTS, any_step, bounds=(np.full(2, -9.0), np.full(2, 9.0)),
        held=(1,), max_steps=60, tolerance=1e-14,
    )  # fmt: skip
    decay = np.exp(-STARTS[:, 1:] * TIME_S)
    linear = (decay @ DECAY) / (decay**2).sum(axis=1)
    np.testing.assert_allclose(found, np.column_stack([linear, STARTS[:, 1]]))


def test_rows_that_are_done_drop_out_and_end_where_they_do_alone():
    asked = []

    def counted(theta, rows):
        asked.append(rows.tolist())
        return evaluate(theta, rows)

    best = least_squares(residual, [1.0, 0.1], xtol=1e-14).x
    starts = np.array([[5.0, 2.0], best, [2.0, 1.0]])
    options = {"max_steps": 60, "tolerance": 1e-12, "drops_rows": True}
    found = damped_least_squares(counted, starts, any_step, **options)
    assert asked[0] == [0, 1, 2]
    assert all(1 not in rows for rows in asked[1:])
    assert len(asked[1]) == 2
    alone = [
        damped_least_squares(evaluate, one[np.newaxis], any_step, **options)[0] for one in starts
    ]
    np.testing.assert_array_equal(found, alone)


def test_a_singular_matrix_has_no_inverse():
    singular = np.array([[[1.0, 1.0], [1.0, 1.0]]])
    assert np.isnan(inverse_or_nan(singular)).any()
    good = np.array([[[4.0, 1e-6], [1e-6, 9e-12]]])
    np.testing.assert_allclose(inverse_or_nan(good), np.linalg.inv(good), rtol=1e-8)


def test_a_matrix_that_is_not_finite_has_no_inverse_and_leaves_the_others_theirs():
    good = np.array([[4.0, 1.0], [1.0, 2.0]])
    lost = np.array([[np.nan, 0.0], [0.0, 1.0]])
    endless = np.array([[np.inf, 0.0], [0.0, 1.0]])
    found = inverse_or_nan(np.stack([lost, good, endless]))
    np.testing.assert_allclose(found[1] @ good, np.eye(2), atol=1e-12)
    assert np.isnan(found[[0, 2]]).all()
    assert np.isnan(inverse_or_nan(lost)).all()


DESIGN = np.random.default_rng(8).standard_normal((30, 3)) @ [
    [1.0, 0.98, 0.9], [0.0, 0.2, 0.4], [0.0, 0.0, 0.1],
]  # fmt: skip
VALUES = DESIGN @ [1.0, -2.0, 3.0]


def linear(theta, _):
    error = theta @ DESIGN.T - VALUES
    matrix = np.broadcast_to(DESIGN.T @ DESIGN, (len(theta), 3, 3))
    return 0.5 * (error**2).sum(axis=1), error @ DESIGN, matrix


def test_a_bound_is_met_in_one_step_and_the_others_go_with_it():
    bounds = np.full(3, -9.0), np.array([0.5, 9.0, 9.0])
    found = damped_least_squares(
        linear, np.zeros((1, 3)), any_step, bounds=bounds, max_steps=1, first_damping=0.0
    )
    oracle = lsq_linear(DESIGN, VALUES, bounds, tol=1e-14).x
    assert oracle[0] == pytest.approx(0.5)
    np.testing.assert_allclose(found[0], oracle, rtol=1e-5)


def test_the_last_step_is_taken_unseen_unless_it_gains_next_to_nothing():
    asked = []

    def counted(theta, rows):
        asked.append(theta)
        return linear(theta, rows)

    start = np.array([[1.0, -2.0, 4.0]])
    gain = 2.0 * linear(start, None)[0][0]
    found = damped_least_squares(counted, start, any_step, tolerance=1.1 * gain, first_damping=0.0)
    assert len(asked) == 1
    np.testing.assert_allclose(found[0], [1.0, -2.0, 3.0], rtol=1e-6)
    found = damped_least_squares(
        counted, start, any_step, tolerance=1100.0 * gain, first_damping=0.0
    )
    assert found is asked[-1]
