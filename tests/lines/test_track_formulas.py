"""What the line trackers are made of, against scipy, enumeration and plain loops."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.special import i0
from scipy.stats import multivariate_normal, ncx2, norm

from tests.lines.line_scenes import line_peaks, some_frames
from uwtrack_cli.estimation.kalman import KalmanState
from uwtrack_cli.lines.contacts import group, has_doppler, has_turn, mains_lines
from uwtrack_cli.lines.families.comb_test import CombRule
from uwtrack_cli.lines.families.harmonics import comb_fit
from uwtrack_cli.lines.pair_evidence import LineSamples, PairEvidence, pair_evidence
from uwtrack_cli.lines.paths.path_ends import MeasuredPaths
from uwtrack_cli.lines.stitching import PieceEnds, log_ratio_of_return
from uwtrack_cli.lines.track_pda import Mixture, PdaLineTracker
from uwtrack_cli.lines.tracker_options import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    ProcessNoise,
    ScoreLogic,
    TrackerOptions,
)
from uwtrack_cli.lines.tracking.association import Associator, Pairs
from uwtrack_cli.lines.tracking.frame_peaks import Choice, split_frames
from uwtrack_cli.lines.tracking.line_continuation import LineContinuation, SilentLines
from uwtrack_cli.lines.tracking.llr_score import ECHO, ClutterDensity, LlrScore
from uwtrack_cli.lines.tracking.track_management import HitCounter, merge_lines
from uwtrack_cli.lines.tracking.track_store import TrackStore
from uwtrack_cli.lines.tracking.tracker import LineTracker, adapt_noise

RESOLUTION_HZ = 0.5
"""Of frames of two seconds, so that no unit is one by chance."""

LINE_WANDER, KINK, SIDE, TOLERANCE = 2e-5, 5.0, 17.0, 2.5
"""As stated: relative jitter, windows on either side of a kink, deviations."""


def states(n_lines, seed):
    rng = np.random.default_rng(seed)
    spread = rng.uniform(0.5, 2.0, (2, n_lines)) * [[0.02], [30.0]]
    rate_spread = rng.uniform(0.5, 2.0, (2, n_lines)) * [[1e-4], [0.5]]
    share = rng.uniform(-0.8, 0.8, (2, n_lines)) * np.sqrt(spread * rate_spread)
    position = np.stack([100.0 + 0.2 * np.arange(n_lines), rng.uniform(0, 360, n_lines)])
    rate = rng.normal(size=(2, n_lines)) * [[0.01], [0.5]]
    return KalmanState(position, rate, spread, share, rate_spread)


def store_of(state, n_confirmed=0, *, has_bearings=True, precision=100.0):
    store = TrackStore(capacity=64)
    if has_bearings:
        store.track_bearings()
    n = state.position.shape[1]
    density = np.tile([[1e-4], [1e-2]], n)
    store.start(
        state, density, np.full((6, n), np.nan), np.ones(n, bool), np.zeros(n),
        np.full(n, precision),
    )  # fmt: skip
    store.confirm(np.arange(n_confirmed), np.zeros(n_confirmed, np.int64))
    return store


def slow_frames(n_frames):
    frames = some_frames(n_frames)
    return replace(frames, time_s=2.0 * frames.time_s, sample_rate_hz=1000.0)


def peaks_of(seed, n_frames=1, **options):
    """Peaks of frames of two seconds, 0 to 500 Hz."""
    none = np.full((n_frames, 1), np.nan)
    peaks = line_peaks(none, none, seed=seed, **options)
    return replace(
        peaks, frames=slow_frames(n_frames), highest_hz=500.0, frequency_hz=0.5 * peaks.frequency_hz
    )


def carried(state, line, quantity, step_s, density):
    """Mean and covariance of one quantity ahead, by matrices."""
    move = np.array([[1.0, step_s], [0.0, 1.0]])
    mean = move @ [state.position[quantity, line], state.rate[quantity, line]]
    covariance = np.array([
        [state.variance[quantity, line], state.covariance[quantity, line]],
        [state.covariance[quantity, line], state.rate_variance[quantity, line]],
    ])  # fmt: skip
    grown = density * np.array([[step_s**3 / 3.0, step_s**2 / 2.0], [step_s**2 / 2.0, step_s]])
    return mean, move @ covariance @ move.T + grown


def rows_of(state):
    """States with a row for each line, shape (..., 5, 2)."""
    return np.moveaxis(np.stack(state), (0, 1), (-2, -1))


def turned_by(deg):
    return (deg + 180.0) % 360.0 - 180.0


@pytest.mark.parametrize("is_known", [True, False])
def test_a_return_is_weighed_by_gaussians_against_strangers_in_the_band(is_known):
    before, now = states(1, 1), states(1, 2)
    now.position[0], now.rate[0] = before.position[0] + 0.3, before.rate[0] + 0.005
    if not is_known:
        before.variance[1] = 1e8
    density, gap_s, strangers_per_hz = np.array([[1e-4], [1e-2]]), 7.0, 0.03
    ends, begins = (
        PieceEnds(np.array([1]), np.array([at_s]), rows_of(state), density.T)
        for state, at_s in ((before, 100.0), (now, 100.0 + gap_s))
    )
    found = log_ratio_of_return(ends, begins, RESOLUTION_HZ, strangers_per_hz)
    mean, covariance = carried(before, 0, 0, gap_s, 1e-4)
    covariance += np.diag([(0.3 * RESOLUTION_HZ) ** 2, (0.2 * RESOLUTION_HZ**2) ** 2])
    both = now.covariance[0, 0]
    covariance += [[now.variance[0, 0], both], [both, now.rate_variance[0, 0]]]
    course = [now.position[0, 0], now.rate[0, 0]]
    # the rate of a stranger is known as well as it can be: it is steady
    wanted = np.log(0.5 / strangers_per_hz) - norm.logpdf(0.0, 0.0, 0.2 * RESOLUTION_HZ**2)
    wanted += multivariate_normal.logpdf(course, mean, covariance)
    if is_known:
        mean, covariance = carried(before, 0, 1, gap_s, 1e-2)
        around = covariance[0, 0] + now.variance[1, 0]
        wanted -= 0.5 * turned_by(now.position[1, 0] - mean[0]) ** 2 / around
    assert found == pytest.approx(wanted)


def test_a_line_that_turned_is_weighed_by_where_it_may_have_gone():
    """It turned at any part of the gap, and comes back soon where strangers do not."""
    first, now, old_state = states(3, 3), states(3, 4), states(2, 5)
    old_state.variance[1, 1] = 1e8  # no bearing
    store = store_of(first)
    for row in range(12):
        store.keep_frame(row, 2.0 * row, 2.0)
    for entry, own in zip(store.state, now, strict=True):
        entry[:, :3] = own
    store.born[:3], store.risen[:3] = (0, 8, 10), (9, 9, 4)
    told = LineContinuation(store, RESOLUTION_HZ, 500.0, 120.0, may_turn=True)
    old = SilentLines(
        np.array([[1], [2]]), np.array([[10.0], [16.0]]), rows_of(old_state)[:, None],
        np.zeros((2, 1, 2)), np.full((2, 1), -1), np.array([[5], [8]]),
    )  # fmt: skip
    found = told._turned(old, np.arange(3), 0.03)
    begin_s = np.array([[12.0, 16.0, 20.0], [18.0, 18.0, 20.0]])
    share = np.linspace(0.0, 1.0, 20_001)
    for i, j in np.ndindex(2, 3):
        gap_s = begin_s[i, j] - (10.0, 16.0)[i]
        rate, new_rate = old_state.rate[0, i], now.rate[0, j]
        ways = old_state.position[0, i] + gap_s * (share * rate + (1 - share) * new_rate)
        doubt = gap_s**2 * (old_state.rate_variance[0, i] + now.rate_variance[0, j]) / 4
        spread = old_state.variance[0, i] + first.variance[0, j] + ways.var() + doubt
        spread += (0.3 * RESOLUTION_HZ) ** 2
        wanted = norm.logpdf(first.position[0, j], ways.mean(), np.sqrt(spread))
        wait_s = 3.0 / RESOLUTION_HZ
        wanted += np.log(0.5 * 0.5 / 0.03) - gap_s / wait_s
        wanted += np.log(max(begin_s[i].max() / wait_s, 1.0))
        if i == 0:
            turn = turned_by(first.position[1, j] - old_state.position[1, i])
            wanted -= 0.5 * turn**2 / (old_state.variance[1, i] + first.variance[1, j])
        was_there = (10.0, 16.0)[i] - 2.0 * (9, 9, 4)[j] > wait_s
        assert found[i, j] == (-np.inf if was_there else pytest.approx(wanted, rel=1e-6))
    assert np.isinf(found).sum() == 1


def score_logic(kept=0.1, **options):
    peaks = replace(peaks_of(1), kept_probability=kept)
    return LlrScore(ScoreLogic(**options), peaks.frames, peaks), peaks


def test_a_score_adds_the_log_likelihood_ratios_of_all_that_a_frame_says():
    logic, _ = score_logic()
    rng = np.random.default_rng(6)
    store = store_of(states(6, 6), n_confirmed=3)
    store.rows = 40
    slots = np.arange(6)
    rate, score = rng.uniform(0, 1, 6), rng.uniform(0, 9, 6)
    store.hit_rate[:6], store.score[:6], store.best_score[:6] = rate, score, score + 1.0
    store.age[:6] = (5, 100, 20, 3, 4, 5)
    store.faintness[:6] = (1.0, 4.0, 1.0, 1.0, 1.0, 2.9)
    store.least_score[:6] = score - 0.05
    gain, evidence = np.array([2.0, -1.5, 1.0, 0.5]), np.array([4.0, 0.0, 0.3])
    chosen = Choice(np.array([0, 1, 3, 5]), np.arange(4), gain, evidence)
    is_confirmed, is_lost = logic.judge(store, slots, chosen, np.ones(6))
    hit = np.isin(slots, chosen.line)
    detection, chance = logic.detection, 1.0 - np.exp(-3.0 * 0.9 * 0.1)
    for k in range(6):
        if k < 3:  # a confirmed line is seen as often as it was, within bounds
            own = (rate[k] - chance) / (1.0 - chance)
            seen = np.clip(own, detection, max(detection, 0.65))
            strength = np.exp(gain[chosen.line.tolist().index(k)]) if hit[k] else 0.0
            ratio = 1.0 - seen + seen * strength / detection
        else:
            ratio = 1.0 - detection + evidence[k - 3]
        # frames that overlap by half are independent
        assert store.score[k] == pytest.approx(score[k] + np.log(ratio))
        frames = min(store.age[k], 63)
        assert store.hit_rate[k] == pytest.approx(rate[k] + (hit[k] - rate[k]) / frames)
        best = max(score[k] + 1.0, store.score[k])
        assert store.best_score[k] == best
        is_own = hit[k] and best - store.score[k] <= 2.0 and store.faintness[k] < 3.0
        assert store.settled[k] == (40 if is_own else 0)
        is_least = store.score[k] < score[k] - 0.05
        assert store.risen[k] == (41 if is_least else 0)
        assert store.least_score[k] == min(score[k] - 0.05, store.score[k])
    assert np.array_equal(is_confirmed, store.score[:6] >= logic.confirming)
    assert not is_lost.any()
    for fall, patience, is_over in ((9.9, 1.0, 0), (10.1, 1.0, 1), (10.1, 1.1, 0)):
        store.best_score[0] = store.score[0] + fall
        none = Choice(*(np.zeros(0, np.int64),) * 2, np.zeros(0), np.full(3, detection))
        store.best_score[0] += np.log(1.0 - np.clip(
            (store.hit_rate[0] - chance) / (1 - chance), detection, max(detection, 0.65)
        ))  # fmt: skip
        _, is_lost = logic.judge(store, slots, none, np.full(6, patience))
        assert is_lost[0] == is_over
    store.score[3:6] = store.best_score[3:6] = (-1.9, -2.1, 0.0)
    _, is_lost = logic.judge(store, slots, none, np.ones(6))
    assert is_lost[3:].tolist() == [False, True, False]


def test_a_peak_is_weighed_by_its_place_in_resolutions():
    logic, _ = score_logic()
    store = store_of(states(2, 7))
    store.history[:2] = (0, 1)
    variance, line = np.array([0.04, 0.09]), np.array([0, 1, 1])
    off, height = np.array([0.1, -0.3, 0.5]), np.array([1.0, 2.0, -0.5])
    distance = off**2 / variance[line]
    cost, gain = logic.weigh(store, np.arange(2), distance, variance, line, height)
    place = norm.logpdf(off, scale=np.sqrt(variance[line])) + np.log(RESOLUTION_HZ)
    assert gain == pytest.approx(height + place - logic.echo * np.array([0, 1, 1]))
    assert np.array_equal(cost, -gain)


@pytest.mark.parametrize("kept", [0.1, 0.01])
def test_the_score_that_confirms_is_walds(kept):
    logic, _ = score_logic(kept, false_lines_per_khz_hour=5.0)
    births = 1000.0 * 0.9 * 2.0 * kept * 3600.0 / 1.0  # per kHz and hour, a hop of 1 s
    assert logic.confirming == pytest.approx(np.log(0.4 * births / 5.0))
    assert logic.weight == 1.0
    threshold = -np.log(kept)
    window = np.hanning(4001)[:-1]
    shared = (window[2000:] @ window[:2000] / (window @ window)) ** 2
    assert logic.echo == pytest.approx(ECHO * shared * threshold, rel=1e-3)
    store = store_of(states(3, 8))
    store.score[:3] = logic.confirming * np.array([0.49, 0.5, 2.0])
    assert logic.is_likely(store, np.arange(3)).tolist() == [False, True, True]


def test_a_peaks_height_is_rices_ratio_for_the_line_looked_for():
    logic, peaks = score_logic(0.1, design_snr_db=3.0)
    design, excess = 10.0**0.3, 1.225  # a noise peak's mean excess over any threshold
    threshold = -np.log(0.1) / excess
    seen = ncx2.sf(2.0 * threshold, 2, 2.0 * design)
    assert logic.detection == pytest.approx(0.48 * seen)
    assert logic.least_gain == pytest.approx(np.log(1.0 - 0.48 * seen))
    (frame,) = split_frames(peaks, peaks)
    snr_db = np.array([-20.0, -11.0, 0.004, 3.0, 5.0, 9.0, 59.0, 70.0])
    frame = replace(frame, measured=np.tile(snr_db, (6, 1)), frequency_hz=50.0 * np.arange(8))
    power = (1.0 + 10.0 ** (np.maximum(snr_db, -12.0) / 10.0)) / excess
    ratio = np.log(i0(2.0 * np.sqrt(design * power[:-2]))) - design
    wanted = np.minimum(np.append(ratio, [99.0, 99.0]), 3.5)
    assert wanted[4] < 3.5 == wanted[5]
    assert logic.heights(frame) == pytest.approx(wanted, abs=0.01)
    # a line begins with the likelihood of its first peak among those that are kept
    first = wanted - threshold - np.log(seen)
    assert logic.first_score(wanted) == pytest.approx(first)
    least_db = 10.0 * np.log10(excess * np.log(0.48 / 0.02) - 1.0)
    assert logic.may_start(frame).tolist() == (snr_db > least_db).tolist()
    assert logic.most_own == max(logic.detection, 0.65)


def test_frames_that_overlap_more_count_for_less():
    peaks = peaks_of(1)
    dense = replace(peaks.frames, hop_samples=peaks.frames.hop_samples // 4)
    assert LlrScore(ScoreLogic(), dense, peaks).weight == pytest.approx(0.25)


def test_counted_hits_confirm_keep_and_end_lines():
    peaks = peaks_of(1)
    rule = CountLogic(start_hits=3, start_frames=5, keep_hits=2, keep_frames=4)
    logic = HitCounter(rule, peaks.frames, peaks)
    store = store_of(states(7, 9), n_confirmed=3)
    history = [0b1000, 0b100, 0b1001, 0b11, 0b11, 0b1, 0b100]
    age = [9, 9, 9, 3, 3, 4, 5]
    store.history[:7], store.age[:7] = history, age
    chosen = Choice(np.array([0, 3]), np.zeros(2, int), np.zeros(2), np.zeros(4))
    patience = np.array([1.0, 1.0, 1.2, 1.0, 1.0, 1.0, 1.0])
    is_confirmed, is_lost = logic.judge(store, np.arange(7), chosen, patience)
    # two hits in four frames, or in five where the window is 1.2 times as long
    assert is_lost[:3].tolist() == [True, True, False]
    assert is_confirmed.tolist() == [False] * 3 + [True, False, False, False]
    # of five frames two are left for one hit, one for two, and none
    assert is_lost[3:].tolist() == [False, False, True, True]


def test_the_clutter_is_averaged_over_frames_and_neighbours():
    """Loops over cells and frames; a band of 20 Hz in cells of half a hertz."""
    peaks = replace(peaks_of(1), lowest_hz=100.0, highest_hz=120.0)
    clutter = ClutterDensity(peaks.frames, peaks)
    rng = np.random.default_rng(10)
    nominal = 0.9 * peaks.kept_probability
    n_cells = 41
    density, usual, watched, fresh = np.full(n_cells, nominal), 0.0, 0, []
    for frame in range(24):
        frequency = rng.uniform(99.0, 110.0, rng.integers(3, 8))
        clutter.watch(frequency, frequency.size + 2)
        usual = usual or float(frequency.size)
        usual += (frequency.size - usual) / 16.0
        fresh += np.clip((2.0 * (frequency - 100.0)).astype(int), 0, 40).tolist()
        if frame % 8 == 7:
            watched += 8
            n_averaged = min(24 + watched, 128)
            for cell in range(n_cells):
                density[cell] += (fresh.count(cell) - 8 * density[cell]) / n_averaged
            fresh = []
    lasting = np.zeros(n_cells)
    for cell in range(n_cells):
        around = [density[k] for k in range(n_cells) if 2 < abs(k - cell) <= 16]
        mean = np.mean(around)
        mean -= np.sqrt(max(mean, nominal) / (len(around) * n_averaged))
        lasting[cell] = max(np.log(mean / nominal), 0.0) if mean > 0 else 0.0
    at = np.array([99.0, 100.2, 104.9, 109.7, 119.9])
    cells = np.clip((2.0 * (at - 100.0)).astype(int), 0, 40)
    assert clutter.excess(at) == pytest.approx(lasting[cells])
    assert lasting.max() > 1.0
    # 2 of the peaks are lines'; so many more than usual are a click's
    for n_peaks, is_sudden in ((round(usual) + 2, False), (60, True)):
        crowd = np.full(n_peaks, 119.9)
        sudden = np.log((n_peaks - 2) / usual) if is_sudden else 0.0
        assert clutter.excess(crowd) == pytest.approx(lasting[39] + sudden)


def test_process_noise_follows_the_correlation_of_the_innovations():
    n = 40
    rng = np.random.default_rng(11)
    store = store_of(states(n, 12))
    window_s, motion = 2.0, ProcessNoise(adaptation=0.3, doppler_ps3=1e-7)
    last, now = rng.normal(0, 2, (2, n))
    probability = rng.uniform(0, 1, n)
    store.last_innovation[:n] = last
    own = 1e-4 / 2.0**5
    density = own * 10.0 ** rng.uniform(-4, 4, n)
    width = 10.0 ** rng.uniform(-0.5, 2.5, n)
    store.noise_density[0, :n], store.width[:n] = density, width
    adapt_noise(store, np.arange(n), now, probability, motion, window_s)
    for k in range(n):
        product = np.clip(last[k] * now[k], -4.0, 4.0)
        push = product if product < 1.0 else 1.0 + 3.0 * (product - 1.0)
        grown = density[k] * np.exp(0.3 * probability[k] * push)
        greatest = own + 1e-7 * store.frequency_hz[k] ** 2
        assert store.noise_density[0, k] == pytest.approx(np.clip(grown, 1e-3 * own, greatest))
        surplus = min(now[k] ** 2, 4.0) - 0.94 - product
        wider = width[k] * np.exp(0.25 * 0.3 * probability[k] * surplus)
        assert store.width[k] == pytest.approx(np.clip(wider, 1.0, 100.0))
    assert np.array_equal(store.innovation[:n], now)


def pda_tracker(peaks):
    options = TrackerOptions(
        "score", ScoreLogic(), CountLogic(), Feedback(classifier="none"),
        Gates(), ProcessNoise(), Harmonics(),
    )  # fmt: skip
    return PdaLineTracker(options, peaks, snr_db=3.0, lowest_false_alarm=1e-6)


def crowd(seed, has_bearings):
    """A frame with peaks around three lines, some without a bearing."""
    state = states(3, seed)
    state.position[0] = (100.0, 140.0, 180.0)
    state.variance[1, 2] = 1e8
    rng = np.random.default_rng(seed)
    peaks = replace(peaks_of(seed, clutter=12.0), kept_probability=0.1)
    n = peaks.frame.size
    near = np.repeat(state.position[0], n)[: 3 * n : 3][:n]
    near = state.position[0][np.arange(n) % 3]
    bearing = state.position[1][np.arange(n) % 3] + 10.0 * rng.normal(size=n)
    bearing[n // 2] = np.nan
    order = np.argsort(near + 0.15 * rng.normal(size=n))
    peaks = replace(
        peaks,
        frequency_hz=np.sort(near + 0.15 * rng.normal(size=n)),
        bearing_deg=(bearing % 360.0)[order] if has_bearings else np.full(n, np.nan),
        bearing_std_deg=np.full(n, 5.0),
    )
    tracker = pda_tracker(peaks)
    tracker.store = store_of(state, 3, has_bearings=has_bearings, precision=60.0)
    (frame,) = split_frames(peaks, peaks)
    return tracker, frame


@pytest.mark.parametrize("has_bearings", [True, False])
def test_probabilities_of_peaks_are_bayes_over_all_that_may_be(has_bearings):
    tracker, peaks = crowd(13, has_bearings)
    slots, n = np.arange(3), peaks.frequency_hz.size
    line, peak = (a.ravel() for a in np.indices((3, n)))
    pairs = Pairs(line, peak, np.zeros(line.size), np.zeros(line.size))
    weight, gain, allowed = tracker._weigh(slots, pairs, peaks)
    state = tracker.store.state
    has_turn = np.sqrt(state.variance[1, :3]) < 100.0
    false_alarm, detection = tracker._operate(slots, state.variance[:, slots], has_turn, peaks)
    assert (false_alarm > 0).all()
    for k in range(3):
        own = line == k
        inside = tracker.inside[1] if has_turn[k] else tracker.inside[0]
        ways = [1.0 - detection[k] * inside]
        for p in range(n):
            noise = 1.0 / 60.0
            std = np.sqrt(state.variance[0, k] + noise)
            density = norm.pdf(peaks.frequency_hz[p], state.position[0, k], std)
            clutter = 0.9 * 2.0 * false_alarm[k]  # noise peaks above threshold, per Hz
            if has_turn[k] and np.isfinite(peaks.bearing_deg[p]):
                around = np.sqrt(state.variance[1, k] + 25.0)
                turn = turned_by(peaks.bearing_deg[p] - state.position[1, k])
                density *= norm.pdf(turn, scale=around)
                clutter /= 360.0
            # a cell of Rayleigh amplitude passes with the probability of a false alarm
            cell = 1.0 + 10.0 ** (peaks.snr_db[p] / 10.0)
            is_above = np.exp(-cell) <= false_alarm[k]
            assert allowed[own][p] == is_above
            ways.append(detection[k] * density / clutter if is_above else 0.0)
        ways = np.array(ways)
        assert weight[own] == pytest.approx(ways[1:] / ways.sum(), rel=1e-9, abs=1e-15)
        assert gain[own] == pytest.approx(np.log(ways.sum()))


def test_lines_are_sought_at_the_stated_power_over_noise():
    tracker = pda_tracker(peaks_of(1))
    threshold = np.array([2.0, 4.0, 7.0])
    seen = ncx2.sf(2.0 * threshold, 2, 2.0 * 10.0**0.3)
    assert tracker.curve.detection(np.exp(-threshold)) == pytest.approx(seen, rel=1e-3)


@pytest.mark.parametrize("kind", ["plain", "pda"])
def test_process_noise_is_adapted_by_deviations_and_probabilities(monkeypatch, kind):
    """The innovation over its deviation; a peak that two lines share counts nothing."""
    tracker, peaks = crowd(24, False)
    if kind == "plain":
        tracker.__class__ = LineTracker
    tracker.associator.store = tracker.store
    told = []
    monkeypatch.setattr(tracker, "_adapt", lambda *given: told.append(given))
    slots = np.arange(3)
    before = tracker.store.frequency_hz.copy()
    variance = tracker.store.frequency_variance_hz2[:3] + 1.0 / 60.0
    gain = np.array([1.5, -0.5])
    line, peak = np.array([0, 2]), np.array([2, 9])
    if kind == "plain":  # the second and the third cannot be told apart
        tracker.store.state.position[0, 1] = before[2] - 0.7
    tracker._update(slots, Choice(line, peak, gain, np.zeros(0)), peaks)
    own, deviation, probability = told[-1]
    off = peaks.frequency_hz[peak] - before[line]
    wanted = 1.0 / (1.0 + np.exp(-gain))
    doubt = variance[line]
    if kind == "plain":
        wanted[1] = 0.0
        doubt[1] += (0.5 * RESOLUTION_HZ) ** 2
    assert own.tolist() == [0, 2]
    assert deviation == pytest.approx(off / np.sqrt(doubt))
    assert probability == pytest.approx(wanted)


def test_the_precision_of_a_line_is_averaged_over_its_peaks():
    tracker, peaks = crowd(25, False)
    store, slots, peak = tracker.store, np.array([0, 1]), np.array([3, 8])
    store.hits[:2] = (2.0, 40.0)
    tracker._note_peaks(slots, peak, peaks)
    own = 1.0 / peaks.frequency_variance_hz2[peak]
    # six usual peaks before the first, and at most the last 32
    wanted = 60.0 + (own - 60.0) / np.array([9.0, 32.0])
    assert store.precision[:2] == pytest.approx(wanted)
    assert store.faintness[:2] == pytest.approx(60.0 / own)
    assert store.hits[:2].tolist() == [3.0, 41.0]


def test_the_noise_of_a_bearing_rises_with_peaks_beyond_its_gate_and_falls_again():
    tracker, _ = crowd(26, True)
    density, variance = tracker.store.noise_density, np.full(3, 25.0)
    for start, turn_deg, wanted in (
        (1.0, 20.1, 8.0), (1.0, 19.9, 0.8), (0.011, 0.0, 0.01), (500.0, -21.0, 1000.0),
    ):  # fmt: skip
        density[1, :3] = start
        tracker._follow_turns(np.arange(3), np.full(3, turn_deg), variance)
        assert density[1, :3] == pytest.approx(wanted)


@pytest.mark.parametrize("rate_hzps", [None, 0.07])
def test_a_new_line_has_the_state_of_its_peak(rate_hzps):
    peaks = peaks_of(27, clutter=12.0)
    motion = ProcessNoise(frequency_rate_hzps=rate_hzps, bearing_rate_degps=2.0)
    told = TrackerOptions(
        "count", ScoreLogic(), CountLogic(), Feedback(), Gates(), motion, Harmonics()
    )
    n = peaks.frame.size
    unknown = np.where(np.arange(n) == 1, np.nan, peaks.bearing_deg)
    peaks = replace(
        peaks, is_detection=np.ones(n, bool), bearing_deg=unknown,
        frequency_std_hz=np.linspace(0.05, 0.2, n),
    )  # fmt: skip
    tracker = LineTracker(told, peaks)
    (frame,) = split_frames(peaks, peaks)
    free = np.arange(n) != 0
    tracker._start(frame, free, np.zeros(n))
    state, slots = tracker.store.state, np.arange(n - 1)
    own = 1.0 / peaks.frequency_std_hz[1:] ** 2
    precision = (6.0 * own.mean() + own) / 7.0
    assert state.position[0, slots] == pytest.approx(peaks.frequency_hz[1:])
    assert state.variance[0, slots] == pytest.approx(1.0 / precision)
    assert tracker.store.precision[slots] == pytest.approx(precision)
    is_known = np.isfinite(unknown[1:])
    assert state.position[1, slots][is_known] == pytest.approx(unknown[1:][is_known])
    wanted = np.where(is_known, peaks.bearing_std_deg[1:] ** 2, 1e8)
    assert state.variance[1, slots] == pytest.approx(wanted)
    # loud ones may move by a resolution per step: of 1 s and half a hertz
    rate = rate_hzps or 4.0 * 0.25 / (2.0 * 1.0)
    assert state.rate_variance[0, slots] == pytest.approx(rate**2)
    assert state.rate_variance[1, slots] == pytest.approx(4.0)
    assert tracker.store.noise_density[0, slots] == pytest.approx(1e-4 / 2.0**5)
    assert tracker.store.noise_density[1, slots] == pytest.approx(1e-2)
    faint = tracker._first_rate_std_hzps(np.array([True, False]))
    assert faint == pytest.approx([rate, rate_hzps or rate / 8.0])
    tracker._start(frame, free, np.zeros(n))  # the usual precision is remembered
    assert tracker.usual_precision == pytest.approx(own.mean())


def test_an_arrays_turn_loosens_bearings_by_twice_as_much():
    tracker, _ = crowd(28, True)
    before = tracker.store.bearing_variance_deg2[:3].copy()
    for heading in (350.0, np.nan, 5.0, 5.0, 359.0):
        tracker.turn(heading)
    after = tracker.store.bearing_variance_deg2[:3]
    assert after - before == pytest.approx(np.full(3, 30.0**2 + 12.0**2))


def test_a_line_takes_the_mean_and_the_spread_of_what_its_peaks_say():
    tracker, peaks = crowd(14, True)
    rng = np.random.default_rng(15)
    n = peaks.frequency_hz.size
    slot, peak = np.repeat([0, 2], 4), rng.permutation(n)[:8]
    weight = rng.dirichlet(np.ones(5), 2)[:, :4].ravel()
    before = [entry.copy() for entry in tracker.store.state]
    tracker._correct(Mixture(slot, peak, weight), peaks)
    after = tracker.store.state
    for k in (0, 2):
        for quantity in (0, 1):
            mean = np.array([before[0][quantity, k], before[1][quantity, k]])
            prior = np.array([
                [before[2][quantity, k], before[3][quantity, k]],
                [before[3][quantity, k], before[4][quantity, k]],
            ])  # fmt: skip
            parts = [(1.0 - weight[slot == k].sum(), mean, prior)]
            for p, w in zip(peak[slot == k], weight[slot == k], strict=True):
                noise = 1.0 / 60.0 if quantity == 0 else peaks.bearing_variance_deg2[p]
                value = (peaks.frequency_hz, peaks.bearing_deg)[quantity][p]
                off = value - mean[0]
                if quantity == 1:
                    off = 0.0 if np.isnan(off) else turned_by(off)
                gain = prior[:, 0] / (prior[0, 0] + noise)
                parts.append((w, mean + gain * off, prior - np.outer(gain, prior[0])))
            middle = sum(w * m for w, m, _ in parts)
            total = sum(w * (c + np.outer(m - middle, m - middle)) for w, m, c in parts)
            found = [entry[quantity, k] for entry in after]
            wanted = [*middle, total[0, 0], total[0, 1], total[1, 1]]
            assert found == pytest.approx(wanted, rel=1e-7)
    assert all(np.array_equal(b[:, 1], a[:, 1]) for b, a in zip(before, after, strict=True))


def test_peaks_are_given_to_lines_at_the_least_total_cost():
    rng = np.random.default_rng(16)
    for _ in range(30):
        cost = rng.uniform(0.0, 9.0, (4, 6))
        line, peak = (a.ravel() for a in np.indices(cost.shape))
        best = Pairs(line, peak, cost.ravel(), -cost.ravel()).best()
        rows, columns = linear_sum_assignment(cost)
        assert best.line.tolist() == rows.tolist()
        assert best.peak.tolist() == columns.tolist()
        own = Pairs(line, peak, cost.ravel(), -cost.ravel()).best(is_exclusive=False)
        assert own.peak.tolist() == cost.argmin(axis=1).tolist()
    even = Pairs(np.array([0, 0, 1]), np.array([0, 1, 2]), np.zeros(3), np.zeros(3))
    assert even.best().peak.tolist() == [0, 2]  # of equal ones the first


def associator(store, peaks, **options):
    told = TrackerOptions(
        "count", ScoreLogic(), CountLogic(), options.get("feedback", Feedback()),
        options.get("gates", Gates()), ProcessNoise(), Harmonics(),
    )  # fmt: skip
    logic = HitCounter(CountLogic(), peaks.frames, peaks)
    return Associator(store, told, logic, RESOLUTION_HZ)


def test_a_gate_is_so_many_deviations_wide_and_wider_if_recognised():
    peaks = peaks_of(17, clutter=60.0)
    n = peaks.frame.size
    state = states(4, 17)
    state.position[0] = (60.0, 120.0, 180.0, 240.0)
    rng = np.random.default_rng(17)
    near = state.position[0][np.arange(n) % 4] + rng.normal(0.0, 1.0, n)
    turn = state.position[1][np.arange(n) % 4] + rng.normal(0.0, 40.0, n)
    order = np.argsort(near)
    peaks = replace(peaks, frequency_hz=near[order], bearing_deg=(turn % 360.0)[order],
                    bearing_std_deg=np.full(n, 5.0))  # fmt: skip
    (frame,) = split_frames(peaks, peaks)
    store = store_of(state, 2, precision=40.0)
    store.width[:4] = 2.0
    is_wide = np.array([True, False, True, False])
    own = associator(store, peaks)
    found = own.pairs(np.arange(4), is_wide, frame, np.zeros(n))
    wanted = []
    for k, p in np.ndindex(4, n):
        total = state.variance[0, k] + 2.0 / 40.0
        around = state.variance[1, k] + 25.0
        off = frame.frequency_hz[p] - state.position[0, k]
        turned = turned_by(frame.bearing_deg[p] - state.position[1, k])
        reach = 4.0 * (1.5 if is_wide[k] else 1.0)
        if off**2 < reach**2 * total and turned**2 < reach**2 * around:
            wanted.append((k, p, off**2 / total + turned**2 / around))
    assert len(wanted) > 20
    assert list(zip(found.line, found.peak, strict=True)) == [w[:2] for w in wanted]
    assert found.cost == pytest.approx([w[2] for w in wanted])


def test_a_weak_peak_serves_a_recognised_line_that_has_no_other():
    """Its cell's amplitude has 0.8 of the threshold's, or more (Choi 2014)."""
    peaks = peaks_of(18, clutter=30.0)
    n = 6
    cell_db = 9.6 + 20.0 * np.log10(0.8) + np.array([0.05, -0.05, 5.0, 0.05, 0.05, 5.0])
    snr_db = 10.0 * np.log10(10.0 ** (cell_db / 10.0) - 1.0)
    peaks = replace(
        peaks.take("peak", slice(0, n)), frame=np.zeros(n, np.int64),
        frequency_hz=np.array([60.0, 60.1, 120.0, 120.1, 180.0, 240.0]),
        snr_db=snr_db, is_detection=cell_db > 9.6,
    )  # fmt: skip
    (frame,) = split_frames(peaks, peaks)
    own = associator(store_of(states(4, 18), 2), peaks)
    line, peak = np.array([0, 0, 1, 1, 2, 3]), np.arange(6)
    pairs = Pairs(line, peak, np.arange(6.0), np.zeros(6))
    is_wide = np.array([True, True, False, False])
    found = own._allowed(pairs, is_wide, frame)
    # the second is too weak, the fourth has a better one beside, the fifth no licence
    assert found.peak.tolist() == [0, 2, 5]
    assert found.cost.tolist() == [500.0, 2.0, 5.0]


@pytest.mark.parametrize("bearing_gate", [None, 30.0])
@pytest.mark.parametrize("reach_hz", [None, 0.9])
def test_peaks_beside_confirmed_lines_start_no_others(bearing_gate, reach_hz):
    state = states(5, 19)
    state.position[0] = (200.0, 100.0, 101.7, 300.0, 400.0)
    peaks = peaks_of(19, clutter=60.0)
    rng = np.random.default_rng(19)
    n = peaks.frame.size
    frequency = np.sort(state.position[0][rng.integers(0, 5, n)] + rng.normal(0, 1, n))
    peaks = replace(peaks, frequency_hz=frequency, bearing_deg=rng.uniform(0, 360, n))
    (frame,) = split_frames(peaks, peaks)
    gates = Gates(frequency_hz=reach_hz, bearing_deg=bearing_gate)
    own = associator(store_of(state, 4), peaks, gates=gates)
    near = np.abs(frequency[:, None] - state.position[0, :4]) < (reach_hz or 0.5)
    if bearing_gate is not None:
        turn = turned_by(frame.bearing_deg[:, None] - state.position[1, :4])
        near &= np.abs(turn) < bearing_gate
    assert np.array_equal(own.is_claimed(frame), near.any(axis=1))


@pytest.mark.parametrize(
    ("hops", "std", "is_kept"), [(1.4, 1.6, True), (1.6, 1.6, False), (1.6, 1.4, True)]
)
def test_after_a_gap_a_line_known_within_less_than_it_is_wide_goes_on(hops, std, is_kept):
    """More than one and a half steps are a gap, so many resolutions too wide."""
    peaks = peaks_of(20, clutter=30.0)
    peaks = replace(
        peaks.take("peak", np.arange(1)), frame=np.zeros(1, np.int64),
        frequency_hz=np.array([100.0]), frequency_std_hz=np.array([0.05]),
        bearing_deg=np.array([np.nan]), bearing_std_deg=np.array([np.nan]),
        snr_db=np.array([20.0]), is_detection=np.array([True]),
    )  # fmt: skip
    told = TrackerOptions(
        "count", ScoreLogic(), CountLogic(), Feedback(), Gates(), ProcessNoise(), Harmonics()
    )
    tracker = LineTracker(told, peaks)
    state = KalmanState(*np.zeros((5, 2, 1)))
    state.position[0], state.variance[0] = 100.0, (std * RESOLUTION_HZ) ** 2
    tracker.store.start(
        state, np.zeros((2, 1)), np.zeros((6, 1)), np.ones(1, bool), np.ones(1), np.full(1, 400.0)
    )
    tracker.store.confirm(np.arange(1), np.zeros(1, np.int64))
    tracker.last_time_s = 10.0
    (frame,) = split_frames(peaks, peaks)
    tracker.step(0, 10.0 + hops * peaks.frames.hop_s, 1.0, frame)
    assert (tracker.store.confirmed.size == 1) == is_kept


def test_of_two_lines_that_are_one_the_weaker_ends():
    """Tentative before confirmed, then the lower score, then the later one."""

    def ended(n_confirmed, score, *, rate=0.0, off_hz=0.2, n_frames=2):
        state = KalmanState(*np.zeros((5, 2, 2)))
        state.position[0], state.rate[0] = (100.0, 100.0 + off_hz), (0.0, rate)
        state.variance[:], state.rate_variance[:] = 1.0, 1e-4
        store = store_of(state, n_confirmed, has_bearings=False)
        store.score[:2] = score
        for _ in range(n_frames // 2):
            merge_lines(store, Gates(), RESOLUTION_HZ)
        return sorted({0, 1} - set(store.active().tolist()))

    assert ended(1, (0.0, 9.0)) == [1]
    assert ended(0, (0.0, 9.0)) == [0]
    assert ended(0, (9.0, 0.0)) == [1]
    assert ended(0, (3.0, 3.0)) == [1]
    assert ended(0, (3.0, 3.0), off_hz=0.26) == []  # half a resolution
    slip = 3.0 * np.sqrt(2e-4)
    assert ended(0, (3.0, 3.0), rate=0.99 * slip) == [1]
    assert ended(0, (3.0, 3.0), rate=1.01 * slip) == []
    # two confirmed lines: sixty frames together, those of the first look twice
    assert ended(2, (0.0, 9.0), n_frames=56) == []
    assert ended(2, (0.0, 9.0), n_frames=58) == [1]


def samples_of(frequency, bearing=None, std_hz=0.01, correlation=3.0):
    """Lines by time, nan where silent."""
    line, frame = np.nonzero(np.isfinite(frequency))
    nothing = np.full(line.size, np.nan)
    return LineSamples(
        np.searchsorted(line, np.arange(len(frequency) + 1)), frame,
        frequency[line, frame], np.full(line.size, std_hz**2),
        nothing if bearing is None else bearing[line, frame],
        nothing if bearing is None else np.full(line.size, 16.0), correlation,
    )  # fmt: skip


@pytest.mark.parametrize("has_bearings", [True, False])
def test_the_evidence_for_one_source_is_a_ratio_of_gaussians(has_bearings):
    rng = np.random.default_rng(20)
    time = np.arange(90.0)
    bend = 2e-3 * np.tanh((time - 40.0) / 9.0)
    rest = np.array([100.0, 171.0, 250.0, 90.0, 77.0])
    frequency = rest[:, None] * (1.0 + bend + 2e-4 * rng.normal(size=(5, 90)))
    frequency[2] = 250.0 + 0.02 * rng.normal(size=90)
    frequency[0, 60:] = frequency[1, :20] = frequency[3, 45:] = frequency[4, 3:] = np.nan
    frequency[3, :40] = np.nan
    bearing = np.where(np.arange(5) == 2, 170.0, -170.0)[:, None] + 5.0 * rng.normal(size=(5, 90))
    bearing[0, 30:] = np.nan
    samples = samples_of(frequency, bearing if has_bearings else None)
    found = pair_evidence(samples)
    told = dict(zip(zip(found.low, found.high, strict=True), found.nepers, strict=True))
    count = np.isfinite(frequency).sum(axis=1)
    for a in range(5):
        for b in range(a + 1, 5):
            both = np.isfinite(frequency[a]) & np.isfinite(frequency[b])
            if both.sum() < 4 or min(count[a], count[b]) < 4:
                assert (a, b) not in told
                continue
            shift = [np.log(frequency[k] / np.nanmean(frequency[k]))[both] for k in (a, b)]
            spread = shift[0].var() + shift[1].var()
            noise = sum((0.01 / frequency[k][both]) ** 2 for k in (a, b))
            noise = noise + 2.0 * LINE_WANDER**2 + 0.2**2 * spread
            off = shift[0] - shift[1]
            middle = np.average(off, weights=1.0 / noise)
            nepers = norm.logpdf(off, middle, np.sqrt(noise)).sum()
            nepers -= norm.logpdf(off, middle, np.sqrt(noise + spread)).sum()
            if both.sum() < 0.5 * min(count[a], count[b]):
                nepers = min(nepers, 0.0)
            turn = turned_by(bearing[a] - bearing[b])[both]
            turn = turn[np.isfinite(turn)]
            if has_bearings and turn.size >= 4:
                width = np.sqrt(2.0 * 16.0 + 3.0**2)
                nepers += (np.log(360.0) + norm.logpdf(turn, scale=width)).sum()
            assert told[a, b] == pytest.approx(nepers / 3.0, rel=1e-6), (a, b)
    assert told[0, 1] > 3.0
    assert told[0, 2] < 0.0


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_what_changes_by_three_deviations_moves(factor):
    """Frequencies against their noise and a machine's wander; bearings, multipath."""
    sign = np.tile([1.0, -1.0], 50)
    limit_hz = 3.0 * np.hypot(0.05, LINE_WANDER * 300.0)
    frequency = 300.0 + factor * limit_hz * sign[None]
    samples = samples_of(frequency, std_hz=0.05)
    assert has_doppler(samples).tolist() == [factor > 1.0]
    limit_deg = 3.0 * np.hypot(4.0, 3.0)
    bearing = (-179.0 + factor * limit_deg * sign)[None] % 360.0
    bearing = np.append(bearing, np.full((1, 100), 20.0), axis=0)
    bearing[:, 90:] = np.nan
    turned = has_turn(samples_of(np.full((2, 100), 300.0), bearing))
    assert turned.tolist() == [factor > 1.0, False]


def test_multiples_of_one_mains_are_hum():
    """Within 0.1 % and a little, at most half a hertz; 50 or 60 Hz, not both."""
    frequency = np.array([50.0, 100.1, 150.6, 60.0, 1000.45, 1000.55, 350.0, 20.0])
    steady = np.arange(8) != 6
    found = mains_lines(frequency, steady)
    assert found.tolist() == [True, True, False, False, True, False, False, False]
    american = np.array([60.0, 120.0, 180.0, 50.0])
    wanted = [True, True, True, False]
    assert mains_lines(american, np.ones(4, bool)).tolist() == wanted


def test_groups_are_joined_by_the_sum_of_their_evidence():
    """By tables of all pairs, searched anew after each union."""
    rng = np.random.default_rng(21)
    for _ in range(20):
        n = 8
        table = np.triu(rng.normal(0.0, 5.0, (n, n)), 1)
        table *= rng.random((n, n)) < 0.8
        low, high = np.nonzero(table)
        evidence = PairEvidence(low, high, table[low, high])
        label = np.arange(n)
        both = table + table.T
        order = np.argsort(-evidence.nepers, kind="stable")
        for pair in order:
            if evidence.nepers[pair] < 3.0:
                break
            one, two = label[low[pair]], label[high[pair]]
            between = both[np.ix_(label == one, label == two)]
            if one == two or between.sum() < 3.0:
                continue
            if (between <= -6.0).any():
                continue
            label[label == two] = one
        names = list(dict.fromkeys(label.tolist()))
        wanted = [names.index(k) for k in label.tolist()]
        assert group(evidence, n, 3.0).tolist() == wanted


@pytest.mark.parametrize("teeth", [[2, 3, 4, 6, 9], [10, 11, 13]])
def test_spacing_and_its_deviation_are_those_of_a_straight_line(teeth):
    teeth, sigma_hz = np.array(teeth), 0.05
    rng = np.random.default_rng(22)
    frequency = 14.0 * teeth + sigma_hz * rng.normal(size=teeth.size)
    fit = comb_fit(frequency, teeth - teeth.min(), sigma_hz)
    (slope, _), covariance = np.polyfit(teeth, frequency, 1, cov="unscaled")
    assert fit.spacing_hz == pytest.approx(slope)
    assert fit.spacing_std_hz == pytest.approx(sigma_hz * np.sqrt(covariance[0, 0]))
    assert fit.offset_hz == pytest.approx(frequency[0] % slope)
    # the constant's deviation is that of how far the teeth are from multiples
    constant = np.polyfit(teeth, frequency, 1, cov="unscaled")[1][1, 1]
    reach = TOLERANCE * sigma_hz * np.sqrt(constant)
    for share in (0.9, 1.1):
        whole = slope * teeth + share * reach
        assert comb_fit(whole, teeth, sigma_hz).is_harmonic == (
            share < 1.0 and reach < 0.15 * slope
        )


def test_teeth_no_longer_than_two_tolerances_are_not_tried():
    rule = CombRule((0.1, 9.0), 12, 0.2, 10.0, 500.0)
    assert rule.tolerance_hz == pytest.approx(TOLERANCE * np.hypot(0.2, 0.2))
    assert rule.least_spacing_hz == pytest.approx(2.0 * rule.tolerance_hz)
    assert replace(rule, spacing_hz=(4.0, 9.0)).least_spacing_hz == 4.0


def test_a_kink_is_where_two_weighted_straight_courses_do_not_meet():
    rng = np.random.default_rng(23)
    time, window_s, at_s = 1.0 * np.arange(160), 2.0, 81.0
    side = np.sign(time - at_s)
    jump = np.array([0.0, 0.4, 3.0, 3.0])
    value = 100.0 + 0.01 * time[:, None] + 0.5 * side[:, None] * jump
    value += 0.05 * rng.normal(size=value.shape)
    variance = rng.uniform(0.5, 2.0, value.shape) * 0.05**2
    silent = rng.random(value.shape) < 0.2
    silent[(time > at_s) & (time < at_s + 27.0), 3] = True  # four frames are left
    value[silent], variance[silent] = np.nan, np.inf
    paths = MeasuredPaths(
        SimpleNamespace(time_s=time, window_s=window_s),
        SimpleNamespace(position=value[None], variance=variance[None]),
        None,
        np.zeros(2),
    )
    sides = paths.kinks(7 + np.arange(4), at_s)
    assert [side.line.tolist() for side in sides] == [[8, 9]] * 2
    for k, *found in zip((1, 2), *(side.state for side in sides), strict=True):
        for sign, own in zip((-1.0, 1.0), found, strict=True):
            away = sign * (time - at_s) / window_s
            use = (away > KINK) & (away < SIDE) & ~silent[:, k]
            line, covariance = np.polyfit(
                time[use] - at_s, value[use, k], 1, w=variance[use, k] ** -0.5, cov="unscaled"
            )
            assert own[0, 0] == pytest.approx(line[1])
            assert own[2, 0] == pytest.approx(covariance[1, 1])
