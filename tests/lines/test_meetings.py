"""Lines that run together for a minute: who is who afterwards."""

import numpy as np
import pytest

from uwtrack_cli.data.lines import COASTED, DETECTED
from uwtrack_cli.lines.line_points import LinePoints
from uwtrack_cli.lines.paths.meetings import MOST_FRAMES, Meetings

HOP_S, STD_HZ, N_FRAMES, WINDOW = 0.5, 0.1, 240, 60
TIME_S = np.arange(N_FRAMES) * HOP_S
RATE_HZPS = 0.05


def points(line, frame, frequency_hz, snr_db=12.0):
    """Points of one line, as a path gives them."""
    state = np.zeros((frame.size, 5, 2))
    state[:, 0, 0], state[:, 2, 0], state[:, 2, 1] = frequency_hz, STD_HZ**2, 1e9
    measured = np.full((frame.size, 6), np.nan)
    measured[:, 0], measured[:, 1], measured[:, 5] = frequency_hz, STD_HZ, snr_db
    kind = np.full(frame.size, DETECTED)
    number = np.full(frame.size, line)
    return LinePoints(number, frame, TIME_S[frame], state, measured, kind)


def told(*lines):
    """Push points window by window; return those that left, and what left when."""
    meetings = Meetings(1.0, 1e-4)
    whole = LinePoints.join([points(k, *line) for k, line in enumerate(lines, 1)])
    parts = []
    for begin in range(0, N_FRAMES, WINDOW):
        there = (whole.frame >= begin) & (whole.frame < begin + WINDOW)
        parts.append(meetings.push(whole.take(there), begin + WINDOW))
    held = [part.line.size for part in parts]
    return LinePoints.join([*parts, meetings.finish()]).sorted(), held


def courses(away_hz, seed=1):
    """Two noisy courses on either side of 500 Hz, shape (frame, 2)."""
    noise = STD_HZ * np.random.default_rng(seed).standard_normal((N_FRAMES, 2))
    return 500.0 + np.stack([away_hz, -away_hz], axis=1) + noise


FRAME = np.arange(N_FRAMES)
CROSSING = RATE_HZPS * (TIME_S - TIME_S[N_FRAMES // 2])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("rate_hzps", [0.05, 0.1, 0.5])
def test_paths_that_have_changed_places_change_back(rate_hzps, seed):
    crossing = CROSSING * rate_hzps / RATE_HZPS
    one, two = courses(crossing, seed).T
    middle = N_FRAMES // 2
    changed = [np.append(one[:middle], two[middle:]), np.append(two[:middle], one[middle:])]
    # one of them goes astray where the two cannot be told apart
    changed[1][np.abs(crossing) < 0.4] += 6.0
    for paths in ([one, two], changed):
        found, _ = told(*((FRAME, path) for path in paths))
        for line, truth in ((1, crossing), (2, -crossing)):
            mine = found.take(found.line == line)
            assert np.abs(mine.frequency_hz - 500.0 - truth[mine.frame]).max() < 1.3
        assert found.line.size == 2 * N_FRAMES
        put = found.association == COASTED
        assert put.any() == (paths is changed)
        assert np.isnan(found.measured[put]).all()


def test_a_path_that_went_astray_is_not_the_line_that_parts():
    """Two lines within a bin have one ridge, and the other path follows noise."""
    one, two = courses(CROSSING).T
    snr_db = np.full(N_FRAMES, 12.0)
    two[90:150], snr_db[90:150] = two[90:150] + 5.0, 1.0
    found, _ = told((FRAME, one), (FRAME, two, snr_db))
    end = found.take(found.frame == N_FRAMES - 1)
    assert end.line.tolist() == [1, 2]
    assert end.frequency_hz[0] > 500.0 > end.frequency_hz[1]


def test_a_line_lost_in_the_meeting_is_the_one_that_begins_there():
    one, two = courses(CROSSING).T
    # the path of the first ends, that of the second goes on with the first one's line
    late = np.append(two[:120], one[120:])
    found, _ = told((FRAME[:100], one[:100]), (FRAME, late), (FRAME[150:], two[150:]))
    assert set(found.line.tolist()) == {1, 2}
    end = found.frame == N_FRAMES - 1
    assert (found.frequency_hz[end] - 500.0) * CROSSING[-1] == pytest.approx(
        [CROSSING[-1] ** 2, -(CROSSING[-1] ** 2)], abs=1.5
    )


def test_lines_that_come_near_and_turn_back_keep_their_numbers():
    away = np.abs(CROSSING) + 0.8
    found, _ = told(*((FRAME, path) for path in courses(away).T))
    above = found.frequency_hz > 500.0
    assert (above == (found.line == 1)).all()


def test_lines_that_always_run_beside_each_other_are_not_held():
    found, held = told(*((FRAME, path) for path in courses(np.full(N_FRAMES, 0.7)).T))
    assert held == [2 * WINDOW] * (N_FRAMES // WINDOW)
    assert (found.association == DETECTED).all()


def test_what_never_parts_leaves_as_it_came():
    away = np.maximum(-CROSSING, 0.0)  # they come together and stay
    meetings = Meetings(1.0, 1e-4)
    paths = courses(away).T
    n_out = 0
    for begin in range(0, 2 * N_FRAMES, WINDOW):
        frame = np.arange(begin, begin + WINDOW)
        parts = []
        for line, path in enumerate(paths, 1):
            part = points(line, frame % N_FRAMES, path[np.minimum(frame, N_FRAMES - 1)])
            parts.append(LinePoints(
                part.line, frame, frame * HOP_S, part.state, part.measured,
                part.association,
            ))  # fmt: skip
        n_out += meetings.push(LinePoints.join(parts), begin + WINDOW).line.size
        first = int(np.argmax(2.0 * away < 3.0))
        if begin + WINDOW <= first + MOST_FRAMES - 10:
            assert n_out <= 2 * (first + 5)
    assert n_out == 4 * N_FRAMES
