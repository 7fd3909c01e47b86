"""A piece of a line that another passage explains is no passage of its own."""

from dataclasses import replace

import numpy as np
import pytest

from tests.flow.made_encounters import encounters_of
from tests.motion.passing_vessel import frames_of, lines_of_columns
from uwtrack_cli.motion.explained_lines import unexplained

SOUND_MPS = 1500.0
FAST = {
    "time_s": 60.0, "time_std_s": 0.1, "arrival_time_s": 60.0, "speed_mps": 16.0,
    "speed_std_mps": 0.2, "range_over_speed_s": 3.0, "sound_speed_mps": SOUND_MPS,
}  # fmt: skip
SLOW = FAST | {
    "time_s": 40.0, "time_std_s": 4.0, "arrival_time_s": 40.0, "speed_mps": 5.5,
    "speed_std_mps": 0.9, "range_over_speed_s": 12.0,
}  # fmt: skip


CRAWL = SLOW | {"speed_mps": 0.5, "speed_std_mps": 0.1}


def table_of(row, rest_hz, line):
    n = len(rest_hz)
    return replace(
        encounters_of(row), rest_encounter=np.zeros(n, np.int64),
        rest_line_id=np.array(line), rest_frequency_hz=np.array(rest_hz),
        rest_frequency_std_hz=np.full(n, 0.02),
    )  # fmt: skip


def heard(row, rest_hz, from_s, until_s):
    """The line of a straight passage as it is received, by emission times (Quinn 1995)."""
    time = frames_of(240).time_s
    mach = row["speed_mps"] / SOUND_MPS
    width = row["range_over_speed_s"]
    emitted = row["arrival_time_s"] - mach * width + np.linspace(-200, 200, 40001)
    apart = np.hypot(emitted - emitted[20000], width)
    rate = mach * (emitted - emitted[20000]) / apart
    received = rest_hz / (1 + np.interp(time, emitted + mach * apart, rate))
    rng = np.random.default_rng(4)
    received = received + 0.02 * rng.standard_normal(time.size)
    outside = (time < from_s) | (time > until_s)
    return np.where(outside, np.nan, received)


def lines_of(frequency_hz):
    frames = frames_of(frequency_hz.size)
    std = np.where(np.isfinite(frequency_hz), 0.02, np.nan)
    blank = np.full(frequency_hz.size, np.nan)
    columns = [np.ones(frequency_hz.size, np.int64), frequency_hz, std, blank, blank,
               np.zeros(frequency_hz.size)]  # fmt: skip
    return lines_of_columns(frames, columns, [1])


@pytest.mark.parametrize(
    ("row", "made", "own_hz", "is_kept"),
    [
        # the way out of the fast vessel's own line, as a slow one's
        (SLOW, (FAST, 589.0, 64.0, 110.0), 584.0, False),
        # a slow vessel whose line has the fast one's frequency at rest
        (SLOW, (SLOW, 589.0, 10.0, 110.0), 589.0, True),
        # and one whose line is where the fast one's comes to lie
        (SLOW, (SLOW, 584.0, 10.0, 110.0), 584.0, True),
        # which moves less than what tells a line from that path
        (CRAWL, (CRAWL, 582.8, 62.0, 110.0), 582.8, True),
    ],
)
def test_a_row_is_explained_by_the_path_of_its_line(row, made, own_hz, is_kept):
    fast = table_of(FAST, [589.0, 642.0], [6, 8])
    slow = table_of(row, [own_hz], [1])
    found = unexplained(slow, lines_of(heard(*made)), [fast, slow])
    assert found.tolist() == [is_kept]


@pytest.mark.parametrize(
    ("fast", "fast_hz", "slow", "is_kept"),
    [
        (FAST, [589.0, 642.0], SLOW | {"speed_std_mps": 0.08}, False),
        # its speed is better known than that of what would explain it
        (FAST, [589.0, 642.0], SLOW | {"speed_std_mps": 0.05}, True),
        # more lines tell it
        (FAST, [589.0], SLOW, True),
        # it is heard by another sensor
        (FAST | {"sensor": "h2"}, [589.0, 642.0], SLOW, True),
    ],
)
def test_a_row_is_explained_by_what_is_better_known_and_of_more_lines(fast, fast_hz, slow, is_kept):
    """Two pieces of the fast vessel's line, on its way out."""
    known = table_of(fast, fast_hz, list(range(6, 6 + len(fast_hz))))
    table = table_of(slow, [584.0, 584.0], [1, 1])
    lines = lines_of(heard(FAST, 589.0, 64.0, 110.0))
    assert unexplained(table, lines, [known]).tolist() == [is_kept]


def test_rows_at_one_time_compete_and_the_better_known_one_is_not_explained():
    fast = table_of(FAST, [589.0], [1])
    lines = lines_of(heard(FAST, 589.0, 64.0, 110.0))
    worse = table_of(FAST | {"speed_std_mps": 2.0}, [589.0], [1])
    assert unexplained(worse, lines, [fast]).tolist() == [True]
    slow = table_of(SLOW, [584.0], [2])
    assert unexplained(fast, lines, [slow]).tolist() == [True]
    assert unexplained(encounters_of(SLOW), lines, [fast]).tolist() == [True]
