"""Lines that move together, drawn as numbers whose course is known."""

import numpy as np
import pytest

from uwtrack_cli.motion.evidence.fringe_lines import likeliest_course, lines_gain
from uwtrack_cli.motion.evidence.fringe_panel import Panel
from uwtrack_cli.motion.evidence.fringe_template import FringeModel, Hypothesis, Template

ROWS, CELLS, CELL, STD = 60, 160, 0.022, 0.2


def drawn(pattern_of):
    """Draw rows of a pattern that swings by 12 % in noise: rows and course."""
    rng = np.random.default_rng(7)
    course = 0.12 * np.sin(2.0 * np.pi * np.arange(ROWS) / 45.0)
    octave = CELL * np.arange(CELLS) - course[:, None]
    value = pattern_of(octave) + rng.normal(0.0, STD, octave.shape)
    panel = Panel(np.arange(ROWS, dtype=float), value, np.full(CELLS, STD**-2.0), 1.0, CELL)
    return panel, course - np.median(course)


def lines(octave):
    """Return harmonics from the fourth to the thirtieth, 1.2 nepers high, a cell wide."""
    places = 0.2 + np.log(np.arange(4, 31) / 4.0)
    return 1.2 * sum(np.exp(-0.5 * ((octave - at) / (0.5 * CELL)) ** 2) for at in places)


def fringes(octave):
    """Return the comb of one image, of the same power."""
    return 0.5 * np.cos(12.0 * np.exp(octave))


@pytest.mark.parametrize("pattern_of", [lines, fringes])
def test_the_course_of_a_pattern_of_any_shape_is_found(pattern_of):
    panel, course = drawn(pattern_of)
    value = panel.value - panel.value.mean(axis=0)
    # as a passage's course fits a part of it
    found = likeliest_course(panel, value, 0.5 * course, np.ones(ROWS), 0.25)
    assert np.std(found - course) < 0.3 * CELL


@pytest.mark.parametrize(("pattern_of", "is_machine"), [(lines, True), (fringes, False)])
def test_lines_are_told_from_interference_by_their_pattern(pattern_of, is_machine):
    panel, course = drawn(pattern_of)
    time_s = panel.time_s
    moving = Hypothesis(0.0, 1.0, course=(time_s, np.ones(ROWS)), swing=(time_s, course))
    nothing = FringeModel(panel, []).log_likelihood([])
    free = max(
        FringeModel(panel, [Template(knots, variance)]).log_likelihood([moving])
        for knots in (0.75, 1.5, 3.0)
        for variance in (0.01, 0.05, 0.25)
    )
    more = lines_gain(panel, moving) - (free - nothing)
    assert more > 30.0 if is_machine else more < -30.0
