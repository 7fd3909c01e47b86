"""A rise of the level alone must exceed what its parts of the band do all the time."""

import numpy as np
import pytest

from tests.motion.test_sub_bands import TIME, heights, levels_of
from uwtrack_cli.motion.passage.checks.usual_rises import FEWEST_LENGTHS, FLANK, stands_out

WIDTH_S, PERIOD_S = 2.0, 12.0
CREST_S = 120.5
SWELL = 10 ** (0.3 * np.cos(2 * np.pi * (TIME - CREST_S) / PERIOD_S))
"""Sound that swells by 3 dB to either side for a sixth of its length."""
GUST = 1 + 4 * np.exp(-0.5 * ((TIME - CREST_S) / WIDTH_S) ** 2)
LAW = 1 / (1 + ((TIME - CREST_S) / WIDTH_S) ** 2)


def in_parts(one):
    """Return a power that is alike in all parts, shape (part, n)."""
    return np.repeat(one[None], heights().size, axis=0)


def test_a_crest_of_swell_with_a_gust_in_some_parts_is_usual():
    power = in_parts(SWELL)
    power[:3] *= GUST
    assert not stands_out(levels_of(power), CREST_S, WIDTH_S)


@pytest.mark.parametrize("background", [np.ones(TIME.size), SWELL])
def test_a_passage_stands_out_even_of_swell(background):
    power = in_parts(background) + 3 * heights() * LAW
    levels = levels_of(power)
    assert stands_out(levels, CREST_S, WIDTH_S)
    assert not stands_out(levels, CREST_S - 4 * PERIOD_S, WIDTH_S)


def test_a_passage_at_an_end_of_the_recording_stands_out():
    """There is one side of it alone to measure it against."""
    power = in_parts(SWELL) + 3 * heights() / (1 + ((TIME - 3.0) / WIDTH_S) ** 2)
    assert stands_out(levels_of(power), 3.0, WIDTH_S)


def test_a_short_recording_knows_nothing_usual():
    power = in_parts(SWELL)
    longest_s = TIME.size / (2 * FLANK[1] * FEWEST_LENGTHS)
    assert stands_out(levels_of(power), CREST_S, 1.1 * longest_s)
    assert not stands_out(levels_of(power), CREST_S, 0.8 * longest_s)
