"""What the search of paths is made of, against enumeration, scipy and laws."""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import median_filter
from scipy.special import i0
from scipy.stats import binom, gamma, multivariate_normal, ncx2

from uwtrack_cli.estimation.kalman import KalmanState, predict
from uwtrack_cli.estimation.noise_floor import EDGE_STEP, TILE_BINS
from uwtrack_cli.lines.paths import path_search
from uwtrack_cli.lines.paths.path_search import MOVE_PENALTY, FoundPath
from uwtrack_cli.lines.paths.path_tracer import is_heir
from uwtrack_cli.lines.paths.recording_noise import RecordingNoise, _filled, _shifts
from uwtrack_cli.lines.paths.trace_threshold import PathBearing, PathScores, TraceThreshold
from uwtrack_cli.lines.paths.trace_window import WindowData
from uwtrack_cli.lines.sensitivity import (
    amplitude_log_ratio,
    detection_probabilities,
    false_lines_by_count,
    line_power_density,
    weakest_by_count,
    weakest_by_path,
    weakest_by_score,
)
from uwtrack_cli.lines.stitching import FamilyJumps, PieceEnds, course_distance, told_jump

PER_BIN = 2


def test_the_interval_of_greatest_sum_is_that_of_all_intervals():
    rng = np.random.default_rng(1)
    for _ in range(50):
        values = rng.normal(-0.1, 1.0, 12)
        intervals = list(combinations(range(13), 2))
        best = max(intervals, key=lambda ab: values[slice(*ab)].sum())
        assert path_search._greatest_sum(values) == best


def test_own_frames_are_those_that_no_other_line_is_near_in():
    rng = np.random.default_rng(2)
    for _ in range(40):
        cells = np.full(30, 20)
        others = [
            FoundPath(rng.integers(16, 25, 30), first, first + length, 1.0)
            for first, length in rng.integers(1, 14, (2, 2))
        ]
        interval = (3, 27)
        own = [
            k
            for k in range(*interval)
            if not any(o.first <= k < o.stop and abs(o.cells[k] - 20) <= PER_BIN for o in others)
        ]
        assert path_search._own_frames(cells, interval, others, PER_BIN) == (own[0], own[-1] + 1)
    whole = FoundPath(np.full(30, 20 + PER_BIN), 0, 30, 1.0)
    assert path_search._own_frames(cells, (3, 27), [whole], PER_BIN) == (0, 0)


@pytest.mark.parametrize("strength", [1.0, 900.0, 3e4, 1e12])
def test_what_a_line_leaks_beyond_its_noise_is_masked(strength):
    """And not twice as far: beyond two bins Hann's side lobes fall by 18 dB an octave,
    and the mask as if they fell by half of that."""
    power_ratio = np.full((4, 300), strength)
    power_ratio[1] = np.nan
    scores, cells = np.zeros((4, 300)), np.array([150, 151, 150, 5])
    path_search._mask(scores, power_ratio, cells, PER_BIN)
    bins = np.arange(2.5, 200.0, 0.001)
    leaked_db = 10.0 * np.log10(strength) - 31.0 - 30.0 * np.log10(bins / 2.4)
    least = bins[np.argmax(leaked_db < 0.0)] if (leaked_db < 0.0).any() else np.inf
    away = np.abs(np.arange(300) - cells[:, None])
    is_masked = scores == path_search._MASKED
    assert np.array_equal(is_masked, away <= np.ceil(PER_BIN * least - 0.002))
    assert set(np.unique(scores)) <= {0.0, path_search._MASKED}
    bins = (np.arange(300) - 150.3) / PER_BIN
    hann = np.sinc(bins) / (1.0 - bins**2)
    assert (is_masked[0] | (strength * hann**2 < 1.0)).all()


def accepted(seed, expected, least):
    rng = np.random.default_rng(seed)
    total, moves = path_search.best_scores(rng.normal(0.0, 1.0, (24, 60)), MOVE_PENALTY)
    found = path_search._accepted(total, moves, least, np.asarray(expected, np.int64), PER_BIN)
    return total, moves, found


@pytest.mark.parametrize("seed", range(6))
def test_paths_are_taken_one_after_another_if_they_share_little(seed):
    expected = [12, 40]
    least = PathScores(9.0, 4.0)
    total, moves, found = accepted(seed, expected, least)
    tops = [
        c for c in range(60)
        if (c == 0 or total[c] > total[c - 1]) and (c == 59 or total[c] >= total[c + 1])
    ]  # fmt: skip
    left = []
    for cell in sorted(tops, key=lambda c: -total[c]):
        path = path_search.trace_back(moves, np.array([cell]))[0]
        is_expected = min(abs(path[0] - e) for e in expected) <= 2 * PER_BIN
        if total[cell] > 9.0 or (is_expected and total[cell] > 4.0):
            left.append((path, total[cell]))
    wanted = []
    for path, score in left:
        shares = [np.mean(np.abs(path - other) <= 2 * PER_BIN) for other, _ in wanted]
        if all(share <= path_search._SHARED for share in shares):
            wanted.append((path, score))
    assert len(found) == len(wanted) > 0
    for (path, score), (own, own_score) in zip(found, wanted, strict=True):
        assert np.array_equal(path, own)
        assert score == own_score


def test_two_paths_are_one_line_within_a_bin_in_at_least_four_frames():
    cells = np.full(9, 50)
    data = SimpleNamespace(frame=100 + np.arange(9), cells_per_bin=PER_BIN)
    path = FoundPath(cells, 0, 9, 1.0)
    early = 96 + np.arange(9)  # five frames in common
    assert is_heir(data, path, data.frame, cells + PER_BIN)
    assert not is_heir(data, path, data.frame, cells + PER_BIN + 1)
    assert is_heir(data, replace(path, stop=4), early, cells)
    assert not is_heir(data, replace(path, stop=3), early, cells)
    far = np.where(np.arange(9) >= 4, cells - PER_BIN, 0)  # only common frames count
    assert is_heir(data, path, early, far)


def test_a_cells_score_is_the_likelihood_of_a_steady_line_up_to_its_cap():
    power = np.array([0.0, 0.5, 2.0, 5.0, 12.0, 40.0, np.nan])
    plain = np.log(i0(2.0 * np.sqrt(1.5 * power[:-1]))) - 1.5
    wanted = [s if s < 4.0 else 4.0 + 0.5 * np.log(1.0 + s - 4.0) for s in plain]
    assert path_search.cell_scores(power) == pytest.approx([*wanted, 0.0], rel=1e-5)
    assert plain[3] < 4.0 < plain[4]


def test_whitening_divides_by_the_running_median_of_the_limited_mean():
    rng = np.random.default_rng(3)
    shape = 1.0 + 3.0 * np.exp(-(((np.arange(400) - 250) / 60.0) ** 2))
    shape[:60] = 0.1
    ratio = (shape * rng.exponential(1.0, (80, 400))).astype(np.float32)
    ratio[:5], ratio[:, 100] = np.nan, 500.0
    mean = np.nanmean(np.minimum(ratio, 6.0), axis=0, dtype=float)
    running = median_filter(mean, size=2 * 16 * PER_BIN + 1, mode="mirror")
    wanted = ratio / np.clip(running, 0.5, 10.0)
    assert np.allclose(path_search.whiten(ratio, PER_BIN), wanted, rtol=1e-5, equal_nan=True)
    assert (running < 0.5).any()


@pytest.mark.parametrize("slope", [2.0, -1.5, 0.0, 40.0, -40.0])
def test_noise_that_rises_to_an_end_of_the_band_rises_on_by_its_power_law(slope):
    """The floor is constant beyond the middles of the outer tiles."""
    width = TILE_BINS * PER_BIN
    frequency = 20.0 + 0.5 * np.arange(6 * width + 3)
    low, high = round(0.5 * width - 0.5), round(5.5 * width - 0.5)
    middle = np.clip(np.arange(frequency.size), low, high)
    floor = np.tile((frequency[middle] / 100.0) ** slope, (3, 1))
    floor[1] = np.nan
    raised = path_search.beyond_outer_tiles(floor, frequency, PER_BIN)
    wanted = np.ones(frequency.size)
    rising, there = (low, slice(0, low)) if slope < 0.0 else (high, slice(high, None))
    inner = rising + width * (1 if slope < 0.0 else -1)
    if 0.0 < slope * np.log(frequency[rising] / frequency[inner]) < EDGE_STEP:
        wanted[there] = ((frequency / frequency[middle]) ** slope)[there]
    assert (wanted > 1.0).any() == (slope in {2.0, -1.5})
    assert np.allclose(raised, wanted, rtol=1e-5)
    one_tile = path_search.beyond_outer_tiles(floor[:, :width], frequency[:width], 2)
    assert np.array_equal(one_tile, np.ones(width))


@pytest.mark.parametrize(
    ("silent", "moved", "is_bridge"),
    [(12, 8, True), (12, 7, False), (30, 15, True), (30, 14, False), (5, 20, False)],
)
def test_a_path_goes_from_line_to_line_when_it_crosses_noise_fast(silent, moved, is_bridge):
    """At least eight cells and half a cell per frame; silent for more than by chance."""
    ratio = np.concatenate([np.full(40, 8.0), np.full(silent, 0.2), np.full(40, 8.0)])
    steps = np.concatenate([np.zeros(40), np.linspace(0, moved, silent), np.full(40, moved)])
    cells = 30 + np.round(steps).astype(int)
    if silent == 5:
        ratio[40:45] = 1.6
    found = path_search.line_intervals(ratio, cells)
    whole = [(0, ratio.size)]
    assert found == ([(0, 40), (40 + silent, 80 + silent)] if is_bridge else whole)
    power = np.full((ratio.size, 100), 0.5)
    power[np.arange(ratio.size), cells] = ratio
    along = path_search._lines_along(cells, power, PER_BIN)
    assert len(along) == len(found)
    if is_bridge:  # each goes straight on where the path goes over
        assert set(along[0][0][: 40 + silent].tolist()) == {30}
        assert set(along[1][0][40:].tolist()) == {30 + moved}


def test_a_gap_says_nothing_of_where_a_line_ends():
    ratio = np.concatenate([np.full(40, 8.0), np.full(10, np.nan), np.full(40, 0.2)])
    assert path_search.line_intervals(ratio, np.full(90, 30)) == [(0, 40)]
    few = np.append(ratio[:50], 2.0)  # a faint frame is too little to end it
    assert path_search.line_intervals(few, np.full(51, 30)) == [(0, 51)]


@pytest.mark.parametrize("is_masked", [False, True])
def test_the_evidence_of_one_bearing_is_half_of_hotellings_statistic(is_masked):
    rng = np.random.default_rng(10)
    n, n_cells = 40, 120
    power = rng.exponential(1.0, (n, n_cells)) + 0.1
    usual = np.array([0.2, -0.1])
    parts = usual[:, None, None] * power + 0.3 * rng.normal(size=(2, n, n_cells))
    path = 60 + np.arange(n) // 20
    parts[:, np.arange(n), path] += [[0.3], [0.2]]
    floor = rng.uniform(0.5, 2.0, (n, n_cells))
    data = WindowData(
        frame=np.arange(n), time_s=1.0 * np.arange(n), is_valid=np.arange(n) != 3,
        frequency_hz=1.0 * np.arange(n_cells), power=power, floor=floor,
        east=parts[0], north=parts[1], window_s=1.0, cells_per_bin=PER_BIN,
        exponent=np.zeros(n),
    )  # fmt: skip
    mask = np.zeros(power.shape, bool)
    mask[10:14] = is_masked
    rows = [k for k in range(n) if k != 3 and not (is_masked and 10 <= k < 14)]
    vectors = []
    for k in rows:
        off = PER_BIN * np.arange(3, 25)
        near = np.concatenate([path[k] - off, path[k] + off])
        background = np.median(parts[:, k, near] / power[k, near], axis=1)
        own = parts[:, k, path[k]] - background * power[k, path[k]]
        vectors.append(own / floor[k, path[k]])
    vectors = np.array(vectors)
    total = vectors.sum(axis=0)
    wanted = 0.5 * total @ np.linalg.inv(vectors.T @ vectors) @ total
    test = PathBearing(data, 2.5, 0.0).without(mask)
    assert test.scores(path[None]) == pytest.approx([2.5 * wanted])
    # too few frames say nothing, and neither does an omnidirectional sensor
    short = PathBearing(data.take(slice(0, 16)), 2.5, 0.0)
    assert short.scores(path[None, :16]).tolist() == [0.0]
    assert PathBearing(data.take(slice(0, 17)), 2.5, 0.0).scores(path[None, :17])[0] > 0.0
    omni = PathBearing(replace(data, east=None, north=None), 2.5, 0.0)
    assert omni.scores(path[None]).tolist() == [0.0]


def test_the_threshold_with_a_bearing_is_that_of_the_sum_of_two_exponentials():
    rule = TraceThreshold(2.0, 0.5, 2, 0.5, 120)
    n = 120
    ones = np.ones((n, 80))
    data = WindowData(
        frame=np.arange(n), time_s=1.0 * np.arange(n), is_valid=np.ones(n, bool),
        exponent=np.zeros(n),
        frequency_hz=1.0 * np.arange(80), power=ones, floor=ones, east=ones,
        north=ones, window_s=1.0, cells_per_bin=PER_BIN,
    )  # fmt: skip
    plain, found = rule.scores(n), rule.scores_with_bearing(data)
    slope, offset = 2.401, -16.16
    for power_alone, both in zip(plain[:2], found[:2], strict=True):
        rate = np.exp(-(power_alone - offset) / slope)
        assert gamma.sf((both - offset) / slope, 2) == pytest.approx(min(rate, 1.0))
    assert (found.bearing.slope, found.bearing.least_score) == (slope, offset)


def test_gaps_are_filled_with_the_cells_that_follow():
    rng = np.random.default_rng(5)
    values, gaps = rng.normal(size=(20, 15)), rng.random((20, 15)) < 0.4
    filled = _filled(values, gaps)
    for row, gap, own in zip(values, gaps, filled, strict=True):
        free = np.flatnonzero(~gap)
        assert np.array_equal(own[free], row[free])
        begins = np.flatnonzero(gap & ~np.append(False, gap[:-1]))
        for begin in begins:
            end = begin + int(np.argmin(np.append(gap[begin:], False)))
            after = free[free > begin]
            count = min(end - begin, after.size)
            assert np.array_equal(own[begin : begin + count], row[after[:count]])


def test_neighbouring_frames_are_shifted_apart_and_all_ways():
    shift = _shifts(np.random.default_rng(6), 3000, 8, 4)
    assert np.abs(np.diff(shift)).min() == 4
    assert abs(shift[0]) >= 4
    counts = np.bincount(shift + 8)
    assert counts.size == 17
    assert counts.min() > 60
    assert np.abs(np.diff(_shifts(np.random.default_rng(6), 99, 3, 4))).min() == 3


def test_a_recordings_noise_raises_the_threshold_by_its_mean_excess():
    noise = RecordingNoise(70, PER_BIN)
    assert np.isnan(noise.relative_rate())
    width, white, slope = 32, -20.0, 2.5
    excess = np.array([[3.0, -1.0], [5.0, -3.0], [1.0, 0.5]])
    passed = np.zeros(2)
    for count, own in enumerate(excess, 1):
        mean = excess[:count].sum(axis=0) / (count + 5.0)  # as if five were white
        raised = np.maximum(mean, 0.0)
        cells = noise.note(white + own, white, slope)
        assert cells == pytest.approx([*np.repeat(raised, width), *[raised[-1]] * 6])
        passed += np.exp(-raised / slope)
    rate = np.mean(np.exp(mean / slope) * passed / 3.0)
    assert noise.relative_rate() == pytest.approx(rate)


def test_thresholds_follow_the_stated_rate_of_false_lines():
    """Twice as many lines or half as long windows: the slope of the tail times ln 2."""
    rule = TraceThreshold(2.0, 0.5, 2, 0.5, 120)
    slope, offset = 2.401, -16.16
    # windows overlap by half, and a kHz of one-second frames has a thousand bins
    per_window = 2.0 * (0.5 * 120 * 0.5) / 3600.0
    new = offset - slope * np.log(per_window)
    assert rule.scores(120).new == pytest.approx(new)
    assert rule.scores(120).continued == pytest.approx(new - slope * np.log(1e3))
    offset_90, slope_90 = (-3.44 - 16.16) / 2, (2.362 + 2.401) / 2
    wanted = offset_90 - slope_90 * np.log(0.75 * per_window)
    assert rule.scores(90).new == pytest.approx(wanted)
    mean, slope = rule.surrogate_tail(90)
    assert (mean, slope) == pytest.approx(((-15.47 - 34.78) / 2, slope_90))
    plain = rule.weakest_line_snr_db(has_bearing=False)
    assert plain == weakest_by_path(new, 120, 0.05)
    # the product of hop and resolution counts, not the hop
    longer = replace(rule, hop_s=4.0)
    assert longer.scores(120) == rule.scores(120)
    with_bearing = rule.weakest_line_snr_db(has_bearing=True)
    assert with_bearing == weakest_by_path(-16.16 + 2.401, 120, 0.05) < plain


def test_a_lines_power_has_rices_density():
    snr, power = np.array([0.1, 1.0, 9.0]), np.linspace(0.01, 20.0, 7)
    wanted = 2.0 * ncx2.pdf(2.0 * power, 2, 2.0 * snr[:, None])
    assert np.allclose(line_power_density(snr, power), wanted)


@pytest.mark.parametrize("threshold", [0.0, 3.0, 14.0, 80.0])
def test_a_line_is_detected_as_often_as_the_noncentral_chi_square_says(threshold):
    snr = np.array([0.0, 0.16, 2.0, 30.0, 316.0, 2000.0])
    wanted = ncx2.sf(2.0 * threshold, 2, 2.0 * snr)
    found = detection_probabilities(threshold, snr)
    assert np.allclose(found, wanted, rtol=1e-12, atol=0.0)


GRID_DB = np.arange(-8.0, 25.0, 0.1)


def first_above(values, level):
    return GRID_DB[np.flatnonzero(values > level)[0]]


def test_the_weakest_line_of_counted_hits_is_started_every_other_time():
    power_ratio = 10.0 ** (GRID_DB / 10.0)
    seen = ncx2.sf(2.0 * 6.0, 2, 2.0 * power_ratio)
    # a hit, and two more in the four frames after it
    started = seen * (1.0 - binom.cdf(1, 4, seen))
    wanted = first_above(1.0 - (1.0 - started) ** 119.0, 0.5)
    assert weakest_by_count(6.0, 3, 5, 119.0) == pytest.approx(wanted)


def test_false_lines_of_counted_hits_are_births_that_find_noise_in_their_gates():
    per_frame_khz, resolution_hz, hop_s = 3.0, 0.5, 0.25
    in_gate = 1.0 - np.exp(-per_frame_khz / 1000.0 * 2.2 * resolution_hz)
    births_per_hour = per_frame_khz * 3600.0 / hop_s
    wanted = births_per_hour * (1.0 - binom.cdf(1, 4, in_gate))
    found = false_lines_by_count(per_frame_khz, resolution_hz, 3, 5, hop_s)
    assert found == pytest.approx(wanted)


def test_the_weakest_line_of_scores_reaches_its_threshold_on_average():
    rng = np.random.default_rng(7)
    threshold, detection, level = 3.0, 0.4, 6.0

    def gain(snr_db):
        return amplitude_log_ratio(1.0 + 10.0 ** (snr_db / 10.0), 1.6)

    found_db = weakest_by_score(gain, threshold, detection, level, 120.0)
    power = 0.5 * rng.noncentral_chisquare(2, 2.0 * 10.0 ** (found_db / 10.0), 400_000)
    hit = np.maximum(power[power > threshold], 1.1)
    rise = np.log(1.0 - detection + np.exp(gain(10.0 * np.log10(hit - 1.0)) - 0.6))
    drift = rise.sum() / power.size + np.mean(power <= threshold) * np.log(0.6)
    # within the step of a tenth of a decibel
    assert drift * 120.0 == pytest.approx(level, abs=0.8)
    path_db = weakest_by_path(11.0, 120, 0.05)
    power = 0.5 * rng.noncentral_chisquare(2, 2.0 * 10.0 ** (path_db / 10.0), 400_000)
    score = np.minimum(amplitude_log_ratio(power, 1.5), 4.0).mean() + 0.05
    assert score * 120.0 == pytest.approx(11.0, abs=1.5)


def course(value, covariance):
    """State of one frequency by its mean and its covariance."""
    return KalmanState(*value, *covariance[[0, 0, 1], [0, 1, 1]])


def test_two_courses_are_apart_as_two_gaussian_vectors():
    rng = np.random.default_rng(8)
    root = rng.normal(size=(2, 2, 2)) * [1.0, 0.1]
    (one, two), covariance = rng.normal(size=(2, 2)) * [2.0, 0.2], [r.T @ r for r in root]
    total = covariance[0] + covariance[1] + np.diag([0.3**2, 0.02**2])
    square, determinant = course_distance(
        course(one, covariance[0]), course(two, covariance[1]), 0.3, 0.02
    )
    found = -0.5 * (square + np.log((2.0 * np.pi) ** 2 * determinant))
    assert found == pytest.approx(multivariate_normal.logpdf(one, two, total))


@pytest.mark.parametrize("step_s", [3.0, -3.0])
def test_a_course_is_carried_either_way_by_white_acceleration(step_s):
    """Drawn ends of random walks of the rate, a thousand steps each; back in time with
    the density taken as negative."""
    rng = np.random.default_rng(9)
    density, n_steps = 0.01, 300
    start, spread = np.array([100.0, 0.5]), np.diag([0.04, 0.01])
    value = rng.multivariate_normal(start, spread, 20_000).T
    dt = step_s / n_steps
    for _ in range(n_steps):
        kick = rng.normal(0.0, np.sqrt(density * abs(dt)), 20_000)
        value = np.stack([value[0] + dt * (value[1] + 0.5 * kick), value[1] + kick])
    carried = predict(course(start, spread), step_s, np.copysign(density, step_s))
    assert np.allclose(carried[:2], value.mean(axis=1), atol=0.02)
    wanted = np.cov(value)[[0, 0, 1], [0, 1, 1]]
    assert np.allclose(carried[2:], wanted, rtol=0.04, atol=0.004)


def test_a_jump_is_told_by_the_weighted_mean_of_its_lines():
    log_ratio, std = np.array([0.10, 0.11, 0.13]), np.array([0.01, 0.02, 0.01])
    jump = told_jump(7.0, log_ratio, std**2, set())
    mean = np.average(log_ratio, weights=std**-2)
    chi_square = np.sum(((log_ratio - mean) / std) ** 2)
    spread = np.sqrt(max(chi_square / 2.0, 1.0) / np.sum(std**-2))
    assert jump.time_s == 7.0
    assert jump.ratio == pytest.approx(np.exp(mean))
    assert jump.ratio_std == pytest.approx(np.exp(mean) * spread)
    calm = told_jump(7.0, np.array([0.1, 0.1, 0.1]), std**2, set())
    assert calm.ratio_std == pytest.approx(np.exp(0.1) / np.sqrt(np.sum(std**-2)))


def ends_at(frequency_hz, time_s=0.0):
    n = len(frequency_hz)
    state = np.zeros((n, 5, 2))
    state[:, 0, 0], state[:, 2, 0], state[:, 2, 1] = frequency_hz, 0.01, 1e8
    times_s = np.broadcast_to(time_s, n).astype(float)
    return PieceEnds(np.arange(n), times_s, state, np.zeros((n, 2)))


def jumped(n_lines, n_others, seed, resolution_hz=1.0):
    """Frequencies of lines that have jumped by 5 %, among others that have begun."""
    rng = np.random.default_rng(seed)
    before = np.sort(rng.uniform(50.0, 900.0, n_lines))
    now = before * 1.05 + rng.uniform(-0.2, 0.2, n_lines) * resolution_hz
    return before, np.append(now, rng.uniform(50.0, 900.0, n_others))


def common(before, now, may_be=None, resolution_hz=1.0):
    everything = np.ones((len(before.line), len(now)), dtype=bool)
    may_be = everything if may_be is None else may_be
    return FamilyJumps(resolution_hz).common(before, ends_at(now), may_be)


def test_lines_that_have_one_ratio_have_jumped_together():
    before, now = jumped(6, 8, 1)
    assert sorted(common(ends_at(before), now)) == [(k, k) for k in range(6)]
    everything, jumps = np.ones((6, 6), dtype=bool), FamilyJumps(1.0)
    place = before * 1.05
    pairs = jumps._paired(place, ends_at(now[:6]), everything)
    assert sorted(pairs) == [(k, k) for k in range(6)]
    off = np.abs(now[:6] - place)
    assert [k for k, _ in pairs] == np.argsort(off).tolist()  # the nearest first
    # beyond half a resolution none is in reach
    assert jumps._paired(place, ends_at(place + 0.51), everything) == []
    assert len(jumps._paired(place, ends_at(place + 0.49), everything)) == 6


def test_two_lines_or_what_chance_pairs_is_no_jump():
    before, now = jumped(2, 0, 2)
    assert common(ends_at(before), now) == []
    rng = np.random.default_rng(3)
    looks = 0
    for _ in range(60):
        before, now = (np.sort(rng.uniform(50, 900, 12)) for _ in range(2))
        looks += bool(common(ends_at(before), now))
    assert looks <= 2  # one in a thousand is stated


def test_lines_that_may_be_no_other_count_for_nothing():
    """Forty lines that are silent and have no successor allowed are no trials."""
    rng = np.random.default_rng(5)
    own, now = jumped(4, 2, 4)
    before = np.append(own, rng.uniform(50.0, 900.0, 400))
    may_be = np.zeros((before.size, now.size), dtype=bool)
    may_be[:4] = True
    found = sorted(common(ends_at(before), now, may_be))
    assert found == sorted(common(ends_at(own), now)) == [(k, k) for k in range(4)]


def test_lines_whose_ends_lie_too_far_apart_have_not_jumped_together():
    before, now = jumped(4, 0, 4, resolution_hz=0.5)
    for wait_s, is_one in ((11.9, True), (12.1, False)):  # six windows of two seconds
        late = ends_at(before, np.array([0.0, 0.0, wait_s, wait_s]))
        assert bool(common(late, now, resolution_hz=0.5)) == is_one


def test_what_is_found_later_follows_a_jump_that_is_known():
    """A single line, within forty windows; by chance it would say nothing."""
    before, now = jumped(4, 0, 6)
    jumps = FamilyJumps(1.0)
    begins = replace(ends_at(now), line=10 + np.arange(4))
    _, pairs = jumps.find(ends_at(before), begins)
    assert len(pairs) == 4
    ratio = jumps.told[0].ratio
    for wait_s, is_late in ((39.0, False), (41.0, True)):
        end, begin = ends_at([333.0]), replace(
            ends_at([ratio * 333.0], wait_s), line=np.array([20])
        )  # fmt: skip
        found = jumps.find(end, begin)
        assert (found is None) == is_late
        assert found is None or found == (jumps.told[0].time_s, [(0, 0)])
    assert len(jumps.told) == 1
    # a short line ends soon after it has begun: it does not go on with itself
    assert FamilyJumps(1.0).find(ends_at(before), ends_at(now)) is None
