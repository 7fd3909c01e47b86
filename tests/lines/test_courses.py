"""Courses at the ends of paths."""

import numpy as np

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
        errors.append(course.value - [300.0, 0.02])
    # plain least squares is 0.17 Hz and 0.012 Hz/s off, four times as much
    off_hz, off_hzps = np.median(np.abs(errors), axis=0)
    assert off_hz < 0.06
    assert off_hzps < 0.005


def test_a_course_needs_frames() -> None:
    variance = np.full(40, STD_HZ**2)
    variance[7:] = np.inf
    assert fit_course(TIME_S[:40], np.full(40, 300.0), variance, 0.0) is None
