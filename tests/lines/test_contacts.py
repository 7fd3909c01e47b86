"""Which lines are one vessel's: those that bend together, for as long as they are heard."""

import tracemalloc

import numpy as np
import pytest

from uwtrack_cli.lines.contacts import (
    UNRESOLVED_BINS,
    ContactSamples,
    LineSamples,
    group_lines,
    unresolved_share,
)
from uwtrack_cli.lines.line_points import LinePoints

TIME_S = np.arange(400.0)


def passage(rest_hz, closest_s, first_s, last_s):
    """Frequency of a line of a vessel that passes at 6 m/s and 90 m."""
    along = 6.0 * (TIME_S - closest_s)
    frequency = rest_hz * (1.0 - 6.0 / 1500.0 * along / np.hypot(along, 90.0))
    heard = (first_s <= TIME_S) & (last_s >= TIME_S)
    return np.where(heard, frequency, np.nan)


def contacts(*lines, std_hz=0.01):
    return grouped(*lines, std_hz=std_hz)[0].tolist()


def grouped(*lines, std_hz=0.01):
    frequency = np.stack(lines) + std_hz * np.random.default_rng(1).normal(
        size=(len(lines), TIME_S.size)
    )
    line, frame = np.nonzero(np.isfinite(frequency))
    unknown = np.full(line.size, np.nan)
    samples = LineSamples(
        np.searchsorted(line, np.arange(len(lines) + 1)), frame,
        frequency[line, frame], np.full(line.size, std_hz**2), unknown, unknown, 4.0,
    )  # fmt: skip
    return group_lines(samples, np.full(len(lines), -1))


def test_lines_of_one_passage_are_one_contact_though_one_is_heard_for_longer():
    found = contacts(passage(150.0, 100.0, 0, 200), passage(310.0, 100.0, 40, 160))
    assert found == [1, 1]


@pytest.mark.parametrize("overlap_s", [80.0, 100.0])
def test_the_end_of_a_passage_and_the_beginning_of_the_next_are_two_contacts(overlap_s):
    found = contacts(passage(150.0, 100.0, 0, 150 + overlap_s), passage(310.0, 290.0, 150, 390))
    assert found == [1, 2]


def points(line, frame, frequency_hz, std_hz=0.02):
    state = np.zeros((frame.size, 5, 2))
    noise = np.random.default_rng(line).normal(size=frame.size)
    state[:, 0, 0], state[:, 2, 0] = frequency_hz + std_hz * noise, std_hz**2
    state[:, 2, 1] = 1e9  # no bearing was measured
    return LinePoints(
        np.full(frame.size, line), frame, 1.0 * frame, state,
        np.full((frame.size, 6), np.nan), np.full(frame.size, 2),
    )  # fmt: skip


def most_held(n_hours):
    """Megabytes at most while lines of some hours, each of a minute, are compared."""
    held = ContactSamples(2)
    held.add(points(0, np.arange(0, 7200 * n_hours, 4), 50.0))
    starts = np.arange(0, 7200 * n_hours, 60)
    for number, start in enumerate(starts, 1):
        held.add(points(number, start + np.arange(120), 60.0 + 1.37 * number % 140))
    lines = held.line_seen()
    assert lines.size == starts.size + 1
    tracemalloc.start()
    try:
        group_lines(held.samples(lines, 8.0), np.full(lines.size, -1))
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def test_a_day_of_lines_is_compared_in_as_little_memory_as_its_points_take():
    # 2881 lines at 43 200 times: four tables of line and time would take 4 GB
    assert most_held(24) < 24.0


@pytest.mark.parametrize(("bins", "expected"), [(1.5, 1.0), (2.0, 0.0)])
def test_lines_that_are_not_resolved_are_told(bins, expected):
    """Three lines of one bin a frame, two of them near each other for half of it."""
    samples = ContactSamples(1)
    frame = np.arange(200)
    samples.add(points(1, frame, np.full(200, 100.0)))
    samples.add(points(2, frame[:100], np.full(100, 100.0 + bins)))
    samples.add(points(3, frame, np.full(200, 300.0)))
    found = unresolved_share(samples.samples(samples.line_seen(), 4.0), UNRESOLVED_BINS)
    assert found == pytest.approx([0.5 * expected, expected, 0.0])


@pytest.mark.parametrize(
    ("lines_hz", "is_hum"),
    [
        ((1139.8,), False),  # a train's horn: 19 times 60 Hz by chance
        ((1139.8, 1200.0), False),  # no grid is heard by its high multiples alone
        ((60.0,), False),
        ((60.0, 60.05), False),  # one multiple, followed twice
        ((60.0, 300.0), True),
        ((250.0, 1150.0), True),
        ((50.0, 120.0), False),
    ],
)
def test_hum_has_two_multiples_of_the_mains_one_of_them_low(lines_hz, is_hum):
    status = grouped(*(np.full(TIME_S.size, each) for each in lines_hz))[1]
    assert set(status.tolist()) == ({"hum"} if is_hum else {"steady"})
