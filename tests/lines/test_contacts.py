"""Which lines are one vessel's: those that bend together, for as long as they are heard."""

import numpy as np
import pytest

from uwtrack_cli.lines.contacts import LineSamples, group_lines

TIME_S = np.arange(400.0)


def passage(rest_hz, closest_s, first_s, last_s):
    """Frequency of a line of a vessel that passes at 6 m/s and 90 m."""
    along = 6.0 * (TIME_S - closest_s)
    frequency = rest_hz * (1.0 - 6.0 / 1500.0 * along / np.hypot(along, 90.0))
    heard = (first_s <= TIME_S) & (last_s >= TIME_S)
    return np.where(heard, frequency, np.nan)


def contacts(*lines, std_hz=0.01):
    frequency = np.stack(lines) + std_hz * np.random.default_rng(1).normal(
        size=(len(lines), TIME_S.size)
    )
    unknown = np.full(frequency.shape, np.nan)
    variance = np.where(np.isfinite(frequency), std_hz**2, np.nan)
    samples = LineSamples(frequency, variance, unknown, unknown, 4.0)
    return group_lines(samples, np.full(len(lines), -1))[0].tolist()


def test_lines_of_one_passage_are_one_contact_though_one_is_heard_for_longer():
    found = contacts(passage(150.0, 100.0, 0, 200), passage(310.0, 100.0, 40, 160))
    assert found == [1, 1]


@pytest.mark.parametrize("overlap_s", [80.0, 100.0])
def test_the_end_of_a_passage_and_the_beginning_of_the_next_are_two_contacts(overlap_s):
    found = contacts(
        passage(150.0, 100.0, 0, 150 + overlap_s), passage(310.0, 290.0, 150, 390)
    )
    assert found == [1, 2]
