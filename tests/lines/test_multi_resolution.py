"""Rungs of a ladder are joined: each stretch once, by who hears it best, one number.

Acceptance holds lines of two lengths of frames joined.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tests.draws.line_sounds import SCENES, score
from tests.lines.ladder_scores import WINDOWS_S, doubled_share, rungs_of, spread
from tests.lines.line_scenes import some_frames
from uwtrack_cli.data.lines import DETECTED, Lines
from uwtrack_cli.errors import DataError
from uwtrack_cli.lines.contacts import LEAST_EVIDENCE
from uwtrack_cli.lines.families.lasting_families import no_families
from uwtrack_cli.lines.line_points import LinePoints, LineTable, to_lines
from uwtrack_cli.lines.multi_resolution import join_rungs
from uwtrack_cli.lines.rungs.best_basis import is_finer_best
from uwtrack_cli.motion.target_motion.inputs import measurements_from_lines
from uwtrack_cli.presence.line_summary import summarise

RATE_HZ = 2000.0


def drawn(window_s: float, *courses, duration_s: float = 80.0, sensor: str = "h1"):
    """Lines of frames of one length: (frequency at a time, power over noise in 1 Hz)."""
    hop_s = 0.5 * window_s
    n_frames = int((duration_s - window_s) / hop_s) + 1
    frames = replace(
        some_frames(n_frames),
        time_s=np.arange(n_frames) * hop_s + 0.5 * window_s,
        window_samples=round(window_s * RATE_HZ),
        hop_samples=round(hop_s * RATE_HZ),
        fft_length=2 * round(window_s * RATE_HZ),
        sensor=sensor,
    )
    parts = []
    for number, (course, power) in enumerate(courses, 1):
        frequency_hz, told = course(frames.time_s), power(frames.time_s) * window_s
        frame = np.flatnonzero(told > 0.0)
        state = np.zeros((frame.size, 5, 2))
        state[:, 0, 0], state[:, 2] = frequency_hz[frame], (0.01, np.inf)
        measured = np.full((frame.size, 6), np.nan)
        measured[:, 0], measured[:, 1] = frequency_hz[frame], 0.1
        measured[:, 4], measured[:, 5] = 60.0, 10.0 * np.log10(told[frame])
        parts.append(LinePoints(
            np.full(frame.size, number), frame, frames.time_s[frame], state, measured,
            np.full(frame.size, DETECTED),
        ))  # fmt: skip
    names = np.arange(1, len(courses) + 1)
    none = np.zeros(names.size, np.int64)
    table = LineTable(
        names, none, none - 1, np.full(names.size, "steady"), np.zeros(names.size), no_families()
    )
    scalars = {
        "reference": "full scale", "false_lines_per_khz_hour": 1.0,
        "weakest_line_snr_db": 3.0,
    }  # fmt: skip
    return to_lines(frames, LinePoints.join(parts), table, scalars)


def at(frequency_hz: float):
    return lambda time_s: np.full(time_s.size, frequency_hz)


def power(value: float, begin_s: float = 0.0, end_s: float = np.inf):
    return lambda time_s: np.where((time_s >= begin_s) & (time_s < end_s), value, 0.0)


def test_the_course_through_the_cells_has_the_greatest_evidence():
    rng = np.random.default_rng(5)
    for _ in range(30):
        gain = rng.normal(0.0, 4.0, 8)
        steps = rng.integers(1, 3, 7)

        def total(states, gain=gain, steps=steps):
            changes = np.diff(states) != 0
            return (gain * states).sum() - LEAST_EVIDENCE * (changes & (steps == 1)).sum()

        best = max(total(np.array(states)) for states in product((0, 1), repeat=8))
        assert total(is_finer_best(gain, steps).astype(int)) == pytest.approx(best)


def test_a_steady_line_is_told_by_the_longest_frames_and_once():
    lines = join_rungs([drawn(w, (at(100.0), power(10.0))) for w in WINDOWS_S])
    assert np.unique(lines.line).tolist() == [1]
    inside = (lines.time_s > 4.0) & (lines.time_s < 76.0)
    assert set(lines.window_s[inside]) == {8.0}
    assert doubled_share(lines) == 0.0


def test_the_number_goes_on_where_another_rung_hears_the_line_better():
    early, late = power(20.0, 0.0, 40.0), power(60.0, 40.0)
    lines = join_rungs([
        drawn(8.0, (at(100.0), early)),
        drawn(1.0, (at(100.0), power(4.0))),
        drawn(0.1, (at(100.0), late)),
    ])  # fmt: skip
    assert np.unique(lines.line).tolist() == [1]
    usual = [np.median(lines.window_s[np.abs(lines.time_s - t) < 8.0]) for t in (20.0, 60.0)]
    assert usual[0] == 8.0
    assert usual[1] == 0.1  # six times the noise in its cells
    assert lines.overlap_frames == 2.0
    nearest = lines.frames.time_s[lines.frame - lines.frames.first_frame]
    assert np.abs(nearest - lines.time_s).max() <= 0.5 * lines.frames.hop_s + 1e-9


def test_a_short_rise_of_a_line_is_that_line():
    """Two seconds that short frames tell, of a line that long ones follow."""
    lines = join_rungs(
        [drawn(8.0, (at(100.0), power(20.0))), drawn(0.1, (at(100.0), power(500.0, 40.0, 42.0)))]
    )
    assert set(lines.window_s) == {8.0, 0.1}
    assert np.unique(lines.line).tolist() == [1]


def test_two_lines_that_short_frames_do_not_resolve_stay_two():
    pair = (at(100.0), power(10.0)), (at(100.4), power(10.0))
    lines = join_rungs([
        drawn(8.0, *pair), drawn(1.0, (at(100.2), power(20.0))),
        drawn(0.1, (at(100.2), power(20.0))),
    ])  # fmt: skip
    assert np.unique(lines.line).size == 2
    inside = (lines.time_s > 4.0) & (lines.time_s < 76.0)
    for name, frequency_hz in ((1, 100.0), (2, 100.4)):
        own = inside & (lines.line == name)
        assert set(lines.frequency_hz[own]) == {frequency_hz}


def test_the_order_of_the_rungs_does_not_matter():
    rungs = [drawn(w, (at(100.0), power(10.0)), (at(200.0), power(w))) for w in WINDOWS_S]
    assert join_rungs(rungs).equals(join_rungs(rungs[::-1]))


def test_false_lines_of_all_rungs_add_up_and_the_keenest_tells_the_weakest():
    """Each rung starts lines of its own; SNRs of the cells of long frames are higher."""
    rungs = [drawn(w, (at(100.0), power(10.0))) for w in (8.0, 1.0, 0.1)]
    told = ((1.0, 5.0, 0.5), (2.0, 3.0, np.nan), (4.0, -7.0, 1.5))
    rates = [
        replace(
            one, false_lines_per_khz_hour=stated, weakest_line_snr_db=weakest_db,
            measured_false_lines_per_khz_hour=measured,
        )
        for one, (stated, weakest_db, measured) in zip(rungs, told, strict=True)
    ]  # fmt: skip
    joined = join_rungs(rates)
    assert joined.false_lines_per_khz_hour == 7.0
    assert joined.measured_false_lines_per_khz_hour == 2.0
    # in 1 Hz: 5 - 9, 3 and -7 + 10 dB
    assert joined.weakest_line_snr_db == 5.0
    assert np.isnan(join_rungs(rungs).measured_false_lines_per_khz_hour)


def test_one_rung_is_told_as_it_is():
    one = drawn(1.0, (at(100.0), power(10.0)))
    lines = join_rungs([one])
    assert np.array_equal(lines.frequency_hz, one.frequency_hz)
    assert set(lines.window_s) == {1.0}
    assert lines.of_window(1.0).line.size == one.line.size
    assert lines.of_window(8.0).line_id.size == 0


def test_what_cannot_be_joined_is_refused():
    one = drawn(1.0, (at(100.0), power(10.0)))
    with pytest.raises(DataError, match="there are no lines"):
        join_rungs([])
    with pytest.raises(DataError, match="2 sensors: h1, h2"):
        join_rungs([one, drawn(8.0, (at(100.0), power(10.0)), sensor="h2")])
    with pytest.raises(DataError, match="joined from several lengths of frames before"):
        join_rungs([join_rungs([one]), one])
    other = replace(one, frames=replace(one.frames, hop_samples=500))
    with pytest.raises(DataError, match=r"same share, got 0\.5, 0\.75"):
        join_rungs([one, other])


@pytest.mark.slow
def test_lines_that_sweep_lose_nothing_by_the_ladder():
    scene = SCENES["sweeps of 2 bins a frame"](np.random.default_rng([4242, 7]))
    rungs = rungs_of(scene, 4242)
    single = [score(scene, spread(one)) for one in rungs]
    second = single[WINDOWS_S.index(1.0)]  # a line keeps its id there, too
    assert second.cover.mean() >= 0.94
    assert second.ids <= 2.1
    lines = join_rungs(rungs)
    found = score(scene, spread(lines))
    assert found.cover.mean() >= max(0.95, *(one.cover.mean() for one in single))
    assert found.ids <= 2.0
    assert found.purity >= 0.97
    assert doubled_share(lines) < 0.02


def test_files_and_streams_know_the_rung_of_each_point():
    lines = join_rungs([drawn(w, (at(100.0), power(10.0))) for w in WINDOWS_S])
    half = lines.line.size // 2
    parts = [lines.take("point", slice(half)), lines.take("point", slice(half, None))]
    nothing = lines.frames.take("frame", slice(0, 0))
    parts[1] = replace(parts[1], frames=nothing).take("line", slice(0))
    assert np.array_equal(Lines.join(parts).window_s, lines.window_s)
    assert drawn(1.0, (at(100.0), power(10.0))).window_s is None


def test_what_follows_knows_the_length_of_the_frames_or_asks_for_one():
    lines = join_rungs([drawn(w, (at(107.0), power(10.0))) for w in WINDOWS_S])
    assert summarise(lines).resolution_hz.tolist() == [1.0 / 8.0]
    contact = replace(lines, line_contact=np.ones(1, np.int64))
    with pytest.raises(DataError, match=r"frames of 0\.1, 1, 8 s.*with --step"):
        measurements_from_lines(contact)
    (one,) = measurements_from_lines(contact.of_window(8.0))
    assert one.window_s == 8.0
    assert one.overlap_rows == 1


def jumped(lines: Lines, *jumps) -> Lines:
    """Lines with jumps: time, ratio and number of lines each; all of contact 1."""
    time_s, ratio, count = np.array(jumps, float).T
    return replace(
        lines, line_contact=np.ones(lines.line_id.size, np.int64), jump_time_s=time_s,
        jump_ratio=ratio, jump_ratio_std=np.full(count.size, 1e-3), jump_line_count=count,
        jump_contact=np.ones(count.size, np.int64),
    )  # fmt: skip


def test_a_jump_that_two_rungs_tell_is_told_once():
    pair = (at(107.0), power(10.0)), (at(207.0), power(10.0))
    lines = join_rungs([
        jumped(drawn(8.0, *pair), (42.0, 1.02, 1)),
        jumped(drawn(1.0, *pair), (40.0, 1.0205, 2), (60.0, 0.98, 2)),
        drawn(0.1, *pair),
    ])  # fmt: skip
    assert lines.jump_time_s.tolist() == [40.0, 60.0]
    assert lines.jump_line_count.tolist() == [2, 2]
    assert set(lines.jump_contact.tolist()) <= set(lines.line_contact.tolist())


def test_a_line_is_unresolved_for_as_long_as_its_rungs_say():
    early, late = (at(107.0), power(20.0, 0.0, 50.0)), (at(107.0), power(90.0, 30.0))
    unresolved = replace(drawn(0.1, late), line_unresolved_share=np.ones(1))
    lines = join_rungs([drawn(8.0, early), unresolved])
    assert lines.line_unresolved_share == pytest.approx([0.6], abs=0.06)
