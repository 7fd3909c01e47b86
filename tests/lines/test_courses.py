"""Courses at the ends of paths."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from uwtrack_cli.lines.paths.courses import fit_course

N_FRAMES, HOP_S, STD_HZ = 120, 0.5, 0.1
TIME_S = np.arange(N_FRAMES) * HOP_S


def test_noise_after_the_end_of_a_line_does_not_turn_its_course() -> None:
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(200):
        frequency = 300.0 + 0.02 * TIME_S[:40] + STD_HZ * rng.standard_normal(40)
        frequency[:5] += rng.uniform(-2.0, 2.0, 5)  # nearest first: the very end
        course = fit_course(TIME_S[:40], frequency, np.full(40, STD_HZ**2), 0.0)
        errors.append(np.subtract(course[:2], [300.0, 0.02]))
    # plain least squares is 0.17 Hz and 0.012 Hz/s off, four times as much
    off_hz, off_hzps = np.median(np.abs(errors), axis=0)
    assert off_hz < 0.06
    assert off_hzps < 0.005


def test_a_course_needs_frames() -> None:
    variance = np.full(40, STD_HZ**2)
    variance[7:] = np.inf
    assert fit_course(TIME_S[:40], np.full(40, 300.0), variance, 0.0) is None


@pytest.mark.parametrize("seed", range(4))
def test_a_course_is_the_likeliest_under_cauchys_law(seed) -> None:
    """As scipy finds it: its loss is c^2 ln(1 + (r / c)^2) with c = 3 deviations."""
    rng = np.random.default_rng(seed)
    time_s, std = TIME_S[:24], rng.uniform(0.5, 2.0, 24) * STD_HZ
    frequency = 300.0 + 0.02 * time_s + std * rng.standard_normal(24)
    frequency[[2, 9, 17]] += std[[2, 9, 17]] * [4.0, -4.0, 5.0]
    course = fit_course(time_s, frequency, std**2, 4.0)

    def residual(value):
        return (frequency - value[0] - value[1] * (time_s - 4.0)) / std

    found = least_squares(
        residual, [300.0, 0.0], loss="cauchy", f_scale=3.0, xtol=1e-12, ftol=1e-12
    ).x
    std_error = np.sqrt([course.variance, course.rate_variance])
    assert (np.abs(course[:2] - found) < 0.02 * std_error).all()
    weight = 1.0 / (1.0 + (residual(found) / 3.0) ** 2)
    design = np.stack([np.ones(24), time_s - 4.0], axis=1) / std[:, None]
    excess = np.sum(weight * residual(found) ** 2) / 22.0
    wanted = np.linalg.inv(design.T @ (weight[:, None] * design)) * max(excess, 1.0)
    assert course[2:] == pytest.approx(wanted[[0, 0, 1], [0, 1, 1]], rel=1e-2)
