"""Lines of a machine whose speed jumps: they keep their ids, and strangers do not."""

import numpy as np
import pytest

from tests.draws.line_sounds import STEP_S, Scene, score, tracked
from tests.lines.line_scenes import line_peaks
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.estimation.kalman import KalmanState
from uwtrack_cli.lines.stitching import BEARING_SIGMAS, bearing_distance
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.tracking.track_store import UNKNOWN_BEARING_VARIANCE

N_BEFORE, N_AFTER = 160, 160
TEETH = np.array([3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])


def jumping(ratio, *, seed=1, bearings=None, base_hz=47.3):
    """Lines at multiples of a rate that changes at once; bearings before and after."""
    before = np.tile(base_hz * TEETH, (N_BEFORE, 1))
    after = before * np.reshape(ratio, (1, -1))
    bearing = None
    if bearings is not None:
        bearing = np.repeat(bearings, [N_BEFORE, N_AFTER])[:, None] * np.ones(TEETH.size)
    peaks = line_peaks(np.concatenate([before, after]), bearing, seed=seed)
    return Lines.join(list(track_lines(iter([peaks]))))


def names(lines, first, stop):
    """Numbers that have most of their points in some frames."""
    inside = (lines.frame >= first) & (lines.frame < stop)
    found, count = np.unique(lines.line[inside], return_counts=True)
    return set(found[count > 0.5 * (stop - first)].tolist())


@pytest.mark.parametrize("ratio", [0.95, 0.99, 1.02, 1.05])
def test_the_lines_of_a_family_keep_their_numbers_through_a_jump(ratio) -> None:
    lines = jumping(ratio)
    before, after = names(lines, 0, N_BEFORE), names(lines, N_BEFORE, 2 * N_BEFORE)
    assert len(before) == TEETH.size
    assert len(before & after) >= TEETH.size - 1
    # each goes on at its own place, and all are one contact
    for number in before & after:
        own = lines.line == number
        early = np.median(lines.frequency_hz[own & (lines.frame < N_BEFORE)])
        late = np.median(lines.frequency_hz[own & (lines.frame > N_BEFORE + 20)])
        assert late / early == pytest.approx(ratio, rel=1e-3)
    kept = np.isin(lines.line_id, sorted(before & after))
    assert np.unique(lines.line_contact[kept]).size == 1
    # and the jump is told: frames come every half second
    assert lines.jump_time_s == pytest.approx([0.5 * N_BEFORE], abs=2.0)
    assert np.abs(lines.jump_ratio - ratio) < 4.0 * lines.jump_ratio_std
    assert 0.0 < lines.jump_ratio_std < 1e-3
    assert lines.jump_line_count >= TEETH.size - 1
    assert lines.jump_contact == lines.line_contact[kept][0]


def test_lines_that_change_each_by_its_own_ratio_are_others() -> None:
    """Other machines that begin when some stop have no ratio in common."""
    rng = np.random.default_rng(5)
    for seed in range(4):
        ratio = 1.0 + rng.uniform(0.015, 0.07, TEETH.size) * rng.choice([-1, 1], 7)
        lines = jumping(ratio, seed=seed)
        before, after = names(lines, 0, N_BEFORE), names(lines, N_BEFORE, 2 * N_BEFORE)
        assert len(before) == TEETH.size
        assert not before & after
        assert lines.jump_time_s.size == 0


def test_a_family_that_begins_on_another_bearing_is_another() -> None:
    same = jumping(1.03, bearings=(40.0, 40.0))
    other = jumping(1.03, bearings=(40.0, 130.0))
    assert names(same, 0, N_BEFORE) & names(same, N_BEFORE, 2 * N_BEFORE)
    assert not names(other, 0, N_BEFORE) & names(other, N_BEFORE, 2 * N_BEFORE)


def test_three_lines_are_too_few_for_a_ratio() -> None:
    """Three that stop and three that begin have a ratio in common by chance too often."""
    teeth = TEETH[:3]
    before = np.tile(47.3 * teeth, (N_BEFORE, 1))
    peaks = line_peaks(np.concatenate([before, 1.04 * before]), seed=3)
    lines = Lines.join(list(track_lines(iter([peaks]))))
    assert not names(lines, 0, N_BEFORE) & names(lines, N_BEFORE, 2 * N_BEFORE)


@pytest.mark.parametrize("ratio", [0.96, 1.03])
def test_trace_keeps_the_numbers_of_a_family_through_a_jump(ratio) -> None:
    """Paths of the low teeth bridge the jump, those of the high ones end and begin."""
    teeth = np.array([3.0, 5.0, 8.0, 12.0, 17.0, 24.0])
    rate = 51.3 * np.repeat([1.0, ratio], 100)
    scene = Scene(teeth[:, None] * rate, np.full(teeth.size, 12.0))
    lines = tracked(scene, 3, "trace")
    found = score(scene, lines)
    assert found.ids == 1.0
    assert found.purity > 0.99
    assert found.cover.min() > 0.93
    points = np.stack([lines.line, lines.frame])
    assert np.unique(points, axis=1).shape == points.shape
    assert lines.jump_time_s == pytest.approx([100 * STEP_S], abs=1.0)
    assert np.abs(lines.jump_ratio - ratio) < 4.0 * lines.jump_ratio_std
    assert lines.jump_line_count >= teeth.size - 1


def test_trace_gives_no_number_to_lines_without_a_common_ratio() -> None:
    ratio = np.array([1.03, 0.955, 1.05, 0.97, 1.062, 0.94])
    places = np.linspace(300.0, 1700.0, 6)[:, None]
    scene = Scene(places * np.where(np.arange(200) < 100, 1.0, ratio[:, None]), np.full(6, 12.0))
    lines = tracked(scene, 4, "trace")
    assert score(scene, lines).ids == 2.0
    assert lines.jump_time_s.size == 0


def test_bearings_tell_which_ends_and_beginnings_may_be_one_vessel() -> None:
    def at(bearing_deg, std_deg):
        zero = np.zeros((2, len(bearing_deg)))
        variance = np.array([zero[0], np.square(std_deg)])
        return KalmanState(np.array([zero[0], bearing_deg]), zero, variance, zero, zero)

    unknown = np.sqrt(UNKNOWN_BEARING_VARIANCE)
    ends = KalmanState(*(each[..., None] for each in at([359.0, 90.0], [2.0, unknown])))
    begins = at([2.0, 20.0, 20.0], [2.0, 2.0, 9.0])
    # 3 and 21 degrees apart: four deviations are 11 with two good bearings, 37 with one
    is_one = bearing_distance(ends, begins) < BEARING_SIGMAS**2
    assert is_one.tolist() == [[True, False, True], [True] * 3]
