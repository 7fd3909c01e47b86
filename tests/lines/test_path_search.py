"""The Viterbi search against brute force; the ends of a line; scores and counts."""

from itertools import product

import numpy as np
from scipy.stats import chi2

from studies.constants.line_ends import scene, scores
from uwtrack_cli.lines.paths.path_search import _centred, best_scores, line_intervals, trace_back
from uwtrack_cli.lines.sensitivity import amplitude_log_ratio, detection_probability
from uwtrack_cli.lines.tracking.track_management import count_hits, push_hits


def test_best_paths_equal_a_search_of_all_paths() -> None:
    rng = np.random.default_rng(1)
    score = rng.standard_normal((5, 4))
    total, moves = best_scores(score, 0.7)
    paths = trace_back(moves, np.arange(4))
    best = np.full(4, -np.inf)
    for path in product(range(4), repeat=5):
        steps = np.abs(np.diff(path))
        if steps.max() <= 1:
            value = score[np.arange(5), list(path)].sum() - 0.7 * steps.sum()
            best[path[-1]] = max(best[path[-1]], value)
    assert np.allclose(total, best)
    kept = score[np.arange(5), paths].sum(1) - 0.7 * np.abs(np.diff(paths)).sum(1)
    assert np.allclose(kept, best)


def test_a_strong_line_at_an_edge_of_the_band_is_moved_to_its_loudest_cell() -> None:
    power_ratio = np.ones((20, 12))
    power_ratio[:, [0, -1]] = 50.0
    for beside, loudest in ((1, 0), (10, 11)):
        path = _centred(np.full(20, beside), power_ratio, 2)
        assert set(path.tolist()) == {loudest}


def test_the_ends_of_a_line_are_found_to_a_few_frames() -> None:
    rng = np.random.default_rng(2)
    first, last = [], []
    for _ in range(50):
        ratio = rng.exponential(1.0, 120)
        ratio[30:80] = 0.5 * rng.noncentral_chisquare(2, 2 * 6.0, 50)
        ((start, stop),) = line_intervals(ratio, np.zeros(120, int))
        first.append(start - 30)
        last.append(stop - 80)
    assert np.abs(np.median(first)) <= 2
    assert np.abs(np.median(last)) <= 2


def test_a_steady_weak_line_keeps_its_whole_length() -> None:
    rng = np.random.default_rng(3)
    whole = [
        line_intervals(ratio, np.zeros(120, int)) == [(0, 120)]
        for ratio in 0.5 * rng.noncentral_chisquare(2, 2 * 0.8, (50, 120))
    ]
    assert np.mean(whole) > 0.9


def test_the_likelihood_ratio_of_noise_averages_to_one() -> None:
    power = np.linspace(0.0, 60.0, 60001)
    ratio = np.exp(amplitude_log_ratio(power, 1.5))
    noise = 2.0 * chi2.pdf(2.0 * power, 2)
    assert np.isclose(np.trapezoid(ratio * noise, power), 1.0, atol=1e-6)


def test_a_steady_lines_detection_is_marcums() -> None:
    rng = np.random.default_rng(4)
    power = 0.5 * rng.noncentral_chisquare(2, 2 * 2.0, 200_000)
    share = np.mean(power > 4.6)
    assert np.isclose(detection_probability(4.6, 2.0), share, atol=0.004)


def test_hits_are_counted_in_a_true_sliding_window() -> None:
    rng = np.random.default_rng(5)
    hits = rng.random(200) < 0.4
    history = np.zeros(1, dtype=np.int64)
    for k, hit in enumerate(hits):
        history = push_hits(history, np.array([hit]))
        for window in (5, 14, 63):
            expected = hits[max(0, k - window + 1) : k + 1].sum()
            assert count_hits(history, window)[0] == expected


def test_weak_lines_end_where_they_fall_silent() -> None:
    ends_s, _, begins_s, cover, ids, _ = scores([scene(2.5, 71)])
    assert ends_s <= 5.0
    assert begins_s <= 8.0
    assert cover > 0.95
    assert ids < 1.2
