"""Sound whose lines begin and end at once is traced, whatever else is in it."""

import numpy as np
import pytest

from tests.draws.onset_scenes import traced


def check(seed: int) -> None:
    """No error, no warning, every line has points, and none has two in a frame."""
    lines = traced(seed)
    points = np.stack([lines.line, lines.frame])
    assert np.unique(points, axis=1).shape == points.shape
    assert np.array_equal(np.unique(lines.line), np.sort(lines.line_id))


@pytest.mark.parametrize("seed", [4000, 4001, 4004, 4006, 4007, 4027])
def test_lines_that_begin_and_end_at_once_are_traced(seed: int) -> None:
    check(seed)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_two_hundred_scenes_of_lines_that_begin_and_end_at_once_are_traced() -> None:
    for seed in range(4000, 4200):
        check(seed)
