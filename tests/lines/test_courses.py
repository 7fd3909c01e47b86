"""Courses of paths: what crosses goes on, what turns back does not."""

import numpy as np
import pytest

from uwtrack_cli.lines.paths.courses import fit_course, uncross
from uwtrack_cli.lines.paths.path_search import FoundPath

N_FRAMES, HOP_S, STD_HZ = 120, 0.5, 0.1
TIME_S = np.arange(N_FRAMES) * HOP_S


def two_lines(rate_hzps, *, turn_back=False, seed=1):
    """Measured frequencies of two lines that meet in the middle, shape (frame, 2)."""
    away = rate_hzps * (TIME_S - TIME_S[N_FRAMES // 2])
    away = np.abs(away) + 1.2 if turn_back else away
    noise = STD_HZ * np.random.default_rng(seed).standard_normal((N_FRAMES, 2))
    return 500.0 + np.stack([away, -away], axis=1) + noise


def exchanged(frequency_hz):
    """What the likeliest paths follow: each goes on with the other's line."""
    half = N_FRAMES // 2
    return np.concatenate([frequency_hz[:half], frequency_hz[half:, ::-1]])


def parted(frequency_hz, first=0):
    """Which of the two lines each path follows at the start and at the end."""
    cells = np.round(2.0 * frequency_hz).astype(np.int64)
    paths = [FoundPath(cells[:, k], first, N_FRAMES, 50.0) for k in (0, 1)]
    variance = np.full(frequency_hz.shape, STD_HZ**2)
    variance[:first] = np.inf
    found = uncross(paths, TIME_S, frequency_hz, variance, 1.0)
    return [(0.5 * p.cells[first], 0.5 * p.cells[-1]) for p in found]


@pytest.mark.parametrize("rate_hzps", [0.1, 0.2, 0.5])
@pytest.mark.parametrize("seed", range(5))
def test_lines_that_cross_go_on_along_their_courses(rate_hzps, seed) -> None:
    frequency = two_lines(rate_hzps, seed=seed)
    for measured in (frequency, exchanged(frequency)):
        for start, end in parted(measured):
            assert (start - 500.0) * (end - 500.0) < 0.0


@pytest.mark.parametrize("seed", range(5))
def test_lines_that_come_near_and_part_again_slowly_do_not_cross(seed) -> None:
    for start, end in parted(two_lines(0.05, turn_back=True, seed=seed)):
        assert (start - 500.0) * (end - 500.0) > 0.0


def test_a_meeting_without_a_course_before_it_changes_nothing() -> None:
    measured = exchanged(two_lines(0.2))
    first = N_FRAMES // 2 - 4
    for start, end in parted(measured, first):
        kept = {round(2.0 * f) for f in measured[first]}
        assert round(2.0 * start) in kept
        assert min(abs(end - measured[-1])) < 0.5


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
